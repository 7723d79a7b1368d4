"""The likeliest changes weighed once more, with the answer of the whole structure to a change of any size.

The scan takes modes of the reference as they are. Beside a change of some size the structure gives way more than these
can: strains concentrate about a patch that is soft, and what a mass pulls at yields. So the rest of its basis, and its
static answers to forces about the location where it has any beside, are added as coordinates v and eliminated at each
measured frequency,

    dS(t) = t S_ll - t**2 S_lv (D_vv + t S_vv)**-1 S_vl,    S = dK - lambda dM,    D = K - lambda M,

which is exact for any amplitude t within these coordinates (Guyan 1965; Leung 1978 at the frequency of each mode).

What a crack or a hole takes is known at loads that stay, not at displacements: it opens until nothing more is carried
across. There the static flexibility of the structure grows in proportion to t. With openings q whose energy is
q' q / 2 in an endless plate, rows C' of the stress that opens them, and Lambda of the modes, the stiffness that is left
follows as

    dS(t) = -C_l (I / t + C_l' Lambda**-1 C_l - C_v' (D_vv**-1 - K_vv**-1) C_v)**-1 C_l',

whatever static answers are known, for these are within the flexibility (eigenstrains: Mura 1987). The modes above
move by v = D_vv**-1 C_v q.
"""

from __future__ import annotations

from collections.abc import Sequence
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
from updating.inference.equation_error import WIDE
from updating.inference.gradient import Latent

Vector = NDArray[np.float64]

_DEPENDENT = 1e-5  # of the largest energy: directions with less are none

_ABOVE = 0.9  # of the highest measured eigenvalue over one of the rest

_LEAST = 0.05  # of its stiffness that a direction keeps

_NOTHING = 1e-6  # of the largest answer: smaller ones are none

_FARTHEST = 3.0  # standard deviation of a modal coordinate beside a shape of unit length, whatever equations say

_TUNED = (1.0 + 0.03 * (np.arange(9) - 4.0) / 9.0) ** 2
"""Squares of tunings over one that was tried, in place of it: those that were tried are up to 3 % apart."""

_OFF = 0.005
"""Least distance of an eigenvalue from that of what is tuned, relative: the mode of a resonator is as near to it as its
mass is small, and has its damping."""

_Around = tuple[Structure, Vector, Vector, list[Vector]]


