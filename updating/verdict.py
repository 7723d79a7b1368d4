"""The verdict on what a search found: nothing missing, an effect, a set that the data cannot part, or the unknown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.stats import chi2

from updating.explanation import Explanation
from updating.search import Search

Verdict = Literal["nothing missing", "identified", "one of", "unlike anything"]

SEPARATE = 3.0
"""Discrimination distance below which two explanations are an ambiguity."""
GAIN_SINGLE = 16.0
"""Fall of the squared misfit that a missing effect must bring; the best of the whole catalogue reaches it by chance in
few of 100 complete models."""
GAIN_SECOND = 16.0
"""The same for a second effect beside the first."""
P_ADEQUATE = 1e-3
"""A model that fits worse than this is not adequate."""
P_CONTENT = 0.05
"""One effect that fits better than this needs no second."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Decision:
    """A verdict with the explanations that it leaves.

    Attributes
    ----------
    verdict : Verdict
        One of four.
    left : tuple of Explanation
        What the data cannot tell apart, the best first; none where nothing is missing or nothing is like it.
    """

    verdict: Verdict
    left: tuple[Explanation, ...]


def decide(found: Search) -> Decision:
    """Give the verdict on what a search found."""
    base = found.base
    single = min(found.singles, key=lambda x: x.misfit, default=base)
    pair = min(found.pairs, key=lambda x: x.misfit, default=base)
    needed = base.misfit - single.misfit > GAIN_SINGLE
    second = single.misfit - pair.misfit > GAIN_SECOND and p_value(single) < P_CONTENT
    if not needed and base.misfit - pair.misfit > GAIN_SINGLE + GAIN_SECOND:
        needed = second = True
    if not needed:
        return Decision(
            verdict="nothing missing" if p_value(base) > P_ADEQUATE else "unlike anything", left=()
        )
    best, among = (pair, found.pairs) if second else (single, found.singles)
    if p_value(best) < P_ADEQUATE:
        return Decision(verdict="unlike anything", left=())
    left = tuple(sorted((x for x in among if x.misfit - best.misfit < SEPARATE**2), key=lambda x: x.misfit))
    return Decision(verdict="identified" if len(left) == 1 else "one of", left=left)


def block_p_value(explanation: Explanation, kinds: Sequence[str], n_free: int) -> float:
    """Return the probability of a misfit as large in some kinds of data, with `n_free` parameters fitted to them."""
    inside = np.isin(explanation.residual.kind, kinds)
    misfit = float(np.sum(explanation.residual.value[inside] ** 2))
    return float(chi2.sf(misfit, max(int(inside.sum()) - n_free, 1)))


def p_value(explanation: Explanation) -> float:
    """Return the probability of a misfit as large if the explanation were complete.

    Twice the smaller of that of frequencies, damping ratios and priors, and that of shapes, which are many and would
    hide what the few others say.
    """
    modal = block_p_value(
        explanation, ["frequency", "damping", "prior"], explanation.residual.jacobian.shape[1]
    )
    return min(1.0, 2.0 * min(modal, block_p_value(explanation, ["shape"], 0)))
