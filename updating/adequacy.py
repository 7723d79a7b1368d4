"""Whether an explanation is enough: probabilities of a misfit as large as its own."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from updating import mixing
from updating.explanation import Explanation
from updating.residual import BLOCKS, Residual

P_ADEQUATE = 0.05
"""A model that fits worse than this is not adequate: one effect asks for a second, and what stays so is unlike
anything."""
_FREE = 1e-6  # share of a block's data below which the fit has met all of them


def block_p_value(explanation: Explanation, kind: str) -> float:
    """Return the probability of a misfit as large in one kind of data if the explanation were complete.

    What the fit leaves of data with unit covariance has the covariance I - H, where H projects on the columns of the
    Jacobian. The squared misfit of a block is thus a sum of chi-squares weighted by the eigenvalues of its part of
    I - H, which is matched in mean and variance (Satterthwaite 1946; Box 1954). Shapes that are `Residual.weak` are
    left out.

    Parameters
    ----------
    explanation : Explanation
        Fitted.
    kind : str
        One of `residual.BLOCKS`.
    """
    found = explanation.residual
    judged = (found.kind != "shape") | ~np.isin(found.label, found.weak)
    return _p_value(found, (found.kind == kind) & judged)


def _p_value(found: Residual, inside: NDArray[np.bool_]) -> float:
    """Return the probability of a misfit as large in some of the data."""
    fitted = found.span[inside]
    gram = fitted.T @ fitted
    mean = inside.sum() - float(np.trace(gram))
    half_variance = mean - float(np.trace(gram)) + float(np.sum(gram**2))
    if mean <= _FREE * max(int(inside.sum()), 1):
        return 1.0
    misfit = float(np.sum(found.value[inside] ** 2))
    return float(chi2.sf(misfit * mean / half_variance, mean**2 / half_variance))


def _worst_shape(found: Residual) -> float:
    """Return the smallest probability of a misfit as large in one shape, times the number of shapes."""
    label = np.where(found.kind == "shape", found.label, "")
    shapes = np.setdiff1d(label, ("", *found.weak))
    return min(1.0, shapes.size * min((_p_value(found, label == one) for one in shapes), default=1.0))


def p_value(explanation: Explanation) -> float:
    """Return the probability of a misfit as large if the explanation were complete.

    The smallest of the probabilities of each kind of data, of the worst shape alone, and of how the shapes lean towards
    other modes, times their number (Bonferroni): what few frequencies say would be lost among the many shape
    components, and what one shape says among those of all.
    """
    found = explanation.residual
    each = [*(block_p_value(explanation, kind) for kind in BLOCKS), _worst_shape(found)]
    each.append(mixing.p_value(found.mixing))
    return min(1.0, len(each) * min(each))
