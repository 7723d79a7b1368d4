"""The same modes of two states of one structure, found by shape and frequency together.

A change moves frequencies, so that modes may cross, and turns shapes. Where two modes lie close, the smallest change
mixes them: either of them may then look like any mixture of both, and only the plane that they span stays.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy
import scipy.linalg as la
from numpy.typing import NDArray

from ema.modal.comparison import MANY_DOFS
from ema.modal.mac import mac
from ema.types.modal_model import ModalModel

Modes = tuple[NDArray[np.float64], NDArray[np.complex128]]
"""Natural frequencies, Hz, (n_mode,), and shapes, (n_dof, n_mode)."""
CLOSE = 0.03
"""Relative gap of neighbouring frequencies below which modes are taken as a plane: a change of 6 % in stiffness closes
it."""
_ALIKE = 0.5
"""MAC from which a mode is the same one: it then shares more of its shape with it than with all others together."""
_WIDTH = 0.2
"""Difference of the logarithms of two frequencies that halves a likeness: the larger cuts of measured plates move a
mode by that much."""
_FAR = 0.7  # of these logarithms, beyond which no change leaves a mode the same
_NEAR = 0.1  # the same where few DOFs are shared, over which all shapes are alike


def shared_dofs(models: Sequence[ModalModel]) -> tuple[NDArray[np.int64], ...]:
    """Return for each model the positions of the DOFs that all of them have, in the order of the first."""
    places = [{_dof(model, k): k for k in range(model.node.size)} for model in models]
    common = [key for key in places[0] if all(key in other for other in places)]
    return tuple(np.array([place[key] for key in common], dtype=np.int64) for place in places)


def match(first: Modes, second: Modes) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Match the modes of two states.

    Parameters
    ----------
    first, second : Modes
        Of each state, at the DOFs that both have.

    Returns
    -------
    tuple of (n_pair,) int
        Numbers, from 0, of the modes that belong together in the first and in the second state.
    """
    apart = np.abs(np.log(second[0][None, :] / first[0][:, None]))
    n_dof = first[1].shape[0]
    if n_dof >= MANY_DOFS:
        likeness, farthest = _likeness(first, second), _FAR
    else:  # shapes cannot tell modes apart: the nearest frequency does, unless its shape is another one
        likeness = mac(first[1], second[1]) if n_dof > 1 else np.ones(apart.shape)
        farthest = _NEAR
    possible = (likeness >= _ALIKE) & (apart <= farthest)
    score = np.where(possible, likeness * np.exp(-np.log(2.0) * (apart / _WIDTH) ** 2), 0.0)
    rows, columns = scipy.optimize.linear_sum_assignment(score, maximize=True)
    found = score[rows, columns] > 0.0
    return rows[found].astype(np.int64), columns[found].astype(np.int64)


def clusters(frequency: NDArray[np.float64]) -> tuple[NDArray[np.int64], ...]:
    """Split modes into those that lie closer than `CLOSE` to a neighbour, each group ascending in frequency."""
    order = np.argsort(frequency, kind="stable")
    gap = np.diff(frequency[order]) / frequency[order][1:]
    return tuple(
        part.astype(np.int64) for part in np.split(order, np.flatnonzero(gap > CLOSE) + 1) if part.size
    )


def sine(first: NDArray[np.complex128], second: NDArray[np.complex128]) -> float:
    """Return the sine of the largest angle between the spans of two sets of as many shapes, (n_dof, n)."""
    return float(np.sin(la.subspace_angles(first, second)[0]))


def _likeness(
    first: Modes,
    second: Modes,
) -> NDArray[np.float64]:
    """MAC of every two modes; of close ones at least most of what lies in the plane of their neighbours."""
    own = mac(first[1], second[1])
    planes = np.minimum(_in_planes(first, second[1]), _in_planes(second, first[1]).T)
    return np.maximum(own, 0.9 * planes)


def _in_planes(state: Modes, shape: NDArray[np.complex128]) -> NDArray[np.float64]:
    """Share of other shapes that lies in the plane of each mode with its close neighbours, (n_mode, n_other).

    It is 0 of a mode that has none: its MAC says it all.
    """
    found = np.zeros((state[0].size, shape.shape[1]))
    whole = np.sum(np.abs(shape) ** 2, axis=0)
    for group in clusters(state[0]):
        if group.size == 1:
            continue
        basis = la.orth(state[1][:, group] / np.linalg.norm(state[1][:, group], axis=0))
        found[group] = np.sum(np.abs(basis.conj().T @ shape) ** 2, axis=0) / whole
    return found


def _dof(model: ModalModel, k: int) -> tuple[float, ...]:
    return (int(model.node[k]), *(np.round(model.direction[k], 6) + 0.0).tolist())
