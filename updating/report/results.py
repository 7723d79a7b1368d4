"""What a results folder holds, read back for a report."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any, TypeVar

from ema.campaign.campaign import Campaign, Configuration
from ema.modal.change import Change
from ema.types.frf import FRF
from ema.types.modal_model import ModalModel
from updating.diagnosis.answer import Diagnosis
from updating.diagnosis.explained_model import Updated
from updating.errors import StoreError
from updating.fitting.fit import Fit, ModelFit
from updating.results.campaign import CHANGE, WHAT_CHANGED
from updating.results.identified import Quality, campaign_file
from updating.results.ledger import Entry, Ledger
from updating.results.pooled import PooledDiagnosis
from updating.results.store import file_digest, folder_name, is_intact, read_document, read_frf, read_result
from updating.results.what_changed import WhatChanged

if TYPE_CHECKING:
    from updating.diagnosis.matrices_answer import MatricesFit

T = TypeVar("T")
_MADE = ("modal_model.json", "measurement.npz")
"""Files that results come from and that are results themselves: another run may have put others in their place."""


@dataclass(frozen=True, eq=False, kw_only=True)
class IdentifiedModel:
    """The model of one configuration with what was identified.

    Attributes
    ----------
    effects : tuple of str
        What was added to the base model.
    value : mapping of str to float
        Values of the effects' parameters.
    fit : ModelFit
        The model with them, and its modes.
    base_frac, frac : float
        FRAC of measured functions with those of the base model and of this one, in the mean over all; NaN where no
        functions were measured, or where nothing says where the force acted.
    """

    effects: tuple[str, ...]
    value: Mapping[str, float]
    fit: Fit | ModelFit  # of a stack, or of matrices: each is read back as what it was
    base_frac: float
    frac: float


@dataclass(frozen=True, eq=False, kw_only=True)
class Tested:
    """One configuration that was identified, and fitted or not.

    Attributes
    ----------
    name : str
        The configuration.
    torque : float or None
        Bolt torque, N m.
    pressure : float or None
        Mean surface pressure, Pa.
    folder : Path
        Where its results are.
    measured : ModalModel
        Identified modes.
    quality : Quality
        What the checks found.
    fit : ModelFit or None
        The base model: that of a diagnosis, where `identified_model.with_models` added it, else `opt`.
    opt : Fit or None
        G_f by opt_G and d_f by opt_d of this configuration alone, eq. (1).
    change : Change or None
        What differs from its reference, where it has one.
    what_changed : WhatChanged or None
        What that was, and where, by a model.
    reference : Tested or None
        The first configuration of its reference, where that has results.
    identified : IdentifiedModel or None
        The model with what was identified, where `identified_model.with_models` added it.
    """

    name: str
    torque: float | None
    pressure: float | None
    folder: Path
    measured: ModalModel
    quality: Quality
    fit: ModelFit | None
    opt: Fit | None = None
    change: Change | None = None
    what_changed: WhatChanged | None = None
    reference: Tested | None = None
    identified: IdentifiedModel | None = None

    @property
    def stack_fit(self) -> Fit | None:
        """The base model, where it is that of a stack."""
        return self.fit if isinstance(self.fit, Fit) else None

    @property
    def matrices_fit(self) -> MatricesFit | None:
        """The fit, where it is that of matrices."""
        if self.fit is None or isinstance(self.fit, Fit):
            return None
        # With all of a diagnosis, which few results need.
        from updating.diagnosis.matrices_answer import MatricesFit

        return self.fit if isinstance(self.fit, MatricesFit) else None

    @property
    def has_parameters(self) -> bool:
        """Whether parameters of a model were fitted to this configuration alone."""
        return self.opt is not None or self.matrices_fit is not None

    @property
    def shown(self) -> ModelFit | None:
        """The fit with what was identified, else that of the base model, else none."""
        return self.fit if self.identified is None else self.identified.fit

    @property
    def has_functions(self) -> bool:
        """Whether modes were identified from functions here, not read from another program's file."""
        return not self.measured.read_from

    @property
    def no_functions(self) -> str:
        """Say why there are no functions, where there are none."""
        name = Path(self.measured.read_from).name
        return f"its modes were read from {name}, not identified here, so there are no functions to show"

    def frf(self) -> FRF:
        """Read the measured functions; they are not kept, so that a report of many configurations stays small.

        Raises
        ------
        StoreError
            There are none, as the modes were read, or they cannot be read.
        """
        if not self.has_functions:
            raise StoreError(f"{self.name}: {self.no_functions}")
        return read_frf(self.folder / "measurement.npz")


