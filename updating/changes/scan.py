"""The scan: what each candidate change does to equation errors, and how much likelier it makes them.

For given modal coordinates a_r of a measured mode, a change dK, dM moves its equation errors by -phi_s' (dK - lambda_r
dM) Phi a_r / (omega_s omega_r), whatever its size. So with errors e of covariance C in the changed state, given what
the reference left, the likelihood of an amplitude t is normal in t, and its integral over a half-normal prior that ends
at what is possible has a closed form. Thousands of candidates are weighed by two matrix products.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray

from updating.changes.candidate import Candidates
from updating.changes.structure import Part

Vector = NDArray[np.float64]

EFFECTS = 0.01 * np.array([0.2, 0.6, 2.0, 6.0, 20.0])
"""Root mean square changes of eigenvalues, relative, over which the prior of a change's size is spread evenly in the
logarithm: 0.1 to 10 % of a frequency. It is the same for all kinds: none gains by a range that somebody chose."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Measured:
    """Modal coordinates of the measured modes of the changed state, all its repeats one after the other.

    Attributes
    ----------
    weight : (n, m) float
        a, by mode.
    eigenvalue : (n,) float
        (rad/s)**2.
    scale : (n, m) float
        omega_s omega_r, by which equation errors are relative.
    """

    weight: Vector
    eigenvalue: Vector
    scale: Vector


class Actions:
    """What parts of candidates do to equation errors, computed once for parts that share their rows."""

    def __init__(self, measured: Measured) -> None:
        self.measured = measured
        # rows and weights are held so that their identity stays theirs
        self._at: dict[int, tuple[Vector, Vector]] = {}
        self._weighted: dict[tuple[int, int], tuple[Part, NDArray[np.intp], Vector]] = {}

    def at_points(self, part: Part) -> Vector:
        """Return the change of all errors by a unit of a part's square at each point, (n_point, n, m)."""
        key = id(part.rows)
        if key not in self._at:
            a = self.measured.weight
            seen = np.einsum("pRm,nm->pRn", part.rows, a, optimize=True)
            force = np.einsum("pRm,pRn->pnm", part.rows, seen, optimize=True)
            self._at[key] = part.rows, -force / self.measured.scale
        return self._at[key][1]

    def of(self, candidates: Candidates) -> Vector:
        """Return the change of all errors by an amplitude of 1 of each candidate, (n_candidate, n, m)."""
        n, m = self.measured.scale.shape
        total = np.zeros((candidates.n, n, m))
        for part in candidates.parts:
            which, change = self._of_part(part)
            change = change.reshape(-1, n, m)
            if part.target == "M":
                change = -change * self.measured.eigenvalue[:, None]
            if part.resonance is not None:
                change = change * apparent(self.measured.eigenvalue, part.resonance[which])[:, :, None]
            total[which] += part.sign * change
        return total

    def _of_part(self, part: Part) -> tuple[NDArray[np.intp], Vector]:
        """Return which candidates have any of a part, and how it changes all errors as a stiffness but for its sign."""
        key = id(part.rows), id(part.weight)
        if key not in self._weighted:
            at, weight = self.at_points(part), sp.csr_array(part.weight)
            which = np.flatnonzero(np.diff(weight.indptr))
            self._weighted[key] = part, which, weight[which] @ at.reshape(len(at), -1)
        return self._weighted[key][1:]

    def effect(self, action: Vector) -> Vector:
        """Return the root mean square relative change of eigenvalues by an amplitude of 1, (n_candidate,)."""
        return np.asarray(np.sqrt(np.mean(np.einsum("cnm,nm->cn", action, self.measured.weight) ** 2, axis=1)))


def apparent(eigenvalue: Vector, resonance: Vector, *, least: float = 0.03) -> Vector:
    """Return by which factor masses on springs act larger than they are, (n_candidate, n_mode).

    `least` keeps a mode off the resonance: there damping does, which loss factors of a few per cent have.
    """
    off = 1.0 - eigenvalue / resonance[:, None]
    return np.asarray(1.0 / np.where(np.abs(off) < least, np.copysign(least, off), off))


@dataclass(frozen=True, eq=False, kw_only=True)
class Weighed:
    """Candidates weighed at one size of the scatter.

    Attributes
    ----------
    log : (n_candidate,) float
        Logarithm of the likelihood of the errors with the change, its amplitude integrated out, over that without.
    amplitude, std : (n_candidate,) float
        Mean and standard deviation of the amplitude.
    fall : (n_candidate,) float
        By how much the best amplitude lowers the misfit.
    """

    log: Vector
    amplitude: Vector
    std: Vector
    fall: Vector


