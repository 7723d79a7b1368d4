"""The same modes of several states of one structure: followed through a campaign by shape, or by shape and frequency.

A change moves frequencies, so that modes may cross, and turns shapes. Where two modes lie close, the smallest change
mixes them: either of them may then look like any mixture of both, and only the plane that they span stays.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
import scipy.linalg as la
from numpy.typing import NDArray

from ema.modal.mac import mac
from ema.types.modal_model import ModalModel
from lamella_shared import arrays

MANY_DOFS = 5
"""Shared DOFs from which shapes alone tell modes apart: random shapes reach a MAC of 0.8 at five of them in 2 %."""


@dataclass(frozen=True, eq=False, kw_only=True)
@arrays({"name mode": "frequency frequency_std damping damping_std mac"})
class Comparison:
    """Every mode of a campaign, one column each, over the configurations, one row each.

    Attributes
    ----------
    name : tuple of str
        The configurations.
    frequency, frequency_std : (n_configuration, n_mode) float
        Natural frequencies and their standard deviations, Hz; NaN where a configuration lacks the mode.
    damping, damping_std : (n_configuration, n_mode) float
        Damping ratios and their standard deviations; NaN likewise.
    mac : (n_configuration, n_mode) float
        MAC with the same mode in the nearest earlier configuration that has it; 1 in the first one, NaN where the
        two share a single DOF, over which MAC is 1 for any two modes.
    """

    name: tuple[str, ...]
    frequency: NDArray[np.float64]
    frequency_std: NDArray[np.float64]
    damping: NDArray[np.float64]
    damping_std: NDArray[np.float64]
    mac: NDArray[np.float64]


def compare(models: Sequence[ModalModel], *, threshold: float = 0.8) -> Comparison:
    """Follow modes from configuration to configuration.

    Each mode goes on as the one of the next configuration with which its shape, at the DOFs that both
    have, makes the largest sum of MAC values; below `threshold` it ends and the other one begins. Where few DOFs
    are shared, different modes look alike there, so that frequencies must agree to 10 % too, and the nearest one wins.

    Parameters
    ----------
    models : sequence of ModalModel
        The configurations in order.
    threshold : float
        Smallest MAC of a shape with itself in the next configuration.

    Returns
    -------
    Comparison
        Its columns are in ascending order of the mean frequency.
    """
    tracks: list[dict[int, tuple[int, float]]] = []  # of each mode: configuration -> (its number there, MAC)
    for c, model in enumerate(models):
        values, score = np.zeros((2, len(tracks), model.frequency.size))
        for t, track in enumerate(tracks):
            before = max(track)
            values[t], score[t] = _likeness_of_mode(models[before], track[before][0], model)
        score = np.where(score >= threshold, score, 0.0)
        rows, columns = scipy.optimize.linear_sum_assignment(score, maximize=True)
        taken = set()
        for t, r in zip(rows, columns, strict=True):
            if score[t, r] >= threshold:
                tracks[t][c] = (int(r), float(values[t, r]))
                taken.add(int(r))
        tracks += [{c: (r, 1.0)} for r in range(model.frequency.size) if r not in taken]

    def table(name: str) -> NDArray[np.float64]:
        matched = np.full((len(models), len(tracks)), np.nan)
        for t, track in enumerate(tracks):
            for c, (r, _) in track.items():
                matched[c, t] = getattr(models[c], name)[r]
        return matched

    order = np.argsort([np.mean([models[c].frequency[r] for c, (r, _) in track.items()]) for track in tracks])
    values = np.full((len(models), len(tracks)), np.nan)
    for t, track in enumerate(tracks):
        for c, (_, value) in track.items():
            values[c, t] = value
    return Comparison(
        name=tuple(model.name for model in models),
        frequency=table("frequency")[:, order],
        frequency_std=table("frequency_std")[:, order],
        damping=table("damping")[:, order],
        damping_std=table("damping_std")[:, order],
        mac=values[:, order],
    )


def _likeness_of_mode(
    first: ModalModel, mode: int, second: ModalModel, *, near_by_shape: float = 0.1
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """MAC ``(n_mode,)`` of one mode with those of another model over the DOFs that both have, and its use as a score.

    The score is 0 without a shared DOF; over few of them it falls with the distance of the frequencies.
    """
    index = {_key(second, k): k for k in range(second.node.size)}
    pairs = [(k, index[_key(first, k)]) for k in range(first.node.size) if _key(first, k) in index]
    if not pairs:
        nothing = np.zeros(second.frequency.size)
        return nothing, nothing
    rows, columns = np.array(pairs).T
    value = mac(first.shape[rows][:, [mode]], second.shape[columns])[0]
    if len(pairs) >= MANY_DOFS:
        return value, value
    apart = np.abs(np.log(second.frequency / first.frequency[mode]))
    score = np.where(apart <= near_by_shape, value * (1.0 - apart), 0.0)
    return (value if len(pairs) > 1 else np.full_like(value, np.nan)), score


def _key(model: ModalModel, k: int) -> tuple[float, ...]:
    return (int(model.node[k]), *np.round(model.direction[k], 6).tolist())


Modes = tuple[NDArray[np.float64], NDArray[np.complex128]]
"""Natural frequencies, Hz, (n_mode,), and shapes, (n_dof, n_mode)."""
CLOSE = 0.03
"""Relative gap of neighbouring frequencies below which modes are taken as a plane: a change of 6 % in stiffness closes
it."""


def shared_dofs(models: Sequence[ModalModel]) -> tuple[NDArray[np.int64], ...]:
    """Return for each model the positions of the DOFs that all of them have, in the order of the first."""
    places = [{_dof(model, k): k for k in range(model.node.size)} for model in models]
    common = [key for key in places[0] if all(key in other for other in places)]
    return tuple(np.array([place[key] for key in common], dtype=np.int64) for place in places)


def match(
    first: Modes, second: Modes, *, alike: float = 0.5, width: float = 0.2, far: float = 0.7, near: float = 0.1
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Match the modes of two states.

    Parameters
    ----------
    first, second : Modes
        Of each state, at the DOFs that both have.
    alike : float
        MAC from which a mode is the same one: it then shares more of its shape with it than with all others together.
    width : float
        Difference of the logarithms of two frequencies that halves a likeness: the larger cuts of measured plates
        move a mode by that much.
    far : float
        Of these logarithms, beyond which no change leaves a mode the same.
    near : float
        The same where few DOFs are shared, over which all shapes are alike.

    Returns
    -------
    tuple of (n_pair,) int
        Numbers, from 0, of the modes that belong together in the first and in the second state.
    """
    apart = np.abs(np.log(second[0][None, :] / first[0][:, None]))
    n_dof = first[1].shape[0]
    if n_dof >= MANY_DOFS:
        likeness, farthest = _likeness(first, second), far
    else:  # shapes cannot tell modes apart: the nearest frequency does, unless its shape is another one
        likeness = mac(first[1], second[1]) if n_dof > 1 else np.ones(apart.shape)
        farthest = near
    possible = (likeness >= alike) & (apart <= farthest)
    score = np.where(possible, likeness * np.exp(-np.log(2.0) * (apart / width) ** 2), 0.0)
    rows, columns = scipy.optimize.linear_sum_assignment(score, maximize=True)
    matched = score[rows, columns] > 0.0
    return rows[matched].astype(np.int64), columns[matched].astype(np.int64)


