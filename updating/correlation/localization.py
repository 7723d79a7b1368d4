"""Where the model is wrong: the energy of shapes by region and kind of stiffness, and a map of the model's error."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields

import numpy as np
import scipy
import scipy.linalg as la
from numpy.typing import NDArray

from ema.modal.mac import real_shape
from ema.types.modal_model import ModalModel
from lamella_shared import Integers, Reals, readonly
from model import Observation, ReducedSystem, Stack
from model.contact.pressing import pressure_distribution
from model.elements.mesh import FIELDS, Derivative, Field
from model.modes.modes import full_parameters, observe
from model.reduction.reduction import shifted_factor
from model.solvers.eigen import orthonormalize
from updating.errors import UpdatingError

ENERGY_KINDS = ("lamina membrane", "lamina bending", "tangential contact", "normal contact", "mass")
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

    x: Reals
    y: Reals
    z: Reals

    def __post_init__(self) -> None:
        for name in ("x", "y", "z"):
            edges = readonly("Regions", name, getattr(self, name), (None,))
            if edges.size < 2 or np.any(np.diff(edges) <= 0.0):
                raise UpdatingError(
                    f"regions: edges along {name} must ascend and be two at least, got {edges.tolist()}"
                )
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


def energy_by_region(system: ReducedSystem, displacement: Reals, theta: Mapping[str, float], where: Regions) -> Reals:
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
    factor = {term.name: term.factor for term in system.assembly.terms}
    scale = {kind: factor[TERM[kind]](theta) / factor[TERM[kind]](system.theta) for kind in ENERGY_KINDS}
    shear, normal = _contact_moduli(system.stack, points.location)
    found = np.zeros((displacement.shape[1], len(ENERGY_KINDS), *where.shape))
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
        self.layer = {z.size: _bin(z, where.z), z.size - 1: _bin((z[1:] + z[:-1]) / 2.0, where.z)}

    def field(self, x: Reals, field: Field, derivative: Derivative = "") -> Reals:
        """Return a field, or a derivative, at all points, (n_lamina, n_point)."""
        key = (field, derivative)
        if key not in self.rows:
            self.rows[key] = self.system.assembly.plan.at_quadrature(field, derivative)
        coefficient = x[self.slices[field]].reshape(self.system.assembly.n_z[field], -1)
        return np.asarray(self.system.phi[field] @ (self.rows[key] @ coefficient.T).T)  # type: ignore[operator]

    def sums(self, density: Reals) -> Reals:
        """Integrate a density (n_layer, n_point) over the plan of every region, (n_x, n_y, n_z)."""
        n_x, n_y, n_z = self.shape
        over_plan = (density * self.area) @ self.to_cell
        total = np.zeros((n_z, n_x * n_y))
        np.add.at(total, self.layer[density.shape[0]], over_plan)
        return total.T.reshape(n_x, n_y, n_z)


def _bin(value: Reals, edges: Reals) -> NDArray[np.intp]:
    return np.clip(np.searchsorted(edges, value, side="right") - 1, 0, edges.size - 2)


def _contact_moduli(stack: Stack, location: Reals) -> tuple[Reals, Reals]:
    """Return shear and normal modulus of every interface over the plan, Pa, (n_interface, n_point or 1) each."""
    n = stack.n_lamina - 1
    distribution = pressure_distribution(stack)
    if distribution is None:
        pressure, normal = (np.full((n, 1), value) for value in (stack.contact.pressure, stack.contact.normal_modulus))
    else:
        pressure, normal = (np.array(field) for field in distribution.at(location.T))
    shear = stack.contact.G_f * pressure
    for layer in stack.interlayers:
        i = layer.below - 1
        swell = stack.spacing[i] / layer.thickness
        shear[i], normal[i] = layer.shear_modulus * swell, layer.normal_modulus * swell
    return shear, normal


def _densities(points: _Points, x: Reals, shear: Reals, normal: Reals) -> dict[str, Reals]:
    """Return energy per area of every lamina or interface by kind, each (n_layer, n_point).

    Sources: Reddy, Mechanics of Laminated Composite Plates and Shells, 2nd ed., sections 2.4 and 3.3, for the
    laminas; the contact as in `model.contact.contact.tangential` and `model.contact.contact.normal`.
    """
    stack = points.system.stack
    t, spacing = stack.pitch, stack.spacing[:, None]
    q11, q12, q22, q66 = stack.material.plane_stress()

    def at(field: Field, derivative: Derivative = "") -> Reals:
        return points.field(x, field, derivative)

    strain_x, strain_y, strain_xy = at("u", "x"), at("v", "y"), at("u", "y") + at("v", "x")
    curve_x, curve_y, twist = at("w", "xx"), at("w", "yy"), 2.0 * at("w", "xy")
    u, v, w = (at(field) for field in FIELDS)
    slope_x, slope_y = at("w", "x"), at("w", "y")
    slip = [np.diff(a, axis=0) / spacing + (slope[1:] + slope[:-1]) / 2.0 for a, slope in ((u, slope_x), (v, slope_y))]

    def plane(a: Reals, b: Reals, c: Reals) -> Reals:
        return np.asarray(q11 * a**2 + q22 * b**2 + 2.0 * q12 * a * b + q66 * c**2)

    rotation = t**2 / 12.0 * (slope_x**2 + slope_y**2)
    densities = (
        t * plane(strain_x, strain_y, strain_xy),
        t**3 / 12.0 * plane(curve_x, curve_y, twist),
        shear * spacing * (slip[0] ** 2 + slip[1] ** 2),
        normal / spacing * np.diff(w, axis=0) ** 2,
        stack.material.density * t * (u**2 + v**2 + w**2 + rotation),
    )
    return dict(zip(ENERGY_KINDS, densities, strict=True))


def _clamp_energy(system: ReducedSystem, x: Reals, where: Regions) -> Reals:
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


_OMEGA = "omega"  # the parameter of stiffness that depends on frequency, where there is such


@dataclass(frozen=True, eq=False, kw_only=True)
class ErrorMap:
    """The error in constitutive relation over the stack.

    Attributes
    ----------
    regions : Regions
        The boxes of the map.
    frequency : (n_mode,) float
        Measured natural frequencies of the modes that it is made from, Hz.
    error : (n_mode, n_stiffness, n_x, n_y, n_z) float
        e' K e of each kind of stiffness (`ENERGY_KINDS` without the mass) and region, over u' K u of the whole mode.
    strain : (n_mode, n_stiffness, n_x, n_y, n_z) float
        u' K u likewise.
    total : (n_mode,) float
        e' K e over u' K u of each mode, terms that are not located included. Its root is about the relative
        error of the stiffness.
    floor : (n_mode,) float
        The total that the standard deviation of the measured frequency alone would give a right model. A map
        whose totals are not far above it shows noise.
    misfit : (n_mode,) float
        Root mean square of measured less expanded shape over its standard deviation; 1 by construction, and less
        where the model meets the shape anyway.
    explained : (n_kind,) float
        Share of the squared eigenvalue errors of the expanded shapes that one common change of all of a kind
        explains, in the order of `ENERGY_KINDS`. The shares of kinds overlap: less stiffness and more mass look alike.
    change : (n_kind,) float
        That change, as a ratio: -0.2 asks for a fifth less stiffness (or mass) of that kind. Where it lies far beyond
        -1 or 1, that kind is not what is wrong, however much it explains.
    """

    regions: Regions
    frequency: Reals
    error: Reals
    strain: Reals
    total: Reals
    floor: Reals
    misfit: Reals
    explained: Reals
    change: Reals

    def __post_init__(self) -> None:
        n_mode, n_kind = np.size(self.frequency), len(ENERGY_KINDS)
        by_region = (n_mode, n_kind - 1, *self.regions.shape)
        shapes = {"error": by_region, "strain": by_region, "explained": (n_kind,), "change": (n_kind,)}
        for field in fields(self):
            if field.name != "regions":
                array = readonly("ErrorMap", field.name, getattr(self, field.name), shapes.get(field.name, (n_mode,)))
                object.__setattr__(self, field.name, array)

    @property
    def relative(self) -> Reals:
        """Error over strain energy of all modes together by kind and region, (n_stiffness, n_x, n_y, n_z).

        1 is the mean of the kind. Regions that hardly strain are damped towards 0.
        """
        floor = 0.05  # of the mean strain energy of a region: below it a ratio to it says nothing
        error, strain = self.error.sum(axis=0), self.strain.sum(axis=0)
        mean = strain.mean(axis=(1, 2, 3), keepdims=True)
        ratio = _over(error, strain + floor * mean)
        return ratio * _over(mean, error.mean(axis=(1, 2, 3), keepdims=True))

    @property
    def contrast(self) -> Reals:
        """How unlike error and strain energy of each kind are spread, (n_stiffness,).

        The total variation distance of the two: 0 where the error follows the strain energy, as it does when a kind is
        wrong everywhere alike, towards 1 where it sits in one place.
        """
        error, strain = (a.sum(axis=0).reshape(a.shape[1], -1) for a in (self.error, self.strain))
        shares = [_over(a, a.sum(axis=1, keepdims=True)) for a in (error, strain)]
        return np.asarray(np.abs(shares[0] - shares[1]).sum(axis=1) / 2.0)

    def peak(self, kind: str) -> tuple[Reals, Reals]:
        """Return the lower and the upper corner, (3,) m each, of the region where `relative` is largest.

        Raises
        ------
        UpdatingError
            There is no such kind of stiffness.
        """
        index = np.unravel_index(np.argmax(self.relative[stiffness_index(kind)]), self.regions.shape)
        edges = (self.regions.x, self.regions.y, self.regions.z)
        low, high = (np.array([edge[i + step] for edge, i in zip(edges, index, strict=True)]) for step in (0, 1))
        return low, high


def stiffness_index(kind: str) -> int:
    """Return the place of a kind of stiffness in `ENERGY_KINDS`.

    Raises
    ------
    UpdatingError
        There is no such kind.
    """
    if kind not in ENERGY_KINDS[:-1]:
        raise UpdatingError(f"unknown kind of stiffness {kind!r}; there are {', '.join(ENERGY_KINDS[:-1])}")
    return ENERGY_KINDS.index(kind)


def map_error(
    system: ReducedSystem,
    measured: ModalModel,
    observation: Observation,
    where: Regions,
    *,
    G_f: float,
    modes: Integers,
    parameters: Mapping[str, float] | None = None,
) -> ErrorMap:
    """Map the error in constitutive relation of a model against measured modes.

    It is solved on the z-reduced equations, in the span of the reduced basis and of the answers to forces at the
    measured points, static and quasi-static, which is all that the optimum is made of.

    Parameters
    ----------
    system : ReducedSystem
        The model.
    measured : ModalModel
        Identified modes.
    observation : Observation
        The measured DOFs on the model, `Registration.observation`.
    where : Regions
        The regions, `regions(stack)`.
    G_f : float
        Contact stiffness of the model, Pa/Pa.
    modes : (n,) int
        Columns of the measured modes to use, such as `Pairing.measured`; the lowest half a dozen locate best.
    parameters : mapping of str to float, optional
        Further parameters that differ from `system.theta`.

    Raises
    ------
    UpdatingError
        No modes are given.
    """
    if np.size(modes) == 0:
        raise UpdatingError("an error map needs at least one measured mode; none was given")
    theta = full_parameters(system, G_f, system.theta["d_f"], parameters)
    basis, rows = _span(system, observation, theta)
    found = _optima(system, theta, basis, rows, measured, modes)
    u, e = basis @ np.column_stack([f.u for f in found]), basis @ np.column_stack([f.e for f in found])
    explained, change = _common_changes(found)
    return ErrorMap(
        regions=where,
        frequency=measured.frequency[modes],
        error=energy_by_region(system, e, theta, where)[:, :-1],
        strain=energy_by_region(system, u, theta, where)[:, :-1],
        total=np.array([f.e @ f.stiffness @ f.e for f in found]),
        floor=(2.0 * measured.frequency_std[modes] / measured.frequency[modes]) ** 2,
        misfit=np.array([f.misfit for f in found]),
        explained=explained,
        change=change,
    )


def _optima(
    system: ReducedSystem, theta: Mapping[str, float], basis: Reals, rows: Reals, measured: ModalModel, modes: Integers
) -> list[_Fields]:
    """Return the optimum of each measured mode in the span of the basis, in which `rows` are the measured DOFs."""
    # Errors of places, directions and calibration of the sensors, relative to a shape's root mean square
    sensor_scatter = 0.01
    matrices = _matrices(system, basis, theta)
    found = []
    for r in modes:
        omega = 2.0 * np.pi * float(measured.frequency[r])
        if _OMEGA in theta:
            matrices = _matrices(system, basis, {**theta, _OMEGA: omega})
        shape = real_shape(measured.shape[:, [r]])[:, 0]
        std = np.hypot(measured.shape_std[:, r], sensor_scatter * np.sqrt(np.mean(shape**2)))
        found.append(_solve(matrices, omega, rows / std[:, None], shape / std))
    return found


Matrices = dict[str, Reals]
"""Stiffness of each kind, of "other" terms, and the "mass", in the span of the solution."""


def _span(system: ReducedSystem, observation: Observation, theta: Mapping[str, float]) -> tuple[Reals, Reals]:
    """Return a mass-orthonormal basis (assembly.size, n) of the solutions and the measured rows in it."""
    assembly, rows = system.assembly, observe(system, observation).rows
    mass = assembly.krons("M", theta)

    def product(x: Reals) -> Reals:
        return np.asarray(assembly.apply(mass, x))

    factor = shifted_factor(system.assembly, theta)
    static = factor.solve(rows.T.toarray())
    answers = np.hstack([static, factor.solve(product(static))])
    displaced = system.basis[:, : system.n_displaced]
    attachment, _ = orthonormalize(answers, product, [(displaced, product(displaced))])
    basis = np.hstack([displaced, attachment])
    return basis, np.asarray(rows @ basis)


def _matrices(system: ReducedSystem, basis: Reals, theta: Mapping[str, float]) -> Matrices:
    """Project the terms on the basis, by kind."""
    size = basis.shape[1]
    found: Matrices = {kind: np.zeros((size, size)) for kind in (*ENERGY_KINDS, "other")}
    kind_of = {name: kind for kind, name in TERM.items() if name != "laminas"}
    for term in system.assembly.terms:
        if term.target == "C":
            continue
        if term.name == "laminas":
            parts = {
                "lamina bending": tuple(k for k in term.krons if k.row == k.column == "w"),
                "lamina membrane": tuple(k for k in term.krons if not k.row == k.column == "w"),
            }
        else:
            parts = {"mass" if term.target == "M" else kind_of.get(term.name, "other"): term.krons}
        for kind, krons in parts.items():
            found[kind] += term.factor(theta) * (basis.T @ system.assembly.apply(krons, basis))
    return {kind: (matrix + matrix.T) / 2.0 for kind, matrix in found.items()}


@dataclass(frozen=True, eq=False, kw_only=True)
class _Fields:
    """The optimum for one mode, scaled to u' K u = 1, with the matrices that it was found with."""

    u: Reals
    e: Reals
    misfit: float
    omega: float
    matrices: Matrices
    stiffness: Reals


