"""Factors by which whole measurements are off, in words."""

from __future__ import annotations

import numpy as np

_KNOWN = {
    9.80665: "g for m/s²",
    4.448222: "N for lbf",
    1000.0: "a prefix, as in mm",
    2.0 * np.pi: "rad/s for Hz",
}
"""Ratios of units that are taken for each other."""
_NEAR = 0.15  # of the logarithm


def factor_text(factor: float) -> str:
    """Return a factor as text, with the units that it is the ratio of, such as ``9.7 times (g for m/s²)``."""
    said = f"{factor:.3g} times"
    for ratio, what in _KNOWN.items():
        if abs(abs(np.log(factor)) - np.log(ratio)) < _NEAR:
            return f"{said} ({what} would do this)"
    return said
