"""Configurations of a campaign: identified once, written, and read back, with poles chosen by hand."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TypeVar

import numpy as np
from rich.console import Console

from ema import (
    Campaign,
    Configuration,
    ExplainedPower,
    Identification,
    ModalModel,
    ReadModes,
    Verdict,
    identify,
    read_modes,
)
from ema.identification.exchange import read_poles
from ema.modal.runs import run_changes
from ema.types.errors import EmaError
from lamella_shared import plain_bytes
from model.stack.errors import ModelError
from updating.errors import FitError, PairingError, StoreError
from updating.results.store import (
    file_digest,
    folder_name,
    read_current,
    read_document,
    write_bytes,
    write_frf,
    write_result,
)
from updating.workers.workers import in_parallel

CAMPAIGN = "campaign.json"
"""File of the campaign, in the folder of the results."""


def write_campaign(campaign: Campaign, folder: Path) -> None:
    """Write campaign.json; the path of the campaign file in it is relative to the folder of the results.

    Raises
    ------
    StoreError
        The folder cannot be written.
    """
    inputs = (campaign.path, *points_file(campaign))
    named = replace(campaign, path=_from(folder, campaign.path))
    write_result(folder / CAMPAIGN, named, inputs=inputs, options={})


def points_file(campaign: Campaign) -> tuple[Path, ...]:
    """Return the file of the points, none where the campaign names none."""
    return () if campaign.points is None else (campaign.points,)


def _from(folder: Path, file: Path) -> Path:
    """Return a file as seen from a folder; as it is where they are on different drives."""
    try:
        return Path(Path(os.path.relpath(file, folder)).as_posix())
    except ValueError:
        return file.absolute()


def campaign_file(folder: Path) -> Path:
    """Return the campaign file that results come from.

    It is where the results name it, as seen from them, or from where the command was started that made older ones.
    Results that were copied without that place find the same file, by its digest, in or beside any folder above.

    Raises
    ------
    StoreError
        It is nowhere; the message says where it was.
    """
    document = read_document(folder / CAMPAIGN)
    named = Path(document["result"]["path"])
    # results of older versions name the file from where their command was started
    above = () if ".." in named.parts else (Path(), *folder.absolute().parents)
    for place in (folder.absolute(), *above):
        file = Path(os.path.normpath(place / named))
        if file.is_file():
            return _short(file)
    digests = set(document["provenance"]["inputs"].values())
    for file in _likely(folder, named):
        if file.is_file() and file_digest(file) in digests:
            return _short(file)
    raise StoreError(
        f"{folder}: these results come from {named}, which is not there; open the campaign file itself: lamella "
        f"open CAMPAIGN -o {folder}"
    )


def _likely(folder: Path, named: Path) -> Iterator[Path]:
    """Yield the places above the results that end as the campaign file was named, those with most in common first."""
    parts = [part for part in named.parts if part not in ("..", named.anchor)]
    for first in range(len(parts)):
        for above in folder.absolute().parents:
            yield above.joinpath(*parts[first:])


def _short(file: Path) -> Path:
    """Return a file as seen from the working folder, where it is below it."""
    absolute, working_folder = Path(os.path.normpath(file.absolute())), Path.cwd()
    return absolute.relative_to(working_folder) if absolute.is_relative_to(working_folder) else absolute


CHOSEN = "chosen_poles.txt"
"""File of the poles that a user chose, in the folder of a configuration."""

BY_HAND = "chosen by hand"


def keep_choice(poles: Path, folder: Path) -> None:
    """Make the poles of a file those that every later command identifies a configuration with.

    Parameters
    ----------
    poles : Path
        The file, see `ema.identification.poles_file`.
    folder : Path
        Folder of the configuration.

    Raises
    ------
    IdentificationError
        The file cannot be read or holds no poles.
    StoreError
        The folder cannot be written.
    """
    read_poles(poles)  # so that an error names this file
    write_bytes(folder / CHOSEN, plain_bytes(poles))


def forget_choices(output: Path) -> None:
    """Delete the chosen poles of a results folder and of results in it, so that they are chosen automatically again."""
    for file in (*output.glob(f"*/{CHOSEN}"), *output.glob(f"*/*/{CHOSEN}")):
        file.unlink()


def chosen_poles(campaign: Campaign, output: Path, given: Path | None = None) -> dict[str, Path]:
    """Return the file of the chosen poles of every configuration that has one.

    Parameters
    ----------
    campaign : Campaign
        The campaign.
    output : Path
        Folder of the results. Results that lie in other results of the same campaign take the choice from there.
    given : Path, optional
        Folder whose poles.txt files are chosen from now on.

    Raises
    ------
    IdentificationError
        A poles.txt cannot be read.
    StoreError
        `given` holds no poles.txt of this campaign, or the results cannot be written.
    """
    above = 2  # folders above the results, which may be results, too: what a fit in the workbench writes is in them
    output = output.absolute()
    if given is not None:
        files = {c.name: given.absolute() / folder_name(c.name) / "poles.txt" for c in campaign.configurations}
        existing = {name: file for name, file in files.items() if file.exists()}
        if not existing:
            raise StoreError(f"{given}: no */poles.txt of this campaign; `lamella ema` writes them beside its results")
        for name, file in existing.items():
            keep_choice(file, output / folder_name(name))
    places = [output, *(p for p in output.parents[:above] if _is_of(campaign, p))]
    chosen = {}
    for configuration in campaign.configurations:
        files_ = (place / folder_name(configuration.name) / CHOSEN for place in places)
        chosen[configuration.name] = next((file for file in files_ if file.exists()), None)
    return {name: file for name, file in chosen.items() if file is not None}


def _is_of(campaign: Campaign, folder: Path) -> bool:
    """Whether a folder holds results of a campaign."""
    try:
        return (folder / CAMPAIGN).exists() and campaign_file(folder).samefile(campaign.path)
    except (StoreError, OSError):
        return False


def choice_note(poles: Path) -> str:
    """Say that the poles of a configuration were chosen by hand, and how that is undone."""
    number = read_poles(poles).size
    return (
        f"its {number} poles were {BY_HAND} ({poles.parent.name}/{poles.name}) and are used by every command; "
        "the same command with --identify-anew chooses them automatically again"
    )


@dataclass(frozen=True, kw_only=True)
class Quality:
    """Verdicts of the checks and notes of the reading.

    Attributes
    ----------
    verdicts : tuple of Verdict
        Every check, passed ones too.
    notes : tuple of str
        What was odd in the files and how it was resolved, and which roving runs disagree with the others.
    explained : ExplainedPower
        Share of the measured power that the modes explain, per channel and band.
    """

    verdicts: tuple[Verdict, ...]
    notes: tuple[str, ...]
    explained: ExplainedPower

    @property
    def findings(self) -> tuple[str, ...]:
        """What a user should read: failures of the checks, then warnings, then the notes."""
        texts = (v.text for level in ("fail", "warn") for v in self.verdicts if v.level == level)
        return (*texts, *self.notes)


def quality(identification: Identification, remarks: tuple[str, ...] = ()) -> Quality:
    """Collect the verdicts of the checks and the notes of reading and of comparing roving runs, after remarks."""
    frf = identification.measurement.frf
    changes = run_changes(identification.modal_model, frf.run, sensors_rove=not frf.reciprocal)
    return Quality(
        verdicts=identification.verdicts,
        notes=(*remarks, *identification.measurement.notes, *((changes.finding,) if changes.finding else ())),
        explained=identification.explained,
    )


def quality_of_read(read: ReadModes) -> Quality:
    """Collect the notes of reading modes and the verdicts of their checks; there are no functions to check."""
    n_mode = read.modal_model.frequency.size
    explained = ExplainedPower(
        channel=(),
        edge=np.full(n_mode + 1, np.nan),
        share=np.empty((0, n_mode)),
        whole=np.empty(0),
        quantity=read.modal_model.quantity,
    )
    return Quality(verdicts=read.verdicts, notes=read.notes, explained=explained)


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
        `updating.results.identified`.
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
    (identification,) = identify(assigned.campaign, by_hand)
    remarks = () if poles is None else (choice_note(poles),)
    modes, checks = identification.modal_model, quality(identification, remarks)
    inputs, options = made_from(assigned)
    write_frf(folder / MEASUREMENT, identification.measurement.frf)
    write_result(folder / "quality.json", checks, inputs=inputs, options=options)
    # written last: it shows that the other files are complete, and its digest says of which measurement
    inputs = (*inputs, folder / MEASUREMENT)
    write_result(folder / "modal_model.json", modes, inputs=inputs, options=options)
    return Identified(configuration=configuration, folder=folder, modal_model=modes, quality=checks)


def _read(assigned: Assignment) -> Identified:
    """Read the modes of a configuration whose files hold modes, and write them as an identification is written."""
    folder = assigned.folder
    modes_read = read_modes(assigned.campaign, assigned.configuration.name)
    modes, checks = modes_read.modal_model, quality_of_read(modes_read)
    inputs, options = made_from(assigned)
    (folder / MEASUREMENT).unlink(missing_ok=True)  # of functions that an earlier campaign file named
    write_result(folder / "quality.json", checks, inputs=inputs, options=options)
    write_result(folder / "modal_model.json", modes, inputs=inputs, options=options)
    return Identified(configuration=assigned.configuration, folder=folder, modal_model=modes, quality=checks)


def attempted(task: Callable[[Assignment], R], assigned: Assignment) -> R | Failed:
    """Do a task with one configuration; return its error, so that the others go on.

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
    """Raise the errors of configurations, once the others are done.

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
        raise type(failed[0].error)("\n".join(f"{failure.name}: {failure.error}" for failure in failed))


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
    earlier = [read_back(assignment) for assignment in assigned]
    new = [assignment for assignment, left in zip(assigned, earlier, strict=True) if left is None]
    results = tuple(in_parallel(partial(attempted, identified), new, text, console, cluster))
    require_none([result for result in results if isinstance(result, Failed)], len(assigned))
    now = iter([result for result in results if not isinstance(result, Failed)])
    return tuple(next(now) if left is None else left for left in earlier)


def read_back(assigned: Assignment) -> Identified | None:
    """Return what an earlier run left of a configuration, so that an interrupted run goes on where it stopped.

    None if anything is missing, or another version made it, or from other files or with other options.
    """
    folder = assigned.folder
    inputs, options = made_from(assigned)
    checks = read_current(folder / "quality.json", Quality, inputs=inputs, options=options, keep=assigned.keep)
    measurement = folder / MEASUREMENT
    has_functions = not assigned.configuration.has_modes
    if checks is None or measurement.exists() != has_functions:
        return None
    if has_functions:  # what was truncated, edited or put there from elsewhere has another digest
        inputs = (*inputs, measurement)
    modes = read_current(folder / "modal_model.json", ModalModel, inputs=inputs, options=options, keep=assigned.keep)
    if modes is None:
        return None
    return Identified(configuration=assigned.configuration, folder=folder, modal_model=modes, quality=checks)


def made_from(assigned: Assignment) -> tuple[tuple[Path, ...], dict[str, object]]:
    """Return the files and the options that the results of a configuration depend on."""
    campaign, configuration = assigned.campaign, assigned.configuration
    states = (configuration, *configuration.force_levels)
    files = [file for state in states for group in state.files for file in group.files]
    files += [] if assigned.poles is None else [assigned.poles]
    options: dict[str, object] = {
        "band_Hz": campaign.identification.band, "order": campaign.identification.order,
        "modes": READ if configuration.has_modes else None,
        "poles": None if assigned.poles is None else BY_HAND,
    }  # fmt: skip
    return (
        (campaign.path, *points_file(campaign), *files),
        {name: value for name, value in options.items() if value is not None},
    )


def _check_folders(campaign: Campaign) -> None:
    """Refuse names that differ only in what a folder's name cannot hold."""
    names: dict[str, str] = {}
    for configuration in campaign.configurations:
        first = names.setdefault(folder_name(configuration.name).casefold(), configuration.name)
        if first != configuration.name:
            raise StoreError(
                f"{campaign.path}: configurations {first!r} and {configuration.name!r} would both be written to the "
                f"folder {folder_name(configuration.name)}; give them names that differ in letters or digits"
            )
