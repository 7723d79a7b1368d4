"""What a fit moved beside effects: every quantity of the stack file and of the measurement, stated and fitted."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from model import Stack
from updating.diagnosis.answer import Moved, Pulled
from updating.diagnosis.candidates import DIMENSIONS
from updating.diagnosis.evidence import D_F_START, DECAY, POINTS_SHIFT
from updating.fitting.fit import ParameterEstimate
from updating.inference.explain import Explanation
from updating.results.text import interval_text, percent, quantity

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
        return (f"location of clamp {clamp[1]} along {clamp[2]}", "m", float(getattr(clamp_stated, clamp[2])), False)
    if what in (POINTS_SHIFT, DECAY):
        return _LABELS[what], "m" if what == POINTS_SHIFT else "1/s", 0.0, False
    if what == "gain":
        return f"gain of {where} over that of sensor 1", "1", 1.0, True
    if where:
        return f"{_LABELS[what]} at {where} over that of all", "1", 1.0, True
    if what in DIMENSIONS:
        return what, "m", float(getattr(stack, what)), True
    stated = {
        "G_f": (stack.contact.G_f, "Pa/Pa"),
        "d_f": (stack.contact.d_f or D_F_START, "s/Pa"),
        "young": (stack.material.young, "Pa"),
        "density": (stack.material.density, "kg/m3"),
        "normal_modulus": (stack.contact.normal_modulus, "Pa"),
    }
    value, unit = stated[what]
    return _LABELS[what], unit, float(value), True


_STEEL = {"young": "Young's modulus", "density": "density", "normal_modulus": "stiffness of the contact across"}
_CONTACT = {"G_f": "stiffness G_f", "d_f": "damping d_f"}


def misstated(p: ParameterEstimate) -> str:
    """Write what was stated wrongly, such as ``pressure at M1 1.2 times the stated one``; other parameters as usual."""
    what, _, where = p.name.partition("[")
    where, clamp = where.rstrip("]"), _CLAMP.fullmatch(p.name)
    value = quantity(p.value, p.unit)
    if clamp:
        text = f"clamp {clamp[1]} sits {value} farther along {clamp[2]}"
    elif what in DIMENSIONS:
        text = f"{what} {value} times the stated one"
    elif what == "G_f" and where:
        text = f"pressure at {where} {value} times the stated one"
    elif what == "gain":
        text = f"{where} reads {value} times what sensor 1 does"
    elif what == DECAY:
        text = f"every free vibration decays faster by {value}"
    elif what == POINTS_SHIFT:
        text = f"all points sit {value} farther along x"
    else:
        return interval_text(p)
    return f"{text} (95 %: {quantity(p.lower, p.unit, p.value)} to {quantity(p.upper, p.unit, p.value)})"


def pulled_text(pulled: Sequence[Pulled]) -> list[str]:
    """Write a sentence for each nuisance that is pulled from its prior, to follow a word such as beware.

    Two torques whose contact is off in opposite ways give one sentence, on their difference.
    """
    text, left = [], list(pulled)
    for what in _CONTACT:
        pair = [nuisance for nuisance in left if nuisance.name.partition("[")[0] == what]
        if len(pair) == 2 and pair[0].value * pair[1].value < 0.0:
            left = [nuisance for nuisance in left if nuisance not in pair]
            low, high = sorted(pair, key=lambda nuisance: nuisance.value)
            more, known = (percent(float(np.expm1(high.value - low.value))), _off(high, np.sqrt(2.0) * high.std))
            text.append(
                f"the contact {_CONTACT[what]} would have to be {more} higher at {_where(high)} than at {_where(low)}, "
                f"beyond what their pressures do; reassembly and torque explain {known}."
            )
    return text + [_pulled_text(nuisance) for nuisance in left]


def _where(nuisance: Pulled) -> str:
    return nuisance.name.partition("[")[2].rstrip("]")


def _pulled_text(nuisance: Pulled) -> str:
    what = nuisance.name.partition("[")[0]
    value, known, clamp = (
        _off(nuisance, nuisance.value),
        _off(nuisance, nuisance.std),
        _CLAMP.fullmatch(nuisance.name),
    )
    if what in _CONTACT:
        return (
            f"the contact {_CONTACT[what]} at {_where(nuisance)} would have to differ from the other torques' by "
            f"{value}; reassembly and torque explain {known}."
        )
    if clamp:
        text = f"clamp {clamp[1]} would have to sit {value} farther along {clamp[2]} than the file has it"
    elif what == POINTS_SHIFT:
        text = f"all measured points would have to sit {value} farther along x than the file has them"
    elif what == DECAY:
        return (
            f"every free vibration would have to decay faster by {value}, as an exponential window makes it, "
            "and the campaign states none."
        )
    else:
        known_by = (
            f"the stack's {_STEEL.get(what, what)}" if what in (*_STEEL, *DIMENSIONS) else f"the factor of {what}"
        )
        text = f"{known_by} would have to differ from the file's by {value}"
    return f"{text}; what is known of it leaves {known}."


def _off(nuisance: Pulled, value: float) -> str:
    """Write how far a nuisance is off, in its unit or in percent."""
    if nuisance.name == POINTS_SHIFT or _CLAMP.fullmatch(nuisance.name):
        return quantity(value, "m")
    return quantity(value, "1/s") if nuisance.name == DECAY else percent(float(np.expm1(value)))
