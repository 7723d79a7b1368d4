"""From a stack to its full equations of motion, every lamina and every interface."""

from __future__ import annotations

import numpy as np

from model.clamping import clamp_terms
from model.mesh import FIELDS, plan_of
from model.normal_contact import normal_krons
from model.shell import lamina_terms
from model.stack import Stack
from model.system import Assembly, Monomial, Term
from model.tangential_contact import tangential_krons


def assemble(stack: Stack) -> Assembly:
    """Assemble laminas, contact and clamps of a stack under uniform pressure.

    The parameters are `G_f` (Pa/Pa), `d_f` (s/Pa) and the factors `young`, `density` and `normal_modulus`
    on the stack's own values (nominal 1). Contact damping is beta = d_f p times the contact stiffness,
    tangential and normal.
    """
    plan = plan_of(stack)
    contact = stack.contact
    pressure = np.full(stack.n_lamina - 1, contact.pressure)
    normal = np.full(stack.n_lamina - 1, contact.normal_modulus)

    def term(name: str, target: str, powers: dict[str, int], krons: tuple) -> Term:  # type: ignore[type-arg]
        return Term(name=name, target=target, factor=Monomial(exponent=powers), krons=krons)  # type: ignore[arg-type]

    terms = (
        *lamina_terms(stack, plan),
        *clamp_terms(stack, plan),
        term("tangential contact", "K", {"G_f": 1}, tangential_krons(plan, stack.pitch, pressure)),
        term("normal contact", "K", {"normal_modulus": 1}, normal_krons(plan, stack.pitch, normal)),
        term(
            "tangential contact damping",
            "C",
            {"d_f": 1, "G_f": 1},
            tangential_krons(plan, stack.pitch, pressure**2),
        ),
        term(
            "normal contact damping",
            "C",
            {"d_f": 1, "normal_modulus": 1},
            normal_krons(plan, stack.pitch, pressure * normal),
        ),
    )
    theta = {"G_f": contact.G_f, "d_f": contact.d_f, "young": 1.0, "density": 1.0, "normal_modulus": 1.0}
    return Assembly(plan=plan, n_z=dict.fromkeys(FIELDS, stack.n_lamina), terms=terms, theta=theta)
