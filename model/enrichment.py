"""A reduced basis enriched where it is used: with the modes of all equations at given parameters.

First-order answers carry a reduction some way from its snapshots; a strong effect leads further. Where a fit arrives is
known only then. The modes of all equations there, iterated from those of the basis and taken into it, make it right at
that place, and the error around it of second order in the distance (Rayleigh and Ritz).
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

from model.eigen import orthonormalize
from model.errors import SolveError
from model.modes import reduced_eigenpairs
from model.projection import Projection
from model.reduced_equations import ReducedTerm
from model.reduction import ReducedSystem, acting
from model.solver import solver_over_plan
from model.system import Term
from model.z_basis import N_RIGID, shear_shift

_TOLERANCE = 1e-4  # relative, of eigenvalues
_MIN_STEPS = 3  # for modes that the reduced equations lack


def enriched(system: ReducedSystem, samples: Iterable[Mapping[str, float]], n_mode: int) -> ReducedSystem:
    """Return the reduced system with better modes at some parameters in its basis.

    Parameters
    ----------
    system : ReducedSystem
        The reduced stack.
    samples : iterable of mapping of str to float
        Parameters that differ from the nominal ones. Those where the stiffness is negative are passed over.
    n_mode : int
        Modes of each sample, the six rigid-body modes included.
    """
    assembly = system.assembly
    mass = assembly.krons("M", assembly.theta)

    def product(x: NDArray[np.float64]) -> NDArray[np.float64]:
        return assembly.apply(mass, x)

    known = [(system.basis, product(system.basis))]
    for sample in samples:
        with contextlib.suppress(SolveError):
            known.append(
                orthonormalize(_iterated(system, {**system.theta, **sample}, n_mode), product, known)
            )
    return _extended(system, np.hstack([vectors for vectors, _ in known[1:]])) if known[1:] else system


def _iterated(system: ReducedSystem, theta: Mapping[str, float], n_mode: int) -> NDArray[np.float64]:
    """Return the elastic modes at `theta` of all equations, from those of the reduced ones."""
    _, vectors, _ = reduced_eigenpairs(system, theta, n_mode)
    solver = solver_over_plan(acting(system.assembly, [theta]))
    rigid, start = system.basis[:, :N_RIGID], system.basis @ vectors[:, N_RIGID:n_mode]
    shift = shear_shift(system.stack, theta)
    _, found = solver.modes(theta, shift, start, n_mode, _TOLERANCE, rigid, _MIN_STEPS)
    return found[:, N_RIGID:n_mode]


def _extended(system: ReducedSystem, fresh: NDArray[np.float64]) -> ReducedSystem:
    """Return the system with further basis vectors; only their rows and columns of the terms are computed."""
    basis, n = np.hstack([system.basis, fresh]), system.size
    project = Projection(system.assembly, basis, fresh)

    def grown(term: ReducedTerm, full: Term) -> NDArray[np.float64]:
        matrix = np.zeros((basis.shape[1], basis.shape[1]))
        matrix[:n, :n] = term.matrix
        matrix[:, n:] = project(full.krons)
        matrix[n:] = matrix[:, n:].T
        matrix[n:, n:] = (matrix[n:, n:] + matrix[n:, n:].T) / 2.0
        return matrix

    return system.rebased(basis, grown)
