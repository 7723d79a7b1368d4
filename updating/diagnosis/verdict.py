"""The verdict on what a search found: nothing missing, an effect, a set, a part of the truth, or the unknown."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from updating.diagnosis.adequacy import too_large
from updating.diagnosis.answer import Verdict
from updating.diagnosis.calibration import (
    HALVES,
    HELPS,
    MOST_JUDGED,
    NEGLIGIBLE,
    OVERRULED,
    SEPARATE,
    SHOWS,
    STRAINED,
    SURE,
)
from updating.diagnosis.discrepancy import KINDS, MEDIAN, Kind
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
    shown = _shown(found)
    if not shown:
        if not too_large(evidence, base) and not evidence.lacking:
            return Decision(verdict="nothing missing", left=(), steps=(base,))
        return Decision(verdict="unlike anything", left=(), steps=(base,), point=point_change(evidence, base))
    ways = [_steps(found, x) for x in shown]
    steps = max(ways, key=lambda way: found.odds(_beyond_its_form(found, way)))
    own = _beyond_its_form(found, steps)
    anywhere = point_change(evidence, base)
    if anywhere is not None and anywhere.log_odds + np.log(0.5) > found.odds(own) + SEPARATE:
        # what is known of no effect explains more than the best that is known
        return Decision(verdict="unlike anything", left=(), steps=(base,), point=anywhere)
    left = _ambiguous(found, own)
    if too_large(evidence, own) or evidence.lacking:
        point = point_change(evidence, steps[-1])
        return Decision(verdict="partly explained", left=left, steps=steps, point=point)
    return Decision(verdict="identified" if len(left) == 1 else "one of", left=left, steps=steps)


def _shown(found: Search) -> list[Explanation]:
    """Return the most probable explanation that shows and helps, and others that do and are nearly as probable.

    It is the part of each that would be named, beyond the error of its form, that must help. Where something that has
    none of its effects is far more probable and only predicts no better, it would stand in that one's place: nothing
    shows.
    """
    ordered = sorted(found.fitted, key=found.odds, reverse=True)
    shows = [own for own in ordered[:MOST_JUDGED] if found.odds(own) >= SHOWS]

    def named(own: Explanation) -> Explanation:
        return _beyond_its_form(found, _steps(found, own))

    first = next((own for own in shows if _helps(found, named(own))), None)
    if first is None or _overruled(found, named(first)):
        return []
    near = (own for own in shows if 0.0 < found.odds(first) - found.odds(own) < SEPARATE)
    return [first, *(own for own in near if _helps(found, named(own)))]


def _overruled(found: Search, own: Explanation) -> bool:
    """Tell whether something that has none of the effects of an explanation is far more probable."""
    return any(
        found.odds(x) - found.odds(own) > OVERRULED and not set(x.effects) & set(own.effects)
        for x in found.fitted
    )


def _helps(found: Search, own: Explanation) -> bool:
    """Tell whether an explanation predicts modes that it has not seen better than without it, or relieves others.

    Each of several effects must do so beside the others: a loss that is sure brings no credit to what stands beside it.

    What changes between configurations alone, such as the law of pressure, predicts no mode better: without it, what
    is known of assembly and torque is strained. Nothing may predict clearly worse. Beside a hypothesis about the
    measurement, the effects must help where that is supposed: what it frees is no merit of theirs.

    What no effect has is often met in shapes by two that have nothing to do with it: a side of the stack that is soft,
    by contact lost in a corner and a mass at the shaker. One effect may be seen in shapes alone, several at once
    hardly are.

    What more than halves that which is left helps as well: few modes that each tell one parameter predict no other.
    Effects that halve nothing and relieve nothing must be the surer.
    """
    base = _supposing_alone(found, own)
    if not (_matters(found, base, own) or _relieves(found, base, own)):
        return False
    before, after = (left_out(found.evidence, x) for x in (base, own))
    if np.nansum(np.subtract(after.score, before.score)) < -SHOWS:
        return False
    physical = set(own.effects) - set(found.evidence.hypotheses)
    if len(physical) > 1 and _between(found, base) - _between(found, own) <= STRAINED**2:
        kinds: tuple[Kind, ...] = ("frequency", "damping")
    else:
        kinds = KINDS
    ratio = np.array([getattr(after, kind) / getattr(before, kind) for kind in kinds])
    relieves = _relieves(found, base, own)
    unknown, halved = bool(np.isnan(ratio).all()), _halves(base, own)
    better = unknown or np.nanmin(ratio) < HELPS or halved
    if physical and found.odds(own) - found.odds(base) < SURE:
        better = unknown or np.nanmin(ratio[:2], initial=np.inf) <= HALVES or halved
    return (better or relieves) and _each_helps(found, own)


def _each_helps(found: Search, own: Explanation) -> bool:
    """Tell whether each of several effects helps beside the others, in frequencies or damping ratios.

    What more than halves that which is left does so as well: few modes that each tell one parameter predict no other.
    To take back what another of them has spoilt is no help.
    """
    physical = set(own.effects) - set(found.evidence.hypotheses)
    if len(physical) < 2:
        return True
    none, after = (left_out(found.evidence, x) for x in (_supposing_alone(found, own), own))
    for effect in physical:
        others = set(own.effects) - {effect}
        without = next((x for x in found.fitted if set(x.effects) == others), None)
        if without is None or _relieves(found, without, own):
            continue
        before = left_out(found.evidence, without)
        kinds: tuple[Kind, ...] = ("frequency", "damping")
        predicted = np.array(
            [getattr(after, kind) / min(getattr(before, kind), getattr(none, kind)) for kind in kinds]
        )
        better = np.nanmin(predicted, initial=np.inf) < HELPS or _halves(without, own)
        if not (better and _matters(found, without, own)):
            return False
    return True


def _halves(before: Explanation, after: Explanation) -> bool:
    """Tell whether less than half is left of the discrepancy of frequencies, or of damping ratios."""
    return any(
        getattr(after.mean, kind) < HALVES * getattr(before.mean, kind) for kind in ("frequency", "damping")
    )


def _supposing_alone(found: Search, own: Explanation) -> Explanation:
    """Return what is supposed of the measurement in an explanation, without its effects; else the base model."""
    supposed = set(own.effects) & set(found.evidence.hypotheses)
    if supposed == set(own.effects):
        return found.base
    return next((x for x in found.fitted if set(x.effects) == supposed), found.base)


def _matters(found: Search, base: Explanation, own: Explanation) -> bool:
    """Tell whether an explanation takes more off what is left without it than any model that is right may leave.

    What a laboratory states of a discrepancy is no estimate that could fall.
    """
    if found.evidence.scatter.stated:
        return True
    before, after = (np.array([getattr(x.mean, kind) for kind in KINDS]) for x in (base, own))
    usual = np.array([MEDIAN[kind] for kind in KINDS])
    return bool(np.any(before**2 - after**2 > (NEGLIGIBLE * usual) ** 2))


def _relieves(found: Search, base: Explanation, own: Explanation) -> bool:
    """Tell whether an explanation relieves what is known of assembly and torque, or what else is far off.

    Of many values that are known, some are off by two deviations in every test.
    """
    held = np.isfinite(found.evidence.prior_std)
    farthest = np.max(np.abs(base.nuisance[held] / found.evidence.prior_std[held]))
    if farthest > STRAINED and base.strain - own.strain > STRAINED**2:
        return True
    return _between(found, base) - _between(found, own) > STRAINED**2


def _between(found: Search, own: Explanation) -> float:
    """Return the strain of what differs from torque to torque beyond the law of pressure."""
    differs = [name.startswith("G_f[") for name in found.evidence.nuisances]
    return float(np.sum((own.nuisance[differs] / found.evidence.prior_std[differs]) ** 2))


def _beyond_its_form(found: Search, steps: tuple[Explanation, ...]) -> Explanation:
    """Return the last explanation on the way whose every step brings more than the error of what is there before."""
    beyond = itertools.takewhile(lambda pair: not is_form(found.base, *pair), itertools.pairwise(steps))
    return [after for _, after in beyond][-1]


def _ambiguous(found: Search, own: Explanation) -> tuple[Explanation, ...]:
    """Return what is nearly as probable as an explanation or more, of as many effects, and helps beyond others' form.

    It comes first itself, but for what does with fewer of its effects; what only adds an effect to another of these
    says nothing new.
    """
    near = [
        x
        for x in found.fitted
        if found.odds(own) - found.odds(x) < SEPARATE
        and len(x.effects) <= len(own.effects)
        and (x is own or (_beyond_its_form(found, _steps(found, x)) is x and _helps(found, x)))
    ]
    near = [x for x in near if x is own or not any(set(y.effects) < set(x.effects) for y in near)]
    simpler = {id(x) for x in near if set(x.effects) < set(own.effects)}
    return tuple(sorted(near, key=lambda x: (id(x) not in simpler, x is not own, -found.odds(x))))


def _steps(found: Search, best: Explanation) -> tuple[Explanation, ...]:
    """Return the way from the base model to an explanation, one effect at a time.

    The first is the most probable of its effects; each further one brings more than the error of form of what is there
    before it, if one does, and is the most probable of these.
    """
    steps = [found.base]
    while len(steps[-1].effects) < len(best.effects):
        at = steps[-1]
        further = [
            x
            for x in found.fitted
            if len(x.effects) == len(at.effects) + 1 and set(at.effects) < set(x.effects) <= set(best.effects)
        ]
        if not further:  # not all of its parts were fitted
            return (*steps, best)
        steps.append(min(further, key=lambda x: (is_form(found.base, at, x), -found.odds(x))))
    return tuple(steps)