@dataclass(frozen=True, eq=False, kw_only=True)
class Results:
    """Results of a campaign.

    Attributes
    ----------
    name : str
        The campaign.
    tested : tuple of Tested
        Its configurations.
    missing : tuple of str
        Configurations that are not done yet.
    ledger : tuple of Entry
        What each effect does to the error; empty where no effect was fitted.
    diagnosis : Diagnosis or None
        Which effect is missing, where that was asked.
    updated : Updated or None
        What an updating file made of all configurations together.
    folder : Path
        Where all this is.
    campaign : Path or None
        The campaign file, as it was named; None of specimens.
    pooled : PooledDiagnosis or None
        What many specimens tell together, where the campaign lists them.
    origin : mapping of str to dict
        Provenance of every result file, by its path within the folder.
    remarks : tuple of str
        Which results were changed, or come from other files than those beside them.
    about : tuple of (str, str)
        Title block, by name: project, author and date as far as the campaign states them.
    """

    name: str
    tested: tuple[Tested, ...]
    missing: tuple[str, ...]
    ledger: tuple[Entry, ...]
    diagnosis: Diagnosis | None
    updated: Updated | None
    folder: Path
    campaign: Path | None
    pooled: PooledDiagnosis | None
    origin: dict[str, dict[str, Any]]
    remarks: tuple[str, ...] = ()
    about: tuple[tuple[str, str], ...] = ()


def read_results(folder: Path, *, keep: bool = False) -> Results:
    """Read everything in a results folder that a report shows.

    A fit, a ledger, a diagnosis or an updating that was changed after it was written, or that comes from other modes
    than those beside it, is left out, and the remarks say so.

    Parameters
    ----------
    folder : Path
        Folder of the results.
    keep : bool
        Whether such results are read, too; the remarks then say which they are.

    Raises
    ------
    StoreError
        The folder holds no result, one that cannot be read, or measured modes that were changed.
    """
    reader = _Reader(folder, keep=keep)
    for name in ("pooled_diagnosis.json", "pooled_fit.json"):  # a diagnosis says more
        if (folder / name).exists():
            return _read_pooled(folder, name, reader)
    if (folder / "campaign.json").exists():
        results = _read_campaign(folder, reader)
    else:
        raise StoreError(
            f"{folder}: no campaign.json to report on; make results with: lamella fit CAMPAIGN -o {folder}"
        )
    if not results.tested:
        raise StoreError(f"{folder}: none of its configurations is done; go on with: lamella fit CAMPAIGN -o {folder}")
    return results


class _Reader:
    """Reads results of a folder, and notes which of them are not what they were or belong to something else."""

    def __init__(self, folder: Path, *, keep: bool) -> None:
        self._folder, self._keep = folder, keep
        self._digests: dict[str, dict[Path, str]] = {}
        self.remarks: list[str] = []
        self.origin: dict[str, dict[str, Any]] = {}

    def needed(self, path: Path, kind: type[T]) -> T:
        """Return a result without which there is nothing to show; a fault is an error, or a remark if kept."""
        fault = self._fault(path)
        if fault and not self._keep:
            raise StoreError(f"{path}: {fault}; make it anew with the command that made it, or use it with --keep")
        return self._read(path, kind, fault)

    def optional(self, path: Path, kind: type[T]) -> T | None:
        """Return a result; None where there is none or it has a fault and is not kept."""
        if not path.exists():
            return None
        fault = self._fault(path)
        if fault and not self._keep:
            self._remark(path, f"{fault}, and is left out; make it anew with the command that made it, or use --keep")
            return None
        return self._read(path, kind, fault)

    def _read(self, path: Path, kind: type[T], fault: str) -> T:
        result = read_result(path, kind, edited=True)
        if fault:
            self._remark(path, f"{fault}, and is used all the same (--keep)")
        self.origin[path.relative_to(self._folder).as_posix()] = read_document(path)["provenance"]
        return result

    def _remark(self, path: Path, text: str) -> None:
        self.remarks.append(f"{path.relative_to(self._folder).as_posix()} {text}.")

    def _fault(self, path: Path) -> str:
        """Return what is wrong with the origin of a result; empty where all is well."""
        document = read_document(path)
        if not is_intact(document):
            return "was changed after it was written"
        for name, digest in document["provenance"]["inputs"].items():
            last = PurePosixPath(name).name
            digests = self._beside(path, name) if last in _MADE else ()
            if digests and digest not in digests:
                return f"comes from another {name} than is here"
        return ""

    def _beside(self, path: Path, name: str) -> Collection[str]:
        """Return the digests of the files that a result can come from.

        That is the one in the folder that its name says, else the one beside the result, else any of that name below.
        """
        stated, name = self._folder / name, PurePosixPath(name).name
        if name not in self._digests:
            self._digests[name] = {file: file_digest(file) for file in self._folder.rglob(name)}
        digests = self._digests[name]
        named = stated if stated in digests else path.parent / name
        return (digests[named],) if named in digests else digests.values()