def clusters(frequency: NDArray[np.float64]) -> tuple[NDArray[np.int64], ...]:
    """Split modes into those that lie closer than `CLOSE` to a neighbour, each group ascending in frequency."""
    order = np.argsort(frequency, kind="stable")
    gap = np.diff(frequency[order]) / frequency[order][1:]
    return tuple(part.astype(np.int64) for part in np.split(order, np.flatnonzero(gap > CLOSE) + 1) if part.size)


def sine(first: NDArray[np.complex128], second: NDArray[np.complex128], n: int) -> float:
    """Return the sine of the largest angle between the spans of two sets of shapes, (n_dof, any).

    `n`: how many shapes of each are to be the same, whatever the spans have beside.
    """
    return float(np.sin(la.subspace_angles(first, second)[-n]))  # they descend


def _likeness(first: Modes, second: Modes) -> NDArray[np.float64]:
    """MAC of every two modes; of close ones at least most of what lies in the plane of their neighbours."""
    value = mac(first[1], second[1])
    planes = np.minimum(_in_planes(first, second[1]), _in_planes(second, first[1]).T)
    return np.maximum(value, 0.9 * planes)


def _in_planes(state: Modes, shape: NDArray[np.complex128]) -> NDArray[np.float64]:
    """Share of other shapes that lies in the plane of each mode with its close neighbours, (n_mode, n_other).

    It is 0 of a mode that has none: its MAC says it all.
    """
    share = np.zeros((state[0].size, shape.shape[1]))
    whole = np.sum(np.abs(shape) ** 2, axis=0)
    for group in clusters(state[0]):
        if group.size == 1:
            continue
        basis = la.orth(state[1][:, group] / np.linalg.norm(state[1][:, group], axis=0))
        share[group] = np.sum(np.abs(basis.conj().T @ shape) ** 2, axis=0) / whole
    return share


def _dof(model: ModalModel, k: int) -> tuple[float, ...]:
    return (int(model.node[k]), *(np.round(model.direction[k], 6) + 0.0).tolist())
