"""Measured against modelled modes, pair by pair: the table that a fit is judged by."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ema.arrays import readonly
from updating.pairing import ModeSet, Pairing


@dataclass(frozen=True, eq=False, kw_only=True)
class Correlation:
    """Paired modes side by side, one entry a pair.

    Attributes
    ----------
    measured_frequency, model_frequency : (n_pair,) float
        Natural frequencies, Hz.
    frequency_error : (n_pair,) float
        (model - measured) / measured, as a ratio: positive where the model is too stiff or too light.
    measured_damping, model_damping : (n_pair,) float
        Damping ratios.
    mac : (n_pair,) float
        Modal assurance criterion.
    """

    measured_frequency: NDArray[np.float64]
    model_frequency: NDArray[np.float64]
    frequency_error: NDArray[np.float64]
    measured_damping: NDArray[np.float64]
    model_damping: NDArray[np.float64]
    mac: NDArray[np.float64]

    def __post_init__(self) -> None:
        n_pair = np.size(self.mac)
        for name in self.__dataclass_fields__:
            object.__setattr__(self, name, readonly("Correlation", name, getattr(self, name), (n_pair,)))


def correlate(measured: ModeSet, model: ModeSet, pairing: Pairing) -> Correlation:
    """Put the paired modes side by side."""
    f_exp, f_num = measured.frequency[pairing.measured], model.frequency[pairing.model]
    return Correlation(
        measured_frequency=f_exp,
        model_frequency=f_num,
        frequency_error=(f_num - f_exp) / f_exp,
        measured_damping=measured.damping[pairing.measured],
        model_damping=model.damping[pairing.model],
        mac=pairing.paired_mac,
    )
