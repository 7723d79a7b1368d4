"""Whether what a further term takes off is of any matter."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from updating.diagnosis.answer import Strained
from updating.diagnosis.calibration import HALVES, HELPS, NEGLIGIBLE, NEGLIGIBLE_HALF, STRAINED
from updating.diagnosis.discrepancy import KINDS, MEDIAN
from updating.pooled.beside import Bench
from updating.pooled.fit import Fitted
from updating.pooled.held_out import torques_left_out
from updating.pooled.linear import SHARED_PART

Vector = NDArray[np.float64]


def matters(bench: Bench, before: Fitted, after: Fitted) -> bool:
    """Tell whether a term takes more off what is left without it than any model that is right may leave.

    Many specimens of one rig bear out hundredths of a per cent that the model misses in all of them alike, as some
    effect would. What counts is what it takes off frequencies and damping ratios of those that have it, off shapes, or
    off the frequencies at a torque that is predicted from all else; and that what is known of those that have it is
    strained without. What a laboratory states of a discrepancy is no estimate that could fall.

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
    was, now = (_mean_square(own, "log_frequency", members) for own in (before, after))
    if now < HALVES**2 * was and fell["frequency"] > NEGLIGIBLE_HALF * MEDIAN["frequency"]:
        return True
    if any(fell[kind] > NEGLIGIBLE * MEDIAN[kind] for kind in KINDS):
        return True
    if relieves(bench, before, after, members):
        return True
    left = [torques_left_out(bench, own) for own in (before, after)]
    if not left[0].size:
        return False
    was, now = (float(np.mean(own)) for own in left)
    return now < HELPS * was and was - now > NEGLIGIBLE * MEDIAN["frequency"]


def relieves(bench: Bench, before: Fitted, after: Fitted, members: Sequence[int]) -> bool:
    """Tell whether what is known of some specimens, in their mean, is far off before and is relieved after.

    A mass that the rig has passes for denser steel, and frequencies are met then; but in all specimens alike.
    """
    was, now = (_squared(means_off(bench, own, members)) for own in (before, after))
    return bool(np.max(was) > STRAINED**2 and np.sum(was) - np.sum(now) > STRAINED**2)


def far_off(bench: Bench, own: Fitted) -> tuple[Strained, ...]:
    """Return the nuisances whose mean over all specimens is far from what is known of it."""
    means = means_off(bench, own, range(len(bench.own)))
    return tuple(each for each in means if abs(each.value) > STRAINED * each.std)


def means_off(bench: Bench, own: Fitted, members: Sequence[int]) -> tuple[Strained, ...]:
    """Return how far the mean of each nuisance of some specimens is from what is known of it."""
    away: dict[str, list[float]] = {}
    for s in members:
        off = own.at.nuisance[s] - bench.own[s].known
        for name, value in zip(bench.own[s].evidence.nuisances, off.tolist(), strict=True):
            if np.isfinite(bench.nuisance_std[name]):
                away.setdefault(name, []).append(value)
    return tuple(
        Strained(
            name=name,
            value=float(np.mean(off)),
            std=float(bench.nuisance_std[name] * np.sqrt(SHARED_PART + (1.0 - SHARED_PART) / len(off))),
        )
        for name, off in away.items()
    )


def _squared(every: Sequence[Strained]) -> Vector:
    return np.array([(own.value / own.std) ** 2 for own in every])


def _fell(before: Fitted, after: Fitted, name: str, members: Sequence[int]) -> float:
    """Return the root of the fall of the mean square of logarithms over some specimens."""
    return _root(_mean_square(before, name, members) - _mean_square(after, name, members))


def _mean_square(own: Fitted, name: str, members: Sequence[int]) -> float:
    return float(np.mean(np.square(np.concatenate([getattr(own.linear.found[s], name) for s in members]))))


def _root(square: float) -> float:
    return float(np.sqrt(max(square, 0.0)))
