"""What the files of a campaign hold: FRFs with their coherences, or records to average, and lines that all share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from ema.campaign.campaign import Campaign
from ema.campaign.campaign_file import Format, format_of
from ema.campaign.estimate import (
    FEWEST_SAMPLES,
    Averaging,
    FRFEstimate,
    FRFMatrixEstimate,
    clipped_share,
    cut_at_hits,
    estimate_frf,
    estimate_frf_matrix,
    pulse_samples,
    second_pulse,
)
from ema.io.array_files import is_cut_off
from ema.io.array_histories import read_histories, read_wav
from ema.io.measured_function import (
    Channels,
    MeasuredFunction,
    Unit,
    is_uneven,
    parse_unit,
    records_in,
    said_of_rounded,
)
from ema.io.sdynpy import read_data_arrays
from ema.io.table import TableLayout, read_records, read_table
from ema.io.uff import read_uff_functions
from ema.io.variables import read_variables
from ema.types.errors import CampaignError, MeasurementError
from lamella_shared import Booleans, Complexes, Reals

_Found = tuple[MeasuredFunction, MeasuredFunction | None, float, float]


def frfs_from_records(
    contents: list[tuple[Path, tuple[MeasuredFunction, ...]]], averaging: Averaging, notes: list[str]
) -> list[_Found]:
    """Estimate the FRFs of one run from its files, each of which holds the same forces and responses.

    Parameters
    ----------
    contents : list of (Path, tuple of MeasuredFunction)
        Files and what they hold; all of them are averaged.
    averaging : Averaging
        Estimator, windows, positions of the forces, units.
    notes : list of str
        Overloads and double hits, which are not used, are added to it, and of several forces what they share.

    Returns
    -------
    list of (FRF, coherence or None, share of overloaded samples, decay rate)
        One entry for each response, in reading order, of several forces one for each response and force; the coherence
        is then the partial one. The last is what an exponential window adds, 1/s.

    Raises
    ------
    MeasurementError
        The files do not hold the same number of forces and responses on one uniform time axis, or no single hit.
    """
    sorted_channels = [_force_first(file, functions, averaging) for file, functions in contents]
    records = [channels for channels, _ in sorted_channels]
    n_force = sorted_channels[0][1]
    if any(forces != n_force for _, forces in sorted_channels):
        raise MeasurementError(f"{contents[0][0]} and the files averaged with it hold different numbers of forces")
    counts = {len(channels) for channels in records}
    if len(counts) > 1:
        raise MeasurementError(
            f"{contents[0][0]} and the files averaged with it hold different numbers of channels: {counts}"
        )
    n_sample = min(channel.abscissa.size for channels in records for channel in channels)
    rate = _rate(records)
    value = np.array([[channel.value[:n_sample] for channel in channels] for channels in records])
    clipped = np.array([[clipped_share(record) for record in channels] for channels in value])
    if n_force == 1:
        value = _single_hits(contents[0][0], value, rate, averaging, notes)
    force, response = value[:, :n_force].swapaxes(0, 1), value[:, n_force:].swapaxes(0, 1)
    if n_force == 1:
        estimate = estimate_frf(force[0], response, rate, averaging)
    else:
        matrix = estimate_frf_matrix(force, response, rate, averaging)
        _note_forces(contents[0][0], records[0], matrix, notes)
        estimate = _one_by_one(matrix)
    if estimate.decay_rate > 0:
        notes.append(
            f"{contents[0][0]}: the exponential window adds {estimate.decay_rate:.4g} 1/s to the decay rate of "
            "every mode; damping ratios are given without it"
        )
    return _functions(records, n_force, estimate, clipped, averaging, notes)


def _one_by_one(matrix: FRFMatrixEstimate) -> FRFEstimate:
    """Lay the functions of several forces out in a row, for each response those of all forces."""
    n_frequency = matrix.frequency.size
    return FRFEstimate(
        frequency=matrix.frequency,
        value=matrix.value.reshape(-1, n_frequency),
        coherence=matrix.partial_coherence.reshape(-1, n_frequency),
        n_average=matrix.n_average,
        decay_rate=matrix.decay_rate,
    )


def _note_forces(file: Path, channels: list[MeasuredFunction], matrix: FRFMatrixEstimate, notes: list[str]) -> None:
    """Note how much of each response the forces explain together, and how independent the forces are."""
    # Share of a force that is in the others from which on it is reported: the variance of its functions is doubled.
    most_shared = 0.5
    n_force = matrix.independent.shape[0]
    power = np.sum(np.abs(matrix.value) ** 2, axis=1)
    multiple = np.sum(power * matrix.multiple_coherence, axis=1) / np.sum(power, axis=1)
    worst = int(np.argmin(multiple))
    notes.append(
        f"{file}: {n_force} forces at once, {matrix.n_average} averages: of its power they explain "
        f"{np.median(multiple):.2f} in the median over the responses (multiple coherence), {multiple[worst]:.2f} at "
        f"least ({channels[n_force + worst].source})"
    )
    shared = 1.0 - np.median(matrix.independent, axis=1)
    if shared.max() > most_shared:
        notes.append(
            f"{file}: {100 * shared.max():.0f} % of a force is in the others, too: its functions are less certain"
        )


def _functions(
    records: list[list[MeasuredFunction]],
    n_force: int,
    estimate: FRFEstimate,
    clipped: Reals,
    averaging: Averaging,
    notes: list[str],
) -> list[_Found]:
    """Return each response's FRFs in SI units with their coherence; `clipped` are shares (n_record, n_channel)."""
    factor, unit = _unit(averaging)
    functions: list[_Found] = []
    for k, (response, force) in enumerate(product(records[0][n_force:], records[0][:n_force])):
        channel = n_force + k // n_force
        more = "" if len(records) == 1 else f" and {len(records) - 1} more"
        frf = replace(
            response,
            kind="frf",
            abscissa=estimate.frequency,
            value=estimate.value[k] * factor,
            quantity=response.quantity if unit is None else unit.motion,
            input=force.output or (response.input if n_force == 1 else None),
            source=response.source + more,
        )
        coherence = None
        if estimate.coherence is not None:
            coherence = replace(frf, kind="coherence", value=estimate.coherence[k], quantity=None)
        overload = float(clipped[:, [*range(n_force), channel]].max())
        if overload > 0 and force is records[0][0]:
            notes.append(f"{response.source}: {100 * overload:.2g} % of its samples or its force's are clipped")
        functions.append((frf, coherence, overload, estimate.decay_rate))
    return functions


