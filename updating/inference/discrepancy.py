"""The discrepancy of a model: one size of a random symmetric perturbation, shared between states.

An honest model differs from the structure by random symmetric relative perturbations of its stiffness and of its mass
in modal coordinates (Soize 2000): e_r = (E_K + diag(omega_r / omega_s) E_M) a_r + noise, each with independent entries
of variance sigma**2 / 2 off the diagonal and twice as much on it. So cov(e_sr, e_s'r') = sigma**2 (delta_ss' a_r.a_r' +
a_s'r a_sr') (1 + omega_r omega_r' / (omega_s omega_s')) / 2: frequencies and shapes follow from one size, shapes mix by
some sigma omega_s omega_r / (lambda_r - lambda_s), and frequencies move by sigma / sqrt 2. With stiffness alone
two modes would have to take equal parts of one another to within the noise of shapes, which a missing mass does not do.
A share of E is common to states in the same part of the tree. The logarithm of damping is perturbed in the same way.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
import scipy.linalg as la
from numpy.typing import NDArray

from updating.inference.equation_error import Errors

Vector = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class SizePrior:
    """Log-normal prior of a size of the discrepancy, and the grid on which it is integrated.

    Attributes
    ----------
    median : float
        Of the size.
    spread : float
        Standard deviation of its logarithm.
    lowest, highest, n : float, float, int
        Ends and number of points of the grid.
    """

    median: float
    spread: float
    lowest: float
    highest: float
    n: int

    @property
    def grid(self) -> Vector:
        """Points, (n,), evenly spaced in the logarithm."""
        return np.geomspace(self.lowest, self.highest, self.n)

    def near(self, size: float, width: float, n: int) -> SizePrior:
        """Return the same prior on a grid of `n` points about a size, `width` of the logarithm to either side."""
        if self.n == 1:
            return self
        return replace(self, lowest=size * np.exp(-width), highest=size * np.exp(width), n=n)

    def quantile(self, share: float) -> float:
        """Return the size that is not exceeded with some probability."""
        return float(self.median * np.exp(self.spread * scipy.special.ndtri(share)))

    @classmethod
    def exactly(cls, size: float) -> SizePrior:
        """Return the prior of a size that is known."""
        return cls(median=size, spread=0.0, lowest=size, highest=size, n=1)

    def log_density_at(self, size: float) -> float:
        """Return the logarithm of the density of the logarithm of a size; 0 where the size is known."""
        if self.n == 1:
            return 0.0
        away = float(np.log(size / self.median)) / self.spread
        return -0.5 * away**2 - float(np.log(self.spread * np.sqrt(2.0 * np.pi)))

    @property
    def log_density(self) -> Vector:
        """Logarithm of the density of the logarithm of the size at these, times their spacing, (n,)."""
        if self.n == 1:  # a laboratory states it
            return np.zeros(1)
        away = np.log(self.grid / self.median) / self.spread
        step = np.log(self.highest / self.lowest) / (self.n - 1)
        return np.asarray(-0.5 * away**2 - np.log(self.spread * np.sqrt(2.0 * np.pi)) + np.log(step))


SPREAD = float(np.log(5.0) / 1.645)
"""Standard deviation of the logarithm of a size: nine of ten lie within a factor of 5 of the median."""
STIFFNESS = SizePrior(median=0.004, spread=SPREAD, lowest=3e-4, highest=0.1, n=16)
"""Of equation errors: models of laminated stacks and plates that lack nothing leave 0.1 to 1 % of an eigenvalue."""
DAMPING = SizePrior(median=0.1, spread=SPREAD, lowest=4e-3, highest=1.2, n=10)
"""Of the logarithm of a damping ratio: 2 to 50 %; the damping of reassembled stacks repeats to some 10 %."""
OF_MASS = 0.5
"""Share of the variance of equation errors that is the mass's: nobody knows either better."""