def _read_campaign(folder: Path, reader: _Reader) -> Results:
    campaign = reader.needed(folder / "campaign.json", Campaign)
    folders = {c.name: folder / folder_name(c.name) for c in campaign.configurations}
    identified = [c for c in campaign.configurations if (folders[c.name] / "modal_model.json").exists()]
    del reader.origin["campaign.json"]
    tested = _with_references([_read_tested(folders[c.name], c, reader) for c in identified])
    return Results(
        name=campaign.name,
        tested=tested,
        missing=tuple(name for name in folders if name not in {c.name for c in identified}),
        **_read_common(folder, reader),
        campaign=_campaign_file(folder),
        about=tuple(
            (name, text)
            for name, text in (
                ("Project", campaign.project),
                ("Author", campaign.author),
                ("Date of the test", campaign.date),
            )
            if text
        ),
        pooled=None,
    )


def _campaign_file(folder: Path) -> Path:
    """Return the campaign file; as it was named where it is not there, for results can be read without it."""
    try:
        return campaign_file(folder)
    except StoreError:
        return read_result(folder / "campaign.json", Campaign, edited=True).path


def _read_tested(folder: Path, configuration: Configuration, reader: _Reader) -> Tested:
    fit = reader.optional(folder / "fit.json", _kind_of_fit(folder / "fit.json"))
    return Tested(
        name=configuration.name,
        torque=configuration.torque,
        pressure=configuration.pressure,
        folder=folder,
        measured=reader.needed(folder / "modal_model.json", ModalModel),
        quality=reader.needed(folder / "quality.json", Quality),
        fit=fit,
        opt=fit if isinstance(fit, Fit) else None,
        change=reader.optional(folder / CHANGE, Change) if configuration.compare_to else None,
        what_changed=reader.optional(folder / WHAT_CHANGED, WhatChanged) if configuration.compare_to else None,
    )


def _with_references(configurations: Sequence[Tested]) -> tuple[Tested, ...]:
    """Return configurations, each with the reference that it is compared with."""
    named = {tested.name: tested for tested in configurations}
    return tuple(
        tested if tested.change is None else replace(tested, reference=named.get(tested.change.reference[0]))
        for tested in configurations
    )


def _kind_of_fit(path: Path) -> type[ModelFit]:
    """Return what a fit is of: matrices, or a stack."""
    if not path.exists() or read_document(path)["kind"] == Fit.__name__:
        return Fit
    # With all of a diagnosis, which few results need.
    from updating.diagnosis.matrices_answer import MatricesFit

    return MatricesFit


def _read_common(folder: Path, reader: _Reader) -> dict[str, Any]:
    """Read what a campaign of either kind may have."""
    ledger = reader.optional(folder / "ledger.json", Ledger)
    return {
        "folder": folder,
        "ledger": () if ledger is None else ledger.entry,
        "diagnosis": reader.optional(folder / "diagnosis.json", Diagnosis),
        "updated": reader.optional(folder / "update.json", Updated),
        "origin": reader.origin,
        "remarks": tuple(reader.remarks),
    }


def _read_pooled(folder: Path, name: str, reader: _Reader) -> Results:
    pooled = reader.needed(folder / name, PooledDiagnosis)
    return Results(
        name=pooled.name,
        tested=(),
        missing=(),
        ledger=(),
        diagnosis=None,
        updated=None,
        pooled=pooled,
        folder=folder,
        campaign=None,
        origin=reader.origin,
        remarks=tuple(reader.remarks),
    )
