"""Parts of a reduced basis: what all modes need, and what they need beside it while an effect takes part."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from model.reduction.shared_range import InRange, Matrix

Vectors = NDArray[np.float64]

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
