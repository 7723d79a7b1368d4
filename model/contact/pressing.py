"""Stage 1: how the clamps press the stack, and the pressure field that this leaves between the laminas.

Only deflections along z take part. Every lamina bends as a thin plate, every interface follows the measured
compression curve and does not pull, and the clamps press through the plates on both faces. This is the
paper's first stage (Pirnat et al. 2013, section 3) with the contact integrated over the area instead of lumped in
link elements. The potential energy is convex, so the pressure is unique and does not depend on the loading path.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
import scipy.sparse.linalg as splinalg

from lamella_shared import Booleans, Reals, arrays, readonly
from model.elements.mesh import Plan, plan_of
from model.elements.terms import footprint_points, plate_form
from model.stack.errors import SolveError, StackError
from model.stack.parts import PLATE_POISSON, CompressionCurve, Pressing, PressureDistribution
from model.stack.stack import Stack


@dataclass(frozen=True, eq=False, kw_only=True)
class InterfaceLaw:
    """Pressure of every interface over its compressive strain, per spacing of the mid-planes.

    Attributes
    ----------
    curve : CompressionCurve
        Law of sheets that touch.
    spacing : (n_interface,) float
        Distance of the neighbouring mid-planes, m.
    layer_modulus : (n_interface,) float
        Modulus of the linear law of an interface with a soft layer, over the same spacing, Pa; 0 where sheets
        touch.
    """

    curve: CompressionCurve
    spacing: Reals
    layer_modulus: Reals

    @classmethod
    def of(cls, stack: Stack, curve: CompressionCurve) -> InterfaceLaw:
        """Return the laws of a stack's interfaces."""
        spacing, modulus = stack.spacing, np.zeros(stack.n_lamina - 1)
        for layer in stack.interlayers:
            i = layer.below - 1
            modulus[i] = layer.normal_modulus * spacing[i] / layer.thickness
        return cls(curve=curve, spacing=spacing, layer_modulus=modulus)

    @property
    def is_layer(self) -> Booleans:
        """Whether an interface holds a soft layer, (n_interface,)."""
        return self.layer_modulus > 0.0

    def __call__(self, strain: Reals) -> tuple[Reals, Reals]:
        """Return pressure and tangent modulus, Pa, for strains (n_interface, n)."""
        pressure, tangent = self.curve.evaluate(strain)
        layers = self.is_layer
        if layers.any():
            modulus = self.layer_modulus[layers, None]
            closed = strain[layers] >= 0.0
            pressure[layers] = modulus * np.maximum(strain[layers], 0.0)
            tangent[layers] = np.where(closed, modulus, 0.0)
        return pressure, tangent

    def strain_at(self, pressure: float) -> Reals:
        """Return the strain of every interface at one pressure, (n_interface,)."""
        touching = self.curve.strain_at(pressure)
        return np.where(self.is_layer, pressure / np.where(self.is_layer, self.layer_modulus, 1.0), touching)


@dataclass(frozen=True, eq=False, kw_only=True)
@arrays({"n": "interface_mean lowest highest lost_contact"})
class PressureSummary:
    """A pressure field in a few numbers for each interface, the lowest interface first.

    Attributes
    ----------
    mean : float
        Mean pressure over the plan, Pa: the clamps' force over the area.
    interface_mean, lowest, highest : (n_interface,) float
        Mean, lowest and highest pressure, Pa.
    lost_contact : (n_interface,) float
        Share of the plan that carries no pressure.
    force : float
        The clamps' force, N.
    residual : float
        Of the equilibrium, relative to the load.
    """

    mean: float
    interface_mean: Reals
    lowest: Reals
    highest: Reals
    lost_contact: Reals
    force: float
    residual: float


