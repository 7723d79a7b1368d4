"""Contact lumped in springs between the nodes of neighbouring laminas, as the paper has it, to show the difference.

Between nodes a thin lamina bends and bypasses such springs, so frequencies do not converge with the mesh as they do
with contact integrated over the area (`tangential_contact`). It is here for comparison alone.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import scipy.sparse as sp

from model.contact.contact import jump, mean, tangential_krons
from model.elements.equations import Assembly, Kron, Monomial, Term
from model.elements.mesh import Derivative, Field, Plan
from model.stack.stack import Stack


def nodal_krons(plan: Plan, stack: Stack, modulus: float) -> tuple[Kron, ...]:
    """Return the tangential stiffness of springs at the corners of a rectangle's mesh.

    Each node stands for its share of the area, so a spring works on the slip u[k+1] - u[k] + pitch dw/dx of two
    nodes above each other, and the same in y (Pirnat et al. 2013, Fig. 10).

    Parameters
    ----------
    plan : Plan
        The lamina's mesh.
    stack : Stack
        A stack without interlayers.
    modulus : float
        Shear modulus of the contact, Pa.
    """
    mesh = plan.membrane.mesh
    share = np.repeat(plan.membrane.dx.sum(axis=1) / mesh.t.shape[0], mesh.t.shape[0])
    area = np.bincount(mesh.t.T.ravel(), share, minlength=mesh.p.shape[1])
    at_nodes = sp.diags_array(area)
    d, a = jump(stack.n_lamina), mean(stack.n_lamina)
    krons: list[Kron] = []
    directions: tuple[tuple[Field, Derivative], ...] = (("u", "x"), ("v", "y"))
    for field, slope in directions:
        slip = plan.point_rows(field, mesh.p.T)
        turn = plan.point_rows("w", mesh.p.T, slope)
        products: tuple[tuple[Field, Field, Any, Any], ...] = (
            (field, field, d.T @ d / stack.pitch, slip.T @ at_nodes @ slip),
            (field, "w", d.T @ a, slip.T @ at_nodes @ turn),
            ("w", "w", a.T @ a * stack.pitch, turn.T @ at_nodes @ turn),
        )
        krons += [
            Kron(row=row, column=column, z=modulus * z, planar=planar.tocsr()) for row, column, z, planar in products
        ]
    return tuple(krons)


def nodal_instead(stack: Stack) -> Callable[[Assembly], tuple[Term, ...]]:
    """Return what puts nodal springs in the place of integrated contact where the parameter `nodal` is 1.

    To be given to `reduce` as `terms` with ``theta={"nodal": 1.0}``, for a rectangle under uniform pressure.
    """

    def terms(assembly: Assembly) -> tuple[Term, ...]:
        pressure = stack.contact.pressure
        uniform = np.full(stack.n_lamina - 1, -pressure)
        krons = (*nodal_krons(assembly.plan, stack, pressure), *tangential_krons(assembly.plan, stack.spacing, uniform))
        factor = Monomial(exponent={"G_f": 1, "nodal": 1})
        return (Term(name="nodal contact", target="K", factor=factor, krons=krons),)

    return terms
