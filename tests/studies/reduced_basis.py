"""How exact the basis of a diagnosis is: frequencies with an effect in it, against the plan that was not reduced."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from model import Effect, catalogue, read_stack
from model.effects.parts import known_or_usual_instruments
from model.modes.modes import reduced_eigenpairs
from model.reduction.through_thickness import N_RIGID, shear_shift
from model.solvers.stack_solver import solver_over_plan
from tests.studies.runner import DATA, study
from updating.diagnosis.cached_model import cached_model
from updating.diagnosis.candidates import N_MODEL, CandidateModel
from updating.diagnosis.experiment import aids

STRENGTHS = (1.0, 1.6, 95.0)
"""Over the nominal one; none beyond 95 % of the largest that an effect may have."""
STIFFNESSES = (700.0, 2200.0)
N_MODE = 9
"""Elastic modes that are compared: as many as the shipped tests measure."""
_TOLERANCE = 1e-7  # relative, of the exact eigenvalues
_STEPS = 3


@dataclass(frozen=True, kw_only=True)
class BasisCase:
    """The largest relative error of a frequency in the basis of a diagnosis."""

    effect: str
    strength: float
    G_f: float
    error: float


def planned() -> list[tuple[str, float, float]]:
    """Return effects that stacks can have, their strengths and contact stiffnesses, Pa/Pa."""
    return [(name, strength, G_f) for strength in STRENGTHS for name in candidates().effects for G_f in STIFFNESSES]


@cache
def candidates() -> CandidateModel:
    """Return the model of the shipped stack with a hidden effect, as a diagnosis reduces it."""
    stack = read_stack(DATA / "hidden_effect" / "stack.toml")
    return cached_model(stack, known_or_usual_instruments(stack), catalogue(), aids())


def at_strength(effect: Effect, strength: float) -> dict[str, float]:
    """Return an effect's parameters at a strength over the nominal one, its location being the nominal one.

    Clamps sit rigidly: on a compliant seat they have modes in the basis, but an apparent mass at one frequency here.
    """
    found = {}
    for p in effect.parameters:
        value = p.nominal if p.is_location else p.neutral + strength * (p.nominal - p.neutral)
        found[p.name] = 0.0 if p.name == "clamp_compliance" else float(np.clip(value, 0.95 * p.lower, 0.95 * p.upper))
    return found


def run(name: str, strength: float, G_f: float) -> BasisCase:
    """Solve the modes in the basis, and from these those of all of the plan."""
    system = candidates().system
    theta = {**system.theta, "G_f": G_f, **at_strength(candidates().effects[name], strength)}
    with threadpool_limits(1):
        value, vector, _ = reduced_eigenpairs(system, theta, N_MODEL)
        solver = solver_over_plan(system.assembly.acting([theta]))
        exact, _ = solver.modes(
            theta,
            shear_shift(system.stack, theta),
            system.basis @ vector[:, N_RIGID:N_MODEL],
            N_MODEL,
            _TOLERANCE,
            system.basis[:, :N_RIGID],
            _STEPS,
        )
    elastic = slice(N_RIGID, N_RIGID + N_MODE)
    error = float(np.max(np.abs(np.sqrt(value[elastic] / exact[elastic]) - 1.0)))
    return BasisCase(effect=name, strength=strength, G_f=G_f, error=error)


def study_of(n: int, record: Path) -> list[BasisCase]:
    """Run the first n cases, or go on with them."""
    show = partial(print, flush=True)
    return study(planned()[:n], run, record, BasisCase, lambda c: (c.effect, c.strength, c.G_f), say=show)


def rows(cases: list[BasisCase]) -> list[str]:
    """Return for each strength the median and the largest error, and of which effect that is."""
    found = []
    for strength in STRENGTHS:
        one = [c for c in cases if c.strength == strength]
        if one:
            worst = max(one, key=lambda c: c.error)
            middle = float(np.median([c.error for c in one]))
            found.append(
                f"| strength {strength:g} | {len(one)} cases | median {100 * middle:.2g} % | "
                f"largest {100 * worst.error:.2g} % ({worst.effect} at G_f {worst.G_f:g}) |"
            )
    return found
