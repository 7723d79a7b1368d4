"""The lowest modes of full sparse matrices, which what is reduced is compared with."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as sla
from numpy.typing import NDArray

from model import Assembly


def lowest_modes(
    assembly: Assembly, n: int, *, hertz: float = 200.0, **parameters: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return natural frequencies (n,), Hz, and modes (size, n) by ARPACK with a SuperLU factor in its symmetric mode.

    The shift of the inverse is a negative square of `hertz`, which makes the matrix positive definite: minimum degree
    needs a third of the time of the default order then, and no pivots.
    """
    theta = {**assembly.theta, **parameters}
    return lowest(*(assembly.matrix(target, theta) for target in ("K", "M")), n, hertz=hertz)


def lowest(
    stiffness: sp.sparray, mass: sp.sparray, n: int, *, hertz: float = 200.0
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the same of two sparse matrices."""
    shift = -((2.0 * np.pi * hertz) ** 2)
    inverse = shifted_inverse(stiffness, mass, shift)
    square, vector = sla.eigsh(stiffness, n, mass, sigma=shift, OPinv=inverse)
    order = np.argsort(square)
    return np.sqrt(np.abs(square[order])) / (2.0 * np.pi), vector[:, order]


def shifted_inverse(stiffness: sp.sparray, mass: sp.sparray, shift: float) -> sla.LinearOperator:
    """Return the inverse of K - shift M, which is positive definite, by SuperLU in its symmetric mode."""
    factor = sla.splu(
        (stiffness - shift * mass).tocsc(),
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )
    return sla.LinearOperator(stiffness.shape, matvec=factor.solve)
