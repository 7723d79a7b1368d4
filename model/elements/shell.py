"""The laminas themselves: membrane stiffness, plate bending (Kirchhoff) and inertia of thin sheets."""

from __future__ import annotations

import scipy.sparse as sp

from model.elements.equations import Kron, Monomial, Term
from model.elements.mesh import Plan
from model.stack.stack import Stack


def plate_form(plan: Plan, stiffness: tuple[float, float, float, float]) -> sp.csr_matrix:
    """Return the bending form of a thin plate per thickness**3 / 12 (Reddy, section 3.3).

    Parameters
    ----------
    plan : Plan
        The lamina's mesh.
    stiffness : (Q11, Q12, Q22, Q66)
        Plane-stress stiffnesses, Pa.
    """
    q11, q12, q22, q66 = stiffness
    form = plan.form
    mixed = form("w", "w", ("xx", "yy"))
    return (
        q11 * form("w", "w", ("xx", "xx"))
        + q22 * form("w", "w", ("yy", "yy"))
        + q12 * (mixed + mixed.T)
        + 4.0 * q66 * form("w", "w", ("xy", "xy"))
    ).tocsr()


def lamina_terms(stack: Stack, plan: Plan) -> tuple[Term, ...]:
    """Return stiffness and mass of all laminas.

    Each lamina of thickness t has membrane stiffness t Q and bending stiffness t**3/12 Q with the
    plane-stress stiffnesses Q (Reddy, Mechanics of Laminated Composite Plates and Shells, 2nd ed., sections
    2.4 and 3.3). The factors `young` and `density` scale the stack's own values, so their nominal value is
    1.
    """
    t = stack.pitch
    q11, q12, q22, q66 = stack.material.plane_stress()
    each = sp.eye_array(stack.n_lamina, format="csr")
    form = plan.form

    k_uu = q11 * form("u", "u", ("x", "x")) + q66 * form("u", "u", ("y", "y"))
    k_vv = q22 * form("v", "v", ("y", "y")) + q66 * form("v", "v", ("x", "x"))
    k_uv = q12 * form("u", "v", ("x", "y")) + q66 * form("u", "v", ("y", "x"))
    k_ww = plate_form(plan, stack.material.plane_stress())
    mass = form("u", "u")
    slope = form("w", "w", ("x", "x")) + form("w", "w", ("y", "y"))
    rho_t = stack.material.density * t
    return (
        Term(
            name="laminas",
            target="K",
            factor=Monomial(exponent={"young": 1}),
            krons=(
                Kron(row="u", column="u", z=t * each, planar=k_uu),
                Kron(row="v", column="v", z=t * each, planar=k_vv),
                Kron(row="u", column="v", z=t * each, planar=k_uv),
                Kron(row="w", column="w", z=t**3 / 12.0 * each, planar=k_ww),
            ),
        ),
        Term(
            name="lamina mass",
            target="M",
            factor=Monomial(exponent={"density": 1}),
            krons=(
                Kron(row="u", column="u", z=rho_t * each, planar=mass),
                Kron(row="v", column="v", z=rho_t * each, planar=mass),
                Kron(row="w", column="w", z=rho_t * each, planar=form("w", "w") + t**2 / 12.0 * slope),
            ),
        ),
    )
