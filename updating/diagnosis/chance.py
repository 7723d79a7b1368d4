"""How often the best effect of a catalogue explains as much by chance."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.linalg as la

from updating.diagnosis.coordinates import bounds_of
from updating.diagnosis.screening import Screened

DRAWS = 10_000
_SEED = 0


def chance_of_gain(screened: Sequence[Screened], gain: float) -> float:
    """Return the probability that the best of all effects lowers the misfit as much where nothing is missing.

    A parametric bootstrap to first order: data are drawn about the base model, nuisances are taken out by projection,
    and every effect of the catalogue may explain what is left, on the side of neutral where it can be. So it counts
    that the best of many was chosen.

    Parameters
    ----------
    screened : sequence of Screened
        The catalogue beside the base model.
    gain : float
        Fall of the squared misfit.

    Returns
    -------
    float
        At least 1 / (`DRAWS` + 1); 1 without effects.
    """
    spaces = [(own, la.orth(own.column)) for own in screened if own.column.any()]
    if not spaces:
        return 1.0
    basis = np.hstack([space for _, space in spaces])
    value, vector = np.linalg.eigh(basis.T @ basis)
    root = vector * np.sqrt(np.clip(value, 0.0, None))
    drawn = np.random.default_rng(_SEED).normal(size=(DRAWS, value.size)) @ root.T
    best, first = np.zeros(DRAWS), 0
    for own, space in spaces:
        along = drawn[:, first : first + space.shape[1]]
        first += space.shape[1]
        low, high = bounds_of(own.parameter)
        one_sided = own.strength.size == 1 and not low[own.strength[0]] < 0.0 < high[own.strength[0]]
        if one_sided:  # half of what chance brings asks for the other side
            along = np.clip(along, 0.0, None)
        best = np.maximum(best, np.sum(along**2, axis=1))
    return float((1 + np.count_nonzero(best >= gain)) / (1 + DRAWS))
