"""Maximum-likelihood poles, residues and residual terms of all modes together, with their covariance.

The noise is taken as circular complex normal, independent between lines and functions, of variance
``sigma_o**2 / weight_of`` with an unknown ``sigma_o`` per function and given weights. Residues and residual
terms are linear and are eliminated (variable projection, Golub and Pereyra, SIAM J. Numer. Anal. 10, 1973);
Gauss-Newton with Levenberg-Marquardt damping runs on the poles alone, with Kaufman's analytic Jacobian (BIT 15,
1975), whose gradient is exact. The variances follow from the residuals at every step, so that the end point is
that of the concentrated likelihood.

All functions share one basis, hence one QR factor: a step costs a factorisation of ``2 n_frequency`` rows and
some products, whatever the number of functions. Where lines weigh differently, each function has in addition its
own small normal equations in the orthonormal basis, which are as well conditioned as the weights are even.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from ema.identification.lsfd import mode_basis, residual_basis, split_coefficients, stack_functions
from ema.types.frf import Quantity

MAX_STEP = 60
TOLERANCE = 1e-3
"""Steps end when one gains less log-likelihood: a few % of the standard deviation of a pole."""
_NONE = np.empty(0, dtype=complex)


@dataclass(frozen=True, eq=False, kw_only=True)
class Fit:
    """A modal fit of a set of functions and its uncertainty.

    Attributes
    ----------
    pole : (n_mode,) complex
        Poles, rad/s.
    pole_covariance : (2 n_mode, 2 n_mode) float
        Covariance of Re and Im of each pole in turn, (rad/s)**2: the inverse Fisher information.
    residue : (n_function, n_mode) complex
        Residues of the receptance, m/(N s).
    lower, upper : (n_function,) complex
        Residual terms of the receptance, 1/kg and m/N.
    noise : (n_function,) float
        Standard deviation of the complex residual of each function at weight 1, in the unit of the measured
        quantity.
    weight : (n_function, n_frequency) float
        Assumed inverse variances relative to ``noise**2``, of geometric mean 1.
    residual : (n_function, n_frequency) complex
        Measured less fitted functions.
    linear_covariance : (1 or n_function, 2 n_mode, 2 n_mode) float
        Covariance of Re and Im of the residues at fixed poles for unit ``noise``; one for all functions where
        they have the same weights.
    sensitivity : (n_function, 2 n_mode, 2 n_mode) float
        Derivative of Re and Im of the residues of each function with respect to Re and Im of the poles.
    objective : float
        Concentrated negative log-likelihood, up to a constant.
    """

    pole: NDArray[np.complex128]
    pole_covariance: NDArray[np.float64]
    residue: NDArray[np.complex128]
    lower: NDArray[np.complex128]
    upper: NDArray[np.complex128]
    noise: NDArray[np.float64]
    weight: NDArray[np.float64]
    residual: NDArray[np.complex128]
    linear_covariance: NDArray[np.float64]
    sensitivity: NDArray[np.float64]
    objective: float

    @property
    def whitened(self) -> NDArray[np.complex128]:
        """Residuals over their assumed standard deviations, ``(n_function, n_frequency)``."""
        return self.residual * np.sqrt(self.weight) / self.noise[:, None]

    def residue_covariance(self) -> NDArray[np.float64]:
        """Covariance ``(n_function, 2 n_mode, 2 n_mode)`` of the residues' parts, poles' scatter included."""
        fixed = self.noise[:, None, None] ** 2 * self.linear_covariance
        return fixed + self.sensitivity @ self.pole_covariance @ self.sensitivity.swapaxes(1, 2)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Target:
    """What is fitted, whatever the poles that move."""

    frequency: NDArray[np.float64]
    quantity: Quantity
    value: NDArray[np.float64]  # (2 n_frequency, n_function)
    weight: NDArray[np.float64]  # (n_function, 2 n_frequency), or (1, 1) where all lines weigh the same
    fixed: NDArray[np.float64]  # columns of held poles and residual terms, (2 n_frequency, 2 n_held + 4)

    @classmethod
    def of(
        cls,
        frequency: NDArray[np.float64],
        value: NDArray[np.complex128],
        quantity: Quantity,
        weight: NDArray[np.float64] | None,
        held: NDArray[np.complex128] = _NONE,
    ) -> _Target:
        """Lay functions and weights out as columns and rows; see `refine`."""
        rows = np.ones((1, 1)) if weight is None or np.all(weight == 1.0) else np.tile(weight, 2)
        return cls(
            frequency=frequency,
            quantity=quantity,
            value=stack_functions(value),
            weight=rows,
            fixed=np.concatenate(
                [mode_basis(frequency, held, quantity), residual_basis(frequency, quantity)], axis=1
            ),
        )

    def modes(self, pole: NDArray[np.complex128], power: int = 1) -> NDArray[np.float64]:
        """Columns of modes or, with a power of 2, of their derivatives; see `mode_basis`."""
        return mode_basis(self.frequency, pole, self.quantity, power)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Projection:
    """Linear fit at fixed poles and what Gauss-Newton on the poles needs of it."""

    pole: NDArray[np.complex128]  # those that move, (n_mode,)
    coefficient: NDArray[np.float64]  # (2 n_mode + 4, n_function)
    orthogonal: NDArray[np.float64]  # orthonormal basis, (2 n_frequency, 2 n_mode + 4)
    triangle: NDArray[np.float64]  # R of the basis with its column lengths restored
    inverse: NDArray[
        np.float64
    ]  # of the weighted normal equations in the orthonormal basis, one or (n_function, ...)
    remainder: NDArray[np.float64]  # (2 n_frequency, n_function)
    variance: NDArray[np.float64]  # (n_function,), complex noise variance
    objective: float


def refine(
    frequency: NDArray[np.float64],
    value: NDArray[np.complex128],
    pole: NDArray[np.complex128],
    quantity: Quantity,
    weight: NDArray[np.float64] | None = None,
    *,
    held: NDArray[np.complex128] = _NONE,
) -> Fit:
    """Refine poles to the maximum of the likelihood and return the fit with its covariance.

    Parameters
    ----------
    frequency : (n_frequency,) float
        Lines above 0 Hz.
    value : (n_function, n_frequency) complex
        Functions of `quantity`, not all zero.
    pole : (n_mode,) complex
        Starting poles, rad/s, upper half-plane, stable.
    quantity : {"receptance", "mobility", "accelerance"}
        What the functions are.
    weight : (n_function, n_frequency) float, optional
        Inverse variances relative to one another in each function, of geometric mean 1, so that objectives of
        different weights can be compared. All lines weigh the same where not given.
    held : (n_held,) complex, optional
        Poles that stay where they are; in the fit they come last.
    """
    target = _Target.of(frequency, value, quantity, weight, held)
    state, damping = _project(target, pole.astype(complex)), 1e-3
    for _ in range(MAX_STEP):
        likelier = _likelier(target, state, damping)
        if likelier is None:
            break
        gain = state.objective - likelier[0].objective
        state, damping = likelier[0], max(likelier[1] / 10.0, 1e-12)
        if gain < TOLERANCE:
            break
    if held.size:
        return linear_fit(frequency, value, np.concatenate([state.pole, held]), quantity, weight)
    return _finish(target, state)


def linear_fit(
    frequency: NDArray[np.float64],
    value: NDArray[np.complex128],
    pole: NDArray[np.complex128],
    quantity: Quantity,
    weight: NDArray[np.float64] | None = None,
) -> Fit:
    """Fit residues and residual terms at fixed poles; the covariance is that of `refine` at these poles."""
    target = _Target.of(frequency, value, quantity, weight)
    return _finish(target, _project(target, pole))


def _likelier(target: _Target, state: _Projection, damping: float) -> tuple[_Projection, float] | None:
    """Return the fit after a step that does not raise the objective, and the damping it took; None where none does."""
    information, pull, _ = _normal_equations(target, state)
    gradient = pull.sum(axis=0)
    scale = np.sqrt(np.diag(information))
    # The variances move with the poles; without this term functions that disagree slow the steps down.
    curved = information - (2.0 / target.value.shape[0]) * pull.T @ pull
    scaled = (curved if _positive(curved) else information) / np.outer(scale, scale)
    while damping < 1e8:
        step = scipy.linalg.solve(
            scaled + damping * np.eye(scale.size), gradient / scale, assume_a="sym", check_finite=False
        )
        proposed = _project(target, _moved(state.pole, step / scale))
        if proposed.objective <= state.objective:
            return proposed, damping
        damping *= 10.0
    return None


def _moved(pole: NDArray[np.complex128], step: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Move poles by steps of Re and Im; they stay stable and in the upper half-plane."""
    trial = pole + step[0::2] + 1j * step[1::2]
    # A step across an axis goes nine tenths of the way to it, pole by pole, so that none stalls the rest.
    return np.minimum(trial.real, 0.1 * pole.real) + 1j * np.maximum(trial.imag, 0.1 * pole.imag)


