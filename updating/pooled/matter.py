"""Whether what a further term takes off is of any matter."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from updating.diagnosis.calibration import NEGLIGIBLE
from updating.diagnosis.discrepancy import KINDS, MEDIAN
from updating.pooled.beside import Bench
from updating.pooled.fit import Fitted
from updating.pooled.held_out import torques_left_out


def matters(bench: Bench, before: Fitted, after: Fitted) -> bool:
    """Tell whether a term takes more off what is left without it than any model that is right may leave.

    Many specimens of one rig bear out hundredths of a per cent that the model misses in all of them alike, as some
    effect would. What counts is what it takes off frequencies and damping ratios of those that have it, off shapes, or
    off the frequencies at a torque that is predicted from all else. What a laboratory states of a discrepancy is no
    estimate that could fall.

    Parameters
    ----------
    bench : Bench
        The specimens.
    before, after : Fitted
        An explanation, and one with a further term.
    """
    if bench.own[0].evidence.scatter.stated:
        return True
    members = sorted({s for term in set(after.terms) - set(before.terms) for s in term.level.members})
    fell = {
        "frequency": _fell(before, after, "log_frequency", members),
        "damping": _fell(before, after, "log_damping", members),
        "shape": _root(before.scales.whole("shape") ** 2 - after.scales.whole("shape") ** 2),
    }
    if any(fell[kind] > NEGLIGIBLE * MEDIAN[kind] for kind in KINDS):
        return True
    left = [torques_left_out(bench, own) for own in (before, after)]
    return bool(left[0].size and np.mean(left[0]) - np.mean(left[1]) > NEGLIGIBLE * MEDIAN["frequency"])


def _fell(before: Fitted, after: Fitted, name: str, members: Sequence[int]) -> float:
    """Return the root of the fall of the mean square of logarithms over some specimens."""
    square = [
        np.mean(np.square(np.concatenate([getattr(own.linear.found[s], name) for s in members])))
        for own in (before, after)
    ]
    return _root(float(square[0] - square[1]))


def _root(square: float) -> float:
    return float(np.sqrt(max(square, 0.0)))
