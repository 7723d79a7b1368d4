"""What a finer mesh adds to the stiffness of a stack's model."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from model import Observation, observe
from updating.diagnosis.candidates import EXTRAPOLATED, CandidateModel

Vector = NDArray[np.float64]


class FinerMesh:
    """What an ever finer mesh adds to the stiffness between the base model's modes (Richardson 1911)."""

    def __init__(self, candidates: CandidateModel) -> None:
        self.finer = candidates.finer
        if self.finer is None:
            return
        stack = candidates.stack
        x, y = (np.linspace(-0.5, 0.5, n) * size for n, size in ((9, stack.length), (4, stack.width)))
        z = np.linspace(-0.5, 0.5, 5) * stack.height
        location = np.stack(np.meshgrid(x, y, z, indexing="ij"), axis=-1).reshape(-1, 3)
        n = len(location)
        everywhere = Observation(
            node=np.tile(np.arange(n), 3),
            location=np.tile(location, (3, 1)),
            direction=np.repeat(np.eye(3), n, axis=0),
        )
        self.rows = observe(candidates.system, everywhere).reduced_rows
        self.finer_rows = observe(self.finer, everywhere).reduced_rows
        self.finer_equations = self.finer.equations

    def change(
        self, theta: Mapping[str, float], eigenvalue: Vector, vectors: Vector, rigid: float
    ) -> Vector | None:
        """Return what an ever finer mesh adds to the modal stiffness, (m, m), of modes (n_basis, m).

        Modes of eigenvalues below `rigid` are rigid-body motion.
        """
        if self.finer is None:
            return None
        finer = self.finer_equations
        at = {name: theta[name] for name in finer.theta}
        value, vector = la.eigh(finer.matrix("K", at), finer.matrix("M", at))
        m = eigenvalue.size
        turn = la.lstsq(self.rows @ vectors, self.finer_rows @ vector[:, :m])[0]
        u, _, v = la.svd(turn)
        turn = u @ v
        found = turn @ np.diag(np.where(value[:m] < rigid, 0.0, value[:m])) @ turn.T
        change = EXTRAPOLATED * (found - np.diag(np.where(eigenvalue < rigid, 0.0, eigenvalue)))
        change[eigenvalue < rigid] = 0.0
        change[:, eigenvalue < rigid] = 0.0
        return np.asarray((change + change.T) / 2.0)
