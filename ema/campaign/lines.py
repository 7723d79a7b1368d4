"""Frequency lines that all functions of a configuration share: even, finite, and from records of one length."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from ema.io.measured_function import MeasuredFunction


def snapped(frequency: NDArray[np.float64], *, nearly_zero: float = 0.05) -> NDArray[np.float64]:
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


def _edges(finite: list[NDArray[np.bool_]], inside: NDArray[np.bool_]) -> tuple[int, int]:
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


def _bridged(
    value: NDArray[np.complex128], finite: NDArray[np.bool_], inside: NDArray[np.bool_]
) -> NDArray[np.complex128]:
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
SHORTEST = 0.8
"""Share of the longest record that the shortest one has at least: a shorter one would cost the others their lines."""


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
        As they are where all have the same length, or the shortest has less than `SHORTEST` of the longest.
    """
    sizes = [f.abscissa.size for runs in groups for run in runs for _, channels in run for f in channels]
    shortest, longest = min(sizes, default=0), max(sizes, default=0)
    if shortest == longest or shortest < SHORTEST * longest:
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
