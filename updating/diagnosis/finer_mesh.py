"""What a finer mesh adds to the stiffness of a stack's model."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from model import Observation, observe
from updating.diagnosis.candidates import EXTRAPOLATED, N_MODEL, CandidateModel

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
        self,
        theta: Mapping[str, float],
        eigenvalue: Vector,
        vectors: Vector,
        rigid: float,
        *,
        alike: float = 0.9,
    ) -> Vector | None:
        """Return what an ever finer mesh adds to the modal stiffness, (m, m), of modes (n_basis, m).

        Nothing is added to rigid-body motion, of eigenvalues below `rigid`, nor to modes that the finer model was not
        reduced for: those beyond `N_MODEL`, and those of which it has less than `alike`, near the end of its list.
        """
        if self.finer is None:
            return None
        finer = self.finer_equations
        at = {name: theta[name] for name in finer.theta}
        value, vector = la.eigh(finer.matrix("K", at), finer.matrix("M", at))
        m, n = eigenvalue.size, min(eigenvalue.size, N_MODEL)
        raw = la.lstsq(self.rows @ vectors, self.finer_rows @ vector[:, :n])[0][:n]
        u, _, v = la.svd(raw)
        turn = u @ v
        finer_stiffness = turn @ np.diag(np.where(value[:n] < rigid, 0.0, value[:n])) @ turn.T
        change = np.zeros((m, m))
        change[:n, :n] = EXTRAPOLATED * (
            finer_stiffness - np.diag(np.where(eigenvalue[:n] < rigid, 0.0, eigenvalue[:n]))
        )
        lost = np.append(np.sum(raw**2, axis=1) < alike, np.ones(m - n, dtype=bool)) | (eigenvalue < rigid)
        change[lost] = 0.0
        change[:, lost] = 0.0
        return np.asarray((change + change.T) / 2.0)