@dataclass(frozen=True, eq=False, kw_only=True)
class PressureField:
    """Pressure at every interface and every quadrature point of the plan: the result of the static stage.

    Attributes
    ----------
    plan : Plan
        Mesh of the static stage.
    law : InterfaceLaw
        What gives the pressure for the strain.
    deflection : (n_lamina, plan.size("w")) float
        Degrees of freedom of the deflection of every lamina.
    pressure : (n_interface, n_element, n_point) float
        Pressure at the plan's quadrature points, Pa.
    force : float
        The clamps' force, N.
    residual : (n_iteration,) float
        Residual of each Newton iteration of the last load step, relative to the load.
    n_step : int
        Number of load steps.
    """

    plan: Plan
    law: InterfaceLaw
    deflection: Reals
    pressure: Reals
    force: float
    residual: Reals
    n_step: int

    def __post_init__(self) -> None:
        n_lamina = self.law.spacing.size + 1
        expected: dict[str, tuple[int | None, ...]] = {
            "deflection": (n_lamina, self.plan.size("w")),
            "pressure": (n_lamina - 1, *self.plan.membrane.dx.shape),
            "residual": (None,),
        }
        for name, shape in expected.items():
            object.__setattr__(self, name, readonly("PressureField", name, getattr(self, name), shape))

    @property
    def mean(self) -> float:
        """Mean pressure over the plan, Pa: the clamps' force over the area."""
        return self.force / self.plan.area

    @property
    def interface_force(self) -> Reals:
        """Pressure of each interface integrated over the plan, (n_interface,) N; each equals `force`."""
        return np.asarray(np.sum(self.pressure * self.plan.membrane.dx, axis=(1, 2)))

    @property
    def lost_contact(self) -> Reals:
        """Share of the plan where an interface carries no pressure, (n_interface,)."""
        dx = self.plan.membrane.dx
        return np.asarray(np.sum((self.pressure <= 0.0) * dx, axis=(1, 2)) / dx.sum())

    def summary(self) -> PressureSummary:
        """Return mean, range and lost contact of each interface."""
        return PressureSummary(
            mean=self.mean,
            interface_mean=self.interface_force / self.plan.area,
            lowest=self.pressure.min(axis=(1, 2)),
            highest=self.pressure.max(axis=(1, 2)),
            lost_contact=self.lost_contact,
            force=self.force,
            residual=float(self.residual[-1]),
        )

    def at(self, points: Reals) -> tuple[Reals, Reals]:
        """Return pressure and normal tangent modulus, Pa, (n_interface, n) each, at points (n, 2) of the plan.

        Where contact is lost, the pressure is 0 and the tangent is the curve's at 0, as between sheets that just
        touch: a lamina whose end is free altogether would flap at a few Hz.
        """
        w = self.plan.point_rows("w", points) @ self.deflection.T
        strain = -np.diff(w.T, axis=0) / self.law.spacing[:, None]
        return self.law(np.maximum(strain, 0.0))


@dataclass(frozen=True, eq=False, kw_only=True)
class Separated:
    """A field over interfaces and plan as a short sum of products.

    Attributes
    ----------
    over_z : (n_product, n_interface) float
        Factor of each product over the interfaces.
    over_plan : (n_product, n_point) float
        Factor over the points of the plan, largest absolute value 1.
    error : float
        Largest difference from the field, relative to the field's largest absolute value.
    """

    over_z: Reals
    over_plan: Reals
    error: float


