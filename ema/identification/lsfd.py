"""Linear equations for residues and residual terms at given poles (least squares in the frequency domain, LSFD).

With ``s = i omega`` and ``p = 0, 1, 2`` for receptance, mobility and accelerance, every function is

    H(s) = s**p ( sum_r [ A_r / (s - pole_r) + conj(A_r) / (s - conj(pole_r)) ] + lower / s**2 + upper ),

linear in the real and imaginary parts of ``A_r``, ``lower`` and ``upper`` (Ewins, Modal Testing, 2nd ed.,
sec. 4.4; Heylen, Lammens and Sas, Modal Analysis Theory and Testing, part A). The equations are written
in the quantity that was measured, so that its noise is not reshaped by integration; `maximum_likelihood` beside
it solves them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ema.types.frf import DERIVATIVE, Quantity


def mode_basis(
    frequency: NDArray[np.float64], pole: NDArray[np.complex128], quantity: Quantity, power: int = 1
) -> NDArray[np.float64]:
    """Columns that the real and imaginary parts of the residues multiply.

    Parameters
    ----------
    frequency : (n_frequency,) float
        Lines above 0 Hz.
    pole : (n_mode,) complex
        Upper half-plane poles, rad/s.
    quantity : {"receptance", "mobility", "accelerance"}
        What the functions are.
    power : int, default 1
        Power of ``1 / (s - pole)``; 2 gives the derivatives with respect to the poles.

    Returns
    -------
    (2 n_frequency, 2 n_mode) float
        Real parts over imaginary parts; for each mode the column of Re A, then that of Im A.
    """
    s = 2j * np.pi * frequency[:, None]
    scale = s ** DERIVATIVE[quantity]
    above = scale / (s - pole) ** power
    below = scale / (s - pole.conj()) ** power
    basis = np.empty((frequency.size, 2 * pole.size), dtype=complex)
    basis[:, 0::2] = above + below
    basis[:, 1::2] = 1j * (above - below)
    return _stack(basis)


def residual_basis(frequency: NDArray[np.float64], quantity: Quantity) -> NDArray[np.float64]:
    """Columns of Re lower, Im lower, Re upper, Im upper, ``(2 n_frequency, 4)``, as in `mode_basis`."""
    s = 2j * np.pi * frequency
    exponent = DERIVATIVE[quantity]
    lower, upper = s ** (exponent - 2), s**exponent
    return _stack(np.stack([lower, 1j * lower, upper, 1j * upper], axis=1))


def stack_functions(value: NDArray[np.complex128]) -> NDArray[np.float64]:
    """Stack functions ``(n_function, n_frequency)`` as columns, real parts over imaginary ones."""
    return _stack(value.T)


def _stack(value: NDArray[np.complex128]) -> NDArray[np.float64]:
    return np.concatenate([value.real, value.imag])


def split_coefficients(
    coefficient: NDArray[np.float64],
) -> tuple[NDArray[np.complex128], NDArray[np.complex128], NDArray[np.complex128]]:
    """Read residues ``(n_function, n_mode)``, lower and upper ``(n_function,)`` from the solution."""
    complex_rows = coefficient[0::2] + 1j * coefficient[1::2]
    return complex_rows[:-2].T, complex_rows[-2], complex_rows[-1]
