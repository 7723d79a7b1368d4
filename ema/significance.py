"""Which of the fitted poles are modes of the structure.

A mode must stand out of the noise of the measurement. That is necessary and, with measured data, not
sufficient: a small misfit of a strong mode is as significant as a weak mode. So a pole that does not dominate
the response at its own frequency must in addition look like a mode, that is have residues on one phase line.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.stats
from numpy.typing import NDArray

from ema.frf import DERIVATIVE, Quantity
from ema.refinement import Fit

FALSE_ALARM = 1e-4
"""Chance that noise alone brings forth a significant pole anywhere in the band."""
DOMINANT = 3.0
"""Peak over the rest of the response at resonance from which on a pole is a mode whatever its phases."""
MIN_COLLINEARITY = 0.9
"""Least phase collinearity of the residues of a pole that does not dominate."""
MIN_REALNESS = 0.5
"""Least share of a non-dominant pole's modal constants along the real axis, where real modes have them."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Verdicts:
    """Measures of every pole of a fit and what follows from them.

    Attributes
    ----------
    statistic : (n_mode,) float
        Wald statistic of all residues of the pole being zero; chi-squared of twice the number of functions
        for noise.
    threshold : float
        Least statistic of a significant pole.
    dominance : (n_mode,) float
        Root mean square over the functions of the pole's peak over that of everything else at its frequency.
    collinearity, realness : (n_mode,) float
        Phase collinearity of the modal constants and their share along the real axis, corrected for noise.
    """

    statistic: NDArray[np.float64]
    threshold: float
    dominance: NDArray[np.float64]
    collinearity: NDArray[np.float64]
    realness: NDArray[np.float64]

    @property
    def accepted(self) -> NDArray[np.bool_]:
        """Which poles are modes, ``(n_mode,)``."""
        modal = (self.collinearity >= MIN_COLLINEARITY) & (self.realness >= MIN_REALNESS)
        return (self.statistic > self.threshold) & ((self.dominance >= DOMINANT) | modal)

    @property
    def score(self) -> NDArray[np.float64]:
        """How much each pole looks like a mode, for taking the least likely one away first."""
        return (
            np.minimum(self.dominance, 1.0)
            * self.collinearity
            * np.minimum(1.0, self.statistic / self.threshold)
        )


def significance_threshold(n_function: int, n_frequency: int) -> float:
    """Statistic that noise exceeds anywhere in the band with probability `FALSE_ALARM`.

    The pole itself is searched for: it adds two unknowns, and about as many independent places as lines.
    """
    return float(scipy.stats.chi2.isf(FALSE_ALARM / n_frequency, 2 * n_function + 2))


def judge(fit: Fit, n_frequency: int, quantity: Quantity) -> Verdicts:
    """Measure every pole of a fit.

    Parameters
    ----------
    fit : Fit
    n_frequency : int
        Lines that were fitted.
    quantity : {"receptance", "mobility", "accelerance"}
        What was fitted.
    """
    covariance = fit.residue_covariance()
    n_function, n_mode = fit.residue.shape
    statistic, collinearity, realness, dominance = np.zeros((4, n_mode))
    exponent = DERIVATIVE[quantity]
    for r, pole in enumerate(fit.pole):
        block = covariance[:, 2 * r : 2 * r + 2, 2 * r : 2 * r + 2]
        parts = np.stack([fit.residue[:, r].real, fit.residue[:, r].imag], axis=1)
        statistic[r] = np.einsum("oi,oij,oj->", parts, np.linalg.pinv(block, hermitian=True), parts)

        constant = 2j * pole.imag * fit.residue[:, r]
        # Covariance of the constant's real and imaginary parts; multiplication by i swaps them.
        spread = (2.0 * pole.imag) ** 2 * np.array(
            [[block[:, 1, 1].sum(), -block[:, 0, 1].sum()], [-block[:, 0, 1].sum(), block[:, 0, 0].sum()]]
        )
        moment = np.array(
            [
                [np.sum(constant.real**2), np.sum(constant.real * constant.imag)],
                [np.sum(constant.real * constant.imag), np.sum(constant.imag**2)],
            ]
        )
        signal = moment - spread
        total = max(np.trace(signal), 0.0)
        if total > 0.0:
            distance = np.hypot(signal[0, 0] - signal[1, 1], 2.0 * signal[0, 1])
            collinearity[r] = min(1.0, (distance / total) ** 2)
            realness[r] = min(1.0, max(0.0, signal[0, 0] / total))

        s = 1j * pole.imag
        own = s**exponent * fit.residue[:, r] / (s - pole)
        everything = s**exponent * (
            fit.residue @ (1.0 / (s - fit.pole))
            + fit.residue.conj() @ (1.0 / (s - fit.pole.conj()))
            + fit.lower / s**2
            + fit.upper
        )
        rest = np.sum(np.abs(everything - own) ** 2)
        dominance[r] = np.sqrt(np.sum(np.abs(own) ** 2) / max(rest, np.finfo(float).tiny))
    return Verdicts(
        statistic=statistic,
        threshold=significance_threshold(n_function, n_frequency),
        dominance=dominance,
        collinearity=collinearity,
        realness=realness,
    )