def _force_first(
    file: Path, functions: tuple[MeasuredFunction, ...], averaging: Averaging
) -> tuple[list[MeasuredFunction], int]:
    """Return the time histories of a file, forces first, and how many forces there are."""
    channels = [f for f in functions if f.kind in ("force", "response")]
    forces = [f for f in channels if f.kind == "force"]
    stated = averaging.force if isinstance(averaging.force, tuple) else (averaging.force,)
    if not forces and max(stated) <= len(channels):
        forces = [channels[position - 1] for position in dict.fromkeys(stated)]
    responses = [f for f in channels if not any(f is force for force in forces)]
    if not forces or not responses:
        raise MeasurementError(
            f"{file}: expected time histories of forces and responses, found {len(forces)} forces "
            f"among {len(channels)} time histories"
        )
    return forces + responses, len(forces)


def _rate(records: list[list[MeasuredFunction]]) -> float:
    """Return the one sampling rate of all records, Hz."""
    everything = [channel for channels in records for channel in channels]
    mean = np.diff(everything[0].abscissa).mean()
    for channel in everything:
        step = float(np.diff(channel.abscissa).mean()) if channel.abscissa.size > 1 else 0.0
        if is_uneven(channel.abscissa) or abs(step / mean - 1) > 1e-3:
            message = f"{channel.source}: its samples are not {mean:.6g} s apart, as in the first record"
            sections = "[measurement.table] or [measurement.variables]"
            raise MeasurementError(message + said_of_rounded(channel.abscissa, sections))
    return float(1 / mean)


def _unit(averaging: Averaging) -> tuple[float, Unit | None]:
    """Return the factor to SI of response over force, and the unit of the response if the user states it."""
    response_unit = None if averaging.response_unit is None else parse_unit(averaging.response_unit)
    force_unit = None if averaging.force_unit is None else parse_unit(averaging.force_unit)
    factor = 1.0 if response_unit is None else response_unit.factor
    return factor / (1.0 if force_unit is None else force_unit.factor), response_unit


