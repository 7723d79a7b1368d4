"""Linear algebra of fits whose coordinates differ by orders in what is known of them."""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

Matrix = NDArray[np.float64]


def scaled_solve(matrix: Matrix, right: Matrix, *, damp: float = 1e-9) -> Matrix:
    """Solve with a symmetric positive matrix whose diagonal is scaled to one before a share of it is added.

    Parameters
    ----------
    matrix : (n, n)
        A Hessian.
    right : (n,) or (n, m)
        Right sides.
    damp : float
        What is added to the scaled diagonal, as Levenberg and Marquardt do.
    """
    unit = 1.0 / np.sqrt(np.diag(matrix) + 1e-12)
    scaled = unit[:, None] * matrix * unit + damp * np.eye(unit.size)
    found = la.solve(scaled, (unit * right.T).T, assume_a="pos")
    return np.asarray((unit * found.T).T)


def scaled_inverse(matrix: Matrix) -> Matrix:
    """Return the inverse of a symmetric matrix, what it does not determine left out, its diagonal scaled to one first.

    Parameters
    ----------
    matrix : (n, n)
        A Hessian.
    """
    unit = 1.0 / np.sqrt(np.diag(matrix) + 1e-12)
    return np.asarray(unit[:, None] * la.pinvh(unit[:, None] * matrix * unit) * unit)
