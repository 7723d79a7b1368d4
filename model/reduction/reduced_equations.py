"""Equations of motion of a few degrees of freedom, affine in their parameters: all that a solve needs.

They are small beside what they were reduced from, so they can be sent to another process.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from model.elements.equations import OMEGA, ParameterFactor, Target
from model.stack.stack import Stack

_GENERIC = 0.7310585786300049  # moves a parameter to where no factor vanishes by chance


@dataclass(frozen=True, eq=False, kw_only=True)
class ReducedTerm:
    """A term of the equations of motion projected on the reduced basis: `factor` times `matrix`, (n, n)."""

    name: str
    target: Target
    factor: ParameterFactor
    matrix: NDArray[np.float64]


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
    """

    stack: Stack
    terms: tuple[ReducedTerm, ...]
    theta: Mapping[str, float]
    ranges: Mapping[str, tuple[float, float]]
    _acting: dict[frozenset[str], ReducedEquations] = field(default_factory=dict, init=False, repr=False)

    @property
    def size(self) -> int:
        """Number of reduced degrees of freedom."""
        return self.terms[0].matrix.shape[0]

    @property
    def equations(self) -> ReducedEquations:
        """These equations alone, without what they were reduced from."""
        return ReducedEquations(stack=self.stack, terms=self.terms, theta=self.theta, ranges=self.ranges)

    def leading(self, n: int) -> ReducedEquations:
        """Return these equations on the first n degrees of freedom; all of them where there are fewer."""
        terms = tuple(replace(t, matrix=np.ascontiguousarray(t.matrix[:n, :n])) for t in self.terms)
        return replace(self.equations, terms=terms)

    def acting(self, moved: Collection[str]) -> ReducedEquations:
        """Return the equations without terms that vanish while only some parameters, and the frequency, move."""
        free = frozenset((*moved, OMEGA))
        if free not in self._acting:  # fits ask again at every step
            apart = {
                n: value * _GENERIC + _GENERIC if n in free else value for n, value in self.theta.items()
            }
            terms = tuple(t for t in self.terms if t.factor.names(apart) <= free or t.factor(apart) != 0.0)
            self._acting[free] = replace(self.equations, terms=terms)
        return self._acting[free]

    def matrix(self, target: Target, theta: Mapping[str, float]) -> NDArray[np.float64]:
        """Return the reduced M, C or K at the parameters `theta`, (size, size)."""
        total, share = np.zeros((2, self.size, self.size))
        for term in self.terms:
            if term.target == target and (factor := term.factor(theta)):  # most effects are neutral
                total += np.multiply(factor, term.matrix, out=share)
        return total

    def derivative(self, target: Target, theta: Mapping[str, float], name: str) -> NDArray[np.float64]:
        """Return the derivative of the reduced M, C or K by the parameter `name`, (size, size)."""
        total = np.zeros((self.size, self.size))
        for term in self.terms:
            if term.target == target:
                total += term.factor.derivative(theta, name) * term.matrix
        return total