def _single_hits(file: Path, value: Reals, rate: float, averaging: Averaging, notes: list[str]) -> Reals:
    """Return records with one hit each, (n_record, n_channel, n_sample), those of continuous excitation as they are."""
    if averaging.before_hit_s is not None:
        assert averaging.block_s is not None
        blocks = round(averaging.block_s * rate), round(averaging.before_hit_s * rate)
        try:
            value, n_cut = cut_at_hits(value, *blocks)
        except MeasurementError as error:
            raise MeasurementError(f"{file}: {error}") from error
        notes.append(
            f"{file}: {len(value)} hits are found"
            + (f"; {n_cut} more whose block is not whole are left out" if n_cut else "")
        )
    elif averaging.block_s is not None or averaging.window != "boxcar":
        return value
    samples = np.array([pulse_samples(record[0]) for record in value])
    if np.any((samples > 0) & (samples < FEWEST_SAMPLES)):
        notes.append(
            f"{file}: the hammer's pulse is {samples[samples > 0].min()} samples long, shorter than the sampling "
            "resolves: phases and signs at high frequencies are doubtful; sample faster, or take a softer tip"
        )
    second = np.array([second_pulse(record[0]) for record in value])
    for k in np.flatnonzero(second > 0.0):
        notes.append(
            f"{file}: hit {k + 1} of {len(value)} is left out: it is a double hit, or the next hit falls into its "
            f"block, a second pulse of {100 * second[k]:.0f} % of the first"
        )
    if np.all(second > 0.0):
        raise MeasurementError(
            f"{file}: all {len(value)} hits are double, or the next hit falls into their blocks; measure this point "
            "again, or shorten 'block_s'"
        )
    return value[second == 0.0]


_ARRAYS = ("mat", "hdf5", "numpy", "tdms")


def frfs_of(campaign: Campaign, file: Path, notes: list[str]) -> list[tuple[MeasuredFunction, MeasuredFunction | None]]:
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
) -> list[list[tuple[Path, Channels]]]:
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
    of_sets = [(files[0], _beside(_of_files(campaign, files, notes))) for files in group]
    first, runs = of_sets[0]
    for file, others in of_sets:
        if len(others) != len(runs):
            raise MeasurementError(
                f"{file}: holds {len(others)} runs and {first}, which is averaged with it, {len(runs)}"
            )
    return [[(file, hit) for file, hits in of_sets for hit in hits[r]] for r in range(len(runs))]


def _of_files(
    campaign: Campaign, files: tuple[Path, ...], notes: list[str]
) -> list[tuple[Path, tuple[tuple[Channels, ...], ...]]]:
    """Return what each of the files of one record holds; of sound files each has the full scale of its channels."""
    scales = campaign.full_scale
    if len(files) == 1 or len(scales) < 2:
        return [(f, _records(campaign, f, notes)) for f in files]
    channels = [read_wav(f, (1.0,)) for f in files]
    if sum(map(len, channels)) != len(scales):
        raise MeasurementError(
            f"{files[0]} and the files beside it have {sum(map(len, channels))} channels, and 'full_scale' of the "
            f"campaign file {len(scales)} numbers; give one for each channel, or one for all"
        )
    each = iter(scales)
    return [
        (f, ((tuple(replace(c, value=c.value * next(each)) for c in of_file),),))
        for f, of_file in zip(files, channels, strict=True)
    ]


def _records(campaign: Campaign, file: Path, notes: list[str]) -> tuple[tuple[Channels, ...], ...]:
    """Return for each run of a file its records, for each record its channels."""
    kind = format_of(file, campaign.format)
    if kind in _ARRAYS and not _describes_itself(campaign, kind):
        assert campaign.variables is not None
        notes += _cut_off(file, kind)
        return read_histories(file, campaign.variables, matlab=kind == "mat")
    if kind == "csv" and campaign.table is not None:
        return (_of_table(campaign.table, file, notes),)
    return records_in(_plain(campaign, file, notes))


def _cut_off(file: Path, kind: str) -> list[str]:
    """Say that a file is cut off, and what is read of it."""
    if kind != "tdms" or not is_cut_off(file):
        return []
    return [
        f"{file}: is cut off, as of a recorder or a copy that was stopped; groups that are whole are read, or, where "
        "none is, what all channels of a group have"
    ]


def _of_table(table: TableLayout, file: Path, notes: list[str]) -> tuple[Channels, ...]:
    """Return the records of a text file; those of its segments are averaged."""
    records = read_records(file, table)
    if len(records) > 1:
        notes.append(f"{file}: its {len(records)} segments are blows or blocks that are averaged")
    return records


