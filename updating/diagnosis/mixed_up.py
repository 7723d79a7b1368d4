"""Points of a measurement that were mixed up: two exchanged, or one whose sensor was turned over or misread.

Each changes a few components of all measured shapes by more than any model is off by. Each is tried to the letter,
for one configuration and for all, and the data are put right where that makes them far more likely.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from updating.diagnosis.calibration import MIXED_UP
from updating.diagnosis.evidence import Evidence, unit_shape
from updating.diagnosis.residual import Residual

Vector = NDArray[np.float64]
AnyEvidence = TypeVar("AnyEvidence", bound=Evidence)

MOST = 4
"""Such errors that are put right in one measurement."""
_FREE = 8.0
"""Fall of the misfit that a factor must bring beside what is asked of all, for it is fitted: it is known to some per
mille, and was anything from a tenth to ten."""
_LEAST = 0.03  # logarithm of a factor that is an error and no calibration
_WIDEST = np.log(20.0)  # logarithm of the largest factor


@dataclass(frozen=True, kw_only=True)
class MixedUp:
    """Points that were mixed up.

    Attributes
    ----------
    kind : "exchanged", "turned" or "scaled"
        Two points were measured in each other's place, a sensor was turned over, or it read by a factor too much.
    configuration : tuple of str
        Where.
    node : tuple of int
        The points.
    log_odds : float
        Logarithm of the odds against data that are as they are stated.
    factor : float
        What is read over what is there; -1 of a sensor that was turned over, 1 of points that were exchanged.
    """

    kind: Literal["exchanged", "turned", "scaled"]
    configuration: tuple[str, ...]
    node: tuple[int, ...]
    log_odds: float
    factor: float


def put_right(evidence: AnyEvidence, found: Residual) -> tuple[AnyEvidence, MixedUp | None]:
    """Return evidence with the points put right that most likely were mixed up, and which; as it was where none were.

    Parameters
    ----------
    evidence : Evidence
        Measurement and model, weighed by the discrepancy that the model leaves.
    found : Residual
        Of the base model's fit.
    """
    tried = [own for c in _groups(evidence) for own in _tried(evidence, found, c)]
    if not tried:
        return evidence, None
    gain, where, dofs, factor = max(tried, key=lambda own: own[0])
    log_odds = 0.5 * gain - float(np.log(sum(_number(evidence, c) for c in _groups(evidence))))
    if log_odds < MIXED_UP:
        return evidence, None
    node = tuple(int(evidence.observed[where[0]].node[i]) for i in dofs)
    mixed_up = MixedUp(
        kind="exchanged" if len(dofs) == 2 else "turned" if factor < 0.0 else "scaled",
        configuration=tuple(evidence.tested[c].name for c in where),
        node=node,
        log_odds=log_odds,
        factor=1.0 / factor,
    )
    tested = tuple(
        replace(own, modes=_undone(own.modes, dofs, factor)) if c in where else own
        for c, own in enumerate(evidence.tested)
    )
    sensor = tuple(
        _exchanged(own, dofs) if c in where and len(dofs) == 2 else own
        for c, own in enumerate(evidence.sensor)
    )
    return replace(evidence, tested=tested, sensor=sensor), mixed_up


def _groups(evidence: Evidence) -> list[tuple[int, ...]]:
    """Return configurations in which points may have been mixed up: each alone, and all where points are the same."""
    every = tuple(range(len(evidence.tested)))
    same = all(np.array_equal(own.node, evidence.observed[0].node) for own in evidence.observed)
    return [(c,) for c in every] + ([every] if same and len(every) > 1 else [])


def _number(evidence: Evidence, where: Sequence[int]) -> int:
    """Return how many errors are tried of a group of configurations."""
    n = evidence.observed[where[0]].node.size
    return 2 * n + n * (n - 1) // 2


def _tried(
    evidence: Evidence, found: Residual, where: tuple[int, ...]
) -> list[tuple[float, tuple[int, ...], tuple[int, ...], float]]:
    """Return by how much the best exchange, turn and factor of a sensor lower the misfit, where, of which rows.

    Last comes what the row of a single sensor is to be multiplied by.
    """
    rows = np.array([row for (c, _), row in evidence.rows.shape.items() if c in where])
    shape = np.vstack(
        [unit_shape(evidence.tested[c].modes.shape[:, evidence.used[c]]).T for c in where]
    )  # (n_shape, n_dof)
    if not rows.size:
        return []
    columns, value = _whitened(evidence, found, rows)
    pull, weight = _weighted(columns, value, rows.shape)
    n = shape.shape[1]
    alone = weight[np.arange(n), np.arange(n)]
    turn = -2.0 * shape.T
    turned = -2.0 * np.sum(turn * pull, axis=1) - np.einsum("ik,ikl,il->i", turn, alone, turn)
    one, other = (np.array(own) for own in zip(*itertools.combinations(range(n), 2), strict=True))
    change = (shape[:, other] - shape[:, one]).T
    square = alone[one] + alone[other] - weight[one, other] - weight[other, one]
    exchanged = -2.0 * np.sum(change * (pull[one] - pull[other]), axis=1)
    exchanged -= np.einsum("pk,pkl,pl->p", change, square, change, optimize=True)
    size = np.maximum(np.einsum("ik,ikl,il->i", shape.T, alone, shape.T), np.finfo(float).tiny)
    along = np.sum(shape.T * pull, axis=1)
    i, p, k = int(np.argmax(turned)), int(np.argmax(exchanged)), int(np.argmax(along**2 / size))
    scaled, factor = _scaled(columns, value, shape, k)
    return [
        (float(turned[i]), where, (i,), -1.0),
        (float(exchanged[p]), where, (int(one[p]), int(other[p])), 1.0),
        (scaled, where, (k,), factor),
    ]


def _whitened(evidence: Evidence, found: Residual, rows: NDArray[np.intp]) -> tuple[Vector, Vector]:
    """Return what shape components, in the order of their (n_shape, n_dof) `rows`, add to the residual, and that."""
    (block,) = (own for own in evidence.covariance.blocks if evidence.rows.kind[own.row[0]] == "shape")
    place = np.empty(evidence.rows.kind.size, dtype=np.intp)
    place[block.row] = np.arange(block.row.size)
    half = block.rotation / np.sqrt(1.0 + evidence.sizes.shape**2 * block.growth)[:, None]
    return half[:, place[rows].ravel()], found.value[block.row]


def _weighted(columns: Vector, value: Vector, size: tuple[int, ...]) -> tuple[Vector, Vector]:
    """Return the inverse covariance of shape components times their residual, and itself.

    They are (n_dof, n_shape) and (n_dof, n_dof, n_shape, n_shape) for (n_shape, n_dof) components.
    """
    n_shape, n_dof = size
    pull = (columns.T @ value).reshape(n_shape, n_dof).T
    weight = (columns.T @ columns).reshape(n_shape, n_dof, n_shape, n_dof).transpose(1, 3, 0, 2)
    return pull, weight


def _scaled(columns: Vector, value: Vector, shape: Vector, k: int) -> tuple[float, float]:
    """Return how the misfit falls by the best factor on a component of all shapes (n_shape, n_dof), and the factor.

    Shapes stay at unit length, so that the other components shrink as one grows.
    """

    def misfit(logarithm: float) -> float:
        changed = shape.copy()
        changed[:, k] *= np.exp(logarithm)
        changed /= np.linalg.norm(changed, axis=1, keepdims=True)
        return float(np.sum((value + columns @ (changed - shape).ravel()) ** 2))

    best = minimize_scalar(misfit, bounds=(-_WIDEST, _WIDEST), method="bounded")
    fall = float(value @ value) - float(best.fun) - _FREE
    return (fall if abs(best.x) > _LEAST else -np.inf), float(np.exp(best.x))


def _undone(modes: Any, dofs: tuple[int, ...], factor: float) -> Any:
    """Return modes with the error of some components undone."""
    shape, std = modes.shape.copy(), modes.shape_std.copy()
    if len(dofs) == 1:
        shape[dofs[0]] *= factor
        std[dofs[0]] *= abs(factor)
    else:
        shape, std = _exchanged(shape, dofs), _exchanged(std, dofs)
    return replace(modes, shape=shape, shape_std=std)


def _exchanged(values: NDArray[Any], dofs: tuple[int, ...]) -> NDArray[Any]:
    """Return an array with two rows exchanged."""
    out = values.copy()
    out[list(dofs)] = values[list(dofs[::-1])]
    return out
