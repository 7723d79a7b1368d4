"""All modes of the model at the sensors, which measured shapes may lean towards without anything being amiss."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from model import Modes, Observed
from model.reduction.through_thickness import N_RIGID
from updating.diagnosis.evidence import DiagnosisScatter
from updating.diagnosis.mixing import NEIGHBOUR, Mixing, leaning

Vector = NDArray[np.float64]

_HALF = 0.5  # of a rigid-body motion, that no elastic mode holds
_SEEN = 0.1  # motion of the sensors, over that of the mode that moves them most, from which they see a mode


@dataclass(frozen=True, eq=False, kw_only=True)
class ModeSpace:
    """Modes of the model in one configuration, elastic ones first and rigid-body motion last.

    Attributes
    ----------
    shape : (n_dof, n) float
        At the sensors, of unit modal mass.
    frequency : (n,) float
        Hz; 0 of rigid-body motion.
    mass, stiffness : float
        Standard deviations of m_rs and k_rs, see `mixing.Mixing`.
    """

    shape: Vector
    frequency: Vector
    mass: float
    stiffness: float

    @classmethod
    def of(cls, modes: Modes, observed: Observed, scatter: DiagnosisScatter) -> ModeSpace:
        """Return the elastic `modes` with the rigid-body motion of the sensors, but what is elastic on a suspension."""
        held = modes.coordinate[:N_RIGID]  # the basis begins with rigid-body modes
        share, turn = la.eigh(np.eye(N_RIGID) - held @ held.T)
        rigid = observed.reduced_rows[:, :N_RIGID] @ turn[:, share > _HALF]
        return cls(
            shape=np.hstack([modes.shape, rigid]),
            frequency=np.append(modes.frequency, np.zeros(rigid.shape[1])),
            mass=scatter.mixing,
            stiffness=2.0 * scatter.frequency,
        )

    @property
    def length(self) -> Vector:
        """Lengths of the shapes, (n,)."""
        return np.asarray(np.linalg.norm(self.shape, axis=0))

    def apart(self, m: int, sigma: float) -> Callable[[Vector], Vector]:
        """Return what takes out of a difference of the m-th shape, at unit length, what others may have brought.

        What lies along the shape itself is its scale, and how modes within 5 % in frequency mix is not to be predicted:
        both are taken out. What lies along other modes counts less where small masses turn the shape towards them by
        more than `sigma`, the standard deviation of its components.
        """
        frequency, length = self.frequency, self.length
        near = np.abs(frequency / frequency[m] - 1.0) < NEIGHBOUR
        out = la.orth(self.shape[:, near] / length[near])
        turn = np.hypot(*leaning(frequency[~near], frequency[m], self.mass, self.stiffness))
        others = self.shape[:, ~near] * turn / length[m]
        along, size, _ = la.svd(others - out @ (out.T @ others), full_matrices=False)
        less = 1.0 - 1.0 / np.hypot(1.0, size / sigma)

        def kept(x: Vector) -> Vector:
            x = x - out @ (out.T @ x)
            return np.asarray(x - (along * less) @ (along.T @ x))

        return kept

    def mixing(self, measured: Vector, modelled: Vector, column: NDArray[np.int64], form: Vector) -> Mixing:
        """Return shapes, (n_dof, n_mode), and the modes that they are taken for, at unit length, beside other modes.

        These are the lowest that the sensors see; no more than leave half of all directions free.
        """
        length = self.length
        others = np.setdiff1d(np.flatnonzero(length > _SEEN * length.max()), column)
        others = others[np.argsort(self.frequency[others])]
        others = others[: max(len(measured) // 2 - column.size, 0)]
        every = np.append(column, others)
        return Mixing(
            measured=measured,
            modelled=np.hstack([modelled, self.shape[:, others] / length[others]]),
            frequency=self.frequency[every],
            length=length[every],
            form=form,
            mass=self.mass,
            stiffness=self.stiffness,
        )
