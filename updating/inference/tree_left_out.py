"""How well an explanation of many states predicts what is left out: messages on the tree without it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from updating.inference.algebra import bounded_step, scaled_solve
from updating.inference.discrepancy import Sizes
from updating.inference.equation_error import Errors
from updating.inference.tree import Passing, TreeProblem

Vector = NDArray[np.float64]
Without = Mapping[int, NDArray[np.bool_] | None]


def tree_left_out(
    errors: tuple[Errors, ...],
    problem: TreeProblem,
    sizes: tuple[float, float],
    x: Vector,
    precision: Vector,
    bounds: tuple[Vector, Vector],
    by: str,
    n_nuisance: int,
) -> Vector:
    """Predict each mode of the structure in all states at once, each state or each specimen, from all other data.

    Parameters
    ----------
    errors, problem, x, precision
        Of a fit: of each state, of all, its coordinates, and the precision of their priors.
    bounds : pair of (n_coordinate,)
        Within which coordinates stay.
    sizes : (float, float)
        Of the discrepancies of equation errors and of damping ratios.
    by : "mode", "state" or "specimen"
        What is left out at a time. Nuisances that only a specimen has are fitted to it: no other data determine them.
    n_nuisance : int
        Number of coordinates that are of the base model, the first ones.

    Returns
    -------
    (2, n) float
        Errors of frequencies and of damping ratios, by measured mode; NaN where nothing is predicted.
    """
    passing = Passing(problem, sizes[0])
    first = np.cumsum([0, *(len(e.value) for e in errors)])
    errors_left_out = np.full((2, int(first[-1])), np.nan)
    of_state = [np.flatnonzero(problem.damping_at == c) for c in range(len(errors))]
    seen = [np.flatnonzero(np.isfinite(e.damping)) for e in errors]
    beside = problem.beside(Sizes(stiffness=sizes[0], damping=sizes[1]))
    groups = list(_modes(problem) if by == "mode" else _states(problem, deep=by == "state"))
    for out in groups:
        if all(c in out and out[c] is None for c in range(len(errors))):
            return np.full_like(errors_left_out, np.nan)
        damped = np.ones(problem.damping.size, dtype=bool)
        for c, rows in out.items():
            gone = slice(None) if rows is None else np.isin(seen[c], _gone(problem, c, rows))
            damped[of_state[c][gone]] = False
        weighed = problem.whole(passing.root(out)) + problem.of_damping(sizes[1], damped)
        kept = _kept(problem, out)
        hessian = weighed.hessian + np.diag(precision + 1e-12) + problem.curvature_of(kept)
        slope = weighed.slope + precision * x + beside[kept].sum(axis=0)
        step = bounded_step(slope, hessian, bounds[0] - x, bounds[1] - x)
        if by == "specimen":
            _step_alone(step, passing, problem, sizes[1], precision, x, out, n_nuisance, beside)
        for c, rows in out.items():
            e, leaf = errors[c], problem.leaves[c]
            n, m = e.value.shape
            k = leaf.touched.size
            value = (leaf.columns[:, 0] + leaf.columns[:, 1 : 1 + k] @ step[leaf.touched]).reshape(n, m)
            modes = np.arange(n) if rows is None else _gone(problem, c, rows)
            errors_left_out[0, first[c] + modes] = (0.5 * np.sum(value * e.weight, axis=1))[modes]
            there = np.isin(seen[c], modes)
            which = of_state[c][there]
            predicted = problem.damping[which] + problem.damping_jacobian[which] @ step
            errors_left_out[1, first[c] + seen[c][there]] = predicted
    return errors_left_out


def _step_alone(
    step: Vector,
    passing: Passing,
    problem: TreeProblem,
    size: float,
    precision: Vector,
    x: Vector,
    out: Without,
    n_nuisance: int,
    beside: Vector,
) -> None:
    """Set the steps of nuisances that only the states left out have, from these states, with all other steps given."""
    others = {c: None for c in range(len(problem.leaves)) if c not in out}
    elsewhere = np.unique(np.concatenate([problem.leaves[c].touched for c in others]))
    here = np.unique(np.concatenate([problem.leaves[c].touched for c in out]))
    alone = np.setdiff1d(here[here < n_nuisance], elsewhere)
    damped = np.isin(problem.damping_at, list(out))
    weighed = problem.whole(passing.root(others)) + problem.of_damping(size, damped)
    rest = np.setdiff1d(here, alone)
    kept = _kept(problem, others)
    hessian = weighed.hessian + problem.curvature_of(kept)
    slope = weighed.slope[alone] + precision[alone] * x[alone] + beside[kept].sum(axis=0)[alone]
    slope += hessian[np.ix_(alone, rest)] @ step[rest]
    step[alone] = -scaled_solve(hessian[np.ix_(alone, alone)] + np.diag(precision[alone] + 1e-12), slope)


def _kept(problem: TreeProblem, without: Without) -> NDArray[np.bool_]:
    """Return which measured modes are not left out, (n,)."""
    by_state = []
    for c, leaf in enumerate(problem.leaves):
        kept = np.ones(leaf.mode[-1] + 1, dtype=bool)
        if c in without:
            rows = without[c]
            kept[:] = False
            kept[np.unique(leaf.mode[rows]) if rows is not None else []] = True
        by_state.append(kept)
    return np.concatenate(by_state)


def _gone(problem: TreeProblem, c: int, kept: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Return the measured modes of a state of which no error is kept."""
    return np.setdiff1d(problem.leaves[c].mode, problem.leaves[c].mode[kept]).astype(np.intp)


def _states(problem: TreeProblem, *, deep: bool) -> Iterator[Without]:
    """Yield each state alone, or the states of each specimen."""
    paths = problem.tree.paths
    for node in dict.fromkeys(path if deep else path[:-1] for path in paths):
        yield {c: None for c, path in enumerate(paths) if path[: len(node)] == node}


def _modes(problem: TreeProblem, *, alike: float = 0.7) -> Iterator[Without]:
    """Yield the errors that are kept when one mode of the structure is left out of all states that have it."""
    left = [set(range(len(coordinates))) for coordinates in problem.turned]
    unit = [coordinates / np.linalg.norm(coordinates, axis=1, keepdims=True) for coordinates in problem.turned]
    for c in range(len(unit)):
        while left[c]:
            first = unit[c][min(left[c])]
            out: dict[int, NDArray[np.bool_] | None] = {}
            for d in range(c, len(unit)):
                same = [r for r in left[d] if abs(unit[d][r] @ first) > alike]
                if same:
                    best = max(same, key=lambda r, d=d: abs(unit[d][r] @ first))  # type: ignore[misc]  # bound now
                    left[d].discard(best)
                    out[d] = problem.leaves[d].mode != best
            yield out
