"""What a reduced basis needs beside the modes of the base model, so that effects can be switched on in it.

For each term that an effect adds, the modes' first-order answer to it is taken: the displacements that its forces on
the modes cause. They make frequencies right to the third order of the strength, and for a stiff spring at a
place they are its attachment modes.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from model.elements.equations import Assembly, Kron, Term, ratio
from model.reduction.through_thickness import FREE, n_rigid, shear_shift
from model.solvers.low_rank import Factor
from model.stack.effect import Effect


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
    share = 0.75  # of its nominal strength, that an effect has in these samples
    effects_at_once = 8  # in one sample of the modes over z
    effects = [effect for effect in assembly.stack.effects if not effect.grounded]
    names = shaping(assembly, (p.name for effect in effects for p in effect.parameters))
    effects = [effect for effect in effects if any(p.name in names for p in effect.parameters)]
    n_group = -(-len(effects) // effects_at_once)
    return [
        {
            **theta,
            **{
                p.name: p.neutral + share * (p.nominal - p.neutral)
                for effect in effects[i::n_group]
                for p in effect.parameters
            },
        }
        for i in range(n_group)
    ]


def elastic_modes(
    assembly: Assembly, theta: Mapping[str, float], basis: NDArray[np.float64], n_mode: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the elastic ones of the first `n_mode` modes at `theta` in the span of a basis that holds them.

    Returns
    -------
    (n,) float
        Squared angular frequencies, (rad/s)**2.
    (assembly.size, n) float
        Modes of unit mass.
    """
    stiffness, mass = (basis.T @ assembly.apply(assembly.krons(t, theta), basis) for t in ("K", "M"))
    values, vectors = la.eigh((stiffness + stiffness.T) / 2.0, (mass + mass.T) / 2.0)
    elastic = np.arange(n_rigid(assembly.stack), min(n_mode, values.size))
    elastic = elastic[values[elastic] > FREE * shear_shift(assembly.stack, theta)]
    return values[elastic], basis @ vectors[:, elastic]


def effect_answers(
    assembly: Assembly,
    effects: Sequence[Effect],
    factor: Factor,
    theta: Mapping[str, float],
    modes: tuple[NDArray[np.float64], NDArray[np.float64]],
) -> NDArray[np.float64]:
    """Return the displacements by which the modes at `theta` answer to the effects' terms at their full strength.

    Parameters
    ----------
    assembly : Assembly
        Equations of motion after reduction over z.
    effects : sequence of Effect
        Those of its stack's that are meant.
    factor : Factor
        Of K + shift M at `theta`, the shift being `shear_shift`.
    theta : mapping of str to float
        Parameters of the modes.
    modes : (n,) and (assembly.size, n) float
        Those of `elastic_modes` there.

    Returns
    -------
    (assembly.size, n_answer)
        The principal ones of all answers, by energy.
    """
    least_energy = 3e-4  # of a mode, at full strength: an answer with less is left out; a frequency misses half of it
    values, unit_energy = modes[0], modes[1] / np.sqrt(modes[0])
    acting: dict[int, tuple[Term, float]] = {}
    for term, strength in _strengths(assembly, effects, theta):
        acting.setdefault(id(term.krons), (term, strength))
    if not acting:
        return np.empty((assembly.size, 0))
    felt = [
        _felt(strength * assembly.apply(term.krons, unit_energy) * (values if term.target == "M" else 1.0))
        for term, strength in acting.values()
    ]
    ends = np.cumsum([0, *(force.shape[1] for _, force in felt)])
    forces = np.zeros((assembly.size, ends[-1]))
    for (row, force), start, end in zip(felt, ends[:-1], ends[1:], strict=True):
        forces[row, start:end] = force
    answer = factor.solve(forces)
    # The work of each force on each answer is the energy of the answers, and symmetric: half of it will do.
    works = np.zeros((ends[-1], ends[-1]))
    for (row, force), start, end in zip(felt, ends[:-1], ends[1:], strict=True):
        works[start:end, :end] = force.T @ answer[row, :end]
    energy, principal = la.eigh(works, lower=True)
    return np.asarray(answer @ principal[:, energy > least_energy])


