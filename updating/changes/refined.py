"""The likeliest changes weighed once more, with the answer of the whole structure to a change of any size.

The scan takes modes of the reference as they are. Beside a change of some size the structure gives way more than these
can: strains concentrate about a patch that is soft, and what a mass pulls at yields. So the rest of its basis, and its
static answers to forces about the location where it has any beside, are added as coordinates v and eliminated at each
measured frequency,

    dS(t) = t S_ll - t**2 S_lv (D_vv + t S_vv)**-1 S_vl,    S = dK - lambda dM,    D = K - lambda M,

which is exact for any amplitude t within these coordinates (Guyan 1965; Leung 1978 at the frequency of each mode).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray

from updating.changes.candidate import Candidates, Kind
from updating.changes.scan import EFFECTS, apparent
from updating.changes.situation import Situation
from updating.changes.structure import Answers, Part, Structure

Vector = NDArray[np.float64]

Change = Callable[[Vector], Vector]
"""Takes amplitudes (n,), returns the change of all errors of the changed state, (n, N)."""

_DEPENDENT = 1e-5  # of the largest energy: directions with less are none

_ABOVE = 0.9  # of the highest measured eigenvalue over one of the rest

_LEAST = 0.05  # of its stiffness that a direction keeps


class Condensed:
    """The structure about the fitted reference, and how it answers to changes.

    Parameters
    ----------
    at : Situation
        State and reference.
    """

    def __init__(self, at: Situation) -> None:
        self.at, self.structure = at, at.structure
        self._kept: dict[tuple[object, ...], tuple[Structure, Vector, Vector]] = {}

    def change(self, kind: Kind, candidates: Candidates, i: int) -> Change:
        """Return what one candidate does to the equation errors of the changed state, by its amplitude.

        Parameters
        ----------
        kind : Kind
            Its kind.
        candidates : Candidates
            Among which it is number `i`.
        """
        structure, stiffness, mass = self._around(kind, candidates, i)
        own = kind.candidates(structure, structure.located(candidates.place[i, None]))
        (j,) = np.flatnonzero(own.form == candidates.form[i])
        m, measured = self.structure.n_mode, self.at.ours
        steps = list[tuple[Vector, Vector, Vector]]()
        parts = _matrices(own.only(np.array([j])))
        for r, value in enumerate(measured.eigenvalue):
            s = _dynamic(parts, value)
            gap = stiffness - value * mass
            mu, turn = la.eigh(s[m:, m:], gap)
            a = measured.weight[r]
            steps.append((s[:m, :m] @ a, s[:m, m:] @ turn, np.column_stack([mu, turn.T @ s[m:, :m] @ a])))

        def changed(amplitude: Vector) -> Vector:
            found = np.zeros((amplitude.size, *measured.scale.shape))
            for r, (first, back, answers) in enumerate(steps):
                t = amplitude[:, None]
                yields = t**2 * answers[:, 1] / np.maximum(1.0 + t * answers[:, 0], _LEAST)
                found[:, r] = -(t * first - yields @ back.T) / measured.scale[r]
            return found.reshape(amplitude.size, -1)

        return changed

    def _around(self, kind: Kind, candidates: Candidates, i: int) -> tuple[Structure, Vector, Vector]:
        """Return the structure with its answers after the modes, and stiffness and mass of these answers."""
        place, size = candidates.place[i], float(candidates.size[i])
        half = size if np.isfinite(size) else 0.0
        key = (*np.round(place, 4).tolist(), round(half, 4)) if kind.local else ()
        if key not in self._kept:
            answers = self.structure.answers(place, half) if kind.local else None
            if answers is None and key:
                return self._around(replace(kind, local=False), candidates, i)
            self._kept[key] = self._beside(answers)
        return self._kept[key]

    def _beside(self, answers: Answers | None) -> tuple[Structure, Vector, Vector]:
        """Return the structure with all that is beside its modes, and stiffness and mass of that."""
        modes, stiffness, mass = self.structure.matrices()
        n = len(stiffness)
        if answers is not None:
            stiffness, mass = _bordered(stiffness, answers.stiffness), _bordered(mass, answers.mass)
            modes = np.vstack([modes, np.zeros((len(stiffness) - n, modes.shape[1]))])
        raw = np.eye(len(stiffness)) - modes @ (modes.T @ mass)
        energy, inertia = raw.T @ (stiffness @ raw), raw.T @ (mass @ raw)
        unit = 1.0 / np.sqrt(np.maximum(np.diag(energy), 1e-300))
        value, turn = la.eigh(energy * np.outer(unit, unit))
        keep = value > _DEPENDENT * value[-1]
        turn = unit[:, None] * turn[:, keep] / np.sqrt(value[keep])
        # nothing near the measured frequencies or below: it would be a mode that is looked at already
        ratio, axes = la.eigh(turn.T @ inertia @ turn)
        above = ratio * self.at.ours.eigenvalue.max() < _ABOVE
        found = raw @ (turn @ axes[:, above])
        further = None if answers is None else answers.vectors @ found[n:]
        structure = self.structure.beside(found[:n], further)
        return structure, np.eye(found.shape[1]), np.diag(ratio[above])


def _bordered(matrix: Vector, border: Vector) -> Vector:
    """Return a matrix, (n, n), with further columns and rows, given as columns (n + k, k)."""
    n = len(matrix)
    return np.block([[matrix, border[:n]], [border[:n].T, border[n:]]])


def _matrices(own: Candidates) -> list[tuple[Part, Vector]]:
    """Return what each part of one candidate adds for an amplitude of 1, as a matrix."""
    found = []
    for part in own.parts:
        row = sp.csr_array(part.weight)
        rows = part.rows[row.indices]
        flat = rows.reshape(-1, rows.shape[2])
        found.append((part, flat.T @ (np.repeat(part.sign * row.data, rows.shape[1])[:, None] * flat)))
    return found


def _dynamic(parts: Sequence[tuple[Part, Vector]], eigenvalue: float) -> Vector:
    """Return dK - lambda dM at one measured mode."""
    total = np.zeros_like(parts[0][1])
    for part, matrix in parts:
        factor = -eigenvalue if part.target == "M" else 1.0
        if part.resonance is not None:
            factor *= float(apparent(np.array([eigenvalue]), part.resonance)[0, 0])
        total += factor * matrix
    return (total + total.T) / 2.0


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
        return np.asarray(scipy.special.logsumexp(self.log, axis=1))


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
    within = np.log(np.maximum(np.exp(scipy.special.log_ndtr(most / scale)) - 0.5, 1e-300))
    return np.asarray(scipy.special.logsumexp(each - within, axis=1) - np.log(len(scale)))