def _solve(matrices: Matrices, omega: float, rows: Reals, shape: Reals) -> _Fields:
    """Find u and e for whitened rows and shape.

    With A = K - omega**2 M the optimum has A e = L' m for multipliers m at the measured points, and u = A^-1 K e,
    so everything follows from the flexibility L A^-1 K A^-1 L' of those points.
    """
    rounding = 1e-15  # of the largest flexibility
    stiffness = np.asarray(sum(matrix for kind, matrix in matrices.items() if kind != "mass"))
    dynamic = stiffness - omega**2 * matrices["mass"]
    answer = la.solve(dynamic, rows.T, assume_a="sym")
    flexibility = answer.T @ stiffness @ answer
    value, vector = la.eigh((flexibility + flexibility.T) / 2.0)
    value = np.maximum(value, rounding * value[-1])
    part = vector.T @ shape

    def misfit(log_r: float) -> float:
        return float(np.mean((part / (1.0 + np.exp(log_r) * value)) ** 2))

    low, high = -np.log(value[-1]) - 10.0, -np.log(value[0]) + 10.0
    weak = misfit(low) <= 1.0  # nothing was measured beyond the noise
    log_r = low if weak else float(scipy.optimize.brentq(lambda log_r: misfit(log_r) - 1.0, low, high))
    e = answer @ (vector @ (part * np.exp(log_r) / (1.0 + np.exp(log_r) * value)))
    u = la.solve(dynamic, stiffness @ e, assume_a="sym")
    unit = np.sqrt(u @ stiffness @ u)
    return _Fields(
        u=u / unit,
        e=e / unit,
        misfit=float(np.sqrt(misfit(log_r))),
        omega=omega,
        matrices=matrices,
        stiffness=stiffness,
    )


def _common_changes(found: list[_Fields]) -> tuple[Reals, Reals]:
    """Return the share of the eigenvalue errors that a common change of each kind explains, and that change.

    If all stiffness of one kind were (1 + a) times the model's, the Rayleigh quotient of u would give
    omega**2 u' M u / u' K u = 1 + a s with the kind's share s of the strain energy; likewise for the mass. The best a
    follows by least squares over all modes.
    """
    inertia = np.array([f.omega**2 * (f.u @ f.matrices["mass"] @ f.u) for f in found])
    error = inertia - 1.0
    share = np.array([[f.u @ f.matrices[kind] @ f.u for kind in ENERGY_KINDS[:-1]] for f in found])
    columns = np.column_stack([share, -inertia])
    cross, norm = columns.T @ error, np.sum(columns**2, axis=0)
    return _over(cross**2, norm * (error @ error)), _over(cross, norm)


def _over(value: Reals, size: Reals) -> Reals:
    """Return values over sizes, and 0 where there is nothing: one lamina has no contact to strain."""
    return np.where(size == 0.0, 0.0, value / np.where(size == 0.0, 1.0, size))
