"""Whether measured shapes lean towards other modes by more than small unknowns make them.

What a model lacks turns each mode towards others, c_rs = m_rs w_r**2 / (w_s**2 - w_r**2) for a mass m and
k_rs w_r w_s / (w_r**2 - w_s**2) for a stiffness k, over modal ones (Fox and Kapoor, AIAA J. 6, 1968), in few directions
of the many that a shape has; a sum over all points loses it. Sensors, cables and glue do the same to every stack, and
so does what the mesh and the reduction leave, so mixing counts beside theirs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

Vector = NDArray[np.float64]

NEIGHBOUR = 0.05
"""Relative distance of frequencies up to which how modes mix is not to be predicted."""
_FEWEST = 3  # measured degrees of freedom beyond the modes, from which noise can be told
# squared length of what parts shapes, below which sensors tell nothing of their mixing: models are right to about that
_PARTED = 1e-4


@dataclass(frozen=True, eq=False, kw_only=True)
class Mixing:
    """Shapes of one configuration, measured and modelled, at unit length.

    Attributes
    ----------
    measured : (n_dof, n_mode) float
        Mode by mode.
    modelled : (n_dof, n_column) float
        Those that they are taken for, and behind them other modes of the model.
    frequency : (n_column,) float
        Of the model, Hz; 0 of rigid-body motion.
    length : (n_column,) float
        What the shapes of unit modal mass were divided by.
    form : (n_mode,) float
        Length by which the form of an effect may be off.
    mass, stiffness : float
        Standard deviations of m_rs, see `DiagnosisScatter.mixing`, and of k_rs.
    """

    measured: Vector
    modelled: Vector
    frequency: Vector
    length: Vector
    form: Vector
    mass: float
    stiffness: float

    def misfit(self) -> tuple[float, int]:
        """Return the squared misfit of all mixing coefficients together, and their number.

        Their covariance is that of the noise, which the part of the shapes tells that no mode has, with that of small
        masses and stiffnesses, which turn both modes of a pair at once, and of the form of an effect.
        """
        (n_dof, n_column), n_mode = self.modelled.shape, self.measured.shape[1]
        free = n_dof - n_column
        apart = np.abs(self.frequency[:, None] / self.frequency[:n_mode] - 1.0) > NEIGHBOUR
        s, r = np.nonzero(apart)  # of mode s in shape r
        if not s.size or free < _FEWEST:
            return 0.0, 0
        difference = self.measured - self.modelled[:, :n_mode]
        own = np.linalg.inv(self.modelled.T @ self.modelled + _PARTED * np.eye(n_column))
        coefficient = own @ (self.modelled.T @ difference)
        rest = difference - self.modelled @ coefficient
        noise = np.sum(rest**2, axis=0) / (free - 2)  # it is estimated: the mean of F over that of chi-square
        omega = self.frequency
        by_mass, by_stiffness = (
            by * self.length[s] / self.length[r]
            for by in leaning(omega[s], omega[r], self.mass, self.stiffness)
        )
        same_shape = r[:, None] == r
        same_pair = (s[:, None] == s) & same_shape | (s[:, None] == r) & (r[:, None] == s)
        covariance = np.where(same_shape, noise[r] * own[np.ix_(s, s)], 0.0)
        covariance += same_pair * (np.outer(by_mass, by_mass) + np.outer(by_stiffness, by_stiffness))
        covariance += np.diag(self.form[r] ** 2)
        c = coefficient[s, r]
        return float(c @ np.linalg.solve(covariance, c)), c.size


def leaning(
    towards: Vector, frequency: Vector | float, mass: float, stiffness: float
) -> tuple[Vector, Vector]:
    """Return by how much a mass and a stiffness, over modal ones, turn modes of a frequency towards others.

    Parameters
    ----------
    towards, frequency : (n,)
        Of the other modes and of those that turn, Hz.
    mass, stiffness : float
        m_rs and k_rs.
    """
    away = towards**2 - frequency**2
    return mass * frequency**2 / away, -stiffness * frequency * towards / away


def p_value(configurations: Sequence[Mixing]) -> float:
    """Return the probability of as much mixing if the model were complete."""
    found = [own.misfit() for own in configurations]
    number = sum(n for _, n in found)
    return float(chdtrc(number, sum(misfit for misfit, _ in found))) if number else 1.0
