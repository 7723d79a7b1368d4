"""The gradient of the cost, from the posterior of each measured mode's modal coordinates.

The density of a measured mode, its modal coordinates a integrated out, is that of u = alpha (Psi a + n) times
N(B a; 0, S) abs(det B), where B has the equations' errors e = B a: the diagonal of the gaps in the basis of the model's
modes, and dB = -Phi' (dK - lambda_r dM) Phi / (omega_s omega_r) in that basis as it stands. So (Fisher's identity) the
derivative of its logarithm is that of the integrand, in the mean of what is known of a, mean b and covariance D:
p' dB b + tr[(C B' P - B^-1) dB]. Here p are the errors over their covariance, P is the inverse of that covariance, and
C the covariance of a by shapes alone. A mode that sensors hardly see acts by its equation, not by its noise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from updating.inference.protocol import Modal

Vector = NDArray[np.float64]


@dataclass(frozen=True, eq=False, kw_only=True)
class Latent:
    """What shapes alone say of the modal coordinates of the measured modes of one state.

    Attributes
    ----------
    modal : Modal
        The model.
    eigenvalue : (n,) float
        Measured, (rad/s)**2.
    mean, covariance : (n, m) and (n, m, m) float
        Modal coordinates and their covariance.
    weight : (n, m) float
        Coordinates of unit length, by which the discrepancy acts.
    gap, scale : (n, m) float
        What coordinates are multiplied by to give errors, and what it is relative to.
    shape : (n, n_dof) float
        Measured shapes over their length.
    sure : (n,) float
        Precision of one component of each.
    looked : (n,) bool
        Modes whose shapes count: those of the model.
    """

    modal: Modal
    eigenvalue: Vector
    mean: Vector
    covariance: Vector
    weight: Vector
    gap: Vector
    scale: Vector
    shape: Vector
    sure: Vector
    looked: NDArray[np.bool_]

    def gradient(self, pull: Vector, inverse: Vector, n_coordinate: int) -> Vector:
        """Return the gradient of minus the logarithm of the density, damping left out, by mode, (n, n_coordinate).

        Parameters
        ----------
        pull : (n, m)
            Errors over their covariance.
        inverse : (n, m, m)
            Blocks of the inverse of that covariance, mode by mode.
        n_coordinate : int
            Number of coordinates.
        """
        modal, gap, scale = self.modal, self.gap, self.scale
        n, m = gap.shape
        lam, equation = self.eigenvalue[:, None], np.arange(m)
        spread = self.covariance * gap[:, None, :]  # C B'
        mean = self.mean - np.einsum("rij,rj->ri", spread, pull)
        covariance = self.covariance - spread @ inverse @ spread.transpose(0, 2, 1)
        # Derivative by each element of dB, (n, m, m), and from it that by each element of dK.
        counts = pull[:, :, None] * mean[:, None, :] + (spread @ inverse).transpose(0, 2, 1)
        counts[:, equation, equation] -= 1.0 / gap
        by_stiffness = -counts / scale[:, :, None]
        # log |sum_s a_s**2 / (lambda_r - lambda_s)|, of the map from lambda_r to e
        along = self.weight / (gap * scale)
        length = np.sum(self.weight * along, axis=1)
        by_stiffness -= along[:, :, None] * (along / length[:, None])[:, None, :]
        by_mass = -lam[:, :, None] * by_stiffness
        scaled = gap * np.einsum("rii->ri", counts)  # as the errors of an equation, or of a mode, grow
        heavier = 1.0 - 0.5 * scaled.sum(axis=1)  # a is of unit length by the modal mass
        by_mass += heavier[:, None, None] * self.weight[:, :, None] * self.weight[:, None, :]
        elastic = np.where(equation >= modal.n_rigid, modal.eigenvalue, np.inf)
        by_stiffness[:, equation, equation] -= 0.5 * scaled / elastic
        by_mass[:, equation, equation] += 0.5 * scaled * (equation >= modal.n_rigid)

        sure = self.sure * self.looked
        rest = (self.shape - mean @ modal.rows.T) * sure[:, None]
        seen = (modal.rows @ covariance) * sure[:, None, None]
        by_rows = seen - rest[:, :, None] * mean[:, None, :]  # derivative by each element of dPsi, (n, n_dof, m)
        total = np.zeros((n, n_coordinate))
        if modal.looks.size:
            total[:, modal.looks] += _times(by_rows, modal.row_change)
        if modal.moves.size:
            by_beyond = (modal.beyond_rows.T @ by_rows) / (lam - modal.beyond)[:, :, None]
            total[:, modal.moves] += (
                _times(by_stiffness, modal.stiffness)
                + _times(by_mass, modal.mass)
                + _times(by_beyond, modal.beyond_stiffness)
                - _times(lam[:, :, None] * by_beyond, modal.beyond_mass)
            )
        if modal.of_mode_moves.size:
            of_mode = -(pull / scale)[:, :, None] * mean[:, None, :]
            total[:, modal.of_mode_moves] += np.einsum("srij,rij->rs", modal.of_mode_change, of_mode)
        return total


def _times(counts: Vector, change: Vector) -> Vector:
    """Return sums of (n, i, j) over each of (q, i, j), (n, q)."""
    return np.asarray(counts.reshape(len(counts), -1) @ change.reshape(len(change), -1).T)
