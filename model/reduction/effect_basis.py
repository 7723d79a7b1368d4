"""What a reduced basis needs beside the modes of the base model, so that effects can be switched on in it.

For each term that an effect adds, the modes' first-order answer to it is taken: the displacements that its forces on
the modes cause. They make frequencies right to the third order of the strength, and for a stiff spring at a
place they are its attachment modes.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from model.elements.equations import Assembly, Kron, Term, ratio
from model.reduction.through_thickness import FREE, n_rigid, shear_shift
from model.solvers.low_rank import Factor
from model.solvers.stack_solver import Solver
from model.stack.effect import Effect

_EFFECTS_AT_ONCE = 8  # in one sample of the modes over z
_SHARE = 0.75  # of its nominal strength, that an effect has in these samples
_N_TRIAL = 21  # over a range of which some terms act over a part alone
_ENERGY = 3e-4  # of a mode, at full strength: an answer with less is left out; a frequency misses half of it
_RANK = 1e-8  # singular values below this share of the largest are rounding
_DEPTH = 2  # answers to forces, and to the inertia of these: what modes far above the measured ones add is small then


def shaping(assembly: Assembly, names: Iterable[str]) -> frozenset[str]:
    """Return those parameters on which stiffness depends in a way of its own over z.

    Others only change shapes over the plan, which the through-thickness functions hardly feel: masses, and contact that
    changes over the plan alone.

    Parameters
    ----------
    assembly : Assembly
        Equations of motion of all laminas.
    names : iterable of str
        The parameters in question.
    """
    names, theta = frozenset(names), assembly.theta
    used = [(term, term.factor.names(theta) & names) for term in assembly.terms if term.target == "K"]
    base = [kron for term, found in used if not found for kron in term.krons]

    def is_new(kron: Kron) -> bool:
        return not any((kron.row, kron.column) == (b.row, b.column) and ratio(kron.z, b.z) for b in base)

    return frozenset().union(*(found for term, found in used if any(is_new(kron) for kron in term.krons)))


def effect_samples(assembly: Assembly, theta: Mapping[str, float]) -> list[dict[str, float]]:
    """Return parameters at which effects act that shape the through-thickness functions, each with 3/4 of its strength.

    At full strength several that soften the contact could together make it negative. Effects that ground the stack are
    not among them: the modes are sought beside those of rigid-body motion.
    """
    effects = [effect for effect in assembly.stack.effects if not effect.grounded]
    own = shaping(assembly, (p.name for effect in effects for p in effect.parameters))
    effects = [effect for effect in effects if any(p.name in own for p in effect.parameters)]
    n_group = -(-len(effects) // _EFFECTS_AT_ONCE)
    return [
        {
            **theta,
            **{
                p.name: p.neutral + _SHARE * (p.nominal - p.neutral)
                for effect in effects[i::n_group]
                for p in effect.parameters
            },
        }
        for i in range(n_group)
    ]


def effect_answers(
    assembly: Assembly,
    effects: Sequence[Effect],
    solver: Solver,
    theta: Mapping[str, float],
    basis: NDArray[np.float64],
    n_mode: int,
) -> NDArray[np.float64]:
    """Return the displacements by which the modes at `theta` answer to the effects' terms at their full strength.

    Parameters
    ----------
    assembly : Assembly
        Equations of motion after reduction over z.
    effects : sequence of Effect
        Those of its stack's that are meant.
    solver : Solver
        Of the terms that act at `theta`.
    theta : mapping of str to float
        Parameters of the modes.
    basis : (assembly.size, n)
        Whose span holds these modes; the rigid-body modes come first.
    n_mode : int
        Number of modes, rigid-body ones included.

    Returns
    -------
    (assembly.size, n_answer)
        The principal ones of all answers, by energy.
    """
    if not effects:
        return np.empty((assembly.size, 0))
    values, modes = _modes(assembly, theta, basis, n_mode)
    factor = solver.factor(theta, shear_shift(assembly.stack, theta))
    unit_energy = modes / np.sqrt(values)
    acting: dict[int, tuple[Term, float]] = {}
    for term, strength in _strengths(assembly, effects, theta):
        acting.setdefault(id(term.krons), (term, strength))
    if not acting:
        return np.empty((assembly.size, 0))
    forces = [
        _Forces.of(
            strength * assembly.apply(term.krons, unit_energy) * (values if term.target == "M" else 1.0)
        )
        for term, strength in acting.values()
    ]
    answer = factor.solve(np.hstack([own.full(assembly.size) for own in forces]))
    energy, principal = la.eigh(_works(forces, answer))
    return np.asarray(answer @ principal[:, energy > _ENERGY])


def second_answers(
    assembly: Assembly,
    effects: Sequence[Effect],
    factor: Factor,
    theta: Mapping[str, float],
    basis: NDArray[np.float64],
    n_mode: int,
    least: float = 3e-5,
) -> NDArray[np.float64]:
    """Return what effects of their nominal strength answer to their first answers, where that is no more small.

    Contact that half an interface has lost is no small change: with first answers alone, frequencies are right to 0.1 %
    there and to 10 % where nearly all is lost. With second ones they are right to the fifth order of the strength.

    Parameters
    ----------
    assembly, effects, theta, n_mode
        As in `effect_answers`.
    factor : Factor
        Of K + shift M at `theta`.
    basis : (assembly.size, n)
        Whose span holds the modes there, and the first answers.
    least : float
        Energy, of a mode's, below which an answer is left out; a frequency misses half of it.

    Returns
    -------
    (assembly.size, n_answer)
        The principal ones beside the basis, by energy.
    """
    values, modes = _modes(assembly, theta, basis, n_mode)
    changes = []
    for effect in effects:
        at = {**theta, **{p.name: p.nominal for p in effect.parameters}}
        by = [(t, t.factor(at) - t.factor(theta)) for t in assembly.terms if t.target == "K"]
        changes.append([(term.krons, share) for term, share in by if share])
    changes = [change for change in changes if change]
    if not changes:
        return np.empty((assembly.size, 0))

    def forces(
        change: Sequence[tuple[tuple[Kron, ...], float]], x: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        return np.asarray(sum(share * assembly.apply(krons, x) for krons, share in change))

    unit_energy = modes / np.sqrt(values)
    force = [forces(change, unit_energy) for change in changes]
    first = np.split(factor.solve(np.hstack(force)), len(changes), axis=1)
    strong = [
        forces(change, answer)
        for change, own, answer in zip(changes, force, first, strict=True)
        if la.eigvalsh(own.T @ answer)[-1] ** 2 > least
    ]
    if not strong:
        return np.empty((assembly.size, 0))
    acting = np.hstack(strong)
    answer = factor.solve(acting)
    held = assembly.apply(assembly.krons("K", theta), basis)
    held += shear_shift(assembly.stack, theta) * assembly.apply(assembly.krons("M", theta), basis)
    known = la.solve(basis.T @ held, basis.T @ acting, assume_a="pos")
    energy, principal = la.eigh(answer.T @ acting - acting.T @ basis @ known)
    return np.asarray((answer - basis @ known) @ principal[:, energy > least])


def attachment_answers(
    assembly: Assembly,
    effects: Sequence[Effect],
    factor: Factor,
    theta: Mapping[str, float],
    basis: NDArray[np.float64],
    n_mode: int,
) -> NDArray[np.float64]:
    """Return what the stack at `theta` answers to forces where effects act, and to the inertia of these answers.

    However strong a part is that acts at few places, the modes with it are answers to forces at these (Craig and
    Chang, AIAA J. 14, 1976); the answers to their inertia make a Krylov space, which holds for all frequencies.

    Parameters
    ----------
    assembly : Assembly
        Equations of motion after reduction over z.
    effects : sequence of Effect
        Those that act at few places.
    factor : Factor
        Of K + shift M at `theta`.
    theta : mapping of str to float
        Parameters, at which these effects do not act.
    basis : (assembly.size, n)
        Whose span holds the modes there; the rigid-body modes come first.
    n_mode : int
        Number of modes, rigid-body ones included, on which the effects' forces are looked at.

    Returns
    -------
    (assembly.size, n_answer)
    """
    own = frozenset(p.name for effect in effects for p in effect.parameters)
    modes = _modes(assembly, theta, basis, n_mode)[1]
    acting = {id(t.krons): t.krons for t in assembly.terms if t.factor.names(assembly.theta) & own}
    if not acting:
        return np.empty((assembly.size, 0))
    forces = [
        _Forces.of(assembly.apply(krons, modes), _RANK).full(assembly.size) for krons in acting.values()
    ]
    force = la.orth(np.hstack(forces), _RANK)  # several terms act at the same places
    mass, answers = assembly.krons("M", assembly.theta), list[NDArray[np.float64]]()
    for _ in range(_DEPTH):
        answers.append(factor.solve(force))
        force = assembly.apply(mass, answers[-1])
    return np.hstack(answers)


def _modes(
    assembly: Assembly, theta: Mapping[str, float], basis: NDArray[np.float64], n_mode: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the elastic modes at `theta` in the span of a basis: eigenvalues and vectors, (assembly.size, n)."""
    stiffness, mass = (basis.T @ assembly.apply(assembly.krons(t, theta), basis) for t in ("K", "M"))
    values, vectors = la.eigh((stiffness + stiffness.T) / 2.0, (mass + mass.T) / 2.0)
    elastic = np.arange(n_rigid(assembly.stack), min(n_mode, values.size))
    elastic = elastic[values[elastic] > FREE * shear_shift(assembly.stack, theta)]
    return values[elastic], basis @ vectors[:, elastic]


