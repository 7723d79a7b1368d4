"""Campaigns of many specimens on one rig: the form of their file, and the one reader of all their sources."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import Field, model_validator

from ema import Campaign
from ema.campaign.campaign import campaign_of, geometry_of
from ema.campaign.campaign_file import (
    CampaignFile,
    CommonSections,
    ConfigurationSection,
    DofEntry,
    FileNames,
    PointsSection,
    StateSection,
    reference_faults,
)
from ema.io.files import Section
from ema.types.frf import Geometry
from ema.types.modal_model import ModalModel
from lamella_shared import did_you_mean, read_form, read_toml
from model import Stack, read_stack
from model.stack.errors import StackError
from model.stack.stack_file import stack_inputs
from updating.errors import FitError, StoreError
from updating.pooled.specimen import Specimen, classes, modal_model
from updating.results.store import read_result

if TYPE_CHECKING:
    from updating.pooled.specimen import Classes


class MaterialSection(Section):
    """What a specimen's steel has other than the stack file states."""

    young_GPa: float | None = Field(default=None, gt=0, le=1e3)
    poisson: float | None = Field(default=None, gt=-1, lt=0.5)
    density_kg_m3: float | None = Field(default=None, gt=0, le=1e5)
    transverse_ratio: float | None = Field(default=None, gt=0, le=1e2)
    shear_ratio: float | None = Field(default=None, gt=0, le=1e2)


class SpecimenConfigurationSection(StateSection):
    """One state of a specimen, and where its modes come from."""

    modal_model: str | None = None
    modes: str | None = None
    shapes: str | None = None
    force: DofEntry | None = None

    @model_validator(mode="after")
    def _one_source(self) -> SpecimenConfigurationSection:
        sources = {"files": self.files or self.run, "modal_model": self.modal_model, "modes": self.modes}
        given = [key for key, value in sources.items() if value]
        if len(given) != 1:
            raise ValueError(
                f"configuration {self.name!r}: give one source of its modes: 'files' or [[specimen.configuration.run]] "
                f"of FRFs, 'modal_model', or 'modes'; found {', '.join(given) or 'none'}"
            )
        if (self.shapes is None) != (self.force is None) or (self.shapes and not self.modes):
            raise ValueError(
                f"configuration {self.name!r}: 'shapes' goes with 'modes' and with 'force', the DOF of the force such "
                "as '45+z'"
            )
        return self

    @property
    def measured(self) -> bool:
        """Whether FRFs are to be identified."""
        return bool(self.files or self.run)


class SpecimenSection(Section):
    """One specimen: what its stack has other than that of the rig, notes, and configurations."""

    name: str
    compare_to: FileNames = ()
    repeat_of: str | None = None
    stack: str | None = None
    height_mm: float | None = Field(default=None, gt=0, allow_inf_nan=False)
    n_lamina: int | None = Field(default=None, ge=1)
    material: MaterialSection = MaterialSection()
    notes: dict[str, str] = Field(default_factory=dict)
    configuration: tuple[SpecimenConfigurationSection, ...] = Field(min_length=1)


class RigSection(Section):
    """The rig that all specimens share, with the stack values that they do not state themselves."""

    stack: str


class SpecimensFile(CommonSections):
    """The whole file."""

    structure: RigSection
    points: PointsSection | None = None
    specimen: tuple[SpecimenSection, ...] = Field(min_length=2)


@dataclass(frozen=True, eq=False, kw_only=True)
class SpecimenCampaign:
    """A campaign of many specimens, its FRFs not loaded.

    Attributes
    ----------
    name : str
        Title.
    path : Path
        The file.
    content : SpecimensFile
        What it holds.
    stacks : tuple of Stack
        Of each specimen.
    geometry : Geometry or None
        The measured points, where they are listed.
    measured : Campaign or None
        All configurations that are given as FRFs, named "specimen configuration", for the identification.
    inputs : tuple of Path
        Files that were read.
    """

    name: str
    path: Path
    content: SpecimensFile
    stacks: tuple[Stack, ...]
    geometry: Geometry | None
    measured: Campaign | None
    inputs: tuple[Path, ...]


def has_specimens(path: Path) -> bool:
    """Whether a campaign file lists specimens; an unreadable file does not, and its reader will say why."""
    try:
        return "specimen" in read_toml(path)
    except (OSError, ValueError, RecursionError):
        return False


def read_specimens(path: Path) -> SpecimenCampaign:
    """Read a campaign file with `[[specimen]]` tables.

    Raises
    ------
    FitError
        The file asks for what does not exist or is not possible; the message names file, table and key.
    StackError
        A stack file cannot be read, or what a specimen states makes no stack.
    CampaignError, MeasurementError
        What is wrong with points or FRF files.
    """
    content = read_form(path, SpecimensFile, FitError)
    _require_unique(path, content)
    folder = path.resolve().parent
    files = [folder / (specimen.stack or content.structure.stack) for specimen in content.specimen]
    stacks = tuple(_stack(path, file, specimen) for file, specimen in zip(files, content.specimen, strict=True))
    listed = content.points is not None and content.points.file is not None
    geometry = geometry_of(path, folder, content.points)[0] if content.points is not None and listed else None
    sources = [
        folder / str(name)
        for specimen in content.specimen
        for c in specimen.configuration
        for name in (c.modal_model, c.modes, c.shapes)
        if name is not None
    ]
    _require_files(path, sources)
    stack_files = tuple(dict.fromkeys(file for name in files for file in stack_inputs(name)))
    return SpecimenCampaign(
        name=content.campaign.name,
        path=path,
        content=content,
        stacks=stacks,
        geometry=geometry,
        measured=_measured(path, content),
        inputs=(path, *stack_files, *sources),
    )