def _project(target: _Target, pole: NDArray[np.complex128]) -> _Projection:
    """Fit what is linear at fixed poles."""
    basis = np.concatenate([target.modes(pole), target.fixed], axis=1)
    length = np.linalg.norm(basis, axis=0)
    orthogonal, triangle = _tall_qr(basis / length)
    value, weight = target.value, target.weight
    if weight.size == 1:
        inverse = np.eye(length.size)[None]
        part = orthogonal.T @ value
    else:
        normal = np.stack([(orthogonal.T * row) @ orthogonal for row in weight])
        inverse = np.linalg.inv(normal)
        part = np.einsum("okl,lo->ko", inverse, orthogonal.T @ (weight.T * value))
    remainder = value - orthogonal @ part
    coefficient = scipy.linalg.solve_triangular(triangle, part, check_finite=False) / length[:, None]
    n_row, n_function = value.shape
    # Each function spends its own linear unknowns and its share of the poles.
    freedom = max(n_row - basis.shape[1] - 2.0 * pole.size / n_function, 1.0)
    floor = (1e-14 * np.linalg.norm(value, axis=0)) ** 2 + np.finfo(float).tiny
    square = np.sum(weight.T * remainder**2, axis=0) + floor
    return _Projection(
        pole=pole,
        coefficient=coefficient,
        orthogonal=orthogonal,
        triangle=triangle * length,
        inverse=inverse,
        remainder=remainder,
        variance=2.0 * square / freedom,
        objective=float(0.5 * n_row * np.sum(np.log(square))),
    )


