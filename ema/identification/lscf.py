"""Poles of FRFs for every model order by the least-squares complex-frequency method (LSCF).

A common matrix denominator ``A`` and one numerator ``B_o`` for each output, polynomials in
``z = exp(-i theta)``, are fitted to ``H_o(f) A(z) = B_o(z)`` in the least-squares sense. The numerators are
eliminated output by output, which leaves the reduced normal equations

    D a = 0,   D = sum_o (T_o - S_o^H R^-1 S_o)

(Guillaume et al., A poly-reference implementation of the least-squares complex frequency-domain estimator,
IMAC XXI, 2003, eqs. 8-16). All blocks are Toeplitz, so that one set of Fourier sums fills the equations of
the highest order. The equations of every lower order are leading blocks in which the elimination uses fewer
rows of ``R^-1/2 S_o``; one Cholesky factor of ``R`` and one running sum therefore serve all orders.

The coefficient of the highest power is fixed to the identity, which drives the computational poles into the
unstable half-plane (Cauberghe, Guillaume, Verboven, Parloo and Vanlanduit, J. Sound Vib. 2005).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from ema.identification.polynomial_roots import nearby_roots
from ema.types.errors import IdentificationError

_AT_ONCE = 1 << 20  # values of functions that are summed over at once
_MANY = 30  # roots from which on those of the order before them save time


def lscf_poles(
    frequency: NDArray[np.float64], value: NDArray[np.complex128], order: int
) -> list[NDArray[np.complex128]]:
    """Return the upper half-plane poles of every model order up to `order`.

    Parameters
    ----------
    frequency : (n_frequency,) float
        Frequency lines, Hz, ascending. Where they begin near 0 Hz (below 2 % of the last line) the
        coefficients are real and the lines are mapped on half the unit circle, so that every pole comes with
        its conjugate. Else the lines are mapped on the full circle with complex coefficients, so that a
        narrow band far from 0 Hz is as well conditioned as a full one.
    value : (n_output, n_reference, n_frequency) complex
        Functions to fit; the references share the matrix denominator. Each function weighs as it is: scale
        them beforehand where one should not dominate.
    order : int
        Highest model order, the number of poles in the band per reference.

    Returns
    -------
    list of (n_pole,) complex
        Entry ``k`` holds the poles of order ``k + 1``, rad/s, ``Im > 0``, computational ones included.

    Raises
    ------
    IdentificationError
        Fewer lines than unknowns, or a value that is not finite.
    """
    half = bool(frequency[0] <= 0.02 * frequency[-1])
    step = (
        2 if half else 1
    )  # powers of z that an order adds: real coefficients have every pole with its conjugate
    _check(frequency, value, order, step)
    circle = _Circle.of(frequency, half=half)
    theta = circle.angle(frequency)
    found = []
    root = np.empty(0, dtype=complex)
    for coefficient in _denominators(theta, circle.weight(theta), value, step * order, step, real=half):
        root = _roots(coefficient, root)
        pole = circle.pole(root)
        found.append(pole[pole.imag > 0.0])
    return found


def _check(frequency: NDArray[np.float64], value: NDArray[np.complex128], order: int, step: int) -> None:
    """Refuse values that are not finite, and fewer lines than unknowns."""
    n_output, n_reference, n_frequency = value.shape
    if not np.all(np.isfinite(value)):
        message = "LSCF needs finite values; a function holds NaN or infinity"
        raise IdentificationError(message)
    if n_output * n_frequency * step < (step * order + 1) * (n_output + n_reference):
        message = (
            f"order {order} needs more lines than the {n_frequency} in "
            f"{frequency[0]:g}-{frequency[-1]:g} Hz: lower the order or widen the band"
        )
        raise IdentificationError(message)


@dataclass(frozen=True, kw_only=True)
class _Circle:
    """The unit circle that lines are mapped on: `half` of it from 0 Hz on, or all of it."""

    half: bool
    origin: float  # frequency at z = 1, Hz
    span: float  # of the whole circle, Hz

    @classmethod
    def of(cls, frequency: NDArray[np.float64], *, half: bool) -> _Circle:
        """Return the circle of which lines fill half or all."""
        first, last, n_frequency = float(frequency[0]), float(frequency[-1]), frequency.size
        if half:
            return cls(half=True, origin=0.0, span=2.0 * last)
        return cls(half=False, origin=first, span=(last - first) * n_frequency / (n_frequency - 1))

    def angle(self, frequency: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the angles of lines, rad."""
        return 2.0 * np.pi * (frequency - self.origin) / self.span

    def weight(self, theta: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return what lines count: one at 0 or pi of the half circle is its own conjugate, the others count twice."""
        return np.where(np.isclose(np.sin(theta), 0.0, atol=1e-12) & self.half, 0.5, 1.0)

    def pole(self, root: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """Return the poles, rad/s, of roots in z."""
        logarithm = -np.log(root)
        if not self.half:
            # The band fills the whole circle, so its upper half belongs to angles from pi to 2 pi.
            logarithm.imag %= 2.0 * np.pi
        return np.asarray(logarithm * self.span + 2j * np.pi * self.origin)


def _denominators(
    theta: NDArray[np.float64],
    weight: NDArray[np.float64],
    value: NDArray[np.complex128],
    degree: int,
    step: int,
    *,
    real: bool,
) -> list[NDArray[Any]]:
    """Solve for the denominators ``(k, m, m)`` of every degree ``k``, the monic coefficient left out."""
    n_output, m, n_frequency = value.shape
    size = degree + 1
    kernel = np.exp(1j * np.outer(np.arange(size), theta))
    cross_power, lags = np.zeros((m, m, n_frequency), complex), []
    few = max(1, _AT_ONCE // (m * n_frequency))
    for first in range(0, n_output, few):
        own = value[first : first + few]
        weighted = own * weight
        lags.append(_lags(kernel, weighted.reshape(-1, n_frequency), real=real))
        cross_power += np.einsum("oaf,obf->abf", weighted.conj(), own, optimize=True)
    data, power = np.concatenate(lags, axis=1), cross_power.reshape(m * m, n_frequency)
    regression = _lags(kernel, weight[None].astype(complex), real=real)[size - 1 :, 0]
    response = _lags(kernel, power, real=real).reshape(-1, m, m)

    # Entry (j, k) of every Toeplitz block is the sum of lag j - k.
    index = np.arange(size)[:, None] - np.arange(size)[None, :] + degree
    total = response[index].transpose(0, 2, 1, 3).reshape(size * m, size * m)
    factor = _cholesky(scipy.linalg.toeplitz(regression, regression.conj()))
    inverse = scipy.linalg.solve_triangular(factor, np.eye(size), lower=True, check_finite=False)
    # Rows of all outputs stand together, so that each order's are one block of memory.
    outputs = np.arange(n_output)[None, :, None]
    cross = data.reshape(-1, n_output, m).swapaxes(0, 1)[
        outputs, index[:, None, :]
    ]  # (size, n_output, size, m)
    (multiply,) = scipy.linalg.get_blas_funcs(("trmm",), (inverse, cross))
    # BLAS stores by columns, hence the transposes.
    whitened = multiply(1.0, inverse.T, cross.reshape(size, -1).T, side=1, overwrite_b=True)
    whitened = whitened.T.reshape(size, n_output, size * m)

    explained = np.zeros_like(total)
    row = 0
    coefficients: list[NDArray[Any]] = []
    for k in range(step, degree + 1, step):
        used, free = (k + 1) * m, k * m
        new = whitened[row : k + 1].reshape(-1, size * m)
        explained += new.conj().T @ new
        row = k + 1
        reduced = total[:used, :used] - explained[:used, :used]
        coefficients.append(_solve(reduced[:free, :free], -reduced[:free, free:]).reshape(k, m, m))
    return coefficients


def _lags(kernel: NDArray[np.complex128], value: NDArray[np.complex128], *, real: bool) -> NDArray[Any]:
    """Sum ``value exp(i lag theta)`` over the lines for lags ``-degree..degree``: ``(n_lag, n_row)``."""
    if real:
        even, odd = kernel.real @ value.real.T, kernel.imag @ value.imag.T
        return np.concatenate([(even + odd)[:0:-1], even - odd])
    return np.concatenate([(kernel.conj() @ value.T)[:0:-1], kernel @ value.T])


def _cholesky(matrix: NDArray[Any]) -> NDArray[Any]:
    """Lower Cholesky factor; lines that leave part of the circle empty need a shift of rounding size."""
    try:
        return scipy.linalg.cholesky(matrix, lower=True)
    except scipy.linalg.LinAlgError:
        shift = 1e-13 * np.trace(matrix).real
        return scipy.linalg.cholesky(matrix + shift * np.eye(len(matrix)), lower=True)


def _solve(matrix: NDArray[Any], right: NDArray[Any]) -> NDArray[Any]:
    """Solve, with the minimum-norm answer where exact data leave an over-modelled order singular."""
    try:
        return np.linalg.solve(matrix, right)
    except np.linalg.LinAlgError:
        return np.linalg.lstsq(matrix, right, rcond=None)[0]


def _roots(coefficient: NDArray[Any], known: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Roots of ``det(sum_k coefficient[k] z**k + I z**n)`` as eigenvalues of the block companion matrix.

    The coefficients stand in the first block row, the form that LAPACK reduces fastest. Many roots of one polynomial
    are found from `known` ones, those of the order before.
    """
    n, m, _ = coefficient.shape
    if m == 1 and n > _MANY:
        near = nearby_roots(coefficient[:, 0, 0], known)
        if near is not None:
            real = np.abs(near.imag) < 1e-12 * np.abs(near)  # to rounding, which eigenvalues do not have
            return np.where(real & np.isrealobj(coefficient), near.real, near)
    companion = np.zeros((n * m, n * m), dtype=coefficient.dtype, order="F")
    companion[:m] = -coefficient[::-1].transpose(1, 0, 2).reshape(m, n * m)
    companion[np.arange(m, n * m), np.arange((n - 1) * m)] = 1.0
    return scipy.linalg.eigvals(companion, overwrite_a=True, check_finite=False).astype(complex)
