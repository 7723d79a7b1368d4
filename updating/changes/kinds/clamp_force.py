"""What kinds share that change the force of one clamp: the pressure between sheets under and around it."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from updating.changes.candidate import Candidates, at_heights, crossed, plain
from updating.changes.fields import Fields
from updating.changes.structure import Part

_SPREAD = np.array([0.5, 1.0, 2.0])
"""How far the pressure of a clamp spreads along the stack beyond its footprint, over the stack's height: by 45 degrees
from both faces it is a half."""


_RIDES = np.array([np.inf, *np.geomspace(0.5, 3.0, 16)])
"""Where the clamp's mass then resonates on its footprint, over the band's end: one that presses less rides on a softer
spring."""
_TOGETHER = np.array([0.1, 0.2, 0.4, 0.7, 1.0])
"""Share of the contact's stiffness that goes with the whole of the clamp's mass riding so."""


def _pressed(fields: Fields, number: int, wide: float) -> NDArray[np.float64]:
    """Return the area that a clamp presses at each point, m2: 1 under it, falling within a length beyond."""
    clamp = fields.stack.clamps[number]
    sides = np.array(clamp.footprint) / 2.0
    away = np.maximum(np.abs(fields.grid.point - np.array([clamp.x, clamp.y])) - sides, 0.0)
    return np.asarray(np.exp(-np.sum(away**2, axis=1) / wide**2) * fields.grid.area)


def under_clamps(fields: Fields) -> list[Part]:
    """Return the contact under each clamp, pressed by 45 degrees from its faces."""
    rows = fields.contact(fields.layers[0])
    wide = float(_SPREAD[0]) * fields.stack.height
    return [
        Part(rows=rows, target="K", weight=sp.csr_array(_pressed(fields, i, wide)[None, :]))
        for i in range(len(fields.stack.clamps))
    ]


def at_clamps(
    fields: Fields,
    at: NDArray[np.float64],  # noqa: ARG001
    *,
    sign: float,
    upper: float,
    rides: bool = False,
) -> Candidates:
    """Return each clamp with less (sign -1) or more (1) of the contact's stiffness under it.

    With `rides` its mass may also ride on a spring that is not stiff.
    """
    stack, point, area = fields.stack, fields.grid.point, fields.grid.area
    springs, together = (_RIDES, _TOGETHER) if rides else (_RIDES[:1], _TOGETHER[-1:])
    number, spread, spring, share_of = crossed(
        np.arange(len(stack.clamps)), _SPREAD * stack.height, springs, together
    )
    alone = np.isinf(spring) & (share_of < 1.0)  # the same as with the whole share
    number, spread, spring, share_of = (each[~alone] for each in (number, spread, spring, share_of))
    under, place = [], []
    for clamp in stack.clamps:
        sides = np.array(clamp.footprint) / 2.0
        inside = np.all(np.abs(point - np.array([clamp.x, clamp.y])) <= sides + 1e-3, axis=1)
        near = np.zeros(len(point))
        near[np.argmin(np.sum((point - np.array([clamp.x, clamp.y])) ** 2, axis=1))] = 1.0
        share = np.where(inside, area, 0.0) if inside.any() else near
        under.append(clamp.mass * share / share.sum())
        place.append([clamp.x, clamp.y])
    whole, step = fields.layers[0], len(_SPREAD)
    pressed = [_pressed(fields, i, wide) for i in range(len(place)) for wide in _SPREAD * stack.height]
    held = (
        share_of[:, None] * np.array(pressed)[step * number + np.searchsorted(_SPREAD * stack.height, spread)]
    )
    parts = [Part(rows=fields.contact(whole), target="K", weight=sp.csr_array(held), sign=sign)]
    if rides:
        mass = sp.csr_array(np.array(under)[number])
        resonance = (2.0 * np.pi * fields.band[1] * spring) ** 2
        parts.append(Part(rows=fields.motion(whole), target="M", weight=mass, resonance=resonance))
        parts.append(Part(rows=fields.motion(whole), target="M", weight=mass, sign=-1.0))
    return plain(
        at_heights(np.array(place)[number], 0.0),
        tuple(parts),
        size=spread,
        part=number,
        extra=share_of,
        upper=upper,
    )