class Condensed:
    """The structure about the fitted reference, and how it answers to changes.

    Parameters
    ----------
    at : Situation
        State and reference.
    """

    def __init__(self, at: Situation) -> None:
        self.at, self.structure = at, at.structure
        self._kept: dict[tuple[object, ...], _Around] = {}

    def changes(self, kind: Kind, candidates: Candidates, i: int) -> list[Change]:
        """Return what one candidate does to the equation errors of the changed state, by its amplitude.

        What is tuned is so several times, between the tunings that were tried.

        Parameters
        ----------
        kind : Kind
            Its kind.
        candidates : Candidates
            Among which it is number `i`.
        """
        structure, stiffness, mass, seen = self._around(kind, candidates, i)
        opened, adding = None, structure
        if kind.opened is not None:  # mass that goes with it moves with the modes
            opened, adding = kind.opened(structure, candidates.only(np.array([i]))), self.structure
        there = kind.candidates(adding, structure.located(candidates.location[i, None]))
        (j,) = np.flatnonzero(there.form == candidates.form[i])
        chosen = there.only(np.array([j])).parts
        parts = _matrices([part for part in chosen if opened is None or part.target == "M"])
        tuned = any(part.resonance is not None and np.isfinite(part.resonance).all() for part in chosen)
        around = (structure, stiffness, mass, seen)
        return [self._change(_tuned(parts, ratio), opened, around) for ratio in (_TUNED if tuned else (1.0,))]

    def _change(self, parts: Sequence[tuple[Part, Vector]], opened: Vector | None, around: _Around) -> Change:
        """Return what some matrices, or openings, do."""
        (_, stiffness, mass, seen), m, steps = around, self.structure.n_mode, list[_Mode]()
        for errors, rows in zip(self.at.joint.errors[self.at.n_reference :], seen, strict=True):
            for r, value in enumerate(errors.eigenvalue):
                s = _dynamic(parts, value) if parts else np.zeros((m, m))
                if opened is None:
                    mu, turn = la.eigh(s[m:, m:], stiffness - value * mass)
                    answers, moved = turn.T @ s[m:, :m], turn
                else:
                    mu, answers, moved = self._opening(opened, value, np.diag(mass))
                size = np.linalg.norm(answers, axis=1)
                used = size > _NOTHING * size.max(initial=0.0)
                law = _Law(s[:m, :m], mu[used], answers[used], opens=opened is not None)
                steps.append(_Mode(errors.latent, r, law, rows @ moved[:, used]))
        return Change(steps)

    def _opening(self, opened: Vector, eigenvalue: float, inertia: Vector) -> tuple[Vector, Vector, Vector]:
        """Return what keeps openings closed at one measured mode, the stress that opens each, and what they move.

        Parameters
        ----------
        opened : (r, m + k)
            Rows C' of the modes and of the rest of the structure, whose stiffness is 1 each.
        eigenvalue : float
            Of the mode.
        inertia : (k,)
            Mass of the rest.
        """
        m = self.structure.n_mode
        within, beyond = opened[:, :m], opened[:, m:]
        modes, stiffness, _ = self.structure.matrices()
        value = np.einsum("im,ij,jm->m", modes, stiffness, modes, optimize=True)
        elastic = value > _NOTHING * value.max()
        flexible = within[:, elastic] / np.sqrt(value[elastic])
        answer = 1.0 / (1.0 - eigenvalue * inertia)
        mu, turn = la.eigh(flexible @ flexible.T - (beyond * (answer - 1.0)) @ beyond.T)
        return mu, turn.T @ within, (answer[:, None] * beyond.T) @ turn

    def _around(self, kind: Kind, candidates: Candidates, i: int) -> _Around:
        """Return the structure with its answers after the modes, stiffness and mass of these, and what is seen of them.

        That is nothing where only the reduced basis answers, as of a thick stack: coordinates of modes that sensors
        hardly see would take it up.
        """
        location, size = candidates.location[i], float(candidates.size[i])
        half = size if np.isfinite(size) else 0.0
        half = half if kind.on_plan else half / 2.0  # parts of edges have a length, patches a radius
        key = (*np.round(location, 4).tolist(), round(half, 4)) if kind.local else ()
        if key not in self._kept:
            answers = self.structure.answers(location, half) if kind.local else None
            if answers is None and key:
                return self._around(replace(kind, local=False), candidates, i)
            self._kept[key] = self._beside(answers)
        return self._kept[key]

    def _beside(self, answers: Answers | None) -> _Around:
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
        beside = structure.vectors[:, self.structure.n_mode :]
        seen = [np.asarray(sensors @ beside) for sensors in self.at.sensors]
        seen = seen if answers is not None else [np.zeros_like(rows) for rows in seen]
        return structure, np.eye(found.shape[1]), np.diag(ratio[above]), seen


@dataclass(frozen=True, eq=False)
class _Law:
    """What an amplitude does to one measured mode in the equations of the structure.

    Attributes
    ----------
    within : (m, m) float
        dK - lambda dM of an amplitude of 1 between the modes.
    mu : (k,) float
        The same of the rest of the structure, in coordinates in which its own dynamic stiffness is the identity; of
        openings what keeps them closed.
    answers : (k, m) float
        The same between these coordinates and the modes; of openings the stress that opens them.
    opens : bool
        Whether the coordinates are openings.
    """

    within: Vector
    mu: Vector
    answers: Vector
    opens: bool

    def __call__(self, amplitude: Vector) -> tuple[Vector, Vector]:
        """Return how the coordinates follow the modes, (n, k, m), and the change of their stiffness, (n, m, m)."""
        t = amplitude[:, None]
        off = 1.0 + t * self.mu
        share = t / np.where(off > _LEAST, off, _LEAST)
        yields = (share if self.opens else -share)[..., None] * self.answers
        gives = -yields if self.opens else t[..., None] * yields
        return yields, t[..., None] * self.within + self.answers.T @ gives


