"""Changes of laminas: cracks, holes, stiffeners, and patches that are softer or stiffer.

Moments across the line of a crack turn it, the more the nearer its middle: by 4 m sqrt(a**2 - s**2) / ((3 + nu) (1 -
nu) D) under a moment m per length in a thin plate with a through crack of length 2 a, and force it open likewise (Sih,
Paris and Erdogan, J. Appl. Mech. 29, 1962). An amplitude of 1 is such a crack; one that is not through has less.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import scipy.sparse as sp

from model import Stack
from updating.changes.candidate import (
    Candidates,
    Kind,
    Part,
    always,
    amplitude,
    at_heights,
    bumps,
    crossed,
    gone,
    lines,
    plain,
)
from updating.changes.fields import Fields, Layer, Vector

_CRACK_LENGTHS = np.array([0.07, 0.14, 0.25, 0.4, 0.6])  # over the root of the plan's area

_ANGLES = np.pi * np.arange(4) / 4.0

_MOST_OPENING = 3.0  # beside edges, and where cracks are long, more opens than in an endless plate


def crack_candidates(fields: Fields, at: Vector) -> Candidates:
    """Return cracks of several lengths in four directions."""
    scale = float(np.sqrt(fields.grid.area.sum()))
    nu, layers = fields.stack.material.poisson, fields.layers
    length, centre = crossed(scale * _CRACK_LENGTHS, at)
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
        upper=_MOST_OPENING,
    )


def crack_length(candidates: Candidates, found: Vector) -> Vector:
    """Return the length of a crack through all the depth that opens as much, m: what opens grows with its square."""
    size = candidates.size.reshape(-1, *(1,) * (found.ndim - 1))
    return np.asarray(size * np.sqrt(found))


CRACK = Kind(
    name="crack",
    label="a crack or cut",
    quantity="length, were it through all the depth",
    unit="m",
    why_not=always,
    candidates=crack_candidates,
    value=crack_length,
    exact=None,
)

_TAKES = 2.3
"""Share of the stiffness in a small hole's area that goes with it: between the 2 and 3 of bending and of forces in the
plane, for strains concentrate around it."""

_RADIUS = 0.02  # over the root of the plan's area, of the bell that stands for a small hole


def hole_candidates(fields: Fields, at: Vector) -> Candidates:
    """Return holes, their area being the size."""
    scale = float(np.sqrt(fields.grid.area.sum()))
    bell = bumps(fields.grid, at, np.full(len(at), max(_RADIUS * scale, 1.5 * _step(fields))))
    share = bell.multiply(1.0 / np.maximum(np.asarray(bell.sum(axis=1)), 1e-300)[:, None]).tocsr()
    whole = fields.layers[0]
    area = fields.grid.area.sum()
    return plain(
        at_heights(at, 0.0),
        (
            Part(rows=fields.strain(whole), target="K", weight=-_TAKES * share),
            Part(rows=fields.motion(whole), target="M", weight=-fields.mass / area * share),
        ),
        n_cell=len(at),
        upper=0.1 * float(area),
    )


def _step(fields: Fields) -> float:
    return float(max(fields.grid.x[1] - fields.grid.x[0], fields.grid.y[1] - fields.grid.y[0]))


def _diameter(candidates: Candidates, found: Vector) -> Vector:  # noqa: ARG001
    """Return the diameter of a round hole of an area, m."""
    return np.asarray(np.sqrt(4.0 * found / np.pi))


HOLE = Kind(
    name="hole",
    label="a hole",
    quantity="diameter, were it round",
    unit="m",
    why_not=always,
    candidates=hole_candidates,
    value=_diameter,
    exact=None,
)

_STIFFENER_LENGTHS = np.array([0.25, 0.5, 1.0])  # over the root of the plan's area

_THICK = np.array([0.2, 0.7, 2.5])  # of a strip of the same material, over the structure's thickness


def stiffener_why_not(stack: Stack) -> str | None:
    """Return why a thick stack has no stiffener: it would be one by its sheets."""
    return None if stack.n_lamina == 1 else "a strip stiffens a single plate only"


def stiffener_candidates(fields: Fields, at: Vector) -> Candidates:
    """Return strips of the structure's material, their width being the size."""
    scale, h = float(np.sqrt(fields.grid.area.sum())), fields.stack.pitch
    young = fields.theta.get("young", 1.0) * fields.stack.material.young
    rho = fields.theta.get("density", 1.0) * fields.stack.material.density
    length, thick, centre = crossed(scale * _STIFFENER_LENGTHS, h * _THICK, at)
    n, m = len(centre), len(_ANGLES)
    mass_parts, parts = [], []
    for j, angle in enumerate(_ANGLES):
        weight = lines(fields.grid, centre, np.full(n, angle), length)
        inertia = (
            thick**3 / 12.0 + thick * ((h + thick) / 2.0) ** 2
        )  # of unit width, about the plate's middle
        blocks = [sp.csr_array(weight.shape)] * m
        blocks[j] = sp.diags_array(young * inertia) @ weight
        parts.append(Part(rows=fields.along(float(angle)), target="K", weight=sp.vstack(blocks).tocsr()))
        mass_parts.append(sp.diags_array(rho * thick) @ weight)
    parts.append(Part(rows=fields.motion(fields.layers[0]), target="M", weight=sp.vstack(mass_parts).tocsr()))
    return plain(
        at_heights(np.tile(centre, (m, 1)), 0.0),
        tuple(parts),
        size=np.tile(length, m),
        angle=np.repeat(_ANGLES, n),
        n_cell=len(at),
        upper=0.2 * scale,
    )


