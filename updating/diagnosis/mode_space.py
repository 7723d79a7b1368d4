"""All modes of the model at the sensors, which a shape may lean towards."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from model import Modes, Observed, Stack
from model.reduction.through_thickness import N_RIGID, n_rigid

Vector = NDArray[np.float64]

_HALF = 0.5  # of a rigid-body motion, that no elastic mode holds


@dataclass(frozen=True, eq=False, kw_only=True)
class ModeSpace:
    """Modes of the model in one configuration, elastic ones first and rigid-body motion last.

    Attributes
    ----------
    shape : (n_dof, n) float
        At the sensors, of unit modal mass.
    frequency : (n,) float
        Hz; 0 of rigid-body motion.
    """

    shape: Vector
    frequency: Vector

    @classmethod
    def of(cls, modes: Modes, observed: Observed, stack: Stack) -> ModeSpace:
        """Return the elastic `modes` with the rigid-body motion of the sensors, but what is elastic on a suspension.

        A stack that supports hold has no rigid-body motion.
        """
        if not n_rigid(stack):
            return cls(shape=modes.shape, frequency=modes.frequency)
        held = modes.coordinate[:N_RIGID]  # the basis begins with rigid-body modes
        share, turn = la.eigh(np.eye(N_RIGID) - held @ held.T)
        rigid = observed.reduced_rows[:, :N_RIGID] @ turn[:, share > _HALF]
        return cls(
            shape=np.hstack([modes.shape, rigid]),
            frequency=np.append(modes.frequency, np.zeros(rigid.shape[1])),
        )
