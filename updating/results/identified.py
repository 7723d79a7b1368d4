"""The identified configurations of a campaign: computed once, written, and read back by whatever asks again."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TypeVar

from rich.console import Console

from ema import Campaign, Configuration, ModalModel, identify, read_modes
from ema.identification.exchange import read_poles
from ema.types.errors import EmaError
from model.stack.errors import ModelError
from updating.errors import FitError, PairingError, StoreError
from updating.results.chosen_poles import BY_HAND, choice_note, chosen_poles
from updating.results.quality import Quality, quality, quality_of_read
from updating.results.store import folder_name, read_current, write_frf, write_result
from updating.results.stored_campaign import points_file, write_campaign
from updating.workers.workers import in_parallel

R = TypeVar("R")
READ = "read, not identified"
"""What the provenance says of modes that another program identified."""
MEASUREMENT = "measurement.npz"
"""File of the functions that were identified, in the folder of a configuration."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Identified:
    """One configuration with its modes, as they are stored.

    Attributes
    ----------
    configuration : Configuration
        As the campaign file has it.
    folder : Path
        Where its results are; `measurement.npz` there holds the functions that were identified, if any were.
    modal_model : ModalModel
        The modes.
    quality : Quality
        What the checks found.
    """

    configuration: Configuration
    folder: Path
    modal_model: ModalModel
    quality: Quality


@dataclass(frozen=True, eq=False, kw_only=True)
class Assignment:
    """One configuration to be identified, for any process that sees the files.

    Attributes
    ----------
    campaign : Campaign
        With this configuration alone.
    folder : Path
        Folder of its results.
    poles : Path or None
        File of the poles chosen by hand, which take the place of the automatic choice.
    keep : bool
        Whether results that are there are used whatever they came from.
    """

    campaign: Campaign
    folder: Path
    poles: Path | None
    keep: bool = False

    @property
    def configuration(self) -> Configuration:
        """The configuration."""
        return self.campaign.configurations[0]


@dataclass(frozen=True, kw_only=True)
class Failed:
    """A configuration of which nothing came.

    Attributes
    ----------
    name : str
        The configuration.
    error : Exception
        Why, written for the user.
    """

    name: str
    error: Exception


def assignments(
    campaign: Campaign, output: Path, poles: Path | None = None, *, keep: bool = False
) -> tuple[Assignment, ...]:
    """Divide a campaign into its configurations and write campaign.json.

    Parameters
    ----------
    campaign : Campaign
    output : Path
        Folder of the results; each configuration has a folder in it.
    poles : Path, optional
        Folder of earlier results, whose poles.txt files take the place of the automatic choice from now on, see
        `updating.results.chosen_poles`.
    keep : bool
        Whether results that are there are used whatever they came from.

    Raises
    ------
    StoreError
        Two configurations have one folder, a folder cannot be written, or `poles` holds none of this campaign.
    IdentificationError
        A file of chosen poles cannot be read.
    """
    _check_folders(campaign)
    chosen = chosen_poles(campaign, output, poles)
    write_campaign(campaign, output)
    return tuple(
        Assignment(
            campaign=replace(campaign, path=campaign.path.absolute(), configurations=(configuration,)),
            folder=output.absolute() / folder_name(configuration.name),
            poles=chosen.get(configuration.name),
            keep=keep,
        )
        for configuration in campaign.configurations
    )


def identified(assigned: Assignment) -> Identified:
    """Identify one configuration and write it, or read back what an earlier run left, see `read_back`.

    Raises
    ------
    StoreError
        The folder cannot be written.
    MeasurementError, IdentificationError
        See `ema.identification.identify`.
    """
    earlier = read_back(assigned)
    if earlier is not None:
        return earlier
    if assigned.configuration.has_modes:
        return _read(assigned)
    folder, poles, configuration = assigned.folder, assigned.poles, assigned.configuration
    by_hand = {} if poles is None else {configuration.name: read_poles(poles)}
    (found,) = identify(assigned.campaign, by_hand)
    remarks = () if poles is None else (choice_note(poles),)
    modes, checks = found.modal_model, quality(found, remarks)
    inputs, options = made_from(assigned)
    write_frf(folder / MEASUREMENT, found.measurement.frf)
    write_result(folder / "quality.json", checks, inputs=inputs, options=options)
    # last, for it tells that the others are there, and by its digest which measurement is
    inputs = (*inputs, folder / MEASUREMENT)
    write_result(folder / "modal_model.json", modes, inputs=inputs, options=options)
    return Identified(configuration=configuration, folder=folder, modal_model=modes, quality=checks)


