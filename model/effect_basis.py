"""What a reduced basis needs beside the modes of the base model, so that effects can be switched on in it.

For each term that an effect adds, the modes' first-order answer to it is taken: the displacements that its forces on
the modes cause. They make frequencies right to the third order of the strength, and for a stiff spring at a
place they are its attachment modes.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from model.solver import Solver
from model.stack import Stack
from model.system import Assembly, Term
from model.z_basis import N_RIGID, shear_shift

_EFFECTS_AT_ONCE = 8  # in one sample of the modes over z
_ENERGY = 1e-5  # of a mode: an answer with less is left out; a frequency misses half of it


def effect_samples(stack: Stack, theta: Mapping[str, float]) -> list[dict[str, float]]:
    """Return parameters at which the stack's effects act, several at a time, each with half of its nominal strength.

    At full strength several that soften the contact could together make it negative. Effects that ground the stack are
    not among them: they change no function of z, and the modes are sought beside those of rigid-body motion.
    """
    effects = [effect for effect in stack.effects if not effect.grounded]
    n_group = -(-len(effects) // _EFFECTS_AT_ONCE)
    return [
        {
            **theta,
            **{
                p.name: (p.nominal + p.neutral) / 2.0
                for effect in effects[i::n_group]
                for p in effect.parameters
            },
        }
        for i in range(n_group)
    ]


def effect_answers(
    assembly: Assembly, solver: Solver, theta: Mapping[str, float], basis: NDArray[np.float64], n_mode: int
) -> NDArray[np.float64]:
    """Return the displacements by which the modes at `theta` answer to the effects' terms at their full strength.

    Parameters
    ----------
    assembly : Assembly
        Equations of motion after reduction over z.
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
    if not stack.effects:
        return np.empty((assembly.size, 0))
    stiffness, mass = (basis.T @ assembly.apply(assembly.krons(t, theta), basis) for t in ("K", "M"))
    values, vectors = la.eigh((stiffness + stiffness.T) / 2.0, (mass + mass.T) / 2.0)
    values, modes = values[N_RIGID:n_mode], basis @ vectors[:, N_RIGID:n_mode]
    factor = solver.factor(theta, shear_shift(stack, theta))
    unit_energy = modes / np.sqrt(values)
    answers, seen = [], set()
    for term, strength in _strengths(assembly, theta):
        if id(term.krons) in seen:
            continue
        seen.add(id(term.krons))
        force = assembly.apply(term.krons, unit_energy) * (values if term.target == "M" else 1.0)
        answers.append(factor.solve(strength * force))
    if not answers:
        return np.empty((assembly.size, 0))
    together = np.hstack(answers)
    gram = together.T @ assembly.apply(assembly.krons("K", theta), together)
    energy, principal = la.eigh((gram + gram.T) / 2.0)
    return np.asarray(together @ principal[:, energy > _ENERGY])


def _strengths(assembly: Assembly, theta: Mapping[str, float]) -> list[tuple[Term, float]]:
    """Return the mass and stiffness terms that effects can switch on, with the largest factor that they can have."""
    corners = [
        {**theta, **dict(zip([p.name for p in effect.parameters], corner, strict=True))}
        for effect in assembly.stack.effects
        for corner in itertools.product(*((p.lower, p.nominal, p.upper) for p in effect.parameters))
    ]
    found = []
    for term in assembly.terms:
        if term.target != "C":
            at = np.array([term.factor(corner) for corner in corners])
            if np.ptp(at) > 0.0:
                found.append((term, float(np.abs(at - term.factor(theta)).max())))
    return found