class _Mode:
    """One measured mode in the equations of the structure with a change of any amplitude.

    The rest of the structure moves by v = V a, and sensors see Psi + Psi_v V of the modal coordinates a. So these are
    estimated anew, as `updating.inference.equation_error` does without a change: with a prior by which equation errors
    are of a size of `WIDE`.

    Parameters
    ----------
    latent : Latent
        What shapes say of modal coordinates without a change.
    r : int
        Number of the mode.
    law : _Law
        What an amplitude does.
    seen : (n_dof, k) float
        What sensors see of the coordinates of that law.
    """

    def __init__(self, latent: Latent, r: int, law: _Law, seen: Vector) -> None:
        self.law, self.scale, self.gap = law, latent.scale[r], latent.gap[r]
        self.weight, self.eigenvalue = latent.weight[r], float(latent.eigenvalue[r])
        self.sure, m = float(latent.sure[r]), len(law.within)
        every = np.hstack([latent.modal.rows, seen])
        self.gram, self.shape = every.T @ every, every.T @ latent.shape[r]
        self.n, self.usual = m, _errors(np.diag(self.gap), self.gram[:m, :m], self.shape[:m], self.sure)

    def shift(self, amplitude: float) -> float:
        """Return the change of the logarithm of the frequency, by Rayleigh's quotient."""
        _, (stiffness,) = self.law(np.array([amplitude]))
        return float(np.arcsinh(0.5 * self.weight @ stiffness @ self.weight / self.eigenvalue))

    def change(self, amplitude: Vector) -> Vector:
        """Return by how much errors differ from those without a change, (n, m)."""
        m = self.n
        yields, stiffness = self.law(amplitude)
        map_ = np.diag(self.gap) - stiffness / self.scale[:, None]
        cross = self.gram[:m, m:] @ yields
        gram = self.gram[:m, :m] + cross + cross.transpose(0, 2, 1)
        gram = gram + yields.transpose(0, 2, 1) @ self.gram[m:, m:] @ yields
        shape = self.shape[:m] + yields.transpose(0, 2, 1) @ self.shape[m:]
        return np.asarray(_errors(map_, gram, shape, self.sure) - self.usual)


class Change:
    """What one candidate does to the measured modes of the changed state."""

    def __init__(self, modes: Sequence[_Mode]) -> None:
        self.modes = modes

    def __call__(self, amplitude: Vector) -> Vector:
        """Return the change of all errors by amplitudes, (n, N)."""
        return np.hstack([mode.change(amplitude) for mode in self.modes])

    def shift(self, amplitude: float) -> Vector:
        """Return the changes of the logarithms of frequencies, (n_mode,)."""
        return np.array([mode.shift(amplitude) for mode in self.modes])


def _errors(map_: Vector, gram: Vector, shape: Vector, sure: float) -> Vector:
    """Return equation errors, (..., m), of the modal coordinates that a shape has."""
    prior = map_.swapaxes(-1, -2) @ map_ / WIDE**2 + np.eye(map_.shape[-1]) / _FARTHEST**2
    a = np.linalg.solve(gram * sure + prior, sure * shape[..., None])
    return np.asarray((map_ @ a)[..., 0] / np.linalg.norm(a, axis=-2))


def _bordered(matrix: Vector, border: Vector) -> Vector:
    """Return a matrix, (n, n), with further columns and rows, given as columns (n + k, k)."""
    n = len(matrix)
    return np.block([[matrix, border[:n]], [border[:n].T, border[n:]]])


def _matrices(parts: Sequence[Part]) -> list[tuple[Part, Vector]]:
    """Return what each part of one candidate adds for an amplitude of 1, as a matrix."""
    found = []
    for part in parts:
        row = sp.csr_array(part.weight)
        rows = part.rows[row.indices]
        flat = rows.reshape(-1, rows.shape[2])
        found.append((part, flat.T @ (np.repeat(part.sign * row.data, rows.shape[1])[:, None] * flat)))
    return found


def _tuned(parts: Sequence[tuple[Part, Vector]], ratio: float) -> list[tuple[Part, Vector]]:
    """Return parts whose resonances are at so many times their eigenvalues."""
    return [
        (part if part.resonance is None else replace(part, resonance=ratio * part.resonance), matrix)
        for part, matrix in parts
    ]


