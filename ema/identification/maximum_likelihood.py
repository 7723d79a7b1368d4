"""Maximum-likelihood poles, residues and residual terms of all modes together, with their covariance.

With ``s = i omega`` and ``p = 0, 1, 2`` for receptance, mobility and accelerance, every function is

    H(s) = s**p ( sum_r [ A_r / (s - pole_r) + conj(A_r) / (s - conj(pole_r)) ] + lower / s**2 + upper ),

linear in the real and imaginary parts of ``A_r``, ``lower`` and ``upper`` (Ewins, Modal Testing, 2nd ed.,
sec. 4.4; Heylen, Lammens and Sas, Modal Analysis Theory and Testing, part A). The equations are written
in the quantity that was measured, so that its noise is not reshaped by integration (least squares in the
frequency domain, LSFD).

The noise is taken as circular complex normal, independent between lines and functions, of variance
``sigma_o**2 / weight_of`` with an unknown ``sigma_o`` per function and given weights. Residues and residual
terms are linear and are eliminated (variable projection, Golub and Pereyra, SIAM J. Numer. Anal. 10, 1973);
Gauss-Newton with Levenberg-Marquardt damping runs on the poles alone, with Kaufman's analytic Jacobian (BIT 15,
1975), whose gradient is exact. The variances follow from the residuals at every step, so that the end point is
that of the concentrated likelihood.

All functions share one basis, hence one QR factor: a step costs a factorisation of ``2 n_frequency`` rows and
some products, whatever the number of functions. Where lines weigh differently, each function has in addition its
own small normal equations in the orthonormal basis, which are as well conditioned as the weights are even.
Bases and functions are held with their lines along rows of memory, on which most of the time is spent.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg
from scipy.linalg import lapack

from ema.identification.mode_columns import mode_basis, mode_derivatives, residual_basis, split_coefficients
from ema.types.frf import Quantity
from lamella_shared import Complexes, Reals

NO_POLE = np.empty(0, dtype=complex)


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
        Measured less fitted functions; (n_function, 0) of a fit that does not hold them, see `left`.
    linear_covariance : (1 or n_function, 2 n_mode, 2 n_mode) float
        Covariance of Re and Im of the residues at fixed poles for unit ``noise``; one for all functions where
        they have the same weights.
    sensitivity : (n_function, 2 n_mode, 2 n_mode) float
        Derivative of Re and Im of the residues of each function with respect to Re and Im of the poles.
    objective : float
        Concentrated negative log-likelihood, up to a constant.
    """

    pole: Complexes
    pole_covariance: Reals
    residue: Complexes
    lower: Complexes
    upper: Complexes
    noise: Reals
    weight: Reals
    residual: Complexes
    linear_covariance: Reals
    sensitivity: Reals
    objective: float

    def whitened(self, lines: slice = slice(None)) -> Complexes:
        """Return residuals on some lines over their assumed standard deviations, ``(n_function, n_line)``."""
        return self.residual[:, lines] * np.sqrt(self.weight[:, lines]) / self.noise[:, None]

    def left(self, rows: slice, frequency: Reals, value: Complexes, quantity: Quantity) -> Complexes:
        """Return what the fit leaves of some of its functions, ``(n, n_frequency)``, made anew where it is not held.

        Parameters
        ----------
        rows : slice
            Which functions.
        frequency : (n_frequency,) float
            Lines of the fit, Hz.
        value : (n_function, n_frequency) complex
            What was fitted.
        quantity : {"receptance", "mobility", "accelerance"}
            What the functions are.
        """
        if self.residual.shape[1]:
            return self.residual[rows]
        linear = np.hstack([self.residue[rows], self.lower[rows, None], self.upper[rows, None]]).T
        coefficient = np.stack([linear.real, linear.imag], axis=1).reshape(-1, linear.shape[1])
        columns = mode_basis(frequency, self.pole, quantity), residual_basis(frequency, quantity)
        fitted = columns[0] @ coefficient[:-4] + columns[1] @ coefficient[-4:]
        left = np.array(value[rows])
        left.real -= fitted[: frequency.size].T
        left.imag -= fitted[frequency.size :].T
        return left

    def residue_covariance(self) -> Reals:
        """Covariance ``(n_function, 2 n_mode, 2 n_mode)`` of the residues' parts, poles' scatter included."""
        fixed = self.noise[:, None, None] ** 2 * self.linear_covariance
        return fixed + self.sensitivity @ self.pole_covariance @ self.sensitivity.swapaxes(1, 2)

    def covariance_of_each(self) -> Reals:
        """Covariance ``(n_function, n_mode, 2, 2)`` of both parts of each residue: blocks of `residue_covariance`."""
        n_function, n_row, n_pole = self.sensitivity.shape
        by_pole = (self.sensitivity.reshape(n_function * n_row, n_pole) @ self.pole_covariance).reshape(
            n_function, n_row, n_pole
        )
        blocks = np.empty((n_function, n_row // 2, 2, 2))
        for a, b in ((0, 0), (0, 1), (1, 0), (1, 1)):
            fixed = np.diagonal(self.linear_covariance[:, a::2, b::2], axis1=1, axis2=2)
            moving = np.einsum("orf,orf->or", by_pole[:, a::2], self.sensitivity[:, b::2])
            blocks[:, :, a, b] = self.noise[:, None] ** 2 * fixed + moving
        return blocks


@dataclass(frozen=True, eq=False, kw_only=True)
class _Target:
    """What is fitted, whatever the poles that move."""

    frequency: Reals
    quantity: Quantity
    value: Complexes  # (n_function, n_frequency)
    weight: Reals  # (n_function, n_frequency), or (1, 1) where all lines weigh the same
    fixed: Reals  # of held poles and residual terms, (2 n_held + 4, 2 n_frequency)

    @classmethod
    def of(
        cls, frequency: Reals, value: Complexes, quantity: Quantity, weight: Reals | None, held: Complexes = NO_POLE
    ) -> _Target:
        """Lay out what is fitted; see `refine`."""
        even = weight is None or all(np.all(row == 1.0) for row in weight)
        return cls(
            frequency=frequency,
            quantity=quantity,
            value=value,
            weight=np.ones((1, 1)) if weight is None or even else weight,
            fixed=np.concatenate([mode_basis(frequency, held, quantity).T, residual_basis(frequency, quantity).T]),
        )

    @property
    def even(self) -> bool:
        """Whether all lines weigh the same."""
        return self.weight.size == 1

    @cached_property
    def blocks(self) -> list[slice]:
        """Functions that are taken at once: all of them, unless they are large."""
        at_once = 1 << 19  # values of functions, 8 MB of them: more are taken in blocks
        few = max(1, at_once // self.frequency.size)
        return [slice(first, first + few) for first in range(0, len(self.value), few)]

    @cached_property
    def _whole(self) -> Reals:
        return self._laid_out(slice(None))

    def rows(self, block: slice) -> Reals:
        """Real beside imaginary parts of some functions, ``(n, 2 n_frequency)``."""
        return self._whole if len(self.blocks) == 1 else self._laid_out(block)

    def _laid_out(self, block: slice) -> Reals:
        return np.concatenate([self.value[block].real, self.value[block].imag], axis=1)

    def weights(self, block: slice) -> Reals:
        """Their weights, ``(n, 2 n_frequency)``."""
        return np.tile(self.weight[block], 2)

    def modes(self, pole: Complexes) -> Reals:
        """Modes, ``(2 n_mode, 2 n_frequency)``; see `mode_basis`."""
        return mode_basis(self.frequency, pole, self.quantity).T


@dataclass(frozen=True, eq=False, kw_only=True)
class _Basis:
    """An orthonormal basis, as what makes it of other rows: products with these are small beside making it."""

    rows: Reals  # (2 n_mode + 4, 2 n_frequency)
    turn: Reals  # of them into orthonormal ones, (2 n_mode + 4, 2 n_mode + 4), lower triangle
    onto: Reals  # the same for the modes and residual terms themselves


@dataclass(frozen=True, eq=False, kw_only=True)
class _Projection:
    """Linear fit at fixed poles and what Gauss-Newton on the poles needs of it."""

    pole: Complexes  # those that move, (n_mode,)
    coefficient: Reals  # (2 n_mode + 4, n_function)
    modes: Reals  # the rows of the basis that are of the modes, (2 n_mode, 2 n_frequency)
    basis: _Basis
    inverse: Reals  # of the weighted normal equations in it, one or (n_function, ...)
    part: Reals  # coefficients in the orthonormal basis, (2 n_mode + 4, n_function)
    remainder: Reals  # (n_function, 2 n_frequency); none where functions are taken in blocks
    variance: Reals  # (n_function,), complex noise variance
    objective: float


@dataclass(frozen=True, eq=False, kw_only=True)
class _Equations:
    """Normal equations of the poles at a projection."""

    information: Reals  # Fisher information of Re and Im of the poles, (2 n_mode, 2 n_mode)
    pull: Reals  # of each function on them, (n_function, 2 n_mode)
    residue: Complexes  # what moving poles multiplies their derivatives by, (n_function, n_mode)
    along: Reals  # derivatives in the basis, (1 or n_function, 2 n_mode + 4, 2 n_mode)


def refine(
    frequency: Reals,
    value: Complexes,
    pole: Complexes,
    quantity: Quantity,
    weight: Reals | None = None,
    *,
    held: Complexes = NO_POLE,
    tolerance: float = 1e-3,
    max_step: int = 60,
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
    tolerance : float
        Gain of log-likelihood below which steps end: by default that of a few % of the standard deviation
        of a pole.
    max_step : int
        Most steps.
    """
    target = _Target.of(frequency, value, quantity, weight, held)
    state, damping = _project(target, pole.astype(complex)), 1e-3
    for _ in range(max_step):
        likelier = _likelier(target, state, damping)
        if likelier is None:
            break
        gain = state.objective - likelier[0].objective
        # What had to be raised just now would have to be again.
        raised = likelier[1] > damping
        state, damping = likelier[0], likelier[1] if raised else max(likelier[1] / 10.0, 1e-12)
        if gain < tolerance:
            break
    if held.size:
        return linear_fit(frequency, value, np.concatenate([state.pole, held]), quantity, weight)
    return _finish(target, state)


def linear_fit(
    frequency: Reals,
    value: Complexes,
    pole: Complexes,
    quantity: Quantity,
    weight: Reals | None = None,
    *,
    with_residual: bool = True,
) -> Fit:
    """Fit residues and residual terms at fixed poles; the covariance is that of `refine` at these poles.

    Without its residual a fit of large functions takes little memory beside them.
    """
    target = _Target.of(frequency, value, quantity, weight)
    return _finish(target, _project(target, pole), with_residual=with_residual)


def _likelier(
    target: _Target, state: _Projection, damping: float, *, rounding: float = 1e-6
) -> tuple[_Projection, float] | None:
    """Return the fit after a step that does not raise the objective, and the damping it took; None where none does.

    `rounding`: gain of log-likelihood that a step promises.
    """
    equations = _normal_equations(target, state)
    information, pull = equations.information, equations.pull
    gradient = pull.sum(axis=0)
    scale = np.sqrt(np.diag(information))
    # The variances move with the poles; without this term functions that disagree slow the steps down.
    curved = information - (1.0 / target.frequency.size) * pull.T @ pull
    scaled = (curved if _positive(curved) else information) / np.outer(scale, scale)
    while damping < 1e8:
        step = np.linalg.solve(scaled + damping * np.eye(scale.size), gradient / scale)
        proposed = _project(target, _moved(state.pole, step / scale))
        if proposed.objective <= state.objective:
            return proposed, damping
        if 0.5 * gradient @ (step / scale) < rounding:
            return None  # it is the end point, and the rest is rounding
        damping *= 10.0
    return None


def _moved(pole: Complexes, step: Reals) -> Complexes:
    """Move poles by steps of Re and Im; they stay stable and in the upper half-plane."""
    trial = pole + step[0::2] + 1j * step[1::2]
    # A step across an axis goes nine tenths of the way to it, pole by pole, so that none stalls the rest.
    return np.minimum(trial.real, 0.1 * pole.real) + 1j * np.maximum(trial.imag, 0.1 * pole.imag)


def _project(target: _Target, pole: Complexes) -> _Projection:
    """Fit what is linear at fixed poles."""
    modes = target.modes(pole)
    basis = _orthonormal(np.concatenate([modes, target.fixed]))
    parts, inverses, squares, remainder = [], [], [], np.empty((0, 0))
    for block in target.blocks:
        value = target.rows(block)
        if target.even:
            inverse = np.eye(len(basis.rows))[None]
            part = basis.turn @ (basis.rows @ value.T)
        else:
            weight = target.weights(block)
            normal = np.stack([_gram(basis.rows * np.sqrt(row)) for row in weight])
            inverse = np.asarray(np.linalg.inv(basis.turn @ normal @ basis.turn.T))
            part = (inverse @ (basis.turn @ (basis.rows @ (weight * value).T)).T[..., None])[..., 0].T
        remainder = _remainder(basis, part, value)
        floor = (1e-14 * np.linalg.norm(value, axis=1)) ** 2 + np.finfo(float).tiny
        weighted = remainder if target.even else weight * remainder
        squares.append(np.einsum("on,on->o", weighted, remainder) + floor)
        parts.append(part)
        inverses.append(inverse)
    n_function, n_row = len(target.value), 2 * target.frequency.size
    # Each function spends its own linear unknowns and its share of the poles.
    freedom = max(n_row - len(basis.rows) - 2.0 * pole.size / n_function, 1.0)
    part, square = np.concatenate(parts, axis=1), np.concatenate(squares)
    return _Projection(
        pole=pole,
        coefficient=basis.onto.T @ part,
        modes=modes,
        basis=basis,
        inverse=inverses[0] if target.even else np.concatenate(inverses),
        part=part,
        remainder=remainder if len(target.blocks) == 1 else np.empty((0, 0)),
        variance=2.0 * square / freedom,
        objective=float(0.5 * n_row * np.sum(np.log(square))),
    )


def _remainder(basis: _Basis, part: Reals, value: Reals) -> Reals:
    """Return functions less their parts in a basis, (n, 2 n_frequency)."""
    left = (basis.turn.T @ part).T @ basis.rows
    return np.subtract(value, left, out=left)


def _left(target: _Target, state: _Projection, block: slice) -> Reals:
    """Return what a fit leaves of some functions, (n, 2 n_frequency)."""
    if state.remainder.size:
        return state.remainder[block]
    return _remainder(state.basis, state.part[:, block], target.rows(block))


def _orthonormal(basis: Reals, *, nearly: float = 10.0) -> _Basis:
    """Return what makes orthonormal rows of a basis of a few long rows, and the lower triangle that does.

    One round of Cholesky makes them orthogonal to rounding where the basis nearly is. That need not be done then: the
    small products are turned. Two do up to a condition of about 1e7 (Yamamoto, Nakatsukasa, Yanagisawa and
    Fukaya, ETNA 44, 2015); bases that come near it are left to Householder. Each is several times faster than the next.

    `nearly`: up to this mean square of what makes its rows orthonormal a basis is nearly orthogonal, and orthonormal to
    1e-14 after one round.
    """
    gram = _gram(basis)
    length = np.sqrt(np.diag(gram))
    try:
        first = np.linalg.cholesky(gram / np.outer(length, length))
    except np.linalg.LinAlgError:
        return _by_householder(basis, length)
    diagonal = np.diag(first)
    if diagonal.min() < 1e-5 * diagonal.max():
        return _by_householder(basis, length)
    onto = _inverse(first)
    # The square of its norm over their number bounds the square of the condition.
    near, onto = np.sum(onto**2) < nearly * len(basis), onto / length
    if near:
        return _Basis(rows=basis, turn=onto, onto=onto)
    orthogonal = onto @ basis
    second = _inverse(np.asarray(np.linalg.cholesky(_gram(orthogonal))))
    return _Basis(rows=second @ orthogonal, turn=np.eye(len(basis)), onto=second @ onto)


def _by_householder(basis: Reals, length: Reals) -> _Basis:
    orthogonal, triangle = np.linalg.qr((basis / length[:, None]).T)
    return _Basis(rows=np.ascontiguousarray(orthogonal.T), turn=np.eye(len(basis)), onto=_inverse(triangle.T) / length)


def _gram(rows: Reals) -> Reals:
    return np.asarray(rows @ rows.T)


def _inverse(lower: Reals) -> Reals:
    """Return the inverse of a lower triangle."""
    if not lower.size:
        return lower
    return np.tril(lapack.dtrtri(lower, lower=1)[0])


def _normal_equations(target: _Target, state: _Projection) -> _Equations:
    """Return what Gauss-Newton on the poles, and their covariance, need at a projection."""
    basis, derivative = state.basis, mode_derivatives(target.frequency, state.modes, target.quantity)
    along = basis.turn @ (basis.rows @ derivative.T)
    # Modes that are nearly alike leave little of the derivatives, which differences of products would lose.
    tangent = derivative - (basis.turn.T @ along).T @ basis.rows
    if target.even:
        gram, along = _gram(tangent)[None], along[None]
        seen = np.hstack([tangent @ _left(target, state, block).T for block in target.blocks])
    else:
        n_basis = len(basis.rows)
        both = np.concatenate([basis.rows, tangent])
        whole = np.stack([_gram(both * np.tile(np.sqrt(row), 2)) for row in target.weight])
        cross = basis.turn @ whole[:, :n_basis, n_basis:]
        more = state.inverse @ cross
        gram = whole[:, n_basis:, n_basis:] - cross.swapaxes(1, 2) @ more
        along = along + more
        seen = np.hstack(
            [tangent @ (target.weights(block) * _left(target, state, block)).T for block in target.blocks]
        )  # (2 n_mode, n_function)
    residue = split_coefficients(state.coefficient)[0][:, : state.pole.size]
    weight = 2.0 / state.variance
    pull = weight[:, None] * _turned(seen.T[:, None, :], residue)[:, 0]
    if target.even:
        information = _turned_alike(gram[0], residue, weight)
    else:
        information = _turned_sum(weight[:, None, None] * _turned(gram, residue), residue)
    return _Equations(information=information, pull=pull, residue=residue, along=along)


def _turned(matrix: Reals, residue: Complexes) -> Reals:
    """Return matrices (1 or n_function, n, 2 n_mode) with each pair of columns turned by a residue, of each function.

    Moving Re(pole) multiplies the derivative columns by A, moving Im(pole) by i A.
    """
    real, imaginary = residue.real[:, None], residue.imag[:, None]
    first, second = matrix[..., 0::2], matrix[..., 1::2]
    turned = np.empty((len(residue), *matrix.shape[1:]))
    turned[..., 0::2] = first * real + second * imaginary
    turned[..., 1::2] = second * real - first * imaginary
    return turned


def _turned_sum(matrix: Reals, residue: Complexes) -> Reals:
    """Return the sum over functions of matrices, (n_function, 2 n_mode, n), with pairs of rows turned likewise."""
    total = np.empty(matrix.shape[1:])
    first, second = matrix[:, 0::2], matrix[:, 1::2]

    def times(part: Reals, rows: Reals) -> Reals:
        return np.asarray(np.einsum("or,orf->rf", part, rows))

    total[0::2] = times(residue.real, first) + times(residue.imag, second)
    total[1::2] = times(residue.real, second) - times(residue.imag, first)
    return total


def _turned_alike(gram: Reals, residue: Complexes, weight: Reals) -> Reals:
    """Return the weighted sum over functions of a symmetric matrix, the same of all, turned from both sides."""
    real, imaginary = residue.real, residue.imag
    rr, ri, ii = (x.T @ (weight[:, None] * y) for x, y in ((real, real), (real, imaginary), (imaginary, imaginary)))
    first, cross, second = gram[0::2, 0::2], gram[0::2, 1::2], gram[1::2, 1::2]
    total = np.empty_like(gram)
    total[0::2, 0::2] = rr * first + ri * cross + ri.T * cross.T + ii * second
    total[0::2, 1::2] = rr * cross - ri * first + ri.T * second - ii * cross.T
    total[1::2, 1::2] = rr * second - ri * cross.T - ri.T * cross + ii * first
    total[1::2, 0::2] = total[0::2, 1::2].T
    return total


def _positive(matrix: Reals) -> bool:
    return not matrix.size or lapack.dpotrf(matrix, lower=1)[1] == 0


def _finish(target: _Target, state: _Projection, *, with_residual: bool = True) -> Fit:
    """Return the fit at the poles of a projection, with its covariance."""
    equations = _normal_equations(target, state)
    information = equations.information
    triangle = state.basis.onto.T[: 2 * state.pole.size]
    residue, lower, upper = split_coefficients(state.coefficient)
    n_frequency = target.frequency.size
    residual = np.empty((len(target.value), n_frequency if with_residual else 0), complex)
    for block in target.blocks if with_residual else ():
        left = _left(target, state, block)
        residual[block].real, residual[block].imag = left[:, :n_frequency], left[:, n_frequency:]
    scale = np.sqrt(np.diag(information))
    normalised = scipy.linalg.pinvh(information / np.outer(scale, scale)) if scale.size else information
    return Fit(
        pole=state.pole,
        pole_covariance=normalised / np.outer(scale, scale),
        residue=residue,
        lower=lower,
        upper=upper,
        noise=np.sqrt(state.variance),
        weight=np.broadcast_to(target.weight, target.value.shape),
        residual=residual,
        linear_covariance=0.5 * triangle @ state.inverse @ triangle.T,
        sensitivity=_turned(-(triangle @ equations.along), equations.residue),
        objective=state.objective,
    )