def _read(assigned: Assignment) -> Identified:
    """Read the modes of a configuration whose files hold modes, and write them as an identification is written."""
    folder = assigned.folder
    found = read_modes(assigned.campaign, assigned.configuration.name)
    modes, checks = found.modal_model, quality_of_read(found)
    inputs, options = made_from(assigned)
    (folder / MEASUREMENT).unlink(missing_ok=True)  # of functions that an earlier campaign file named
    write_result(folder / "quality.json", checks, inputs=inputs, options=options)
    write_result(folder / "modal_model.json", modes, inputs=inputs, options=options)
    return Identified(configuration=assigned.configuration, folder=folder, modal_model=modes, quality=checks)


def attempted(task: Callable[[Assignment], R], assigned: Assignment) -> R | Failed:
    """Do a task with one configuration; what is wrong with it is returned, so that it does not end the others.

    Parameters
    ----------
    task : callable
        Of one configuration.
    assigned : Assignment
        The configuration.

    Raises
    ------
    StoreError
        Results cannot be written, which ends them all.
    """
    try:
        return task(assigned)
    except (EmaError, ModelError, FitError, PairingError) as error:
        return Failed(name=assigned.configuration.name, error=error)


def require_none(failed: Sequence[Failed], n_configuration: int) -> None:
    """Raise what was wrong with configurations, once the others are done.

    Parameters
    ----------
    failed : sequence of Failed
        Where there is none, nothing happens.
    n_configuration : int
        Number of configurations; one alone need not be named.

    Raises
    ------
    LAMELLA_ERRORS
        Of the first one's kind, with all of them in its message.
    """
    if failed and n_configuration == 1:
        raise failed[0].error
    if failed:
        raise type(failed[0].error)("\n".join(f"{each.name}: {each.error}" for each in failed))


def every_identified(
    assigned: Sequence[Assignment], text: str, console: Console, cluster: str | None = None
) -> tuple[Identified, ...]:
    """Identify configurations in parallel, but read back what an earlier run left: processes take longer to start.

    Parameters
    ----------
    assigned : sequence of Assignment
        The configurations.
    text, console, cluster
        As in `in_parallel`.

    Raises
    ------
    EmaError
        Some cannot be identified; the others are kept.
    """
    earlier = [read_back(each) for each in assigned]
    new = [each for each, found in zip(assigned, earlier, strict=True) if found is None]
    made = tuple(in_parallel(partial(attempted, identified), new, text, console, cluster))
    require_none([each for each in made if isinstance(each, Failed)], len(assigned))
    now = iter([each for each in made if not isinstance(each, Failed)])
    return tuple(next(now) if found is None else found for found in earlier)


def read_back(assigned: Assignment) -> Identified | None:
    """Return what an earlier run left of a configuration, so that an interrupted run goes on where it stopped.

    None if anything is missing, or another version made it, or from other files or with other options.
    """
    folder = assigned.folder
    inputs, options = made_from(assigned)
    checks = read_current(
        folder / "quality.json", Quality, inputs=inputs, options=options, keep=assigned.keep
    )
    measurement = folder / MEASUREMENT
    has_functions = not assigned.configuration.has_modes
    if checks is None or measurement.exists() != has_functions:
        return None
    if has_functions:  # what was truncated, edited or put there from elsewhere has another digest
        inputs = (*inputs, measurement)
    modes = read_current(
        folder / "modal_model.json", ModalModel, inputs=inputs, options=options, keep=assigned.keep
    )
    if modes is None:
        return None
    return Identified(configuration=assigned.configuration, folder=folder, modal_model=modes, quality=checks)


def made_from(assigned: Assignment) -> tuple[tuple[Path, ...], dict[str, object]]:
    """Return the files and the options that the results of a configuration depend on."""
    campaign, configuration = assigned.campaign, assigned.configuration
    states = (configuration, *configuration.force_levels)
    files = [file for state in states for group in state.files for file in group.files]
    files += [] if assigned.poles is None else [assigned.poles]
    asked: dict[str, object] = {
        "band_Hz": campaign.identification.band, "order": campaign.identification.order,
        "modes": READ if configuration.has_modes else None,
        "poles": None if assigned.poles is None else BY_HAND,
    }  # fmt: skip
    return (
        (campaign.path, *points_file(campaign), *files),
        {name: value for name, value in asked.items() if value is not None},
    )


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
