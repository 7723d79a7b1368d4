"""From a stack to its full equations of motion, every lamina and every interface."""

from __future__ import annotations

from model.clamping import clamp_terms
from model.contact import contact_terms
from model.mesh import FIELDS, plan_of
from model.shell import lamina_terms
from model.stack import Stack
from model.support import support_terms
from model.system import Assembly


def assemble(stack: Stack) -> Assembly:
    """Assemble laminas, contact, clamps and supports of a stack.

    The parameters are `G_f` (Pa/Pa), `d_f` (s/Pa) and the factors `young`, `density`, `normal_modulus` and, with
    interlayers, `layer_modulus` on the stack's own values (nominal 1). Contact damping is beta = d_f p times
    the contact stiffness, tangential and normal.
    """
    plan = plan_of(stack)
    terms = (
        *lamina_terms(stack, plan),
        *clamp_terms(stack, plan),
        *contact_terms(stack, plan),
        *support_terms(stack, plan),
    )
    contact = stack.contact
    theta = {"G_f": contact.G_f, "d_f": contact.d_f, "young": 1.0, "density": 1.0, "normal_modulus": 1.0}
    if stack.interlayers:
        theta["layer_modulus"] = 1.0
    return Assembly(plan=plan, n_z=dict.fromkeys(FIELDS, stack.n_lamina), terms=terms, theta=theta)