@dataclass(frozen=True, eq=False)
class _Forces:
    """Forces of a term on modes: their principal ones, where they act at all."""

    row: NDArray[np.intp]
    force: NDArray[np.float64]

    @classmethod
    def of(cls, force: NDArray[np.float64], least: float = 1e-4) -> _Forces:
        """Return the principal ones of forces, (size, n), that are no smaller than a share of the largest."""
        row = np.flatnonzero(force.any(axis=1))
        direction, size, _ = la.svd(force[row], full_matrices=False)
        kept = size > least * size.max(initial=0.0)
        return cls(row, direction[:, kept] * size[kept])

    def full(self, size: int) -> NDArray[np.float64]:
        """Return the forces at all degrees of freedom, (size, n)."""
        found = np.zeros((size, self.force.shape[1]))
        found[self.row] = self.force
        return found


def _works(forces: Sequence[_Forces], answer: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the work of each force on each answer, (n, n): it is the energy of the answers, and symmetric."""
    found, start = np.zeros((answer.shape[1], answer.shape[1])), 0
    for own in forces:
        end = start + own.force.shape[1]
        found[start:end, :end] = own.force.T @ answer[own.row, :end]
        start = end
    return np.asarray(np.tril(found) + np.tril(found, -1).T)


def _strengths(
    assembly: Assembly, effects: Sequence[Effect], theta: Mapping[str, float]
) -> list[tuple[Term, float]]:
    """Return the mass and stiffness terms that effects can switch on, with the largest factor that they can have."""
    corners = [
        {**theta, **corner}
        for effect in effects
        for corner in effect.combinations(lambda p: p.trials(_N_TRIAL))
    ]
    found = []
    for term in assembly.terms:
        if term.target != "C":
            at = np.array([term.factor(corner) for corner in corners])
            if np.ptp(at) > 0.0:
                found.append((term, float(np.abs(at - term.factor(theta)).max())))
    return found
