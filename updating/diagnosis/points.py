"""What may be wrong at single measured points: two mixed up, a sensor turned or misread, an added mass or spring.

Points that were mixed up move all measured shapes out of the space of the model's modes by more than the error of any
model. Each is tried, for one configuration and for all, and the data are corrected where that makes them far more
likely. A mass or a spring needs no effect of the catalogue: all points are tried to first order, and the odds count
that the best was chosen.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from model import Observation
from updating.diagnosis.answer import MIXED_UP, POINT_EXPLAINS, POINT_SHOWS, Kind, MixedUp, PointChange
from updating.diagnosis.evidence import Tested
from updating.diagnosis.stack_model import StackModel
from updating.inference.discrepancy import Evidence, Problem, SizePrior, evidence, spectrum, whitened
from updating.inference.explain import Explanation, Setting, explain
from updating.inference.protocol import Coordinate, LocalModel, Model
from updating.inference.search import Search, begin, search
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
    shrinks = after.sizes.stiffness**2 <= (1.0 - POINT_EXPLAINS) * explanation.evidence.sizes.stiffness**2
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


MOST_MIXED_UP = 4
"""Most such errors that are corrected in one measurement."""


M = TypeVar("M", bound=Model)


def search_corrected(
    make: Callable[[Sequence[Tested]], tuple[M, Sequence[Vector]]],
    tested: Sequence[Tested],
    node: Sequence[NDArray[np.int64]],
    *,
    shares: Sequence[float],
    priors: tuple[SizePrior, SizePrior],
    asked: Sequence[Sequence[str]] = (),
) -> tuple[M, Search, tuple[MixedUp, ...]]:
    """Correct the points that were mixed up, and search for what is missing.

    Parameters
    ----------
    make : callable
        Returns the model of configurations, and the coordinates from which fits of the base model start.
    tested, node
        As `put_right` takes them.
    shares, priors
        As `begin` takes them.
    asked
        As `search` takes it.

    Returns
    -------
    model, search, mixed_up
        The model of the corrected configurations, all that was fitted, and the corrections.
    """
    corrections: list[MixedUp] = []

    def begun(tested: Sequence[Tested]) -> tuple[M, Sequence[Vector], Setting, Explanation]:
        model, starts = make(tested)
        return model, starts, *begin(model, shares=shares, starts=starts, priors=priors)

    model, starts, common, base = begun(tested)
    while len(corrections) < MOST_MIXED_UP:
        local = model.about(base.coordinates, [base.x])
        right, mixed_up = correct(model, local, base.x, common.noise, tested, node)
        if mixed_up is None:
            break
        again = begun(right)
        refitted = explain(again[0], [], common, again[3].x)
        if refitted.log_evidence - base.log_evidence < MIXED_UP:  # the fit does not confirm the first order
            break
        tested, (model, starts, common, base) = right, again
        corrections.append(mixed_up)
    return model, search(model, common, base, starts=starts, asked=asked), tuple(corrections)


def correct(
    model: Model,
    local: LocalModel,
    x: Vector,
    noise: Sequence[Vector],
    tested: Sequence[Tested],
    node: Sequence[NDArray[np.int64]],
) -> tuple[tuple[Tested, ...], MixedUp | None]:
    """Return configurations with the points corrected that most likely were mixed up, and these points.

    The configurations stay as they are where no points were mixed up.

    Parameters
    ----------
    model, local, x
        The model, and the same near the coordinates of a fit of the base model.
    noise : sequence of (n,) float
        Standard deviation of a component of each measured shape, by configuration.
    tested : sequence of Tested
        The configurations.
    node : sequence of (n_dof,) int
        The point of each component.
    """
    weighed = [_Weighed.of(model, local, x, noise_of_state, c) for c, noise_of_state in enumerate(noise)]
    all_states = tuple(range(len(tested)))
    same = all(np.array_equal(points, node[0]) for points in node)
    groups = [(c,) for c in all_states] + ([all_states] if same and len(all_states) > 1 else [])
    tried = [trial for where in groups for trial in _tried(weighed, where)]
    number = sum(2 * node[where[0]].size + node[where[0]].size * (node[where[0]].size - 1) // 2 for where in groups)
    gain, where, dofs, factor = max(tried, key=lambda trial: trial[0])
    log_odds = 0.5 * gain - float(np.log(number))
    if log_odds < MIXED_UP:
        return tuple(tested), None
    right = tuple(
        replace(configuration, modes=_undone(configuration.modes, dofs, factor)) if c in where else configuration
        for c, configuration in enumerate(tested)
    )
    return right, MixedUp(
        kind="exchanged" if len(dofs) == 2 else "turned" if factor < 0.0 else "scaled",
        configuration=tuple(tested[c].name for c in where),
        node=tuple(int(node[where[0]][i]) for i in dofs),
        log_odds=log_odds,
        factor=1.0 / factor,
    )


@dataclass(frozen=True, eq=False)
class _Weighed:
    """Shapes of a configuration, (n_dof, n), and the matrices (n, n_dof, n_dof) of which their misfits are forms."""

    shape: Vector
    weight: Vector

    @classmethod
    def of(cls, model: Model, local: LocalModel, x: Vector, noise: Vector, state: int) -> _Weighed:
        shape, modal = model.states[state].shape, local.modal(x, state)
        rows = np.hstack([modal.rows, modal.beyond_rows[:, : modal.eigenvalue.size // 2]])
        q = np.linalg.svd(rows, full_matrices=False)
        reached = q[0][:, q[1] > 1e-2 * q[1][0]]  # what modes reach, at amplitudes that they have
        outside = np.eye(len(shape)) - reached @ reached.T
        return cls(shape, outside[None] / noise[:, None, None] ** 2)


def _tried(
    weighed: Sequence[_Weighed], where: tuple[int, ...]
) -> list[tuple[float, tuple[int, ...], tuple[int, ...], float]]:
    """Return by how much the best exchange, turn and factor of a sensor lower the misfit, where, of which rows.

    Last comes what the row of a single sensor is to be multiplied by.
    """
    widest = 20.0  # largest factor
    least = 0.03  # logarithm of a factor that is an error and no calibration
    # Fall of the misfit that a factor must reach beyond that of the other errors, because it is fitted: it is known to
    # some per mille, and could be anything from a tenth to ten.
    free = 8.0
    shape = np.hstack([weighed[c].shape for c in where])  # (n_dof, n_shape)
    weight = np.concatenate([weighed[c].weight for c in where])
    n = len(shape)
    pull = np.einsum("rij,jr->ir", weight, shape)
    alone = np.einsum("rii->ir", weight)
    along, size = np.sum(shape * pull, axis=1), np.sum(shape**2 * alone, axis=1)
    turned = 4.0 * (along - size)
    # A sensor that reads nothing keeps its factor.
    over = np.divide(along, size, out=np.zeros_like(size), where=size > 0.0)
    best = np.clip(1.0 - over, 1.0 / widest, widest)
    scaled = -((best - 1.0) * 2.0 * along + (best - 1.0) ** 2 * size) - free
    scaled = np.where(np.abs(np.log(best)) > least, scaled, -np.inf)
    first, second = (np.array(indices) for indices in zip(*itertools.combinations(range(n), 2), strict=True))
    change = shape[second] - shape[first]
    between = weight[:, first, second].T
    exchanged = -2.0 * np.sum(change * (pull[first] - pull[second]), axis=1)
    exchanged -= np.sum(change**2 * (alone[first] + alone[second] - 2.0 * between), axis=1)
    i, p, k = int(np.argmax(turned)), int(np.argmax(exchanged)), int(np.argmax(scaled))
    return [
        (float(turned[i]), where, (i,), -1.0),
        (float(exchanged[p]), where, (int(first[p]), int(second[p])), 1.0),
        (float(scaled[k]), where, (k,), float(best[k])),
    ]


def _undone(modes: Any, dofs: tuple[int, ...], factor: float) -> Any:
    """Return modes with the error of some components undone."""
    shape, std = modes.shape.copy(), modes.shape_std.copy()
    if len(dofs) == 1:
        shape[dofs[0]] *= factor
        std[dofs[0]] *= abs(factor)
    else:
        shape, std = _exchanged(shape, dofs), _exchanged(std, dofs)
        return replace(modes, shape=shape, shape_std=std, sensor=_exchanged(modes.sensor, dofs))
    return replace(modes, shape=shape, shape_std=std)


def _exchanged(values: NDArray[Any], dofs: tuple[int, ...]) -> NDArray[Any]:
    """Return an array with two rows exchanged."""
    out = values.copy()
    out[list(dofs)] = values[list(dofs[::-1])]
    return out
