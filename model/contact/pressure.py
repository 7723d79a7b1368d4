"""The pressure between the laminas, frozen, and the contact stiffness and damping that follow from it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from lamella_shared import arrays, readonly
from model.elements.mesh import Plan
from model.stack.inputs import CompressionCurve
from model.stack.stack import Stack

Vector = NDArray[np.float64]


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
    spacing: Vector
    layer_modulus: Vector

    @classmethod
    def of(cls, stack: Stack, curve: CompressionCurve) -> InterfaceLaw:
        """Return the laws of a stack's interfaces."""
        spacing, modulus = stack.spacing, np.zeros(stack.n_lamina - 1)
        for layer in stack.interlayers:
            i = layer.below - 1
            modulus[i] = layer.normal_modulus * spacing[i] / layer.thickness
        return cls(curve=curve, spacing=spacing, layer_modulus=modulus)

    @property
    def is_layer(self) -> NDArray[np.bool_]:
        """Whether an interface holds a soft layer, (n_interface,)."""
        return self.layer_modulus > 0.0

    def __call__(self, strain: Vector) -> tuple[Vector, Vector]:
        """Return pressure and tangent modulus, Pa, for strains (n_interface, n)."""
        pressure, tangent = self.curve.evaluate(strain)
        layers = self.is_layer
        if layers.any():
            modulus = self.layer_modulus[layers, None]
            closed = strain[layers] >= 0.0
            pressure[layers] = modulus * np.maximum(strain[layers], 0.0)
            tangent[layers] = np.where(closed, modulus, 0.0)
        return pressure, tangent

    def strain_at(self, pressure: float) -> Vector:
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
    interface_mean: Vector
    lowest: Vector
    highest: Vector
    lost_contact: Vector
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
    deflection: Vector
    pressure: Vector
    force: float
    residual: Vector
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
    def interface_force(self) -> Vector:
        """Pressure of each interface integrated over the plan, (n_interface,) N; each equals `force`."""
        return np.asarray(np.sum(self.pressure * self.plan.membrane.dx, axis=(1, 2)))

    @property
    def lost_contact(self) -> Vector:
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

    def at(self, points: Vector) -> tuple[Vector, Vector]:
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

    over_z: Vector
    over_plan: Vector
    error: float


def separate(value: Vector, tolerance: float) -> Separated:
    """Write a field (n_interface, n_point) as the shortest sum of products within a tolerance.

    The products are those of the singular value decomposition, which is the best approximation for each
    number of products; they are added until no value differs by more than `tolerance` of the largest.
    """
    scale = float(np.abs(value).max(initial=0.0))
    gram = (
        value @ value.T
    )  # the few interfaces make this small; what squaring loses is below 1e-8 of the largest
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
