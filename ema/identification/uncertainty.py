"""What makes poles less certain than independent noise does: noise that runs share, and few lines.

The likelihood takes the noise of functions as independent. Noise of the force is common to all sensors of a run, and
grows with the response, so that it is strongest where a pole is read. The variance of a pole follows from what is left
of each run along the mode's own shape, over the lines that the pole is read from: the sandwich of White (Econometrica
48, 1980) with runs and lines as clusters (Liang and Zeger, Biometrika 73, 1986), taken for one pole at a time.
Residuals are smaller than the noise by the leverage of their lines (MacKinnon and White, J. Econometrics 29, 1985,
HC2).

Noise from line to line says nothing of the damping where few lines resolve a resonance: a record that ends before a
resonance has died away, or the window that it was given, widens the line in the same way at every repetition. Of
functions that come from a file neither is known. Simulated FRFs of one mode, as H1 gives them for a random force under
a Hann window or none and for a hammer without a window, give a half-power bandwidth that is too large, relative to
what is found:

| lines in the bandwidth that is found | Hann window | random force, no window | hammer, no window |
| --- | --- | --- | --- |
| 1.0 | (none is as narrow) | 0.50 | 0.00 |
| 1.4 | 0.65 | 0.30 | 0.00 |
| 2.1 | 0.30 | 0.18 | 0.00 |
| 3.4 | 0.12 | 0.11 | 0.00 |
| 4.3 | 0.08 | 0.08 | 0.00 |

The mean square over the three is that of 0.4 to 0.6 lines below two lines, and of 0.3 at three. Frequencies are off by
no more than 0.001 lines. `tests/unit/test_uncertainty.py` repeats it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy

from ema.identification.functions import Functions
from ema.identification.maximum_likelihood import Fit
from ema.quality.peaks import MIN_LINES
from ema.types.modal_model import ModalModel
from lamella_shared import Complexes, Reals


@dataclass(frozen=True, eq=False, kw_only=True)
class RunNoise:
    """What one run leaves along the shape of each mode, in units of independent noise.

    Attributes
    ----------
    strength : (n_mode,) float
        Sum of squared residues over the variances of their functions: what a run tells of a pole.
    response : (n_mode,) float
        Variance along the shape of the functions themselves, over the same lines: what noise that grows with the
        response, as that of the force does, is in proportion to.
    ratio : (n_mode,) float
        Variance of what is left along the shape, over the lines that the pole is read from; 1 for independent noise.
    freedom : (n_mode,) float
        Number of independent complex values in it.
    correlation : tuple of (n_lag,) complex
        Sums over lines of what is left times itself some lines on, for each mode, from no lag on.
    """

    strength: Reals
    response: Reals
    ratio: Reals
    freedom: Reals
    correlation: tuple[Reals, ...]


def run_noise(run: Functions, fit: Fit) -> RunNoise:
    """Measure the noise that the functions of one run share.

    Parameters
    ----------
    run : Functions
        The functions of the run.
    fit : Fit
        Fit of the functions of the run; its noise is that of each function.
    """
    n_mode = fit.pole.size
    frequency = run.frequency
    strength, response, ratio, freedom = np.zeros((4, n_mode))
    correlation = []
    for r, pole in enumerate(fit.pole):
        window = _window(frequency, pole)
        weight = fit.weight[:, window] / fit.noise[:, None] ** 2
        size = np.abs(fit.residue[:, r, None]) ** 2 * weight
        shape = fit.residue[:, r, None].conj() * weight / np.sqrt(size.sum(axis=0))
        along = np.sum(shape * fit.residual[:, window], axis=0)
        share, leverage = _read_from(frequency[window], pole)
        power = share * np.abs(along) ** 2 / (1.0 - leverage)
        strength[r] = np.mean(size.sum(axis=0))
        response[r] = np.sum(
            share * np.abs(np.sum(shape * (run.value[:, window] - fit.residual[:, window]), axis=0)) ** 2
        )
        ratio[r] = power.sum()
        freedom[r] = (1.0 - share @ leverage) / np.sum(share**2)
        read = np.sqrt(share) * along
        lags = range(max(1, read.size // 2))
        correlation.append(np.array([np.vdot(read[: read.size - k], read[k:]).real for k in lags]))
    return RunNoise(strength=strength, response=response, ratio=ratio, freedom=freedom, correlation=tuple(correlation))


@dataclass(frozen=True, eq=False, kw_only=True)
class Enlargement:
    """Factors by which noise that is not independent enlarges the variances of poles.

    Attributes
    ----------
    each : (n_run, n_mode) float
        Of the poles of each run alone.
    together : (n_mode,) float
        Of the poles of all runs together.
    freedom : (n_mode,) float
        Degrees of freedom of both; infinite where the noise is independent.
    """

    each: Reals
    together: Reals
    freedom: Reals

    @property
    def student(self) -> Reals:
        """Student's over the normal quantile of 95 %, (n_mode,): what makes normal intervals wide enough."""
        two_sided = 0.975
        return np.asarray(scipy.special.stdtrit(self.freedom, two_sided) / scipy.special.ndtri(two_sided))