def _describes_itself(campaign: Campaign, kind: Format) -> bool:
    """Whether files are functions of SDynPy, which need no description of their variables."""
    return kind == "numpy" and campaign.variables is None


def _plain(campaign: Campaign, file: Path, notes: list[str]) -> Channels:
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
        raise CampaignError(f"{campaign.path}: measurement: text file {file.name} needs a [measurement.table]")
    return read_table(file, campaign.table, campaign.unit)


def _beside(files: list[tuple[Path, tuple[tuple[Channels, ...], ...]]]) -> tuple[tuple[Channels, ...], ...]:
    """Put the channels of files of the same records side by side."""
    (first, records), *others = files
    for file, more in others:
        counts = [[len(run) for run in of_force] for of_force in (records, more)]
        if counts[0] != counts[1]:
            raise MeasurementError(
                f"{file}: holds {counts[1]} hits in its runs and {first}, which belongs beside it, {counts[0]}"
            )
        records = tuple(
            tuple(_one_record(file, a, b) for a, b in zip(run, of_force, strict=True))
            for run, of_force in zip(records, more, strict=True)
        )
    return records


def _one_record(file: Path, channels: Channels, more: Channels, *, same_start: float = 0.5) -> Channels:
    """Return the channels of one record from two files, which begin at the same time.

    `same_start`: share of a step by which channels of one record may begin apart.
    """
    for channel in more:
        time, reference = channel.abscissa, channels[0].abscissa
        step = float(np.diff(reference).mean()) if reference.size > 1 else 0.0
        if abs(time[0] - reference[0]) > same_start * step:
            raise MeasurementError(
                f"{file}: its times begin at {time[0]:g} s, those of {channels[0].source} at {reference[0]:g} s; files "
                "beside each other hold channels of the same record"
            )
    return channels + more


def _coherences(
    frfs: list[MeasuredFunction], coherences: list[MeasuredFunction], file: Path, notes: list[str]
) -> Sequence[MeasuredFunction | None]:
    if not coherences:
        return [None] * len(frfs)
    if len({f.abscissa.size for f in (*frfs, *coherences)}) > 1:
        notes.append(f"{file}: coherences and FRFs have different numbers of lines; the coherences are left out")
        return [None] * len(frfs)
    if all(f.output is None or f.input is None for f in coherences):
        if len(coherences) == len(frfs):
            return list(coherences)
        notes.append(f"{file}: {len(coherences)} coherences for {len(frfs)} FRFs; they are left out")
        return [None] * len(frfs)
    by_dof = {(f.output, f.input): f for f in coherences}
    return [by_dof.get((f.output, f.input)) for f in frfs]


def snapped(frequency: Reals, *, nearly_zero: float = 0.05) -> Reals:
    """Return a uniform axis where the stored one differs from it by no more than its printed digits.

    `nearly_zero`: share of a step; put in place of 0 Hz, to divide by it.
    """
    if frequency.size < 3:
        return frequency
    if 0.0 < frequency[0] < nearly_zero * (frequency[1] - frequency[0]):
        frequency = np.concatenate([[0.0], frequency[1:]])
    uniform = np.linspace(frequency[0], frequency[-1], frequency.size)
    tolerance = max(1e-3 * abs(uniform[1] - uniform[0]), 5e-6 * abs(frequency[-1]))
    tolerance = min(tolerance, 0.4 * abs(uniform[1] - uniform[0]))
    return uniform if np.abs(frequency - uniform).max() <= tolerance else frequency


MOST_LOST = 0.01
"""Share of the lines of a function that are bridged; where more are lost, the check of its numbers refuses it."""
Entry = TypeVar("Entry", bound=Any)


