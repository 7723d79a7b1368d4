"""Modes with an error estimate from the equations of all laminas, and what was done where it was too large."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from model.modes.modes import Modes, solve_modes
from model.modes.observation import Observation
from model.modes.refinement import refine, residual_error
from model.reduction.reduction import ReducedSystem, reduce
from model.stack.arrays import readonly
from model.stack.stack import Stack

Basis = Literal["first", "enriched", "all laminas"]

_SHARE = 0.1  # of the tolerance, that the through-thickness functions may take in the first basis
_ENRICHED = 0.003  # and in the enriched one
_SPARE = 2  # modes beyond those asked for, so that none is missing among close ones


@dataclass(frozen=True, eq=False, kw_only=True)
class Verification:
    """How far the frequencies of a reduced stack are from those of all its laminas.

    Attributes
    ----------
    error : (n_mode,) float
        Estimated relative error of each frequency, from the residual of the equations of all laminas.
    tolerance : float
        The error that was allowed.
    basis : "first", "enriched" or "all laminas"
        What the frequencies are from: the first reduced basis, which kept the tolerance; one with more
        through-thickness functions, because the first did not; or an iteration on the equations of all laminas,
        because neither did.
    first_error : float
        Largest estimated error with the first basis.
    """

    error: NDArray[np.float64]
    tolerance: float
    basis: Basis
    first_error: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "error", readonly("Verification", "error", self.error, (None,)))

    @property
    def within_tolerance(self) -> bool:
        """Whether every error is within the tolerance."""
        return bool(np.all(self.error <= self.tolerance))


def solve_verified(
    stack: Stack, *, observation: Observation, n_mode: int = 16, tolerance: float = 1e-4
) -> tuple[ReducedSystem, Modes, Verification]:
    """Solve for the modes of a stack and check them on the equations of all laminas.

    When the estimated error exceeds the tolerance, the basis is enriched; when that does not suffice, the modes are
    iterated on the equations of all laminas. Damping ratios and shapes are those of the last reduced basis.

    Parameters
    ----------
    stack : Stack
        The stack.
    observation : Observation
        Where shapes are wanted.
    n_mode : int
        Number of modes, rigid-body modes included.
    tolerance : float
        Relative error of a frequency.

    Returns
    -------
    system : ReducedSystem
        The reduced stack, for pictures and responses.
    modes : Modes
        The modes, rigid-body ones first.
    verification : Verification
        Errors, and what the frequencies are from.

    Raises
    ------
    SolveError
        The modes do not converge.
    """
    contact = stack.contact

    def attempt(share: float) -> tuple[ReducedSystem, Modes, NDArray[np.float64]]:
        system = reduce(stack, n_mode=n_mode + _SPARE, n_snapshot=1, z_tolerance=share * tolerance)
        modes = solve_modes(system, G_f=contact.G_f, d_f=contact.d_f, n_mode=n_mode, observation=observation)
        return system, modes, residual_error(system, G_f=contact.G_f, n_mode=n_mode)

    system, modes, error = attempt(_SHARE)
    first, basis = float(error.max()), "first"
    if first > tolerance:
        system, modes, error = attempt(_ENRICHED)
        basis = "enriched"
    if error.max() > tolerance:
        check = refine(system, G_f=contact.G_f, n_mode=n_mode, tolerance=_SHARE * tolerance)
        # where factors depend on frequency, the correction is that at the reference frequency
        corrected = modes.frequency * (1.0 - check.reduction_error + check.error)
        modes, basis, error = dataclasses.replace(modes, frequency=corrected), "all laminas", check.error
    return system, modes, Verification(error=error, tolerance=tolerance, basis=basis, first_error=first)  # type: ignore[arg-type]
