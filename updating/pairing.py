"""One-to-one pairing of measured and model modes by the modal assurance criterion (MAC)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from ema.arrays import readonly
from ema.mac import mac
from updating.errors import PairingError


class ModeSet(Protocol):
    """What pairing needs to know of modes, measured or modelled."""

    @property
    def frequency(self) -> NDArray[np.float64]:
        """Natural frequencies (n_mode,), Hz."""

    @property
    def damping(self) -> NDArray[np.float64]:
        """Damping ratios (n_mode,)."""

    @property
    def shape(self) -> NDArray[np.inexact]:
        """Mode shapes (n_dof, n_mode)."""

    @property
    def node(self) -> NDArray[np.int64]:
        """Point number of each DOF (n_dof,)."""

    @property
    def direction(self) -> NDArray[np.float64]:
        """Direction of each DOF (n_dof, 3)."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Pairing:
    """Which measured mode belongs to which mode of the model.

    Attributes
    ----------
    mac : (n_measured, n_model) float
        MAC of every measured mode with every mode of the model.
    measured, model : (n_pair,) int
        Column numbers of the paired modes, ascending in the measured ones.
    unpaired_measured, unpaired_model : (n,) int
        Column numbers of those left over.
    threshold : float
        Smallest MAC that makes a pair.
    """

    mac: NDArray[np.float64]
    measured: NDArray[np.int64]
    model: NDArray[np.int64]
    unpaired_measured: NDArray[np.int64]
    unpaired_model: NDArray[np.int64]
    threshold: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "mac", readonly("Pairing", "mac", self.mac, (None, None)))
        measured = readonly("Pairing", "measured", self.measured, (None,), np.int64)
        object.__setattr__(self, "measured", measured)
        object.__setattr__(
            self, "model", readonly("Pairing", "model", self.model, (measured.size,), np.int64)
        )
        for name in ("unpaired_measured", "unpaired_model"):
            object.__setattr__(self, name, readonly("Pairing", name, getattr(self, name), (None,), np.int64))

    @property
    def paired_mac(self) -> NDArray[np.float64]:
        """MAC of each pair (n_pair,)."""
        return self.mac[self.measured, self.model]


def pair(measured: ModeSet, model: ModeSet, *, threshold: float = 0.8) -> Pairing:
    """Pair modes one to one so that the sum of the MAC over all pairs is largest.

    Parameters
    ----------
    measured, model : ModeSet
        Modes on the same DOFs in the same order.
    threshold : float
        Pairs below it are dissolved and listed as unpaired.

    Raises
    ------
    PairingError
        The two do not have the same DOFs.
    """
    _require_same_dofs(measured, model)
    value = mac(measured.shape, model.shape)
    row, column = linear_sum_assignment(np.where(value >= threshold, value, 0.0), maximize=True)
    good = value[row, column] >= threshold
    row, column = row[good], column[good]
    return Pairing(
        mac=value,
        measured=row,
        model=column,
        unpaired_measured=np.setdiff1d(np.arange(value.shape[0]), row),
        unpaired_model=np.setdiff1d(np.arange(value.shape[1]), column),
        threshold=threshold,
    )


def _require_same_dofs(measured: ModeSet, model: ModeSet) -> None:
    if measured.node.size != model.node.size or np.any(measured.node != model.node):
        message = (
            f"modes on different DOFs cannot be paired: {measured.node.size} measured, {model.node.size} in the "
            "model. Sample the model at the measured DOFs (updating.register) first."
        )
        raise PairingError(message)
    alignment = np.sum(measured.direction * model.direction, axis=1)
    if np.any(alignment < 1 - 1e-6):
        wrong = [int(n) for n in measured.node[alignment < 1 - 1e-6]]
        message = f"measured and modelled directions differ at points {wrong}"
        raise PairingError(message)
