"""Candidates: changes of one kind, each with a location, a size and an angle, as weighted sums of squares of rows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from updating.changes.fields import Grid
from updating.changes.structure import Part, Structure

Vector = NDArray[np.float64]


@dataclass(frozen=True, eq=False, kw_only=True)
class Candidates:
    """Changes of one kind: where, how large, and what they do to the equations of motion for an amplitude of 1.

    Attributes
    ----------
    location : (n, 3) float
        Their middles, m.
    size : (n,) float
        Radius or length, m; NaN where a kind has none.
    angle : (n,) float
        Direction against the x axis, rad; NaN where a kind has none.
    layer : (n,) int
        Part of the height, 0 for all of it.
    part : (n,) int
        Number of the clamp, edge, node or term that it sits at, from 0; -1 where a kind has none.
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

    location: Vector
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
        return len(self.location)

    def only(self, which: NDArray[np.intp]) -> Candidates:
        """Return some of them."""
        return Candidates(
            location=self.location[which],
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
        for name in ("location", "size", "angle", "layer", "part", "cell", "extra", "form")
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
        Takes the structure; why it cannot have such a change, None where it can.
    candidates : callable
        Takes the structure, its `Fields` where the kind is of laminas, and locations, (n, 2) over the plan or (n, 3),
        m; returns what to try there, for each size and direction all locations one after the other. Kinds that may not
        be anywhere look at the structure alone.
    value : callable
        Takes candidates and amplitudes, (n,) or (n, k); returns sizes in SI units.
    local : bool
        Whether it sits at one location; otherwise it is all over.
    on_plan : bool
        Whether that location may be anywhere; otherwise it is a clamp or an edge.
    exact : callable, optional
        The same as `value` of amplitudes that were estimated with the structure's answer
        (`updating.changes.refined`); None where nothing but first order is known.
    opened : callable, optional
        Takes the structure and one candidate; returns how stresses open it, rows C' of the vectors, (r, m): C C' is
        what an amplitude of 1 takes from the stiffness at loads that stay (`updating.changes.refined`).
    whole : float
        Largest amplitude then: 1 where that is all there is.
    splits : bool
        Whether it makes two modes of one, so that a state without a further mode cannot have it.
    """

    name: str
    label: str
    quantity: str
    why_not: Callable[[Structure], str | None]
    candidates: Callable[[Any, Vector], Candidates]
    unit: str = "1"
    value: Callable[[Candidates, Vector], Vector] = field(default_factory=lambda: amplitude)
    exact: Callable[[Candidates, Vector], Vector] | None = field(default_factory=lambda: amplitude)
    opened: Callable[[Any, Candidates], Vector] | None = None
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


def always(structure: Structure) -> str | None:  # noqa: ARG001
    """Return None: any structure can have it."""
    return None


_NO_LAMINAS = "its model is matrices, which know of no laminas"


def needs_laminas(structure: Structure) -> str | None:
    """Return why matrices cannot have a change of strains in a patch: only their terms say which part strains."""
    return _NO_LAMINAS if structure.stack is None else None


def needs_contact(structure: Structure) -> str | None:
    """Return why a structure without interfaces cannot have a change of contact."""
    stack = structure.stack
    if stack is None:
        return _NO_LAMINAS
    return None if stack.n_lamina > 1 else "one lamina has no contact with another"


def needs_supports(structure: Structure) -> str | None:
    """Return why a structure that nothing holds cannot have a change of what holds it."""
    stack = structure.stack
    if stack is None:
        return "its model is matrices, in which a stated term holds it"
    return None if stack.supports else "nothing holds it"


def needs_clamps(structure: Structure) -> str | None:
    """Return why a structure without clamps cannot have a change of them."""
    stack = structure.stack
    if stack is None:
        return _NO_LAMINAS
    return None if stack.clamps and stack.n_lamina > 1 else "it has no clamps that press laminas together"


_END = np.exp(-6.0)  # of a bell's height, below which it is nothing


def bumps(grid: Grid, centre: Vector, radius: Vector) -> Any:
    """Return weights of bells about locations, (n, n_point): areas where the bell is 1.

    Radii are (n,), or (n, 2) along x and y, infinite where a bell is a stripe.
    """
    along = radius[:, None] if radius.ndim == 1 else radius
    x, y = (
        np.exp(-(((centre[:, [axis]] - line) / along[:, [min(axis, along.shape[1] - 1)]]) ** 2))
        for axis, line in enumerate((grid.x, grid.y))
    )
    bell = (x[:, :, None] * y[:, None]).reshape(len(centre), -1)[:, grid.inside.ravel()]
    bell[bell < _END] = 0.0
    return sp.csr_array(bell).multiply(grid.area).tocsr()


def lines(
    grid: Grid,
    centre: Vector,
    angle: Vector,
    length: Vector,
    profile: Callable[[Vector], Vector] = np.ones_like,
    n: int = 12,
) -> Any:
    """Return weights of lines about locations, (n, n_point): lengths, times a profile along each, from -1 to 1."""
    node, share = np.polynomial.legendre.leggauss(n)
    half = length[:, None] / 2.0
    along = np.column_stack([np.cos(angle), np.sin(angle)])
    location = centre[:, None] + half[:, :, None] * node[None, :, None] * along[:, None]
    which, shares = grid.shares(location.reshape(-1, 2))
    weight = shares.reshape(len(centre), n, 4) * (half * share * profile(node))[:, :, None]
    row = np.broadcast_to(np.arange(len(centre))[:, None, None], weight.shape)
    found = sp.coo_array((weight.ravel(), (row.ravel(), which.ravel())), shape=(len(centre), len(grid.point)))
    return found.tocsr()


def crossed(*parts: NDArray[Any]) -> list[NDArray[Any]]:
    """Return all combinations of values: arrays of as many rows as there are combinations, of each part one."""
    number = np.meshgrid(*(np.arange(len(part)) for part in parts), indexing="ij")
    return [part[index.ravel()] for part, index in zip(parts, number, strict=True)]


def at_heights(location: Vector, heights: float | Vector) -> Vector:
    """Return locations over the plan with heights, (n, 3)."""
    return np.column_stack([location, np.broadcast_to(np.asarray(heights, float), (len(location),))])


def plain(
    location: Vector,
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
    """Return candidates at locations (n, 3), what is not given being none; `n_cell` locations repeat themselves."""
    n = len(location)
    nothing = np.full(n, np.nan)
    return Candidates(
        location=location,
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
