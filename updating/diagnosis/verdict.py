"""The verdict on what a search found: nothing missing, an effect, a set that the data cannot part, or the unknown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from updating.diagnosis.adequacy import P_ADEQUATE, p_value
from updating.diagnosis.explanation import Z90, Explanation, best_of
from updating.diagnosis.point_change import P_POINT, PointChange, point_change
from updating.diagnosis.search import Search

Verdict = Literal["nothing missing", "identified", "one of", "unlike anything"]

SEPARATE = 3.0
"""Discrimination distance below which two explanations are an ambiguity."""
GAIN_SINGLE = 16.0
"""Fall of the squared misfit that a missing effect must bring; to first order the best of the whole catalogue brings
it by chance in 1 to 2 of 1000 complete models (`chance.chance_of_gain`)."""
GAIN_SECOND = 20.0
"""The same for a second effect beside the first, of which there are more to choose from; and more where a strong first
one is adequate: what its form may be off by changes the data, too, and is no effect of its own."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Doubt:
    """A second effect that may be there, or stand in for what the form of the first is off by.

    Attributes
    ----------
    effects : tuple of str
        Its name.
    gain : float
        Fall of the squared misfit that it brings.
    least : float
        Fall that it would have to bring to be named.
    """

    effects: tuple[str, ...]
    gain: float
    least: float


@dataclass(frozen=True, eq=False, kw_only=True)
class Decision:
    """A verdict with the explanations that it leaves.

    Attributes
    ----------
    verdict : Verdict
        One of four.
    left : tuple of Explanation
        What the data cannot tell apart, the best first; none where nothing is missing or nothing is like it.
    doubt : Doubt, optional
        Where one effect is named, a second one that would leave less, but not by enough to be named itself.
    point : PointChange, optional
        Where nothing is like it: what is left looks like a mass or a spring at one point.
    """

    verdict: Verdict
    left: tuple[Explanation, ...]
    doubt: Doubt | None = None
    point: PointChange | None = None


def decide(found: Search) -> Decision:
    """Give the verdict on what a search found."""
    base = found.base
    single, pair = best_of(found.singles, base), best_of(found.pairs, base)
    needed = base.misfit - single.misfit > GAIN_SINGLE
    gain, least = single.misfit - pair.misfit, _least_of_second(found, single)
    second = gain > least
    if not needed and base.misfit - pair.misfit > GAIN_SINGLE + GAIN_SECOND:
        needed = second = True
    if not needed:
        if p_value(base) <= P_ADEQUATE or found.evidence.lacking:
            return Decision(verdict="unlike anything", left=(), point=_all_at_a_point(found, [base]))
        point = _at_a_point(found, base)
        return Decision(verdict="unlike anything" if point else "nothing missing", left=(), point=point)
    best, among = (pair, found.pairs) if second else (single, found.singles)
    if p_value(best) < P_ADEQUATE:
        return Decision(
            verdict="unlike anything", left=(), point=_all_at_a_point(found, [base, single, pair])
        )
    point = _at_a_point(found, best)
    if point is not None:
        return Decision(verdict="unlike anything", left=(), point=point)
    left = tuple(sorted((x for x in among if x.misfit - best.misfit < SEPARATE**2), key=lambda x: x.misfit))
    beside = tuple(name for name in pair.effects if name not in single.effects)
    doubtful = not second and gain > GAIN_SECOND and len(beside) == 1
    return Decision(
        verdict="identified" if len(left) == 1 else "one of",
        left=left,
        doubt=Doubt(effects=beside, gain=gain, least=least) if doubtful else None,
    )


def _at_a_point(found: Search, own: Explanation) -> PointChange | None:
    """Return the change at a point that an explanation leaves beyond chance and beyond what its form may be off by."""
    point = point_change(found.evidence, own)
    return point if point.chance < P_POINT and point.gain > _by_form(found, own) else None


def _all_at_a_point(found: Search, beside: Sequence[Explanation]) -> PointChange | None:
    """Return the change at a point that explains all that the first of some explanations leaves for which it does."""
    points = (_at_a_point(found, own) for own in beside)
    return next((point for point in points if point and point.p_value > P_ADEQUATE), None)


def _least_of_second(found: Search, single: Explanation) -> float:
    """Return the fall of the squared misfit that a second effect must bring beside the best single one."""
    return GAIN_SECOND + (0.0 if p_value(single) <= P_ADEQUATE else _by_form(found, single))


def _by_form(found: Search, own: Explanation) -> float:
    """Return the fall of the squared misfit that may be due to the form of an explanation's effects."""
    return (Z90 * found.evidence.scatter.form) ** 2 * max(found.base.misfit - own.misfit, 0.0)
