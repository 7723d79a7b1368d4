"""Whether an explanation is enough: probabilities of a misfit as large as its own."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from updating.diagnosis import mixing
from updating.diagnosis.explanation import Explanation
from updating.diagnosis.residual import Residual

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
    return float(chdtrc(mean**2 / half_variance, misfit * mean / half_variance))


def _worst(found: Residual, parts: Sequence[NDArray[np.bool_]]) -> float:
    """Return the smallest probability of a misfit as large in one of some parts, times their number."""
    return min(1.0, len(parts) * min((_p_value(found, part) for part in parts), default=1.0))


def p_value(explanation: Explanation) -> float:
    """Return the probability of a misfit as large if the explanation were complete.

    The smallest of the probabilities of each kind of data, of the worst shape, of the worst frequency or damping ratio
    and of the worst nuisance alone, and of how the shapes lean towards other modes, times their number (Bonferroni):
    what few frequencies say would be lost among the many shape components, what one shape says among those of all, and
    that one nuisance has to leave what is known of it among those that stay.
    """
    found = explanation.residual
    shape = np.where(found.kind == "shape", found.label, "")
    single = np.eye(found.value.size, dtype=bool)
    each = [
        *(block_p_value(explanation, kind) for kind in ("frequency", "damping", "shape")),
        _worst(found, [shape == one for one in np.setdiff1d(shape, ("", *found.weak))]),
        _worst(found, list(single[np.isin(found.kind, ("frequency", "damping"))])),
        _worst(found, list(single[found.kind == "prior"])),
        mixing.p_value(found.mixing),
    ]
    return min(1.0, len(each) * min(each))
