"""A reduced basis enriched where it is used: with the modes of all equations at given parameters.

First-order answers carry a reduction some way from its snapshots; a strong effect leads further. Where a fit arrives is
known only then. The modes of all equations there, corrected from those of the basis and taken into it, make it right at
that place, and the error around it of second order in the distance (Rayleigh and Ritz). The corrections are what the
nominal stack answers to the forces that the modes leave unbalanced (Davidson, J. Comput. Phys. 17, 1975): its factor
serves for all places.
"""

from __future__ import annotations

import contextlib
import functools
from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from model.elements.equations import Assembly
from model.modes.modes import reduced_eigenpairs
from model.reduction.reduction import ReducedSystem, leading, reduced_terms, shifted_factor
from model.reduction.through_thickness import N_RIGID, SOFT, n_rigid, shear_shift
from model.solvers.eigen import orthonormalize
from model.solvers.low_rank import Factor
from model.stack.errors import SolveError

_TOLERANCE = 1e-6  # relative change of eigenvalues by a correction, below which modes are right
_MOST_STEPS = 6


def enriched(system: ReducedSystem, samples: Iterable[Mapping[str, float]], n_mode: int) -> ReducedSystem:
    """Return the reduced system with better modes in its basis at those of some parameters where it is off.

    Parameters
    ----------
    system : ReducedSystem
        The reduced stack.
    samples : iterable of mapping of str to float
        Parameters that differ from the nominal ones. Those where the stiffness is negative are passed over.
    n_mode : int
        Modes of each sample, the six rigid-body modes included.
    """
    known, corrections = _Known(system), []
    for sample in samples:
        with contextlib.suppress(SolveError):
            corrections.append(_Correction(system, {**system.theta, **sample}, n_mode))
    wrong = corrections
    for _ in range(_MOST_STEPS):
        if wrong:  # all at once, for the factor is large, and reading it takes longest
            answers = nominal_factor(system.assembly).solve(np.hstack([c.unbalanced() for c in wrong]))
            for correction, answer in zip(wrong, np.split(answers, len(wrong), axis=1), strict=True):
                correction.improve(answer)
            wrong = [c for c in wrong if not c.right]
    better = [c.modes() for c in corrections if c.improved]
    if better:
        known.add(leading(known.beside(np.hstack(better)), system.assembly, system.theta))
    return known.extended()


class _Known:
    """A basis that grows, orthonormal in the mass."""

    def __init__(self, system: ReducedSystem) -> None:
        self._system = system
        self._krons = system.assembly.krons("M", system.assembly.theta)
        self._blocks = [(system.basis, self.mass(system.basis))]

    def mass(self, vectors: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the nominal mass times vectors."""
        return self._system.assembly.apply(self._krons, vectors)

    def beside(self, vectors: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return what vectors have beside the basis."""
        return vectors - sum(basis @ (mass_basis.T @ vectors) for basis, mass_basis in self._blocks)

    def add(self, vectors: NDArray[np.float64]) -> None:
        """Add what vectors have beside the basis."""
        if vectors.shape[1]:
            self._blocks.append(orthonormalize(vectors, self.mass, self._blocks))

    def extended(self) -> ReducedSystem:
        """Return the system with all of it."""
        if len(self._blocks) == 1:
            return self._system
        basis = np.hstack([vectors for vectors, _ in self._blocks])
        return replace(self._system, basis=basis, terms=reduced_terms(self._system.assembly, basis))


class _Correction:
    """The elastic modes of all equations at some parameters, sought in a space that grows from those of the basis.

    Raises
    ------
    SolveError
        The stiffness is negative.
    """

    right = False
    """Whether the last improvement changed next to nothing."""
    improved = False
    """Whether any did more: the modes of the basis were not right."""

    def __init__(self, system: ReducedSystem, theta: Mapping[str, float], n_mode: int) -> None:
        values, vectors, _ = reduced_eigenpairs(system, theta, n_mode)
        self._assembly = system.assembly.acting([theta])
        self._stiffness, self._inertia = (self._assembly.krons(target, theta) for target in ("K", "M"))
        self._soft = SOFT * shear_shift(system.assembly.stack, theta)
        self._elastic = slice(n_rigid(system.stack), n_mode)
        self._now, modes = values[self._elastic], system.basis @ vectors[:, self._elastic]
        start = np.hstack([system.basis[:, :N_RIGID], modes])
        self._space, self._mass_space = orthonormalize(start, self._mass)
        self._force = self._assembly.apply(self._stiffness, self._space)
        self._turn = self._mass_space.T @ modes

    def unbalanced(self) -> NDArray[np.float64]:
        """Return the forces that the modes as they are leave unbalanced, (size, n)."""
        return np.asarray(self._force @ self._turn - self._mass_space @ (self._turn * self._now))

    def improve(self, answer: NDArray[np.float64]) -> None:
        """Let the modes have what was answered to the unbalanced forces."""
        block, mass_block = orthonormalize(answer, self._mass, [(self._space, self._mass_space)])
        self._space = np.hstack([self._space, block])
        self._mass_space = np.hstack([self._mass_space, mass_block])
        self._force = np.hstack([self._force, self._assembly.apply(self._stiffness, block)])
        projected = self._space.T @ self._force
        found, every = la.eigh((projected + projected.T) / 2.0)
        before, self._now, self._turn = self._now, found[self._elastic], every[:, self._elastic]
        self.right = bool(np.all(before - self._now < _TOLERANCE * np.abs(self._now)))
        self.improved = self.improved or not self.right

    def modes(self) -> NDArray[np.float64]:
        """Return the modes, of unit energy, (size, n)."""
        return np.asarray(self._space @ self._turn / np.sqrt(np.maximum(self._now, self._soft)))

    def _mass(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        return self._assembly.apply(self._inertia, x)


@functools.lru_cache(maxsize=2)  # a search asks again and again, and beside it a virtual test is simulated
def nominal_factor(assembly: Assembly) -> Factor:
    """Return the factor of the nominal stack that `enriched` corrects modes with: worth a call in an idle moment."""
    return shifted_factor(assembly, assembly.theta)
