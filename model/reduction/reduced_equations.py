"""Equations of motion of a few degrees of freedom, affine in their parameters: all that a solve needs.

They are small beside what they were reduced from, so they can be sent to another process.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace

import numpy as np
from numpy.typing import NDArray

from model.elements.equations import OMEGA, ParameterFactor, Target
from model.reduction.basis_parts import BasisParts, Space
from model.reduction.shared_range import Matrix, n_row, summed
from model.stack.stack import Stack

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
