"""Marginal likelihood of an explanation: over its parameters by Laplace, over the sizes of the discrepancy by sum."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from updating.diagnosis.discrepancy import KINDS, Kind, Sizes, sizes_tried

Vector = NDArray[np.float64]

_COUNTS = 0.02  # of the largest weight, from which sizes count for the covariance


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
    covariance : (n_coordinate, n_coordinate) float
        Of the coordinates, sizes and linear parameters integrated out.
    """

    log_evidence: float
    likeliest: Sizes
    mean: Sizes
    spread: Sizes
    covariance: Vector


def marginal(own: Linearized, stated: Sizes | None = None, stated_kinds: tuple[Kind, ...] = ()) -> Marginal:
    """Integrate an explanation over its coordinates and over the sizes of the discrepancy.

    Parameters
    ----------
    own : Linearized
        The explanation about its fit.
    stated : Sizes, optional
        What a laboratory states.
    stated_kinds : tuple of str
        The kinds for which it does.
    """
    tried, prior, parts = [], [], []
    for kind in KINDS:
        size, log_prior = sizes_tried(
            kind, getattr(stated, kind) if stated is not None and kind in stated_kinds else None
        )
        tried.append(size)
        prior.append(log_prior)
        parts.append(_normal_equations(own, kind, size))
    n = [size.size for size in tried]
    index = np.stack(np.meshgrid(*map(np.arange, n), indexing="ij"), axis=-1).reshape(-1, 3)
    gram = sum(part[0][i] for part, i in zip(parts, index.T, strict=True))
    slope = sum(part[1][i] for part, i in zip(parts, index.T, strict=True))
    constant = sum(part[2][i] for part, i in zip(parts, index.T, strict=True))
    precision = np.asarray(gram) + np.diag(own.prior_precision)
    slope = np.asarray(slope) - own.prior_precision * own.prior_value
    constant = np.asarray(constant) + float(np.sum(own.prior_precision * own.prior_value**2))
    free = own.free
    step = np.zeros(slope.shape)
    held = precision + np.diag(own.trust)
    step[:, free] = -np.linalg.solve(held[:, free][:, :, free], slope[:, free, None])[..., 0]
    misfit = constant + np.einsum("ij,ij->i", 2.0 * slope + np.einsum("ijk,ik->ij", precision, step), step)
    logdet = np.linalg.slogdet(precision + np.diag(own.unseen))[1]
    log_likelihood = -0.5 * (misfit + logdet) + sum(p[i] for p, i in zip(prior, index.T, strict=True))
    top = float(np.max(log_likelihood))
    weight = np.exp(log_likelihood - top)
    total = float(weight.sum())
    weight /= total
    at = index[int(np.argmax(log_likelihood))]
    logs = [np.log(size)[i] for size, i in zip(tried, index.T, strict=True)]
    mean = [float(weight @ log) for log in logs]
    spread = [float(np.sqrt(max(weight @ (log - m) ** 2, 0.0))) for log, m in zip(logs, mean, strict=True)]
    counts = weight > _COUNTS * weight.max()
    weight, step = weight[counts] / weight[counts].sum(), step[counts]
    inverse = np.linalg.pinv(precision[counts], hermitian=True)
    middle = weight @ step
    covariance = np.einsum("i,ijk->jk", weight, inverse)
    covariance += np.einsum("i,ij,ik->jk", weight, step - middle, step - middle)
    return Marginal(
        log_evidence=top + float(np.log(total) + _log_volume(own)),
        likeliest=Sizes(**{k: float(s[i]) for k, s, i in zip(KINDS, tried, at, strict=True)}),
        mean=Sizes(**{k: float(np.exp(m)) for k, m in zip(KINDS, mean, strict=True)}),
        spread=Sizes(**dict(zip(KINDS, spread, strict=True))),
        covariance=covariance,
    )


def _normal_equations(own: Linearized, kind: Kind, size: Vector) -> tuple[Vector, Vector, Vector]:
    """Return Gram matrices, slopes and misfits with log determinants of one kind of data, for each of its sizes."""
    rows = own.kind == kind
    value, jacobian, growth = own.value[rows], own.jacobian[rows], own.growth[rows]
    variance = 1.0 + size[:, None] ** 2 * growth
    weighted = jacobian / variance[..., None]
    gram = np.einsum("sij,ik->sjk", weighted, jacobian, optimize=True)
    slope = np.einsum("sij,i->sj", weighted, value)
    constant = np.sum(value**2 / variance + np.log(variance), axis=1)
    return gram, slope, constant


def _log_volume(own: Linearized) -> float:
    """Return the logarithm of the densities of all priors at their centres, but for those that say nothing."""
    held = own.prior_precision[own.prior_precision > 0.0]
    ranged = own.unseen[own.unseen > 1.0]
    return 0.5 * float(np.sum(np.log(held)) + np.sum(np.log(ranged)))
