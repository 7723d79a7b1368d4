"""Steel orthotropy: rolled electrical steel is stiffer across the rolling direction than along it.

Enters: membrane and bending stiffness of the laminas along y, times (r - 1) of Q22; affine, with Q12 and Q66
    kept.
Range: r from 0.75 to 1.5: Goss texture reaches 1.25 to 1.4 for grain-oriented, 1 to 1.1 for other sheet.
Does: raises T2 by 0.4 % and the others by less than 0.1 %: contact, not the sheets, sets these modes. The
    same between torques. (Demo stack, nominal strength.)
Mistaken for: nothing that one can see; usually not visible.
"""

from __future__ import annotations

from typing import Any

import scipy.sparse as sp

from model.effects.parts import again
from model.elements.equations import Assembly, Kron, Term, Theta
from model.elements.mesh import Field
from model.stack.effect import Effect, Parameter


def _change(t: Theta) -> Any:
    return t["transverse_excess"] - 1.0


def terms(assembly: Assembly) -> tuple[Term, ...]:
    """Return the part Q22 of the laminas once more."""
    stack, form = assembly.stack, assembly.plan.form
    q22 = stack.material.plane_stress()[2]
    each = sp.eye_array(stack.n_lamina, format="csr")
    parts: list[tuple[Field, str, float]] = [("v", "y", stack.pitch), ("w", "yy", stack.pitch**3 / 12.0)]
    krons = tuple(
        Kron(row=field, column=field, z=q22 * size * each, planar=form(field, field, (d, d)))  # type: ignore[arg-type]
        for field, d, size in parts
    )
    return (again(assembly, "laminas", "steel_orthotropy", _change, krons=krons),)


EFFECT = Effect(
    name="steel_orthotropy",
    label="orthotropy of the rolled steel",
    family="steel",
    summary="The sheets are stiffer across the rolling direction",
    description=__doc__,
    parameters=(
        Parameter(
            name="transverse_excess",
            unit="1",
            nominal=1.2,
            lower=0.75,
            upper=1.5,
            neutral=1.0,
            source="Goss texture: Young modulus 110 along to 145 or more across, relative to 200 GPa",
        ),
    ),
    terms=terms,
)
