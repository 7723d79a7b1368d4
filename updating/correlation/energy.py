"""Where a displacement of the stack stores its energy: by region and by kind of stiffness, and by mass."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ema.types.arrays import readonly
from model import Modes, ReducedSystem, Stack
from model.contact.pressing import pressure_distribution
from model.elements.mesh import FIELDS, Derivative, Field
from updating.errors import UpdatingError

Vector = NDArray[np.float64]

KINDS = ("lamina membrane", "lamina bending", "tangential contact", "normal contact", "mass")
"""Kinds of stiffness, and the mass last. A soft layer counts as the contact that it takes the place of."""
TERM = {
    "lamina membrane": "laminas",
    "lamina bending": "laminas",
    "tangential contact": "tangential contact",
    "normal contact": "normal contact",
    "mass": "lamina mass",
}
"""The term of the equations of motion that each kind is, or is a part of."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Regions:
    """A division of a stack into boxes.

    Attributes
    ----------
    x, y, z : (n + 1,) float
        Ascending edges of the boxes along each axis, m.
    """

    x: Vector
    y: Vector
    z: Vector

    def __post_init__(self) -> None:
        for name in ("x", "y", "z"):
            edges = readonly("Regions", name, getattr(self, name), (None,))
            if edges.size < 2 or np.any(np.diff(edges) <= 0.0):
                message = f"regions: edges along {name} must ascend and be two at least, got {edges.tolist()}"
                raise UpdatingError(message)
            object.__setattr__(self, name, edges)

    @property
    def shape(self) -> tuple[int, int, int]:
        """Number of boxes along x, y and z."""
        return self.x.size - 1, self.y.size - 1, self.z.size - 1


def regions(stack: Stack, n_x: int = 10, n_y: int = 2, n_z: int = 4) -> Regions:
    """Divide a stack's bounding box into equal boxes."""
    sides = zip((stack.length, stack.width, stack.height), (n_x, n_y, n_z), strict=True)
    x, y, z = (np.linspace(-side / 2.0, side / 2.0, n + 1) for side, n in sides)
    return Regions(x=x, y=y, z=z)


def modal_energy(system: ReducedSystem, modes: Modes, theta: Mapping[str, float], where: Regions) -> Vector:
    """Return the share of each mode's energy by kind and region.

    The four kinds of stiffness share the strain energy of the mode, the mass its kinetic energy; each of the two
    sums to 1, less what effects beyond the plain stack hold.

    Parameters
    ----------
    system : ReducedSystem
        The reduced stack.
    modes : Modes
        Its elastic modes.
    theta : mapping of str to float
        Parameters that they were solved for.
    where : Regions
        The regions.

    Returns
    -------
    (n_mode, n_kind, n_x, n_y, n_z) float
        Kinds in the order of `KINDS`.
    """
    energy = energy_by_region(system, system.basis @ modes.coordinate, theta, where)
    stiffness, mass = (
        np.einsum("ir,ij,jr->r", modes.coordinate, system.matrix(target, theta), modes.coordinate)
        for target in ("K", "M")
    )
    energy[:, :-1] /= stiffness[:, None, None, None, None]
    energy[:, -1] /= mass[:, None, None, None]
    return energy


def energy_by_region(
    system: ReducedSystem, displacement: Vector, theta: Mapping[str, float], where: Regions
) -> Vector:
    """Return x' K x by kind of stiffness, and x' M x, of every region.

    Energies are integrated at the quadrature points of every lamina and interface; a clamp's mass counts where its
    centre is. Supports, and effects beyond the plain stack, are not located.

    Parameters
    ----------
    system : ReducedSystem
        The reduced stack.
    displacement : (assembly.size, n)
        Displacements in the z-reduced coordinates, such as ``system.basis @ modes.coordinate``.
    theta : mapping of str to float
        Parameters.
    where : Regions
        The regions.

    Returns
    -------
    (n, n_kind, n_x, n_y, n_z) float
    """
    points = _Points(system, where)
    scale = _scales(system, theta)
    shear, normal = _contact_moduli(system.stack, points.location)
    found = np.zeros((displacement.shape[1], len(KINDS), *where.shape))
    for i, x in enumerate(displacement.T):
        for j, (kind, density) in enumerate(_densities(points, x, shear, normal).items()):
            found[i, j] = scale[kind] * points.sums(density)
        found[i, -1] += _clamp_energy(system, x, where)
    return found


