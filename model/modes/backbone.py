"""Modes over their amplitude where interfaces slip: the strain of the contact, and frequency and damping along it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lamella_shared import Complexes, Reals, arrays
from model.contact.contact import SlipLaw, contact_fields, jump, mean
from model.elements.equations import OMEGA
from model.elements.mesh import Derivative, Field
from model.modes.modes import full_parameters, reduced_eigenpairs
from model.reduction.reduced_equations import ReducedEquations
from model.reduction.reduction import ReducedSystem
from model.stack.errors import SolveError

N_INTERFACE = 9
"""Interfaces that stand for all: with them the loss of a mode is off by some 1e-3 at most."""


@dataclass(frozen=True, eq=False, kw_only=True)
@arrays({"2 n any": "rows", "n": "weight spacing"})
class ContactStrain:
    """Shear strain of the contact as a function of reduced coordinates.

    Attributes
    ----------
    rows : (2, n_point, n_basis) float
        From reduced coordinates to the shear strains along x and y.
    weight : (n_point,) float
        Volume times pressure over its mean that each point stands for, m3: G_f times the mean pressure times the sum
        of weight times strain squared is twice the energy.
    spacing : (n_point,) float
        Distance between the mid-planes of the two laminas, m: times the strain it is how far the faces move apart.
    """

    rows: Reals
    weight: Reals
    spacing: Reals

    def amplitude(self, coordinate: Reals) -> Reals:
        """Return the size of the strain at reduced coordinates (n_basis,), (n_point,)."""
        x, y = self.rows @ coordinate
        return np.hypot(x, y)


def contact_strain(system: ReducedSystem, *, n_interface: int = N_INTERFACE) -> ContactStrain:
    """Return the shear strain of a reduced stack's contact, (u[k+1] - u[k]) / s + dw/dx and the same along y.

    Parameters
    ----------
    system : ReducedSystem
        The reduced stack; soft layers do not slip.
    n_interface : int
        Interfaces at which the strain is taken; all where there are no more.
    """
    quadrature_order = 4  # Over the plan, of elements: nine points of a rectangle.
    plan, stack = system.assembly.plan.sampled(quadrature_order), system.stack
    interface, share = chosen_interfaces(stack.n_lamina - 1, n_interface)
    spacing = stack.spacing[interface]
    d, a = (m(stack.n_lamina)[interface].toarray() for m in (jump, mean))
    where, n_z = system.assembly.slices(), system.assembly.n_z
    over = {f: system.basis[where[f]].reshape(n_z[f], plan.size(f), -1) for f in ("u", "v", "w")}

    def at_points(field: Field, derivative: Derivative, z: Reals) -> Reals:
        """Return a field over (interfaces, points of the plan, basis)."""
        values = np.stack([plan.at_quadrature(field, derivative) @ part for part in over[field]])
        return np.tensordot(z @ system.phi[field], values, axes=1)

    axes: tuple[tuple[Field, Derivative], ...] = (("u", "x"), ("v", "y"))
    rows = [at_points(f, "", d / spacing[:, None]) + at_points("w", slope, a) for f, slope in axes]
    pressure = sum(
        np.outer(z[interface], np.broadcast_to(w, plan.quadrature_points.shape[1:]).ravel())
        for z, w in contact_fields(stack, plan)["pressure"].products
    )
    area = np.asarray(plan.membrane.dx).ravel()
    return ContactStrain(
        rows=np.stack(rows).reshape(2, -1, system.size),
        weight=(pressure * np.outer(share * spacing, area)).ravel(),
        spacing=np.repeat(spacing, area.size),
    )


def chosen_interfaces(n: int, most: int) -> tuple[NDArray[np.intp], Reals]:
    """Return at most so many of n interfaces with shares that sum up to n, for sums of what is smooth over the height.

    The places are Chebyshev's, rounded, and the shares make sums of polynomials exact.
    """
    if n <= most:
        return np.arange(n), np.ones(n)
    place = np.unique(np.rint(0.5 * (n - 1) * (1.0 - np.cos(np.pi * (np.arange(most) + 0.5) / most)))).astype(np.intp)
    z = (2.0 * np.arange(n) - n + 1.0) / (n - 1.0)
    every = np.polynomial.legendre.legvander(z, place.size - 1)
    return place, np.linalg.solve(every[place].T, every.sum(axis=0))


_MOST_STEPS = 8


@dataclass(frozen=True, eq=False, kw_only=True)
@arrays({"n": "amplitude frequency damping slip", "any n": "coordinate"})
class Backbone:
    """A mode over its amplitude.

    Attributes
    ----------
    amplitude : (n,) float
        Modal amplitude, m sqrt(kg): displacement is amplitude times the mass-normalised shape.
    frequency : (n,) float
        Natural frequency, Hz; at amplitude 0 the undamped one of the linear model.
    damping : (n,) float
        Damping ratio; at amplitude 0 the modal one of the linear model.
    slip : (n,) float
        Largest displacement of two faces against each other, m, elastic part included.
    coordinate : (n_basis, n) float
        Mass-normalised deflection in reduced coordinates, 1/sqrt(kg), without what is out of phase.
    """

    amplitude: Reals
    frequency: Reals
    damping: Reals
    slip: Reals
    coordinate: Reals


def backbone(
    system: ReducedEquations,
    strain: ContactStrain,
    law: SlipLaw,
    *,
    mode: int,
    amplitude: Reals,
    G_f: float,
    d_f: float,
    parameters: Mapping[str, float] | None = None,
) -> Backbone:
    """Follow a mode from small to large amplitude.

    Parameters
    ----------
    system, strain : ReducedEquations, ContactStrain
        The reduced stack, and its contact in the same coordinates.
    law : SlipLaw
        How interfaces slip.
    mode : int
        Elastic mode, from 0.
    amplitude : (n,)
        Modal amplitudes, m sqrt(kg), 0 or above and ascending.
    G_f, d_f, parameters
        As in `solve_modes`; those of contact at small amplitude.

    Raises
    ------
    SolveError
        There is no such mode, amplitudes are not 0 or above and ascending, or a deflection does not settle.
    """
    n_beside = 60  # Modes above the one that is followed, of which its deflection is made.
    wanted, theta = _ascending(amplitude), _steady(full_parameters(system, G_f, d_f, parameters))
    eigenvalues, vectors, n_rigid = reduced_eigenpairs(system, theta, system.size)
    if not 0 <= mode < system.size - n_rigid:
        raise SolveError(f"mode = {mode}: elastic modes are numbered from 0 to {system.size - n_rigid - 1}")
    taken = slice(n_rigid, n_rigid + mode + 1 + n_beside)
    taken_values, vectors = eigenvalues[taken], vectors[:, taken]
    viscous = vectors.T @ system.matrix("C", theta) @ vectors
    contact = _Contact.of(strain, vectors, law, theta)
    along = _along(taken_values, contact, wanted, mode)
    values = [_resonance(np.diag(taken_values) + 1j * np.sqrt(at[1]) * viscous, contact, at) for at in along]
    resonance = np.array(values, dtype=complex)
    stiffness, loss = resonance.real, resonance.imag / (2.0 * resonance.real)
    omega = float(np.sqrt(taken_values[mode]))
    coordinate = vectors @ np.column_stack([shape for _, _, shape in along[1:]])
    moved = np.stack([strain.spacing * strain.amplitude(x) for x in coordinate.T])
    return Backbone(
        amplitude=wanted,
        frequency=omega / (2.0 * np.pi) * np.sqrt(stiffness[1:] / stiffness[0]),
        damping=viscous[mode, mode] / (2.0 * omega) + loss[1:] - loss[0],
        slip=wanted * moved.max(axis=1),
        coordinate=coordinate,
    )


def _steady(theta: dict[str, float]) -> dict[str, float]:
    if OMEGA in theta:
        raise SolveError("a mode over amplitude is not solved beside effects that depend on frequency; leave them out")
    return theta


def _ascending(amplitude: Reals) -> Reals:
    wanted = np.asarray(amplitude, dtype=float)
    if wanted.ndim != 1 or not np.all(wanted >= 0.0) or np.any(np.diff(wanted) < 0.0):
        raise SolveError(f"amplitudes must be 0 or above and ascend, got {amplitude}")
    return wanted


@dataclass(frozen=True, eq=False)
class _Contact:
    """Contact in coordinates of elastic modes: strains per `slide`, and stiffness of points per strain so measured."""

    rows: Reals
    stiffness: Reals
    law: SlipLaw

    @classmethod
    def of(cls, strain: ContactStrain, modes: Reals, law: SlipLaw, theta: Mapping[str, float]) -> _Contact:
        slide = law.sliding_strain(theta["G_f"])
        modulus = theta["G_f"] * theta["pressure"] * slide**2
        touching = strain.weight != 0.0
        return cls(strain.rows[:, touching] @ modes / slide, modulus * strain.weight[touching], law)

    def softened(self, coordinate: Reals) -> tuple[Reals, Reals]:
        """Return what a deflection lowers the stress by, as a force (n_mode,), and its derivative, (n_mode, n_mode)."""
        strain = self.rows @ coordinate
        size = np.hypot(*strain)
        lost, growth = self.stiffness * self.law.softening(size), self.stiffness * self.law.growth(size)
        force = sum((lost * share) @ rows for share, rows in zip(strain, self.rows, strict=True))
        safe = np.where(size > 0.0, size, 1.0)
        # a tangent only leads the way, so half of the digits do, in half of the time
        rows, (x, y) = self.rows.astype(np.float32), (strain / safe).astype(np.float32)
        weights = [np.sqrt(w).astype(np.float32)[:, None] for w in (lost, lost, growth)]
        parts = [*rows, x[:, None] * rows[0] + y[:, None] * rows[1]]
        weighted = np.concatenate([w * part for w, part in zip(weights, parts, strict=True)])
        return force, (weighted.T @ weighted).astype(float)

    def cycle(self, coordinate: Complexes) -> Complexes:
        """Return what a harmonic deflection lowers the stress by, as the first harmonic of a force, (n_mode,)."""
        strain = self.rows @ coordinate
        size = np.sqrt(np.sum(np.abs(strain) ** 2, axis=0))
        lost = self.stiffness * (self.law.softening(size) - 1j * self.law.loss(size))
        return np.asarray(sum((lost * share) @ rows for share, rows in zip(strain, self.rows, strict=True)))


def _along(eigenvalues: Reals, contact: _Contact, amplitude: Reals, mode: int) -> list[tuple[float, float, Reals]]:
    """Return amplitude, eigenvalue and shape of a mode at rest and at each amplitude."""
    along = [(0.0, float(eigenvalues[mode]), np.eye(eigenvalues.size)[mode])]
    for a in amplitude.tolist():
        along.append(_followed(eigenvalues, contact, a, along[-1]) if a else along[-1])
    return along


def _followed(
    eigenvalues: Reals, contact: _Contact, a: float, before: tuple[float, float, Reals], depth: int = 0
) -> tuple[float, float, Reals]:
    """Return an amplitude a with eigenvalue and shape, of unit length, of the mode there, from those at a smaller one.

    Where Newton's method does not settle nearby, the mode is sought halfway first.
    """
    most_halves = 7
    first_step = 1e-3  # of an amplitude: where to begin below it
    found = _settled(eigenvalues, contact, a, before)
    if found is not None:
        return found
    if depth == most_halves:
        raise SolveError(f"at a modal amplitude of {a:g} m sqrt(kg) so much slips that the mode cannot be followed")
    halfway = np.sqrt(max(before[0], first_step * a) * a)
    middle = _followed(eigenvalues, contact, float(halfway), before, depth + 1)
    return _followed(eigenvalues, contact, a, middle, depth + 1)


def _settled(
    eigenvalues: Reals, contact: _Contact, a: float, before: tuple[float, float, Reals]
) -> tuple[float, float, Reals] | None:
    """Return the solution of the nonlinear eigenproblem next to another one; None where there is none next to it."""
    settled = 1e-4  # change of a unit shape and of an eigenvalue: of the next of Newton's steps it is the square
    near = 0.9  # cosine between shapes at two amplitudes, of which the second is sought from the first
    _, value, shape = before
    for _ in range(_MOST_STEPS):
        force, tangent = contact.softened(a * shape)
        rest = (eigenvalues - value) * shape - force / a
        bordered = np.block([[np.diag(eigenvalues - value) - tangent, -shape[:, None]], [shape, np.zeros(1)]])
        step = np.linalg.solve(bordered, -np.append(rest, 0.5 * (shape @ shape - 1.0)))
        value, shape = value + step[-1], shape + step[:-1]
        if shape @ before[2] < near or value <= 0.0:
            return None
        if np.linalg.norm(step[:-1]) <= settled and abs(step[-1]) <= settled * value:
            return a, float(value), shape
    return None


def _resonance(linear: Complexes, contact: _Contact, at: tuple[float, float, Reals]) -> complex:
    """Return the complex eigenvalue of a mode, omega**2 (1 + 2 i damping), with the loss that couples it to others.

    `at` holds its amplitude, and eigenvalue and shape without loss, from which the steps are taken with one matrix. The
    component along that shape stays what it is.
    """
    most_loss_steps = 60
    settled_loss = 1e-5  # relative change of the eigenvalue in the last step with loss
    a, start, shape = at
    value = complex(start)
    u: Complexes = shape.astype(complex)
    tangent = contact.softened(a * shape)[1] if a else 0.0
    bordered = np.block([[linear.real - start * np.eye(u.size) - tangent, -shape[:, None]], [shape, np.zeros(1)]])
    inverse = np.linalg.inv(bordered)
    for _ in range(most_loss_steps):
        rest = linear @ u - value * u - (contact.cycle(a * u) / a if a else 0.0)
        step = inverse @ -np.append(rest, 0.0)
        value, u = value + step[-1], u + step[:-1]
        if abs(step[-1]) <= settled_loss * abs(value):
            return value
    raise SolveError(f"at a modal amplitude of {a:g} m sqrt(kg) so much is lost that the mode does not settle")
