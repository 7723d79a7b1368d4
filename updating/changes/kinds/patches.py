"""Patches where laminas, or the contact between them, are softer or stiffer: bells and stripes at several heights."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import scipy.sparse as sp

from updating.changes.candidate import (
    Candidates,
    Kind,
    at_heights,
    bumps,
    crossed,
    gone,
    needs_contact,
    needs_laminas,
    plain,
)
from updating.changes.fields import Fields, Layer, Vector
from updating.changes.structure import Part

_FAR = 3.0
"""Largest amplitude: a patch that is all gone takes more from the stiffness than what it held, for strains concentrate
around it (Eshelby, Proc. R. Soc. A 241, 1957: 1 / (1 - S), S near a half in bending; 3 is a hole's in the plane)."""


def patches(
    fields: Fields, at: Vector, *, of: Callable[[Fields, Layer], Vector], sign: float, upper: float = _FAR
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
    key = "patches", at.tobytes()
    if key not in fields.shared:
        fields.shared[key] = _bells(fields, at)
    side, centre, weights = fields.shared[key]
    n, layers = len(centre), fields.layers
    parts = [
        Part(rows=of(fields, layer), target="K", weight=weight, sign=sign)
        for layer, weight in zip(layers, weights, strict=True)
    ]
    location = np.vstack([at_heights(centre, layer.z) for layer in layers])
    return plain(
        location,
        tuple(parts),
        size=np.tile(side, len(layers)),
        layer=np.repeat(np.arange(len(layers)), n),
        upper=upper,
        n_cell=len(at),
    )


def _bells(fields: Fields, at: Vector) -> tuple[Vector, Vector, list[Any]]:
    """Return the smallest sides of patches at locations, their middles, and their weights in each layer alone."""
    # Radii of patches over the root of the plan's area: smaller ones act as one point does, larger ones as the whole.
    # They are a third apart: of a large change those at twice the size are off by more than assemblies scatter
    radii = np.geomspace(0.05, 0.5, 9)
    # The same across stripes all along the plan, in both directions: an edge, or one side, may be what changed
    stripes = np.geomspace(0.09, 0.5, 6)
    scale = float(np.sqrt(fields.grid.area.sum()))
    endless = np.full(len(stripes), np.inf)
    sides = scale * np.vstack([
        np.column_stack([radii, radii]), np.column_stack([endless, stripes]), np.column_stack([stripes, endless]),
    ])  # fmt: skip
    radius, centre = crossed(sides, at)
    weight, layers = bumps(fields.grid, centre, radius), fields.layers
    nothing = sp.csr_array(weight.shape)
    weights = [
        sp.vstack([weight if j == i else nothing for j in range(len(layers))]).tocsr() for i in range(len(layers))
    ]
    return radius.min(axis=1), centre, weights


KINDS = (
    Kind(
        name="softer_patch",
        label="a patch of less stiffness",
        quantity="share of its stiffness that is gone",
        why_not=needs_laminas,
        candidates=partial(patches, of=Fields.strain, sign=-1.0),
        value=gone,
        whole=1.0,
    ),
    Kind(
        name="stiffer_patch",
        label="a patch of more stiffness",
        quantity="share by which it is stiffer",
        why_not=needs_laminas,
        candidates=partial(patches, of=Fields.strain, sign=1.0, upper=10.0),
    ),
    Kind(
        name="lost_contact",
        label="contact between sheets lost in a patch",
        quantity="share of its stiffness that is gone",
        why_not=needs_contact,
        candidates=partial(patches, of=Fields.contact, sign=-1.0, upper=2.0),
        value=gone,
        whole=1.0,
    ),
    Kind(
        name="glued_patch",
        label="sheets that hold together more in a patch, as by glue",
        quantity="share by which their contact is stiffer",
        why_not=needs_contact,
        candidates=partial(patches, of=Fields.contact, sign=1.0, upper=20.0),
    ),
)
