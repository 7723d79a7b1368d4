"""The force of one clamp, a bolt that came loose or was tightened: pressure between sheets, and what its mass does."""

from __future__ import annotations

from functools import partial

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from model.effects.parts import clamp_bells
from updating.changes.candidate import Candidates, Kind, at_heights, crossed, gone, needs_clamps, plain
from updating.changes.fields import Fields, Vector, as_rows
from updating.changes.structure import Part


def _about_clamps(fields: Fields) -> NDArray[np.float64]:
    """Return slip about each clamp as rows, (n, R, m), all clamps for one reach after the other."""
    # Shares of the wide bell in which pressure falls about a clamp, the others being of the narrow one
    reaches = np.array([0.0, 0.5, 1.0])
    key = ("about clamps",)
    if key not in fields.shared:
        slip, area, (x, y) = fields.slip(fields.layers[0]), fields.grid.area, fields.grid.point.T
        bells = [clamp_bells(fields.stack, clamp) for clamp in fields.stack.clamps]
        found = []
        for reach in reaches:
            for narrow, wide in bells:
                root = np.sqrt(area * ((1.0 - reach) * narrow(x, y) + reach * wide(x, y)))
                rows = (root[:, None, None] * slip).reshape(-1, slip.shape[2])
                found.append(as_rows(rows.T @ rows))
        fields.shared[key] = np.array(found)
    return np.asarray(fields.shared[key])


def under_clamps(fields: Fields) -> list[Part]:
    """Return the contact about each clamp, as what presses evenly spreads."""
    rows = _about_clamps(fields)
    alone = np.eye(len(rows))[-len(fields.stack.clamps) :]
    return [Part(rows=rows, target="K", weight=sp.csr_array(line[None])) for line in alone]


def at_clamps(
    fields: Fields,
    at: NDArray[np.float64],  # noqa: ARG001
    *,
    sign: float,
    upper: float,
    rides: bool = False,
) -> Candidates:
    """Return each clamp with less (sign -1) or more (1) stiffness against slip about it.

    With `rides` its mass may also ride on a spring that is not stiff.
    """
    # Where the clamp's mass then resonates on its footprint, over the band's end: one that presses less rides on a
    # softer spring. They are 3 % apart, for what is lightly damped acts sharply within the band
    resonances = np.array([np.inf, *np.geomspace(0.5, 3.0, 64)])
    # Share of the contact's stiffness that goes with the whole of the clamp's mass riding so
    shares_together = np.array([0.1, 0.2, 0.4, 0.7, 1.0])
    clamps = fields.stack.clamps
    rows = _about_clamps(fields)
    springs, together = (resonances, shares_together) if rides else (resonances[:1], shares_together[-1:])
    which, spring, share_of = crossed(np.arange(len(rows)), springs, together)
    alone = np.isinf(spring) & (share_of < 1.0)  # the same as with the whole share
    which, spring, share_of = (each[~alone] for each in (which, spring, share_of))
    number, held = which % len(clamps), sp.csr_array(share_of[:, None] * np.eye(len(rows))[which])
    parts = [Part(rows=rows, target="K", weight=held, sign=sign)]
    if rides:
        mass = sp.csr_array(np.eye(len(clamps))[number])
        resonance = (2.0 * np.pi * fields.band[1] * spring) ** 2
        parts.append(Part(rows=fields.clamps, target="M", weight=mass, resonance=resonance))
        parts.append(Part(rows=fields.clamps, target="M", weight=mass, sign=-1.0))
    return plain(
        at_heights(np.array([[clamp.x, clamp.y] for clamp in clamps])[number], 0.0),
        tuple(parts),
        part=number,
        extra=share_of,
        upper=upper,
    )


def _share(clamps: Candidates, found: Vector) -> Vector:
    """Return the share of the contact's stiffness that goes with an amplitude, which may go with the clamp's mass."""
    return np.asarray(clamps.extra.reshape(-1, *(1,) * (found.ndim - 1)) * found)


def _gone(clamps: Candidates, found: Vector) -> Vector:
    """Return the share that is gone under the clamp."""
    return gone(clamps, _share(clamps, found))


KINDS = (
    Kind(
        name="loose_clamp",
        label="a clamp that presses less",
        quantity="share of the contact's stiffness under it that is gone",
        why_not=needs_clamps,
        candidates=partial(at_clamps, sign=-1.0, upper=1.5, rides=True),
        on_plan=False,
        value=_gone,
        exact=_share,
        whole=1.0,
    ),
    Kind(
        name="tight_clamp",
        label="a clamp that presses more",
        quantity="share by which the contact under it is stiffer",
        why_not=needs_clamps,
        candidates=partial(at_clamps, sign=1.0, upper=5.0),
        on_plan=False,
    ),
)
