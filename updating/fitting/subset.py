"""Which parameters data determine: subset selection by pivoted QR.

Parameters are chosen one after another, each time the one that changes the data most in a way that those chosen
before cannot. Source: Lallement and Piranda, Localization methods for parameter updating of finite element models in
elastodynamics, Proc. IMAC VIII, 1990; Friswell, Mottershead and Ahmadian, Phil. Trans. R. Soc. A 359, 2001.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
from numpy.typing import ArrayLike, NDArray


def select(sensitivity: ArrayLike) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Rank parameters by what they alone change in the data.

    Parameters
    ----------
    sensitivity : (n_residual, n_parameter) array_like
        Change of the data, in their standard deviations, when each parameter moves by what was known of it before,
        such as the spread of a uniform distribution over its range.

    Returns
    -------
    order : (n_parameter,) int
        Parameters in the order in which they were chosen.
    gain : (n_parameter,) float
        Of each parameter, in the order given: length of its change of the data, without what the parameters chosen
        before it can do. Above 1 the data say more than was known before.
    """
    matrix = np.asarray(sensitivity, dtype=float)
    _, upper, order = la.qr(matrix, mode="economic", pivoting=True)
    length = np.zeros(matrix.shape[1])
    diagonal = np.abs(np.diag(upper))
    length[order[: diagonal.size]] = diagonal
    return np.asarray(order, dtype=np.int64), length
