"""Whether measured shapes lean towards other modes by more than small unknowns make them.

What a model lacks turns each mode towards others, c_rs = m_rs w_r**2 / (w_s**2 - w_r**2) for a mass m (Fox and Kapoor,
AIAA J. 6, 1968), in few directions of the many that a shape has; a sum over all points loses it. Sensors, cables and
glue do the same to every stack, so mixing counts beside theirs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

Vector = NDArray[np.float64]

_FEWEST = 3  # measured degrees of freedom beyond the modes, from which noise can be told


@dataclass(frozen=True, eq=False, kw_only=True)
class Mixing:
    """Shapes of one configuration, measured and modelled, at unit length.

    Attributes
    ----------
    measured, modelled : (n_dof, n_mode) float
        Mode by mode.
    frequency : (n_mode,) float
        Of the model, Hz.
    form : (n_mode,) float
        Length by which the form of an effect may be off.
    small : float
        Standard deviation of m_rs, see `Scatter.mixing`.
    """

    measured: Vector
    modelled: Vector
    frequency: Vector
    form: Vector
    small: float

    def misfit(self) -> tuple[float, int]:
        """Return the squared misfit of all mixing coefficients together, and their number.

        Their covariance is that of the noise, which the part of the shapes tells that no mode has, with that of small
        masses, which turn both modes of a pair at once, and of the form of an effect.
        """
        n_dof, n_mode = self.modelled.shape
        free = n_dof - n_mode
        if n_mode < 2 or free < _FEWEST:
            return 0.0, 0
        difference = self.measured - self.modelled
        coefficient = np.linalg.lstsq(self.modelled, difference, rcond=None)[0]
        noise = np.sum((difference - self.modelled @ coefficient) ** 2, axis=0) / free
        own = np.linalg.inv(self.modelled.T @ self.modelled)
        s, r = np.nonzero(~np.eye(n_mode, dtype=bool))  # of mode s in shape r
        square = self.frequency**2
        near = square[r] / (square[s] - square[r])
        same_shape = r[:, None] == r
        same_pair = (s[:, None] == s) & same_shape | (s[:, None] == r) & (r[:, None] == s)
        covariance = np.where(same_shape, noise[r] * own[np.ix_(s, s)], 0.0)
        covariance += np.where(same_pair, self.small**2 * np.outer(near, near), 0.0)
        covariance += np.diag(self.form[r] ** 2)
        c = coefficient[s, r]
        # the noise is estimated: the mean of F
        return float(c @ np.linalg.solve(covariance, c)) * (free - 2) / free, c.size


def p_value(configurations: Sequence[Mixing]) -> float:
    """Return the probability of as much mixing if the model were complete."""
    found = [own.misfit() for own in configurations]
    number = sum(n for _, n in found)
    return float(chi2.sf(sum(misfit for misfit, _ in found), number)) if number else 1.0
