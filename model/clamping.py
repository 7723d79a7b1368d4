"""Clamps: the masses that ride on the stack."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from model.mesh import FIELDS, Plan
from model.stack import Clamp, Stack
from model.system import Kron, Monomial, Term

_POINTS_PER_SIDE = 8  # Gauss points over a footprint; it may span several elements


def _footprint_points(clamp: Clamp) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return points (n, 2) and their shares (n,) of the mass."""
    nodes, weights = np.polynomial.legendre.leggauss(_POINTS_PER_SIDE)
    axes = [
        (centre + side / 2.0 * nodes, weights / 2.0) if side > 0.0 else (np.array([centre]), np.ones(1))
        for centre, side in zip((clamp.x, clamp.y), clamp.footprint, strict=True)
    ]
    x, y = np.meshgrid(axes[0][0], axes[1][0], indexing="ij")
    return np.column_stack([x.ravel(), y.ravel()]), np.outer(axes[0][1], axes[1][1]).ravel()


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
        points, shares = _footprint_points(clamp)
        z = sp.diags_array(clamp.mass * _height_shares(clamp, stack.n_lamina)).tocsr()
        krons = tuple(
            Kron(row=field, column=field, z=z, planar=plan.point_form(field, points, shares))
            for field in FIELDS
        )
        terms.append(Term(name=f"clamp {i} mass", target="M", factor=Monomial(exponent={}), krons=krons))
    return tuple(terms)
