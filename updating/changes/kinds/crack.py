"""A crack or a cut: laminas broken across a line.

Moments across the line turn it, the more the nearer its middle: by 4 m sqrt(a**2 - s**2) / ((3 + nu) (1 - nu) D) under
a moment m per length in a thin plate with a through crack of length 2 a, and forces open it likewise (Sih, Paris and
Erdogan, J. Appl. Mech. 29, 1962). An amplitude of 1 is such a crack; one that is not through has less.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from updating.changes.candidate import Candidates, Kind, at_heights, crossed, lines, needs_laminas, plain
from updating.changes.fields import Fields, Vector
from updating.changes.structure import Part

_LENGTHS = np.array([0.07, 0.14, 0.25, 0.4, 0.6])  # over the root of the plan's area
_ANGLES = np.pi * np.arange(4) / 4.0
_MOST = 3.0  # beside edges, and where cracks are long, more opens than in an endless plate


def candidates(fields: Fields, at: Vector) -> Candidates:
    """Return cracks of several lengths in four directions."""
    scale = float(np.sqrt(fields.grid.area.sum()))
    nu, layers = fields.stack.material.poisson, fields.layers
    length, centre = crossed(scale * _LENGTHS, at)
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
        upper=_MOST,
    )


def _length(candidates: Candidates, found: Vector) -> Vector:
    """Return the length of a crack through all the depth that opens as much, m: what opens grows with its square."""
    size = candidates.size.reshape(-1, *(1,) * (found.ndim - 1))
    return np.asarray(size * np.sqrt(found))


KIND = Kind(
    name="crack",
    label="a crack or cut",
    quantity="length, were it through all the depth",
    unit="m",
    why_not=needs_laminas,
    candidates=candidates,
    value=_length,
    exact=None,
)