def _tall_qr(matrix: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """QR factors of a tall matrix by two rounds of Cholesky, several times faster than Householder's.

    Two rounds are orthogonal to rounding up to a condition of about 1e7 (Yamamoto, Nakatsukasa, Yanagisawa and
    Fukaya, ETNA 44, 2015); matrices that come near it are left to Householder.
    """
    try:
        first = np.linalg.cholesky(matrix.T @ matrix).T
    except np.linalg.LinAlgError:
        return np.linalg.qr(matrix)
    diagonal = np.diag(first)
    if diagonal.min() < 1e-5 * diagonal.max():
        return np.linalg.qr(matrix)
    rough = matrix @ scipy.linalg.solve_triangular(first, np.eye(len(first)), check_finite=False)
    second = np.linalg.cholesky(rough.T @ rough).T
    orthogonal = rough @ scipy.linalg.solve_triangular(second, np.eye(len(second)), check_finite=False)
    return orthogonal, second @ first


def _normal_equations(
    target: _Target, state: _Projection
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Fisher information of Re and Im of the poles, each function's pull on them, and coefficient maps."""
    derivative = target.modes(state.pole, power=2)
    tangent = derivative - state.orthogonal @ (state.orthogonal.T @ derivative)
    if target.weight.size == 1:
        gram = (tangent.T @ tangent)[None]
    else:
        # The tangents are orthogonal to the basis; what weighting makes of that is projected out here.
        cross = np.stack([(state.orthogonal.T * row) @ tangent for row in target.weight])
        gram = np.stack([(tangent.T * row) @ tangent for row in target.weight])
        gram -= cross.swapaxes(1, 2) @ state.inverse @ cross
    seen = tangent.T @ (target.weight.T * state.remainder)  # (2 n_mode, n_function)
    n_mode = state.pole.size
    real, imaginary = state.coefficient[0 : 2 * n_mode : 2], state.coefficient[1 : 2 * n_mode : 2]
    # Moving Re(pole) multiplies the derivative columns by A, moving Im(pole) by i A.
    maps = np.zeros((target.value.shape[1], 2 * n_mode, 2 * n_mode))
    r = np.arange(n_mode)
    maps[:, 2 * r, 2 * r] = real.T
    maps[:, 2 * r + 1, 2 * r] = imaginary.T
    maps[:, 2 * r, 2 * r + 1] = -imaginary.T
    maps[:, 2 * r + 1, 2 * r + 1] = real.T
    weight = 2.0 / state.variance
    information = np.einsum("o,oki,okj->ij", weight, maps, gram @ maps, optimize=True)
    pull = weight[:, None] * np.einsum("oki,ko->oi", maps, seen, optimize=True)
    return information, pull, maps


def _positive(matrix: NDArray[np.float64]) -> bool:
    try:
        scipy.linalg.cholesky(matrix, check_finite=False)
    except scipy.linalg.LinAlgError:
        return False
    return True


def _finish(target: _Target, state: _Projection) -> Fit:
    """Return the fit at the poles of a projection, with its covariance."""
    information, _, maps = _normal_equations(target, state)
    n_linear = 2 * state.pole.size
    triangle = scipy.linalg.solve_triangular(state.triangle, np.eye(len(state.triangle)), check_finite=False)
    triangle = triangle[:n_linear]
    derivative = target.modes(state.pole, power=2)
    onto = state.orthogonal.T @ derivative
    if target.weight.size > 1:
        onto = state.inverse @ np.stack([(state.orthogonal.T * row) @ derivative for row in target.weight])
    residue, lower, upper = split_coefficients(state.coefficient)
    n_frequency, remainder = target.frequency.size, state.remainder.T
    residual = remainder[:, :n_frequency] + 1j * remainder[:, n_frequency:]
    scale = np.sqrt(np.diag(information))
    normalised = scipy.linalg.pinvh(information / np.outer(scale, scale)) if scale.size else information
    return Fit(
        pole=state.pole,
        pole_covariance=normalised / np.outer(scale, scale),
        residue=residue,
        lower=lower,
        upper=upper,
        noise=np.sqrt(state.variance),
        weight=np.broadcast_to(target.weight[:, :n_frequency], residual.shape),
        residual=residual,
        linear_covariance=0.5 * triangle @ state.inverse @ triangle.T,
        sensitivity=-(triangle @ onto) @ maps,
        objective=state.objective,
    )
