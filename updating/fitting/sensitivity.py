"""Whitened differences between measured and modelled modes, with their analytic derivatives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from model import Modes
from updating.fitting.target import Target

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Scatter:
    """Standard deviations beyond the identification's: what reassembly changes and no model of this kind meets.

    Those of `DiagnosisScatter` are the smallest that a right model meets, since a diagnosis asks whether anything is
    missing. These are what a model with its remaining faults meets in practice: they set how frequencies, damping
    ratios and shapes weigh against each other in a fit that is to serve although the model is not right.

    Attributes
    ----------
    frequency, damping : float
        Relative.
    shape : float
        Of a component, relative to the root mean square of its mode.
    pressure : float
        Of the pressure of each configuration about its nominal one, relative: torque and reassembly. Where it is not
        0, each pressure is a parameter with this prior.
    """

    frequency: float = 0.005
    damping: float = 0.1
    shape: float = 0.05
    pressure: float = 0.0


FREQUENCY, DAMPING, SHAPE, PRIOR = range(4)
"""Blocks that weighted differences belong to."""


def whitened_residual(
    target: Target,
    used: NDArray[np.bool_],
    modes: Modes,
    column: NDArray[np.int64],
    scatter: Scatter,
    *,
    with_damping: bool,
) -> tuple[Array, Array, NDArray[np.int64]]:
    """Return the weighted differences of model and measurement and their derivatives.

    Frequencies enter by their logarithm, damping ratios as they are, both weighted by the inverse of the
    identified covariance plus scatter. Shapes enter as vectors, the modelled one times the factor that suits
    best, whose dependence on the parameters is part of the derivative. A mode that the model does not have
    (column -1) counts as off by a factor e, without derivative.

    Parameters
    ----------
    target : Target
        The measured modes.
    used : (n_mode,) bool
        Which of them count.
    modes : Modes
        Elastic modes of the model at the target's observation.
    column : (n_mode,) int
        The model's mode of each measured one.
    scatter : Scatter
        Standard deviation beyond the identification's.
    with_damping : bool
        Whether damping ratios count.

    Returns
    -------
    residual : (n_residual,)
        In standard deviations.
    jacobian : (n_residual, n_parameter)
        By each of `modes.parameter`.
    block : (n_residual,) int
        `FREQUENCY`, `DAMPING` or `SHAPE`.
    """
    chosen = np.flatnonzero(used)
    value, slope, index, variance, block = _unweighted(target, chosen, modes, column, scatter, with_damping)
    factor = la.cholesky(target.covariance[np.ix_(index, index)] + np.diag(variance), lower=True)
    residual = [la.solve_triangular(factor, np.array(value), lower=True)]
    jacobian = [
        la.solve_triangular(factor, np.reshape(slope, (len(value), len(modes.parameter))), lower=True)
    ]
    if target.shape.shape[0]:
        for r in chosen:
            difference, derivative = _shape_residual(target, int(r), modes, int(column[r]), scatter)
            residual.append(difference)
            jacobian.append(derivative)
            block += [SHAPE] * difference.size
    return np.concatenate(residual), np.vstack(jacobian), np.array(block)


def _unweighted(
    target: Target,
    chosen: NDArray[np.intp],
    modes: Modes,
    column: NDArray[np.int64],
    scatter: Scatter,
    with_damping: bool,
) -> tuple[list[float], list[Array], list[int], list[float], list[int]]:
    """Return differences before weighting, their derivatives, rows of the covariance, added variances and blocks."""
    n_parameter = len(modes.parameter)
    value, slope, index, variance, block = [], [], [], [], []
    for r in chosen:
        c = column[r]
        value.append(np.log(modes.frequency[c] / target.frequency[r]) if c >= 0 else 1.0)
        slope.append(modes.frequency_gradient[c] / modes.frequency[c] if c >= 0 else np.zeros(n_parameter))
        index.append(2 * r)
        variance.append(scatter.frequency**2)
        block.append(FREQUENCY)
        if with_damping and np.isfinite(target.damping[r]):
            value.append(modes.damping[c] - target.damping[r] if c >= 0 else target.damping[r])
            slope.append(modes.damping_gradient[c] if c >= 0 else np.zeros(n_parameter))
            index.append(2 * r + 1)
            variance.append((scatter.damping * target.damping[r]) ** 2)
            block.append(DAMPING)
    return value, slope, index, variance, block


def _shape_residual(target: Target, r: int, modes: Modes, c: int, scatter: Scatter) -> tuple[Array, Array]:
    measured = target.shape[:, r]
    rms = np.linalg.norm(measured) / np.sqrt(measured.size)
    weight = 1.0 / np.sqrt(target.shape_std[:, r] ** 2 + (scatter.shape * rms) ** 2)
    measured = weight * measured
    shape = weight * modes.shape[:, c]
    slope = weight[:, None] * modes.shape_gradient[:, c]
    norm = shape @ shape
    scale = (shape @ measured) / norm
    d_scale = (slope.T @ measured - 2.0 * scale * (slope.T @ shape)) / norm
    return scale * shape - measured, scale * slope + np.outer(shape, d_scale)
