"""Contact between neighbouring laminas: tangential and normal, integrated over the area, and its law where it slips.

The shear strain of an interface is (u[k+1] - u[k]) / spacing + dw/dx, and the same in y with v, where dw/dx is the mean
slope of the two laminas: a lamina that tilts carries its faces along. The shear modulus is G = G_f p. Normal contact
has a stiffness of modulus / spacing per area against opening.

Where it slips, it is an Iwan model: many springs in parallel, each in series with a slider (Jenkins elements). With a
power law of slip limits that ends in a spike it has four parameters (D. J. Segalman, A four-parameter Iwan model for
lap-type joints, J. Appl. Mech. 72, 2005, eqs. 19 to 26): the stiffness K_T, the force F_S at which all of it slides,
the exponent chi and the share beta of the spike. Here it is a law of shear stress over shear strain of an interface.
K_T is the shear modulus G_f p and F_S the traction mu p, so the strain from which everything slides is the same at
every pressure.

Stress and strain are in units of G gamma_slide and gamma_slide here: all that a law has of its own is its shape.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal, get_args

import numpy as np
import scipy
import scipy.sparse as sp

from lamella_shared import Reals
from model.contact.pressing import pressure_distribution, separate
from model.elements.equations import Kron, Monomial, Target, Term
from model.elements.mesh import Derivative, Field, Plan
from model.stack.stack import Stack


def jump(n_lamina: int) -> sp.csr_array:
    """Return the matrix of differences between neighbouring laminas, (n_lamina - 1, n_lamina)."""
    ones = np.ones(n_lamina - 1)
    return sp.diags_array([-ones, ones], offsets=[0, 1], shape=(n_lamina - 1, n_lamina)).tocsr()


def mean(n_lamina: int) -> sp.csr_array:
    """Return the matrix of means of neighbouring laminas, (n_lamina - 1, n_lamina)."""
    halves = np.full(n_lamina - 1, 0.5)
    return sp.diags_array([halves, halves], offsets=[0, 1], shape=(n_lamina - 1, n_lamina)).tocsr()


def tangential_krons(
    plan: Plan, spacing: Reals | float, modulus: Reals, weight: Reals | float = 1.0, axes: str = "xy"
) -> tuple[Kron, ...]:
    """Return the tangential contact stiffness for a shear modulus modulus[k] weight(x, y).

    Parameters
    ----------
    plan : Plan
        The lamina's mesh.
    spacing : float or (n_interface,)
        Distance of neighbouring mid-planes, m.
    modulus : (n_interface,)
        Shear modulus of each interface, Pa.
    weight : float or (n_element, n_point)
        Its variation over the plan, at the plan's quadrature points.
    axes : "xy", "x" or "y"
        Directions of slip that it resists.
    """
    n_lamina = modulus.size + 1
    d, a = jump(n_lamina), mean(n_lamina)
    over: Any = sp.diags_array(modulus / spacing)
    g: Any = sp.diags_array(modulus)
    times: Any = sp.diags_array(modulus * spacing)
    krons: list[Kron] = []
    directions: dict[str, tuple[Field, Derivative]] = {"x": ("u", "x"), "y": ("v", "y")}
    for axis in axes:
        field, slope = directions[axis]
        krons += [
            Kron(row=field, column=field, z=(d.T @ over @ d).tocsr(), planar=plan.form(field, field, weight=weight)),
            Kron(row=field, column="w", z=(d.T @ g @ a).tocsr(), planar=plan.form(field, "w", ("", slope), weight)),
            Kron(row="w", column="w", z=(a.T @ times @ a).tocsr(), planar=plan.form("w", "w", (slope, slope), weight)),
        ]
    return tuple(krons)


def normal_krons(plan: Plan, spacing: Reals | float, modulus: Reals, weight: Reals | float = 1.0) -> tuple[Kron, ...]:
    """Return the normal contact stiffness for a tangent modulus modulus[k] weight(x, y).

    Parameters
    ----------
    plan : Plan
        The lamina's mesh.
    spacing : float or (n_interface,)
        Distance of neighbouring mid-planes, m.
    modulus : (n_interface,)
        Tangent modulus of each interface, Pa.
    weight : float or (n_element, n_point)
        Its variation over the plan, at the plan's quadrature points.
    """
    d = jump(modulus.size + 1)
    e: Any = sp.diags_array(modulus / spacing)
    return (Kron(row="w", column="w", z=(d.T @ e @ d).tocsr(), planar=plan.form("w", "w", weight=weight)),)


SEPARATION = 1e-6  # largest error of a field written as a sum of products, relative to its largest value


Product = tuple[Reals, Reals | float]  # over the interfaces, over the plan

ContactQuantity = Literal["pressure", "normal", "pressure squared", "pressure times normal"]


@dataclass(frozen=True, eq=False, kw_only=True)
class ContactField:
    """A coefficient of the contact over interfaces and plan, as a short sum of products.

    Attributes
    ----------
    stack : Stack
        What it belongs to.
    plan : Plan
        The lamina's mesh.
    products : sequence of ((n_interface,), float or (n_element, n_point))
        Factors over the interfaces and over the plan's quadrature points.
    """

    stack: Stack
    plan: Plan
    products: Sequence[Product]

    def tangential(self, modulation: Reals | float = 1.0, axes: str = "xy") -> tuple[Kron, ...]:
        """Return the tangential stiffness with the field, times a `modulation` over the plan, as shear modulus."""
        return tuple(
            kron
            for over_z, weight in self.products
            for kron in tangential_krons(self.plan, self.stack.spacing, over_z, _times(weight, modulation), axes)
        )

    def normal(self, modulation: Reals | float = 1.0) -> tuple[Kron, ...]:
        """Return the normal stiffness with the field, times a `modulation` over the plan, as tangent modulus."""
        return tuple(
            kron
            for over_z, weight in self.products
            for kron in normal_krons(self.plan, self.stack.spacing, over_z, _times(weight, modulation))
        )

    def over_interfaces(self, share: Reals) -> ContactField:
        """Return the field with each interface multiplied by its `share`, (n_interface,)."""
        return replace(self, products=[(share * over_z, weight) for over_z, weight in self.products])


def _times(weight: Reals | float, modulation: Reals | float) -> Reals | float:
    return weight if isinstance(modulation, float) and modulation == 1.0 else weight * modulation


def contact_fields(stack: Stack, plan: Plan) -> dict[ContactQuantity, ContactField]:
    """Return the fields that the linearised contact is made of.

    They are "pressure", p over its mean, "normal", the tangent modulus in Pa, "pressure squared" and "pressure times
    normal". Each is off by at most 1e-6 of its largest value and is 0 where a soft layer takes the place of
    contact.
    """
    touching = stack.touching
    products: list[list[Product]]
    distribution = pressure_distribution(stack)
    if distribution is None:
        normal = stack.contact.normal_modulus * touching
        products = [[(touching, 1.0)], [(normal, 1.0)], [(touching, 1.0)], [(normal, 1.0)]]
    else:
        points = plan.quadrature_points
        p, tangent = distribution.at(points.reshape(2, -1).T)
        p, tangent = p / stack.contact.pressure * touching[:, None], tangent * touching[:, None]
        products = [_products(value, points.shape[1:]) for value in (p, tangent, p**2, p * tangent)]
    return {
        name: ContactField(stack=stack, plan=plan, products=found)
        for name, found in zip(get_args(ContactQuantity), products, strict=True)
    }


def contact_terms(stack: Stack, plan: Plan) -> tuple[Term, ...]:
    """Return stiffness and damping of the contact: G = G_f p, beta = d_f p, and the normal tangent modulus.

    The parameter `pressure` is the mean pressure. Under uneven pressure every coefficient is a field over interfaces
    and plan, integrated over the area at the plan's quadrature points; its distribution is that at the stack's own
    mean pressure.
    """
    field = contact_fields(stack, plan)

    def term(name: str, target: Target, powers: dict[str, int], krons: tuple[Kron, ...]) -> Term:
        return Term(name=name, target=target, factor=Monomial(exponent=powers), krons=krons)

    uniform = stack.pressing is None
    tangential, normal = field["pressure"].tangential(), field["normal"].normal()
    squared = tangential if uniform else field["pressure squared"].tangential()
    mixed = normal if uniform else field["pressure times normal"].normal()
    return (
        term("tangential contact", "K", {"G_f": 1, "pressure": 1}, tangential),
        term("normal contact", "K", {"normal_modulus": 1}, normal),
        term("tangential contact damping", "C", {"d_f": 1, "G_f": 1, "pressure": 2}, squared),
        term("normal contact damping", "C", {"d_f": 1, "normal_modulus": 1, "pressure": 1}, mixed),
        *interlayer_terms(stack, plan),
    )


def _products(value: Reals, shape: tuple[int, ...]) -> list[Product]:
    found = separate(value, SEPARATION)
    return [(over_z, weight.reshape(shape)) for over_z, weight in zip(found.over_z, found.over_plan, strict=True)]


def interlayer_terms(stack: Stack, plan: Plan) -> tuple[Term, ...]:
    """Return stiffness and mass of the soft layers; the factor `layer_modulus` scales all their moduli."""
    if not stack.interlayers:
        return ()
    spacing = stack.spacing
    shear, normal, mass = np.zeros((3, spacing.size))
    for layer in stack.interlayers:
        i = layer.below - 1
        # the faces of the laminas slip by spacing times the strain, and all of it shears the layer
        shear[i] = layer.shear_modulus * spacing[i] / layer.thickness
        normal[i] = layer.normal_modulus * spacing[i] / layer.thickness
        mass[i] = layer.density * layer.thickness
    middle = mean(stack.n_lamina)
    over_z = middle.T @ (mass[:, None] * middle.toarray())
    krons = [Kron(row=f, column=f, z=over_z, planar=plan.form(f, f)) for f in ("u", "v", "w")]
    return (
        Term(
            name="interlayers",
            target="K",
            factor=Monomial(exponent={"layer_modulus": 1}),
            krons=(*tangential_krons(plan, spacing, shear), *normal_krons(plan, spacing, normal)),
        ),
        Term(name="interlayer mass", target="M", factor=Monomial(exponent={}), krons=tuple(krons)),
    )


@dataclass(frozen=True, kw_only=True)
class SlipLaw:
    """Shear stress of an interface over its shear strain.

    Attributes
    ----------
    friction : float
        mu, traction over pressure at which an interface slides as a whole.
    exponent : float
        chi, of the power law of slip limits, above -1; the loss of a cycle grows with strain to the 3 + chi.
    spike : float
        beta, what slips at once when everything slides, over what slips before, 0 or above.

    Raises
    ------
    ValueError
        A parameter lies outside its range.
    """

    friction: float
    exponent: float = -0.5
    spike: float = 0.0

    def __post_init__(self) -> None:
        if not (self.friction > 0.0 and self.exponent > -1.0 and self.spike >= 0.0):
            raise ValueError(f"{self}: friction must be above 0, the exponent above -1, the spike 0 or above")

    @property
    def _power(self) -> tuple[float, float]:
        """Density of the power law of slip limits, R, and stiffness of the spike, S (Segalman 2005, eq. 19)."""
        return (self.exponent + 1.0) / (1.0 + self.spike), self.spike / (1.0 + self.spike)

    @property
    def strength(self) -> float:
        """Stress at which everything slides, over that of a contact that never slips."""
        density, spike = self._power
        return density / (self.exponent + 2.0) + spike

    def sliding_strain(self, G_f: float) -> float:
        """Return the shear strain gamma_slide from which an interface slides as a whole (Segalman 2005, eq. 23)."""
        return self.friction / (G_f * self.strength)

    def stress(self, x: Reals) -> Reals:
        """Return the stress at strains x, 0 or above, at first loading (Segalman 2005, eq. 20), (n,)."""
        density, _ = self._power
        below = x - density * x ** (self.exponent + 2.0) / ((self.exponent + 1.0) * (self.exponent + 2.0))
        return np.where(x < 1.0, below, self.strength)

    def softening(self, x: Reals) -> Reals:
        """Return by which share a cycle of strain amplitude x, 0 or above, lowers the stiffness, (n,).

        It is that of the stress's first harmonic. The loop is the curve of first loading, twice as large (Masing's
        rules). Below sliding the integral over it is a ratio of gamma functions; beyond, a sum over sliders, each with
        the describing function of a Jenkins element.
        """
        spike = self._power[1]
        share = self._at_sliding * np.minimum(x, 1.0) ** (self.exponent + 1.0)
        beyond = x > 1.0
        if np.any(beyond):
            limit, weight = self._limits
            stuck = _jenkins(limit / x[beyond, None])
            share[beyond] = (1.0 - stuck) @ weight + spike * (1.0 - _jenkins(1.0 / x[beyond]))
        return share

    def reach(self, softening: float) -> float:
        """Return the strain x at which a cycle would lower the stiffness by a share, were none above 1."""
        return float((softening / self._at_sliding) ** (1.0 / (self.exponent + 1.0)))

    @property
    def _at_sliding(self) -> float:
        """Softening where everything is about to slide."""
        n = self.exponent + 2.0
        gamma = np.exp(scipy.special.gammaln(n + 0.5) - scipy.special.gammaln(n + 1.0))
        return float(4.0 / np.sqrt(np.pi) * gamma / (n + 1.0) * self._power[0] / (n - 1.0))

    def growth(self, x: Reals) -> Reals:
        """Return the derivative of `softening` by the logarithm of the strain amplitude x, (n,)."""
        _, spike = self._power
        grown = (self.exponent + 1.0) * self.softening(np.minimum(x, 1.0))
        beyond = x > 1.0
        if np.any(beyond):
            limit, weight = self._limits
            grown[beyond] = _growing(limit / x[beyond, None]) @ weight + spike * _growing(1.0 / x[beyond])
        return grown

    def loss(self, x: Reals) -> Reals:
        """Return the energy lost in a cycle of strain amplitude x over pi x**2, a loss factor, (n,).

        Below sliding it is Segalman 2005, eq. 28; beyond, each slider of limit t loses 4 t (x - t).
        """
        n = self.exponent + 2.0
        density, spike = self._power
        reach = np.minimum(x, 1.0)
        slid = density * (x * reach**n / n - reach ** (n + 1.0) / (n + 1.0)) + spike * np.maximum(x - 1.0, 0.0)
        return 4.0 * slid / (np.pi * np.where(x > 0.0, x, 1.0) ** 2)

    @cached_property
    def _limits(self) -> tuple[Reals, Reals]:
        """Slip limits and weights that integrate over the power law (Gauss and Jacobi)."""
        nodes = 60  # of the integral over slip limits where everything slides at the peak
        density, _ = self._power
        node, weight = scipy.special.roots_jacobi(nodes, 0.0, self.exponent)
        return 0.5 * (node + 1.0), density * weight / 2.0 ** (self.exponent + 1.0)

    def sliders(self, count: int) -> tuple[Reals, Reals]:
        """Return slip limits and stiffnesses, ``(count + 1,)`` each, of that many Jenkins elements and of the spike.

        The power law is cut into equal parts of its stiffness, each of which slips where it does on average.
        """
        density, spike = self._power
        m = self.exponent + 1.0
        edge = np.linspace(0.0, 1.0, count + 1) ** (1.0 / m)
        stiffness = np.full(count, density / m / count)
        limit = density * np.diff(edge ** (m + 1.0)) / (m + 1.0) / stiffness
        return np.append(limit, 1.0), np.append(stiffness, spike)


def _jenkins(limit: Reals) -> Reals:
    """Return the first harmonic of a Jenkins element's stress over that of its spring, for a slip limit 0 to 1."""
    angle = np.arccos(np.clip(1.0 - 2.0 * limit, -1.0, 1.0))
    return np.asarray((angle - np.sin(angle) * np.cos(angle)) / np.pi)


def _growing(limit: Reals) -> Reals:
    """Return the derivative of `_jenkins` by the logarithm of the slip limit."""
    return np.asarray(8.0 / np.pi * limit**1.5 * np.sqrt(1.0 - limit))
