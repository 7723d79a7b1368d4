"""Linear algebra of fits: some coordinates are known better than others by orders of magnitude."""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

Matrix = NDArray[np.float64]


def scaled_solve(matrix: Matrix, right: Matrix, *, damp: float = 1e-9) -> Matrix:
    """Solve with a symmetric positive matrix, its diagonal scaled to one and damped.

    Parameters
    ----------
    matrix : (n, n)
        A Hessian.
    right : (n,) or (n, m)
        Right sides.
    damp : float
        Added to the scaled diagonal, as in Levenberg and Marquardt's method.
    """
    unit = 1.0 / np.sqrt(np.diag(matrix) + 1e-12)
    scaled = unit[:, None] * matrix * unit + damp * np.eye(unit.size)
    solution = la.solve(scaled, (unit * right.T).T, assume_a="pos")
    return np.asarray((unit * solution.T).T)


def bounded_step(slope: Matrix, hessian: Matrix, lower: Matrix, upper: Matrix, *, damp: float = 1e-9) -> Matrix:
    """Return a step that lowers a quadratic cost within bounds.

    What would leave its bounds is held there, and the others step as far as is best with it.

    Parameters
    ----------
    slope, hessian : (n,) and (n, n)
        Gradient of the cost and its Hessian.
    lower, upper : (n,)
        Bounds of the step, at most and at least 0.
    damp : float
        As `scaled_solve` takes it.
    """
    free = ~(((lower >= 0.0) & (slope > 0.0)) | ((upper <= 0.0) & (slope < 0.0)))
    step = np.zeros(slope.size)
    while free.any():
        downhill = -(slope + hessian[:, ~free] @ step[~free])
        step[free] = scaled_solve(hessian[np.ix_(free, free)], downhill[free], damp=damp)
        within = np.clip(step, lower, upper)
        left = free & (within != step)
        if not left.any():
            break
        step[left], free = within[left], free & ~left
    return step


def scaled_inverse(matrix: Matrix) -> Matrix:
    """Return the pseudoinverse of a symmetric matrix, its diagonal scaled to one first.

    Parameters
    ----------
    matrix : (n, n)
        A Hessian.
    """
    unit = 1.0 / np.sqrt(np.diag(matrix) + 1e-12)
    return np.asarray(unit[:, None] * la.pinvh(unit[:, None] * matrix * unit) * unit)
