"""Whether resonances have the phase of the quantity that functions are given as."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ema.quality.peaks import peaks, residues
from ema.quality.verdict import Verdict
from ema.types.frf import FRF

_IN_PHASE = 0.7
"""Mean cosine of twice the angle between residues and a phase from which on they have that phase."""
_FEWEST_LINES = 0.25
"""Lines in a half-power bandwidth from which on a record is long enough for phases: its end turns them by 27 degrees at
most, the angle whose sine is exp(-pi 0.25), where nothing else has faded the response out."""


def phases(frf: FRF, sound: NDArray[np.int64]) -> Iterator[Verdict]:
    """Compare the phase of the residues with that of the quantity.

    Residues of real modes are imaginary in receptance and accelerance, and real in mobility, if time is counted from
    the force. Where a resonance is narrower than the lines tell, its record ends before it has died away, and the phase
    of its residues is that of the end of the record: it refuses nothing.
    """
    expected = 1.0 if frf.quantity == "mobility" else -1.0
    wrong, resolved = [], []
    for around in residues(frf, sound, peaks(frf, sound)):
        square, power = np.sum(around.residue**2).real, np.sum(np.abs(around.residue) ** 2)
        wrong.append(bool(expected * square < -_IN_PHASE * power))
        resolved.append(around.lines > _FEWEST_LINES)
    told = np.array(wrong)[resolved] if any(resolved) else np.array(wrong)
    if told.size < 2 or told.sum() <= 0.75 * told.size:
        return
    other = "mobility" if expected < 0 else "accelerance or receptance"
    text = f"given as {frf.quantity}, but {told.sum()} of {told.size} resonances have the phase of {other}"
    if np.count_nonzero(resolved) >= 2:
        yield Verdict(check="unit", level="fail", channel=(), band=None, message=text)
    else:
        text += (
            "; they are narrower than the lines resolve, so that the end of the record may have turned it: check the "
            "quantity, and take longer blocks"
        )
        yield Verdict(check="resolution", level="warn", channel=(), band=None, message=text)
