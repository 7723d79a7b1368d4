"""Columns that residues and residual terms multiply in functions, and their derivatives with respect to the poles.

With ``s = i omega`` and ``p = 0, 1, 2`` for receptance, mobility and accelerance these are the terms of

    H(s) = s**p ( sum_r [ A_r / (s - pole_r) + conj(A_r) / (s - conj(pole_r)) ] + lower / s**2 + upper ),

in real arithmetic: complex divisions take several times as long.
"""

from __future__ import annotations

import numpy as np

from ema.types.frf import DERIVATIVE, Quantity
from lamella_shared import Complexes, Reals

_BLOCK = 8192  # values that are worked on at once: more, and the system makes room for arrays again and again
_Parts = tuple[Reals, Reals]


def mode_basis(frequency: Reals, pole: Complexes, quantity: Quantity, power: int = 1) -> Reals:
    """Columns that the real and imaginary parts of the residues multiply.

    Parameters
    ----------
    frequency : (n_frequency,) float
        Lines above 0 Hz.
    pole : (n_mode,) complex
        Upper half-plane poles, rad/s.
    quantity : {"receptance", "mobility", "accelerance"}
        What the functions are.
    power : {1, 2}
        Power of ``1 / (s - pole)``; 2 gives the derivatives with respect to the poles.

    Returns
    -------
    (2 n_frequency, 2 n_mode) float
        Real parts over imaginary parts; for each mode the column of Re A, then that of Im A.
    """
    omega, n = 2.0 * np.pi * frequency, frequency.size
    basis = np.empty((pole.size, 2, 2, n))
    few = max(1, _BLOCK // n)
    for k in range(0, pole.size, few):
        rows, some = basis[k : k + few], pole[k : k + few, None]
        for row, receptance in enumerate(_columns(omega, some, power)):
            rows[:, row, 0], rows[:, row, 1] = _derived(omega, receptance, quantity)
    return basis.reshape(2 * pole.size, 2 * n).T


def mode_derivatives(frequency: Reals, rows: Reals, quantity: Quantity) -> Reals:
    """Return the derivatives of modes with respect to their poles, `mode_basis` with a power of 2, from its columns.

    Parameters
    ----------
    frequency : (n_frequency,) float
        Lines above 0 Hz.
    rows : (2 n_mode, 2 n_frequency) float
        The columns of `mode_basis`, as rows.
    quantity : {"receptance", "mobility", "accelerance"}

    Returns
    -------
    (2 n_mode, 2 n_frequency) float
        Rows in the same order.
    """
    n, omega = frequency.size, 2.0 * np.pi * frequency
    parts, derivatives = rows.reshape(-1, 2, 2, n), np.empty((len(rows) // 2, 2, 2, n))
    few = max(1, _BLOCK // n)
    # With p and q = 1 / (s - pole) and its mirror image, p**2 + q**2 and i (p**2 - q**2) from p + q and i (p - q).
    for k in range(0, len(parts), few):
        (a, b), (c, d) = parts[k : k + few].transpose(1, 2, 0, 3)
        pairs = (0.5 * ((a - b) * (a + b) - (c - d) * (c + d)), a * b - c * d), (a * c - b * d, a * d + b * c)
        for row, receptance in enumerate(pairs):
            some = derivatives[k : k + few, row]
            some[:, 0], some[:, 1] = _once(omega, receptance, quantity)
    return derivatives.reshape(rows.shape)


def _once(omega: Reals, square: _Parts, quantity: Quantity) -> _Parts:
    """Return products of two functions of a quantity divided by ``s**p``, so that they are of the quantity again."""
    real, imaginary = square
    if quantity == "mobility":
        return imaginary / omega, -real / omega
    return (-real / omega**2, -imaginary / omega**2) if quantity == "accelerance" else square


def _columns(omega: Reals, pole: Complexes, power: int) -> tuple[_Parts, _Parts]:
    """Real and imaginary parts ``(n_mode, n_frequency)`` of what Re A and Im A multiply in a receptance.

    They are 2 (s - decay) / D and -2 own / D with D = (s - pole) (s - conj(pole)), in real arithmetic: complex
    divisions take several times as long. No nearly equal numbers are subtracted but the frequencies.
    """
    decay, rotation = pole.real, pole.imag
    re, im = decay**2 - (omega - rotation) * (omega + rotation), (-2.0 * decay) * omega
    double = 2.0 / (re * re + im * im)
    a, b = (omega * omega + (decay**2 + rotation**2)) * (-decay * double), (omega * re + decay * im) * double
    c, d = re * (-rotation * double), im * (rotation * double)
    if power == 1:
        return (a, b), (c, d)
    # With p and q = 1 / (s - pole) and its mirror image, p**2 + q**2 and i (p**2 - q**2) from p + q and i (p - q).
    return (0.5 * (a * a - b * b - c * c + d * d), a * b - c * d), (a * c - b * d, a * d + b * c)


def _derived(omega: Reals, receptance: _Parts, quantity: Quantity) -> _Parts:
    real, imaginary = receptance
    if quantity == "mobility":
        return -omega * imaginary, omega * real
    square = omega * omega
    return (-square * real, -square * imaginary) if quantity == "accelerance" else receptance


def residual_basis(frequency: Reals, quantity: Quantity) -> Reals:
    """Columns of Re lower, Im lower, Re upper, Im upper, ``(2 n_frequency, 4)``, as in `mode_basis`."""
    s = 2j * np.pi * frequency
    exponent = DERIVATIVE[quantity]
    lower, upper = s ** (exponent - 2), s**exponent
    return _stack(np.stack([lower, 1j * lower, upper, 1j * upper], axis=1))


def stack_functions(value: Complexes) -> Reals:
    """Stack functions ``(n_function, n_frequency)`` as columns, real parts over imaginary ones."""
    return _stack(value.T)


def _stack(value: Complexes) -> Reals:
    return np.concatenate([value.real, value.imag])


def split_coefficients(coefficient: Reals) -> tuple[Complexes, Complexes, Complexes]:
    """Read residues ``(n_function, n_mode)``, lower and upper ``(n_function,)`` from the solution."""
    complex_rows = coefficient[0::2] + 1j * coefficient[1::2]
    return complex_rows[:-2].T, complex_rows[-2], complex_rows[-1]