@dataclass(frozen=True, eq=False)
class Weighed:
    """Errors weighed by their covariance: all that a fit needs of them.

    Attributes
    ----------
    misfit : float
        Their square.
    slope, hessian : (n_coordinate,) and (n_coordinate, n_coordinate) float
        Half its gradient by the coordinates, and Gauss and Newton's half of its Hessian.
    log : float
        Half the logarithm of the determinant of the covariance.
    """

    misfit: float
    slope: Vector
    hessian: Vector
    log: float

    def __add__(self, other: Weighed) -> Weighed:
        """Return the sum of two, for errors that are independent."""
        return Weighed(
            self.misfit + other.misfit, self.slope + other.slope, self.hessian + other.hessian, self.log + other.log
        )

    @classmethod
    def nothing(cls, n: int) -> Weighed:
        """Return the same without any errors, for `n` coordinates."""
        return cls(0.0, np.zeros(n), np.zeros((n, n)), 0.0)

    @classmethod
    def of(cls, value: Vector, jacobian: Vector, covariance: Vector) -> Weighed:
        """Weigh errors (N,) with derivatives (N, n_coordinate) by a covariance (N, N)."""
        root = la.cholesky(covariance, lower=True, check_finite=False)
        white = la.solve_triangular(root, np.column_stack([value, jacobian]), lower=True, check_finite=False)
        product = white.T @ white
        return cls(float(product[0, 0]), product[1:, 0], product[1:, 1:], float(np.sum(np.log(np.diag(root)))))


@dataclass(frozen=True, eq=False, kw_only=True)
class Problem:
    """All errors of a campaign in one vector, with the parts of their covariance.

    Attributes
    ----------
    value : (N,) float
        Equation errors of all states; (N, n_coordinate) `jacobian` are their derivatives.
    noise, discrepancy : (N, N) float
        Covariance by noise, and by a discrepancy of size 1.
    damping, damping_jacobian, damping_noise, damping_discrepancy
        The same of the logarithms of damping ratios that are compared.
    log_map : float
        Logarithm of the density of what was measured over that of equation errors.
    curvature : (n_coordinate, n_coordinate) float
        Hessian of its part by what no mode reaches in the shapes, as in `Errors`.
    errors : tuple of Errors
        By state, what was joined.
    """

    value: Vector
    jacobian: Vector
    noise: Vector
    discrepancy: Vector
    damping: Vector
    damping_jacobian: Vector
    damping_noise: Vector
    damping_discrepancy: Vector
    log_map: float
    curvature: Vector
    errors: tuple[Errors, ...]

    def beside(self, sizes: Sizes) -> Vector:
        """Return the gradient of the cost less that at a fixed covariance, by measured mode, (n, n_coordinate).

        See `gradient`: the noise of shapes and the normalisation of the density depend on the model.
        """
        m = self.errors[0].value.shape[1]
        inverse = la.inv(self.noise + sizes.stiffness**2 * self.discrepancy, check_finite=False)
        pull = (inverse @ self.value).reshape(-1, m)
        mode = np.arange(len(pull))
        blocks = inverse.reshape(mode.size, m, mode.size, m)[mode, :, mode]
        first, by_state = 0, list[Vector]()
        for errors in self.errors:
            here = slice(first, first + len(errors.value))
            by_state.append(np.zeros((len(errors.value), self.jacobian.shape[1])))
            by_state[-1][:, : errors.jacobian.shape[2]] = errors.beside(pull[here], blocks[here])
            first = here.stop
        return np.vstack(by_state)

    def curvature_of(self, kept: NDArray[np.bool_]) -> Vector:
        """Return the part of the curvature of some measured modes; `kept` is (n,) bool."""
        total, first = np.zeros_like(self.curvature), 0
        for errors in self.errors:
            k = errors.jacobian.shape[2]
            total[:k, :k] += errors.curvature[kept[first : first + len(errors.value)]].sum(axis=0)
            first += len(errors.value)
        return total

    def weighed(self, sizes: Sizes) -> Weighed:
        """Return misfit and derivatives over noise and a discrepancy of given sizes."""
        value, jacobian, log = whitened(self, sizes)
        return Weighed(float(value @ value), jacobian.T @ value, jacobian.T @ jacobian, log)


def shared_levels(paths: Sequence[tuple[str, ...]], shares: Sequence[float]) -> Vector:
    """Return the share of the discrepancy that each two states have in common, (n_state, n_state).

    Parameters
    ----------
    paths : sequence of tuple of str
        Place of each state in the tree, from the outside in.
    shares : sequence of float
        Share of each level of the tree, from the outside in; they sum to 1.
    """
    common = np.zeros((len(paths), len(paths)))
    for i, path in enumerate(paths):
        for j, other in enumerate(paths):
            same = [a == b for a, b in zip(path, other, strict=True)]
            depth = same.index(False) if False in same else len(same)
            common[i, j] = sum(shares[:depth])
    return common


def rotation(into: Errors, of: Errors) -> Vector:
    """Return the rotation, (m, m), by which modal coordinates of one state are those of another, from their modes."""
    u, _, v = la.svd(into.shape.T @ of.shape)
    return np.asarray(u @ v)


