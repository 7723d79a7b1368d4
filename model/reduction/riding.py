"""Coordinates of masses that ride on springs, in equations that are reduced.

The motion of a mass m is that of the structure, b'x, plus that on its seat of compliance c. With s r for the latter,
the kinetic energy is m (b'v + s r')^2 / 2 and that of the seat (s r)^2 / (2 c), so that r has the stiffness
s^2 / c, the mass m s^2, and the mass m s b between it and x. With s^2 = k c for any fixed k, the stiffness is constant,
and at c = 0 the mass moves with the structure.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
import scipy.linalg as la

from model.elements.equations import Analytic, Assembly, Monomial, Riding, Theta
from model.reduction.reduced_equations import ReducedTerm, Vectors

_STIFFNESS = 1e8
"""Stiffness k of the coordinates, N/m: any of the order of a seat's keeps the equations well scaled."""


Part = Literal["own", "between"]


@dataclass(frozen=True, eq=False, kw_only=True)
class RidingPart(Analytic):
    """The factor of the mass of a coordinate of motion on the seat: its own, or that between it and the structure.

    Attributes
    ----------
    riding : Riding
        What rides.
    part : "own" or "between"
        Which of both.
    """

    riding: Riding
    part: Part

    def eigenvalue(self, theta: Theta) -> float:
        """Return that of what rides on its seat, the structure being held, (rad/s)**2; of the part "own"."""
        return _STIFFNESS / self(theta)

    def function(self, theta: Theta, /) -> Any:
        """Return the mass, kg, real or complex."""
        # Frequency, Hz, at which a mass rides on a seat without compliance: infinite, were masses of 0 allowed.
        highest = 200e3
        mass, compliance = self.riding.mass, self.riding.compliance(theta)
        least = 1.0 / (mass * (2.0 * math.pi * highest) ** 2)
        if self.part == "own":
            return mass * _STIFFNESS * (compliance + least)
        return mass * compliance * np.sqrt(self.riding.share(theta) * _STIFFNESS / (compliance + least))


def riding_terms(assembly: Assembly, basis: Vectors) -> tuple[tuple[ReducedTerm, ...], int]:
    """Return the terms of what rides on a structure, in coordinates of its motion on seats after those of a basis.

    Parameters
    ----------
    assembly : Assembly
        Equations of motion, with masses that depend on frequency as a `Riding` does.
    basis : (assembly.size, n) float
        Of the structure's displacements.

    Returns
    -------
    tuple of ReducedTerm
        In n + m coordinates.
    int
        The number m of motions on seats.
    """
    rank = 1e-9  # of the largest motion of a mass, below which another is rounding
    riding = list[tuple[str, Riding, Vectors]]()
    for term in assembly.terms:
        if isinstance(term.factor, Riding):
            square, direction = la.eigh(basis.T @ assembly.apply(term.krons, basis))
            kept = square > rank * square[-1]
            riding.append((term.name, term.factor, direction[:, kept] * np.sqrt(square[kept])))
    start = basis.shape[1]
    size = start + sum(motion.shape[1] for _, _, motion in riding)
    terms = list[ReducedTerm]()
    for name, what, motion in riding:
        where = np.arange(start, start + motion.shape[1])
        start += where.size
        one, between = np.zeros((size, size)), np.zeros((size, size))
        one[where, where] = 1.0
        between[: len(motion), where] = motion
        between += between.T
        own, coupling = (RidingPart(riding=what, part=part) for part in get_args(Part))
        terms += [
            ReducedTerm(name=name, target="K", factor=Monomial(exponent={}), matrix=_STIFFNESS * one),
            ReducedTerm(name=name, target="M", factor=own, matrix=one),
            ReducedTerm(name=name, target="M", factor=coupling, matrix=between),
        ]
    return tuple(terms), size - basis.shape[1]
