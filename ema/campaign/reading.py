"""What the files of a campaign hold, as its file describes them: FRFs with their coherences, or records to average."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ema.campaign.campaign import Campaign
from ema.campaign.named_files import Format, format_of
from ema.io.array_histories import read_histories
from ema.io.data_arrays import read_data_arrays
from ema.io.measured_function import MeasuredFunction
from ema.io.table import TableLayout, read_records, read_table
from ema.io.tdms import is_cut_off
from ema.io.uff import read_uff_functions
from ema.io.variables import read_variables
from ema.io.wav import read_wav
from ema.types.errors import CampaignError, MeasurementError

_Channels = tuple[MeasuredFunction, ...]
_ARRAYS = ("mat", "hdf5", "numpy", "tdms")
_SAME_START = 0.5  # of a step, by which channels of one record may begin apart


def frfs_of(
    campaign: Campaign, file: Path, notes: list[str]
) -> list[tuple[MeasuredFunction, MeasuredFunction | None]]:
    """Return the FRFs of a file, each with the coherence of its DOFs or, unstated, of its place.

    Raises
    ------
    CampaignError, MeasurementError
        It cannot be read, or not as the campaign file describes it.
    """
    kind = format_of(file, campaign.format)
    if kind in _ARRAYS and not _describes_itself(campaign, kind):
        assert campaign.variables is not None
        notes += _cut_off(file, kind)
        functions = read_variables(file, campaign.variables, campaign.unit, matlab=kind == "mat")
    else:
        functions = _plain(campaign, file, notes)
    frfs = [f for f in functions if f.kind == "frf"]
    coherences = [f for f in functions if f.kind == "coherence"]
    if not frfs:
        kinds = ", ".join(sorted({f.kind for f in functions}))
        notes.append(f"{file}: no FRF in the file, only functions of kind {kinds}")
    return list(zip(frfs, _coherences(frfs, coherences, file, notes), strict=True))


def records_of(
    campaign: Campaign, group: Sequence[tuple[Path, ...]], notes: list[str]
) -> list[list[tuple[Path, _Channels]]]:
    """Return the records of time histories in files, for each run those that are averaged.

    Parameters
    ----------
    campaign : Campaign
    group : sequence of tuple of Path
        Files that are averaged; those of a tuple hold channels of the same records, such as the force and a response.
    notes : list of str
        What was odd is added to it.

    Returns
    -------
    list of list of (Path, tuple of MeasuredFunction)
        For each run its records: a file, for messages, and the channels. Only arrays hold more than one run.

    Raises
    ------
    CampaignError, MeasurementError
        A file cannot be read, or files of one record or one run do not fit each other.
    """
    of_sets = [(files[0], _beside([(f, _records(campaign, f, notes)) for f in files])) for files in group]
    first, runs = of_sets[0]
    for file, others in of_sets:
        if len(others) != len(runs):
            message = f"{file}: holds {len(others)} runs and {first}, which is averaged with it, {len(runs)}"
            raise MeasurementError(message)
    return [[(file, hit) for file, own in of_sets for hit in own[r]] for r in range(len(runs))]


def _records(campaign: Campaign, file: Path, notes: list[str]) -> tuple[tuple[_Channels, ...], ...]:
    """Return for each run of a file its records, for each record its channels."""
    kind = format_of(file, campaign.format)
    if kind in _ARRAYS and not _describes_itself(campaign, kind):
        assert campaign.variables is not None
        notes += _cut_off(file, kind)
        return read_histories(file, campaign.variables, matlab=kind == "mat")
    if kind == "csv" and campaign.table is not None:
        return (_of_table(campaign.table, file, notes),)
    return ((_plain(campaign, file, notes),),)


def _cut_off(file: Path, kind: str) -> list[str]:
    """Say that a file is cut off, and what is read of it."""
    if kind != "tdms" or not is_cut_off(file):
        return []
    return [
        f"{file}: is cut off, as of a recorder or a copy that was stopped; groups that are whole are read, or, where "
        "none is, what all channels of a group have"
    ]


def _of_table(table: TableLayout, file: Path, notes: list[str]) -> tuple[_Channels, ...]:
    """Return the records of a text file; those of its segments are averaged."""
    records = read_records(file, table)
    if len(records) > 1:
        notes.append(f"{file}: its {len(records)} segments are blows or blocks that are averaged")
    return records


def _describes_itself(campaign: Campaign, kind: Format) -> bool:
    """Whether files are functions of SDynPy, which need no description of their variables."""
    return kind == "numpy" and campaign.variables is None


def _plain(campaign: Campaign, file: Path, notes: list[str]) -> _Channels:
    """Return the functions of a universal file, of SDynPy, of a table or of a sound file."""
    if format_of(file, campaign.format) == "uff":
        functions, odd = read_uff_functions(file, campaign.unit, campaign.file_units)
        notes += odd
        return functions
    if format_of(file, campaign.format) == "wav":
        return read_wav(file, campaign.full_scale)
    if format_of(file, campaign.format) == "numpy":
        return read_data_arrays(file, campaign.unit)
    if campaign.table is None:
        message = f"{campaign.path}: measurement: text file {file.name} needs a [measurement.table]"
        raise CampaignError(message)
    return read_table(file, campaign.table, campaign.unit)


def _beside(files: list[tuple[Path, tuple[tuple[_Channels, ...], ...]]]) -> tuple[tuple[_Channels, ...], ...]:
    """Put the channels of files of the same records side by side."""
    (first, records), *others = files
    for file, more in others:
        counts = [[len(run) for run in own] for own in (records, more)]
        if counts[0] != counts[1]:
            message = f"{file}: holds {counts[1]} hits in its runs and {first}, which belongs beside it, {counts[0]}"
            raise MeasurementError(message)
        records = tuple(
            tuple(_one_record(file, a, b) for a, b in zip(run, own, strict=True))
            for run, own in zip(records, more, strict=True)
        )
    return records


def _one_record(file: Path, channels: _Channels, more: _Channels) -> _Channels:
    """Return the channels of one record from two files, which begin at the same time."""
    for channel in more:
        time, reference = channel.abscissa, channels[0].abscissa
        step = float(np.diff(reference).mean()) if reference.size > 1 else 0.0
        if abs(time[0] - reference[0]) > _SAME_START * step:
            message = (
                f"{file}: its times begin at {time[0]:g} s, those of {channels[0].source} at {reference[0]:g} s; files "
                "beside each other hold channels of the same record"
            )
            raise MeasurementError(message)
    return channels + more


def _coherences(
    frfs: list[MeasuredFunction], coherences: list[MeasuredFunction], file: Path, notes: list[str]
) -> Sequence[MeasuredFunction | None]:
    if not coherences:
        return [None] * len(frfs)
    if len({f.abscissa.size for f in (*frfs, *coherences)}) > 1:
        notes.append(
            f"{file}: coherences and FRFs have different numbers of lines; the coherences are left out"
        )
        return [None] * len(frfs)
    if all(f.output is None or f.input is None for f in coherences):
        if len(coherences) == len(frfs):
            return list(coherences)
        notes.append(f"{file}: {len(coherences)} coherences for {len(frfs)} FRFs; they are left out")
        return [None] * len(frfs)
    by_dof = {(f.output, f.input): f for f in coherences}
    return [by_dof.get((f.output, f.input)) for f in frfs]
