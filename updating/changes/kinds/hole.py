"""A hole, or material taken out: stiffness and mass are gone together.

Strains concentrate around a hole. Of a small round one in a thin plate, whose loads stay, 2 / (1 - nu) of the energy
goes that was in its area by a mean curvature or a mean strain, and of the rest of the energy 4 / (3 + nu) where it is
bent, 4 / (1 + nu) where it is stretched in its plane (Kirsch's solution, and that of a bent plate: Timoshenko and
Woinowsky-Krieger, Theory of Plates and Shells, 1959).
"""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from updating.changes.candidate import Candidates, Kind, at_heights, bumps, crossed, needs_laminas, plain
from updating.changes.fields import Fields, Vector
from updating.changes.structure import Part


def candidates(fields: Fields, at: Vector) -> Candidates:
    """Return holes of several radii; an amplitude of 1 is all that is within the outline."""
    most = 2.0  # a hole may be larger than its neighbour in this list is
    radii = np.array([0.02, 0.035, 0.06, 0.1, 0.17])  # over the root of the plan's area
    radius, centre = crossed(float(np.sqrt(fields.grid.area.sum())) * radii, at)
    share, whole = _share(fields, centre, radius), fields.layers[0]
    return plain(
        at_heights(centre, 0.0),
        (
            Part(rows=fields.around_hole(whole), target="K", weight=-share),
            Part(rows=fields.motion(whole), target="M", weight=-fields.mass / fields.grid.area.sum() * share),
        ),
        extra=radius,
        n_cell=len(at),
        upper=most,
    )


def _opened(fields: Fields, holes: Candidates) -> Vector:
    """Return how the stresses about one hole strain it; see `Kind.opened`."""
    least = 1e-6  # of the largest energy: the rest is none
    share = _share(fields, holes.location[:, :2], holes.extra)
    rows = fields.around_hole(fields.layers[0])[share.indices] * np.sqrt(share.data)[:, None, None]
    # as few rows that have the same squares
    value, axes = la.eigh(np.tensordot(rows, rows, axes=((0, 1), (0, 1))))
    keep = value > least * value[-1]
    return np.asarray(np.sqrt(value[keep])[:, None] * axes[:, keep].T)


def _share(fields: Fields, centre: Vector, radius: Vector) -> sp.csr_array:
    """Return bells as wide as holes about locations, (n, n_point): areas, which sum to a hole's where it is within.

    A disc's mean square distance from its middle is half the square of its radius, a bell's the square of its own.
    """
    step = max(float(line[1] - line[0]) for line in (fields.grid.x, fields.grid.y))
    wide = np.maximum(radius / np.sqrt(2.0), 1.5 * step)
    return sp.csr_array(bumps(fields.grid, centre, wide).multiply((radius / wide)[:, None] ** 2))


def _diameter(candidates: Candidates, found: Vector) -> Vector:
    """Return the diameter of a hole whose area is an amplitude's share of that of a candidate, m."""
    radius = candidates.extra.reshape(-1, *(1,) * (found.ndim - 1))
    return np.asarray(2.0 * radius * np.sqrt(found))


KINDS = (
    Kind(
        name="hole",
        label="a hole",
        quantity="diameter, were it round",
        unit="m",
        why_not=needs_laminas,
        candidates=candidates,
        value=_diameter,
        exact=_diameter,
        opened=_opened,
    ),
)
