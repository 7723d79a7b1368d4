"""The identified configurations of a campaign: computed once, written, and read back by whatever asks again."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from ema import Campaign, Configuration, ModalModel, identify
from ema.picking import read_poles
from updating.errors import StoreError
from updating.quality import Quality, quality
from updating.store import folder_name, read_current, write_frf, write_result


@dataclass(frozen=True, eq=False, kw_only=True)
class Identified:
    """One configuration with its modes, as they are stored.

    Attributes
    ----------
    configuration : Configuration
        As the campaign file has it.
    folder : Path
        Where its results are; `measurement.npz` there holds the functions that were identified.
    modal_model : ModalModel
        The modes.
    quality : Quality
        What the checks found.
    """

    configuration: Configuration
    folder: Path
    modal_model: ModalModel
    quality: Quality


def identified(campaign: Campaign, output: Path, poles: Path | None = None) -> Iterator[Identified]:
    """Identify configuration by configuration, writing each before it is handed on.

    What an earlier run left is read back if the same version made it from the same files with the same options, so
    that an interrupted run goes on where it stopped.

    Parameters
    ----------
    campaign : Campaign
    output : Path
        Folder of the results; each configuration has a folder in it.
    poles : Path, optional
        Folder of earlier results, whose poles.txt files take the place of the automatic choice.

    Raises
    ------
    StoreError
        Two configurations have one folder, a folder cannot be written, or `poles` holds none of this campaign.
    MeasurementError, IdentificationError
        See `ema.identify`.
    """
    _check_folders(campaign)
    chosen = _chosen_poles(campaign, poles)
    write_result(output / "campaign.json", campaign, inputs=(campaign.path, campaign.points), options={})
    for configuration in campaign.configurations:
        yield _identified(campaign, configuration, output, chosen.get(configuration.name))


def _identified(
    campaign: Campaign, configuration: Configuration, output: Path, poles: Path | None
) -> Identified:
    folder = output / folder_name(configuration.name)
    states = (configuration, *configuration.force_levels)
    files = [file for state in states for group in state.files for file in group.files]
    files += [] if poles is None else [poles]
    inputs = (campaign.path, campaign.points, *files)
    asked = {"band_Hz": campaign.identification.band, "order": campaign.identification.order}
    options = {name: value for name, value in asked.items() if value is not None}
    modes = read_current(folder / "modal_model.json", ModalModel, inputs=inputs, options=options)
    checks = read_current(folder / "quality.json", Quality, inputs=inputs, options=options)
    if modes is None or checks is None or not (folder / "measurement.npz").exists():
        by_hand = {} if poles is None else {configuration.name: read_poles(poles)}
        (found,) = identify(replace(campaign, configurations=(configuration,)), by_hand)
        modes, checks = found.modal_model, quality(found)
        write_frf(folder / "measurement.npz", found.measurement.frf)
        write_result(folder / "quality.json", checks, inputs=inputs, options=options)
        # last, for it tells that the others are there
        write_result(folder / "modal_model.json", modes, inputs=inputs, options=options)
    return Identified(configuration=configuration, folder=folder, modal_model=modes, quality=checks)


def _chosen_poles(campaign: Campaign, folder: Path | None) -> dict[str, Path]:
    """Find poles.txt of every configuration that has one in a results folder."""
    if folder is None:
        return {}
    files = {c.name: folder / folder_name(c.name) / "poles.txt" for c in campaign.configurations}
    found = {name: file for name, file in files.items() if file.exists()}
    if not found:
        message = f"{folder}: no */poles.txt of this campaign; `lamella ema` writes them beside its results"
        raise StoreError(message)
    return found


def _check_folders(campaign: Campaign) -> None:
    """Refuse names that differ only in what a folder's name cannot hold."""
    names: dict[str, str] = {}
    for configuration in campaign.configurations:
        other = names.setdefault(folder_name(configuration.name).casefold(), configuration.name)
        if other != configuration.name:
            message = (
                f"{campaign.path}: configurations {other!r} and {configuration.name!r} would both be written to the "
                f"folder {folder_name(configuration.name)}; give them names that differ in letters or digits"
            )
            raise StoreError(message)
