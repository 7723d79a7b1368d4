"""The functions of a configuration as rows, on the lines of the band that is identified."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ema.identification.line_weights import misfit_weight
from ema.identification.maximum_likelihood import Fit, linear_fit
from ema.identification.stabilization import MAX_DAMPING
from ema.types.frf import Quantity

_WEIGHINGS = 3


@dataclass(frozen=True, eq=False, kw_only=True)
class Functions:
    """Functions to fit as rows.

    Attributes
    ----------
    frequency : (n_frequency,) float
        Lines of the band above 0 Hz.
    value : (n_function, n_frequency) complex
    run : (n_function,) int
        Roving run of each function.
    quantity : {"receptance", "mobility", "accelerance"}
    weight : (n_function, n_frequency) float
        Inverse variances that the coherences lead to (`ema.identification.line_weights`); ones where there are none.
    """

    frequency: NDArray[np.float64]
    value: NDArray[np.complex128]
    run: NDArray[np.int64]
    quantity: Quantity
    weight: NDArray[np.float64]

    def linear_fit(self, pole: NDArray[np.complex128], weight: NDArray[np.float64] | None = None) -> Fit:
        """Fit residues and residual terms at fixed poles; all lines weigh the same where no weights are given."""
        return linear_fit(self.frequency, self.value, pole, self.quantity, weight)

    def weigh_by_misfit(self, fit: Fit) -> Fit:
        """Fit residues at the poles of a fit with lines that weigh by the misfit, which they change in turn."""
        for _ in range(_WEIGHINGS):
            fit = self.linear_fit(fit.pole, misfit_weight(self.value - fit.residual, fit.residual))
        return fit

    def of_run(self, number: int) -> Functions:
        """Return the functions of one run."""
        own = self.run == number
        if own.all():
            return self
        return replace(self, value=self.value[own], run=self.run[own], weight=self.weight[own])


def inside(pole: NDArray[np.complex128], band: tuple[float, float]) -> NDArray[np.bool_]:
    """Tell which poles the band (Hz) holds with at least one half bandwidth on each side."""
    hertz, half_bandwidth = np.abs(pole) / (2.0 * np.pi), -pole.real / (2.0 * np.pi)
    return (hertz - half_bandwidth >= band[0]) & (hertz + half_bandwidth <= band[1])


def resonant(pole: NDArray[np.complex128], band: tuple[float, float]) -> NDArray[np.bool_]:
    """Tell which poles are results: inside the band (Hz), and damped no more than a resonance can be.

    A pole that refinement damps further stands for the background of the modes, as those beyond the band do.
    """
    return inside(pole, band) & (-pole.real <= MAX_DAMPING * np.abs(pole))
