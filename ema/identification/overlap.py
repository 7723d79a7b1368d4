"""Modes beside others that overlap too much to be told apart.

Where bandwidths reach over several modes, poles are found that the functions need, but whose residues have not the
phases of a mode: each stands for several modes. Taken away one after the other, each spoils the phases of its
neighbours, until those that can be told go as well. So they stay in the fit, as background, and are no results.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ema.identification.functions import Functions, inside
from ema.identification.maximum_likelihood import Fit, refine
from ema.identification.selection import sound
from ema.identification.significance import is_split, judge
from ema.identification.stabilization import MAX_DAMPING

OVERLAPPED = "modes overlap there so much that they cannot be told apart"
OVERLAP = 0.3
"""Modal overlap factor from which modes are sought beside background."""
SAME_PLACE = 0.1
"""Half bandwidths within which two poles are at one place: runs that differ a little bring such."""
_UNDAMPED = 1e-6


def modal_overlap(pole: NDArray[np.complex128]) -> float:
    """Return the modal overlap factor: the median half-power bandwidth over the mean spacing of the poles."""
    return float(-2.0 * np.median(pole.real) * pole.size / np.ptp(pole.imag)) if pole.size > 1 else 0.0


def with_background(
    data: Functions, candidates: NDArray[np.complex128], band: tuple[float, float]
) -> tuple[Fit, NDArray[np.bool_]]:
    """Refine candidates together, and tell which are modes.

    Parameters
    ----------
    data : Functions
    candidates : (n_candidate,) complex
        Poles that may be modes, rad/s.
    band : (float, float)
        Where modes are wanted, Hz.

    Returns
    -------
    fit : Fit
        All poles that stand out of the noise.
    is_mode : (n_mode,) bool
        Which of them are modes; the others are background.
    """
    pole, wide = candidates, (2.0 * band[0] - band[1], 2.0 * band[1] - band[0])
    while True:
        fit = refine(data.frequency, data.value, pole, data.quantity)
        verdicts = judge(data.frequency, fit, data.quantity)
        size = np.abs(fit.pole)
        damped = (-fit.pole.real > _UNDAMPED * size) & (-fit.pole.real < MAX_DAMPING * size)
        needed = (verdicts.statistic > verdicts.threshold) & damped & inside(fit.pole, wide)
        if needed.all():
            break
        pole = fit.pole[needed]
    is_mode = needed & verdicts.accepted & sound(fit, pole, band)
    return fit, is_mode & ~_doubles(fit, is_mode)


def _doubles(fit: Fit, is_mode: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Tell which modes are no more than a second pole of a stronger one: of its shape, or at its very place."""
    double = np.zeros(fit.pole.size, dtype=bool)
    height = np.linalg.norm(fit.residue, axis=0) / -fit.pole.real
    kept: list[int] = []
    for r in sorted(np.flatnonzero(is_mode), key=lambda r: -height[r]):
        half = np.minimum(-fit.pole.real[kept], -fit.pole.real[r])
        double[r] = is_split(fit, int(r), kept) or bool(
            np.any(np.abs(fit.pole.imag[kept] - fit.pole.imag[r]) < SAME_PLACE * half)
        )
        if not double[r]:
            kept.append(int(r))
    return double
