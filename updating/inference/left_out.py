"""How well an explanation predicts modes and states that are left out, by the linear algebra of its fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from updating.inference.algebra import bounded_step
from updating.inference.discrepancy import Problem
from updating.inference.explain import Explanation
from updating.inference.tree import TreeProblem
from updating.inference.tree_left_out import tree_left_out

Vector = NDArray[np.float64]


Kind = Literal["frequency", "damping"]


@dataclass(frozen=True, eq=False, kw_only=True)
class LeftOut:
    """Relative errors of predictions from all other data.

    Attributes
    ----------
    errors : mapping of "frequency" or "damping" to (n,) float
        Of natural frequencies and of damping ratios, by measured mode; NaN where nothing is predicted, and for modes
        that are set apart from the model's.
    state : (n,) int
        The state of each mode.
    """

    errors: Mapping[Kind, Vector]
    state: NDArray[np.intp]

    def among(self, states: Sequence[int] | None) -> LeftOut:
        """Return the errors of some states alone; of all where none are named."""
        if states is None:
            return self
        here = np.isin(self.state, list(states))
        return replace(self, errors={kind: np.where(here, error, np.nan) for kind, error in self.errors.items()})

    @property
    def frequency(self) -> float:
        """Root mean square error of natural frequencies; NaN without any."""
        return self.rms("frequency")

    @property
    def damping(self) -> float:
        """Root mean square error of damping ratios; NaN without any."""
        return self.rms("damping")

    def rms(self, kind: Kind) -> float:
        """Return the root mean square error of a kind, NaN without any."""
        return _rms(self.errors[kind])

    def beside(self, other: LeftOut, kind: Kind) -> float:
        """Return the root mean square error of the modes that `other` predicts; 1 for each that only `other` does."""
        mine = np.where(np.isfinite(self.errors[kind]), self.errors[kind], 1.0)
        return _rms(np.where(np.isfinite(other.errors[kind]), mine, np.nan))


def left_out(
    explanation: Explanation,
    by: Literal["mode", "state", "specimen"] = "mode",
    *,
    near: float = 0.3,
    alike: float = 0.5,
) -> LeftOut:
    """Predict each mode of the structure, in all states at once, or each state, from all other data.

    It is to first order about the fit, without a new fit: the step follows from the errors of the data that remain.

    Parameters
    ----------
    explanation : Explanation
        A fit.
    by : "mode", "state" or "specimen"
        What is left out at a time; specimens where there are several.
    near, alike : float
        Difference of the logarithm of eigenvalues, and cosine between modal coordinates, within which two measured
        modes of different states are one of the structure.
    """
    problem, sizes = explanation.problem, explanation.evidence.sizes
    if isinstance(problem, TreeProblem):
        precision = np.array([c.std**-2.0 for c in explanation.coordinates])
        both = (sizes.stiffness, sizes.damping)
        predicted = tree_left_out(
            explanation.errors, problem, both, explanation.x, precision, explanation.bounds, by, explanation.n_nuisance
        )
        state = np.concatenate([np.full(len(e.value), c) for c, e in enumerate(explanation.errors)])
        return LeftOut(errors={"frequency": predicted[0], "damping": predicted[1]}, state=state)
    m = explanation.errors[0].value.shape[1]
    state = np.concatenate([np.full(len(e.value), c) for c, e in enumerate(explanation.errors)])
    weight = np.vstack([e.weight @ (explanation.errors[0].shape.T @ e.shape).T for e in explanation.errors])
    eigenvalue = np.concatenate([e.eigenvalue for e in explanation.errors])
    covariance = sizes.stiffness**2 * problem.discrepancy + problem.noise
    of_damping = sizes.damping**2 * problem.damping_discrepancy + problem.damping_noise
    precision = np.array([c.std**-2.0 for c in explanation.coordinates]) + 1e-12
    damped = np.isfinite(np.concatenate([e.damping for e in explanation.errors]))
    value = problem.value.reshape(-1, m)
    jacobian = problem.jacobian.reshape(-1, m, explanation.x.size)
    frequency, damping = np.full((2, state.size), np.nan)
    beside = problem.beside(sizes)
    strange = {int(np.flatnonzero(state == c)[0]) + r for c, r in explanation.apart}
    for r in range(state.size):
        if by == "state":
            out = state == state[r]
        else:
            out = (np.abs(np.log(eigenvalue / eigenvalue[r])) < near) & (np.abs(weight @ weight[r]) > alike)
            out[r] = True
        if out.all():
            nothing = np.full(state.size, np.nan)
            return LeftOut(errors={"frequency": nothing, "damping": nothing}, state=state)
        if r in strange:
            continue
        pull = beside[~out].sum(axis=0)
        step = _step_without(explanation, out, pull, covariance, of_damping, precision, damped)
        a = explanation.errors[state[r]].weight[r - int(np.flatnonzero(state == state[r])[0])]
        frequency[r] = 0.5 * float((value[r] + jacobian[r] @ step) @ a)
        if damped[r]:
            i = int(np.count_nonzero(damped[:r]))
            damping[r] = float(problem.damping[i] + problem.damping_jacobian[i] @ step)
    return LeftOut(errors={"frequency": frequency, "damping": damping}, state=state)


def _step_without(
    explanation: Explanation,
    out: NDArray[np.bool_],
    pull: Vector,
    covariance: Vector,
    of_damping: Vector,
    precision: Vector,
    damped: NDArray[np.bool_],
) -> Vector:
    """Return the step of the coordinates that follows from the errors of all other modes, (n_coordinate,).

    `pull` is what these modes add to the gradient beyond the slope of their errors (`Problem.beside`).
    """
    problem = explanation.problem
    assert isinstance(problem, Problem)
    m = explanation.errors[0].value.shape[1]
    hessian, slope = np.diag(precision) + problem.curvature_of(~out), precision * explanation.x + pull
    for value, jacobian, matrix, keep in (
        (problem.value, problem.jacobian, covariance, ~np.repeat(out, m)),
        (problem.damping, problem.damping_jacobian, of_damping, ~out[damped]),
    ):
        if keep.any():
            root = la.cholesky(matrix[np.ix_(keep, keep)], lower=True, check_finite=False)
            white = la.solve_triangular(
                root, np.column_stack([value[keep], jacobian[keep]]), lower=True, check_finite=False
            )
            hessian = hessian + white[:, 1:].T @ white[:, 1:]
            slope = slope + white[:, 1:].T @ white[:, 0]
    lower, upper = explanation.bounds
    return bounded_step(slope, hessian, lower - explanation.x, upper - explanation.x)


def _rms(errors: Vector) -> float:
    known = errors[np.isfinite(errors)]
    return float(np.sqrt(np.mean(known**2))) if known.size else float("nan")
