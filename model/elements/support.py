"""Supports: edges and patches of the laminas held by springs to the ground."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
import scipy.sparse as sp
import skfem
from numpy.typing import NDArray

from model.elements.clamping import footprint_points
from model.elements.equations import Kron, Monomial, Term
from model.elements.mesh import FIELDS, Field, Plan
from model.stack.parts import Edge, EdgeSupport, PatchSupport
from model.stack.stack import Stack

_HELD = 1e5  # stiffness that stands for an infinite one, relative to a lamina's over one element
_ON_LINE = 1e-9  # of the plan's size


def edge_matrix(plan: Plan, field: str, edge: Edge, *, slope: bool = False) -> sp.csr_matrix:
    """Integrate the square of a field, or of its slope normal to the edge, along an edge.

    Parameters
    ----------
    plan : Plan
        The lamina's mesh.
    field : "u", "v" or "w"
        The field.
    edge : "left", "right", "front", "back" or "all"
        Lowest or highest x, lowest or highest y, or the whole boundary with its holes.
    slope : bool
        Whether the normal slope is meant.
    """
    basis = plan.basis(field)  # type: ignore[arg-type]
    mesh = basis.mesh
    facets = mesh.boundary_facets()
    if edge != "all":
        axis, side = {"left": (0, 0), "right": (0, 1), "front": (1, 0), "back": (1, 1)}[edge]
        line = plan.bounds[axis][side]
        ends = mesh.p[axis][mesh.facets[:, facets]]
        facets = facets[np.all(np.abs(ends - line) < _ON_LINE * np.ptp(plan.bounds), axis=0)]
    along = skfem.FacetBasis(mesh, basis.elem, mapping=basis.mapping, facets=facets, intorder=6)
    if slope:
        normal = np.asarray(along.normals)
        values = np.array([np.einsum("ieq,ieq->eq", f[0].grad, normal) for f in along.basis])
    else:
        values = np.array([np.broadcast_to(f[0], along.dx.shape) for f in along.basis])
    blocks = np.einsum("ieq,jeq->eij", values * along.dx, values)
    dofs = along.element_dofs
    rows = np.broadcast_to(dofs.T[:, :, None], blocks.shape)
    columns = np.broadcast_to(dofs.T[:, None, :], blocks.shape)
    return sp.coo_matrix((blocks.ravel(), (rows.ravel(), columns.ravel())), (basis.N, basis.N)).tocsr()


@dataclass(frozen=True, eq=False, kw_only=True)
class HeldMotion:
    """One motion that a support holds.

    Attributes
    ----------
    kron : Kron
        Its stiffness.
    stiffness : float
        Per length of the edge or area of the patch, and lamina; that of a rigid hold is 1e5 times that of a lamina over
        one element.
    turns : bool
        Whether it is turning about the edge.
    """

    kron: Kron
    stiffness: float
    turns: bool


def held_motions(stack: Stack, plan: Plan, support: EdgeSupport | PatchSupport) -> tuple[HeldMotion, ...]:
    """Return the motions that a support holds."""
    t = stack.pitch
    q11 = stack.material.plane_stress()[0]
    size = float(np.sqrt(plan.area / plan.membrane.mesh.t.shape[1]))
    held = {
        "along": q11 * t / size,
        "across": q11 * t**3 / 12.0 / size**3,
        "rotation": q11 * t**3 / 12.0 / size,
    }
    z = sp.diags_array(_held_laminas(support.laminas, stack.n_lamina)).tocsr()
    per = 1.0 if isinstance(support, EdgeSupport) else size
    found = []

    def hold(field: Field, name: str, planar: Callable[[], sp.csr_matrix]) -> None:
        stiffness = getattr(support, name)
        stiffness = _HELD * held[name] / per if np.isinf(stiffness) else stiffness
        if stiffness > 0.0:
            kron = Kron(row=field, column=field, z=stiffness * z, planar=planar())
            found.append(HeldMotion(kron=kron, stiffness=stiffness, turns=name == "rotation"))

    for f in FIELDS:
        name = "across" if f == "w" else "along"
        if isinstance(support, EdgeSupport):
            hold(f, name, partial(edge_matrix, plan, f, support.edge))
        else:
            hold(f, name, partial(_patch_matrix, plan, f, support))
    if isinstance(support, EdgeSupport):
        hold("w", "rotation", partial(edge_matrix, plan, "w", support.edge, slope=True))
    return tuple(found)


def support_terms(stack: Stack, plan: Plan) -> tuple[Term, ...]:
    """Return the stiffness of each support; an infinite one is 1e5 times that of a lamina over one element."""
    return tuple(
        Term(
            name=f"support {i}",
            target="K",
            factor=Monomial(exponent={}),
            krons=tuple(motion.kron for motion in held_motions(stack, plan, support)),
        )
        for i, support in enumerate(stack.supports)
    )


def _patch_matrix(plan: Plan, field: str, support: PatchSupport) -> sp.csr_matrix:
    points, weights = footprint_points((support.x, support.y), support.size, plan)
    rows = plan.point_rows(field, points)  # type: ignore[arg-type]
    area = support.size[0] * support.size[1]
    return (rows.T @ sp.diags_array(weights * area) @ rows).tocsr()


def _held_laminas(laminas: str, n_lamina: int) -> NDArray[np.float64]:
    held = np.zeros(n_lamina)
    if laminas == "all":
        held[:] = 1.0
    if laminas in ("bottom", "faces"):
        held[0] = 1.0
    if laminas in ("top", "faces"):
        held[-1] = 1.0
    return held
