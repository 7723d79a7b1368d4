"""Where the descents of a joint fit begin."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from model.reduction.sobol import sobol
from updating.fitting.joint_problem import Problem
from updating.fitting.sensitivity import whitened_residual

_SCAN = 15  # values of G_f tried before each descent


def starts(
    problem: Problem, n: int, first: Mapping[str, float], near: Mapping[tuple[str, str], float] | None = None
) -> list[NDArray[np.float64]]:
    """Return n points to descend from; see `joint_fit`.

    The first is `near`, estimates by name and group, with effects that it lacks at their neutral values.
    """
    near = near or {}
    shared = problem.of_effects
    stiffness = [j for j, f in enumerate(problem.free) if f.name == "G_f"]
    inside = 1e-3 * (problem.high - problem.low)
    points = sobol(1 << (n - 2).bit_length() if n > 2 else 0, len(shared))
    found = []
    for k in range(n):
        x = np.array([f.inward(f.nominal) for f in problem.free])
        for m, j in enumerate(shared):
            nominal, neutral = x[j], problem.free[j].inward(problem.free[j].neutral)
            if k == 0 and problem.free[j].name in first:
                x[j] = problem.free[j].inward(first[problem.free[j].name])
            elif k == 1:
                x[j] = neutral + 0.05 * (nominal - neutral)
            elif k > 1:
                x[j] = problem.low[j] + points[k - 2, m] * (problem.high[j] - problem.low[j])
        at = {j: near[f.name, f.group] for j, f in enumerate(problem.free) if (f.name, f.group) in near}
        if k == 0 and near:
            for j in shared:
                x[j] = problem.free[j].inward(problem.free[j].neutral)
            for j, value in at.items():
                x[j] = problem.free[j].inward(value)
        x = np.clip(x, problem.low + inside, problem.high - inside)
        if k > 0 or any(j not in at for j in stiffness):
            x = _scan(problem, x, stiffness)
        found.append(x)
    return found


def _scan(problem: Problem, x: NDArray[np.float64], stiffness: list[int]) -> NDArray[np.float64]:
    """Give each G_f the best value of a grid, the other parameters kept."""
    if not stiffness:
        return x
    grid = [np.linspace(problem.low[j], problem.high[j], _SCAN + 2)[1:-1] for j in stiffness]
    cost = np.zeros((len(stiffness), _SCAN))
    for k in range(_SCAN):
        trial = x.copy()
        trial[stiffness] = [g[k] for g in grid]
        for i, (p, used) in enumerate(zip(problem.prepared, problem.used, strict=True)):
            if np.any(used):
                modes, column = problem.modes(i, trial)
                residual = whitened_residual(
                    p.target, used, modes, column, problem.scatter, with_damping=False
                )[0]
                cost[stiffness.index(problem.column[i]["G_f"]), k] += residual @ residual
    x = x.copy()
    for j, g, c in zip(stiffness, grid, cost, strict=True):
        if np.any(c):  # else no mode of that group counts
            x[j] = g[int(np.argmin(c))]
    return x
