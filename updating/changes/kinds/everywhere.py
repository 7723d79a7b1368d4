"""What kinds share that are not local: one change all over the structure."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from updating.changes.candidate import Candidates, plain
from updating.changes.fields import Fields
from updating.changes.kinds.held_edges import whole_edges
from updating.changes.structure import Part


def whole_contact(fields: Fields) -> Part:
    """Return the stiffness of all interfaces against slip."""
    return Part(rows=fields.slip(fields.layers[0]), target="K", weight=sp.csr_array(fields.grid.area[None, :]))


def interfaces(fields: Fields) -> tuple[Part, ...]:
    """Return all interfaces as one part."""
    return (whole_contact(fields),)


def whole_laminas(fields: Fields) -> Part:
    """Return the stiffness of all laminas."""
    rows = fields.strain(fields.layers[0])
    return Part(rows=rows, target="K", weight=sp.csr_array(fields.grid.area[None, :]))


def all_over(
    fields: Fields,
    at: NDArray[np.float64],  # noqa: ARG001
    *,
    of: Callable[[Fields], tuple[Part, ...]],
    sign: float,
    upper: float,
) -> Candidates:
    """Return each of some parts as a candidate, with more (sign 1) or less (-1) of it."""
    parts = of(fields)
    n = len(parts)
    weights = [np.zeros((n, 1)) for _ in parts]
    for i, line in enumerate(weights):
        line[i] = sign
    shifted = tuple(
        Part(rows=part.rows, target=part.target, weight=sp.csr_array(line @ part.weight.toarray()))
        for part, line in zip(parts, weights, strict=True)
    )
    location = np.zeros((n, 3))
    location[:, :2] = fields.grid.point.mean(axis=0)
    return plain(location, shifted, upper=upper)


def edges(fields: Fields) -> tuple[Part, ...]:
    """Return each held edge as a whole, against moving and against turning."""
    return tuple(part for _, _, part in whole_edges(fields))
