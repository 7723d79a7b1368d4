"""Residual pressure of welds: seams that shrink press the laminas where they run, whatever the bolts do.

Two seams on the long sides at x = +-L/4.

Enters: a pressure a p_ref f(x, y) that does not change with torque (p_ref = 160 kPa), f a bell of half of the
    height about each seam; shear stiffness G_f times it, affine in a for a given G_f.
Range: a from 0 to 6.
Does: raises B1 by 21 %, T1 by 18 %, B2 by 8 % and T2 by 7 % at low torque, half to two thirds of it at twice
    the pressure. (Demo stack, nominal strength.)
Mistaken for: weld_seam, contact_offset, clamp_frame.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from model.contact.contact import tangential_krons
from model.effects.parts import again
from model.elements.equations import Assembly, Term, Theta
from model.stack.effect import PRESSURE_REFERENCE, Effect, Parameter


def _change(t: Theta) -> Any:
    return PRESSURE_REFERENCE * t["weld_residual"] / t["pressure"]


def terms(assembly: Assembly) -> tuple[Term, ...]:
    """Return the tangential contact under the seams' own pressure."""
    stack = assembly.stack
    x, y = assembly.plan.quadrature_points
    reach = stack.height / 2.0
    weight = sum(
        np.exp(-0.5 * ((x - sx) / reach) ** 2 - 0.5 * ((y - sy) / reach) ** 2)
        for sx in (-stack.length / 4.0, stack.length / 4.0)
        for sy in (-stack.width / 2.0, stack.width / 2.0)
    )
    krons = tangential_krons(assembly.plan, stack.spacing, stack.touching, np.asarray(weight))
    return (
        again(assembly, "tangential contact", "weld_pressure", _change, krons=krons),
        again(assembly, "tangential contact damping", "weld_pressure damping", _change, krons=krons),
    )


EFFECT = Effect(
    name="weld_pressure",
    label="residual pressure of welds",
    family="pressure field",
    summary="Residual pressure of welds",
    description=__doc__,
    parameters=(
        Parameter(
            name="weld_residual",
            unit="1",
            nominal=1.0,
            lower=0.0,
            upper=6.0,
            source="shrinking seams keep pressures of the order of the bolts'",
        ),
    ),
    terms=terms,
)
