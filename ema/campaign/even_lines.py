"""Even frequency lines, of an axis that a file holds in few digits."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_NEARLY_ZERO = 0.05  # of a step; put in place of 0 Hz, to divide by it


def snapped(frequency: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a uniform axis where the stored one differs from it by no more than its printed digits."""
    if frequency.size < 3:
        return frequency
    if 0.0 < frequency[0] < _NEARLY_ZERO * (frequency[1] - frequency[0]):
        frequency = np.concatenate([[0.0], frequency[1:]])
    uniform = np.linspace(frequency[0], frequency[-1], frequency.size)
    tolerance = max(1e-3 * abs(uniform[1] - uniform[0]), 5e-6 * abs(frequency[-1]))
    tolerance = min(tolerance, 0.4 * abs(uniform[1] - uniform[0]))
    return uniform if np.abs(frequency - uniform).max() <= tolerance else frequency
