"""Points that fill a box evenly."""

from __future__ import annotations

import warnings

import numpy as np
from numpy.typing import NDArray


def sobol(n: int, n_axis: int) -> NDArray[np.float64]:
    """Return the first points of a scrambled Sobol sequence in the unit box, (n, n_axis), always the same."""
    if not n or not n_axis:
        return np.empty((n, n_axis))
    from scipy.stats import qmc  # here: it takes long to import, and few commands need it

    with warnings.catch_warnings():  # that a number of points is not a power of 2 does not matter here
        warnings.simplefilter("ignore", UserWarning)
        return np.asarray(qmc.Sobol(n_axis, rng=np.random.default_rng(0)).random(n))
