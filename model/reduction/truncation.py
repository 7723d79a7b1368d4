"""A reduced basis truncated to what its modes use at given parameters, for work that solves it hundreds of times."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
import scipy.linalg as la

from model.reduction.reduction import ReducedSystem
from model.reduction.through_thickness import N_RIGID, SOFT, n_rigid, shear_shift
from model.stack.errors import SolveError


def truncated(
    system: ReducedSystem, samples: Iterable[Mapping[str, float]], n_mode: int, tolerance: float
) -> ReducedSystem:
    """Return the reduced system in the principal directions of its modes at some parameters, the largest first.

    Parameters
    ----------
    system : ReducedSystem
        The reduced stack.
    samples : iterable of mapping of str to float
        Parameters that differ from the nominal ones. Those where stiffness or mass are negative are passed over.
    n_mode : int
        Modes of each sample, the six rigid-body modes included.
    tolerance : float
        Amplitude of a direction, each mode having one of unit energy, below which it is left out (proper orthogonal
        decomposition in the stiffness of the nominal parameters). What is left out raises frequencies by half its
        energy: mass weighs it too little in soft modes, such as the first torsion mode at low contact stiffness.

    Raises
    ------
    SolveError
        Stiffness or mass are negative at all samples.
    """
    shift = SOFT * shear_shift(system.stack, system.theta)
    first, modes = n_rigid(system.stack), []
    for sample in samples:
        theta = {**system.theta, **sample}
        try:
            value, vector = la.eigh(
                system.matrix("K", theta), system.matrix("M", theta), subset_by_index=(0, n_mode - 1)
            )
        except la.LinAlgError:  # a clamp that lacks more mass than it has
            continue
        if value[0] > -1e-6 * value[-1]:
            modes.append(vector[:, first:] / np.sqrt(np.maximum(value[first:], shift)))
    if not modes:
        message = "truncated: stiffness or mass are negative at all samples"
        raise SolveError(message)
    together = np.hstack(modes)
    together[:N_RIGID] = 0.0  # rigid-body motion is kept as it is
    energy = system.matrix("K", system.theta) + shift * system.matrix("M", system.theta)
    root = la.cholesky(energy)
    directions, amplitude, _ = la.svd(root @ together, full_matrices=False)
    kept = la.solve_triangular(root, directions[:, amplitude > tolerance])
    turn = np.hstack([np.eye(system.size, N_RIGID), la.qr(kept, mode="economic")[0]])
    return system.rebased(system.basis @ turn, lambda term, _: turn.T @ term.matrix @ turn)
