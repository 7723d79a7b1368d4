"""Noise that the functions of a run share: how much it enlarges the variances of poles.

The likelihood takes the noise of functions as independent. Noise of the force is common to all sensors of a run, and
grows with the response, so that it is strongest where a pole is read. The variance of a pole follows from what is left
of each run along the mode's own shape, over the lines that the pole is read from: the sandwich of White (Econometrica
48, 1980) with runs and lines as clusters (Liang and Zeger, Biometrika 73, 1986), taken for one pole at a time. Residuals
are smaller than the noise by the leverage of their lines (MacKinnon and White, J. Econometrics 29, 1985, HC2).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.special as special
from numpy.typing import NDArray

from ema.identification.maximum_likelihood import Fit

_REACH = 4.0
"""Half bandwidths around a pole from which its noise is taken."""
_FEWEST = 8  # lines on each side
_BELIEVED = 2.0
"""Standard deviations from which noise is taken to be more than what is independent."""
_CORRELATED = 4.0  # likewise of the correlation from line to line, whose sum is what scatters most
_TWO_SIDED = 0.975


@dataclass(frozen=True, eq=False, kw_only=True)
class RunNoise:
    """What one run leaves along the shape of each mode, in units of independent noise.

    Attributes
    ----------
    strength : (n_mode,) float
        Sum of squared residues over the variances of their functions: what a run tells of a pole.
    ratio : (n_mode,) float
        Variance of what is left along the shape, over the lines that the pole is read from; 1 for independent noise.
    freedom : (n_mode,) float
        Number of independent complex values in it.
    correlation : tuple of (n_lag,) complex
        Sums over lines of what is left times itself some lines on, for each mode, from no lag on.
    """

    strength: NDArray[np.float64]
    ratio: NDArray[np.float64]
    freedom: NDArray[np.float64]
    correlation: tuple[NDArray[np.float64], ...]


def run_noise(frequency: NDArray[np.float64], fit: Fit) -> RunNoise:
    """Measure the noise that the functions of one run share.

    Parameters
    ----------
    frequency : (n_frequency,) float
        Lines, Hz.
    fit : Fit
        Fit of the functions of the run; its noise is that of each function.
    """
    n_mode = fit.pole.size
    strength, ratio, freedom = np.zeros((3, n_mode))
    correlation = []
    for r, pole in enumerate(fit.pole):
        window = _window(frequency, pole)
        weight = fit.weight[:, window] / fit.noise[:, None] ** 2
        size = np.abs(fit.residue[:, r, None]) ** 2 * weight
        along = np.sum(fit.residue[:, r, None].conj() * weight * fit.residual[:, window], axis=0)
        along /= np.sqrt(size.sum(axis=0))
        share, leverage = _read_from(frequency[window], pole)
        power = share * np.abs(along) ** 2 / (1.0 - leverage)
        strength[r] = np.mean(size.sum(axis=0))
        ratio[r] = power.sum()
        freedom[r] = (1.0 - share @ leverage) / np.sum(share**2)
        read = np.sqrt(share) * along
        lags = range(max(1, read.size // 2))
        correlation.append(np.array([np.vdot(read[: read.size - k], read[k:]).real for k in lags]))
    return RunNoise(strength=strength, ratio=ratio, freedom=freedom, correlation=tuple(correlation))


def enlargement(runs: tuple[RunNoise, ...]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return by which factors the noise enlarges the variances of poles.

    What is shared grows with the strength of a mode in a run; by how much is estimated over all runs, so that weak
    modes and runs of few lines have it from the strong ones. Where few values tell it, the factor is larger by the
    square of Student's over the normal quantile, for intervals are taken as normal.

    Parameters
    ----------
    runs : tuple of RunNoise
        One for each run.

    Returns
    -------
    each : (n_run, n_mode) float
        Of the poles of each run alone.
    together : (n_mode,) float
        Of the poles of all runs together.
    """
    strength = np.array([run.strength for run in runs])
    each, together = np.ones(strength.shape), np.ones(strength.shape[1])
    for r in range(strength.shape[1]):
        g = strength[:, r] / strength[:, r].max()
        ratio, freedom = (np.array([getattr(run, name)[r] for run in runs]) for name in ("ratio", "freedom"))
        slope = _slope(g, ratio, freedom)
        effective = float(freedom.sum())
        serial = _serial([run.correlation[r] for run in runs], effective)
        if slope == 0.0 and serial == 1.0:
            continue
        quantile = special.stdtrit(max(2.0 * effective, 1.0), _TWO_SIDED) / special.ndtri(_TWO_SIDED)
        each[:, r] = (1.0 + slope * g) * serial * quantile**2
        together[r] = (1.0 + slope * np.sum(g**2) / np.sum(g)) * serial * quantile**2
    return each, together


def _slope(g: NDArray[np.float64], ratio: NDArray[np.float64], freedom: NDArray[np.float64]) -> float:
    """Rise of the variance ratio with the strength, ``ratio = 1 + slope g``; 0 where chance makes as much.

    Weighted least squares, the weights from the rise itself: the variance of a ratio is its square over the freedom.
    """
    slope = 0.0
    for _ in range(5):
        weight = freedom / (1.0 + slope * g) ** 2
        slope = max(0.0, float(np.sum(weight * g * (ratio - 1.0)) / np.sum(weight * g**2)))
    chance = float(np.sum(freedom * g**2)) ** -0.5
    return slope if slope > _BELIEVED * chance else 0.0


def _serial(correlations: list[NDArray[np.float64]], freedom: float) -> float:
    """Spectral density over variance of what is left, where a correlation from line to line is significant."""
    length = min(c.size for c in correlations)
    total = np.sum([c[:length] for c in correlations], axis=0)
    if length < 2 or total[1] < _CORRELATED / np.sqrt(2.0 * freedom) * total[0]:
        return 1.0
    correlation = total / total[0]
    end = int(np.argmax(correlation <= 0.0)) or length  # beyond its first zero it is noise
    return 1.0 + 2.0 * float(correlation[1:end].sum())


def _window(frequency: NDArray[np.float64], pole: complex) -> slice:
    """Lines around a pole that its noise is taken from."""
    spacing = frequency[1] - frequency[0]
    centre = (pole.imag / (2.0 * np.pi) - frequency[0]) / spacing
    reach = max(_REACH * -pole.real / (2.0 * np.pi * spacing), _FEWEST)
    start = int(np.clip(centre - reach, 0, max(frequency.size - 2 * _FEWEST, 0)))
    return slice(start, int(np.clip(centre + reach + 1, start + 2 * _FEWEST, frequency.size)))


def _read_from(
    frequency: NDArray[np.float64], pole: complex
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Share of each line in what is read of a pole, of sum 1, and its leverage in the fit of residue and pole."""
    line = 1.0 / (2j * np.pi * frequency - pole)
    basis, _ = np.linalg.qr(np.stack([line, line**2], axis=1))
    return np.abs(basis[:, 1]) ** 2, np.minimum(np.sum(np.abs(basis) ** 2, axis=1), 0.95)
