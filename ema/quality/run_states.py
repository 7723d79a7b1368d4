"""Whether the runs of a configuration are of one state of the structure: runs of one state share their resonances.

Small shifts from run to run, as a roving sensor's mass or temperature makes them, are compared after the
identification (`ema.identification.run_poles`). Here whole runs are told apart that have other resonances, such as
files of another bolt torque.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ema.quality.peaks import MIN_LINES, peaks
from ema.quality.verdict import Verdict
from ema.types.frf import FRF

_FEWEST_RUNS = 4
_FEWEST_PEAKS = 3
"""Peaks that a run must show to be compared; fewer coincide by chance."""
_MOST_OF = 0.5
"""Share of the runs that must show as many: where bandwidths overlap, a few runs show the peaks that their sensors'
places let stand out, and others show others."""
_SAME = 0.008
"""Relative distance of two peaks up to which they may be one resonance: sensors and temperature shift by less."""
_WITHIN, _BETWEEN = 0.6, 0.35
"""Share of peaks that runs of one state have in common at least, and runs of two states at most, in the mean. Runs
miss a peak where all their sensors are at a node; runs of other states meet a few by chance."""


def run_states(frf: FRF, channels: NDArray[np.int64]) -> Iterator[Verdict]:
    """Find runs of two states among channels of one direction.

    Each run's resonances are the peaks of its summed power, and two runs are as alike as the share of peaks that they
    have in common. Runs are divided about the two that are least alike; they are of two states where both parts agree
    within, but not with each other.

    Parameters
    ----------
    frf : FRF
        Finite functions.
    channels : (n,) int
        Positions of sound outputs of one direction: another direction has other resonances.
    """
    number, found = _resonances(frf, channels)
    if number.size < max(_FEWEST_RUNS, _MOST_OF * np.unique(frf.run[channels]).size):
        return
    step = float(np.median(np.diff(frf.frequency)))
    alike = np.array([[_alike(a, b, MIN_LINES * step) for b in found] for a in found])
    first, second = np.unravel_index(int(np.argmin(alike)), alike.shape)
    of_second = alike[:, second] > alike[:, first]
    parts = (np.flatnonzero(~of_second), np.flatnonzero(of_second))
    if min(part.size for part in parts) < 2:
        return  # one odd run shares nothing with the others, which `unshared` says of its channels
    within = min(_mean_of_others(alike[np.ix_(part, part)]) for part in parts)
    between = float(alike[np.ix_(*parts)].mean())
    if within < _WITHIN or between > _BETWEEN:
        return
    large, small = sorted(parts, key=lambda part: (-part.size, part[0]))
    told = " and ".join(
        f"runs {_listed(number[part])} (from {_source(frf, int(number[part[0]]))}) with peaks at {_peaks(found, part)}"
        for part in (large, small)
    )
    message = (
        f"runs of two states of the structure: {told}. They share {100 * between:.0f} % of their peaks, among "
        "themselves runs share "
        f"{100 * within:.0f} % or more. Put each state into a configuration of its own, or take the files "
        "that belong here"
    )
    yield Verdict(check="states", level="fail", channel=(), band=None, message=message)


def _resonances(frf: FRF, channels: NDArray[np.int64]) -> tuple[NDArray[np.int64], list[NDArray[np.float64]]]:
    """Return the runs that show enough peaks, and of each their frequencies, Hz."""
    numbers, found = [], []
    for run in np.unique(frf.run[channels]):
        own = np.array([p.frequency for p in peaks(frf, channels[frf.run[channels] == run])])
        if own.size >= _FEWEST_PEAKS:
            numbers.append(int(run))
            found.append(own)
    return np.array(numbers, dtype=np.int64), found


def _alike(one: NDArray[np.float64], other: NDArray[np.float64], near: float) -> float:
    """Return the share of peaks that two runs have in common."""
    apart = np.abs(one[:, None] - other)
    close = apart <= np.maximum(near, _SAME * one[:, None])
    return float(close.any(axis=1).sum() + close.any(axis=0).sum()) / (one.size + other.size)


def _mean_of_others(alike: NDArray[np.float64]) -> float:
    """Return the mean likeness of different runs."""
    return float(alike[~np.eye(len(alike), dtype=bool)].mean())


def _listed(runs: NDArray[np.int64]) -> str:
    """Return numbers of runs, from 1, those in a row as a range."""
    rows = np.split(runs, np.flatnonzero(np.diff(runs) > 1) + 1)
    return ", ".join(f"{r[0] + 1}" if r.size == 1 else f"{r[0] + 1} to {r[-1] + 1}" for r in rows)


def _source(frf: FRF, run: int) -> str:
    return frf.source[int(np.flatnonzero(frf.run == run)[0])]


def _peaks(found: list[NDArray[np.float64]], part: NDArray[np.intp]) -> str:
    """Return the peaks of the run of a part that shows most."""
    most = max((found[i] for i in part), key=len)
    return ", ".join(f"{f:.5g}" for f in most[:4]) + (", ... Hz" if most.size > 4 else " Hz")
