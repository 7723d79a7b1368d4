"""What a fit moved beside effects: every quantity of the stack file and of the measurement, stated and fitted."""

from __future__ import annotations

import re

import numpy as np

from model import Stack
from updating.diagnosis.answer_parts import Moved
from updating.diagnosis.candidates import DIMENSIONS
from updating.diagnosis.evidence import D_F_START, DECAY, POINTS_SHIFT
from updating.inference.explain import Explanation
from updating.results.text import percent, quantity

REPORTED = 2.0
"""Standard deviations of its prior from which the terminal names what was moved; JSON and report have all."""
_CLAMP = re.compile(r"clamp_(\d+)_([xy])")
_LABELS = {
    "G_f": "contact stiffness G_f",
    "d_f": "contact damping d_f",
    "young": "Young's modulus",
    "density": "density",
    "normal_modulus": "stiffness of the contact across",
    POINTS_SHIFT: "shift of all points along x",
    DECAY: "added decay of all modes",
}


def moved(stack: Stack, explanation: Explanation) -> tuple[Moved, ...]:
    """Return every quantity that all fits may move, as stated and as an explanation was fitted with it.

    Parameters
    ----------
    stack : Stack
        What states the values.
    explanation : Explanation
        A fit.
    """
    quantities = []
    for c, x, std in list(zip(explanation.coordinates, explanation.x, explanation.std, strict=True))[
        : explanation.n_nuisance
    ]:
        label, unit, stated, is_ratio = _stated(stack, c.name)
        scale = stated if is_ratio else 1.0
        value = stated * float(np.exp(x)) if is_ratio else stated + float(x)
        slope = value if is_ratio else scale
        quantities.append(
            Moved(
                name=c.name,
                label=label,
                unit=unit,
                stated=stated,
                value=value,
                std=float(slope * std),
                prior=float(scale * c.std) if np.isfinite(c.std) else None,
                deviations=float(x / c.std) if np.isfinite(c.std) else None,
            )
        )
    return tuple(quantities)


def moved_text(nuisance: Moved) -> str:
    """Write a quantity as stated and as fitted, such as ``density from 7600 kg/m3 to 7500 kg/m3 (2.1)``."""
    if nuisance.unit == "1":
        change = f"by {percent(nuisance.value - nuisance.stated)}"
    else:
        stated = quantity(nuisance.stated, nuisance.unit, nuisance.value)
        change = f"from {stated} to {quantity(nuisance.value, nuisance.unit)}"
    return f"{nuisance.label} {change} ({abs(nuisance.deviations or 0.0):.1f})"


def _stated(stack: Stack, name: str) -> tuple[str, str, float, bool]:
    """Return label, unit and stated value of a quantity, and whether it is moved by a factor."""
    what, _, where = name.partition("[")
    where, clamp = where.rstrip("]"), _CLAMP.fullmatch(name)
    if clamp:
        clamp_stated = stack.clamps[int(clamp[1]) - 1]
        return (
            f"place of clamp {clamp[1]} along {clamp[2]}",
            "m",
            float(getattr(clamp_stated, clamp[2])),
            False,
        )
    if what in (POINTS_SHIFT, DECAY):
        return _LABELS[what], "m" if what == POINTS_SHIFT else "1/s", 0.0, False
    if what == "gain":
        return f"gain of {where} over that of sensor 1", "1", 1.0, True
    if where:
        return f"{_LABELS[what]} at {where} over that of all", "1", 1.0, True
    if what in DIMENSIONS:
        return what, "m", float(getattr(stack, what)), True
    stated = {
        "G_f": (stack.contact.G_f, "1"),
        "d_f": (stack.contact.d_f or D_F_START, "s/Pa"),
        "young": (stack.material.young, "Pa"),
        "density": (stack.material.density, "kg/m3"),
        "normal_modulus": (stack.contact.normal_modulus, "Pa"),
    }
    value, unit = stated[what]
    return _LABELS[what], unit, float(value), True