def _felt(force: NDArray[np.float64], least: float = 1e-4) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """Return where forces act, and their principal ones there that are no smaller than a share of the largest."""
    row = np.flatnonzero(force.any(axis=1))
    direction, size, _ = la.svd(force[row], full_matrices=False)
    kept = size > least * size.max(initial=0.0)
    return row, direction[:, kept] * size[kept]


def second_answers(
    assembly: Assembly,
    effects: Sequence[Effect],
    factor: Factor,
    theta: Mapping[str, float],
    modes: tuple[NDArray[np.float64], NDArray[np.float64]],
    basis: NDArray[np.float64],
    least: float = 3e-5,
) -> NDArray[np.float64]:
    """Return what effects of their nominal strength answer to their first answers, where it is not small.

    With first answers alone the frequencies of a stack that has lost half of its contact in waves were off by 0.1 %,
    with second ones by 0.015 %. Where nearly all is lost, neither does.

    Parameters
    ----------
    assembly, effects, factor, theta, modes
        As in `effect_answers`.
    basis : (assembly.size, n)
        Whose span holds the modes, and the first answers.
    least : float
        Energy, of a mode's, below which an answer is left out; a frequency misses half of it.

    Returns
    -------
    (assembly.size, n_answer)
        The principal ones beside the basis, by energy.
    """
    changes = []
    for effect in effects:
        at = {**theta, **{p.name: p.nominal for p in effect.parameters}}
        by = [(t, t.factor(at) - t.factor(theta)) for t in assembly.terms if t.target == "K"]
        changes.append([(term.krons, share) for term, share in by if share])
    changes = [change for change in changes if change]
    if not changes:
        return np.empty((assembly.size, 0))

    def forces(change: Sequence[tuple[tuple[Kron, ...], float]], x: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(sum(share * assembly.apply(krons, x) for krons, share in change))

    unit_energy = modes[1] / np.sqrt(modes[0])
    force = [forces(change, unit_energy) for change in changes]
    first = np.split(factor.solve(np.hstack(force)), len(changes), axis=1)
    strong = [
        forces(change, answer)
        for change, pull, answer in zip(changes, force, first, strict=True)
        if la.eigvalsh(pull.T @ answer)[-1] ** 2 > least
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
    assembly: Assembly, effects: Sequence[Effect], factor: Factor, modes: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return what a stack answers to forces where effects act, and to the inertia of these answers.

    However strong a part is that acts at few places, the modes with it are answers to forces at these (Craig and
    Chang, AIAA J. 14, 1976); the answers to their inertia make a Krylov space, which holds for all frequencies.

    Parameters
    ----------
    assembly : Assembly
        Equations of motion after reduction over z.
    effects : sequence of Effect
        Those that act at few places.
    factor : Factor
        Of K + shift M where these effects do not act.
    modes : (assembly.size, n) float
        Modes there, on which the effects' forces are looked at.

    Returns
    -------
    (assembly.size, n_answer)
    """
    depth = 2  # answers to forces and to the inertia of these: what modes far above add is small then
    rank = 1e-8  # singular values below this share of the largest are rounding
    names = frozenset(p.name for effect in effects for p in effect.parameters)
    acting = {id(t.krons): t.krons for t in assembly.terms if t.factor.names(assembly.theta) & names}
    if not acting:
        return np.empty((assembly.size, 0))
    # Of each term alone first: they differ in size, and several act at the same places.
    each = [la.orth(assembly.apply(krons, modes), rank) for krons in acting.values()]
    force = la.orth(np.hstack(each), rank)
    mass, answers = assembly.krons("M", assembly.theta), list[NDArray[np.float64]]()
    for _ in range(depth):
        answers.append(factor.solve(force))
        force = assembly.apply(mass, answers[-1])
    return np.hstack(answers)


def _strengths(assembly: Assembly, effects: Sequence[Effect], theta: Mapping[str, float]) -> list[tuple[Term, float]]:
    """Return the mass and stiffness terms that effects can switch on, with the largest factor that they can have."""
    n_trial = 21  # over a range of which some terms act over a part alone
    corners = [{**theta, **corner} for effect in effects for corner in effect.combinations(lambda p: p.trials(n_trial))]
    found = []
    for term in assembly.terms:
        if term.target != "C":
            at = np.array([term.factor(corner) for corner in corners])
            if np.ptp(at) > 0.0:
                found.append((term, float(np.abs(at - term.factor(theta)).max())))
    return found
