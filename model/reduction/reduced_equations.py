"""Reduced equations of motion, with what keeps them small: matrices of low rank, and bases in parts.

A clamp moves with the mean displacement under it, so its mass, and all that it does when it sits elsewhere, couple a
few dozen directions of several hundred. Most terms of a model with all effects are such: in full they would be two
thirds of its size. A basis has parts, too: what all modes need, and what they need beside it while an effect acts.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, fields, replace

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from model.elements.equations import OMEGA, ParameterFactor, Target
from model.stack.stack import Stack

Vectors = NDArray[np.float64]

_MOST = 1 / 10  # of the basis, that a range may span: with more, full matrices are as quick

_FEWEST = 40  # directions that it may have in any case

_RANK = 1e-11  # of the largest direction of a matrix, below which one is rounding

_SAME = 1e-7  # part of a unit direction beside others, below which it is theirs

_EXACT = 1e-11  # of a matrix's largest entry, to which it must be the same in its range

_SPARE = (
    8  # random vectors beyond the most directions, which show that a range has no more (Halko et al. 2011)
)


@dataclass(frozen=True, eq=False, kw_only=True)
class InRange:
    """A symmetric matrix, range @ core @ range'.

    Attributes
    ----------
    range : (n, r) float
        Columns that span all that the matrix can give; matrices that share it have the same object.
    core : (r, r) float
        The matrix between them.
    """

    range: Vectors
    core: Vectors


Matrix = Vectors | InRange
"""A symmetric matrix in full or in a range."""


def full(matrix: Matrix) -> Vectors:
    """Return a matrix in full, (n, n)."""
    if not isinstance(matrix, InRange):
        return matrix
    found = matrix.range @ matrix.core @ matrix.range.T
    return np.asarray((found + found.T) / 2.0)


def n_row(matrix: Matrix) -> int:
    """Return the number of rows of a matrix."""
    return len(matrix.range if isinstance(matrix, InRange) else matrix)


def summed(n: int, parts: Iterable[tuple[float, Matrix]]) -> Vectors:
    """Return the sum of factors times matrices in full, (n, n)."""
    total, share = np.zeros((2, n, n))
    between: dict[int, tuple[Vectors, Vectors]] = {}
    for factor, matrix in parts:
        if not isinstance(matrix, InRange):
            total += np.multiply(factor, matrix, out=share)
            continue
        shared, core = between.get(id(matrix.range), (matrix.range, np.zeros(matrix.core.shape)))
        between[id(matrix.range)] = shared, core + factor * matrix.core
    for shared, core in between.values():
        total += shared @ core @ shared.T
    return total


def in_ranges(matrices: Iterable[Vectors]) -> list[Matrix]:
    """Return matrices of low rank in ranges that they share, others as they are.

    Parameters
    ----------
    matrices : iterable of (n, n) float
        Symmetric. Those that follow each other are the likeliest to share a range; no more of them than may share one
        are kept in full at a time.
    """
    found: list[Matrix] = []
    group = _Group(range=np.zeros((0, 0)), members={})
    most, probe = _FEWEST, np.zeros((0, 0))
    for i, matrix in enumerate(matrices):
        found.append(matrix)
        if i == 0:
            most = max(int(_MOST * len(matrix)), _FEWEST)
            probe = np.random.default_rng(0).standard_normal((len(matrix), most + _SPARE))
        image = matrix @ probe
        own = _orthonormal(image, _RANK * float(np.max(np.linalg.norm(image, axis=0), initial=0.0)))
        if own.shape[1] > most:
            continue
        wider = group.wider(matrix, own)
        if wider is None or wider.shape[1] > most:
            found = group.put(found)
            group = _Group(range=own, members={i: matrix})
        else:
            group = _Group(range=wider, members={**group.members, i: matrix})
    return group.put(found)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Group:
    """Matrices in full, by their number, and a range that they share."""

    range: Vectors
    members: Mapping[int, Vectors]

    def wider(self, matrix: Vectors, own: Vectors) -> Vectors | None:
        """Return the range with that of another matrix; None if they can share none.

        What feels rigid-body motion shares no range with what does not, for there it must stay exactly 0.
        """
        if not self.members:
            return None
        first = next(iter(self.members.values()))
        return _with(self.range, own) if np.array_equal(first.any(axis=1), matrix.any(axis=1)) else None

    def put(self, found: list[Matrix]) -> list[Matrix]:
        """Return all matrices with those of the group in its range, where they are the same there."""
        for i, matrix in self.members.items():
            core = self.range.T @ matrix @ self.range
            ranged = InRange(range=self.range, core=(core + core.T) / 2.0)
            if np.abs(full(ranged) - matrix).max() <= _EXACT * np.abs(matrix).max():
                found[i] = ranged
        return found


def _with(shared: Vectors, own: Vectors) -> Vectors:
    """Return an orthonormal range with what another has beside it."""
    left = own
    for _ in range(2):  # of what is small, the first time leaves mostly rounding, which lies along the range
        left = left - shared @ (shared.T @ left)
        left = _orthonormal(left - shared @ (shared.T @ left), _SAME)
    return np.hstack([shared, left])


def _orthonormal(vectors: Vectors, least: float) -> Vectors:
    """Return an orthonormal range of vectors, exactly 0 where their rows are, without directions that are shorter.

    Rigid-body motion is felt by few matrices, and what rounding would put there is large times a large stiffness.
    """
    felt = np.flatnonzero(vectors.any(axis=1))
    direction, triangle, _ = la.qr(vectors[felt], mode="economic", pivoting=True)
    kept = direction[:, np.abs(np.diag(triangle)) > least]
    found = np.zeros((len(vectors), kept.shape[1]))
    found[felt] = kept
    return found


_NEARLY_ALL = 0.8  # of the spare coordinates, from which it is quicker to take all

_DEPENDENT = 1e-8  # part of a unit direction, beside those before it, that is rounding


@dataclass(frozen=True, eq=False, kw_only=True)
class Further:
    """Directions that modes need while one of some parameters takes part.

    Attributes
    ----------
    parameter : tuple of str
        Which.
    reach : float
        How far from its nominal value one has to be; with 0 it is enough that it may move.
    direction : (n_spare, k) float
        In the spare coordinates, orthonormal.
    """

    parameter: tuple[str, ...]
    reach: float
    direction: Vectors

    def takes_part(self, moved: Mapping[str, float], nominal: Mapping[str, float]) -> bool:
        """Tell whether one of the parameters is among those that move, and far enough from its nominal value."""
        return any(
            name in moved and abs(moved[name] - nominal[name]) >= self.reach for name in self.parameter
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class BasisParts:
    """How a basis is made: a core, spare coordinates, and then what was added for good.

    Attributes
    ----------
    n_core : int
        First coordinates, which all modes need.
    n_spare : int
        Next coordinates, which modes need while an effect takes part, and then few directions of them.
    further : tuple of Further
        These directions.
    """

    n_core: int
    n_spare: int
    further: tuple[Further, ...]

    def needed(self, moved: Mapping[str, float], nominal: Mapping[str, float]) -> tuple[int, ...]:
        """Return which of `further` take part while some parameters move, by their places."""
        return tuple(i for i, own in enumerate(self.further) if own.takes_part(moved, nominal))

    def space(self, needed: tuple[int, ...], size: int) -> Space | None:
        """Return the coordinates and directions that modes need, of a basis of some size; None of nearly all."""
        spare = slice(self.n_core, self.n_core + self.n_spare)
        used = [self.further[i].direction for i in needed]
        directions = np.hstack([np.zeros((self.n_spare, 0)), *used])
        if directions.shape[1] >= _NEARLY_ALL * self.n_spare:
            return None
        if len(used) > 1:
            directions, triangle, _ = la.qr(directions, mode="economic", pivoting=True)
            directions = directions[:, np.abs(np.diag(triangle)) > _DEPENDENT]
        kept = np.concatenate([np.arange(self.n_core), np.arange(spare.stop, size)])
        return Space(size=size, kept=kept, spare=spare, direction=directions)


@dataclass(frozen=True, eq=False, kw_only=True)
class Space:
    """Some coordinates of a basis and some directions of its spare ones, orthonormal together.

    Attributes
    ----------
    size : int
        Of the basis.
    kept : (n_kept,) int
        The coordinates, none of them spare.
    spare : slice
        The spare ones.
    direction : (n_spare, k) float
        The directions.
    """

    size: int
    kept: NDArray[np.intp]
    spare: slice
    direction: Vectors

    def matrices(self, whole: Iterable[Matrix]) -> Iterator[Matrix]:
        """Yield symmetric matrices of the basis, (size, size), in this space; ranges that they share stay shared."""
        ranges: dict[int, Vectors] = {}
        for own in whole:
            if not isinstance(own, InRange):
                yield self._matrix(own)
                continue
            if id(own.range) not in ranges:
                ranges[id(own.range)] = self.rows(own.range.T).T
            yield replace(own, range=ranges[id(own.range)])

    def _matrix(self, whole: Vectors) -> Vectors:
        """Return a symmetric matrix of the basis, (size, size), in this space, (n_kept + k, n_kept + k)."""
        n = self.kept.size
        image = whole[:, self.spare] @ self.direction
        found = np.empty((n + image.shape[1], n + image.shape[1]))
        found[:n, :n] = whole[np.ix_(self.kept, self.kept)]
        found[:n, n:] = image[self.kept]
        found[n:, :n] = found[:n, n:].T
        corner = self.direction.T @ image[self.spare]
        found[n:, n:] = (corner + corner.T) / 2.0
        return found

    def rows(self, whole: Vectors) -> Vectors:
        """Return rows that act on coordinates of the basis, (n_dof, size), as they act on those of this space."""
        return np.hstack([whole[:, self.kept], whole[:, self.spare] @ self.direction])

    def whole(self, coordinate: Vectors) -> Vectors:
        """Return vectors of this space, (n_kept + k, n), in the coordinates of the basis, (size, n)."""
        found = np.zeros((self.size, coordinate.shape[1]))
        found[self.kept] = coordinate[: self.kept.size]
        found[self.spare] = self.direction @ coordinate[self.kept.size :]
        return found


_GENERIC = 0.7310585786300049  # moves a parameter to where no factor vanishes by chance


@dataclass(frozen=True, eq=False, kw_only=True)
class ReducedTerm:
    """A term of the equations of motion projected on the reduced basis: `factor` times `matrix`, (n, n)."""

    name: str
    target: Target
    factor: ParameterFactor
    matrix: Matrix


@dataclass(frozen=True, eq=False, kw_only=True)
class ReducedEquations:
    """The equations of motion of a stack, reduced to a few degrees of freedom.

    Attributes
    ----------
    stack : Stack
        What was reduced.
    terms : tuple of ReducedTerm
        The projected terms.
    theta : mapping of str to float
        Nominal parameters.
    ranges : mapping of str to (float, float)
        Values of parameters for which the reduction was made, G_f among them.
    parts : BasisParts, optional
        What of the basis modes need; all of it by default.
    quick : BasisParts, optional
        What of it does for a quick look.
    """

    stack: Stack
    terms: tuple[ReducedTerm, ...]
    theta: Mapping[str, float]
    ranges: Mapping[str, tuple[float, float]]
    parts: BasisParts | None = None
    quick: BasisParts | None = None
    _acting: dict[tuple[frozenset[str], tuple[int, ...]], Acting] = field(
        default_factory=dict, init=False, repr=False
    )

    @property
    def size(self) -> int:
        """Number of reduced degrees of freedom."""
        return n_row(self.terms[0].matrix)

    @property
    def equations(self) -> ReducedEquations:
        """These equations alone, without what they were reduced from."""
        names = (one.name for one in fields(ReducedEquations) if one.init)
        return ReducedEquations(**{name: getattr(self, name) for name in names})

    @property
    def rough(self) -> ReducedEquations:
        """These equations for a quick look: what acts of them is off by some 1 % of a frequency at most."""
        return replace(self.equations, parts=self.quick)

    def acting(self, moved: Mapping[str, float]) -> Acting:
        """Return what modes need of the equations while some parameters, and the frequency, move.

        Terms that vanish all the while are left out, and what only other parameters ask for of the basis.

        Parameters
        ----------
        moved : mapping of str to float
            The parameters that move, and where they are.
        """
        free = frozenset((*moved, OMEGA))
        needed = () if self.parts is None else self.parts.needed(moved, self.theta)
        if (free, needed) not in self._acting:  # fits ask again at every step; each takes some 20 MB
            space = None if self.parts is None else self.parts.space(needed, self.size)
            self._acting.clear()
            self._acting[free, needed] = Acting(
                equations=self._in_space(self._terms_of(free), space), space=space
            )
        return self._acting[free, needed]

    def _terms_of(self, free: frozenset[str]) -> tuple[ReducedTerm, ...]:
        """Return the terms that do not vanish wherever some parameters are."""
        apart = {n: value * _GENERIC + _GENERIC if n in free else value for n, value in self.theta.items()}
        return tuple(t for t in self.terms if t.factor.names(apart) <= free or t.factor(apart) != 0.0)

    def _in_space(self, terms: tuple[ReducedTerm, ...], space: Space | None) -> ReducedEquations:
        """Return the equations with some terms, in a space of the basis; None is all of it."""
        if space is not None:
            whole = {id(t.matrix): t.matrix for t in terms}
            found = dict(zip(whole, space.matrices(whole.values()), strict=True))
            terms = tuple(replace(t, matrix=found[id(t.matrix)]) for t in terms)
        return replace(self.equations, terms=terms, parts=None, quick=None)

    def matrix(self, target: Target, theta: Mapping[str, float]) -> NDArray[np.float64]:
        """Return the reduced M, C or K at the parameters `theta`, (size, size)."""
        factors = ((term.factor(theta), term.matrix) for term in self.terms if term.target == target)
        return summed(self.size, (own for own in factors if own[0]))  # most effects are neutral

    def derivative(self, target: Target, theta: Mapping[str, float], name: str) -> NDArray[np.float64]:
        """Return the derivative of the reduced M, C or K by the parameter `name`, (size, size)."""
        terms = (term for term in self.terms if term.target == target)
        return summed(self.size, ((term.factor.derivative(theta, name), term.matrix) for term in terms))


@dataclass(frozen=True, eq=False, kw_only=True)
class Acting:
    """The equations that act while some parameters move, in the space that modes need then; None is the basis."""

    equations: ReducedEquations
    space: Space | None

    def rows(self, whole: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return rows that act on coordinates of the basis, (n_dof, n), as they act on those of these equations."""
        return whole if self.space is None else self.space.rows(whole)

    def whole(self, coordinate: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return vectors in the coordinates of these equations in those of the basis."""
        return coordinate if self.space is None else self.space.whole(coordinate)
