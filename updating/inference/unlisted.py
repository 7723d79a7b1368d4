"""The evidence of something beside an explanation that no term of the catalogue describes.

Most of what a structure can have and a model can lack acts in few places: a mass, a spring, a crack, a joint. In modal
coordinates it is of low rank, while the discrepancy of an honest model has all directions alike. So the rival of every
term is a change of the stiffness or of the mass in one unknown direction v, with equation errors
+-v_s (v.a_r) of stiffness and +-omega_r / omega_s v_s (v.a_r) of mass. A term that this rival beats has the strength
of what is missing, not its form: naming it would be wrong.
"""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray
from scipy.special import logsumexp

from updating.inference.beside import Beside
from updating.inference.discrepancy import Sizes, roots, rotation, whitened
from updating.inference.equation_error import Errors
from updating.inference.explain import Explanation, Setting
from updating.inference.protocol import State
from updating.inference.tree import TreeProblem

Vector = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class _Change:
    """A change of stiffness or of mass in one direction: by state, its modes in those of the first, and what it scales.

    States that do not have it are left out by a scale of 0.
    """

    turns: tuple[Vector, ...]
    weights: tuple[Vector, ...]
    scales: tuple[Vector, ...]

    def at(self, direction: Vector) -> tuple[Vector, Vector]:
        """Return the equation errors that it takes away, (N,), and their derivatives by the direction, (N, m)."""
        values, derivatives = list[Vector](), list[Vector]()
        for turn, weight, scale in zip(self.turns, self.weights, self.scales, strict=True):
            here, onto = direction @ turn, weight @ turn.T
            part = onto @ direction
            values.append((scale * here * part[:, None]).ravel())
            by = turn.T * part[:, None, None] + here[:, None] * onto[:, None, :]
            derivatives.append((scale[:, :, None] * by).reshape(-1, direction.size))
        return np.concatenate(values), np.vstack(derivatives)


@dataclass(frozen=True, eq=False)
class _Eliminated:
    """Errors whitened by the matrix `white`, with derivatives by the coordinates of the fit, which are eliminated.

    `pull` is the gradient of all other parts of the cost by these, `inverse` that of the Hessian of the whole, and
    `log` half the logarithm of what both determinants add to the density.
    """

    white: Vector
    value: Vector
    jacobian: Vector
    inverse: Vector
    pull: Vector
    log: float

    def cost(self, errors: Vector) -> tuple[float, Vector]:
        """Return the cost with some equation errors taken away, and its gradient by these, whitened."""
        rest = self.value - errors
        driven = self.jacobian.T @ rest + self.pull
        answer = self.inverse @ driven
        return 0.5 * float(rest @ rest - driven @ answer), self.jacobian @ answer - rest


def unlisted_gain(
    explanation: Explanation,
    setting: Setting,
    measured: Sequence[State],
    states: Collection[int] | None = None,
    *,
    strengths: Sequence[float] = (0.2, 0.06, 0.02),
    n_start: int = 2,
    lowest: float = 0.1,
) -> float:
    """Return the logarithm of the factor by which something unlisted beside an explanation raises its evidence.

    First, coordinates of the fit are eliminated (errors are linear in them about the explanation), the direction is
    found by Gauss and Newton's method and integrated by Laplace's, sizes of the discrepancy and of the direction on
    grids. Far from the measurement, errors that are linear promise too much: the evidence is that of the best of these
    directions, fitted as any term is (`Beside`).

    Parameters
    ----------
    explanation : Explanation
        A fit; of many specimens, minus infinity is returned: nothing unlisted is looked for there.
    setting : Setting
        What all fits share.
    measured : sequence of State
        The measured states.
    states : collection of int, optional
        Those that the unlisted may change; all by default.
    strengths : sequence of float
        Prior standard deviations of a component of the direction, alike probable: changes of a stiffness by 0.5 % to
        half of it, spread over some 15 modes.
    n_start : int
        Directions from which each sign starts: the strongest of the errors' mean symmetric matrix.
    lowest : float
        Smallest size of the discrepancy that is looked at, relative to that without the unlisted.
    """
    problem, sizes, priors = explanation.problem, explanation.evidence.sizes, setting.priors
    if isinstance(problem, TreeProblem):
        return -np.inf
    grid = priors[0].grid
    near = (grid > lowest * sizes.stiffness) & (grid < 1.5 * sizes.stiffness)
    beside = problem.beside(sizes).sum(axis=0)
    likely = [
        (_eliminated(explanation, Sizes(stiffness=float(size), damping=sizes.damping), beside), log)
        for size, log in zip(grid[near], priors[0].log_density[near], strict=True)
    ]
    pull = la.cho_solve((roots(problem, sizes)[0], True), problem.value)
    logs, ends = list[float](), list[tuple[float, Beside, Vector, float]]()
    for of_mass, sign in itertools.product((False, True), (1.0, -1.0)):
        change = _change(problem.errors, states, of_mass, sign)
        model = Beside(explanation, measured, of_mass, sign, states)
        by_start = []
        for at in _directions(sizes.stiffness**2 * pull, change, n_start):
            direction, of_start = at, []
            for e, log in likely:  # from small sizes on, where a direction is needed most: 0 is stationary
                for strength in strengths:
                    integral, direction = _integrated(e, change, direction, strength)
                    of_start.append(log + e.log + integral)
                    ends.append((of_start[-1], model, direction, strength))
            by_start.append(of_start)
        logs += np.max(by_start, axis=0).tolist()
    others = float(logsumexp(logs) - np.max(logs) - np.log(4.0 * len(strengths)))
    for _, model, direction, strength in sorted(ends, key=lambda end: -end[0]):
        with contextlib.suppress(np.linalg.LinAlgError, ValueError):  # no modes there
            return model.fitted(setting, direction, strength) + others
    return -np.inf


