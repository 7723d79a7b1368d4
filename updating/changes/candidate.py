"""Candidates: changes of one kind, each with a location, a size and an angle, as weighted sums of squares of rows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from model import Stack
from updating.changes.fields import Fields, Grid

Vector = NDArray[np.float64]

N_PLACE = 220
"""Locations at which a kind is tried on one lamina; on a stack, where most have a height as well, half as many."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Part:
    """A weighted sum of squares of rows that a change adds to the stiffness or to the mass.

    Attributes
    ----------
    rows : (n_point, R, m) float
        Rows of the modes at points. Parts that share them hold the same array.
    target : "K" or "M"
        What it is added to.
    weight : (n_candidate, n_point) sparse
        For an amplitude of 1.
    resonance : (n_candidate,) float, optional
        Eigenvalue, (rad/s)**2, of a mass that rides on a spring; infinite where it is tied. At a mode lambda such a
        mass acts as one that is 1 / (1 - lambda / resonance) times as large.
    """

    rows: Vector
    target: Literal["K", "M"]
    weight: Any
    resonance: Vector | None = None

    def only(self, which: NDArray[np.intp]) -> Part:
        """Return what it is for some of the candidates."""
        resonance = None if self.resonance is None else self.resonance[which]
        return Part(rows=self.rows, target=self.target, weight=self.weight[which], resonance=resonance)


@dataclass(frozen=True, eq=False, kw_only=True)
class Candidates:
    """Changes of one kind: where, how large, and what they do to the equations of motion for an amplitude of 1.

    Attributes
    ----------
    place : (n, 3) float
        Their middles, m.
    size : (n,) float
        Radius or length, m; NaN where a kind has none.
    angle : (n,) float
        Direction against the x axis, rad; NaN where a kind has none.
    layer : (n,) int
        Part of the height, 0 for all of it.
    part : (n,) int
        Number of the clamp, edge or patch that it sits at, from 0; -1 where a kind has none.
    parts : tuple of Part
        What they add.
    upper : float
        Largest amplitude.
    cell : (n,) int
        Number of the location among those that were given, -1 where a kind is not of the plan.
    extra : (n,) float
        What else a kind needs for its size; NaN where that is nothing.
    form : (n,) int
        Number of the size, direction, height and so on among those that are tried at each location.
    """

    place: Vector
    size: Vector
    angle: Vector
    layer: NDArray[np.intp]
    part: NDArray[np.intp]
    parts: tuple[Part, ...]
    upper: float
    cell: NDArray[np.intp]
    extra: Vector
    form: NDArray[np.intp]

    @property
    def n(self) -> int:
        """How many they are."""
        return len(self.place)

    def only(self, which: NDArray[np.intp]) -> Candidates:
        """Return some of them."""
        return Candidates(
            place=self.place[which],
            size=self.size[which],
            angle=self.angle[which],
            layer=self.layer[which],
            part=self.part[which],
            parts=tuple(part.only(which) for part in self.parts),
            upper=self.upper,
            cell=self.cell[which],
            extra=self.extra[which],
            form=self.form[which],
        )


def joined_candidates(one: Candidates, other: Candidates) -> Candidates:
    """Return candidates of one kind together, without what they add: that is weighed by then."""
    both = {
        name: np.concatenate([getattr(one, name), getattr(other, name)])
        for name in ("place", "size", "angle", "layer", "part", "cell", "extra", "form")
    }
    return Candidates(**both, parts=(), upper=one.upper)


def amplitude(candidates: Candidates, found: Vector) -> Vector:  # noqa: ARG001
    """Return amplitudes as they are: where they are the size."""
    return found


@dataclass(frozen=True, kw_only=True)
class Kind:
    """A kind of change whose location nobody knows.

    Attributes
    ----------
    name : str
        Its key.
    label : str
        What it is called in a sentence: "a patch of less stiffness".
    quantity, unit : str
        What its size is, such as "mass", and its unit.
    why_not : callable
        Takes the stack; why it cannot have such a change, None where it can.
    candidates : callable
        Takes the fields and locations over the plan, (n, 2) m; returns what to try there, for each size and direction
        all locations one after the other. Kinds that are not of the plan look at the fields alone.
    value : callable
        Takes candidates and amplitudes, (n,) or (n, k); returns sizes in SI units.
    local : bool
        Whether it sits at one location; otherwise it is all over.
    on_plan : bool
        Whether that location may be anywhere on the plan; otherwise it is a clamp or an edge.
    exact : callable, optional
        The same as `value` of amplitudes that were estimated with the structure's answer
        (`updating.changes.refined`); None where its rows hold to first order only, as beside the tip of a crack.
    whole : float
        Largest amplitude then: 1 where that is all there is.
    splits : bool
        Whether it makes two modes of one, so that a state without a further mode cannot have it.
    """

    name: str
    label: str
    quantity: str
    unit: str
    why_not: Callable[[Stack], str | None]
    candidates: Callable[[Fields, Vector], Candidates]
    value: Callable[[Candidates, Vector], Vector]
    exact: Callable[[Candidates, Vector], Vector] | None = amplitude
    whole: float = np.inf
    local: bool = True
    on_plan: bool = True
    splits: bool = False


def gone(candidates: Candidates, found: Vector) -> Vector:  # noqa: ARG001
    """Return the share of a stiffness that is gone where a share `found` of the energy is, as modes had it before.

    Strains concentrate where less is left: of a patch that is all gone, an energy of 1 / (1 - S) times its share goes,
    with Eshelby's S near a half in bending.
    """
    return np.asarray(np.minimum(found / (1.0 + 0.5 * found), 1.0))


