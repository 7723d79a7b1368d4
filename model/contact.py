"""Stage 2: contact stiffness and damping between the laminas, linearised at the pressure between them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from model.mesh import Plan
from model.normal_contact import normal_krons
from model.pressure import separate
from model.stack import Pressing, Stack
from model.static import press
from model.system import Kron, Monomial, Term
from model.tangential_contact import mean, tangential_krons

SEPARATION = 1e-6  # largest error of a field written as a sum of products, relative to its largest value

Vector = NDArray[np.float64]
Product = tuple[Vector, Vector | float]  # over the interfaces, over the plan


def contact_terms(stack: Stack, plan: Plan) -> tuple[Term, ...]:
    """Return stiffness and damping of the contact: G = G_f p, beta = d_f p, and the normal tangent modulus.

    Under uneven pressure every coefficient is a field over interfaces and plan. It is written as a short sum of
    products, off by at most 1e-6 of its largest value, and each product is integrated over the area at the plan's
    quadrature points. Soft layers take the place of contact where they lie.
    """
    spacing = stack.spacing
    touching = np.ones(spacing.size)
    touching[[layer.below - 1 for layer in stack.interlayers]] = 0.0
    if stack.pressing is None:
        pressure = stack.contact.pressure * touching
        normal = stack.contact.normal_modulus * touching
        fields: list[list[Product]] = [
            [(value, 1.0)] for value in (pressure, normal, pressure**2, pressure * normal)
        ]
    else:
        distribution = press(stack) if isinstance(stack.pressing, Pressing) else stack.pressing
        points = plan.quadrature_points
        p, tangent = distribution.at(points.reshape(2, -1).T)
        p, tangent = p * touching[:, None], tangent * touching[:, None]
        fields = [_products(value, points.shape[1:]) for value in (p, tangent, p**2, p * tangent)]

    def tangential(products: list[Product]) -> tuple[Kron, ...]:
        return tuple(
            k for over_z, weight in products for k in tangential_krons(plan, spacing, over_z, weight)
        )

    def across(products: list[Product]) -> tuple[Kron, ...]:
        return tuple(k for over_z, weight in products for k in normal_krons(plan, spacing, over_z, weight))

    def term(name: str, target: str, powers: dict[str, int], krons: tuple[Kron, ...]) -> Term:
        return Term(name=name, target=target, factor=Monomial(exponent=powers), krons=krons)  # type: ignore[arg-type]

    return (
        term("tangential contact", "K", {"G_f": 1}, tangential(fields[0])),
        term("normal contact", "K", {"normal_modulus": 1}, across(fields[1])),
        term("tangential contact damping", "C", {"d_f": 1, "G_f": 1}, tangential(fields[2])),
        term("normal contact damping", "C", {"d_f": 1, "normal_modulus": 1}, across(fields[3])),
        *interlayer_terms(stack, plan),
    )


def _products(value: Vector, shape: tuple[int, ...]) -> list[Product]:
    found = separate(value, SEPARATION)
    return [
        (over_z, weight.reshape(shape)) for over_z, weight in zip(found.over_z, found.over_plan, strict=True)
    ]


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
