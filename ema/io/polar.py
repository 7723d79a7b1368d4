"""FRFs as magnitude and phase: their numbers, and the units that names and numbers tell."""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from ema.io.contents import UNKNOWN

_LEAST_OF_DEGREES = 60.0
"""Largest phase from which on numbers without a unit are taken as degrees. A phase that is not wrapped passes 2 pi in
rad, but needs some twenty resonances to pass this; in degrees one resonance takes it beyond 90."""


def from_polar(
    magnitude: NDArray[np.float64], phase: NDArray[np.float64], *, decibel: bool, degrees: bool
) -> NDArray[np.complex128]:
    """Return complex numbers from magnitudes, plain or 20 log10 of them, and phases in degrees or rad."""
    with np.errstate(over="ignore", invalid="ignore"):  # what is not finite is for the quality check to say
        size = 10.0 ** (magnitude / 20.0) if decibel else magnitude
        return np.asarray(size * np.exp(1j * (np.deg2rad(phase) if degrees else phase)))


def polar_units(
    titles: tuple[str, str], magnitude: NDArray[np.float64], phase: NDArray[np.float64], guesses: list[str]
) -> dict[str, str]:
    """Return `magnitude_unit` and `phase_unit` as a campaign file has them, where they are not the usual ones.

    Parameters
    ----------
    titles : (str, str)
        What titles or names say of the magnitudes and of the phases.
    magnitude, phase : array
        The numbers, of any shape.
    guesses : list of str
        What only the numbers tell is added to it.
    """
    keys: dict[str, str] = {}
    of_magnitude, of_phase = (title.lower() for title in titles)
    if re.search(r"db(?![a-z])|decibel", of_magnitude) or np.nanmin(magnitude, initial=0.0) < 0:
        keys["magnitude_unit"] = "dB"
        if "db" not in of_magnitude:
            guesses.append("the magnitude is taken as dB, since some of it is negative")
    largest = float(np.nanmax(np.abs(phase), initial=0.0))
    if "rad" in of_phase:
        keys["phase_unit"] = "rad"
    elif "deg" in of_phase or "°" in of_phase or "grad" in of_phase:
        pass
    elif largest <= 2 * np.pi:
        keys["phase_unit"] = "rad"
        guesses.append(f"the phase is taken as rad, since it does not pass {largest:.3g}")
    elif largest < _LEAST_OF_DEGREES:
        keys["phase_unit"] = UNKNOWN
        guesses.append(f"the phase reaches {largest:.3g}, which may be rad or degrees")
    else:
        guesses.append(f"the phase is taken as degrees, since it reaches {largest:.3g}")
    return keys
