"""One descent of a joint fit, and the covariance of where it ends."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from updating.fitting.joint_problem import Problem
from updating.fitting.sensitivity import PRIOR

Vector = NDArray[np.float64]

_AT_BOUND = 1e-4  # of the range
_MOST = 100  # evaluations
_TOLERANCES = {"xtol": 1e-8, "ftol": 1e-10}
_LAST, _NOTHING = 20, 1e-6  # evaluations in which the sum of squares must fall by this ratio
_SINGULAR = 1e-13  # of the largest curvature: less is rounding


@dataclass(frozen=True, eq=False, kw_only=True)
class Descent:
    """One descent, in search variables.

    Attributes
    ----------
    first, last : (n_parameter,) float
        Where it began and ended.
    objective : (n_evaluation,) float
        Half the sum of squares at each point tried, in order.
    cost : float
        Half the sum of squares at the end.
    converged : bool
        Whether a tolerance was met, or nothing more was gained, before the steps ran out.
    """

    first: Vector
    last: Vector
    objective: Vector
    cost: float
    converged: bool


def descend(
    problem: Problem,
    first: Vector,
    *,
    held: Collection[int] = (),
    weight: Vector | None = None,
    shift: Vector | None = None,
) -> Descent:
    """Minimise the sum of squared weighted differences from one point.

    Parameters
    ----------
    problem : Problem
        The problem.
    first : (n_parameter,) float
        Search variables to begin with.
    held : collection of int
        Variables that stay as they are.
    weight : (n_residual,) float, optional
        Factors of the differences.
    shift : (n_residual,) float, optional
        What is added to the differences, before the factors: simulated errors.
    """
    moving = np.setdiff1d(np.arange(first.size), list(held))
    history: list[float] = []
    factor = np.ones(1) if weight is None else weight
    offset = np.zeros(1) if shift is None else shift

    def whole(y: Vector) -> Vector:
        x = first.copy()
        x[moving] = y
        return x

    def residual(y: Vector) -> Vector:
        value = factor * (problem.evaluate(whole(y))[0] + offset)
        history.append(0.5 * float(value @ value))
        return value

    def jacobian(y: Vector) -> Vector:
        return np.asarray((problem.evaluate(whole(y))[1] * factor[:, None])[:, moving])

    if moving.size == 0:
        residual(first)
        return Descent(first=first, last=first, objective=np.array(history), cost=history[0], converged=True)
    found = least_squares(
        residual,
        first[moving],
        jac=jacobian,
        bounds=(problem.low[moving], problem.high[moving]),
        x_scale="jac",
        max_nfev=_MOST,
        **_TOLERANCES,
    )
    return Descent(
        first=first,
        last=whole(found.x),
        objective=np.array(history),
        cost=float(found.cost),
        converged=found.status > 0 or _stalled(history),
    )


def _stalled(history: list[float]) -> bool:
    """Tell whether the last steps gained nothing: where a derivative jumps, tolerances are met late or never."""
    return min(history[:-_LAST]) - min(history) < _NOTHING * min(history)


def at_bound(problem: Problem, x: Vector) -> NDArray[np.bool_]:
    """Tell which search variables lie on a bound (n_parameter,)."""
    return np.asarray(
        np.minimum(x - problem.low, problem.high - x) < _AT_BOUND * (problem.high - problem.low)
    )


def covariance(problem: Problem, x: Vector) -> tuple[Vector, Vector]:
    """Return the covariance of search variables at an optimum, and the inflation of each difference.

    Frequencies, damping ratios and shapes each have a variance factor of their own: the squared misfit over its
    degrees of freedom, 1 at least. Where the model is off by more than the stated errors, the covariance grows by
    it (the sandwich estimator; White, Econometrica 50, 1982). So shapes that fit well cannot make up for frequencies
    that do not.

    Parameters
    ----------
    problem : Problem
        The problem.
    x : (n_parameter,) float
        Its optimum.

    Returns
    -------
    covariance : (n_parameter, n_parameter)
        Zero for variables on a bound. A direction that the data do not determine has a huge variance.
    inflation : (n_residual,)
        Root of the variance factor of each difference.
    """
    residual, jacobian = problem.evaluate(x)
    inner = np.flatnonzero(~at_bound(problem, x))
    reduced = jacobian[:, inner]
    inverse, undetermined = _inverse(reduced.T @ reduced)
    inflation = np.ones(residual.size)
    middle = undetermined @ undetermined.T
    for name in np.unique(problem.block):
        inside = problem.block == name
        share = inverse @ reduced[inside].T
        if name != PRIOR:
            degrees = max(1.0, np.count_nonzero(inside) - float(np.sum(share.T * reduced[inside])))
            inflation[inside] = max(1.0, float(residual[inside] @ residual[inside]) / degrees) ** 0.5
        middle += inflation[inside][0] ** 2 * (share @ share.T)
    found = np.zeros((x.size, x.size))
    found[np.ix_(inner, inner)] = middle
    return found, inflation


def _inverse(curvature: Vector) -> tuple[Vector, Vector]:
    """Invert a curvature matrix; directions without curvature are left out and returned with a huge length."""
    length = np.sqrt(np.diag(curvature))
    length = np.where(length > 0.0, length, np.sqrt(_SINGULAR))
    value, vector = np.linalg.eigh(curvature / np.outer(length, length))
    vector = vector / length[:, None]
    flat = value < _SINGULAR * max(1.0, value.max(initial=0.0))
    inverse = (vector[:, ~flat] / value[~flat]) @ vector[:, ~flat].T
    return np.asarray(inverse), np.asarray(vector[:, flat] / np.sqrt(_SINGULAR))
