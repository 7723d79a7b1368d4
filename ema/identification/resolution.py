"""How uncertain damping is where few lines resolve a resonance.

Noise from line to line says nothing of it: a record that ends before a resonance has died away, or the window that it
was given, widens the line in the same way at every repetition. Of functions that come from a file neither is known.
Simulated FRFs of one mode, as H1 gives them for a random force under a Hann window or none and for a hammer without a
window, give a half-power bandwidth that is too large, relative to what is found:

| lines in the bandwidth that is found | Hann window | random force, no window | hammer, no window |
| --- | --- | --- | --- |
| 1.0 | (none is as narrow) | 0.50 | 0.00 |
| 1.4 | 0.65 | 0.30 | 0.00 |
| 2.1 | 0.30 | 0.18 | 0.00 |
| 3.4 | 0.12 | 0.11 | 0.00 |
| 4.3 | 0.08 | 0.08 | 0.00 |

The mean square over the three is that of 0.4 to 0.6 lines below two lines, and of 0.3 at three. Frequencies are off by
no more than 0.001 lines. `tests/unit/test_resolution.py` repeats it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ema.quality.peaks import MIN_LINES
from ema.types.modal_model import ModalModel

UNKNOWN_LINES = 0.4
"""Standard deviation of a half-power bandwidth of few lines, in lines."""
_FADES = 1.0  # lines below `MIN_LINES` over which it fades out


def with_unknown_lines(modal_model: ModalModel, frequency: NDArray[np.float64]) -> ModalModel:
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
        frequency_std=np.hypot(
            modal_model.frequency_std, np.sqrt(variance) * np.abs(pole.real) / size / (2.0 * np.pi)
        ),
        damping_std=np.hypot(modal_model.damping_std, np.sqrt(variance) * (pole.imag / size) ** 2 / size),
        covariance=covariance,
    )


def decay_variance(
    pole: NDArray[np.complex128], frequency: NDArray[np.float64], decay_rate: float
) -> NDArray[np.float64]:
    """Return the variance of the real part of poles, (rad/s)**2, of an unknown window, ``(n_mode,)``.

    Parameters
    ----------
    pole : (n_mode,) complex
        rad/s.
    frequency : (n_frequency,) float
        Evenly spaced lines, Hz.
    decay_rate : float
        What a window is known to add to all decay rates, 1/s: where it is, there is nothing unknown.
    """
    if decay_rate > 0.0:
        return np.zeros(pole.size)
    step = float(frequency[1] - frequency[0])
    lines = -pole.real / (np.pi * step)
    unknown = UNKNOWN_LINES * np.clip((MIN_LINES - lines) / _FADES, 0.0, 1.0)
    return np.asarray((np.pi * step * unknown) ** 2)
