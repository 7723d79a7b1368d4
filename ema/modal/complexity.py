"""How complex mode shapes are: whether each can be compared with a real one, such as a model without damping has.

A real shape has all its components in phase or against it. Noise, a mode close by, damping that is not proportional,
and channels of wrong phase turn components out of that line.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ema.modal.mac import line_angle, mcf, mpc, mpd
from ema.quality.verdict import Verdict
from ema.types.modal_model import ModalModel

LEAST_MPC = 0.8
"""Modal phase collinearity below which a mode is too complex to be compared as real. The consistent-mode indicator,
which is the MPC times the consistency in time, speaks of high confidence from 80 % on (Pappa, Elliott and Schenk, A
consistent-mode indicator for the eigensystem realization algorithm, NASA TM-107607, 1992)."""
_MOST_LISTED = 8


@dataclass(frozen=True, eq=False, kw_only=True)
class Complexity:
    """Measures of the complexity of every mode shape, ``(n_mode,)`` each.

    Attributes
    ----------
    mpc : float
        Modal phase collinearity, 1 for a real mode.
    mpd : float
        Mean phase deviation from the line of best fit, degrees, weighted by magnitude.
    mcf : float
        Modal complexity factor, 0 for a real mode.
    phase_scatter : float
        Root mean square of that deviation, degrees, weighted by squared magnitude.
    by_noise : float
        Modal complexity factor that the stated standard deviations alone would give a real mode, in the mean.
    """

    mpc: NDArray[np.float64]
    mpd: NDArray[np.float64]
    mcf: NDArray[np.float64]
    phase_scatter: NDArray[np.float64]
    by_noise: NDArray[np.float64]

    @property
    def is_complex(self) -> NDArray[np.bool_]:
        """Which modes are too complex to be compared as real."""
        return self.mpc < LEAST_MPC


def complexity(modal_model: ModalModel) -> Complexity:
    """Measure how complex the shapes of a modal model are.

    Parameters
    ----------
    modal_model : ModalModel
        Its shapes, and their standard deviations for `Complexity.by_noise`: of a real shape with independent errors of
        variance v across its line the MPC is 1 - 4 sum(v) / sum(abs(shape)**2) to first order.
    """
    shape = modal_model.shape
    power = np.sum(np.abs(shape) ** 2, axis=0)
    turned = shape * np.exp(-1j * line_angle(shape))
    off = np.arctan2(np.abs(turned.imag), np.abs(turned.real))
    scatter = np.sqrt(np.sum(np.abs(shape) ** 2 * off**2, axis=0) / power)
    return Complexity(
        mpc=mpc(shape),
        mpd=np.degrees(mpd(shape)),
        mcf=mcf(shape),
        phase_scatter=np.degrees(scatter),
        by_noise=np.minimum(4.0 * np.sum(modal_model.shape_std**2, axis=0) / power, 1.0),
    )


def check_complexity(modal_model: ModalModel) -> tuple[Verdict, ...]:
    """Say which modes are too complex to be compared as real, and whether noise explains it.

    Returns
    -------
    tuple of Verdict
        A warning for each such mode, or that all pass.
    """
    found = complexity(modal_model)
    warned = tuple(_warnings(modal_model, found))
    if warned:
        return warned
    text = (
        f"the shapes are nearly real: the lowest MPC is {found.mpc.min():.3f}"
        if found.mpc.size
        else "no mode"
    )
    return (Verdict(check="complexity", level="pass", channel=(), band=None, message=text),)


def _warnings(modal_model: ModalModel, found: Complexity) -> Iterator[Verdict]:
    complex_ones = np.flatnonzero(found.is_complex)
    for r in complex_ones[:_MOST_LISTED]:
        f = float(modal_model.frequency[r])
        most = 0.5 * (1.0 + np.sqrt(found.mpc[r]))  # of a real shape along the longer axis of the components
        why = (
            "its noise alone explains that: measure it better, or leave it out"
            if found.by_noise[r] > 0.5 * found.mcf[r]
            else "a mode close by, damping at a joint, a sensor's mass that moves, or the phase of a channel does that"
        )
        text = (
            f"the mode at {f:.5g} Hz is too complex to be compared as real: MPC {found.mpc[r]:.2f} (of a real mode 1), "
            f"phases {found.mpd[r]:.0f} degrees off their line in the mean; no real shape has a MAC above {most:.2f} "
            f"with it; {why}"
        )
        yield Verdict(check="complexity", level="warn", channel=(), band=(f, f), message=text)
    if complex_ones.size > _MOST_LISTED:
        f = float(modal_model.frequency[complex_ones[_MOST_LISTED]])
        number = complex_ones.size - _MOST_LISTED
        text = f"{number} further modes from {f:.5g} Hz on are too complex to be compared as real"
        yield Verdict(check="complexity", level="warn", channel=(), band=(f, f), message=text)
