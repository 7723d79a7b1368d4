"""A reduced basis truncated to what its modes use at given parameters, for work that solves it hundreds of times."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from model.reduction.reduced_equations import BasisParts, Further, full
from model.reduction.reduction import ReducedSystem
from model.reduction.through_thickness import N_RIGID, SOFT, n_rigid, shear_shift
from model.stack.errors import SolveError

Vectors = NDArray[np.float64]

_NEEDED = 0.01  # amplitude of a direction that modes need beside what all need
_QUICK = 0.07  # the same for a quick look


@dataclass(frozen=True, kw_only=True)
class Sampled:
    """Parameters at which modes are taken.

    Attributes
    ----------
    samples : iterable of mapping of str to float
        Parameters that differ from the nominal ones. Those where stiffness or mass are negative are passed over.
    parameter : tuple of str
        Those that need these modes; none where all modes may need them.
    reach : float
        How far one has to be from its nominal value to need them.
    """

    samples: Iterable[Mapping[str, float]]
    parameter: tuple[str, ...] = ()
    reach: float = 0.0


def truncated(
    system: ReducedSystem, sampled: Sequence[Sampled], n_mode: int, tolerance: float
) -> ReducedSystem:
    """Return the reduced system in the principal directions of its modes at some parameters, the largest first.

    What all modes may need comes first, and then what modes need that some parameters move; `ReducedSystem.parts` and
    `quick` say what each needs of it.

    Parameters
    ----------
    system : ReducedSystem
        The reduced stack.
    sampled : sequence of Sampled
        Where modes are taken.
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
    modes = [_modes(system, own.samples, n_mode) for own in sampled]
    if not sum(own.shape[1] for own in modes):
        message = "truncated: stiffness or mass are negative at all samples"
        raise SolveError(message)
    shift = SOFT * shear_shift(system.stack, system.theta)
    root = la.cholesky(system.matrix("K", system.theta) + shift * system.matrix("M", system.theta))
    common = [own for own, where in zip(modes, sampled, strict=True) if not where.parameter]
    core, amplitude = _principal(root @ np.hstack([np.zeros((system.size, 0)), *common]), _NEEDED)
    every = root @ np.hstack(modes)
    spare, _ = _principal(every - core @ (core.T @ every), tolerance)
    kept = la.solve_triangular(root, np.hstack([core, spare]))
    turn = np.hstack([np.eye(system.size, N_RIGID), la.qr(kept, mode="economic")[0]])
    small = system.rebased(system.basis @ turn, lambda term, _: turn.T @ full(term.matrix) @ turn)
    energy = small.matrix("K", system.theta) + shift * small.matrix("M", system.theta)
    own_root, own = la.cholesky(energy), [turn.T @ own for own in modes]
    parts, quick = (
        _parts(own_root, own, sampled, N_RIGID + int(np.count_nonzero(amplitude > least)), least)
        for least in (_NEEDED, _QUICK)
    )
    return replace(small, parts=parts, quick=quick)


def _parts(
    root: Vectors, modes: Sequence[Vectors], sampled: Sequence[Sampled], n_core: int, least: float
) -> BasisParts:
    """Return the parts of a basis with a core of some size, `root` being the root of its energy."""
    return BasisParts(
        n_core=n_core,
        n_spare=len(root) - n_core,
        further=tuple(
            _further(
                root[n_core:, n_core:], own[n_core:], where, least
            )  # with what a vector has beside the core
            for own, where in zip(modes, sampled, strict=True)
            if where.parameter
        ),
    )


def _modes(system: ReducedSystem, samples: Iterable[Mapping[str, float]], n_mode: int) -> Vectors:
    """Return the elastic modes at samples, of unit energy, (size, n): rigid-body motion is kept as it is."""
    shift, first = SOFT * shear_shift(system.stack, system.theta), n_rigid(system.stack)
    modes = [np.zeros((system.size, 0))]
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
    together = np.hstack(modes)
    together[:N_RIGID] = 0.0
    return together


def _further(root: Vectors, spare: Vectors, where: Sampled, least: float) -> Further:
    """Return the directions that modes need, `spare` being what they have beside the core, (n_spare, n)."""
    found, _ = _principal(root @ spare, least)
    direction = la.qr(la.solve_triangular(root, found), mode="economic")[0]
    return Further(parameter=where.parameter, reach=where.reach, direction=direction)


def _principal(vectors: Vectors, least: float) -> tuple[Vectors, Vectors]:
    """Return the principal directions of vectors above an amplitude, largest first, and all amplitudes."""
    if vectors.shape[1] > len(vectors):  # quicker, and as exact
        vectors = la.qr(vectors.T, mode="r")[0][: len(vectors)].T
    directions, amplitude, _ = la.svd(vectors, full_matrices=False)
    return directions[:, amplitude > least], amplitude
