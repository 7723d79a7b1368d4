"""Intervals of fitted parameters: from the covariance, from the profile of chi-square, or from simulated data.

The covariance holds where chi-square is a parabola over the interval. The profile takes chi-square as it is, the
other parameters fitted anew at each value (Venzon and Moolgavkar, Appl. Statist. 37, 1988); the parametric bootstrap
fits data that are drawn from the fitted model (Efron and Tibshirani, An Introduction to the Bootstrap, 1993, ch. 6).
"""

from __future__ import annotations

from concurrent.futures import Executor
from functools import partial
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import chdtri, ndtri

from updating.fitting.descent import Descent, at_bound, descend
from updating.fitting.joint_problem import Problem
from updating.workers.workers import distribute

Vector = NDArray[np.float64]
Method = Literal["normal", "profile", "bootstrap"]

LEVEL = 0.95
N_DRAW = 200
"""Simulated sets of data of a bootstrap."""
_NORMAL = float(ndtri(0.5 + LEVEL / 2.0))
_RISE = float(chdtri(1, 1.0 - LEVEL))
_PARABOLA = 0.15  # relative deviation of the profile's rise up to which the normal interval stands
_STEP = 1e-3  # of the range: accuracy of a profile's ends


def normal_intervals(problem: Problem, x: Vector, covariance: Vector) -> Vector:
    """Return intervals of 95 % from the covariance, within the bounds, in search variables (n_parameter, 2)."""
    reach = _NORMAL * np.sqrt(np.diag(covariance))
    return np.clip(np.stack([x - reach, x + reach], axis=1), problem.low[:, None], problem.high[:, None])


def profile_intervals(
    problem: Problem, x: Vector, normal: Vector, inflation: Vector
) -> tuple[Vector, list[Method]]:
    """Return intervals of 95 % from the profile of chi-square wherever the normal ones do not hold.

    Only parameters that several configurations share are looked at, except those of pressure.

    Parameters
    ----------
    problem : Problem
        The problem.
    x : (n_parameter,) float
        Its optimum.
    normal : (n_parameter, 2) float
        Normal intervals.
    inflation : (n_residual,) float
        Root of the variance factor of each difference.

    Returns
    -------
    interval : (n_parameter, 2) float
        In search variables; an end at a bound is open.
    method : list of str
        "normal" or "profile" for each parameter.
    """
    weight = 1.0 / inflation
    best = descend(problem, x, weight=weight)
    found = normal.copy()
    methods: list[Method] = ["normal"] * x.size
    on_bound = at_bound(problem, x)
    for j in _worth_profiling(problem):
        rise = _Profile(problem, j, best, weight)
        ends = normal[j]
        if not on_bound[j] and problem.low[j] < ends[0] and ends[1] < problem.high[j]:
            rises = np.array([rise(float(end)) for end in ends]) / _RISE
            if np.abs(rises - 1.0).max() < _PARABOLA:
                continue
        methods[j] = "profile"
        for side, bound in enumerate((problem.low[j], problem.high[j])):
            found[j, side] = rise.end(float(bound))
    return found, methods


def bootstrap_intervals(
    problem: Problem,
    x: Vector,
    inflation: Vector,
    *,
    seed: int,
    n_draw: int = N_DRAW,
    executor: Executor | None = None,
) -> Vector:
    """Return intervals of 95 % from fits to simulated data, in search variables (n_parameter, 2).

    The data are those of the fitted model with normal errors of the stated size, inflated where the misfit is larger.
    """
    random = np.random.default_rng(seed)
    residual = problem.evaluate(x)[0]
    shifts = [inflation * random.standard_normal(residual.size) - residual for _ in range(n_draw)]
    draws = np.array(list(distribute(partial(_refitted, problem, x), shifts, executor)))
    tail = (1.0 - LEVEL) / 2.0
    return np.quantile(draws, [tail, 1.0 - tail], axis=0).T


def _refitted(problem: Problem, x: Vector, shift: Vector) -> Vector:
    return descend(problem, x, shift=shift).last


def _worth_profiling(problem: Problem) -> list[int]:
    """Return the parameters that more than one configuration has."""
    owners = [sum(j in column.values() for column in problem.column) for j in range(len(problem.free))]
    alone = len(problem.prepared) == 1
    return [j for j, f in enumerate(problem.free) if f.name != "pressure" and (alone or owners[j] > 1)]


class _Profile:
    """By how much chi-square rises when one variable is held, the others fitted from the nearest point known."""

    def __init__(self, problem: Problem, j: int, best: Descent, weight: Vector) -> None:
        self.problem, self.j, self.best, self.weight = problem, j, best, weight
        self.known = {float(best.last[j]): best.last}

    def __call__(self, value: float) -> float:
        nearest = min(self.known, key=lambda other: abs(other - value))
        if nearest == value == self.best.last[self.j]:
            return 0.0
        first = self.known[nearest].copy()
        first[self.j] = value
        trial = descend(self.problem, first, held=[self.j], weight=self.weight)
        self.known[value] = trial.last
        return 2.0 * (trial.cost - self.best.cost)

    def end(self, bound: float) -> float:
        """Return where the profile reaches the level towards a bound; the bound where it does not."""
        centre = float(self.best.last[self.j])
        reach = bound - centre
        if abs(reach) < 1e-12 or self(bound) <= _RISE:
            return bound
        return float(brentq(lambda value: self(value) - _RISE, centre, bound, xtol=_STEP * abs(reach)))
