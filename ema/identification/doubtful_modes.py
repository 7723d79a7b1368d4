"""What is doubtful about single modes of a result: they are told, and stay."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ema.identification.functions import resonant
from ema.identification.significance import MIN_COLLINEARITY, MIN_REALNESS
from ema.identification.stabilization import MAX_DAMPING
from ema.quality.peaks import peaks
from ema.quality.verdict import Verdict
from ema.types.frf import FRF
from ema.types.modal_model import ModalModel

BROAD = 5.0
"""Times the median of the other damping ratios from which on a mode that shows no peak may be no mode."""
HUMP, SHARE = 1.0, 0.25
"""Height of the peak of a broad mode, dB, and its width as a share of the mode's: narrower ones are noise on it."""
FEWEST_FUNCTIONS, FEWEST_MODES = 3, 3
"""Functions that tell phases from chance, and modes that tell what damping is usual."""
NOISE = 0.1
"""Share of the squared residues of a mode that may be noise where something is said of their phases."""
_LISTED = 4


def check_modes(frf: FRF, modal_model: ModalModel) -> tuple[Verdict, ...]:
    """Say of which modes the damping or the phases are doubtful, or whether they are modes.

    Parameters
    ----------
    frf : FRF
        Functions at the outputs and inputs of the model.
    modal_model : ModalModel

    Returns
    -------
    tuple of Verdict
        Warnings about the set; none where nothing is doubtful.
    """
    own = (_background, _overlap, _damping)
    found = (*(say(modal_model) for say in own), _broad(frf, modal_model), *_phases(modal_model))
    return tuple(
        Verdict(check=check, level="warn", channel=(), band=None, message=text)
        for check, text in found
        if text
    )


def _background(modal_model: ModalModel) -> tuple[str, str]:
    pole, (lower, upper) = modal_model.outside_pole, modal_model.band
    hertz, damping = np.abs(pole) / (2.0 * np.pi), -pole.real / np.abs(pole)
    kept = (hertz > lower) & (hertz < upper) & (damping > MAX_DAMPING)
    listed = [f"{f:.4g} Hz ({100 * x:.0f} %)" for f, x in zip(hertz[kept], damping[kept], strict=True)]
    text = f"damped too much for a resonance is what was fitted at {_joined(listed)}: it stands for the background"
    return "background", text if listed else ""


def _overlap(modal_model: ModalModel) -> tuple[str, str]:
    """Say where poles were fitted that are no modes, for each stands for several (`ema.identification.overlap`)."""
    poles = modal_model.outside_pole[resonant(modal_model.outside_pole, modal_model.band)]
    listed = [f"{f:.4g} Hz" for f in np.sort(np.abs(poles)) / (2.0 * np.pi)]
    text = (
        f"modes overlap so much that not all are told apart: what was fitted at {_joined(listed)} has not the phases "
        "of a mode and is no result; forces at more points tell more"
    )
    return "overlap", text if listed else ""


def _damping(modal_model: ModalModel) -> tuple[str, str]:
    columns = modal_model.frequency, modal_model.damping, modal_model.damping_std
    listed = [
        f"{f:.5g} Hz ({100 * x:.2g} ± {100 * s:.2g} %)" for f, x, s in zip(*columns, strict=True) if s >= x
    ]
    text = (
        f"the data do not determine the damping at {_joined(listed)}: where no peak is seen, this is no mode"
    )
    return "damping", text if listed else ""


def _broad(frf: FRF, modal_model: ModalModel) -> tuple[str, str]:
    """Name modes that are far wider than the others and show no peak of their own."""
    damping = modal_model.damping
    if damping.size < FEWEST_MODES:
        return "broad", ""
    usual = np.array([np.median(np.delete(damping, r)) for r in range(damping.size)])
    suspects = np.flatnonzero(damping > BROAD * usual)
    lines = frf.band(max(modal_model.band[0], np.finfo(float).tiny), modal_model.band[1])
    seen = peaks(lines, np.arange(lines.output.node.size), HUMP) if suspects.size else []
    listed = []
    for r in suspects:
        place, half = modal_model.frequency[r], damping[r] * modal_model.frequency[r]
        if not any(abs(p.frequency - place) < half and p.bandwidth > SHARE * 2.0 * half for p in seen):
            listed.append(f"{place:.5g} Hz ({100 * damping[r]:.0f} %, others {100 * usual[r]:.2g} %)")
    text = f"no peak is seen at {_joined(listed)}: so broad, it may stand for the background and be no mode"
    return "broad", text if listed else ""


def _phases(modal_model: ModalModel) -> Iterator[tuple[str, str]]:
    """Name modes whose residues have not the phases of a real mode: turned as one, or each otherwise."""
    turned, apart = [], []
    if modal_model.residue[..., 0].size >= FEWEST_FUNCTIONS:
        for r, place in enumerate(modal_model.frequency):
            constant = (2j * modal_model.pole[r].imag * modal_model.residue[..., r]).ravel()
            spread = 2.0 * np.abs(modal_model.pole[r].imag) * modal_model.residue_std[..., r].ravel()
            collinearity, realness, angle = _of_constants(constant, spread)
            if collinearity < MIN_COLLINEARITY:
                apart.append(f"{place:.5g} Hz ({collinearity:.2f})")
            elif realness < MIN_REALNESS:
                turned.append(f"{place:.5g} Hz (by {angle:.0f} degrees)")
    if turned:
        yield (
            "phases",
            f"the residues at {_joined(turned)} are alike among points, but turned against the force, as by "
            "cross-talk, filters, or a force that is not where it is stated",
        )
    if apart:
        yield (
            "phases",
            f"the residues at {_joined(apart)} have no phase in common (collinearity in brackets): these shapes are "
            "complex, as of two close modes in one",
        )


def _of_constants(
    constant: NDArray[np.complex128], spread: NDArray[np.float64]
) -> tuple[float, float, float]:
    """Return collinearity and realness, 1 where noise may bring what is lacking, and the angle to the real axis."""
    power, noise = float(np.sum(np.abs(constant) ** 2)), 2.0 * float(np.sum(spread**2))
    if noise > NOISE * power:
        return 1.0, 1.0, 0.0
    square = complex(np.sum(constant**2))
    angle = float(np.degrees(abs(np.angle(square)) / 2.0))
    realness = (np.sum(constant.real**2) - 0.5 * noise) / (power - noise)
    return min(1.0, (abs(square) / (power - noise)) ** 2), float(realness), angle


def _joined(listed: list[str]) -> str:
    return ", ".join(listed[:_LISTED]) + (", ..." if len(listed) > _LISTED else "")
