"""A reduced basis enriched where it is used: with the modes of all equations at given parameters.

First-order answers carry a reduction some way from its snapshots; a strong effect leads further. Where a fit arrives is
known only then. One step of inverse iteration from the modes of the basis there, taken into it, squares the error that
they had at that place (Rayleigh and Ritz); a second call squares it again.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from model.eigen import orthonormalize
from model.modes import reduced_eigenpairs
from model.projection import Projection
from model.reduction import ReducedSystem, acting
from model.solver import solver_over_plan
from model.z_basis import N_RIGID, shear_shift


def enriched(system: ReducedSystem, theta: Mapping[str, float], n_mode: int) -> ReducedSystem:
    """Return the reduced system with better modes at `theta` in its basis.

    Parameters
    ----------
    system : ReducedSystem
        The reduced stack.
    theta : mapping of str to float
        Parameters that differ from the nominal ones.
    n_mode : int
        Number of modes, the six rigid-body modes included.

    Raises
    ------
    SolveError
        The stiffness is negative there.
    """
    assembly, at = system.assembly, {**system.theta, **theta}
    _, vectors, _ = reduced_eigenpairs(system, at, n_mode)
    factor = solver_over_plan(acting(assembly, [at])).factor(at, shear_shift(system.stack, at))
    modes = system.basis @ vectors[:, N_RIGID:n_mode]
    better = factor.solve(assembly.apply(assembly.krons("M", at), modes))
    mass = assembly.krons("M", assembly.theta)

    def product(x: NDArray[np.float64]) -> NDArray[np.float64]:
        return assembly.apply(mass, x)

    fresh, _ = orthonormalize(better, product, [(system.basis, product(system.basis))])
    return _extended(system, fresh)


def _extended(system: ReducedSystem, fresh: NDArray[np.float64]) -> ReducedSystem:
    """Return the system with further basis vectors; only their rows and columns of the terms are computed."""
    assembly, n = system.assembly, system.size
    basis = np.hstack([system.basis, fresh])
    krons = {id(old.matrix): new.krons for old, new in zip(system.terms, assembly.terms, strict=True)}
    grown, project = {}, Projection(assembly, basis, fresh)
    for old in system.terms:
        if id(old.matrix) not in grown:
            matrix = np.zeros((basis.shape[1], basis.shape[1]))
            matrix[:n, :n] = old.matrix
            matrix[:, n:] = project(krons[id(old.matrix)])
            matrix[n:] = matrix[:, n:].T
            matrix[n:, n:] = (matrix[n:, n:] + matrix[n:, n:].T) / 2.0
            grown[id(old.matrix)] = matrix
    return dataclasses.replace(
        system,
        basis=basis,
        terms=tuple(dataclasses.replace(term, matrix=grown[id(term.matrix)]) for term in system.terms),
    )
