"""Measured against modelled modes, pair by pair: the table that a fit is judged by, with what noise allows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ema.types.arrays import readonly
from updating.correlation.pairing import ModeSet, Pairing


class MeasuredModes(ModeSet, Protocol):
    """Modes with the standard deviations that an identification gives them."""

    @property
    def frequency_std(self) -> NDArray[np.float64]:
        """Standard deviations of the natural frequencies (n_mode,), Hz."""

    @property
    def damping_std(self) -> NDArray[np.float64]:
        """Standard deviations of the damping ratios (n_mode,)."""

    @property
    def shape_std(self) -> NDArray[np.float64]:
        """Standard deviations of the shape components (n_dof, n_mode)."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Correlation:
    """Paired modes side by side, one entry a pair.

    An error of a few of its standard deviations is what the measurement's noise makes of a right model.

    Attributes
    ----------
    measured_frequency, model_frequency : (n_pair,) float
        Natural frequencies, Hz.
    frequency_error : (n_pair,) float
        (model - measured) / measured, as a ratio: positive where the model is too stiff or too light.
    frequency_error_std : (n_pair,) float
        Its standard deviation.
    measured_damping, model_damping : (n_pair,) float
        Damping ratios.
    damping_error : (n_pair,) float
        (model - measured) / measured, as a ratio.
    damping_error_std : (n_pair,) float
        Its standard deviation.
    mac : (n_pair,) float
        Modal assurance criterion.
    noise_mac : (n_pair,) float
        MAC that the measurement's noise alone would leave with a right model, on average.
    """

    measured_frequency: NDArray[np.float64]
    model_frequency: NDArray[np.float64]
    frequency_error: NDArray[np.float64]
    frequency_error_std: NDArray[np.float64]
    measured_damping: NDArray[np.float64]
    model_damping: NDArray[np.float64]
    damping_error: NDArray[np.float64]
    damping_error_std: NDArray[np.float64]
    mac: NDArray[np.float64]
    noise_mac: NDArray[np.float64]

    def __post_init__(self) -> None:
        n_pair = np.size(self.mac)
        for name in self.__dataclass_fields__:
            object.__setattr__(self, name, readonly("Correlation", name, getattr(self, name), (n_pair,)))


def correlate(measured: MeasuredModes, model: ModeSet, pairing: Pairing) -> Correlation:
    """Put the paired modes side by side.

    Parameters
    ----------
    measured : MeasuredModes
        Identified modes.
    model : ModeSet
        Modes of the model on the same DOFs.
    pairing : Pairing
        Of the two.
    """
    r, s = pairing.measured, pairing.model
    f_exp, f_num = measured.frequency[r], model.frequency[s]
    xi_exp, xi_num = measured.damping[r], model.damping[s]
    variance = np.sum(measured.shape_std[:, r] ** 2, axis=0)
    return Correlation(
        measured_frequency=f_exp,
        model_frequency=f_num,
        frequency_error=(f_num - f_exp) / f_exp,
        frequency_error_std=measured.frequency_std[r] * f_num / f_exp**2,
        measured_damping=xi_exp,
        model_damping=xi_num,
        damping_error=(xi_num - xi_exp) / xi_exp,
        damping_error_std=measured.damping_std[r] * xi_num / xi_exp**2,
        mac=pairing.paired_mac,
        noise_mac=1.0 - np.minimum(variance / np.sum(np.abs(measured.shape[:, r]) ** 2, axis=0), 1.0),
    )