STIFFENER = Kind(
    name="stiffener",
    label="a stiffener along a line",
    quantity="width of a strip of the same material",
    unit="m",
    why_not=stiffener_why_not,
    candidates=stiffener_candidates,
    value=amplitude,
)

RADII = np.array([0.05, 0.09, 0.16, 0.28, 0.5])
"""Radii of patches over the root of the plan's area: smaller ones act as one point does, larger ones as the whole."""

STRIPES = np.array([0.09, 0.16, 0.28])
"""The same across stripes all along the plan, in both directions: an edge, or one side, may be what changed."""

_FAR = 3.0
"""Largest amplitude: a patch that is all gone takes more from the stiffness than what it held, for strains concentrate
around it (Eshelby, Proc. R. Soc. A 241, 1957: 1 / (1 - S), S near a half in bending; 3 is a hole's in the plane)."""


def patches(
    fields: Fields,
    at: Vector,
    *,
    of: Callable[[Fields, Layer], Vector],
    sign: float,
    upper: float = _FAR,
) -> Candidates:
    """Return patches whose stiffness is more (sign 1) or less (-1) by a share.

    Parameters
    ----------
    fields : Fields
        The structure.
    at : (n, 2)
        Locations, m.
    of : callable
        Rows of a layer of the structure whose squares are the energy per area.
    sign : float
        1 or -1.
    upper : float
        Largest share.
    """
    scale = float(np.sqrt(fields.grid.area.sum()))
    endless = np.full(len(STRIPES), np.inf)
    sides = scale * np.vstack([
        np.column_stack([RADII, RADII]), np.column_stack([endless, STRIPES]), np.column_stack([STRIPES, endless]),
    ])  # fmt: skip
    radius, centre = crossed(sides, at)
    weight = sign * bumps(fields.grid, centre, radius)
    n, layers = len(centre), fields.layers
    parts = []
    for i, layer in enumerate(layers):
        blocks = [weight if j == i else sp.csr_array(weight.shape) for j in range(len(layers))]
        parts.append(Part(rows=of(fields, layer), target="K", weight=sp.vstack(blocks).tocsr()))
    place = np.vstack([at_heights(centre, layer.z) for layer in layers])
    return plain(
        place,
        tuple(parts),
        size=np.tile(radius.min(axis=1), len(layers)),
        layer=np.repeat(np.arange(len(layers)), n),
        upper=upper,
        n_cell=len(at),
    )


SOFTER_PATCH = Kind(
    name="softer_patch",
    label="a patch of less stiffness",
    quantity="share of its stiffness that is gone",
    unit="1",
    why_not=always,
    candidates=partial(patches, of=Fields.strain, sign=-1.0),
    value=gone,
    whole=1.0,
)

STIFFER_PATCH = Kind(
    name="stiffer_patch",
    label="a patch of more stiffness",
    quantity="share by which it is stiffer",
    unit="1",
    why_not=always,
    candidates=partial(patches, of=Fields.strain, sign=1.0, upper=10.0),
    value=amplitude,
)