def with_finite_lines(entries: Sequence[Entry], band: tuple[float, float] | None, notes: list[str]) -> list[Entry]:
    """Return functions on common lines with numbers at all of them, as far as that is sound.

    Lines before the first and after the last at which all functions have numbers are cut off, such as the one at 0 Hz
    after a division by omega**2, where they are few or outside the band. A gap of up to `LONGEST_GAP` lines is bridged
    by a straight line, since the identification needs even steps; up to a share `MOST_LOST` of the lines of a function.
    Each is noted. What is lost beyond that stays as it is, for the check of the numbers to refuse.

    Parameters
    ----------
    entries : sequence of dataclass
        Functions with `frequency` and `value`, (n_frequency,), `coherence`, the same or None, and `source`.
    band : (float, float) or None
        Band that will be identified, Hz; None for all lines.
    notes : list of str
        What was done is added to it.
    """
    frequency = entries[0].frequency
    finite = [np.isfinite(entry.value) for entry in entries]
    if all(is_finite.all() for is_finite in finite):
        return list(entries)
    inside = np.ones(frequency.size, bool)
    if band is not None:
        inside = (frequency >= band[0]) & (frequency <= band[1])
    first, last = _edges(finite, inside)
    kept = []
    if (first, last) != (0, frequency.size):
        notes.append(
            f"lines below {frequency[first]:g} or above {frequency[last - 1]:g} Hz are cut off: not all functions have "
            "numbers there"
        )
    for entry, is_finite in zip(entries, finite, strict=True):
        value = _bridged(entry.value[first:last], is_finite[first:last], inside[first:last])
        lost = int(np.count_nonzero(~is_finite[first:last] & np.isfinite(value)))
        if lost:
            notes.append(
                f"{entry.source}: {lost} of {value.size} values are no numbers and are bridged by straight lines"
            )
        coherence = None if entry.coherence is None else entry.coherence[first:last]
        kept.append(replace(entry, frequency=frequency[first:last], value=value, coherence=coherence))
    return kept


def _edges(finite: list[Booleans], inside: Booleans) -> tuple[int, int]:
    """Return the first line that is kept and the one after the last: few are cut off inside the band."""
    common = np.ones(inside.size, bool)
    for is_finite in finite:
        if is_finite.mean() > 0.5:  # a function without numbers is for the check to refuse
            common &= is_finite
    most = int(MOST_LOST * np.count_nonzero(inside)) + 1
    lines = np.flatnonzero(common)
    if lines.size == 0:
        return 0, inside.size
    first, last = int(lines[0]), int(lines[-1]) + 1
    if np.count_nonzero(inside[:first]) > most:
        first = 0
    if np.count_nonzero(inside[last:]) > most:
        last = inside.size
    return first, last


def _bridged(value: Complexes, finite: Booleans, inside: Booleans) -> Complexes:
    """Return a function with its short gaps bridged, and with those outside the band, which nothing looks at."""
    longest_gap = 2  # lines in a row that are bridged; a longer gap may hide a resonance
    line, known = np.arange(value.size), np.flatnonzero(finite)
    if known.size < 2 or finite.all():
        return value
    gap = np.diff(np.r_[-1, known, value.size]) - 1  # lines lost before each line that is known, and after the last
    longest = gap[np.searchsorted(known, line, side="left")]
    bridged = ~finite & ((longest <= longest_gap) | ~inside)
    if np.count_nonzero(bridged & inside) > max(MOST_LOST * np.count_nonzero(inside), 1.0):
        bridged &= ~inside
    filled = np.interp(line, known, value[known].real) + 1j * np.interp(line, known, value[known].imag)
    return np.where(bridged, filled, value)


Run = list[tuple[Path, tuple[MeasuredFunction, ...]]]


def of_common_length(groups: list[list[Run]], notes: list[str]) -> list[list[Run]]:
    """Return the records of all runs with as many samples as the shortest has, and note it.

    Parameters
    ----------
    groups : list of list of run
        For each group of files its runs, for each run its records, for each record its file and its channels.
    notes : list of str
        The common length is added to it.

    Returns
    -------
    groups
        As they are where all have the same length, or the shortest is far shorter than the longest.
    """
    least_share = 0.8  # of the longest record: a shorter one would cost the others their lines
    sizes = [f.abscissa.size for runs in groups for run in runs for _, channels in run for f in channels]
    shortest, longest = min(sizes, default=0), max(sizes, default=0)
    if shortest == longest or shortest < least_share * longest:
        return groups
    notes.append(
        f"the records hold {shortest} to {longest} samples; all are cut to {shortest}, so that their functions have "
        "the same lines; state block_s under [measurement.time] for another length"
    )
    return [
        [[(file, tuple(_cut(f, shortest) for f in channels)) for file, channels in run] for run in runs]
        for runs in groups
    ]


def _cut(function: MeasuredFunction, n_sample: int) -> MeasuredFunction:
    return replace(function, abscissa=function.abscissa[:n_sample], value=function.value[:n_sample])
