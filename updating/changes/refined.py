"""The likeliest candidates weighed once more, with the structure's answer to them: evidence, and sizes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray
from scipy.special import log_ndtr, logsumexp

from updating.changes.candidate import Candidates, Kind
from updating.changes.condensed import Change, Condensed
from updating.changes.scan import EFFECTS

Vector = NDArray[np.float64]

_N_COARSE, _N_CLOSE = 60, 61
_DEEP = 15.0
"""Fall of the logarithm of the posterior beyond which an amplitude is not looked at more closely."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Refined:
    """One candidate with all amplitudes that it may have.

    Attributes
    ----------
    index : int
        Its number among those of its kind.
    amplitude : (n,) float
        Amplitudes.
    log : (n_size, n) float
        Logarithm of the posterior mass at each size of the scatter and amplitude, over the likelihood of no change.
    change : (N,) float
        Change of the errors by the likeliest amplitude.
    fall : (n_size,) float
        By how much the best amplitude lowers the misfit.
    """

    index: int
    amplitude: Vector
    log: Vector
    change: Vector
    fall: Vector

    @property
    def evidence(self) -> Vector:
        """Logarithm of the likelihood over that without a change, amplitude integrated out, (n_size,)."""
        return np.asarray(logsumexp(self.log, axis=1))


def refine(
    structure: Condensed,
    kind: Kind,
    candidates: Candidates,
    index: int,
    effect: float,
    problems: Sequence[tuple[Vector, Vector]],
) -> Refined:
    """Weigh one candidate with the structure's answer to it.

    Parameters
    ----------
    structure : Condensed
        The structure about the reference.
    kind : Kind
        Kind of the candidate.
    candidates : Candidates
        Those among which it is number `index`.
    index : int
        Its number.
    effect : float
        Root mean square change of eigenvalues by an amplitude of 1, to first order.
    problems : sequence of ((N,), (N, N))
        Errors without a change and the lower Cholesky factor of their covariance, at each size of the scatter.
    """
    change = structure.change(kind, candidates, index)
    scale = EFFECTS / effect
    most = min(kind.whole, candidates.upper, 4.0 * float(scale[-1]))
    coarse = np.geomspace(0.02 * min(float(scale[0]), most), most, _N_COARSE)
    middle = len(problems) // 2
    rough = _log_likelihood(change, coarse, problems[middle])[0] + _log_prior(coarse, scale, most)
    top = int(np.argmax(rough))
    near = np.flatnonzero(rough > rough[top] - _DEEP)
    low, high = coarse[max(near[0] - 1, 0)], coarse[min(near[-1] + 1, _N_COARSE - 1)]
    close = np.linspace(low, high, _N_CLOSE)
    best = close[int(np.argmax(_log_likelihood(change, close, problems[middle])[0]))]
    step = close[1] - close[0]
    closest = np.linspace(max(best - 3.0 * step, low), min(best + 3.0 * step, high), _N_CLOSE)
    amplitude = np.unique(np.concatenate([coarse, close, closest]))
    width = np.log(np.maximum(np.gradient(amplitude), 1e-300)) + _log_prior(amplitude, scale, most)
    found = [_log_likelihood(change, amplitude, problem) for problem in problems]
    log = np.array([own + width for own, _ in found])
    at = amplitude[int(np.argmax(log[middle] - width + _log_prior(amplitude, scale, most)))]
    return Refined(
        index=index,
        amplitude=amplitude,
        log=log,
        change=change(np.array([at]))[0],
        fall=np.array([fall for _, fall in found]),
    )


def _log_likelihood(
    change: Change, amplitude: Vector, problem: tuple[Vector, Vector]
) -> tuple[Vector, float]:
    """Return the logarithm of the likelihood over that of no change, (n,), and the largest fall of the misfit."""
    error, root = problem
    white = la.solve_triangular(
        root, np.column_stack([error, (error + change(amplitude)).T]), lower=True, check_finite=False
    )
    misfit = np.sum(white**2, axis=0)
    return 0.5 * (misfit[0] - misfit[1:]), float(max(misfit[0] - misfit[1:].min(), 0.0))


def _log_prior(amplitude: Vector, scale: Vector, most: float) -> Vector:
    """Return the logarithm of the density of the prior, half-normal at several scales up to the largest amplitude."""
    each = -0.5 * (amplitude[:, None] / scale) ** 2 - np.log(scale * np.sqrt(2.0 * np.pi))
    within = np.log(np.maximum(np.exp(log_ndtr(most / scale)) - 0.5, 1e-300))
    return np.asarray(logsumexp(each - within, axis=1) - np.log(len(scale)))
