"""Points of a measurement that were mixed up: two exchanged, or a sensor that was turned over.

Either changes a few components of all measured shapes by more than any model is off by. Each is tried to the letter,
for one configuration and for all, and the data are put right where that makes them far more likely.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from updating.diagnosis.calibration import MIXED_UP
from updating.diagnosis.evidence import Evidence, unit_shape
from updating.diagnosis.residual import Residual

Vector = NDArray[np.float64]
AnyEvidence = TypeVar("AnyEvidence", bound=Evidence)

MOST = 4
"""Such errors that are put right in one measurement."""


@dataclass(frozen=True, kw_only=True)
class MixedUp:
    """Points that were mixed up.

    Attributes
    ----------
    kind : "exchanged" or "turned"
        Two points were measured in each other's place, or a sensor was turned over.
    configuration : tuple of str
        Where.
    node : tuple of int
        The points.
    log_odds : float
        Logarithm of the odds against data that are as they are stated.
    """

    kind: Literal["exchanged", "turned"]
    configuration: tuple[str, ...]
    node: tuple[int, ...]
    log_odds: float


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
    gain, where, dofs = max(tried, key=lambda own: own[0])
    log_odds = 0.5 * gain - float(np.log(sum(_number(evidence, c) for c in _groups(evidence))))
    if log_odds < MIXED_UP:
        return evidence, None
    node = tuple(int(evidence.observed[where[0]].node[i]) for i in dofs)
    mixed_up = MixedUp(
        kind="turned" if len(dofs) == 1 else "exchanged",
        configuration=tuple(evidence.tested[c].name for c in where),
        node=node,
        log_odds=log_odds,
    )
    tested = tuple(
        replace(own, modes=_undone(own.modes, dofs)) if c in where else own
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
    return n + n * (n - 1) // 2


def _tried(
    evidence: Evidence, found: Residual, where: tuple[int, ...]
) -> list[tuple[float, tuple[int, ...], tuple[int, ...]]]:
    """Return by how much the best exchange and the best turn of a sensor lower the misfit, where, and of which rows."""
    rows = np.array([row for (c, _), row in evidence.rows.shape.items() if c in where])
    shape = np.vstack(
        [unit_shape(evidence.tested[c].modes.shape[:, evidence.used[c]]).T for c in where]
    )  # (n_shape, n_dof)
    if not rows.size:
        return []
    pull, weight = _weighted(evidence, found, rows)
    n = shape.shape[1]
    alone = weight[np.arange(n), np.arange(n)]
    turn = -2.0 * shape.T
    turned = -2.0 * np.sum(turn * pull, axis=1) - np.einsum("ik,ikl,il->i", turn, alone, turn)
    one, other = (np.array(own) for own in zip(*itertools.combinations(range(n), 2), strict=True))
    change = (shape[:, other] - shape[:, one]).T
    square = alone[one] + alone[other] - weight[one, other] - weight[other, one]
    exchanged = -2.0 * np.sum(change * (pull[one] - pull[other]), axis=1)
    exchanged -= np.einsum("pk,pkl,pl->p", change, square, change, optimize=True)
    i, p = int(np.argmax(turned)), int(np.argmax(exchanged))
    return [
        (float(turned[i]), where, (i,)),
        (float(exchanged[p]), where, (int(one[p]), int(other[p]))),
    ]


def _weighted(evidence: Evidence, found: Residual, rows: NDArray[np.intp]) -> tuple[Vector, Vector]:
    """Return the inverse covariance of shape components times their residual, and itself.

    They are (n_dof, n_shape) and (n_dof, n_dof, n_shape, n_shape) for the (n_shape, n_dof) `rows`.
    """
    (block,) = (own for own in evidence.covariance.blocks if evidence.rows.kind[own.row[0]] == "shape")
    place = np.empty(evidence.rows.kind.size, dtype=np.intp)
    place[block.row] = np.arange(block.row.size)
    half = block.rotation / np.sqrt(1.0 + evidence.sizes.shape**2 * block.growth)[:, None]
    value = found.value[block.row]
    columns = half[:, place[rows].ravel()]
    n_shape, n_dof = rows.shape
    pull = (columns.T @ value).reshape(n_shape, n_dof).T
    weight = (columns.T @ columns).reshape(n_shape, n_dof, n_shape, n_dof).transpose(1, 3, 0, 2)
    return pull, weight


def _undone(modes: Any, dofs: tuple[int, ...]) -> Any:
    """Return modes with the error of some components undone."""
    shape, std = modes.shape.copy(), modes.shape_std.copy()
    if len(dofs) == 1:
        shape[dofs[0]] *= -1.0
    else:
        shape, std = _exchanged(shape, dofs), _exchanged(std, dofs)
    return replace(modes, shape=shape, shape_std=std)


def _exchanged(values: NDArray[Any], dofs: tuple[int, ...]) -> NDArray[Any]:
    """Return an array with two rows exchanged."""
    out = values.copy()
    out[list(dofs)] = values[list(dofs[::-1])]
    return out
