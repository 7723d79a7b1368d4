"""A band of very many lines taken in parts: each has modes for one model order, and its own fit.

The cost of a fit of all modes together grows with the lines and with the square of the modes, and a model order that
is enough for a few modes is not for those of a whole record. An engineer would take such a record band by band, with
the ends where little happens; so does this.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

MOST_LINES = 20_000
"""Lines up to which a band is taken at once."""
PART_LINES = 8192
"""Lines of a part, about."""
OVERLAP = 1024
"""Lines beyond each end of a part that it is fitted on: for a mode near its end, and the flank of one beyond it."""
_ROOM = 0.25  # of a part, to either side of where it would end, for the end to be moved to a valley
_SMOOTH = 9  # lines over which the power is smoothed: no valley is one quiet line of noise


@dataclass(frozen=True, kw_only=True)
class PartBand:
    """One part of a band.

    Attributes
    ----------
    core : slice
        The lines that are its own; those of all parts are all lines of the band, once.
    lines : slice
        The lines that it is fitted on: with the overlap.
    """

    core: slice
    lines: slice

    def of(self, values: NDArray[Any]) -> NDArray[Any]:
        """Return what values on the lines that it is fitted on, (..., n_line), are on its own ones."""
        return values[..., self.core.start - self.lines.start : self.core.stop - self.lines.start]


def part_bands(value: NDArray[np.complex128]) -> tuple[PartBand, ...]:
    """Cut a band where its functions are quiet; one that has few lines stays whole.

    Parameters
    ----------
    value : (..., n_frequency) complex
        The functions.
    """
    n_line = value.shape[-1]
    if n_line <= MOST_LINES:
        return (PartBand(core=slice(0, n_line), lines=slice(0, n_line)),)
    power = np.zeros(n_line)
    for one in value.reshape(
        -1, n_line
    ):  # all squares at once would take half of the memory of the functions
        square = np.abs(one) ** 2
        power += square / (square.mean() or 1.0)
    power = scipy.ndimage.uniform_filter1d(power, _SMOOTH)
    even = np.linspace(0, n_line, round(n_line / PART_LINES) + 1)
    room = int(_ROOM * (even[1] - even[0]))
    cuts = [int(at) - room + int(np.argmin(power[int(at) - room : int(at) + room])) for at in even[1:-1]]
    ends = [0, *cuts, n_line]
    return tuple(
        PartBand(core=slice(a, b), lines=slice(max(0, a - OVERLAP), min(n_line, b + OVERLAP)))
        for a, b in itertools.pairwise(ends)
    )
