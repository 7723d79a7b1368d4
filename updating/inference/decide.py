"""The decision on a search: one of five verdicts, the explanations that it leaves, and the steps to the first."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Literal

import scipy

from updating.inference.explain import Explanation, too_large
from updating.inference.levels import NAMED, PULLED, SEPARATE
from updating.inference.search import Search

_USUAL = 25  # coordinates of the base model of one stack

Verdict = Literal["nothing missing", "identified", "one of", "partly explained", "unlike anything"]


@dataclass(frozen=True, eq=False, kw_only=True)
class Decision:
    """A verdict with the explanations that it leaves.

    Attributes
    ----------
    verdict : Verdict
        One of five.
    left : tuple of Explanation
        What the data cannot tell apart, the most probable first; none where nothing is named.
    steps : tuple of Explanation
        From the base model to the first of these, one term at a time.
    too_large : tuple of "frequency" or "damping"
        Kinds of data of which more is left than a right model leaves.
    """

    verdict: Verdict
    left: tuple[Explanation, ...]
    steps: tuple[Explanation, ...]
    too_large: tuple[Literal["frequency", "damping"], ...]


def decide(found: Search) -> Decision:
    """Give the verdict on a search.

    Named is what `search` chose, where every step is told apart and predicts better. Beside it stand explanations of
    as many terms or fewer that are nearly as probable and predict better than the base model, too. Nothing is missing
    where the base model is as right as models are and what is known of its nuisances bears that out; an explanation
    is whole where the same holds of it.
    """
    own = found.chosen
    large = too_large(own, found.setting.priors)
    if not own.terms:
        empty: Verdict = (
            "unlike anything" if large or own.apart or _pulled(own, found.freed) else "nothing missing"
        )
        return Decision(verdict=empty, left=(), steps=(own,), too_large=large)
    left = _left(found)
    large = too_large(left[0], found.setting.priors)
    partly = large or left[0].apart or _pulled(left[0], found.freed)
    verdict: Verdict = "partly explained" if partly else "identified" if len(left) == 1 else "one of"
    return Decision(verdict=verdict, left=left, steps=_steps(found, left[0]), too_large=large)


def _pulled(explanation: Explanation, freed: Collection[str]) -> bool:
    """Tell whether an explanation pulls a prior far that no term could widen: where one could, odds have decided.

    Of more coordinates than one stack has some are pulled farther by chance.
    """
    n = explanation.n_nuisance
    far = -float(scipy.special.ndtri(scipy.special.ndtr(-PULLED) * min(1.0, _USUAL / n)))
    return any(
        abs(x) > far * c.std
        for c, x in zip(explanation.coordinates[:n], explanation.x, strict=False)
        if c.name not in freed
    )


def _left(found: Search) -> tuple[Explanation, ...]:
    """Return what was chosen and what cannot be told from it, the most probable first."""
    own, base = found.chosen, found.base
    near = [
        f
        for f in found.fitted.values()
        if f is not own
        and 0 < len(f.terms) <= len(own.terms)
        and found.odds(f) > NAMED
        and found.odds(own) - found.odds(f) < SEPARATE
        and found.helps(f, base)
        and not set(f.terms) < set(own.terms)
    ]
    kept = [f for f in near if not any(set(g.terms) < set(f.terms) for g in (*near, own))]
    return tuple(sorted((own, *kept), key=lambda f: -found.odds(f)))


def _steps(found: Search, own: Explanation) -> tuple[Explanation, ...]:
    """Return the way from the base model to an explanation, the most probable of its parts at each step."""
    steps = [found.base]
    while len(steps[-1].terms) + 1 < len(own.terms):
        parts = [
            f
            for f in found.fitted.values()
            if len(f.terms) == len(steps[-1].terms) + 1
            and set(steps[-1].terms) < set(f.terms) < set(own.terms)
        ]
        if not parts:
            break
        steps.append(max(parts, key=found.odds))
    return (*steps, own)
