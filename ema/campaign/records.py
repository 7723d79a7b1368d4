"""Files of time histories to measured FRFs with their coherence and overloads."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ema.campaign.estimate import Averaging, FRFEstimate, clipped_share, double_hit, estimate_frf
from ema.io.measured_function import MeasuredFunction
from ema.io.units import Unit, parse_unit
from ema.types.errors import MeasurementError

_Found = tuple[MeasuredFunction, MeasuredFunction | None, float, float]


def frfs_from_records(
    contents: list[tuple[Path, tuple[MeasuredFunction, ...]]], averaging: Averaging, notes: list[str]
) -> list[_Found]:
    """Estimate the FRFs of one run from its files, each of which holds one force and the same responses.

    Parameters
    ----------
    contents : list of (Path, tuple of MeasuredFunction)
        Files and what they hold; all of them are averaged.
    averaging : Averaging
        Estimator, windows, position of the force, units.
    notes : list of str
        Overloads and double hits are added to it.

    Returns
    -------
    list of (FRF, coherence or None, share of overloaded samples, decay rate)
        One entry for each response, in reading order; the last is what an exponential window adds, 1/s.

    Raises
    ------
    MeasurementError
        The files do not hold one force and the same number of responses on one uniform time axis.
    """
    records = [_force_first(file, functions, averaging) for file, functions in contents]
    counts = {len(channels) for channels in records}
    if len(counts) > 1:
        message = (
            f"{contents[0][0]} and the files averaged with it hold different numbers of channels: {counts}"
        )
        raise MeasurementError(message)
    n_sample = min(channel.abscissa.size for channels in records for channel in channels)
    rate = _rate(records)
    value = np.array([[channel.value[:n_sample] for channel in channels] for channels in records])
    _note_blows(contents, value[:, 0], averaging, notes)
    clipped = np.array([[clipped_share(record) for record in channels] for channels in value])
    estimate = estimate_frf(value[:, 0], value[:, 1:].swapaxes(0, 1), rate, averaging)
    if estimate.decay_rate > 0:
        notes.append(
            f"{contents[0][0]}: the exponential window adds {estimate.decay_rate:.4g} 1/s to the decay rate of "
            "every mode; damping ratios are given without it"
        )
    return _functions(records, estimate, clipped, averaging, notes)


def _functions(
    records: list[list[MeasuredFunction]],
    estimate: FRFEstimate,
    clipped: NDArray[np.float64],
    averaging: Averaging,
    notes: list[str],
) -> list[_Found]:
    """Return each response's FRF in SI units with its coherence; `clipped` are shares (n_record, n_channel)."""
    factor, unit = _unit(averaging)
    found: list[_Found] = []
    for k, response in enumerate(records[0][1:]):
        more = "" if len(records) == 1 else f" and {len(records) - 1} more"
        frf = replace(
            response,
            kind="frf",
            abscissa=estimate.frequency,
            value=estimate.value[k] * factor,
            quantity=response.quantity if unit is None else unit.motion,
            input=records[0][0].output or response.input,
            source=response.source + more,
        )
        coherence = None
        if estimate.coherence is not None:
            coherence = replace(frf, kind="coherence", value=estimate.coherence[k], quantity=None)
        overload = float(clipped[:, [0, k + 1]].max())
        if overload > 0:
            notes.append(
                f"{response.source}: {100 * overload:.2g} % of its samples or its force's are clipped"
            )
        found.append((frf, coherence, overload, estimate.decay_rate))
    return found


def _force_first(
    file: Path, functions: tuple[MeasuredFunction, ...], averaging: Averaging
) -> list[MeasuredFunction]:
    channels = [f for f in functions if f.kind in ("force", "response")]
    forces = [f for f in channels if f.kind == "force"]
    if not forces and averaging.force <= len(channels):
        forces = [channels[averaging.force - 1]]
    if len(forces) > 1:
        sources = ", ".join(f.source for f in forces)
        message = (
            f"{file}: {len(forces)} forces act at once ({sources}), but FRFs are estimated from time histories of "
            "one force only. Excite with one force after the other, each in a run of its own, or "
            "let the test system estimate the FRFs to all forces and give these"
        )
        raise MeasurementError(message)
    if len(forces) != 1 or len(channels) < 2:
        message = (
            f"{file}: expected time histories of one force and its responses, found {len(forces)} forces "
            f"among {len(channels)} time histories"
        )
        raise MeasurementError(message)
    return forces + [f for f in channels if f is not forces[0]]


def _rate(records: list[list[MeasuredFunction]]) -> float:
    """Return the one sampling rate of all records, Hz."""
    everything = [channel for channels in records for channel in channels]
    mean = np.diff(everything[0].abscissa).mean()
    for channel in everything:
        step = np.diff(channel.abscissa)
        # printed times may jitter by their last digit; a missing or doubled sample is more than that
        if step.size == 0 or np.abs(step - mean).max() > 0.2 * mean or abs(step.mean() / mean - 1) > 1e-3:
            message = f"{channel.source}: its samples are not {mean:.6g} s apart, as in the first record"
            raise MeasurementError(message)
    return float(1 / mean)


def _unit(averaging: Averaging) -> tuple[float, Unit | None]:
    """Return the factor to SI of response over force, and the unit of the response if the user states it."""
    response_unit = None if averaging.response_unit is None else parse_unit(averaging.response_unit)
    force_unit = None if averaging.force_unit is None else parse_unit(averaging.force_unit)
    factor = 1.0 if response_unit is None else response_unit.factor
    return factor / (1.0 if force_unit is None else force_unit.factor), response_unit


def _note_blows(
    contents: list[tuple[Path, tuple[MeasuredFunction, ...]]],
    force: NDArray[np.float64],
    averaging: Averaging,
    notes: list[str],
) -> None:
    if averaging.block_s is not None or averaging.window != "boxcar":
        return  # continuous excitation
    for (file, _), record in zip(contents, force, strict=True):
        second = double_hit(record)
        if second > 0:
            notes.append(f"{file}: double hit, a second pulse of {100 * second:.0f} % of the first")
