"""A hole, or material taken out: stiffness and mass are gone together.

Strains concentrate around a hole. Of a small round one in a thin plate, whose loads stay, 2 / (1 - nu) of the energy
goes that was in its area by a mean curvature or a mean strain, and of the rest of the energy 4 / (3 + nu) where it is
bent, 4 / (1 + nu) where it is stretched in its plane (Kirsch's solution, and that of a bent plate: Timoshenko and
Woinowsky-Krieger, Theory of Plates and Shells, 1959). Where the mean curvature varies within the hole's area, forces
shear the plate and more goes: of the variation 2 / (1 - nu) + 4 / (3 + nu) beside, 2.4 times as much as of an even
curvature in all, by the same solution for deflections r**(n + 2) cos(n phi) of any n > 0.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from updating.changes.candidate import Candidates, Kind, at_heights, crossed, needs_laminas, plain
from updating.changes.fields import Fields, Vector
from updating.changes.structure import Part


def candidates(fields: Fields, at: Vector) -> Candidates:
    """Return holes of several radii; an amplitude of 1 is all that is within the outline."""
    most = 2.0  # a hole may be larger than its neighbour in this list is
    # over the root of the plan's area; curvatures vary within a hole, so that one for one of half the area is off
    radii = np.geomspace(0.02, 0.17, 8)
    radius, centre = crossed(float(np.sqrt(fields.grid.area.sum())) * radii, at)
    share, whole, more = _share(fields, centre, radius), fields.layers[0], _more(fields)
    bent = fields.evenly_bent(whole)
    # the square of a mean is taken from that of all, and what is left is of the variation
    root = np.sqrt(np.maximum(share.sum(axis=1), 1e-300))
    even = (share @ bent.reshape(len(bent), -1)).reshape(-1, *bent.shape[1:]) / root[:, None, None]
    return plain(
        at_heights(centre, 0.0),
        (
            Part(rows=fields.around_hole(whole), target="K", weight=-share),
            Part(rows=bent, target="K", weight=-more * share),
            Part(rows=even, target="K", weight=more * sp.identity(len(radius), format="csr")),
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
    every, bent = (
        fields.around_hole(fields.layers[0])[share.indices],
        fields.evenly_bent(fields.layers[0])[share.indices],
    )
    varied = bent - np.average(bent, axis=0, weights=share.data)
    rows = np.concatenate([every, np.sqrt(_more(fields)) * varied], axis=1) * np.sqrt(share.data)[:, None, None]
    # as few rows that have the same squares
    value, axes = la.eigh(np.tensordot(rows, rows, axes=((0, 1), (0, 1))))
    keep = value > least * value[-1]
    return np.asarray(np.sqrt(value[keep])[:, None] * axes[:, keep].T)


def _more(fields: Fields) -> float:
    """Return what more of the energy by a mean curvature goes where that varies, over that energy."""
    nu = fields.stack.material.poisson
    return 2.0 / (1.0 - nu) + 4.0 / (3.0 + nu)


def _share(fields: Fields, centre: Vector, radius: Vector) -> sp.csr_array:
    """Return discs about locations, (n, n_point): areas, which sum to a hole's where it is within.

    One that is smaller than a few cells of the grid is so wide and has that much less of each.
    """
    grid = fields.grid
    step = max(float(line[1] - line[0]) for line in (grid.x, grid.y))
    wide = np.maximum(radius, 2.0 * step)[:, None]
    apart = np.hypot(*(centre[:, [axis]] - grid.point[:, axis] for axis in (0, 1)))
    disc = np.clip((wide - apart) / step + 0.5, 0.0, 1.0) * (radius[:, None] / wide) ** 2
    return sp.csr_array(disc).multiply(grid.area).tocsr()


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