def joined(errors: Sequence[Errors], common: Vector) -> Problem:
    """Join the errors of all states; `common` (n_state, n_state) holds the shares of the discrepancy in common.

    The discrepancy of one state acts in another by the cross products of their modes.
    """
    m = errors[0].value.shape[1]
    first = np.cumsum([0, *(e.value.shape[0] for e in errors)])
    n = int(first[-1])
    discrepancy, of_damping = np.zeros((n, m, n, m)), np.zeros((n, n))
    for c, errors_c in enumerate(errors):
        for d, errors_d in enumerate(errors[: c + 1]):
            turn = np.eye(m) if c == d else rotation(errors_c, errors_d)
            # Each in the coordinates of the other state.
            forth, back = errors_c.weight @ turn, errors_d.weight @ turn.T
            dot = forth @ errors_d.weight.T
            block = dot[:, None, :, None] * turn[None, :, None, :]
            block = block + back.T[None, :, :, None] * forth[:, None, None, :]
            of_mass = errors_c.inertia[:, :, None, None] * errors_d.inertia[None, None, :, :]
            block *= common[c, d] * (1.0 - OF_MASS + OF_MASS * of_mass)
            here, there = slice(first[c], first[c + 1]), slice(first[d], first[d + 1])
            discrepancy[here, :, there] = block
            discrepancy[there, :, here] = block.transpose(2, 3, 0, 1)
            of_damping[here, there] = common[c, d] * dot**2
            of_damping[there, here] = common[c, d] * dot.T**2
    ratio = np.concatenate([e.damping for e in errors])
    seen = np.isfinite(ratio)
    return Problem(
        value=np.concatenate([e.value.ravel() for e in errors]),
        jacobian=np.vstack([e.jacobian.reshape(-1, e.jacobian.shape[2]) for e in errors]),
        noise=la.block_diag(*(block for e in errors for block in e.noise)) + 1e-10 * np.eye(n * m),
        discrepancy=discrepancy.reshape(n * m, n * m),
        damping=ratio[seen],
        damping_jacobian=np.vstack([e.damping_jacobian for e in errors])[seen],
        damping_noise=np.diag(np.concatenate([e.damping_std for e in errors])[seen] ** 2),
        damping_discrepancy=(of_damping + 1e-6 * np.eye(n))[np.ix_(seen, seen)],
        log_map=sum(e.log_map for e in errors),
        curvature=np.sum([e.curvature.sum(axis=0) for e in errors], axis=0),
        errors=tuple(errors),
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class Spectrum:
    """Errors in coordinates in which noise is white and the discrepancy diagonal: all its sizes at once.

    Attributes
    ----------
    value : (N,) float
        Errors; `jacobian` (N, n_coordinate) are their derivatives.
    growth : (N,) float
        Variance by a discrepancy of size 1, beside 1 by noise.
    log_noise : float
        Logarithm of the determinant of the covariance by noise.
    """

    value: Vector
    jacobian: Vector
    growth: Vector
    log_noise: float

    def at(self, size: float) -> tuple[Vector, Vector, float]:
        """Return whitened errors and derivatives, and the logarithm of the determinant of the covariance."""
        variance = 1.0 + size**2 * self.growth
        root = 1.0 / np.sqrt(variance)
        return (self.value * root, self.jacobian * root[:, None], self.log_noise + float(np.sum(np.log(variance))))


def roots(problem: Problem, sizes: Sizes) -> tuple[Vector, Vector]:
    """Return Cholesky's lower factors of the covariances of equation errors and of damping at given sizes."""
    stiffness, damping = (
        la.cholesky(noise + size**2 * common, lower=True, check_finite=False)
        for noise, common, size in (
            (problem.noise, problem.discrepancy, sizes.stiffness),
            (problem.damping_noise, problem.damping_discrepancy, sizes.damping),
        )
    )
    return stiffness, damping


def whitened(
    problem: Problem, sizes: Sizes, factors: tuple[Vector, Vector] | None = None
) -> tuple[Vector, Vector, float]:
    """Return errors (N,) and derivatives (N, n_coordinate), whitened by noise and a discrepancy of given sizes.

    The third value is half the logarithm of the determinant of the covariance. `factors` are `roots`, where known.
    """
    factors = roots(problem, sizes) if factors is None else factors
    white = np.vstack(
        [
            la.solve_triangular(root, np.column_stack([value, jacobian]), lower=True, check_finite=False)
            for root, value, jacobian in (
                (factors[0], problem.value, problem.jacobian),
                (factors[1], problem.damping, problem.damping_jacobian),
            )
        ]
    )
    return white[:, 0], white[:, 1:], sum(float(np.sum(np.log(np.diag(root)))) for root in factors)


def spectrum(value: Vector, jacobian: Vector, noise: Vector, discrepancy: Vector) -> Spectrum:
    """Diagonalise the covariances by noise and by discrepancy together."""
    if not value.size:
        return Spectrum(value=value, jacobian=jacobian, growth=value, log_noise=0.0)
    root = la.cholesky(noise, lower=True)
    half = la.solve_triangular(root, discrepancy, lower=True)
    relative = la.solve_triangular(root, half.T, lower=True)
    growth, rotation = la.eigh((relative + relative.T) / 2.0, driver="evd")
    turned = rotation.T @ la.solve_triangular(root, np.column_stack([value, jacobian]), lower=True)
    return Spectrum(
        value=turned[:, 0],
        jacobian=turned[:, 1:],
        growth=np.maximum(growth, 0.0),
        log_noise=2.0 * float(np.sum(np.log(np.diag(root)))),
    )


@dataclass(frozen=True, kw_only=True)
class Sizes:
    """Sizes of the discrepancy: of equation errors, and of the logarithms of damping ratios."""

    stiffness: float
    damping: float


USUAL = Sizes(stiffness=STIFFNESS.median, damping=DAMPING.median)
"""Sizes from which fits start."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Evidence:
    """Marginal likelihood about a point: over coordinates by Laplace's method, over sizes on a grid.

    Attributes
    ----------
    log : float
        Its logarithm.
    sizes : Sizes
        The likeliest sizes.
    probability : (n_stiffness, n_damping) float
        Posterior probability of the sizes of the two grids.
    grids : (SizePrior, SizePrior), optional
        These, where they are not those of the priors.
    """

    log: float
    sizes: Sizes
    probability: Vector
    grids: tuple[SizePrior, SizePrior] | None = None

    def moments(self, priors: tuple[SizePrior, SizePrior]) -> tuple[Sizes, Sizes]:
        """Return the posterior medians of the sizes, and the standard deviations of their logarithms."""
        median_and_spread = []
        for prior, chance in zip(
            self.grids or priors, (self.probability.sum(axis=1), self.probability.sum(axis=0)), strict=True
        ):
            mean = float(np.log(prior.grid) @ chance)
            median_and_spread.append(
                (float(np.exp(mean)), float(np.sqrt(np.log(prior.grid) ** 2 @ chance - mean**2 + 1e-12)))
            )
        return (
            Sizes(stiffness=median_and_spread[0][0], damping=median_and_spread[1][0]),
            Sizes(stiffness=median_and_spread[0][1], damping=median_and_spread[1][1]),
        )


def evidence(
    stiffness: Spectrum,
    damping: Spectrum,
    problem: Problem,
    x: Vector,
    precision: Vector,
    log_prior: float,
    priors: tuple[SizePrior, SizePrior] = (STIFFNESS, DAMPING),
) -> Evidence:
    """Integrate over coordinates and sizes.

    Parameters
    ----------
    stiffness, damping : Spectrum
        Of equation errors and of damping, linear about `x`.
    problem : Problem
        What they are spectra of.
    x, precision : (n_coordinate,)
        Coordinates, and the precision of their normal priors about 0; 0 where nothing is known.
    log_prior : float
        Logarithm of what the priors of the coordinates are divided by.
    priors : (SizePrior, SizePrior)
        Of the two sizes.
    """
    parts = []
    for errors, prior in zip((stiffness, damping), priors, strict=True):
        variance = 1.0 + prior.grid[:, None] ** 2 * errors.growth  # (n_size, N)
        hessian = np.einsum("np,gn,nq->gpq", errors.jacobian, 1.0 / variance, errors.jacobian, optimize=True)
        misfit = np.sum(errors.value**2 / variance, axis=1) + np.sum(np.log(variance), axis=1) + errors.log_noise
        parts.append((hessian, misfit, prior.log_density))
    (h1, q1, p1), (h2, q2, p2) = parts
    total = h1[:, None] + h2[None] + np.diag(precision + 1e-12) + problem.curvature
    log = -0.5 * (q1[:, None] + q2[None] + np.sum(precision * x**2) + np.linalg.slogdet(total)[1])
    log = log + p1[:, None] + p2[None]
    top = float(log.max())
    weight = np.exp(log - top)
    i, j = np.unravel_index(int(np.argmax(log)), log.shape)
    return Evidence(
        log=top + float(np.log(weight.sum())) + problem.log_map + log_prior,
        sizes=Sizes(stiffness=float(priors[0].grid[i]), damping=float(priors[1].grid[j])),
        probability=weight / weight.sum(),
    )
