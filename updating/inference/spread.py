"""What data say to first order of coordinates that a fit lacks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from updating.inference.algebra import scaled_solve
from updating.inference.discrepancy import Problem, Sizes, whitened
from updating.inference.protocol import Coordinate

Vector = NDArray[np.float64]


def rise(
    problem: Problem,
    x: Vector,
    coordinates: Sequence[Coordinate],
    sizes: Sizes,
    fitted: Sequence[bool] | NDArray[np.bool_],
) -> float:
    """Return the misfit after a linear step of the fitted coordinates, their priors included.

    Parameters
    ----------
    problem, x, coordinates, sizes, fitted
        As `information` takes them.
    """
    value, jacobian, _ = whitened(problem, sizes)
    have = np.array(fitted, dtype=bool)
    precision = np.array([c.std**-2.0 for c in coordinates])[have]
    slope = jacobian[:, have].T @ value + problem.beside(sizes).sum(axis=0)[have] + precision * x[have]
    hessian = (
        jacobian[:, have].T @ jacobian[:, have] + problem.curvature[np.ix_(have, have)] + np.diag(precision + 1e-12)
    )
    return float(value @ value + precision @ x[have] ** 2 - slope @ scaled_solve(hessian, slope))


def information(
    problem: Problem,
    x: Vector,
    coordinates: Sequence[Coordinate],
    sizes: Sizes,
    fitted: Sequence[bool] | NDArray[np.bool_],
) -> tuple[Vector, Vector]:
    """Return the estimate and standard deviation of each coordinate, added alone to those that are fitted.

    Parameters
    ----------
    problem : Problem
        Errors of all states at `x`.
    x : (n_coordinate,)
        Where.
    coordinates : sequence of Coordinate
        All of them.
    sizes : Sizes
        Of the discrepancy.
    fitted : (n_coordinate,) bool
        Which the explanation has.
    """
    value, jacobian, _ = whitened(problem, sizes)
    precision = np.array([c.std**-2.0 for c in coordinates])
    have = np.array(fitted, dtype=bool)
    hessian = jacobian.T @ jacobian + problem.curvature
    slope = jacobian.T @ value + problem.beside(sizes).sum(axis=0)
    inner = hessian[np.ix_(have, have)] + np.diag(precision[have] + 1e-12)
    towards = scaled_solve(inner, hessian[np.ix_(have, ~have)])
    mean, std = np.array(x, float), np.full(x.size, np.inf)
    left = np.diag(hessian)[~have] - np.sum(hessian[np.ix_(have, ~have)] * towards, axis=0)
    pull = slope[~have] - towards.T @ (slope[have] + precision[have] * x[have])
    left = np.maximum(left, 1e-12)
    std[~have] = left**-0.5
    mean[~have] = x[~have] - pull / left
    return mean, std
