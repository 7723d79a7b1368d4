"""Tracking of modes while a parameter moves, through crossings where their order changes.

Consecutive steps are compared by mass cross-orthogonality in the coordinates of the reduced system (Eldred,
Venkayya and Anderson, AIAA J. 33, 1995); modes of one step are orthogonal there, so they cannot look alike. Where
frequencies nearly meet, the solver returns any mixture of the modes that meet, so a cluster is first turned
onto the modes that were followed so far.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import linear_sum_assignment

from ema.types.arrays import readonly
from model import Modes
from updating.correlation.orthogonality import cross_orthogonality
from updating.correlation.subspace import CLOSE, clusters, rotate_onto
from updating.errors import PairingError


@dataclass(frozen=True, eq=False, kw_only=True)
class Track:
    """Modes followed over the steps of a parameter.

    Attributes
    ----------
    column : (n_step, n_mode) int
        Which mode of each step is the continuation of mode `i` of the first.
    frequency : (n_step, n_mode) float
        Natural frequencies along each track, Hz.
    cross_orthogonality : (n_step, n_mode) float
        With the step before, within a cluster of close modes after turning it; 1 for the first step. A small
        value says that the step was too long or that the mode left the modes that were solved for.
    """

    column: NDArray[np.int64]
    frequency: NDArray[np.float64]
    cross_orthogonality: NDArray[np.float64]

    def __post_init__(self) -> None:
        shape = np.shape(self.column)
        object.__setattr__(self, "column", readonly("Track", "column", self.column, (None, None), np.int64))
        for name in ("frequency", "cross_orthogonality"):
            object.__setattr__(self, name, readonly("Track", name, getattr(self, name), shape))


def track(steps: Sequence[Modes], mass: ArrayLike, *, n_mode: int, close: float = CLOSE) -> Track:
    """Follow the lowest modes of the first step through all others.

    Parameters
    ----------
    steps : sequence of Modes
        Elastic modes of one reduced system at consecutive values of a parameter, a few more of them than shall be
        followed, since others may cross from above.
    mass : (n, n) array_like
        Reduced mass matrix, ``system.matrix("M", theta)``.
    n_mode : int
        Number of modes to follow.
    close : float
        Relative gap below which neighbouring modes may be mixtures of each other.

    Raises
    ------
    PairingError
        A step has fewer modes than are to be followed.
    """
    for i, step in enumerate(steps):
        if step.frequency.size < n_mode:
            message = (
                f"step {i} has {step.frequency.size} modes, but {n_mode} are to be followed; solve for more"
            )
            raise PairingError(message)
    matrix = np.asarray(mass, dtype=float)
    followed = np.array(steps[0].coordinate[:, :n_mode])
    columns, values = [np.arange(n_mode)], [np.ones(n_mode)]
    for step in steps[1:]:
        turned = _turned(step, followed, matrix, close)
        likeness = cross_orthogonality(followed, turned, matrix)
        column = linear_sum_assignment(likeness**2, maximize=True)[1]
        columns.append(column)
        values.append(likeness[np.arange(n_mode), column])
        followed = turned[:, column]
    column = np.array(columns)
    frequency = np.array([step.frequency[c] for step, c in zip(steps, column, strict=True)])
    return Track(column=column, frequency=frequency, cross_orthogonality=np.array(values))


def _turned(
    step: Modes, followed: NDArray[np.float64], mass: NDArray[np.float64], close: float
) -> NDArray[np.float64]:
    """Return the modes of a step, each cluster turned onto the followed modes that lie most in its span."""
    turned = np.array(step.coordinate)
    for group in clusters(step.frequency, close):
        if group.size == 1:
            continue
        inside = cross_orthogonality(followed, turned[:, group], mass)
        nearest = np.argsort(-np.sum(inside**2, axis=1))[: group.size]
        if nearest.size == group.size:
            root = np.linalg.cholesky(mass).T
            rotation = rotate_onto(root @ turned[:, group], root @ followed[:, nearest])
            order = linear_sum_assignment(np.abs((root @ turned[:, group]).T @ rotation), maximize=True)[1]
            turned[:, group] = np.linalg.solve(root, rotation[:, order])
    return turned
