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
from model.solvers.stack_solver import Solver
from model.stack.effect import Effect

_EFFECTS_AT_ONCE = 8  # in one sample of the modes over z
_SHARE = 0.75  # of its nominal strength, that an effect has in these samples
_N_TRIAL = 21  # over a range of which some terms act over a part alone
_ENERGY = 1e-4  # of a mode, at full strength: an answer with less is left out; a frequency misses half of it


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
    stack = assembly.stack
    if not effects:
        return np.empty((assembly.size, 0))
    stiffness, mass = (basis.T @ assembly.apply(assembly.krons(t, theta), basis) for t in ("K", "M"))
    values, vectors = la.eigh((stiffness + stiffness.T) / 2.0, (mass + mass.T) / 2.0)
    shift = shear_shift(stack, theta)
    elastic = np.arange(n_rigid(stack), min(n_mode, values.size))
    elastic = elastic[values[elastic] > FREE * shift]
    values, modes = values[elastic], basis @ vectors[:, elastic]
    factor = solver.factor(theta, shift)
    unit_energy = modes / np.sqrt(values)
    acting: dict[int, tuple[Term, float]] = {}
    for term, strength in _strengths(assembly, effects, theta):
        acting.setdefault(id(term.krons), (term, strength))
    if not acting:
        return np.empty((assembly.size, 0))
    force = np.empty((assembly.size, len(acting) * values.size))
    for i, (term, strength) in enumerate(acting.values()):
        own = slice(i * values.size, (i + 1) * values.size)
        force[:, own] = assembly.apply(term.krons, unit_energy) * (values if term.target == "M" else 1.0)
        force[:, own] *= strength
    answer = factor.solve(force)
    gram = answer.T @ force  # the work of the forces is the energy of the answers
    energy, principal = la.eigh((gram + gram.T) / 2.0)
    return np.asarray(answer @ principal[:, energy > _ENERGY])


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