def _eliminated(explanation: Explanation, sizes: Sizes, beside: Vector) -> _Eliminated:
    """Eliminate the coordinates of a fit at given sizes; `beside` is as `Problem.beside` has it, of all modes."""
    problem, free, n = explanation.problem, ~explanation.at_bound, explanation.problem.value.size
    precision = np.array([c.std**-2.0 for c in explanation.coordinates])
    factors = roots(problem, sizes)
    value, jacobian, log = whitened(problem, sizes, factors)  # of equations, then of damping
    hessian = jacobian.T @ jacobian + np.diag(precision + 1e-12) + problem.curvature
    hessian = hessian[np.ix_(free, free)]
    pull = jacobian[n:].T @ value[n:] + precision * explanation.x + beside
    return _Eliminated(
        white=la.solve_triangular(factors[0], np.eye(n), lower=True, check_finite=False),
        value=value[:n],
        jacobian=jacobian[:n, free],
        inverse=np.asarray(np.linalg.inv(hessian), dtype=np.float64),
        pull=pull[free],
        log=-log - 0.5 * float(np.linalg.slogdet(hessian)[1]),
    )


def _change(errors: Sequence[Errors], states: Collection[int] | None, of_mass: bool, sign: float) -> _Change:
    """Return a change of the mass, or of the stiffness, with a sign, in some states or in all."""
    turns, scales = list[Vector](), list[Vector]()
    for c, e in enumerate(errors):
        turns.append(rotation(errors[0], e) if c else np.eye(e.value.shape[1]))
        has = sign if states is None or c in states else 0.0
        scales.append(has * (e.inertia if of_mass else np.ones_like(e.value)))
    return _Change(tuple(turns), tuple(e.weight for e in errors), tuple(scales))


def _directions(pull: Vector, change: _Change, n: int) -> list[Vector]:
    """Return the strongest directions of a change in the mean of the discrepancy's symmetric matrix, given all errors.

    `pull` holds the errors over their covariance, times the variance of a discrepancy.
    """
    m = len(change.turns[0])
    by_mode, total, first = pull.reshape(-1, m), np.zeros((m, m)), 0
    for turn, weight, scale in zip(change.turns, change.weights, change.scales, strict=True):
        here = slice(first, first + len(weight))
        total += turn @ (scale * by_mode[here]).T @ weight @ turn.T
        first = here.stop
    value, vector = la.eigh(total + total.T)
    return [vector[:, -i] * np.sqrt(max(value[-i], 1e-6)) for i in range(1, n + 1)]


def _integrated(
    errors: _Eliminated, change: _Change, direction: Vector, strength: float, *, steps: int = 40, small: float = 0.05
) -> tuple[float, Vector]:
    """Return minus the least cost, integrated over directions about the best by Laplace's method, and this."""
    precision, damp = strength**-2.0, 1e-3

    def total(v: Vector) -> tuple[float, Vector, Vector]:
        taken, by = change.at(v)
        cost, gradient = errors.cost(errors.white @ taken)
        return cost + 0.5 * precision * float(v @ v), gradient, by

    at, gradient, by = total(direction)
    for _ in range(steps):
        white = errors.white @ by
        across = errors.jacobian.T @ white
        hessian = white.T @ white - across.T @ errors.inverse @ across + precision * np.eye(direction.size)
        slope = white.T @ gradient + precision * direction
        after = np.inf
        while damp < 1e6:
            step = -np.linalg.solve(hessian + damp * np.diag(np.diag(hessian)), slope)
            after, *rest = total(direction + step)
            if after < at:
                break
            damp *= 5.0
        if not after < at:
            break
        fall, at, direction, damp = at - after, after, direction + step, damp / 5.0
        gradient, by = rest
        if fall < small:
            break
    log_spread = 0.5 * direction.size * np.log(precision) - 0.5 * float(np.linalg.slogdet(hessian)[1])
    return float(-at + log_spread + np.log(2.0)), direction  # a direction and its opposite are one change