def always(stack: Stack) -> str | None:  # noqa: ARG001
    """Return None: any structure can have it."""
    return None


def needs_contact(stack: Stack) -> str | None:
    """Return why a stack without interfaces cannot have a change of contact."""
    return None if stack.n_lamina > 1 else "one lamina has no contact with another"


def needs_supports(stack: Stack) -> str | None:
    """Return why a structure that nothing holds cannot have a change of what holds it."""
    return None if stack.supports else "nothing holds it"


def needs_clamps(stack: Stack) -> str | None:
    """Return why a structure without clamps cannot have a change of them."""
    return None if stack.clamps and stack.n_lamina > 1 else "it has no clamps that press laminas together"


def places(fields: Fields) -> tuple[Vector, Vector]:
    """Return locations over the plan, (n, 2) m, evenly spaced, and their steps along x and y.

    The outer ones are half a step from the edges.
    """
    grid = fields.grid
    n = N_PLACE if fields.stack.n_lamina == 1 else N_PLACE // 2
    sides = [float(np.ptp(line)) for line in (grid.x, grid.y)]
    step = np.sqrt(sides[0] * sides[1] / n)
    lines, steps = [], []
    for line, side in zip((grid.x, grid.y), sides, strict=True):
        count = max(3, round(side / step))
        lines.append(line[0] + (np.arange(count) + 0.5) * side / count)
        steps.append(side / count)
    found = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, 2)
    _, share = grid.shares(found)
    return found[share.sum(axis=1) > 0.5], np.array(steps)


def finer(fields: Fields, centre: Vector, step: Vector, n: int = 3) -> Vector:
    """Return n by n locations within the cell about each of some, (n n k, 2), cell after cell; none is off the plan."""
    part = (np.arange(n) - (n - 1) / 2.0) / n
    away = np.stack(np.meshgrid(part, part, indexing="ij"), axis=-1).reshape(-1, 2) * step
    found = (centre[:, None] + away).reshape(-1, 2)
    low, high = np.asarray(fields.system.assembly.plan.bounds).T
    return np.clip(found, low, high)


def bumps(grid: Grid, centre: Vector, radius: Vector) -> Any:
    """Return weights of bells about places, (n, n_point): areas where the bell is 1.

    Radii are (n,), or (n, 2) along x and y, infinite where a bell is a stripe.
    """
    point, area = grid.point, grid.area
    along = radius[:, None] if radius.ndim == 1 else radius
    square = np.sum(((centre[:, None] - point) / along[:, None]) ** 2, axis=2)
    return sp.csr_array(np.where(square < 6.0, np.exp(-square) * area, 0.0))


def lines(
    grid: Grid,
    centre: Vector,
    angle: Vector,
    length: Vector,
    profile: Callable[[Vector], Vector] = np.ones_like,
    n: int = 12,
) -> Any:
    """Return weights of lines about places, (n, n_point): lengths, times a profile of the place along, from -1 to 1."""
    node, share = np.polynomial.legendre.leggauss(n)
    half = length[:, None] / 2.0
    along = np.column_stack([np.cos(angle), np.sin(angle)])
    place = centre[:, None] + half[:, :, None] * node[None, :, None] * along[:, None]
    which, shares = grid.shares(place.reshape(-1, 2))
    weight = shares.reshape(len(centre), n, 4) * (half * share * profile(node))[:, :, None]
    row = np.broadcast_to(np.arange(len(centre))[:, None, None], weight.shape)
    found = sp.coo_array((weight.ravel(), (row.ravel(), which.ravel())), shape=(len(centre), len(grid.point)))
    return found.tocsr()


def crossed(*parts: NDArray[Any]) -> list[NDArray[Any]]:
    """Return all combinations of values: arrays of as many rows as there are combinations, of each part one."""
    number = np.meshgrid(*(np.arange(len(part)) for part in parts), indexing="ij")
    return [part[own.ravel()] for part, own in zip(parts, number, strict=True)]


def at_heights(place: Vector, heights: float | Vector) -> Vector:
    """Return places over the plan with heights, (n, 3)."""
    return np.column_stack([place, np.broadcast_to(np.asarray(heights, float), (len(place),))])


def plain(
    place: Vector,
    parts: tuple[Part, ...],
    *,
    size: Vector | None = None,
    angle: Vector | None = None,
    layer: NDArray[np.intp] | None = None,
    part: NDArray[np.intp] | None = None,
    extra: Vector | None = None,
    upper: float = np.inf,
    n_cell: int = 0,
) -> Candidates:
    """Return candidates at places (n, 3), what is not given being none; `n_cell` locations repeat themselves."""
    n = len(place)
    nothing = np.full(n, np.nan)
    return Candidates(
        place=place,
        size=nothing if size is None else size,
        angle=nothing if angle is None else angle,
        layer=np.zeros(n, dtype=np.intp) if layer is None else layer,
        part=np.full(n, -1, dtype=np.intp) if part is None else part,
        parts=parts,
        upper=upper,
        cell=np.tile(np.arange(n_cell), n // n_cell) if n_cell else np.full(n, -1, dtype=np.intp),
        extra=nothing if extra is None else extra,
        form=np.arange(n, dtype=np.intp) // max(n_cell, 1),
    )


def three(values: Vector) -> tuple[float, float, float]:
    """Return a location as plain numbers."""
    x, y, z = (float(v) for v in values)
    return x, y, z