def separate(value: Reals, tolerance: float) -> Separated:
    """Write a field (n_interface, n_point) as the shortest sum of products within a tolerance.

    The products are those of the singular value decomposition, which is the best approximation for each
    number of products; they are added until no value differs by more than `tolerance` of the largest.
    """
    scale = float(np.abs(value).max(initial=0.0))
    gram = value @ value.T  # the few interfaces make this small; what squaring loses is below 1e-8 of the largest
    vectors = la.eigh(gram)[1][:, ::-1]
    coefficient = vectors.T @ value
    rest, n = value.copy(), 0
    while n < value.shape[0] and np.abs(rest).max() > tolerance * scale:
        rest -= np.outer(vectors[:, n], coefficient[n])
        n += 1
    peak = np.abs(coefficient[:n]).max(axis=1)
    return Separated(
        over_z=(vectors[:, :n] * peak).T,
        over_plan=coefficient[:n] / peak[:, None],
        error=float(np.abs(rest).max(initial=0.0)) / scale if scale else 0.0,
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class _Problem:
    """Equilibrium of all laminas.

    A deflection is (n_lamina, n_planar), counted from uniform compression: the whole of it would carry a rounding
    error that the bending of thick plates makes larger than the residual sought.
    """

    bending: sp.csr_matrix
    face_bending: sp.csr_matrix
    face_ratio: float
    rigid: Reals
    evaluate: sp.csr_matrix
    area: Reals
    law: InterfaceLaw
    closed: Reals
    is_rigid: bool

    def contact(self, w: Reals) -> tuple[Reals, Reals]:
        """Return pressure and tangent modulus at all quadrature points, (n_interface, n_point) each."""
        return self.law(self.closed[:, None] + self.strain(w))

    def strain(self, w: Reals) -> Reals:
        """Return the compressive strain that a deflection adds to the interfaces at all quadrature points."""
        return -np.diff((self.evaluate @ w.T).T, axis=0) / self.law.spacing[:, None]

    def allowed(self, x: Reals) -> Reals:
        """Return the part of a force or deflection that the plates allow: rigid ones move as a whole."""
        if self.is_rigid:
            x = x.copy()
            for face in (0, -1):
                x[face] = self.rigid @ (self.rigid.T @ x[face])
        return x

    def _bend(self, x: Reals) -> Reals:
        y = (self.bending @ x.T).T
        for face in (0, -1):
            y[face] += self.face_bending @ x[face]
        return np.asarray(y)

    def _gather(self, flux: Reals) -> Reals:
        """Return the forces on the laminas of pressures given at all quadrature points of all interfaces."""
        force = (self.evaluate.T @ (flux * self.area).T).T
        total = np.zeros((force.shape[0] + 1, force.shape[1]))
        total[:-1] += force
        total[1:] -= force
        return total

    def internal(self, w: Reals, pressure: Reals) -> Reals:
        """Return the forces that hold the deflection `w`."""
        return self.allowed(self._bend(w) + self._gather(pressure))

    def tangent_product(self, x: Reals, tangent: Reals) -> Reals:
        """Return the tangent stiffness times a deflection."""
        return self.allowed(self._bend(x) + self._gather(tangent * self.strain(x)))

    def preconditioner(self, tangent: Reals) -> Callable[[Reals], Reals]:
        """Return the product with the inverse of the nearest stiffness that separates into z and plan.

        The tangent over spacing E(x, y, k) becomes e(k) m(x, y). In the modes of the chain e the laminas
        decouple; chain eigenvalues that are close share one planar factor.
        """
        floor = 1e-6  # of the mean tangent; lost contact would make the preconditioner singular
        ratio = 1.8  # of neighbouring values over z that share one planar factor of the preconditioner
        stiffness = tangent / self.law.spacing[:, None]
        whole = np.sum(stiffness @ self.area) / (self.area.sum() * stiffness.shape[0])
        over_z = np.maximum(stiffness @ self.area / self.area.sum() / whole, floor)
        over_plan = np.maximum(stiffness.mean(axis=0), floor * whole)
        planar = (self.evaluate.T @ sp.diags_array(over_plan * self.area) @ self.evaluate).tocsc()
        jump = np.diff(np.eye(over_z.size + 1), axis=0)
        inertia = np.ones(over_z.size + 1)
        inertia[[0, -1]] += self.face_ratio
        values, vectors = la.eigh((jump.T * over_z) @ jump, np.diag(inertia))
        values[0] = 0.1 * values[1]  # rigid motion of the whole, of which the load has none
        group = np.round(np.log(values / values[0]) / np.log(ratio)).astype(int)
        solves = {
            int(g): splinalg.factorized((self.bending + values[0] * ratio ** float(g) * planar).tocsc())
            for g in np.unique(group)
        }

        def apply(r: Reals) -> Reals:
            modal = vectors.T @ r
            for g, solve in solves.items():
                members = group == g
                modal[members] = solve(modal[members].T).T
            return self.allowed(vectors @ modal)

        return apply


def press(stack: Stack) -> PressureField:
    """Solve for the pressure between the laminas under the clamps' force.

    The start is uniform compression, whose solution is known; in load steps the clamps' load takes the place of the
    uniform one at constant total force, each step solved by Newton's method with a conjugate-gradient
    solution of the linearised equations of all laminas.

    Parameters
    ----------
    stack : Stack
        A stack with clamps whose `pressing` is a `Pressing`.

    Returns
    -------
    PressureField
        Frozen: it keeps its values whatever becomes of the stack.

    Raises
    ------
    StackError
        The stack has no `Pressing`, no clamp, fewer than two laminas, or is pressed beyond its compression curve.
    SolveError
        Newton's method does not converge.
    """
    pressing = _pressing_of(stack)
    plan = plan_of(stack)
    law = InterfaceLaw.of(stack, pressing.curve)
    problem = _problem(stack, plan, pressing, law)
    force = stack.contact.pressure * plan.area
    w, residuals, n_step = _in_load_steps(stack, problem, plan, force)
    pressure, _ = problem.contact(w)
    highest, end = float(pressure[~law.is_layer].max(initial=0.0)), float(pressing.curve.pressure[-1])
    if highest > end:
        raise StackError(
            f"the pressure reaches {highest / 1e3:.4g} kPa, but the compression curve ends at {end / 1e3:.4g} kPa; "
            "measure the curve farther, or spread the clamps' force by plates or wider footprints"
        )
    one = plan.interpolate("w", (1.0, 0.0, 0.0))
    closing = law.strain_at(stack.contact.pressure) * law.spacing
    heights = np.concatenate([[0.0], -np.cumsum(closing)])
    shape = (stack.n_lamina - 1, *plan.membrane.dx.shape)
    return PressureField(
        plan=plan,
        law=law,
        deflection=np.outer(heights - heights.mean(), one) + w,
        pressure=pressure.reshape(shape),
        force=force,
        residual=np.array(residuals),
        n_step=n_step,
    )


def _pressing_of(stack: Stack) -> Pressing:
    pressing = stack.pressing
    if not isinstance(pressing, Pressing):
        raise StackError("the stack says nothing about how it is pressed; give it a Pressing (table [pressing])")
    if stack.n_lamina < 2 or sum(clamp.share for clamp in stack.clamps) <= 0.0:
        raise StackError("the static stage needs at least two laminas and one clamp with a share of the force")
    return pressing


def _in_load_steps(stack: Stack, problem: _Problem, plan: Plan, force: float) -> tuple[Reals, list[float], int]:
    """Put the clamps' load in place of the uniform one, step by step.

    Returns the deflections beyond uniform compression, the residuals of the last step, and the number of steps.
    """
    smallest_step = 1e-3
    uniform = problem.evaluate.T @ problem.area * stack.contact.pressure
    clamped = np.zeros_like(uniform)
    total = sum(clamp.share for clamp in stack.clamps)
    for clamp in stack.clamps:
        points, weights = footprint_points((clamp.x, clamp.y), clamp.footprint, plan)
        clamped += force * clamp.share / total * (weights @ plan.point_rows("w", points))
    load = np.zeros((stack.n_lamina, uniform.size))
    w = np.zeros_like(load)
    done, step, residuals, n_step = 0.0, 1.0, [0.0], 0
    while done < 1.0:
        aim = min(done + step, 1.0)
        load[0] = (1.0 - aim) * uniform + aim * clamped
        load[-1] = -load[0]
        try:
            found, residuals = _newton(problem, w, problem.allowed(load))
        except SolveError:
            step /= 2.0
            if step < smallest_step:
                raise
            continue
        w, done, n_step = found, aim, n_step + 1
    return w, residuals, n_step


def pressure_distribution(stack: Stack) -> PressureDistribution | None:
    """Return the pressure between the laminas, solved for where the stack says how it is pressed; None if uniform."""
    return press(stack) if isinstance(stack.pressing, Pressing) else stack.pressing


def _problem(stack: Stack, plan: Plan, pressing: Pressing, law: InterfaceLaw) -> _Problem:
    rigid_modulus = 1e7  # bending stiffness of a rigid plate in the preconditioner, relative to a lamina
    t = stack.pitch
    bending = t**3 / 12.0 * plate_form(plan, stack.material.plane_stress())
    nu, rigid = PLATE_POISSON, bool(np.isinf(pressing.plate_rigidity))
    rigidity = 0.0 if rigid else pressing.plate_rigidity
    lamina = t**3 / 12.0 * stack.material.plane_stress()[0]
    plate = rigidity * plate_form(plan, (1.0, nu, 1.0, (1.0 - nu) / 2.0))
    functions = [plan.interpolate("w", c) for c in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))]
    return _Problem(
        bending=bending,
        face_bending=plate,
        face_ratio=rigid_modulus if rigid else rigidity / lamina,
        rigid=la.qr(np.column_stack(functions), mode="economic")[0],
        evaluate=plan.at_quadrature("w"),
        area=plan.plate.dx.ravel(),
        law=law,
        closed=law.strain_at(stack.contact.pressure),
        is_rigid=rigid,
    )


