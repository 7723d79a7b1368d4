"""The start of a fit whose base model is far off, or which has measured modes that the model lacks.

Each measured mode is one of the model's or, with a probability `STRANGE`, none of them: then its equation errors may be
anything. The density of this mixture has one maximum over a coordinate of which nothing is known, however far off some
modes are. That of normal errors has many: one for each way of taking modes for one another.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Sequence

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from updating.inference.discrepancy import joined
from updating.inference.equation_error import Errors, apart_from
from updating.inference.explain import Setting, errors_at
from updating.inference.levels import STRANGE
from updating.inference.protocol import Model

Vector = NDArray[np.float64]


def robust_start(
    model: Model,
    common: Setting,
    start: Vector,
    *,
    sizes: Sequence[float] = (0.02, 0.05),
    reach: float = 1.2,
    per_step: int = 4,
) -> tuple[Vector, frozenset[tuple[int, int]]]:
    """Scan each coordinate that moves modes and of which nothing is known, for the most probable mixture of modes.

    Parameters
    ----------
    model, common : Model and Setting
        The model, and what fits share.
    start : (n_nuisance,)
        Middle of the scan.
    sizes : sequence of float
        Of the discrepancy: the largest that is usual, and more, for nothing else is fitted yet.
    reach : float
        Distance of the scan to either side.
    per_step : int
        Points in the longest step of a fit; one local model holds for them.

    Returns
    -------
    (n_nuisance,) float and frozenset of (int, int)
        Coordinates of the base model, and the measured modes, by state and number, that are none of its modes there.
    """
    best, at, apart = -np.inf, np.array(start, float), frozenset[tuple[int, int]]()
    moving = model.about(model.nuisances, [at]).modal(at, 0).moves
    for i, c in enumerate(model.nuisances):
        if i not in moving or not (np.isinf(c.std) and np.isfinite(c.longest)):
            continue
        before = at
        for middle in np.arange(-reach, reach + 1e-9, c.longest):
            around = middle + c.longest * ((np.arange(per_step) + 0.5) / per_step - 0.5)
            points = [np.array([*before[:i], before[i] + away, *before[i + 1 :]]) for away in (middle, *around)]
            points = [x for x in points if c.lower <= x[i] <= c.upper]
            if not points:
                continue
            local = model.about(model.nuisances, points[:1])
            for x in points:
                with contextlib.suppress(np.linalg.LinAlgError, ValueError):  # no modes there
                    errors = errors_at(model, local, common, x)
                    for size in sizes:
                        log, strange = _mixture(errors, size)
                        if log > best + 1e-6:
                            best, at, apart = log, x, strange
    return at, apart


def _mixture(errors: Sequence[Errors], size: float) -> tuple[float, frozenset[tuple[int, int]]]:
    """Return the logarithm of the density of all modes, and which are more probably none of the model's."""
    total, apart = 0.0, set[tuple[int, int]]()
    for c, of_state in enumerate(errors):
        n, m = of_state.value.shape
        discrepancy = joined([of_state], np.ones((1, 1))).discrepancy.reshape(n, m, n, m)
        wide = apart_from(of_state, old=(), new=range(n)).noise
        for r, value in enumerate(of_state.value):
            mine = math.log(1.0 - STRANGE) + _log_normal(value, of_state.noise[r] + size**2 * discrepancy[r, :, r])
            strange = math.log(STRANGE) + _log_normal(value, wide[r])
            total += float(np.logaddexp(mine, strange)) + float(of_state.log_maps[r])
            if strange > mine:
                apart.add((c, r))
    return total, frozenset(apart)


def _log_normal(value: Vector, covariance: Vector) -> float:
    root = la.cholesky(covariance, lower=True, check_finite=False)
    white = la.solve_triangular(root, value, lower=True, check_finite=False)
    return -0.5 * float(white @ white) - float(np.sum(np.log(np.diag(root))))
