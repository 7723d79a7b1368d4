"""From a stack to its full equations of motion, every lamina and every interface."""

from __future__ import annotations

import dataclasses

from model.contact.contact import contact_terms
from model.contact.pressing import pressure_distribution
from model.elements.clamping import clamp_terms
from model.elements.equations import OMEGA, Assembly
from model.elements.mesh import FIELDS, plan_of
from model.elements.shell import lamina_terms
from model.elements.support import support_terms
from model.stack.effect import OMEGA_REFERENCE
from model.stack.stack import Stack


def assemble(stack: Stack) -> Assembly:
    """Assemble laminas, contact, clamps, supports and physical effects of a stack.

    The parameters are `G_f` (Pa/Pa), `d_f` (s/Pa), the mean `pressure` (Pa), the factors `young`, `density`,
    `normal_modulus` and, with interlayers, `layer_modulus` on the stack's own values (nominal 1), and those of
    the stack's effects. Contact damping is beta = d_f p times the contact stiffness, tangential and normal. The
    assembly's own stack holds the pressure field that its clamps cause.

    Raises
    ------
    EffectError
        An effect needs something that the stack does not have.
    """
    stack = dataclasses.replace(stack, pressing=pressure_distribution(stack))
    plan = plan_of(stack)
    terms = (
        *lamina_terms(stack, plan),
        *clamp_terms(stack, plan),
        *contact_terms(stack, plan),
        *support_terms(stack, plan),
    )
    contact = stack.contact
    theta = {
        "G_f": contact.G_f,
        "d_f": contact.d_f,
        "pressure": contact.pressure,
        "young": 1.0,
        "density": 1.0,
        "normal_modulus": 1.0,
    }
    if stack.interlayers:
        theta["layer_modulus"] = 1.0
    base = Assembly(
        stack=stack, plan=plan, n_z=dict.fromkeys(FIELDS, stack.n_lamina), terms=terms, theta=theta
    )
    added = tuple(term for effect in stack.effects for term in effect.terms(base))
    frequency = (
        {OMEGA: OMEGA_REFERENCE} if any(effect.frequency_dependent for effect in stack.effects) else {}
    )
    return base.with_terms(added, {**stack.effect_values, **frequency})
