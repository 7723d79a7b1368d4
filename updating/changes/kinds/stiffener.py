"""A stiffener along a line: a strip or rib that adds bending stiffness and mass."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from updating.changes.candidate import Candidates, Kind, at_heights, crossed, lines, needs_laminas, plain
from updating.changes.fields import Fields, Vector
from updating.changes.structure import Part, Structure

_ANGLES = np.pi * np.arange(8) / 8.0


def why_not(structure: Structure) -> str | None:
    """Return why a thick stack has no stiffener: it would be one by its sheets."""
    stack = structure.stack
    if stack is None:
        return needs_laminas(structure)
    return None if stack.n_lamina == 1 else "a strip stiffens a single plate only"


def candidates(fields: Fields, at: Vector) -> Candidates:
    """Return strips of the structure's material, their width being the size."""
    thicknesses = np.array([0.2, 0.7, 2.5])  # of a strip of the same material, over the structure's thickness
    lengths = np.array([0.25, 0.5, 1.0])  # over the root of the plan's area
    scale, h = float(np.sqrt(fields.grid.area.sum())), fields.stack.pitch
    young = fields.theta.get("young", 1.0) * fields.stack.material.young
    rho = fields.theta.get("density", 1.0) * fields.stack.material.density
    length, thick, centre = crossed(scale * lengths, h * thicknesses, at)
    n, m = len(centre), len(_ANGLES)
    mass_parts, parts = [], []
    for j, angle in enumerate(_ANGLES):
        weight = lines(fields.grid, centre, np.full(n, angle), length)
        inertia = thick**3 / 12.0 + thick * ((h + thick) / 2.0) ** 2  # of unit width, about the plate's middle
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


KINDS = (
    Kind(
        name="stiffener",
        label="a stiffener along a line",
        quantity="width of a strip of the same material",
        unit="m",
        why_not=why_not,
        candidates=candidates,
    ),
)