class _Points:
    """Evaluation of displacements at the quadrature points of all laminas, and sums over regions."""

    def __init__(self, system: ReducedSystem, where: Regions) -> None:
        self.system, self.shape = system, where.shape
        plan = system.assembly.plan
        self.location = plan.quadrature_points.reshape(2, -1)
        self.area = plan.membrane.dx.ravel()
        self.slices = system.assembly.slices()
        self.rows: dict[tuple[Field, Derivative], object] = {}
        n_x, n_y, _ = where.shape
        cell = n_y * _bin(self.location[0], where.x) + _bin(self.location[1], where.y)
        self.to_cell = np.zeros((cell.size, n_x * n_y))
        self.to_cell[np.arange(cell.size), cell] = 1.0
        z = system.stack.lamina_z
        self.layer = {
            z.size: _bin(z, where.z),
            z.size - 1: _bin((z[1:] + z[:-1]) / 2.0, where.z),
        }

    def field(self, x: Vector, field: Field, derivative: Derivative = "") -> Vector:
        """Return a field, or a derivative, at all points, (n_lamina, n_point)."""
        key = (field, derivative)
        if key not in self.rows:
            self.rows[key] = self.system.assembly.plan.at_quadrature(field, derivative)
        coefficient = x[self.slices[field]].reshape(self.system.assembly.n_z[field], -1)
        return np.asarray(self.system.phi[field] @ (self.rows[key] @ coefficient.T).T)  # type: ignore[operator]

    def sums(self, density: Vector) -> Vector:
        """Integrate a density (n_layer, n_point) over the plan of every region, (n_x, n_y, n_z)."""
        n_x, n_y, n_z = self.shape
        over_plan = (density * self.area) @ self.to_cell
        total = np.zeros((n_z, n_x * n_y))
        np.add.at(total, self.layer[density.shape[0]], over_plan)
        return total.T.reshape(n_x, n_y, n_z)


def _bin(value: Vector, edges: Vector) -> NDArray[np.intp]:
    return np.clip(np.searchsorted(edges, value, side="right") - 1, 0, edges.size - 2)


def _scales(system: ReducedSystem, theta: Mapping[str, float]) -> dict[str, float]:
    """Return by how much the factor of each kind's term differs from the stack's own."""
    factor = {term.name: term.factor for term in system.assembly.terms}
    return {kind: factor[TERM[kind]](theta) / factor[TERM[kind]](system.theta) for kind in KINDS}


def _contact_moduli(stack: Stack, location: Vector) -> tuple[Vector, Vector]:
    """Return shear and normal modulus of every interface over the plan, Pa, (n_interface, n_point or 1) each."""
    n = stack.n_lamina - 1
    distribution = pressure_distribution(stack)
    if distribution is None:
        pressure, normal = (
            np.full((n, 1), value) for value in (stack.contact.pressure, stack.contact.normal_modulus)
        )
    else:
        pressure, normal = (np.array(field) for field in distribution.at(location.T))
    shear = stack.contact.G_f * pressure
    for layer in stack.interlayers:
        i = layer.below - 1
        swell = stack.spacing[i] / layer.thickness
        shear[i], normal[i] = layer.shear_modulus * swell, layer.normal_modulus * swell
    return shear, normal


def _densities(points: _Points, x: Vector, shear: Vector, normal: Vector) -> dict[str, Vector]:
    """Return energy per area of every lamina or interface by kind, each (n_layer, n_point).

    Sources: Reddy, Mechanics of Laminated Composite Plates and Shells, 2nd ed., sections 2.4 and 3.3, for the
    laminas; the contact as in `model.contact.contact.tangential` and `model.contact.contact.normal`.
    """
    stack = points.system.stack
    t, spacing = stack.pitch, stack.spacing[:, None]
    q11, q12, q22, q66 = stack.material.plane_stress()

    def at(field: Field, derivative: Derivative = "") -> Vector:
        return points.field(x, field, derivative)

    strain_x, strain_y, strain_xy = at("u", "x"), at("v", "y"), at("u", "y") + at("v", "x")
    curve_x, curve_y, twist = at("w", "xx"), at("w", "yy"), 2.0 * at("w", "xy")
    u, v, w = (at(field) for field in FIELDS)
    slope_x, slope_y = at("w", "x"), at("w", "y")
    slip = [
        np.diff(a, axis=0) / spacing + (slope[1:] + slope[:-1]) / 2.0
        for a, slope in ((u, slope_x), (v, slope_y))
    ]

    def plane(a: Vector, b: Vector, c: Vector) -> Vector:
        return np.asarray(q11 * a**2 + q22 * b**2 + 2.0 * q12 * a * b + q66 * c**2)

    rotation = t**2 / 12.0 * (slope_x**2 + slope_y**2)
    densities = (
        t * plane(strain_x, strain_y, strain_xy),
        t**3 / 12.0 * plane(curve_x, curve_y, twist),
        shear * spacing * (slip[0] ** 2 + slip[1] ** 2),
        normal / spacing * np.diff(w, axis=0) ** 2,
        stack.material.density * t * (u**2 + v**2 + w**2 + rotation),
    )
    return dict(zip(KINDS, densities, strict=True))


def _clamp_energy(system: ReducedSystem, x: Vector, where: Regions) -> Vector:
    """Return x' M x of the clamps, each lamina's share in the region of the clamp's centre, (n_x, n_y, n_z)."""
    stack, assembly = system.stack, system.assembly
    term = {term.name: term for term in system.laminas.terms}
    layer = _bin(stack.lamina_z, where.z)
    found = np.zeros(where.shape)
    for i, clamp in enumerate(stack.clamps):
        column = _bin(np.array([clamp.x]), where.x)[0], _bin(np.array([clamp.y]), where.y)[0]
        for kron in term[f"clamp {i} mass"].krons:
            coefficient = x[assembly.slices()[kron.row]].reshape(assembly.n_z[kron.row], -1)
            on_laminas = system.phi[kron.row] @ coefficient
            energy = kron.z.diagonal() * np.sum(on_laminas * (kron.planar @ on_laminas.T).T, axis=1)
            np.add.at(found[column], layer, energy)
    return found
