"""Nuisances in words: what may have been stated wrongly of a stack or a measurement, and by how much."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from updating.diagnosis.answer import Pulled
from updating.diagnosis.candidates import DIMENSIONS
from updating.diagnosis.evidence import DECAY, POINTS_SHIFT
from updating.fitting.fit import ParameterEstimate
from updating.results.text import interval_text, percent, quantity

_STEEL = {
    "young": "Young's modulus",
    "density": "density",
    "normal_modulus": "stiffness of the contact across",
}
_CONTACT = {"G_f": "stiffness G_f", "d_f": "damping d_f"}
_CLAMP = re.compile(r"clamp_(\d+)_([xy])")


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
            more, known = (
                percent(float(np.expm1(high.value - low.value))),
                _off(high, np.sqrt(2.0) * high.std),
            )
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
            f"the stack's {_STEEL.get(what, what)}"
            if what in (*_STEEL, *DIMENSIONS)
            else f"the factor of {what}"
        )
        text = f"{known_by} would have to differ from the file's by {value}"
    return f"{text}; what is known of it leaves {known}."


def _off(nuisance: Pulled, value: float) -> str:
    """Write how far a nuisance is off, in its unit or in percent."""
    if nuisance.name == POINTS_SHIFT or _CLAMP.fullmatch(nuisance.name):
        return quantity(value, "m")
    return quantity(value, "1/s") if nuisance.name == DECAY else percent(float(np.expm1(value)))