def _dynamic(parts: Sequence[tuple[Part, Vector]], eigenvalue: float) -> Vector:
    """Return dK - lambda dM at one measured mode."""
    total = np.zeros_like(parts[0][1])
    for part, matrix in parts:
        factor = -eigenvalue if part.target == "M" else 1.0
        if part.resonance is not None:
            factor *= float(apparent(np.array([eigenvalue]), part.resonance, least=_OFF)[0, 0])
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
    shift : (n_mode,) float
        Change of the logarithms of frequencies by the likeliest amplitude.
    fall : (n_size,) float
        By how much the best amplitude lowers the misfit.
    """

    index: int
    amplitude: Vector
    log: Vector
    shift: Vector
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
    scale = EFFECTS / effect
    most = min(kind.whole, candidates.upper, 4.0 * float(scale[-1]))
    each = [_weighed(index, change, scale, most, problems) for change in structure.changes(kind, candidates, index)]
    best = each[int(np.argmax([own.evidence[len(problems) // 2] for own in each]))]
    return replace(
        best,
        amplitude=np.concatenate([own.amplitude for own in each]),
        log=np.hstack([own.log for own in each]) - np.log(len(each)),
    )


def _weighed(
    index: int, change: Change, scale: Vector, most: float, problems: Sequence[tuple[Vector, Vector]]
) -> Refined:
    """Weigh what an amplitude does; its prior is half-normal at several scales, and it is at most `most`."""
    coarse = np.geomspace(0.02 * min(float(scale[0]), most), most, _N_COARSE)
    middle = len(problems) // 2
    moved_coarse = change(coarse)
    rough = _log_likelihood(moved_coarse, problems[middle])[0] + _log_prior(coarse, scale, most)
    top = int(np.argmax(rough))
    near = np.flatnonzero(rough > rough[top] - _DEEP)
    low, high = coarse[max(near[0] - 1, 0)], coarse[min(near[-1] + 1, _N_COARSE - 1)]
    close = np.linspace(low, high, _N_CLOSE)
    moved_close = change(close)
    best = close[int(np.argmax(_log_likelihood(moved_close, problems[middle])[0]))]
    step = close[1] - close[0]
    closest = np.linspace(max(best - 3.0 * step, low), min(best + 3.0 * step, high), _N_CLOSE)
    amplitude, which = np.unique(np.concatenate([coarse, close, closest]), return_index=True)
    moved = np.concatenate([moved_coarse, moved_close, change(closest)])[which]
    width = np.log(np.maximum(np.gradient(amplitude), 1e-300)) + _log_prior(amplitude, scale, most)
    found = [_log_likelihood(moved, problem) for problem in problems]
    log = np.array([log_likelihood + width for log_likelihood, _ in found])
    at = amplitude[int(np.argmax(log[middle] - width + _log_prior(amplitude, scale, most)))]
    return Refined(
        index=index,
        amplitude=amplitude,
        log=log,
        shift=change.shift(float(at)),
        fall=np.array([fall for _, fall in found]),
    )


def _log_likelihood(moved: Vector, problem: tuple[Vector, Vector]) -> tuple[Vector, float]:
    """Return the logarithm of the likelihood over that of no change, (n,), and the largest fall of the misfit.

    Parameters
    ----------
    moved : (n, N)
        Changes of the errors.
    problem : ((N,), (N, N))
        Errors without a change and the lower Cholesky factor of their covariance.
    """
    error, root = problem
    white = la.solve_triangular(root, np.column_stack([error, (error + moved).T]), lower=True, check_finite=False)
    misfit = np.sum(white**2, axis=0)
    return 0.5 * (misfit[0] - misfit[1:]), float(max(misfit[0] - misfit[1:].min(), 0.0))


def _log_prior(amplitude: Vector, scale: Vector, most: float) -> Vector:
    """Return the logarithm of the density of the prior, half-normal at several scales up to the largest amplitude."""
    each = -0.5 * (amplitude[:, None] / scale) ** 2 - np.log(scale * np.sqrt(2.0 * np.pi))
    within = np.log(np.maximum(np.exp(scipy.special.log_ndtr(most / scale)) - 0.5, 1e-300))
    return np.asarray(scipy.special.logsumexp(each - within, axis=1) - np.log(len(scale)))
