"""Whether a mode that seems to move from run to run does so.

Poles that each run has for itself meet whatever the modes of all runs lack: a mode beside another one that was not
found, or what strong resonances elsewhere are off by. So where runs seem to disagree about a mode, the lines around it
are fitted by themselves: with poles that all runs share, with a pole of the mode for each run, and with one more pole
that all share. A mode moves where poles of each run are the likeliest.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from ema.identification.functions import Functions, response
from ema.identification.maximum_likelihood import Fit, linear_fit, refine
from ema.identification.run_poles import FALSE_ALARM
from ema.identification.significance import inflation, is_confined

REACH = 5.0
"""Half bandwidths on each side of a mode on which it is judged, and at least `FEWEST_LINES` lines."""
FEWEST_LINES = 16
ASIDE = (-1.0, -0.5, 0.5, 1.0)
"""Half bandwidths beside a mode at which a further one is sought."""
APART = 0.35
"""Half bandwidths beside any other at which it may be: two poles nearer to each other are what one that moves by as
little in some runs looks like to first order."""

_KNOWN = 0.01  # of the logarithm of the likelihood, of which some ten decide


@dataclass(frozen=True, eq=False, kw_only=True)
class RunEvidence:
    """What the lines around a mode say of its pole in different runs.

    Attributes
    ----------
    moves : bool
        Whether a pole for each run is likelier than one that all share, alone or with a further one.
    beside : Fit or None
        The lines around it with a further pole, the last one, where that is likelier than both.
    """

    moves: bool
    beside: Fit | None


def run_evidence(data: Functions, fit: Fit, mode: int, candidates: NDArray[np.complex128]) -> RunEvidence:
    """Judge whether a mode moves from run to run.

    Parameters
    ----------
    data : Functions
    fit : Fit
        The modes, with poles that all runs share.
    mode : int
        Which of them.
    candidates : (n_candidate,) complex
        Stable poles, rad/s, that may be further modes.
    """
    pole = fit.pole[mode]
    spacing = 2.0 * np.pi * float(data.frequency[1] - data.frequency[0])
    reach = max(-REACH * pole.real, FEWEST_LINES * spacing)
    lines = np.abs(2.0 * np.pi * data.frequency - np.abs(pole)) < reach
    near = np.abs(fit.pole.imag - pole.imag) < reach
    frequency = data.frequency[lines]
    own = (data.value - response(data, fit.pole[~near], fit.residue[:, ~near]))[:, lines]
    near[mode] = False
    shared = refine(frequency, own, np.append(pole, fit.pole[near]), data.quantity)
    numbers = np.unique(data.run)
    gain, noise = np.empty(numbers.size), np.empty(numbers.size)
    for k, number in enumerate(numbers):
        its = own[data.run == number]
        alone = linear_fit(frequency, its, shared.pole, data.quantity)
        moved = refine(frequency, its, shared.pole[:1], data.quantity, held=shared.pole[1:], tolerance=_KNOWN)
        gain[k], noise[k] = 2.0 * (alone.objective - moved.objective), inflation(moved.whitened())
    if not np.any(gain > noise.max() * scipy.special.chdtri(2, FALSE_ALARM / numbers.size)):
        return RunEvidence(moves=False, beside=None)
    start = [pole - 1j * aside * pole.real for aside in ASIDE]
    start += [c for c in candidates if 0.5 * -pole.real < np.abs(c - pole) < reach]
    tried = [
        refine(frequency, own, np.append(shared.pole, s), data.quantity, tolerance=_KNOWN) for s in start
    ]
    apart = [t for t in tried if np.abs(t.pole[-1] - t.pole[:-1]).min() > -APART * pole.real]
    if not apart:
        return RunEvidence(moves=True, beside=None)
    further = min(apart, key=lambda one: one.objective)
    # Unknowns are counted as Akaike does.
    by_runs = float(gain.sum()) - 2 * 2 * (numbers.size - 1)
    by_further = 2.0 * (shared.objective - further.objective) - 2 * (2 + 2 * len(own))
    # A pole that one run alone needs is its own of the mode, and no further mode of all runs.
    if by_further > by_runs and not is_confined(further, data.run)[-1]:
        return RunEvidence(moves=False, beside=further)
    return RunEvidence(moves=True, beside=None)
