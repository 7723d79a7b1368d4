"""Several modes of nearly one pole from functions of several forces: poles, shapes and participations.

The residues of one mode are the outer product of its shape and its participation in the forces, a matrix of rank one
(Ewins, Modal Testing, 2nd ed., sec. 2.8; polyreference LSFD, Heylen, Lammens and Sas, Modal Analysis Theory and
Testing, part A). Modes of one frequency, as symmetric structures have them, leave a matrix ``U V^T`` of higher rank,
whatever their shapes. With ``delta_k`` the distances of their poles from the common one,

    sum_k A_k / (s - pole - delta_k) = U V^T / (s - pole) + U M V^T / (s - pole)**2 + ...,

the eigenvalues of ``M`` are the distances, and its eigenvectors mix ``U`` and ``V`` to shapes and participations
(perturbation of a multiple eigenvalue; Lancaster, Numer. Math. 6, 1964). ``M`` is seen in all functions at once, so a
split far below the bandwidth shows. Reciprocity makes shapes and participations the same at driving points: then ``M``
is symmetric and its eigenvectors are a rotation, so that shapes stay independent whatever noise does to it. Without
driving points the shapes are taken as orthogonal over the measured points. From there poles and rotation minimise the
misfit of the modes themselves, not of their series; shapes and a smooth part are eliminated (variable projection).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
import scipy.linalg
from numpy.typing import NDArray

from ema.identification.significance import MIN_COLLINEARITY, MIN_REALNESS, inflation
from ema.types.frf import DERIVATIVE, Quantity

FALSE_ALARM = 1e-4
"""Chance that noise alone makes the residues of one pole those of two modes."""
LEAST_PART = 0.02
"""Part of a second mode in the residues, relative to the first, below which it may be an error of the measurement."""
LEAST_DEFINITE = 1e-3
"""Least over largest eigenvalue of what driving points say of the scale of shapes, for it to be used."""
LEAST_LIKELIER = 2.0
"""Log-likelihood by which a second mode is to explain a second part of the residues better than errors of gains."""
LARGEST_ERROR = 0.1
"""Errors of gains of single functions, relative, that are thought possible."""
UNKNOWN_ANGLE = np.pi / 4.0
"""Standard deviation, rad, of a rotation that nothing tells: any shape of the subspace is as good."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Around:
    """Functions around a pole, less what other modes add to them, over their noise.

    Attributes
    ----------
    frequency : (n_line,) float
        Lines, Hz.
    quantity : {"receptance", "mobility", "accelerance"}
    value : (n_output, n_input, n_line) complex
        The functions over the noise.
    output_noise, input_noise : (n_output,) and (n_input,) float
        Their product is the standard deviation of the complex noise.
    """

    frequency: NDArray[np.float64]
    quantity: Quantity
    value: NDArray[np.complex128]
    output_noise: NDArray[np.float64]
    input_noise: NDArray[np.float64]

    def line(self, pole: NDArray[np.complex128], power: int = 1) -> NDArray[np.complex128]:
        """Return what modal constants ``2 i omega_d A`` of 1 at poles give, (n_pole, n_line), its smooth part out."""
        s = 2j * np.pi * self.frequency
        own = s ** DERIVATIVE[self.quantity] / (2j * pole.imag[:, None] * (s - pole[:, None]) ** power)
        return self.rough(own)

    def rough(self, value: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """Return functions without their straight part over the lines."""
        straight = np.stack([np.ones(self.frequency.size), self.frequency - self.frequency.mean()])
        straight /= np.linalg.norm(straight, axis=1, keepdims=True)
        return np.asarray(value - (value @ straight.T) @ straight)


@dataclass(frozen=True, eq=False, kw_only=True)
class RankOneModes:
    """Modes of rank one, ascending in frequency.

    Attributes
    ----------
    pole : (n_mode,) complex
        rad/s.
    pole_std : (n_mode,) float
        Standard deviation of Re and of Im of each, rad/s.
    residue : (n_output, n_input, n_mode) complex
        Residues of the receptance, m/(N s).
    residue_std : (n_output, n_input) float
        Standard deviation of them at fixed poles and rotation.
    angle_std : float
        Standard deviation, rad, of the rotation of the shapes in their subspace.
    left : float
        Power of what the modes leave of the functions over their noise.
    """

    pole: NDArray[np.complex128]
    pole_std: NDArray[np.float64]
    residue: NDArray[np.complex128]
    residue_std: NDArray[np.float64]
    angle_std: float
    left: float


@dataclass(frozen=True, eq=False, kw_only=True)
class _Factors:
    """Real parts of the modal constants of a pole over their noise, ``left @ right.T``, columns alike in length."""

    left: NDArray[np.float64]  # (n_output, n_mode)
    right: NDArray[np.float64]  # (n_input, n_mode)


def rank_one_modes(
    around: Around, pole: complex, pairs: list[tuple[int, int, float]], most: int
) -> RankOneModes:
    """Find the modes that share a pole, one at least.

    Parameters
    ----------
    around : Around
        Functions that hold these modes and no other.
    pole : complex
        The common pole, rad/s.
    pairs : list of (int, int, float)
        Driving points: output, input, and the product of their signs.
    most : int
        How many modes there may be.
    """
    factors = _factors(around, pole, most)
    mixing = _common_basis(factors, around, pairs)
    matrix = np.linalg.solve(mixing, _distances(around, pole, factors) @ mixing)
    # Where shapes and participations are the same, so are the matrix and its transpose.
    symmetric = 0.5 * (matrix + matrix.T)
    rotation = np.linalg.eigh(symmetric.imag)[1]
    participation = factors.right @ np.linalg.inv(mixing @ rotation).T
    start = pole + np.diag(rotation.T @ symmetric @ rotation)
    return _refined(around, factors, start, participation)


def _factors(around: Around, pole: complex, most: int) -> _Factors:
    """Factor modal constants into as many modes as stand out of the noise, one at least and some at most."""
    line = around.line(np.array([pole]))[0]
    constant: NDArray[np.complex128] = around.value @ line.conj() / np.linalg.norm(line) ** 2
    rest = around.rough(around.value) - constant[..., None] * line
    grown = inflation(rest.reshape(-1, line.size))
    variance = 0.5 * grown / float(np.linalg.norm(line)) ** 2  # of either part
    left, gain, right = np.linalg.svd(constant, full_matrices=False)
    n_output, n_input = constant.shape
    n = 1
    while n < min(gain.size, most):
        freedom = 2 * (n_output - n) * (n_input - n)
        beyond = float(np.sum(gain[n:] ** 2)) > variance * scipy.special.chdtri(freedom, FALSE_ALARM)
        own = gain[n] * np.outer(left[:, n], right[n])
        if not beyond or gain[n] < LEAST_PART * gain[0] or not _real(own, variance):
            break
        strong, weak = (np.abs(around.output_noise * left[:, k] * gain[k]) for k in (0, n))
        if not _is_additive(strong, weak, np.sqrt(variance) * around.output_noise):
            break
        n += 1
    by_output, size, by_input = np.linalg.svd(constant.real, full_matrices=False)
    root = np.sqrt(size[:n])
    return _Factors(left=by_output[:, :n] * root, right=by_input[:n].T * root)


def _real(constant: NDArray[np.complex128], variance: float) -> bool:
    """Whether modal constants of rank one, each part of them with a variance, lie on the real axis as a mode's do."""
    noise = variance * (sum(constant.shape) - 1)
    real, imaginary = (float(np.sum(part**2)) - noise for part in (constant.real, constant.imag))
    total = real + imaginary
    distance = np.hypot(real - imaginary, 2.0 * float(np.sum(constant.real * constant.imag)))
    return total > 0.0 and distance**2 >= MIN_COLLINEARITY * total**2 and real >= MIN_REALNESS * total


def _is_additive(strong: NDArray[np.float64], weak: NDArray[np.float64], noise: NDArray[np.float64]) -> bool:
    """Whether a weak part of the modal constants is one of a mode, and not an error of gains or of places hit.

    Such errors grow with the response of the strong part and are nothing where that is at rest; a mode shows there.
    Returned is which of both variances over the outputs, ``(n_output,)``, is likelier.
    """

    def log_likelihood(std: NDArray[np.float64]) -> float:
        variance = std**2 + noise**2
        return float(np.max(-0.5 * np.sum(np.log(variance) + weak**2 / variance, axis=1)))

    size = np.geomspace(0.1, 10.0, 41)[:, None] * np.sqrt(np.mean(weak**2))
    error = np.geomspace(1e-3, LARGEST_ERROR, 41)[:, None]
    additive = log_likelihood(size * np.ones(weak.size))
    return additive > log_likelihood(error * strong) + LEAST_LIKELIER


def _common_basis(
    factors: _Factors, around: Around, pairs: list[tuple[int, int, float]]
) -> NDArray[np.float64]:
    """Mixing X of the columns that makes shapes ``left X`` and participations ``right X**-T`` the same.

    At driving points that is ``left S = right`` with the symmetric ``S = X X^T``. Where they do not tell it, X makes
    the shapes orthogonal.
    """
    left, right = around.output_noise[:, None] * factors.left, around.input_noise[:, None] * factors.right
    n = left.shape[1]
    row, column = np.triu_indices(n)
    if len(pairs) * n >= row.size:
        unit = np.zeros((row.size, n, n))
        unit[np.arange(row.size), row, column] = unit[np.arange(row.size), column, row] = 1.0
        o, i, sign = (np.array(part) for part in zip(*pairs, strict=True))
        equations = (left[o] @ unit).reshape(row.size, -1).T
        known = (sign[:, None] * right[i]).reshape(-1)
        square = np.tensordot(np.linalg.lstsq(equations, known, rcond=None)[0], unit, axes=1)
        value = np.linalg.eigvalsh(square)
        if value[0] > LEAST_DEFINITE * value[-1]:
            return np.linalg.cholesky(square)
    return np.asarray(np.linalg.inv(np.linalg.cholesky(left.T @ left)).T)


def _distances(around: Around, pole: complex, factors: _Factors) -> NDArray[np.complex128]:
    """Return M of the module's equation, rad/s: the functions seen along the factors have it in a double pole."""
    square = np.sum(factors.left**2, axis=0)  # as of `right`
    seen = (
        np.einsum("ok,oif,il->klf", factors.left, around.value, factors.right)
        / np.outer(square, square)[..., None]
    )
    basis = np.concatenate([around.line(np.array([pole]), power) for power in (2, 1)])
    n = square.size
    solution = np.linalg.lstsq(basis.T, around.rough(seen).reshape(n * n, -1).T, rcond=None)[0]
    return np.asarray(solution[0].reshape(n, n))


def _rotation(angle: NDArray[np.float64], n: int) -> NDArray[np.float64]:
    """Return the rotation by small angles in each pair of `n` axes."""
    skew = np.zeros((n, n))
    skew[np.triu_indices(n, 1)] = angle
    return np.asarray(scipy.linalg.expm(skew - skew.T))


def _refined(
    around: Around,
    factors: _Factors,
    start: NDArray[np.complex128],
    participation: NDArray[np.float64],
) -> RankOneModes:
    """Minimise the misfit over poles and a rotation of the participations, from a start."""
    from scipy.optimize import (
        least_squares,
    )  # here: it takes long to import, and few structures are symmetric

    n, width = start.size, float(np.mean(-start.real))
    side = factors.left / np.linalg.norm(factors.left, axis=0)
    seen = around.rough(np.einsum("ok,oif->kif", side, around.value)).reshape(n, -1)

    def unpacked(x: NDArray[np.float64]) -> tuple[NDArray[np.complex128], NDArray[np.float64]]:
        pole = start + width * (x[:n] + 1j * x[n : 2 * n])
        return pole, participation @ _rotation(x[2 * n :], n)

    def basis(x: NDArray[np.float64]) -> NDArray[np.complex128]:
        pole, own = unpacked(x)
        return np.asarray((own.T[:, :, None] * around.line(pole)[:, None, :]).reshape(n, -1))

    def misfit(x: NDArray[np.float64]) -> NDArray[np.float64]:
        orthogonal = np.linalg.qr(basis(x).T)[0]
        rest = seen - (seen @ orthogonal.conj()) @ orthogonal.T
        return np.concatenate([rest.real.ravel(), rest.imag.ravel()])

    found = least_squares(misfit, np.zeros(2 * n + n * (n - 1) // 2), method="lm")
    pole, own = unpacked(found.x)
    x = found.x
    if np.any(pole.real >= 0.0) or np.any(np.abs(pole - start) > width):
        pole, own, x = start, participation, np.zeros(found.x.size)
    shape = np.linalg.lstsq(
        basis(x).T, around.rough(around.value).reshape(len(factors.left), -1).T, rcond=None
    )[0].T
    rest = around.rough(around.value) - np.einsum("ok,ik,kf->oif", shape, own, around.line(pole))
    grown = inflation(rest.reshape(-1, rest.shape[-1]))
    information = found.jac.T @ found.jac / (0.5 * grown)
    # What nothing tells has an infinite variance, a rotation of modes of exactly one pole first of all.
    value, vector = np.linalg.eigh(information)
    std = np.sqrt((vector**2) @ (1.0 / np.maximum(value, 1.0)))
    rank = np.argsort(np.abs(pole))
    line = np.linalg.norm(around.line(np.array([pole.mean()])))
    noise = np.outer(around.output_noise, around.input_noise)
    residue = np.einsum("ok,ik->oik", shape, own)[..., rank] * noise[..., None] / (2j * pole.imag[rank])
    return RankOneModes(
        pole=pole[rank],
        pole_std=width * np.maximum(std[:n], std[n : 2 * n])[rank],
        residue=residue,
        residue_std=noise * np.sqrt(0.5 * grown) / (line * 2.0 * np.mean(pole.imag)),
        angle_std=float(min(std[2 * n :].max(initial=0.0), UNKNOWN_ANGLE)),
        left=float(np.sum(np.abs(rest) ** 2)) / grown,
    )
