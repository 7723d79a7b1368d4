"""Clamps: the masses that ride on the stack.

A clamp's effective mass moves with the mean displacement of the area that it presses, so it brings no rotary
inertia of its own. A mass at a point of a thin lamina would swing on the contact around it instead: on the
faces, such local modes crowd the band of the stack's own.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from model.elements.equations import Kron, Monomial, Term
from model.elements.mesh import FIELDS, Plan
from model.stack.parts import Clamp
from model.stack.stack import Stack

_MOST_PANELS = 24  # along one side of a footprint


def footprint_points(
    centre: tuple[float, float], size: tuple[float, float], plan: Plan
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return points (n, 2) of a rectangle on the plan and their weights (n,), which sum to 1.

    The rectangle is cut along the lines of the mesh, with three Gauss points in each direction between them, so
    means and first moments over it are exact for the fields of a rectangle; what overhangs the plan's bounding box does
    not count.
    """
    nodes, weights = np.polynomial.legendre.leggauss(3)
    places, shares = [], []
    for axis, (middle, side) in enumerate(zip(centre, size, strict=True)):
        start, stop = plan.bounds[axis]
        low, high = max(middle - side / 2.0, start), min(middle + side / 2.0, stop)
        lines = np.unique(plan.membrane.mesh.p[axis])
        lines = lines[(lines > low) & (lines < high)]
        if lines.size >= _MOST_PANELS:
            lines = np.linspace(low, high, _MOST_PANELS + 1)[1:-1]
        cuts = np.concatenate([[low], lines, [high]])
        half = np.diff(cuts)[:, None] / 2.0
        places.append((cuts[:-1, None] + half * (1.0 + nodes)).ravel())
        share = half / half.sum() if high > low else np.ones((1, 1))
        shares.append((share * weights / 2.0).ravel())
    x, y = np.meshgrid(*places, indexing="ij")
    return np.column_stack([x.ravel(), y.ravel()]), np.outer(*shares).ravel()


def height_shares(clamp: Clamp, n_lamina: int) -> NDArray[np.float64]:
    """Return which share of a clamp's mass each lamina carries, (n_lamina,)."""
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
        points, weights = footprint_points((clamp.x, clamp.y), clamp.footprint, plan)
        z = sp.diags_array(clamp.mass * height_shares(clamp, stack.n_lamina)).tocsr()
        krons = []
        for field in FIELDS:
            mean = sp.csr_matrix(weights @ plan.point_rows(field, points))
            krons.append(Kron(row=field, column=field, z=z, planar=(mean.T @ mean).tocsr()))
        terms.append(
            Term(name=f"clamp {i} mass", target="M", factor=Monomial(exponent={}), krons=tuple(krons))
        )
    return tuple(terms)
