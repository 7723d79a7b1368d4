"""Contact of all interfaces, as by pressure that rose or fell everywhere, and other changes all over a structure."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from updating.changes.candidate import Candidates, Kind, needs_contact, plain
from updating.changes.fields import Fields
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


KINDS = (
    Kind(
        name="softer_contact",
        label="less contact stiffness all over, as by less pressure",
        quantity="share of it that is gone",
        why_not=needs_contact,
        candidates=partial(all_over, of=interfaces, sign=-1.0, upper=1.0),
        on_plan=False,
        local=False,
    ),
    Kind(
        name="firmer_contact",
        label="more contact stiffness all over, as by more pressure",
        quantity="share by which it is stiffer",
        why_not=needs_contact,
        candidates=partial(all_over, of=interfaces, sign=1.0, upper=10.0),
        on_plan=False,
        local=False,
    ),
)
