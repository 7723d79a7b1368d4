"""Marginal likelihood of an explanation: over its parameters by Laplace, over the sizes of the discrepancy by sum.

Many data tell a size to some per cent and few to a factor of two, so the sum is over points that are placed by the
posterior itself: on a grid that is the same for all, the evidence would depend on where a size falls between points.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from updating.diagnosis.discrepancy import KINDS, MEDIAN, RANGE, Kind, Sizes, log_density, log_together

Vector = NDArray[np.float64]

_COUNTS = 0.1  # of the largest weight, from which sizes count for the covariance
_N_LOOKED, _N_TRIED = 11, 7  # sizes of a kind at which its posterior is looked for, and over which the sum is
_ZOOMED = 1.25  # steps of a look to either side of the best size, which the next look is at
_AGAIN = 4.0  # standard deviations to either side of where a posterior was, at which it is looked for again
_CUT, _WIDENED = (
    0.01,
    2.0,
)  # density over the largest that a look cuts off, and how much wider the next one then is
_RESOLVED = 0.6  # standard deviations over steps, from which a look is fine enough
_MOST_LOOKS, _MOST_ROUNDS = 8, 4
_NO_GROWTH = 1e-12  # of a variance, which the largest size adds to it
_SETTLED = 0.3  # standard deviations that a size may still move from round to round


@dataclass(frozen=True, eq=False, kw_only=True)
class Linearized:
    """Data about a fit, to first order: rotated so that noise is white and discrepancies are uncorrelated.

    Attributes
    ----------
    value : (n,) float
        Measured less modelled.
    jacobian : (n, n_coordinate) float
        Its derivatives by the coordinates.
    kind : (n,) str
        Of each row, one of `KINDS`.
    growth : (n,) float
        Variance by a discrepancy of unit size, over that of the noise.
    prior_value, prior_precision : (n_coordinate,) float
        Where the prior of each coordinate is centred, from the fit on, and its inverse variance.
    trust : (n_coordinate,) float
        Inverse variance of the steps from the fit for which first order does.
    unseen : (n_coordinate,) float
        Precision of the volume that each coordinate has beforehand, which counts in determinants alone.
    free : (n_coordinate,) bool
        Coordinates that are not at the end of their range.
    """

    value: Vector
    jacobian: Vector
    kind: NDArray[np.str_]
    growth: Vector
    prior_value: Vector
    prior_precision: Vector
    trust: Vector
    unseen: Vector
    free: NDArray[np.bool_]


@dataclass(frozen=True, eq=False, kw_only=True)
class Marginal:
    """What is left when parameters and sizes are integrated out.

    Attributes
    ----------
    log_evidence : float
        Logarithm of the marginal likelihood, up to a constant of the data.
    likeliest : Sizes
        Sizes of the largest posterior probability.
    mean : Sizes
        Means of the logarithms of the sizes, as sizes.
    spread : Sizes
        Standard deviations of these logarithms.
    """

    log_evidence: float
    likeliest: Sizes
    mean: Sizes
    spread: Sizes
    _own: Linearized
    _weight: Vector
    _tried: _Tried

    @cached_property
    def covariance(self) -> Vector:
        """Covariance of the coordinates, (n, n), sizes and linear parameters integrated out."""
        counts = self._weight > _COUNTS * self._weight.max()
        weight, step = self._weight[counts] / self._weight[counts].sum(), self._tried.step[counts]
        inverse = np.linalg.pinv(self._tried.precision[counts], hermitian=True)
        middle = weight @ step
        covariance = np.einsum("i,ijk->jk", weight, inverse)
        return np.asarray(covariance + np.einsum("i,ij,ik->jk", weight, step - middle, step - middle))

    @cached_property
    def noise_variance(self) -> Vector:
        """Variances of the coordinates, (n,), were there no discrepancy."""
        exact = {kind: _Rows.of(self._own, kind).at(np.zeros(1)) for kind in KINDS}
        return np.diag(np.linalg.pinv(_tried(self._own, exact).precision[0], hermitian=True))


def marginal(
    own: Linearized,
    stated: Sizes | None = None,
    stated_kinds: tuple[Kind, ...] = (),
    near: tuple[Sizes, Sizes] | None = None,
) -> Marginal:
    """Integrate an explanation over its coordinates and over the sizes of the discrepancy.

    Parameters
    ----------
    own : Linearized
        The explanation about its fit.
    stated : Sizes, optional
        What a laboratory states.
    stated_kinds : tuple of str
        The kinds for which it does.
    near : (Sizes, Sizes), optional
        `mean` and `spread` of an explanation that differs little: where sizes are looked for first.
    """
    known = {kind: float(getattr(stated, kind)) for kind in stated_kinds} if stated is not None else {}
    rows = {kind: _Rows.of(own, kind) for kind in KINDS}
    size, log_step = _placed(own, rows, known, near)
    found = _tried(own, {kind: rows[kind].at(size[kind]) for kind in KINDS})
    log_posterior = found.log_likelihood + _log_prior(found.size, known) + log_step
    top = float(np.max(log_posterior))
    weight = np.exp(log_posterior - top)
    total = float(weight.sum())
    weight /= total
    logs = np.log(found.size)
    mean = weight @ logs
    spread = np.sqrt(weight @ (logs - mean) ** 2)
    return Marginal(
        log_evidence=top + float(np.log(total) + _log_volume(own)),
        likeliest=_sizes(found.size[int(np.argmax(weight))]),
        mean=_sizes(np.exp(mean)),
        spread=_sizes(spread),
        _own=own,
        _weight=weight,
        _tried=found,
    )


@dataclass(frozen=True, eq=False)
class _Equations:
    """Sizes of one kind with the normal equations of its data at each: Gram matrices, slopes, and misfits.

    The misfits hold the logarithms of the determinants of the variances.
    """

    size: Vector
    gram: Vector
    slope: Vector
    misfit: Vector


@dataclass(frozen=True, eq=False)
class _Rows:
    """The data of one kind: those that no discrepancy of it reaches, summed once for all sizes, and the others."""

    gram: Vector
    slope: Vector
    misfit: float
    value: Vector
    jacobian: Vector
    growth: Vector

    @classmethod
    def of(cls, own: Linearized, kind: Kind) -> _Rows:
        """Sort the rows of a kind."""
        largest = (MEDIAN[kind] * max(RANGE)) ** 2
        grows = (own.kind == kind) & (largest * own.growth > _NO_GROWTH)
        still = (own.kind == kind) & ~grows
        value, jacobian = own.value[still], own.jacobian[still]
        return cls(
            gram=jacobian.T @ jacobian,
            slope=jacobian.T @ value,
            misfit=float(value @ value),
            value=own.value[grows],
            jacobian=own.jacobian[grows],
            growth=own.growth[grows],
        )

    def at(self, size: Vector) -> _Equations:
        """Return the normal equations at some sizes."""
        variance = 1.0 + size[:, None] ** 2 * self.growth
        weighted = (self.jacobian / variance[..., None]).swapaxes(1, 2)
        misfit = np.sum(self.value**2 / variance + np.log(variance), axis=1)
        return _Equations(
            size=size,
            gram=self.gram + weighted @ self.jacobian,
            slope=self.slope + weighted @ self.value,
            misfit=self.misfit + misfit,
        )


@dataclass(frozen=True, eq=False)
class _Tried:
    """Sizes of all kinds, (n, n_kind), with what a fit says at each; `step` is from where it stands."""

    size: Vector
    log_likelihood: Vector
    step: Vector
    precision: Vector


def _tried(own: Linearized, equations: Mapping[Kind, _Equations]) -> _Tried:
    """Integrate over the coordinates at every combination of some sizes of each kind."""
    parts = [equations[kind] for kind in KINDS]
    index = np.stack(
        np.meshgrid(*(np.arange(part.size.size) for part in parts), indexing="ij"), axis=-1
    ).reshape(-1, len(KINDS))
    gram, slope, constant = (
        sum(getattr(part, name)[i] for part, i in zip(parts, index.T, strict=True))
        for name in ("gram", "slope", "misfit")
    )
    precision = np.asarray(gram) + np.diag(own.prior_precision)
    slope = np.asarray(slope) - own.prior_precision * own.prior_value
    constant = np.asarray(constant) + float(np.sum(own.prior_precision * own.prior_value**2))
    free = own.free
    step = np.zeros(slope.shape)
    held = precision + np.diag(own.trust)
    step[:, free] = -np.linalg.solve(held[:, free][:, :, free], slope[:, free, None])[..., 0]
    misfit = constant + np.einsum("ij,ij->i", 2.0 * slope + np.einsum("ijk,ik->ij", precision, step), step)
    logdet = np.linalg.slogdet(precision + np.diag(own.unseen))[1]
    return _Tried(
        size=np.column_stack([part.size[i] for part, i in zip(parts, index.T, strict=True)]),
        log_likelihood=-0.5 * (misfit + logdet),
        step=step,
        precision=precision,
    )


def _placed(
    own: Linearized,
    rows: Mapping[Kind, _Rows],
    known: Mapping[Kind, float],
    near: tuple[Sizes, Sizes] | None,
) -> tuple[dict[Kind, Vector], float]:
    """Return the sizes of each kind that the sum is over, and the logarithm of the volume between them.

    They lie about the posterior of each size, the others being where theirs are.
    """
    center = {kind: MEDIAN[kind] if near is None else getattr(near[0], kind) for kind in KINDS} | dict(known)
    spread = {kind: np.inf if near is None else getattr(near[1], kind) for kind in KINDS}
    free = [kind for kind in KINDS if kind not in known]
    for _ in range(_MOST_ROUNDS):
        moved = 0.0
        for kind in free:
            before = center[kind]
            center[kind], spread[kind] = _looked(own, rows, kind, center, known, spread[kind])
            moved = max(moved, abs(np.log(center[kind] / before)) / spread[kind])
        if moved < _SETTLED:
            break
    steps = np.arange(_N_TRIED) - (_N_TRIED - 1) / 2.0
    size = {
        kind: center[kind] * (np.exp(spread[kind] * steps) if kind in free else np.ones(1)) for kind in KINDS
    }
    return size, float(sum(np.log(spread[kind]) for kind in free))


def _looked(
    own: Linearized,
    rows: Mapping[Kind, _Rows],
    kind: Kind,
    center: Mapping[Kind, float],
    known: Mapping[Kind, float],
    spread: float,
) -> tuple[float, float]:
    """Return where the posterior of a kind's size is, and the standard deviation of its logarithm.

    It is looked for about where it was, with the standard deviation that it had there, or else in all its range.
    """
    low, high = np.log(MEDIAN[kind] * np.array(RANGE))
    whole = 0.5 * (high - low)
    middle, half = 0.5 * (low + high), whole
    if np.isfinite(spread):
        middle, half = float(np.log(center[kind])), _AGAIN * spread
    others = {other: rows[other].at(np.array([center[other]])) for other in KINDS if other != kind}
    for _ in range(_MOST_LOOKS):
        logs = np.linspace(middle - half, middle + half, _N_LOOKED)
        found = _tried(own, {**others, kind: rows[kind].at(np.exp(logs))})
        log_posterior = found.log_likelihood + _log_prior(found.size, known)
        weight = np.exp(log_posterior - np.max(log_posterior))
        best, cut = float(logs[np.argmax(weight)]), max(weight[0], weight[-1])
        weight /= weight.sum()
        mean, step = float(weight @ logs), float(logs[1] - logs[0])
        spread = float(np.sqrt(weight @ (logs - mean) ** 2))
        if cut >= (_CUT if half < whole else 1.0):
            middle, half = best, _WIDENED * half
            continue
        if spread >= _RESOLVED * step:
            break
        middle, half = best, _ZOOMED * step
    return float(np.exp(mean)), max(spread, _RESOLVED * step)


def _log_prior(size: Vector, known: Mapping[Kind, float]) -> Vector:
    """Return the logarithm of the prior density of sizes, (n, n_kind), but those that are known."""
    return np.asarray(
        sum(log_density(kind, own) for kind, own in zip(KINDS, size.T, strict=True) if kind not in known)
        + (np.zeros(len(size)) if known else log_together(size))
    )


def _sizes(of_kind: Vector) -> Sizes:
    return Sizes(**dict(zip(KINDS, of_kind.tolist(), strict=True)))


def _log_volume(own: Linearized) -> float:
    """Return the logarithm of the densities of all priors at their centres, but for those that say nothing."""
    held = own.prior_precision[own.prior_precision > 0.0]
    ranged = own.unseen[own.unseen > 1.0]
    return 0.5 * float(np.sum(np.log(held)) + np.sum(np.log(ranged)))
