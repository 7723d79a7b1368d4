"""Modes followed through the configurations of a campaign by their shapes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from ema.modal.mac import mac
from ema.types.arrays import readonly
from ema.types.modal_model import ModalModel

MANY_DOFS = 5
"""Shared DOFs from which shapes alone tell modes apart: random shapes reach a MAC of 0.8 at five of them in 2 %."""
_NEAR = 0.1


@dataclass(frozen=True, eq=False, kw_only=True)
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

    def __post_init__(self) -> None:
        shape = (len(self.name), np.shape(self.frequency)[-1])
        for name in ("frequency", "frequency_std", "damping", "damping_std", "mac"):
            object.__setattr__(self, name, readonly("Comparison", name, getattr(self, name), shape))


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
            values[t], score[t] = _likeness(models[before], track[before][0], model)
        score = np.where(score >= threshold, score, 0.0)
        rows, columns = scipy.optimize.linear_sum_assignment(score, maximize=True)
        taken = set()
        for t, r in zip(rows, columns, strict=True):
            if score[t, r] >= threshold:
                tracks[t][c] = (int(r), float(values[t, r]))
                taken.add(int(r))
        tracks += [{c: (r, 1.0)} for r in range(model.frequency.size) if r not in taken]

    def table(name: str) -> NDArray[np.float64]:
        found = np.full((len(models), len(tracks)), np.nan)
        for t, track in enumerate(tracks):
            for c, (r, _) in track.items():
                found[c, t] = getattr(models[c], name)[r]
        return found

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


def _likeness(
    first: ModalModel, mode: int, second: ModalModel
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
    score = np.where(apart <= _NEAR, value * (1.0 - apart), 0.0)
    return (value if len(pairs) > 1 else np.full_like(value, np.nan)), score


def _key(model: ModalModel, k: int) -> tuple[float, ...]:
    return (int(model.node[k]), *np.round(model.direction[k], 6).tolist())
