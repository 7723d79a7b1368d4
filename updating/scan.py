"""A coarse look over the whole range of every effect, for a base model so far off that steps from it mislead."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ema.mac import mac
from model import Parameter, SolveError
from updating.candidates import G_F_RANGE
from updating.coordinates import bounds_of, scaled
from updating.evidence import D_F_START, Evidence, pair, solved

Vector = NDArray[np.float64]

_SHARES = (0.1, 0.35, 1.0)  # of the way from neutral to an end of the range
_PLACES = 7
_STIFFNESS = 3
_STEP = 0.7  # of log G_f, over which frequencies follow it by their slope
_FAR = 0.05  # a relative difference of frequency that counts as no resemblance


def scan(evidence: Evidence, name: str, shaping: NDArray[np.intp]) -> tuple[float, float, Vector]:
    """Return the smallest cost of an effect over its range, with the G_f and the coordinates that give it.

    The cost counts what is far off once only: a mode's squared relative difference in frequency up to one, and 1 - MAC.

    Parameters
    ----------
    evidence : Evidence
        Measurement and model. The configuration with most modes is looked at.
    name : str
        The effect.
    shaping : (n,) int
        Its parameters that have no strength of their own.
    """
    c = int(np.argmax([used.size for used in evidence.used]))
    own, used = evidence.parameters([name]), evidence.used[c]
    shape, frequency = evidence.tested[c].modes.shape[:, used], evidence.tested[c].modes.frequency[used]
    best = (np.inf, 0.0, np.zeros(len(own)))
    for where in _grid(own, shaping):
        effect = {p.name: scaled(p, float(x))[0] for p, x in zip(own, where, strict=True)}
        for G_f in np.geomspace(2.0 * G_F_RANGE[0], G_F_RANGE[1] / 2.0, _STIFFNESS):
            try:
                modes = solved(evidence, c, {"G_f": float(G_f), "d_f": D_F_START, **effect}, ("G_f",))
            except SolveError:  # so strong that the contact turns negative
                continue
            row, column = pair(shape, frequency, modes)
            alike = mac(shape, modes.shape)[row, column]
            far = np.log(frequency[row] / modes.frequency[column])
            slope = G_f * modes.frequency_gradient[column, 0] / modes.frequency[column]
            ratio = float(
                np.clip(np.median(far / slope), -_STEP, _STEP)
            )  # of log G_f, for most modes at once
            far = (far - ratio * slope) / _FAR
            cost = float(np.sum(np.minimum(far**2, 1.0) + 1.0 - alike))
            if cost < best[0]:
                best = (cost, float(G_f * np.exp(ratio)), where)
    return best


def _grid(own: tuple[Parameter, ...], shaping: NDArray[np.intp]) -> Iterator[Vector]:
    low, high = bounds_of(own)
    axes = []
    for i in range(len(own)):
        if i in shaping:
            axes.append(np.linspace(low[i], high[i], _PLACES))
        else:
            axes.append(np.array([s * end for end in (low[i], high[i]) if end for s in _SHARES]))
    for values in itertools.product(*axes):
        yield np.array(values)
