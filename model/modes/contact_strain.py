"""Shear strain of the interfaces of a reduced stack, at points over the plan and at a few interfaces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.contact.contact import contact_fields
from model.contact.tangential import jump, mean
from model.elements.mesh import Derivative, Field
from model.reduction.reduction import ReducedSystem
from model.stack.arrays import readonly

Vector = NDArray[np.float64]

N_INTERFACE = 9
"""Interfaces that stand for all: with them the loss of a mode is off by some 1e-3 at most."""

QUADRATURE_ORDER = 4
"""Over the plan, of elements: nine points of a rectangle."""


@dataclass(frozen=True, eq=False, kw_only=True)
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

    rows: Vector
    weight: Vector
    spacing: Vector

    def __post_init__(self) -> None:
        n = np.size(self.weight)
        for name, shape in (("rows", (2, n, None)), ("weight", (n,)), ("spacing", (n,))):
            object.__setattr__(self, name, readonly("ContactStrain", name, getattr(self, name), shape))

    def amplitude(self, coordinate: Vector) -> Vector:
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
    plan, stack = system.assembly.plan.sampled(QUADRATURE_ORDER), system.stack
    interface, share = chosen_interfaces(stack.n_lamina - 1, n_interface)
    spacing = stack.spacing[interface]
    d, a = (m(stack.n_lamina)[interface].toarray() for m in (jump, mean))
    where, n_z = system.assembly.slices(), system.assembly.n_z
    over = {f: system.basis[where[f]].reshape(n_z[f], plan.size(f), -1) for f in ("u", "v", "w")}

    def at_points(field: Field, derivative: Derivative, z: Vector) -> Vector:
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


def chosen_interfaces(n: int, most: int) -> tuple[NDArray[np.intp], Vector]:
    """Return at most so many of n interfaces with shares that sum up to n, for sums of what is smooth over the height.

    The places are Chebyshev's, rounded, and the shares make sums of polynomials exact.
    """
    if n <= most:
        return np.arange(n), np.ones(n)
    place = np.unique(np.rint(0.5 * (n - 1) * (1.0 - np.cos(np.pi * (np.arange(most) + 0.5) / most)))).astype(
        np.intp
    )
    z = (2.0 * np.arange(n) - n + 1.0) / (n - 1.0)
    every = np.polynomial.legendre.legvander(z, place.size - 1)
    return place, np.linalg.solve(every[place].T, every.sum(axis=0))
