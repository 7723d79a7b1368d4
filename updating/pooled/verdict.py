"""What a pooled diagnosis concludes: which explanation leads, what data do not tell from it, and the verdict."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from updating.diagnosis.calibration import HALVES, HELPS, SEPARATE, SHOWS
from updating.results.pooled_answer import PooledRanked, PooledVerdict

Vector = NDArray[np.float64]


def verdict_of(
    first: PooledRanked, base: PooledRanked, *, adequate: tuple[bool, bool], n_near: int
) -> PooledVerdict:
    """Return the verdict: whether the first explanation is believed, is enough, and stands alone.

    Parameters
    ----------
    first, base : PooledRanked
        The explanation that leads, and the base model.
    adequate : (bool, bool)
        Whether each of the two leaves no more than nearly right models do.
    n_near : int
        Explanations that the data do not tell apart.
    """
    if not _is_believed(first, base):
        return "nothing missing" if adequate[1] else "unlike anything"
    if not adequate[0]:
        return "partly explained" if first.left_out_error < HELPS * base.left_out_error else "unlike anything"
    return "identified" if n_near == 1 else "one of"


def not_told_apart(
    ranking: Sequence[PooledRanked], base: PooledRanked, error: Sequence[Vector], *, adequate: bool
) -> list[int]:
    """Return the explanations that data do not tell apart, the one that leads first.

    Odds are right where one of the explanations is. Where none is adequate, they weigh what is missing as if it were
    scatter, and the one that predicts best is nearer the truth than the most probable one (Yao et al., Using stacking
    to average Bayesian predictive distributions, 2018, on worlds that no model of a list holds). So there the best
    prediction of specimens left out leads, and what predicts them as well, within one standard error of the mean
    difference over specimens, is not told from it. One that has more terms than the most probable one is among them
    where it halves the error of those that have not. What is as probable as the most probable one is not told from it
    either, unless its error is twice as large.

    Parameters
    ----------
    ranking : sequence of PooledRanked
        The most probable first.
    base : PooledRanked
        The base model among them.
    error : sequence of (n_specimen,) float
        Of each explanation, the errors of the specimens left out.
    adequate : bool
        Whether the most probable one leaves no more than nearly right models do.
    """
    top = ranking[0]
    near = [i for i, own in enumerate(ranking) if own.log_odds > top.log_odds - SEPARATE]
    if adequate:
        return near
    mean = [float(np.mean(own)) for own in error]
    has_more = [len(own.parts) > len(top.parts) for own in ranking]
    least = min(own for own, more in zip(mean, has_more, strict=True) if not more)
    open_to = [
        i
        for i, own in enumerate(ranking)
        if _is_believed(own, base) and (not has_more[i] or mean[i] < HALVES * least)
    ]
    if not open_to:
        return near
    lead = min(open_to, key=lambda i: mean[i])
    as_well = [i for i in open_to if _predicts_as_well(error[i], error[lead])]
    as_well += [i for i in near if HALVES * mean[i] <= mean[lead]]
    return [lead, *(i for i in range(len(ranking)) if i != lead and i in as_well)]


def _is_believed(own: PooledRanked, base: PooledRanked) -> bool:
    """Tell whether an explanation has the odds, and helps to predict a specimen from the others.

    What the whole rig lacks, the others tell of the base model too, as what it misses alike in all of them. So of that
    it is asked whether errors fall, or what is known of the stacks is relieved.
    """
    if not own.parts or own.log_odds < SHOWS:
        return False
    if own.left_out_score > 0.0:
        return True
    falls = own.left_out_error < HELPS * base.left_out_error
    return all(part.level == "rig" for part in own.parts) and (falls or own.relieves)


def _predicts_as_well(error: Vector, least: Vector) -> bool:
    more = error - least
    return bool(np.mean(more) <= np.std(more, ddof=1) / np.sqrt(more.size))
