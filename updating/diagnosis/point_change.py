"""Whether a mass or a spring at one of the measured points explains what a model leaves unexplained.

It needs no effect of the catalogue. All points are tried to first order, and the odds count that the best was chosen.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from model import Observation
from updating.diagnosis.answer import Kind, PointChange
from updating.diagnosis.calibration import MOST, POINT_SHOWS
from updating.diagnosis.stack_model import StackModel
from updating.inference.discrepancy import Evidence, Problem, evidence, spectrum, whitened
from updating.inference.explain import Explanation
from updating.inference.protocol import Coordinate
from updating.inference.search import Search
from updating.inference.spread import information

Vector = NDArray[np.float64]

_MOST: dict[Kind, tuple[str, float]] = {"mass": ("kg", 1.0), "spring": ("N/m", 1e7)}
"""Of each kind its unit, and the most that is tried, less or more."""


def point_change(model: StackModel, search: Search, explanation: Explanation) -> PointChange | None:
    """Return the change at one measured point that explains most of what an explanation leaves; None where none does.

    Parameters
    ----------
    model : StackModel
        Measurement and model.
    search : Search
        What fits share.
    explanation : Explanation
        The fit so far; its coordinates take part in each step.
    """
    largest = max(range(len(model.states)), key=lambda c: model.observation[c].node.size)
    point = _points(model.observation[largest])
    local, size = model.about(explanation.coordinates, [explanation.x]), explanation.x.size
    columns: dict[Kind, list[Vector]] = {"mass": [], "spring": []}
    for c, errors in enumerate(explanation.errors):
        modal, row = (local.modal(explanation.x, c), {p: i for i, p in enumerate(_points(model.observation[c]))})
        rows = np.array([modal.rows[row[p]] if p in row else np.zeros(modal.eigenvalue.size) for p in point])
        omega = np.sqrt(np.where(modal.eigenvalue > 0.0, modal.eigenvalue, np.nan))
        scale = np.sqrt(errors.eigenvalue)[:, None] * np.where(
            np.isfinite(omega), omega, np.sqrt(errors.eigenvalue)[:, None]
        )
        force = -np.einsum("ps,pt,rt->rsp", rows, rows, errors.weight) / scale[:, :, None]
        columns["spring"].append(force.reshape(-1, len(point)))
        columns["mass"].append((-errors.eigenvalue[:, None, None] * force).reshape(-1, len(point)))
    best: tuple[float, Kind, int] | None = None
    for kind, (_, most) in _MOST.items():
        problem = _with(explanation.problem, most * np.vstack(columns[kind]))
        extra = [Coordinate(name=f"{kind}_{i}", std=1.0) for i in range(len(point))]
        known = np.arange(size + len(point)) < size
        mean, std = information(
            problem,
            np.append(explanation.x, np.zeros(len(point))),
            [*explanation.coordinates, *extra],
            explanation.evidence.sizes,
            known,
        )
        gain = 0.5 * (mean[size:] / std[size:]) ** 2
        i = int(np.argmax(gain))
        if best is None or gain[i] > best[0]:
            best = float(gain[i]), kind, i
    assert best is not None
    _, kind, i = best
    most = _MOST[kind][1]
    problem = _with(explanation.problem, most * np.vstack(columns[kind])[:, [i]])
    x, after = stepped(
        problem,
        np.append(explanation.x, 0.0),
        (*explanation.coordinates, Coordinate(name=kind, std=1.0)),
        search,
        explanation,
    )
    log_odds = after.log - explanation.log_evidence - float(np.log(2 * len(point)))
    shrinks = after.sizes.stiffness**2 <= (1.0 - MOST) * explanation.evidence.sizes.stiffness**2
    if log_odds < POINT_SHOWS or not shrinks or abs(x[-1]) > 1.0:
        return None
    return PointChange(
        beside=explanation.terms, node=point[i][0], kind=kind, size=float(most * x[-1]), log_odds=log_odds
    )


def _points(observation: Observation) -> list[tuple[int, ...]]:
    """Return node and direction, to a thousandth, of every measured component."""
    return [
        (int(node), *np.round(1e3 * direction).astype(int).tolist())
        for node, direction in zip(observation.node, observation.direction, strict=True)
    ]


def _with(problem: Problem, columns: Vector) -> Problem:
    """Return the errors with further coordinates, (N, n), on which only equation errors depend."""
    n, total = columns.shape[1], problem.jacobian.shape[1] + columns.shape[1]
    curvature = np.zeros((total, total))
    curvature[: total - n, : total - n] = problem.curvature
    return replace(
        problem,
        jacobian=np.hstack([problem.jacobian, columns]),
        damping_jacobian=np.hstack([problem.damping_jacobian, np.zeros((problem.damping.size, n))]),
        curvature=curvature,
    )


def stepped(
    problem: Problem, x: Vector, coordinates: tuple[Coordinate, ...], search: Search, explanation: Explanation
) -> tuple[Vector, Evidence]:
    """Return the coordinates after a linear step, and the evidence there."""
    value, jacobian, _ = whitened(problem, explanation.evidence.sizes)
    precision = np.array([c.std**-2.0 for c in coordinates])
    hessian = jacobian.T @ jacobian + problem.curvature + np.diag(precision + 1e-12)
    slope = jacobian.T @ value + problem.beside(explanation.evidence.sizes).sum(axis=0) + precision * x
    step = -la.solve(hessian, slope, assume_a="pos")
    moved = replace(
        problem,
        value=problem.value + problem.jacobian @ step,
        damping=problem.damping + problem.damping_jacobian @ step,
    )
    there = evidence(
        spectrum(moved.value, moved.jacobian, moved.noise, moved.discrepancy),
        spectrum(moved.damping, moved.damping_jacobian, moved.damping_noise, moved.damping_discrepancy),
        moved,
        x + step,
        precision,
        0.5 * float(np.sum(np.log(precision[precision > 0.0]))),
        search.setting.priors,
    )
    return x + step, there