def _newton(problem: _Problem, w: Reals, load: Reals) -> tuple[Reals, list[float]]:
    """Return the equilibrium under `load` and the relative residuals of the iteration, the last one below 1e-8.

    A residual is measured in the norm of the preconditioner, where forces and moments count alike.
    """
    tolerance = 1e-8  # of the residual relative to the load
    max_newton = 40
    residuals: list[float] = []
    pressure, tangent = problem.contact(w)
    residual = load - problem.internal(w, pressure)
    for _ in range(max_newton):
        precondition = problem.preconditioner(tangent)
        size = np.sqrt(np.sum(residual * precondition(residual)) / np.sum(load * precondition(load)))
        residuals.append(float(size))
        if size <= tolerance:
            return w, residuals
        step = _conjugate_gradients(problem, tangent, precondition, residual)
        slope, length = float(np.sum(residual * step)), 1.0
        while True:
            trial = w + length * step
            trial_pressure, trial_tangent = problem.contact(trial)
            trial_residual = load - problem.internal(trial, trial_pressure)
            # the energy is convex: a step that leaves less slope than it found has not gone too far
            if abs(np.sum(trial_residual * step)) <= 0.9 * slope or length < 1e-3:
                break
            length /= 2.0
        w, tangent, residual = trial, trial_tangent, trial_residual
    raise SolveError(f"the static stage did not converge in {max_newton} Newton steps; residual {residuals[-1]:.2g}")


def _conjugate_gradients(
    problem: _Problem, tangent: Reals, precondition: Callable[[Reals], Reals], residual: Reals
) -> Reals:
    forcing = 1e-2  # residual of the linear solution relative to the Newton residual
    max_cg = 400
    step, r = np.zeros_like(residual), residual.copy()
    z = precondition(r)
    direction = z.copy()
    before = first = float(np.sum(r * z))
    for _ in range(max_cg):
        image = problem.tangent_product(direction, tangent)
        length = before / float(np.sum(direction * image))
        step += length * direction
        r -= length * image
        z = precondition(r)
        now = float(np.sum(r * z))
        if now <= forcing**2 * first:
            break
        direction = z + now / before * direction
        before = now
    return step
