"""Terms of the equations of motion: laminas, clamps that ride on them, supports; and motion as a rigid body.

A clamp's effective mass moves with the mean displacement of the area that it presses, so it brings no rotary inertia of
its own. A mass at a point of a thin lamina would swing on the contact around it instead: on the faces, such local modes
crowd the band of the stack's own.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
import scipy.sparse as sp
import skfem

from lamella_shared import Reals
from model.elements.equations import Assembly, Kron, Monomial, Term
from model.elements.mesh import FIELDS, Field, Plan
from model.stack.parts import Clamp, Edge, EdgeSupport, PatchSupport
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


def footprint_points(centre: tuple[float, float], size: tuple[float, float], plan: Plan) -> tuple[Reals, Reals]:
    """Return points (n, 2) of a rectangle on the plan and their weights (n,), which sum to 1.

    The rectangle is cut along the lines of the mesh, with three Gauss points in each direction between them, so
    means and first moments over it are exact for the fields of a rectangle; what overhangs the plan's bounding box does
    not count.
    """
    most_panels = 24  # along one side of a footprint
    nodes, weights = np.polynomial.legendre.leggauss(3)
    places, shares = [], []
    for axis, (middle, side) in enumerate(zip(centre, size, strict=True)):
        start, stop = plan.bounds[axis]
        low, high = max(middle - side / 2.0, start), min(middle + side / 2.0, stop)
        lines = np.unique(plan.membrane.mesh.p[axis])
        lines = lines[(lines > low) & (lines < high)]
        if lines.size >= most_panels:
            lines = np.linspace(low, high, most_panels + 1)[1:-1]
        cuts = np.concatenate([[low], lines, [high]])
        half = np.diff(cuts)[:, None] / 2.0
        places.append((cuts[:-1, None] + half * (1.0 + nodes)).ravel())
        share = half / half.sum() if high > low else np.ones((1, 1))
        shares.append((share * weights / 2.0).ravel())
    x, y = np.meshgrid(*places, indexing="ij")
    return np.column_stack([x.ravel(), y.ravel()]), np.outer(*shares).ravel()


def height_shares(clamp: Clamp, n_lamina: int) -> Reals:
    """Return which share of a clamp's mass each lamina carries, (n_lamina,)."""
    if clamp.distribution == "height":
        return np.full(n_lamina, 1.0 / n_lamina)
    shares = np.zeros(n_lamina)
    shares[0] += 0.5
    shares[-1] += 0.5
    return shares


def clamp_terms(stack: Stack, plan: Plan) -> tuple[Term, ...]:
    """Return the mass of each clamp, moving with u, v and w of the laminas that carry it."""
    terms = []
    for i, clamp in enumerate(stack.clamps):
        points, weights = footprint_points((clamp.x, clamp.y), clamp.footprint, plan)
        z = sp.diags_array(clamp.mass * height_shares(clamp, stack.n_lamina)).tocsr()
        krons = []
        for field in FIELDS:
            mean = sp.csr_matrix(weights @ plan.point_rows(field, points))
            krons.append(Kron(row=field, column=field, z=z, planar=(mean.T @ mean).tocsr()))
        terms.append(Term(name=f"clamp {i} mass", target="M", factor=Monomial(exponent={}), krons=tuple(krons)))
    return tuple(terms)


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
    on_line = 1e-9  # of the plan's size
    basis = plan.basis(field)  # type: ignore[arg-type]
    mesh = basis.mesh
    facets = mesh.boundary_facets()
    if edge != "all":
        axis, side = {"left": (0, 0), "right": (0, 1), "front": (1, 0), "back": (1, 1)}[edge]
        line = plan.bounds[axis][side]
        ends = mesh.p[axis][mesh.facets[:, facets]]
        facets = facets[np.all(np.abs(ends - line) < on_line * np.ptp(plan.bounds), axis=0)]
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
    as_infinite = 1e5  # stiffness that stands for an infinite one, relative to a lamina's over one element
    t = stack.pitch
    q11 = stack.material.plane_stress()[0]
    size = float(np.sqrt(plan.area / plan.membrane.mesh.t.shape[1]))
    held = {"along": q11 * t / size, "across": q11 * t**3 / 12.0 / size**3, "rotation": q11 * t**3 / 12.0 / size}
    z = sp.diags_array(_held_laminas(support.laminas, stack.n_lamina)).tocsr()
    per = 1.0 if isinstance(support, EdgeSupport) else size
    found = []

    def hold(field: Field, name: str, planar: Callable[[], sp.csr_matrix]) -> None:
        stiffness = getattr(support, name)
        stiffness = as_infinite * held[name] / per if np.isinf(stiffness) else stiffness
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


def _held_laminas(laminas: str, n_lamina: int) -> Reals:
    held = np.zeros(n_lamina)
    if laminas == "all":
        held[:] = 1.0
    if laminas in ("bottom", "faces"):
        held[0] = 1.0
    if laminas in ("top", "faces"):
        held[-1] = 1.0
    return held


def rigid_body_modes(assembly: Assembly, stack: Stack, phi: Mapping[Field, Reals]) -> Reals:
    """Return three translations and three rotations, (assembly.size, 6).

    `phi` holds the through-thickness functions of the assembly's coordinates, (n_lamina, n_z) for each field: the
    identity where they are the laminas themselves.
    """
    plan, where = assembly.plan, assembly.slices()
    one = np.ones(stack.n_lamina)

    def planar(field: Field, function: str) -> Reals:
        return plan.interpolate(field, {"1": (1.0, 0.0, 0.0), "x": (0.0, 1.0, 0.0), "y": (0.0, 0.0, 1.0)}[function])

    modes = np.zeros((assembly.size, 6))

    def add(mode: int, field: Field, over_z: Reals, function: str, sign: float = 1.0) -> None:
        modes[where[field], mode] = sign * np.outer(phi[field].T @ over_z, planar(field, function)).ravel()

    add(0, "u", one, "1")
    add(1, "v", one, "1")
    add(2, "w", one, "1")
    add(3, "v", stack.lamina_z, "1", -1.0)
    add(3, "w", one, "y")
    add(4, "u", stack.lamina_z, "1")
    add(4, "w", one, "x", -1.0)
    add(5, "u", one, "y", -1.0)
    add(5, "v", one, "x")
    return modes
