"""The decision on a search: one of five verdicts, the explanations that remain, and the steps to the first."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Literal

import scipy

from updating.inference.explain import Explanation, too_large
from updating.inference.levels import PULLED, SEPARATE
from updating.inference.search import Search

_USUAL = 25  # coordinates of the base model of one stack

Unlisted = Literal["instead", "beside", "refused"]
Verdict = Literal["nothing missing", "identified", "one of", "partly explained", "unlike anything"]


@dataclass(frozen=True, eq=False, kw_only=True)
class Decision:
    """A verdict with the explanations that remain.

    Attributes
    ----------
    verdict : Verdict
        One of five.
    left : tuple of Explanation
        Explanations that the data cannot tell apart, the most probable first; none where nothing is named.
    steps : tuple of Explanation
        From the base model to the first of these, one term at a time.
    too_large : tuple of "frequency" or "damping"
        Kinds of data whose discrepancy is larger than that of a right model.
    unlisted : "instead", "beside", "refused" or None
        Whether something that no term describes explains the data nearly as well as a term that is named, is clearly
        more probable beside all that are named than nothing, or is more probable than any term that could be named.
    """

    verdict: Verdict
    left: tuple[Explanation, ...]
    steps: tuple[Explanation, ...]
    too_large: tuple[Literal["frequency", "damping"], ...]
    unlisted: Unlisted | None = None


def decide(search: Search) -> Decision:
    """Give the verdict on a search.

    The explanation that `search` chose is named: each of its steps is clearly more probable and predicts better.
    Explanations with as many terms or fewer remain beside it if they are nearly as probable, and more so than the base
    model, and predict better than that, and so does something unlisted. Nothing is missing where the base model has a
    usual discrepancy, no nuisance is far from its prior, and no term was refused for something unlisted. An explanation
    is whole where the discrepancy beside it is usual, no nuisance is far, and nothing unlisted is clearly more probable
    beside it.
    """
    chosen = search.chosen
    large = too_large(chosen, search.setting.priors)
    if not chosen.terms:
        strange = large or chosen.apart - search.setting.unseen or _pulled(chosen, search.freed) or search.refused
        empty: Verdict = "unlike anything" if strange else "nothing missing"
        refused: Unlisted | None = "refused" if search.refused else None
        return Decision(verdict=empty, left=(), steps=(chosen,), too_large=large, unlisted=refused)
    left = _left(search)
    large = too_large(left[0], search.setting.priors)
    unlisted = _unlisted(search, left[0])
    partly = large or left[0].apart - search.setting.unseen or _pulled(left[0], search.freed) or unlisted == "beside"
    several = len(left) > 1 or unlisted == "instead"
    verdict: Verdict = "partly explained" if partly else "one of" if several else "identified"
    return Decision(verdict=verdict, left=left, steps=_steps(search, left[0]), too_large=large, unlisted=unlisted)


def _unlisted(search: Search, explanation: Explanation) -> Unlisted | None:
    """Tell whether something unlisted is about as probable as a term of an explanation, or clearly so beside it."""
    if search.odds_unlisted(explanation, explanation.terms) - search.odds(explanation) > SEPARATE:
        return "beside"
    for name in explanation.terms:
        part = search.fitted.get(frozenset(explanation.terms) - {name})
        if part and search.odds(explanation) - search.odds_unlisted(part, [name]) < SEPARATE:
            return "instead"
    return None


def _pulled(explanation: Explanation, freed: Collection[str]) -> bool:
    """Tell whether a nuisance of an explanation is far from its prior, if no term could have widened that prior.

    Where a term could, the odds have decided. The limit rises with the number of coordinates: some are far by chance.
    """
    n = explanation.n_nuisance
    far = -float(scipy.special.ndtri(scipy.special.ndtr(-PULLED) * min(1.0, _USUAL / n)))
    return any(
        abs(x) > far * c.std
        for c, x in zip(explanation.coordinates[:n], explanation.x, strict=False)
        if c.name not in freed
    )


def _left(search: Search) -> tuple[Explanation, ...]:
    """Return the chosen explanation and those that the data cannot tell from it, the most probable first."""
    chosen, base = search.chosen, search.base
    near = [
        f
        for f in search.fitted.values()
        if f is not chosen
        and 0 < len(f.terms) <= len(chosen.terms)
        and search.odds(f) > max(0.0, search.odds(chosen) - SEPARATE)
        and search.helps(f, base)
        and not set(f.terms) < set(chosen.terms)
    ]
    kept = [f for f in near if not any(set(g.terms) < set(f.terms) for g in (*near, chosen))]
    return tuple(sorted((chosen, *kept), key=lambda f: -search.odds(f)))


def _steps(search: Search, explanation: Explanation) -> tuple[Explanation, ...]:
    """Return the steps from the base model to an explanation: at each, the most probable part of it."""
    steps = [search.base]
    while len(steps[-1].terms) + 1 < len(explanation.terms):
        parts = [
            f
            for f in search.fitted.values()
            if len(f.terms) == len(steps[-1].terms) + 1 and set(steps[-1].terms) < set(f.terms) < set(explanation.terms)
        ]
        if not parts:
            break
        steps.append(max(parts, key=search.odds))
    return (*steps, explanation)
