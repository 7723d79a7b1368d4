"""Files of time histories to measured FRFs with their coherence and overloads."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ema.campaign.estimate import Averaging, FRFEstimate, clipped_share, estimate_frf
from ema.campaign.estimate_matrix import FRFMatrixEstimate, estimate_frf_matrix
from ema.campaign.hits import FEWEST_SAMPLES, cut_at_hits, pulse_samples, second_pulse
from ema.io.measured_function import MeasuredFunction
from ema.io.sampling import is_uneven, said_of_rounded
from ema.io.units import Unit, parse_unit
from ema.types.errors import MeasurementError

SHARED = 0.5
"""Share of a force that is in the others from which on it is told: the variance of its functions is twice as large."""

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
    if any(own != n_force for _, own in sorted_channels):
        message = f"{contents[0][0]} and the files averaged with it hold different numbers of forces"
        raise MeasurementError(message)
    counts = {len(channels) for channels in records}
    if len(counts) > 1:
        message = (
            f"{contents[0][0]} and the files averaged with it hold different numbers of channels: {counts}"
        )
        raise MeasurementError(message)
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


def _note_forces(
    file: Path, channels: list[MeasuredFunction], matrix: FRFMatrixEstimate, notes: list[str]
) -> None:
    """Note how much of each response the forces explain together, and how independent the forces are."""
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
    if shared.max() > SHARED:
        notes.append(
            f"{file}: {100 * shared.max():.0f} % of a force is in the others, too: its functions are less certain"
        )


def _functions(
    records: list[list[MeasuredFunction]],
    n_force: int,
    estimate: FRFEstimate,
    clipped: NDArray[np.float64],
    averaging: Averaging,
    notes: list[str],
) -> list[_Found]:
    """Return each response's FRFs in SI units with their coherence; `clipped` are shares (n_record, n_channel)."""
    factor, unit = _unit(averaging)
    found: list[_Found] = []
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
            notes.append(
                f"{response.source}: {100 * overload:.2g} % of its samples or its force's are clipped"
            )
        found.append((frf, coherence, overload, estimate.decay_rate))
    return found


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
        message = (
            f"{file}: expected time histories of forces and responses, found {len(forces)} forces "
            f"among {len(channels)} time histories"
        )
        raise MeasurementError(message)
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


def _single_hits(
    file: Path, value: NDArray[np.float64], rate: float, averaging: Averaging, notes: list[str]
) -> NDArray[np.float64]:
    """Return records with one hit each, (n_record, n_channel, n_sample), those of continuous excitation as they are."""
    if averaging.before_hit_s is not None:
        assert averaging.block_s is not None
        blocks = round(averaging.block_s * rate), round(averaging.before_hit_s * rate)
        try:
            value, n_cut = cut_at_hits(value, *blocks)
        except MeasurementError as error:
            message = f"{file}: {error}"
            raise MeasurementError(message) from error
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
        message = (
            f"{file}: all {len(value)} hits are double, or the next hit falls into their blocks; measure this point "
            "again, or shorten 'block_s'"
        )
        raise MeasurementError(message)
    return value[second == 0.0]
