"""Where the model fails: the error in constitutive relation, over the stack and by kind of stiffness.

A measured mode asks for two fields of the model: a displacement u near the measured shape, and stresses in
equilibrium with its inertia at the measured frequency, which are those of another displacement v. With a right
model the two can be one. The energy of their difference e = u - v is the error in constitutive relation (Ladevèze and
Leguillon, SIAM J. Numer. Anal. 20, 1983; Ladevèze, Nedjar and Reynier, AIAA J. 32, 1994). Measurement errors are
weighed against it as in Banerjee, Walsh, Aquino and Bonnet, Comput. Methods Appl. Mech. Eng. 253, 2013 (MECE):

    minimise  e' K e + r |S^-1 (L u - shape)|**2   under   K e = (K - omega**2 M) u,

with the measured points L u, their standard deviations S, and r such that the shape is matched to its standard
deviation and not better (Morozov's discrepancy principle).

What the map can say: a region where e stores much energy for the energy that u stores there is not as stiff, or not
as heavy, as the model has it. In 40 simulated stacks whose contact was softer by 10 to 70 % over 70 to 116 mm of 465 mm
at random places, with 44 points, six modes and 1 % noise, the peak along the stack lay inside that zone each time,
and on the right side where only half the width was softer.

What it cannot say:

- which effect it is. Missing or misplaced mass bends the same way as wrong stiffness, and lights up where it sits.
- which kind of stiffness with certainty. e is a displacement, so a fault of the contact strains the laminas around it
  as well. `explained` was 0.96 to 1.00 for the right kind where one kind was wrong throughout, and 0.85 where the
  clamps' mass alone was; where a kind is wrong locally, softer contact and more mass explain about as much.
- how deep inside. Points on the outside see top from bottom, and left from right, but not a layer at mid-height.
- anything about a region that no measured mode strains.
- a place where one kind is wrong everywhere: then that kind's own map is flat, while those of the others need not
  be. So look at the map of the kind with the largest `explained` and a `change` that can be. In the same study the
  contrast of the tangential contact's map was 0.18 and more for the soft zones, and 0.02 (median) for G_f off by 10 to
  30 % everywhere.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray
from scipy.optimize import brentq

from ema.modal.mac import real_shape
from ema.types.arrays import readonly
from ema.types.modal_model import ModalModel
from model import Observation, ReducedSystem
from model.modes.modes import full_parameters
from model.modes.observation import observe
from model.reduction.reduction import shifted_factor
from model.solvers.eigen import orthonormalize
from updating.correlation.energy import KINDS, TERM, Regions, energy_by_region
from updating.errors import UpdatingError

Vector = NDArray[np.float64]

SCATTER = 0.01
"""Errors of places, directions and calibration of the sensors, relative to a shape's root mean square."""
_FLOOR = 0.05  # of the mean strain energy of a region: below it a ratio to it says nothing
_ROUNDING = 1e-15  # of the largest flexibility
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
        e' K e of each kind of stiffness (`KINDS` without the mass) and region, over u' K u of the whole mode.
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
        explains, in the order of `KINDS`. The shares of kinds overlap: less stiffness and more mass look alike.
    change : (n_kind,) float
        That change, as a ratio: -0.2 asks for a fifth less stiffness (or mass) of that kind. Where it lies far beyond
        -1 or 1, that kind is not what is wrong, however much it explains.
    """

    regions: Regions
    frequency: Vector
    error: Vector
    strain: Vector
    total: Vector
    floor: Vector
    misfit: Vector
    explained: Vector
    change: Vector

    def __post_init__(self) -> None:
        n_mode, n_kind = np.size(self.frequency), len(KINDS)
        by_region = (n_mode, n_kind - 1, *self.regions.shape)
        shapes = {"error": by_region, "strain": by_region, "explained": (n_kind,), "change": (n_kind,)}
        for field in fields(self):
            if field.name != "regions":
                array = readonly(
                    "ErrorMap", field.name, getattr(self, field.name), shapes.get(field.name, (n_mode,))
                )
                object.__setattr__(self, field.name, array)

    @property
    def relative(self) -> Vector:
        """Error over strain energy of all modes together by kind and region, (n_stiffness, n_x, n_y, n_z).

        1 is the mean of the kind. Regions that hardly strain are damped towards 0.
        """
        error, strain = self.error.sum(axis=0), self.strain.sum(axis=0)
        mean = strain.mean(axis=(1, 2, 3), keepdims=True)
        ratio = _over(error, strain + _FLOOR * mean)
        return ratio * _over(mean, error.mean(axis=(1, 2, 3), keepdims=True))

    @property
    def contrast(self) -> Vector:
        """How unlike error and strain energy of each kind are spread, (n_stiffness,).

        The total variation distance of the two: 0 where the error follows the strain energy, as it does when a kind is
        wrong everywhere alike, towards 1 where it sits in one place.
        """
        error, strain = (a.sum(axis=0).reshape(a.shape[1], -1) for a in (self.error, self.strain))
        shares = [_over(a, a.sum(axis=1, keepdims=True)) for a in (error, strain)]
        return np.asarray(np.abs(shares[0] - shares[1]).sum(axis=1) / 2.0)

    def peak(self, kind: str) -> tuple[Vector, Vector]:
        """Return the lower and the upper corner, (3,) m each, of the region where `relative` is largest.

        Raises
        ------
        UpdatingError
            There is no such kind of stiffness.
        """
        index = np.unravel_index(np.argmax(self.relative[stiffness_index(kind)]), self.regions.shape)
        edges = (self.regions.x, self.regions.y, self.regions.z)
        low, high = (
            np.array([edge[i + step] for edge, i in zip(edges, index, strict=True)]) for step in (0, 1)
        )
        return low, high


def stiffness_index(kind: str) -> int:
    """Return the place of a kind of stiffness in `KINDS`.

    Raises
    ------
    UpdatingError
        There is no such kind.
    """
    if kind not in KINDS[:-1]:
        message = f"unknown kind of stiffness {kind!r}; there are {', '.join(KINDS[:-1])}"
        raise UpdatingError(message)
    return KINDS.index(kind)


def map_error(
    system: ReducedSystem,
    measured: ModalModel,
    observation: Observation,
    where: Regions,
    *,
    G_f: float,
    modes: NDArray[np.int64],
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
        message = "an error map needs at least one measured mode; none was given"
        raise UpdatingError(message)
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
    system: ReducedSystem,
    theta: Mapping[str, float],
    basis: Vector,
    rows: Vector,
    measured: ModalModel,
    modes: NDArray[np.int64],
) -> list[_Fields]:
    """Return the optimum of each measured mode in the span of the basis, in which `rows` are the measured DOFs."""
    matrices = _matrices(system, basis, theta)
    found = []
    for r in modes:
        omega = 2.0 * np.pi * float(measured.frequency[r])
        if _OMEGA in theta:
            matrices = _matrices(system, basis, {**theta, _OMEGA: omega})
        shape = real_shape(measured.shape[:, [r]])[:, 0]
        std = np.hypot(measured.shape_std[:, r], SCATTER * np.sqrt(np.mean(shape**2)))
        found.append(_solve(matrices, omega, rows / std[:, None], shape / std))
    return found


Matrices = dict[str, Vector]
"""Stiffness of each kind, of "other" terms, and the "mass", in the span of the solution."""


def _span(
    system: ReducedSystem, observation: Observation, theta: Mapping[str, float]
) -> tuple[Vector, Vector]:
    """Return a mass-orthonormal basis (assembly.size, n) of the solutions and the measured rows in it."""
    assembly, rows = system.assembly, observe(system, observation).rows
    mass = assembly.krons("M", theta)

    def product(x: Vector) -> Vector:
        return np.asarray(assembly.apply(mass, x))

    factor = shifted_factor(system.assembly, theta)
    static = factor.solve(rows.T.toarray())
    answers = np.hstack([static, factor.solve(product(static))])
    attachment, _ = orthonormalize(answers, product, [(system.basis, product(system.basis))])
    basis = np.hstack([system.basis, attachment])
    return basis, np.asarray(rows @ basis)


def _matrices(system: ReducedSystem, basis: Vector, theta: Mapping[str, float]) -> Matrices:
    """Project the terms on the basis, by kind."""
    size = basis.shape[1]
    found: Matrices = {kind: np.zeros((size, size)) for kind in (*KINDS, "other")}
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

    u: Vector
    e: Vector
    misfit: float
    omega: float
    matrices: Matrices
    stiffness: Vector


def _solve(matrices: Matrices, omega: float, rows: Vector, shape: Vector) -> _Fields:
    """Find u and e for whitened rows and shape.

    With A = K - omega**2 M the optimum has A e = L' m for multipliers m at the measured points, and u = A^-1 K e,
    so everything follows from the flexibility L A^-1 K A^-1 L' of those points.
    """
    stiffness = np.asarray(sum(matrix for kind, matrix in matrices.items() if kind != "mass"))
    dynamic = stiffness - omega**2 * matrices["mass"]
    answer = la.solve(dynamic, rows.T, assume_a="sym")
    flexibility = answer.T @ stiffness @ answer
    value, vector = la.eigh((flexibility + flexibility.T) / 2.0)
    value = np.maximum(value, _ROUNDING * value[-1])
    part = vector.T @ shape

    def misfit(log_r: float) -> float:
        return float(np.mean((part / (1.0 + np.exp(log_r) * value)) ** 2))

    low, high = -np.log(value[-1]) - 10.0, -np.log(value[0]) + 10.0
    weak = misfit(low) <= 1.0  # nothing was measured beyond the noise
    log_r = low if weak else float(brentq(lambda log_r: misfit(log_r) - 1.0, low, high))
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


def _common_changes(found: list[_Fields]) -> tuple[Vector, Vector]:
    """Return the share of the eigenvalue errors that a common change of each kind explains, and that change.

    If all stiffness of one kind were (1 + a) times the model's, the Rayleigh quotient of u would give
    omega**2 u' M u / u' K u = 1 + a s with the kind's share s of the strain energy; likewise for the mass. The best a
    follows by least squares over all modes.
    """
    inertia = np.array([f.omega**2 * (f.u @ f.matrices["mass"] @ f.u) for f in found])
    error = inertia - 1.0
    share = np.array([[f.u @ f.matrices[kind] @ f.u for kind in KINDS[:-1]] for f in found])
    columns = np.column_stack([share, -inertia])
    cross, norm = columns.T @ error, np.sum(columns**2, axis=0)
    return _over(cross**2, norm * (error @ error)), _over(cross, norm)


def _over(value: Vector, size: Vector) -> Vector:
    """Return values over sizes, and 0 where there is nothing: one lamina has no contact to strain."""
    return np.where(size == 0.0, 0.0, value / np.where(size == 0.0, 1.0, size))