def specimens_of(campaign: SpecimenCampaign, identified: Callable[[str], ModalModel]) -> tuple[Specimen, ...]:
    """Return the specimens with the modes of all their configurations, whatever they come from.

    Parameters
    ----------
    campaign : SpecimenCampaign
        The campaign.
    identified : callable
        The modes of a configuration of `SpecimenCampaign.measured`, by its name.

    Raises
    ------
    FitError
        A table is not as it should be, or the model lacks a mode of a class.
    StoreError
        A file is no modal model.
    """
    # With parts of a diagnosis, which nobody waits for who only asks what a file is.
    from updating.pooled.specimen import Classes

    specimens, of_classes = [], Classes()
    for stack, specimen in zip(campaign.stacks, campaign.content.specimen, strict=True):
        tested = []
        for c in specimen.configuration:
            state = stack if c.pressure_kPa is None else stack.with_contact(pressure=1e3 * c.pressure_kPa)
            modes = (
                identified(full_name(specimen, c)) if c.measured else _tabled(campaign, stack, specimen, c, of_classes)
            )
            tested.append((c.name, state.contact.pressure, modes))
        specimens.append(Specimen(name=specimen.name, stack=stack, tested=tuple(tested), notes=dict(specimen.notes)))
    return tuple(specimens)


def full_name(specimen: SpecimenSection, configuration: SpecimenConfigurationSection) -> str:
    """Return what a configuration is called among those of all specimens."""
    return f"{specimen.name} {configuration.name}"


def _tabled(
    campaign: SpecimenCampaign,
    stack: Stack,
    specimen: SpecimenSection,
    c: SpecimenConfigurationSection,
    of_classes: Classes,
) -> ModalModel:
    """Return modes that were identified before."""
    folder, name = campaign.path.resolve().parent, full_name(specimen, c)
    of = {"specimen": specimen.name, "configuration": c.name}
    if c.modal_model is not None:
        try:
            return read_result(folder / c.modal_model, ModalModel, edited=True)
        except StoreError as error:
            raise FitError(f"{campaign.path}: {name}: modal_model: {error}") from error
    modes = folder / str(c.modes)
    if c.shapes is None or c.force is None:
        wanted, poles = classes(modes, of)
        return of_classes.modes(f"{modes}: {name}", stack, wanted, poles)
    if campaign.geometry is None:
        raise FitError(f"{campaign.path}: {name}: shapes need [points] with the list of measured points")
    return modal_model(name, of, modes, folder / c.shapes, campaign.geometry, c.force)


def _stack(path: Path, file: Path, specimen: SpecimenSection) -> Stack:
    """Return the stack of a specimen: that of its file with the values that the specimen states."""
    stack = read_stack(file)
    in_si = {"young_GPa": ("young", 1e9), "density_kg_m3": ("density", 1.0)}
    stated = specimen.material.model_dump(exclude_none=True)
    steel = {name: factor * x for key, x in stated.items() for name, factor in [in_si.get(key, (key, 1.0))]}
    changes: dict[str, Any] = {"material": replace(stack.material, **steel)}
    changes |= {} if specimen.height_mm is None else {"height": 1e-3 * specimen.height_mm}
    changes |= {} if specimen.n_lamina is None else {"n_lamina": specimen.n_lamina}
    try:
        return replace(stack, **changes)
    except StackError as error:
        raise StackError(f"{path}: specimen {specimen.name!r}: {error}") from error


def _measured(path: Path, content: SpecimensFile) -> Campaign | None:
    """Return the campaign of the configurations that are given as FRFs."""
    sections = tuple(
        ConfigurationSection.model_construct(
            **{key: getattr(c, key) for key in StateSection.model_fields}
            | {"name": full_name(specimen, c), "stack": specimen.name}
        )
        for specimen in content.specimen
        for c in specimen.configuration
        if c.measured
    )
    if not sections:
        return None
    if content.points is None or content.points.file is None:
        raise FitError(f"{path}: points: this table, or file in it, is missing; FRFs need the list of measured points")
    shared = {key: getattr(content, key) for key in (*CommonSections.model_fields, "structure", "points")}
    return campaign_of(path, CampaignFile.model_construct(**shared, configuration=sections))


def _require_unique(path: Path, content: SpecimensFile) -> None:
    names = [specimen.name for specimen in content.specimen]
    if len(set(names)) < len(names):
        raise FitError(f"{path}: specimen: names must be unique, found {', '.join(names)}")
    faults = [f"{path}: specimen {fault}" for fault in reference_faults(content.specimen)]
    if faults:
        raise FitError("\n".join(faults))
    for specimen in content.specimen:
        states = [c.name for c in specimen.configuration]
        if len(set(states)) < len(states):
            there = ", ".join(states)
            raise FitError(f"{path}: specimen {specimen.name!r}: configuration: names must be unique, found {there}")


def _require_files(path: Path, files: list[Path]) -> None:
    for file in files:
        try:
            there_is = file.is_file()
        except OSError as error:  # such as a name that is too long
            raise FitError(f"{path}: {str(file)[:120]}: {error.strerror}") from error
        if not there_is:
            there = sorted(sibling.name for sibling in file.parent.glob("*")) if file.parent.is_dir() else []
            hint = did_you_mean(file.name, there) if there else f"there is no folder {file.parent}"
            raise FitError(f"{path}: {file} is not there; {hint}")