def weigh(
    action: Vector, effect: Vector, upper: float, error: Vector, root: Vector, effects: Vector = EFFECTS
) -> Weighed:
    """Weigh candidates.

    Parameters
    ----------
    action : (n_candidate, N)
        Change of the errors by an amplitude of 1.
    effect : (n_candidate,)
        Root mean square change of eigenvalues by the same.
    upper : float
        Largest amplitude.
    error : (N,)
        Errors without a change.
    root : (N, N)
        Lower Cholesky factor of their covariance.
    effects : (n,)
        Changes of eigenvalues that are the scales of the half-normal prior.
    """
    nothing = 1e-9  # of the largest effect: a candidate that does less does nothing
    whitening = la.solve_triangular(root, np.eye(error.size), lower=True, check_finite=False)
    e, j = whitening @ error, action @ whitening.T
    none = effect < nothing * np.max(effect, initial=1e-300)  # such as a line beyond the outline
    information = np.where(none, nothing, np.einsum("ci,ci->c", j, j))
    pull = np.where(none, 0.0, -(j @ e))
    scale = effects[:, None] / np.where(none, 1.0, effect)  # (n_scale, n_candidate)
    precision = information + scale**-2.0
    mean, std = pull / precision, precision**-0.5
    log = 0.5 * pull**2 / precision - 0.5 * np.log(precision * scale**2)
    log += _log_within(mean, std, upper)
    log -= np.log(0.5 * scipy.special.erf(np.sqrt(0.5) * upper / scale))  # what of the prior is possible
    top = log.max(axis=0)
    share = np.exp(log - top)
    total = share.sum(axis=0)
    share /= total
    middle, spread = _truncated(mean, std, upper)
    amplitude = np.sum(share * middle, axis=0)
    variance = np.sum(share * (spread**2 + middle**2), axis=0) - amplitude**2
    best = np.clip(pull / information, 0.0, upper)
    return Weighed(
        log=top + np.log(total / len(effects)),
        amplitude=amplitude,
        std=np.sqrt(np.maximum(variance, 0.0)),
        fall=best * (2.0 * pull - best * information),
    )


def _log_within(mean: Vector, std: Vector, upper: float) -> Vector:
    """Return the logarithm of the probability that a normal variable lies between 0 and an upper end."""
    a, b = -mean / std, (upper - mean) / std
    beyond = a > 0.0  # both ends in the upper tail: there the lower one of the mirrored variable loses nothing
    high, low = (scipy.special.log_ndtr(np.where(beyond, -a, b)), scipy.special.log_ndtr(np.where(beyond, -b, a)))
    return np.asarray(high + np.log1p(-np.exp(np.minimum(low - high, -1e-15))))


def _truncated(mean: Vector, std: Vector, upper: float) -> tuple[Vector, Vector]:
    """Return mean and standard deviation of a normal variable between 0 and an upper end."""
    a, b = -mean / std, (np.full_like(mean, upper) - mean) / std
    log_z = _log_within(mean, std, upper)

    def density(t: Vector) -> Vector:
        return np.exp(np.minimum(-0.5 * t**2 - 0.5 * np.log(2.0 * np.pi) - log_z, 50.0))

    finite = np.where(np.isfinite(b), b, 0.0)
    pa, pb = density(a), np.where(np.isfinite(b), density(finite), 0.0)
    first = pa - pb
    second = 1.0 + a * pa - finite * pb - first**2
    return np.clip(mean + std * first, 0.0, upper), std * np.sqrt(np.clip(second, 1e-6, None))


def conditional(error: Vector, covariance: Vector, changed: NDArray[np.bool_]) -> tuple[Vector, Vector, float]:
    """Return the errors of the changed state less what the reference makes of them, and their covariance then.

    Last comes the logarithm of the likelihood of the reference's errors.

    Parameters
    ----------
    error, covariance : (N,) and (N, N)
        Of all states.
    changed : (N,) bool
        Which are of the changed state.
    """
    ours, theirs = np.ix_(changed, ~changed), np.ix_(~changed, ~changed)
    root = la.cholesky(covariance[theirs], lower=True, check_finite=False)
    half = la.solve_triangular(root, np.column_stack([error[~changed], covariance[ours].T]), lower=True)
    rest = error[changed] - half[:, 1:].T @ half[:, 0]
    left = covariance[np.ix_(changed, changed)] - half[:, 1:].T @ half[:, 1:]
    log = -0.5 * float(half[:, 0] @ half[:, 0]) - float(np.sum(np.log(np.diag(root))))
    return rest, (left + left.T) / 2.0, log
