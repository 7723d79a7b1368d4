"""What kinds of change need of a structure: rows of its modes at locations, what scatters in it, and how it answers.

Stacks and plates are one such structure (`updating.changes.fields`), matrices of another program are another
(`updating.changes.nodes`). Kinds that ask for no more than this hold for both.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from model import Stack

Vector = NDArray[np.float64]


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
        For an amplitude of 1. Parts that share them hold the same matrix.
    sign : 1 or -1
        Whether that is added or taken away.
    resonance : (n_candidate,) float, optional
        Eigenvalue, (rad/s)**2, of a mass that rides on a spring; infinite where it is tied. At a mode lambda such a
        mass acts as one that is 1 / (1 - lambda / resonance) times as large.
    """

    rows: Vector
    target: Literal["K", "M"]
    weight: Any
    sign: float = 1.0
    resonance: Vector | None = None

    def only(self, which: NDArray[np.intp]) -> Part:
        """Return what it is for some of the candidates."""
        resonance = None if self.resonance is None else self.resonance[which]
        return replace(self, weight=self.weight[which], resonance=resonance)


@dataclass(frozen=True, eq=False, kw_only=True)
class Tied:
    """What moves where something may be tied to a structure.

    Attributes
    ----------
    location : (n, 3) float
        Where, m.
    rows : (n_point, R, m) float
        Rows of the modes, whose squares sum to that of the motion.
    weight : (n, n_point) sparse
        Which of them each location has.
    part : (n,) int
        Number by which the structure names each; -1 where it has no name for it.
    """

    location: Vector
    rows: Vector
    weight: Any
    part: NDArray[np.intp]


@dataclass(frozen=True, eq=False, kw_only=True)
class StatedTerm:
    """A term that a structure file states.

    Attributes
    ----------
    name : str
        Its name.
    parts : tuple of Part
        What all of it is, as one candidate; what a factor of 1 adds where the reference has nothing of it.
    there : bool
        Whether the reference has any of it.
    """

    name: str
    parts: tuple[Part, ...]
    there: bool


@dataclass(frozen=True, eq=False, kw_only=True)
class Answers:
    """Static answers of a structure to forces about a location, beside its reduced coordinates.

    Attributes
    ----------
    vectors : (n, k) float
        They, in the rows of the structure.
    stiffness, mass : (n_basis + k, k) float
        Stiffness and mass between the reduced coordinates and them, and among them.
    """

    vectors: Vector
    stiffness: Vector
    mass: Vector


class Structure(Protocol):
    """A structure about a fitted reference, as kinds of change see it."""

    n_mode: int
    band: tuple[float, float]
    """Lowest and highest measured natural frequency, Hz."""
    vectors: Vector
    """Its modes, and vectors after them, in its equations of motion, (n, n_mode)."""

    @property
    def stack(self) -> Stack | None:
        """The stack, None where the model knows of no laminas."""

    @property
    def stated(self) -> tuple[StatedTerm, ...]:
        """Terms of a structure file; none of a stack."""

    @property
    def axes(self) -> tuple[str, ...]:
        """Axes along which a location is said, the first two being those of its map; none where nobody knows it."""

    @property
    def ends(self) -> tuple[str, ...]:
        """What the lower ends along these are called, where they have a name."""

    @property
    def box(self) -> Vector:
        """Lowest and highest coordinates along the axes of the map, (2, 2) m."""

    @property
    def mass(self) -> float:
        """All of its mass, kg."""

    @property
    def removable(self) -> float:
        """Largest mass that may go at one location, kg."""

    @property
    def stiffest(self) -> float:
        """Stiffness of a spring beyond which it is no spring, N/m."""

    def locations(self) -> tuple[Vector, Vector]:
        """Return locations, evenly spaced, (n, 2) over a plan or (n, 3), m, and their steps along the axes."""

    def finer(self, centre: Vector, step: Vector) -> Vector:
        """Return locations within the cell about each of some, more closely; none is off the structure."""

    def located(self, location: Vector) -> Vector:
        """Return locations of candidates, (n, 3), as `locations` has them."""

    def tied(self, at: Vector) -> Tied:
        """Return what a mass moves with at locations."""

    def pulled(self, at: Vector) -> Tied:
        """Return what a spring pulls at: all locations for one direction after the other."""

    def layer_name(self, number: int) -> str:
        """Return what a part of the height is called; empty where it is all of it."""

    def part_name(self, kind: str, number: int) -> str:
        """Return what a clamp, edge, node or term is called."""

    def matrices(self) -> tuple[Vector, Vector, Vector]:
        """Return the modes in the coordinates of the reduced structure, and its stiffness and mass in these."""

    def answers(self, location: Vector, half: float) -> Answers | None:
        """Return answers to forces within a distance of a location, None where the structure is taken as reduced."""

    def beside(self, coordinates: Vector, answers: Vector | None) -> Structure:
        """Return it with more vectors after its modes: combinations (n_basis, k) of its coordinates, plus others."""
