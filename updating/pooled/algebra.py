"""Many specimens beside one model, to first order: a Gaussian problem in which each specimen's own part goes first.

A specimen's own coordinates touch its own data alone, so they are eliminated specimen by specimen, and what is left is
a small dense problem in what all share: the block elimination of bundle adjustment (Triggs et al., Bundle Adjustment -
A Modern Synthesis, 2000). Time grows with the number of specimens, the problem that is solved in the end does not.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from updating.diagnosis.discrepancy import KINDS, Kind

Vector = NDArray[np.float64]

_LEAST, _ROUNDING, _EDGE = 1e-30, 1e-10, 1e-12


@dataclass(frozen=True, eq=False, kw_only=True)
class Block:
    """Data of one specimen to first order: value + own x - shared a + effect t, rotated so that its noise is white.

    Attributes
    ----------
    value : (n,) float
        Measured less modelled.
    own : (n, n_own) float
        Its derivatives by the specimen's own coordinates.
    shared : (n, n_latent) float
        Discrepancies that all specimens share, at unit strength.
    effect : (n, n_effect) float
        Derivatives by coordinates of effects.
    kind : (n,) str
        Of each row, one of `KINDS`.
    growth : (n,) float
        Variance by the specimen's own discrepancy of unit size, over that of the noise.
    away : (n_own,) float
        How far the own coordinates are from what is known of them.
    mean : (n_own,) int
        The shared coordinate that each own coordinate scatters about, among the means.
    """

    value: Vector
    own: Vector
    shared: Vector
    effect: Vector
    kind: NDArray[np.str_]
    growth: Vector
    away: Vector
    mean: NDArray[np.intp]

    @cached_property
    def columns(self) -> Vector:
        """All columns side by side, (n, n_own + n_latent + n_effect + 1), the value last."""
        return np.column_stack([self.own, -self.shared, self.effect, self.value])

    def __getstate__(self) -> dict[str, object]:
        """Return what another process needs: not the columns, which are as large as all else and soon made anew."""
        return {name: value for name, value in self.__dict__.items() if name != "columns"}

    def gram(self, kind: Kind, size: float) -> tuple[Vector, float]:
        """Return the Gram matrix of the columns of one kind of data, and the logarithms of its variances summed."""
        rows = self.kind == kind
        variance = 1.0 + size**2 * self.growth[rows]
        weighted = self.columns[rows] / np.sqrt(variance)[:, None]
        return weighted.T @ weighted, float(np.sum(np.log(variance)))


@dataclass(frozen=True, kw_only=True)
class Strengths:
    """What a pooled problem is weighed with.

    Attributes
    ----------
    size : tuple of float
        Sizes of the discrepancy of each of `KINDS`.
    own : tuple of float
        Standard deviation of each own coordinate about its mean.
    mean : tuple of float
        Standard deviation of each mean; infinite where nothing is known of it.
    latent : tuple of float
        Standard deviation of each shared discrepancy.
    """

    size: tuple[float, ...]
    own: tuple[float, ...]
    mean: tuple[float, ...]
    latent: tuple[float, ...]


@dataclass(frozen=True, eq=False, kw_only=True)
class Reduced:
    """A specimen without its own coordinates.

    Attributes
    ----------
    gram : (m, m) float
        Of the means, latents, effects and the value, (m = n_mean + n_latent + n_effect + 1).
    held : (m, m) float
        The same where the own coordinates stay where they are.
    log_det : float
        Logarithms of the precision of the own coordinates over their priors', and of the variances of the data.
    back : (n_own, m) float
        Own coordinates that fit best, as the negative of `back` times (means, latents, effects, 1).
    root : (n_own, n_own) float
        Lower Cholesky factor of the precision of the own coordinates.
    """

    gram: Vector
    held: Vector
    log_det: float
    back: Vector
    root: Vector

    @property
    def covariance(self) -> Vector:
        """Covariance of the own coordinates where all else is known, (n_own, n_own)."""
        return np.asarray(la.cho_solve((self.root, True), np.eye(len(self.root))))


def reduced(
    blocks: Sequence[Block], weighed: Sequence[Strengths], grams: Sequence[Sequence[tuple[Vector, float]]]
) -> list[Reduced]:
    """Eliminate the own coordinates of specimens, of those that have the same coordinates at once.

    Parameters
    ----------
    blocks : sequence of Block
        The specimens.
    weighed : sequence of Strengths
        Sizes and priors of each.
    grams : sequence of sequence of ((k, k), float)
        Of each `Block.gram` of every kind of data at its size.
    """
    alike: dict[tuple[bytes, tuple[int, ...]], list[int]] = {}
    for s, (block, gram) in enumerate(zip(blocks, grams, strict=True)):
        alike.setdefault((block.mean.tobytes(), gram[0][0].shape), []).append(s)
    found: dict[int, Reduced] = {}
    for members in alike.values():
        own = _reduced(
            [blocks[s] for s in members], [weighed[s] for s in members], [grams[s] for s in members]
        )
        found.update(zip(members, own, strict=True))
    return [found[s] for s in range(len(blocks))]


def _reduced(
    blocks: Sequence[Block], weighed: Sequence[Strengths], grams: Sequence[Sequence[tuple[Vector, float]]]
) -> Iterator[Reduced]:
    """Yield specimens that have the same coordinates without them."""
    n_own, n_mean = blocks[0].own.shape[1], len(weighed[0].mean)
    precision = np.array([own.own for own in weighed]) ** -2.0
    data = np.array([sum(gram for gram, _ in own) for own in grams])
    first = n_own + n_mean  # of the latents
    full = np.zeros((len(blocks), n_mean + data.shape[1], n_mean + data.shape[1]))
    full[:, :n_own, :n_own], full[:, :n_own, first:] = data[:, :n_own, :n_own], data[:, :n_own, n_own:]
    full[:, first:, :n_own], full[:, first:, first:] = data[:, n_own:, :n_own], data[:, n_own:, n_own:]
    _add_prior(full, np.array([own.away for own in blocks]), blocks[0].mean, precision)
    root = np.linalg.cholesky(full[:, :n_own, :n_own])
    back = np.linalg.solve(full[:, :n_own, :n_own], full[:, :n_own, n_own:])
    gram = full[:, n_own:, n_own:] - full[:, :n_own, n_own:].transpose(0, 2, 1) @ back
    own_det = 2.0 * np.sum(np.log(np.diagonal(root, axis1=1, axis2=2)), axis=1)
    own_det -= np.sum(np.log(precision), axis=1)
    for s, own in enumerate(grams):
        yield Reduced(
            gram=gram[s],
            held=full[s, n_own:, n_own:],
            log_det=float(own_det[s] + sum(log for _, log in own)),
            back=back[s],
            root=root[s],
        )


def _add_prior(full: Vector, away: Vector, mean: NDArray[np.intp], precision: Vector) -> None:
    """Add to Gram matrices those of own - mean + away, each over its standard deviation, (n_specimen, n_own)."""
    own, centre, force = np.arange(len(mean)), precision.shape[1] + mean, precision * away
    full[:, own, own] += precision
    full[:, centre, centre] += precision  # each own coordinate has another mean
    full[:, own, centre] -= precision
    full[:, centre, own] -= precision
    for row, sign in ((own, 1.0), (centre, -1.0)):
        full[:, row, -1] += sign * force
        full[:, -1, row] += sign * force
    full[:, -1, -1] += np.sum(force * away, axis=1)


@dataclass(frozen=True, eq=False, kw_only=True)
class Joined:
    """All specimens without their own coordinates, with the priors of what they share.

    Coordinates are the means, the latents, and those of effects.

    Attributes
    ----------
    precision : (m, m) float
        Of the coordinates by data and priors.
    slope : (m,) float
        Half of the derivative of the misfit by them.
    misfit : float
        Where all of them are 0.
    log_det : float
        Logarithms of the determinants of all that was eliminated, and of the priors.
    """

    precision: Vector
    slope: Vector
    misfit: float
    log_det: float

    def step(self, low: Vector, high: Vector, trust: float) -> Vector:
        """Return the coordinates (m,) of the least misfit with those of effects, the last of them, within bounds.

        Parameters
        ----------
        low, high : (n_coordinate,) float
            The bounds.
        trust : float
            Inverse variance of steps of effects for which first order does.
        """
        n = self.slope.size - low.size
        root = la.cho_factor(self.precision[:n, :n])
        first = la.cho_solve(root, np.column_stack([self.slope[:n], self.precision[:n, n:]]))
        beside = self.precision[n:, n:] - self.precision[n:, :n] @ first[:, 1:]
        slope = self.slope[n:] - self.precision[n:, :n] @ first[:, 0]
        effects = bounded(beside + trust * np.eye(low.size), slope, low, high)
        return np.concatenate([-first[:, 0] - first[:, 1:] @ effects, effects])

    def at(self, coordinate: Vector) -> float:
        """Return the misfit at some coordinates."""
        return float(self.misfit + 2.0 * self.slope @ coordinate + coordinate @ self.precision @ coordinate)


def joined(
    specimens: Sequence[Reduced], weighed: Strengths, place: Sequence[Vector], prior: tuple[Vector, Vector]
) -> Joined:
    """Put specimens together.

    Parameters
    ----------
    specimens : sequence of Reduced
        Without their own coordinates.
    weighed : Strengths
        Sizes and priors.
    place : sequence of (n_effect, n_coordinate) float
        How the effect columns of each specimen follow the coordinates of effects.
    prior : ((n_coordinate,), (n_coordinate,))
        Where these are from the centres of their priors, and the precision of these.
    """
    std = np.array([*weighed.mean, *weighed.latent])
    n, n_coordinate = std.size, prior[0].size
    total = np.zeros((n + n_coordinate + 1, n + n_coordinate + 1))
    for own, where in zip(specimens, place, strict=True):
        _add_spread(total, own.gram, n, where)
    known = np.concatenate([std**-2.0, prior[1]])
    away = np.concatenate([np.zeros(n), prior[0]])
    held = known[known > 0.0]
    return Joined(
        precision=total[:-1, :-1] + np.diag(known),
        slope=total[:-1, -1] + known * away,
        misfit=float(total[-1, -1] + np.sum(known * away**2)),
        log_det=sum(own.log_det for own in specimens) - float(np.sum(np.log(held))),
    )


def spread(gram: Vector, n: int, where: Vector) -> Vector:
    """Return a Gram matrix whose effect columns, between the first n and the value, are put where coordinates are."""
    full = np.zeros((n + where.shape[1] + 1, n + where.shape[1] + 1))
    _add_spread(full, gram, n, where)
    return full


def _add_spread(total: Vector, gram: Vector, n: int, where: Vector) -> None:
    """Add `spread` to a matrix: of its parts, for hundreds are added and each has few columns of effects."""
    column = gram[:, n:-1] @ where
    total[:n, :n] += gram[:n, :n]
    total[:n, n:-1] += column[:n]
    total[n:-1, :n] += column[:n].T
    total[n:-1, n:-1] += where.T @ column[n:-1]
    for rest, row in ((slice(None, n), gram[:n, -1]), (slice(n, -1), column[-1])):
        total[rest, -1] += row
        total[-1, rest] += row
    total[-1, -1] += gram[-1, -1]


def bounded(precision: Vector, slope: Vector, low: Vector, high: Vector) -> Vector:
    """Return the step within bounds that makes step @ precision @ step + 2 slope @ step least."""
    if not slope.size:
        return np.zeros(0)
    scale = np.sqrt(np.maximum(np.diag(precision), _LEAST))
    root = la.cholesky(precision / np.outer(scale, scale) + _ROUNDING * np.eye(scale.size), lower=True)
    target = la.solve_triangular(root, -slope / scale, lower=True)
    found = lsq_linear(root.T, target, bounds=(low * scale - _EDGE, high * scale + _EDGE), method="bvls")
    return np.asarray(found.x / scale)


def log_evidence(found: Joined, coordinate: Vector, unseen: Vector) -> float:
    """Return the logarithm of the marginal likelihood by Laplace, up to a constant of the data.

    Parameters
    ----------
    found : Joined
        All specimens.
    coordinate : (m,) float
        Where the misfit is taken, such as `Joined.step`.
    unseen : (m,) float
        Precision of the volume that each coordinate has beforehand, which counts in determinants alone.
    """
    log_det = np.linalg.slogdet(found.precision + np.diag(unseen))[1] - np.sum(np.log(unseen[unseen > 0.0]))
    return -0.5 * float(found.at(coordinate) + found.log_det + log_det)


def grams(block: Block, size: Sequence[float]) -> list[tuple[Vector, float]]:
    """Return `Block.gram` of each of `KINDS`."""
    return [block.gram(kind, own) for kind, own in zip(KINDS, size, strict=True)]
