"""Whether an explanation is enough: probabilities of a misfit as large as its own."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.stats import chi2

from updating.explanation import Explanation

P_CONTENT = 0.05
"""One effect that fits worse than this asks for a second."""


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
