"""Whether the functions of a structure stay the same when the force changes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ema.campaign.measurement import Measurement
from ema.quality.channels import check, usable
from ema.quality.peaks import Peak, peaks, summed_power
from ema.quality.verdict import Verdict, listing
from ema.types.errors import MeasurementError
from ema.types.frf import DERIVATIVE, FRF, dof_keys, shared_dofs
from lamella_shared import Integers, Reals

NOT_LINEAR = ": not linear"
"""End of the finding on a resonance that moves with the force."""
_SAME = 2.0
"""Bandwidths within which a resonance of the other level is taken for the same one."""


def check_force_levels(
    measurement: Measurement,
    verdicts: tuple[Verdict, ...],
    levels: tuple[Measurement, ...],
    band: tuple[float, float] | None = None,
) -> tuple[Verdict, ...]:
    """Compare a measurement with others of the same structure at other force levels.

    What is wrong with another level by itself is said and left out of the comparison.

    Parameters
    ----------
    measurement : Measurement
        What will be identified, before channels are left out: the verdicts count its outputs.
    verdicts : tuple of Verdict
        What `check` found in it; failed channels are not compared.
    levels : tuple of Measurement
        The same state at other forces, at all of its points or some.
    band : (float, float), optional
        Band that will be identified, Hz.

    Raises
    ------
    MeasurementError
        A level cannot be compared with the measurement, see `check_linearity`.
    """
    failed = {c for v in verdicts if v.level == "fail" for c in v.channel}
    sound = [c not in failed for c in range(measurement.frf.output.node.size)]
    place = np.flatnonzero(sound)
    if not place.size:
        return ()
    reference = replace(measurement, frf=measurement.frf.outputs(np.array(sound)), overload=measurement.overload[place])
    compared: list[Verdict] = []
    for level in levels:
        of_level = check(level, band)
        compared += [
            _verdict("warn", f"{level.name} is compared without a channel: {v.message}")
            for v in of_level
            if v.level == "fail"
        ]
        try:
            other = usable(level, of_level)
        except MeasurementError:
            continue
        compared += [
            replace(v, channel=tuple(int(place[c]) for c in v.channel)) for v in check_linearity(reference, other, band)
        ]
    return tuple(compared)


def check_linearity(
    first: Measurement, second: Measurement, band: tuple[float, float] | None = None
) -> tuple[Verdict, ...]:
    """Compare two measurements of one structure at different force levels, resonance by resonance.

    A resonance that moves by more than a tenth of its bandwidth, or whose height changes by more than a
    tenth, is not linear: contact that slips at the higher level lowers both. Where the height changes in less
    than half of the channels, these are named: a loose or overloaded sensor is likelier than the structure.

    Parameters
    ----------
    first, second : Measurement
        Outputs that only one of them has are not compared.
    band : (float, float), optional
        Band to compare, Hz; all lines where not given.

    Returns
    -------
    tuple of Verdict
        One for each resonance of `first`, with its band; channels are outputs of `first`.

    Raises
    ------
    MeasurementError
        The two share no output, or differ in force DOFs or frequency lines.
    """
    frf, other = (m.frf if band is None else m.frf.band(*band) for m in (first, second))
    rows, its = shared_dofs((frf.output, other.output))
    difference = (
        "outputs"
        if not rows.size
        else "force DOFs"
        if dof_keys(frf.input) != dof_keys(other.input)
        else "frequency lines"
        if frf.frequency.shape != other.frequency.shape or not np.allclose(frf.frequency, other.frequency)
        else None
    )
    if difference is not None:
        raise MeasurementError(
            f"{first.name!r} and {second.name!r} cannot be compared for linearity: they do not share {difference}; "
            "measure the force levels with the same points and the same spectrum settings"
        )
    highest = max(frf.quantity, other.quantity, key=lambda quantity: DERIVATIVE[quantity])
    frf, other = frf.convert(highest), other.convert(highest)
    verdicts = tuple(_resonances(first.name, second.name, frf, rows, other, its))
    return verdicts or (_verdict("warn", f"{first.name} and {second.name}: no clear resonance to compare"),)


def _verdict(
    level: str, message: str, channel: tuple[int, ...] = (), band: tuple[float, float] | None = None
) -> Verdict:
    return Verdict(check="linearity", level=level, channel=channel, band=band, message=message)  # type: ignore[arg-type]


def _resonances(
    name: str,
    other_name: str,
    frf: FRF,
    rows: Integers,
    other: FRF,
    its: Integers,
    *,
    tolerance: float = 0.1,
    # Share of its height below which a resonance is gone.
    least_height: float = 0.5,
) -> Iterator[Verdict]:
    # Channels below this share of a resonance's largest height are near its nodal lines and not judged.
    least_dB = 3.0  # prominence, dB, of a resonance of the other level that is lower there, where no clear one is near
    least_strong = 0.3
    clear, faint = peaks(other, its), peaks(other, its, least_dB)
    for peak in peaks(frf, rows):
        band = (peak.frequency - peak.bandwidth, peak.frequency + peak.bandwidth)
        label = f"{peak.frequency:.5g} Hz: from {name} to {other_name}"
        partner = _nearest(clear, peak) or _nearest(
            [p for p in faint if _level(other, its, p) > least_height * _level(frf, rows, peak)], peak
        )
        if partner is None:
            text = f"{label} the resonance is gone, or moves by more than {_SAME:g} bandwidths; that is not linear"
            yield _verdict("warn", text, band=band)
            continue
        shift = (_centre(other, its, partner) - _centre(frf, rows, peak)) / peak.bandwidth
        before, after = _height(frf, rows, peak), _height(other, its, partner, peak.bandwidth)
        strong = before > least_strong * before.max()
        change = float(np.median(after[strong] / before[strong])) - 1
        odd = np.flatnonzero(strong & (np.abs(after / before - 1 - change) > tolerance))
        moved = abs(shift) > tolerance or abs(change) > tolerance
        text = (
            f"{label} it moves by {100 * shift:+.0f} % of its bandwidth and its height changes by {100 * change:+.0f} %"
        )
        if moved:
            yield _verdict("warn", f"{text}{NOT_LINEAR}", band=band)
        elif odd.size:
            parts = [f"{frf.output.name(int(rows[c]))} by {100 * (after[c] / before[c] - 1):+.0f} %" for c in odd]
            text = f"{text}, but that of {listing(parts, 6)}: check these sensors"
            yield _verdict("warn", text, tuple(int(rows[c]) for c in odd), band)
        else:
            yield _verdict("pass", text, band=band)


def _nearest(candidates: list[Peak], peak: Peak) -> Peak | None:
    """Resonance of the other level that is the same one, if any is."""
    near = min(candidates, key=lambda p: abs(p.frequency - peak.frequency), default=None)
    return near if near and abs(near.frequency - peak.frequency) <= _SAME * peak.bandwidth else None


def _level(frf: FRF, channels: Integers, peak: Peak) -> float:
    """Root mean square of the channels at the line of a peak."""
    return float(np.sqrt(np.mean(np.abs(frf.value[channels][..., peak.line]) ** 2)))


def _centre(frf: FRF, channels: Integers, peak: Peak) -> float:
    """Place of a peak, Hz, from all lines of its half-power band, where the inverse power is a parabola."""
    lines = np.abs(frf.frequency - peak.frequency) <= 0.5 * peak.bandwidth
    if np.count_nonzero(lines) < 4:
        return peak.frequency
    power = summed_power(frf, channels)[lines]
    offset = (frf.frequency[lines] - peak.frequency) / peak.bandwidth
    # Noise of even size makes the inverse power p**-1 scatter with p**-1.5.
    curvature, slope, _ = np.polyfit(offset, power.max() / power, 2, w=(power / power.max()) ** 1.5)
    vertex = -slope / (2 * curvature) if curvature > 0 else 0.0
    return peak.frequency + peak.bandwidth * float(np.clip(vertex, -0.5, 0.5))


def _height(frf: FRF, channels: Integers, peak: Peak, bandwidth: float | None = None) -> Reals:
    """Root mean square of each channel over a bandwidth around a peak, ``(n_channel,)``."""
    lines = np.abs(frf.frequency - frf.frequency[peak.line]) <= 0.5 * (bandwidth or peak.bandwidth)
    return np.sqrt(np.mean(np.abs(frf.value[channels][..., lines]) ** 2, axis=(1, 2)))