def enlargement(runs: tuple[RunNoise, ...]) -> Enlargement:
    """Return by which factors the noise enlarges the variances of poles.

    What is shared grows with the response of a run; by how much is estimated over all runs, so that weak
    modes and runs of few lines have it from the strong ones.

    Parameters
    ----------
    runs : tuple of RunNoise
        One for each run.
    """
    strength = np.array([run.strength for run in runs])
    each, together, freedoms = np.ones(strength.shape), *np.ones((2, strength.shape[1]))
    freedoms[:] = np.inf
    for r in range(strength.shape[1]):
        response, ratio, freedom = (
            np.array([getattr(run, name)[r] for run in runs]) for name in ("response", "ratio", "freedom")
        )
        g = response / response.max()
        slope = _slope(g, ratio, freedom)
        effective = float(freedom.sum())
        serial = _serial([run.correlation[r] for run in runs], effective)
        if slope == 0.0 and serial == 1.0:
            continue
        each[:, r] = (1.0 + slope * g) * serial
        together[r] = np.average(each[:, r], weights=strength[:, r])
        freedoms[r] = max(2.0 * effective, 1.0)
    return Enlargement(each=each, together=together, freedom=freedoms)


def _slope(g: Reals, ratio: Reals, freedom: Reals, *, believed: float = 2.0) -> float:
    """Rise of the variance ratio with the response, ``ratio = 1 + slope g``; 0 where chance makes as much.

    Weighted least squares, the weights from the rise itself: the variance of a ratio is its square over the freedom.

    `believed`: standard deviations from which noise is taken to be more than what is independent.
    """
    slope = 0.0
    for _ in range(5):
        weight = freedom / (1.0 + slope * g) ** 2
        slope = max(0.0, float(np.sum(weight * g * (ratio - 1.0)) / np.sum(weight * g**2)))
    chance = float(np.sum(freedom * g**2)) ** -0.5
    return slope if slope > believed * chance else 0.0


def _serial(correlations: list[Reals], freedom: float, *, correlated: float = 4.0) -> float:
    """Spectral density over variance of what is left, where a correlation from line to line is significant.

    `correlated`: standard deviations, likewise, of the correlation from line to line, whose sum is what scatters most.
    """
    length = min(c.size for c in correlations)
    total = np.sum([c[:length] for c in correlations], axis=0)
    if length < 2 or total[1] < correlated / np.sqrt(2.0 * freedom) * total[0]:
        return 1.0
    correlation = total / total[0]
    end = int(np.argmax(correlation <= 0.0)) or length  # beyond its first zero it is noise
    return 1.0 + 2.0 * float(correlation[1:end].sum())


def _window(frequency: Reals, pole: complex, *, half_bandwidths: float = 4.0, fewest: int = 8) -> slice:
    """Lines around a pole that its noise is taken from.

    `half_bandwidths`, `fewest`: half bandwidths around a pole, and lines on each side at least.
    """
    spacing = frequency[1] - frequency[0]
    centre = (pole.imag / (2.0 * np.pi) - frequency[0]) / spacing
    reach = max(half_bandwidths * -pole.real / (2.0 * np.pi * spacing), fewest)
    start = int(np.clip(centre - reach, 0, max(frequency.size - 2 * fewest, 0)))
    return slice(start, int(np.clip(centre + reach + 1, start + 2 * fewest, frequency.size)))


def _read_from(frequency: Reals, pole: complex) -> tuple[Reals, Reals]:
    """Share of each line in what is read of a pole, of sum 1, and its leverage in the fit of residue and pole."""
    line = 1.0 / (2j * np.pi * frequency - pole)
    basis, _ = np.linalg.qr(np.stack([line, line**2], axis=1))
    return np.abs(basis[:, 1]) ** 2, np.minimum(np.sum(np.abs(basis) ** 2, axis=1), 0.95)


UNKNOWN_LINES = 0.4
"""Standard deviation of a half-power bandwidth of few lines, in lines."""


def with_unknown_lines(modal_model: ModalModel, frequency: Reals) -> ModalModel:
    """Return a model whose damping ratios are known no better than the spacing of its lines allows.

    All runs have these lines, so this comes after runs are averaged: what every one of them leaves unknown in the same
    way, many leave unknown too.

    Parameters
    ----------
    modal_model : ModalModel
        With the standard deviations that noise and runs leave.
    frequency : (n_frequency,) float
        Evenly spaced lines, Hz.
    """
    pole = modal_model.pole
    variance = decay_variance(pole, frequency, modal_model.decay_rate)
    size = np.abs(pole)
    covariance = modal_model.covariance.copy()
    covariance[::2, ::2] += np.diag(variance)
    return replace(
        modal_model,
        frequency_std=np.hypot(modal_model.frequency_std, np.sqrt(variance) * np.abs(pole.real) / size / (2.0 * np.pi)),
        damping_std=np.hypot(modal_model.damping_std, np.sqrt(variance) * (pole.imag / size) ** 2 / size),
        covariance=covariance,
    )


def decay_variance(pole: Complexes, frequency: Reals, decay_rate: float, *, fades: float = 1.0) -> Reals:
    """Return the variance of the real part of poles, (rad/s)**2, of an unknown window, ``(n_mode,)``.

    Parameters
    ----------
    pole : (n_mode,) complex
        rad/s.
    frequency : (n_frequency,) float
        Evenly spaced lines, Hz.
    decay_rate : float
        What a window is known to add to all decay rates, 1/s: where it is, there is nothing unknown.
    fades : float
        Lines below `MIN_LINES` over which it fades out.
    """
    if decay_rate > 0.0:
        return np.zeros(pole.size)
    step = float(frequency[1] - frequency[0])
    lines = -pole.real / (np.pi * step)
    unknown = UNKNOWN_LINES * np.clip((MIN_LINES - lines) / fades, 0.0, 1.0)
    return np.asarray((np.pi * step * unknown) ** 2)
