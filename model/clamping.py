"""Clamps: the masses that ride on the stack.

A clamp's effective mass moves with the mean displacement of the area that it presses, so it brings no rotary
inertia of its own. A mass at a point of a thin lamina would swing on the contact around it instead: on the
faces, such local modes crowd the band of the stack's own.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from model.mesh import FIELDS, Plan
from model.stack import Clamp, Stack
from model.system import Kron, Monomial, Term

_POINTS_PER_SIDE = 8  # Gauss points over a footprint; it may span several elements


def _footprint_points(clamp: Clamp, stack: Stack) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return points (n, 2) of the area that a clamp presses and their weights (n,), which sum to 1."""
    nodes, weights = np.polynomial.legendre.leggauss(_POINTS_PER_SIDE)
    axes = []
    for centre, side, size in zip(
        (clamp.x, clamp.y), clamp.footprint, (stack.length, stack.width), strict=True
    ):
        low, high = max(centre - side / 2.0, -size / 2.0), min(centre + side / 2.0, size / 2.0)
        axes.append((low + high) / 2.0 + (high - low) / 2.0 * nodes)
    x, y = np.meshgrid(*axes, indexing="ij")
    return np.column_stack([x.ravel(), y.ravel()]), np.outer(weights, weights).ravel() / 4.0


def _height_shares(clamp: Clamp, n_lamina: int) -> NDArray[np.float64]:
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
        points, weights = _footprint_points(clamp, stack)
        z = sp.diags_array(clamp.mass * _height_shares(clamp, stack.n_lamina)).tocsr()
        krons = []
        for field in FIELDS:
            mean = sp.csr_matrix(weights @ plan.point_rows(field, points))
            krons.append(Kron(row=field, column=field, z=z, planar=(mean.T @ mean).tocsr()))
        terms.append(
            Term(name=f"clamp {i} mass", target="M", factor=Monomial(exponent={}), krons=tuple(krons))
        )
    return tuple(terms)
