"""Reduced equations of motion, with what keeps them small: matrices of low rank.

A clamp moves with the mean displacement under it, so its mass, and all that it does when it sits elsewhere, couple a
few dozen directions of several hundred. Most terms of a model with all effects are such: in full they would be two
thirds of its size.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields, replace

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray
from scipy.linalg.blas import daxpy

from model.elements.equations import OMEGA, ParameterFactor, Target
from model.stack.stack import Stack

Vectors = NDArray[np.float64]


_SPARE = 8  # random vectors beyond the most directions, which show that a range has no more (Halko et al. 2011)


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


def _leading(matrix: Matrix, n: int) -> Vectors:
    """Return the leading block of a matrix in full, (n, n)."""
    return full(replace(matrix, range=matrix.range[:n]) if isinstance(matrix, InRange) else matrix[:n, :n])


def n_row(matrix: Matrix) -> int:
    """Return the number of rows of a matrix."""
    return len(matrix.range if isinstance(matrix, InRange) else matrix)


def summed(n: int, parts: Iterable[tuple[float, Matrix]]) -> Vectors:
    """Return the sum of factors times matrices in full, (n, n)."""
    total = np.zeros(n * n)
    between: dict[int, tuple[Vectors, Vectors]] = {}
    for factor, matrix in parts:
        if not isinstance(matrix, InRange):
            total = daxpy(matrix.ravel(), total, a=factor)  # in place
            continue
        shared, core = between.get(id(matrix.range), (matrix.range, np.zeros(matrix.core.shape)))
        between[id(matrix.range)] = shared, core + factor * matrix.core
    square = total.reshape(n, n)
    for shared, core in between.values():
        square += shared @ core @ shared.T
    return square


def in_ranges(matrices: Iterable[Vectors]) -> list[Matrix]:
    """Return matrices of low rank in ranges that they share, others as they are.

    Parameters
    ----------
    matrices : iterable of (n, n) float
        Symmetric. Those that follow each other are the likeliest to share a range; no more of them than may share one
        are kept in full at a time.
    """
    most_spanned = 1 / 10  # of the basis, that a range may span: with more, full matrices are as quick
    rank = 1e-11  # of the largest direction of a matrix, below which one is rounding
    fewest = 40  # directions that it may have in any case
    found: list[Matrix] = []
    group = _Group(range=np.zeros((0, 0)), members={})
    most, probe = fewest, np.zeros((0, 0))
    for i, matrix in enumerate(matrices):
        found.append(matrix)
        if i == 0:
            most = max(int(most_spanned * len(matrix)), fewest)
            probe = np.random.default_rng(0).standard_normal((len(matrix), most + _SPARE))
        image = matrix @ probe
        span = _orthonormal(image, rank * float(np.max(np.linalg.norm(image, axis=0), initial=0.0)))
        if span.shape[1] > most:
            continue
        wider = group.wider(matrix, span)
        if wider is None or wider.shape[1] > most:
            found = group.put(found)
            group = _Group(range=span, members={i: matrix})
        else:
            group = _Group(range=wider, members={**group.members, i: matrix})
    return group.put(found)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Group:
    """Matrices in full, by their number, and a range that they share."""

    range: Vectors
    members: Mapping[int, Vectors]

    def wider(self, matrix: Vectors, further: Vectors) -> Vectors | None:
        """Return the range with that of another matrix; None if they can share none.

        What feels rigid-body motion shares no range with what does not, for there it must stay exactly 0.
        """
        if not self.members:
            return None
        first = next(iter(self.members.values()))
        return _with(self.range, further) if np.array_equal(first.any(axis=1), matrix.any(axis=1)) else None

    def put(self, found: list[Matrix]) -> list[Matrix]:
        """Return all matrices with those of the group in its range, where they are the same there."""
        exact = 1e-11  # of a matrix's largest entry, to which it must be the same in its range
        for i, matrix in self.members.items():
            core = self.range.T @ matrix @ self.range
            ranged = InRange(range=self.range, core=(core + core.T) / 2.0)
            if np.abs(full(ranged) - matrix).max() <= exact * np.abs(matrix).max():
                found[i] = ranged
        return found


def _with(shared: Vectors, further: Vectors) -> Vectors:
    """Return an orthonormal range with what another has beside it."""
    same = 1e-7  # part of a unit direction beside others, below which it is theirs
    left = further
    for _ in range(2):  # of what is small, the first time leaves mostly rounding, which lies along the range
        left = left - shared @ (shared.T @ left)
        left = _orthonormal(left - shared @ (shared.T @ left), same)
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


def generic(theta: Mapping[str, float], moving: Iterable[str]) -> dict[str, float]:
    """Return parameters at which no factor vanishes by chance, for those that move."""
    return {**theta, **{name: 1.0123 * theta[name] + 1.01e-3 for name in moving if name in theta}}


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
    n_base : int, optional
        First coordinates, in which the stack has its modes while no effect acts; all of them by default.
    """

    stack: Stack
    terms: tuple[ReducedTerm, ...]
    theta: Mapping[str, float]
    ranges: Mapping[str, tuple[float, float]]
    n_base: int | None = None

    @property
    def size(self) -> int:
        """Number of reduced degrees of freedom."""
        return n_row(self.terms[0].matrix)

    @property
    def equations(self) -> ReducedEquations:
        """These equations alone, without what they were reduced from."""
        names = (one.name for one in fields(ReducedEquations) if one.init)
        return ReducedEquations(**{name: getattr(self, name) for name in names})

    def base(self, moved: Iterable[str]) -> ReducedEquations:
        """Return the equations on their first `n_base` coordinates, where no effect but some parameters act.

        Terms that vanish wherever these parameters, and the frequency, are, are left out.
        """
        free, n = frozenset((*moved, OMEGA)), self.size if self.n_base is None else self.n_base
        apart = generic(self.theta, free)
        acting = [t for t in self.terms if t.factor.names(apart) <= free or t.factor(apart) != 0.0]
        leading = {id(t.matrix): _leading(t.matrix, n) for t in acting}
        terms = tuple(replace(t, matrix=leading[id(t.matrix)]) for t in acting)
        return replace(self.equations, terms=terms, n_base=None)

    def matrix(self, target: Target, theta: Mapping[str, float]) -> NDArray[np.float64]:
        """Return the reduced M, C or K at the parameters `theta`, (size, size)."""
        factors = ((term.factor(theta), term.matrix) for term in self.terms if term.target == target)
        return summed(self.size, (pair for pair in factors if pair[0]))  # most effects are neutral

    def derivative(self, target: Target, theta: Mapping[str, float], name: str) -> NDArray[np.float64]:
        """Return the derivative of the reduced M, C or K by the parameter `name`, (size, size)."""
        terms = (term for term in self.terms if term.target == target)
        return summed(self.size, ((term.factor.derivative(theta, name), term.matrix) for term in terms))
