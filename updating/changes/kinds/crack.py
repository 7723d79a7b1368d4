"""A crack or a cut: laminas broken across a line.

Moments across the line turn it, the more the nearer its middle: by 4 m sqrt(a**2 - s**2) / ((3 + nu) (1 - nu) D) under
a moment m per length in a thin plate with a through crack of length 2 a, and forces open it likewise (Sih, Paris and
Erdogan, J. Appl. Mech. 29, 1962). An amplitude of 1 is such a crack; one that is not through has less. Where moments
vary along it, openings sqrt(a**2 - s**2) U_j(s / a) take the part U_j of them each, the more stiffly by j + 1 (Erdogan
and Gupta, Q. Appl. Math. 29, 1972).
"""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from scipy import special

from updating.changes.candidate import Candidates, Kind, at_heights, crossed, lines, needs_laminas, plain
from updating.changes.fields import Fields, Vector
from updating.changes.structure import Part

_ANGLES = np.pi * np.arange(4) / 4.0
_STEP = 0.02  # over the root of the plan's area, by which moments are compared across a line


def candidates(fields: Fields, at: Vector) -> Candidates:
    """Return cracks of several lengths in four directions."""
    most = 3.0  # beside edges, and where cracks are long, more opens than in an endless plate
    lengths = np.array([0.07, 0.14, 0.25, 0.4, 0.6])  # over the root of the plan's area
    scale = float(np.sqrt(fields.grid.area.sum()))
    nu, layers = fields.stack.material.poisson, fields.layers
    length, centre = crossed(scale * lengths, at)
    n = len(centre)
    found, parts = [], []
    opens = 4.0 / ((3.0 + nu) * (1.0 - nu))
    for angle in _ANGLES:
        weight = lines(fields.grid, centre, np.full(n, angle), length, lambda t: opens * np.sqrt(1.0 - t**2))
        found.append(sp.diags_array(length / 2.0) @ weight)
    total = n * len(_ANGLES) * len(layers)
    for i, layer in enumerate(layers):
        for j, angle in enumerate(_ANGLES):
            first = (i * len(_ANGLES) + j) * n
            weight = sp.coo_array(found[j])
            weight = sp.csr_array(
                (-weight.data, (weight.coords[0] + first, weight.coords[1])), shape=(total, found[j].shape[1])
            )
            parts.append(Part(rows=fields.across(layer, float(angle)), target="K", weight=weight))
    m = len(_ANGLES)
    return plain(
        np.vstack([at_heights(np.tile(centre, (m, 1)), layer.z) for layer in layers]),
        tuple(parts),
        size=np.tile(length, m * len(layers)),
        angle=np.tile(np.repeat(_ANGLES, n), len(layers)),
        layer=np.repeat(np.arange(len(layers)), n * m),
        n_cell=len(at),
        upper=most,
    )


