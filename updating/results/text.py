"""Fitted values in words: as many digits as their uncertainty supports."""

from __future__ import annotations

import numpy as np

from updating.fitting.fit import Estimate


def parameter_text(estimate: Estimate) -> str:
    """Write one fitted parameter with its name, standard deviation and unit."""
    bound = " (at the bound of its range)" if estimate.at_bound else ""
    return f"{estimate.name} = {estimate_text(estimate)} {estimate.unit}{bound}"


def estimate_text(estimate: Estimate) -> str:
    """Write value ± standard deviation with as many digits as the latter supports, such as ``1480 ± 12``."""
    if not 0.0 < estimate.std < np.inf:
        return f"{estimate.value:.4g}"
    exponent = (
        0 if abs(estimate.value) >= 1e-3 else int(np.floor(np.log10(max(abs(estimate.value), estimate.std))))
    )
    digits = min(12, max(0, 1 - int(np.floor(np.log10(estimate.std))) + exponent))
    value, std = (f"{x / 10.0**exponent:.{digits}f}" for x in (estimate.value, estimate.std))
    return f"{value} ± {std}" if exponent == 0 else f"({value} ± {std})e{exponent}"
