"""Single functions of several forces whose sign contradicts all others of their point and of their force.

At a resonance the functions are the outer product of the mode's shape and its participation in the forces (Ewins,
Modal Testing, 2nd ed., sec. 2.8): from point to point only the size of what the forces give changes, not their
proportion. A point at which one force has the other sign at every resonance is no second mode of the same pole, which
would do so at one of them, but a function that is turned.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ema.quality.peaks import peaks
from ema.types.frf import FRF

FEWEST_POINTS = 6
"""Points from which on most of them say what the proportion of the forces is."""
FEWEST_RESONANCES = 2
"""Resonances at which a function must be turned."""
_PROMINENCE = 3.0  # of a resonance, dB
_FITS, _CONTRADICTS = 0.9, 0.5  # share of a point's power that has the proportion of the others
_MOST = 0.7  # share of the points that must have it, for a resonance to be of one mode
_SEEN = 0.3  # least size of a point's functions over their median, for its sign to be told


@dataclass(frozen=True, kw_only=True)
class TurnedFunction:
    """A function of the wrong sign.

    Attributes
    ----------
    output, input : int
        Its positions.
    resonances : tuple of float
        Where it contradicts the others, Hz.
    """

    output: int
    input: int
    resonances: tuple[float, ...]


def turned_functions(frf: FRF, channels: NDArray[np.int64]) -> tuple[TurnedFunction, ...]:
    """Find functions that fit the proportion of the forces at no resonance, and at all of them if they are turned.

    Parameters
    ----------
    frf : FRF
        Functions of several inputs. Of two inputs nothing tells which function is turned; the first is named.
    channels : (n_channel,) int
        Outputs to be compared.
    """
    if channels.size < FEWEST_POINTS or frf.input.node.size == 1:
        return ()
    found: dict[tuple[int, int], list[float]] = {}
    fitting: set[int] = set()
    for peak in peaks(frf, channels, _PROMINENCE):
        value = frf.value[channels, :, peak.line]
        value = value / np.linalg.norm(value, axis=0)
        size = np.linalg.norm(value, axis=1)
        seen = np.flatnonzero(size > _SEEN * np.median(size))
        row = value[seen] / size[seen, None]
        proportion = np.linalg.svd(row, full_matrices=False)[2][0].conj()
        part = row * proportion
        whole = np.abs(part.sum(axis=1)) ** 2
        if np.mean(whole > _FITS) < _MOST:
            continue
        turned = np.abs(part.sum(axis=1, keepdims=True) - 2.0 * part) ** 2
        fitting |= {int(channels[k]) for k in seen[whole > _FITS]}
        for k in np.flatnonzero((whole < _CONTRADICTS) & (turned.max(axis=1) > _FITS)):
            which = int(channels[seen[k]]), int(turned[k].argmax())
            found.setdefault(which, []).append(float(peak.frequency))
    return tuple(
        TurnedFunction(output=output, input=force, resonances=tuple(place))
        for (output, force), place in found.items()
        if output not in fitting and len(place) >= FEWEST_RESONANCES
    )