def _opened(fields: Fields, crack: Candidates) -> Vector:
    """Return how stresses across one crack open it, by the functions in which it opens; see `Kind.opened`.

    The faces of a crack in a single plate also slide past each other: they are free of shear as well. A jump of the
    deflection whose slope along the crack is sqrt(a**2 - s**2) U_j costs what a jump of the slope across does.
    """
    n_along = 24  # points along a crack
    n_opening = 4  # functions U_j
    nu, angle, half = fields.stack.material.poisson, float(crack.angle[0]), float(crack.size[0]) / 2.0
    t, weight = np.polynomial.legendre.leggauss(n_along)
    location = crack.location[0, :2] + half * t[:, None] * [np.cos(angle), np.sin(angle)]
    which, share = fields.grid.shares(location)
    weight = weight * share.sum(axis=1)  # of what is within the outline
    slope = np.sqrt(1.0 - t**2) * special.eval_chebyu(np.arange(n_opening)[:, None], t)  # (j, t)
    number = 1.0 + np.arange(n_opening)
    closed = (slope * weight / np.sqrt(1.0 - t**2)) @ slope.T
    closed *= (number[:, None] + number) / 2.0 * (3.0 + nu) * (1.0 - nu) / 4.0
    if fields.stack.n_lamina > 1:
        across = fields.across(fields.layers[int(crack.layer[0])], angle)
        rows = np.einsum("pk,pkrm->prm", share / np.maximum(share.sum(axis=1), 0.1)[:, None], across[which])
        return _eased(closed, half * np.einsum("jp,prm->jrm", slope * weight, rows))
    moment, twist, shear = _resultants(fields, location, angle)
    turned = half * (slope * weight) @ moment
    phi, n = np.arccos(t), number[:-1, None]  # jumps whose slopes are the functions from the second on
    jump = (np.sin((n + 2.0) * phi) / (n + 2.0) - np.sin(n * phi) / n) / 2.0
    slid = half * ((half * jump * weight) @ shear - 2.0 * (slope[1:] * weight) @ twist)
    return np.vstack([_eased(closed, turned[:, None]), _eased(closed[1:, 1:], slid[:, None])])


def _eased(closed: Vector, forces: Vector) -> Vector:
    """Return forces (j, r, m) on openings whose stiffness is a matrix (j, j) as rows for a stiffness of 1 each."""
    alike = 1e-3  # of the largest stiffness: openings with less are the others
    value, turn = la.eigh(closed)  # where little of a crack is within the plan, its functions are alike
    keep = value > alike * value[-1]
    eased = np.tensordot((turn[:, keep] / np.sqrt(value[keep])).T, forces, axes=1)
    return np.asarray(eased.reshape(-1, forces.shape[2]))


def _resultants(fields: Fields, location: Vector, angle: float) -> tuple[Vector, Vector, Vector]:
    """Return moment across a line, twist along it and the derivative of the moment across it, (n_place, m) each.

    They are of a single plate and over the root of its bending stiffness.
    """
    normal, along = np.array([-np.sin(angle), np.cos(angle)]), np.array([np.cos(angle), np.sin(angle)])
    plan, (q11, q12, q22, q66) = fields.system.assembly.plan, fields.plane_stress
    step = _STEP * float(np.sqrt(fields.grid.area.sum()))
    before, after = plan.nearest(location - step * normal), plan.nearest(location + step * normal)
    every = np.vstack([location, before, after])
    phi = float(fields.system.phi["w"][0, 0])
    x, y, xy = (phi * fields.at_points(every, "w", d)[:, 0] for d in ("xx", "yy", "xy"))
    (c, s), thick = normal, fields.stack.pitch**3 / 12.0
    stiff = c**4 * q11 + s**4 * q22 + 2.0 * c**2 * s**2 * (q12 + 2.0 * q66)
    scale = np.sqrt(thick / stiff)
    m_x, m_y, m_xy = scale * (q11 * x + q12 * y), scale * (q12 * x + q22 * y), scale * 2.0 * q66 * xy
    across = c * c * m_x + s * s * m_y + 2.0 * c * s * m_xy
    twist = c * along[0] * m_x + s * along[1] * m_y + (c * along[1] + s * along[0]) * m_xy
    n, apart = len(location), np.maximum((after - before) @ normal, 0.1 * step)
    return across[:n], twist[:n], (across[2 * n :] - across[n : 2 * n]) / apart[:, None]


def _length(candidates: Candidates, found: Vector) -> Vector:
    """Return the length of a crack through all the depth that opens as much, m: what opens grows with its square."""
    size = candidates.size.reshape(-1, *(1,) * (found.ndim - 1))
    return np.asarray(size * np.sqrt(found))


KINDS = (
    Kind(
        name="crack",
        label="a crack or cut",
        quantity="length, were it through all the depth",
        unit="m",
        why_not=needs_laminas,
        candidates=candidates,
        value=_length,
        exact=_length,
        opened=_opened,
    ),
)
