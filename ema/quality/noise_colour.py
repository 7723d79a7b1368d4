"""In which quantity the noise of measured functions is the same at all lines.

The likelihood of a fit takes the noise as white. A function that is stored as receptance was often measured by an
accelerometer, so that its noise falls with the square of the frequency, and modes of the upper band would count for
nothing. The noise is measured here, and the fit is made in the quantity where it is the most even, so that the same
data give the same modes as whatever quantity they come.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ema.types.frf import DERIVATIVE, FRF, Quantity

BLOCKS = 16
"""Parts of the band in which the noise is measured."""
LEANING = 0.3
"""By how much accelerance, as which most functions are measured, is preferred to what the slope says."""
_FEWEST = 8  # second differences in each
_LOUD = 10.0


def noise_slope(frequency: NDArray[np.float64], value: NDArray[np.complex128]) -> float:
    """Exponent of the frequency that the noise of functions follows.

    The noise is that of the second differences from line to line, their median in each part of the band, which neither
    a smooth course nor a few sharp resonances enlarge.

    Parameters
    ----------
    frequency : (n_frequency,) float
        Lines above 0 Hz.
    value : (n_function, n_frequency) complex

    Returns
    -------
    float
        Slope of the logarithm of the noise over that of the frequency; 0 where there are too few lines to tell.
    """
    size = (frequency.size - 2) // BLOCKS
    if size < _FEWEST:
        return 0.0
    difference = (np.abs(np.diff(own, 2))[: size * BLOCKS].reshape(BLOCKS, size) for own in value)
    noise = np.array([np.median(own, axis=1) for own in difference])
    middle = frequency[1 : size * BLOCKS + 1].reshape(BLOCKS, size).mean(axis=1)
    if not noise.min() > 0.0:
        return 0.0
    level = np.log(noise).mean(axis=0)
    pairs = np.triu_indices(BLOCKS, 1)
    slopes = (level[pairs[1]] - level[pairs[0]]) / np.log(middle[pairs[1]] / middle[pairs[0]])
    return float(np.median(slopes))  # Theil and Sen: blocks that resonances fill do not count


def whitest(frf: FRF) -> Quantity:
    """Return the quantity in which the noise of functions, on lines above 0 Hz, is the most even.

    Integration raises the lowest lines of a band that begins near 0 Hz; it goes no further than these bear.
    """
    slope = noise_slope(frf.frequency, frf.value.reshape(-1, frf.frequency.size))
    wanted = DERIVATIVE[frf.quantity] - slope + LEANING
    ranked = sorted(DERIVATIVE, key=lambda quantity: abs(DERIVATIVE[quantity] - wanted))
    likely = [q for q in DERIVATIVE if DERIVATIVE[q] >= DERIVATIVE[ranked[0]]]
    return next((q for q in likely if _even_at_the_start(frf.convert(q))), likely[-1])


def _even_at_the_start(frf: FRF) -> bool:
    """Whether the noise of the first lines is no larger than some times that of the others."""
    difference = (np.abs(np.diff(own, 2)) for own in frf.value.reshape(-1, frf.frequency.size))
    first, whole = np.array([(np.median(own[:_FEWEST]), np.median(own)) for own in difference]).T
    return bool(np.median(first) <= _LOUD * np.median(whole))
