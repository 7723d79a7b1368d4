"""The verdict on what a search found: nothing missing, an effect, a set, a part of the truth, or the unknown."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from updating.diagnosis.adequacy import too_large
from updating.diagnosis.answer import Verdict
from updating.diagnosis.calibration import HELPS, MOST_JUDGED, SEPARATE, SHOWS, STRAINED
from updating.diagnosis.explanation import Explanation
from updating.diagnosis.held_out import left_out
from updating.diagnosis.point_change import PointChange, point_change
from updating.diagnosis.search import Search, is_form


@dataclass(frozen=True, eq=False, kw_only=True)
class Decision:
    """A verdict with the explanations that it leaves.

    Attributes
    ----------
    verdict : Verdict
        One of five.
    left : tuple of Explanation
        What the data cannot tell apart, the most probable first; none where nothing is missing or nothing helps.
    steps : tuple of Explanation
        From the base model to the most probable explanation, one effect at a time. Where the first of `left` is one
        before the last, the further ones may be no more than the error of its form.
    point : PointChange, optional
        Where something is left: it looks like a mass or a spring at one point.
    """

    verdict: Verdict
    left: tuple[Explanation, ...]
    steps: tuple[Explanation, ...]
    point: PointChange | None = None


def decide(found: Search) -> Decision:
    """Give the verdict on what a search found."""
    base = found.base
    evidence = found.evidence
    best = _best(found)
    if best is None:
        if not too_large(evidence, base) and not evidence.lacking:
            return Decision(verdict="nothing missing", left=(), steps=(base,))
        return Decision(verdict="unlike anything", left=(), steps=(base,), point=point_change(evidence, base))
    steps = _steps(found, best)
    own = _beyond_its_form(found, steps)
    left = _ambiguous(found, own)
    if too_large(evidence, own) or evidence.lacking:
        point = point_change(evidence, best)
        return Decision(verdict="partly explained", left=left, steps=steps, point=point)
    return Decision(verdict="identified" if len(left) == 1 else "one of", left=left, steps=steps)


def _best(found: Search) -> Explanation | None:
    """Return the most probable explanation that shows and helps."""
    ordered = sorted(found.fitted, key=found.odds, reverse=True)
    shows = itertools.takewhile(lambda own: found.odds(own) >= SHOWS, ordered)
    return next((own for own in itertools.islice(shows, MOST_JUDGED) if _helps(found, own)), None)


def _helps(found: Search, own: Explanation) -> bool:
    """Tell whether an explanation predicts modes that it has not seen better than the base model, or relieves it.

    What changes between configurations alone, such as the law of pressure, predicts no mode better: without it, what
    is known of assembly and torque is strained. Nothing may predict clearly worse.
    """
    before, after = (left_out(found.evidence, x) for x in (found.base, own))
    if np.nansum(np.subtract(after.score, before.score)) < -SHOWS:
        return False
    kinds = ("frequency", "damping", "shape")
    ratio = np.array([getattr(after, kind) / getattr(before, kind) for kind in kinds])
    better = bool(np.isnan(ratio).all() or np.nanmin(ratio) < HELPS)
    return better or found.base.strain - own.strain > STRAINED**2


def _beyond_its_form(found: Search, steps: tuple[Explanation, ...]) -> Explanation:
    """Return the last explanation on the way whose every step brings more than the error of what is there before."""
    beyond = itertools.takewhile(lambda pair: not is_form(found.base, *pair), itertools.pairwise(steps))
    return [after for _, after in beyond][-1]


def _ambiguous(found: Search, own: Explanation) -> tuple[Explanation, ...]:
    """Return what is nearly as probable as an explanation or more, of as many effects.

    It comes first itself, but for what does with fewer of its effects; what only adds an effect to another of these
    says nothing new.
    """
    near = [
        x
        for x in found.fitted
        if found.odds(own) - found.odds(x) < SEPARATE and len(x.effects) <= len(own.effects)
    ]
    near = [x for x in near if x is own or not any(set(y.effects) < set(x.effects) for y in near)]
    simpler = {id(x) for x in near if set(x.effects) < set(own.effects)}
    return tuple(sorted(near, key=lambda x: (id(x) not in simpler, x is not own, -found.odds(x))))


def _steps(found: Search, best: Explanation) -> tuple[Explanation, ...]:
    """Return the way from the base model to an explanation, at each step by the effect that raises the odds most."""
    steps = [best]
    while len(steps[-1].effects) > 1:
        members = set(steps[-1].effects)
        before = [x for x in found.fitted if set(x.effects) < members and len(x.effects) == len(members) - 1]
        if not before:
            break
        steps.append(max(before, key=found.odds))
    return (found.base, *reversed(steps))
