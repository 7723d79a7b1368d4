"""The reduced model of a stack with all effects that it can have: what every explanation is computed with."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from ema.modes import ModalModel
from model import (
    Effect,
    EffectError,
    Instruments,
    ReducedSystem,
    Stack,
    assemble,
    reduce,
    shared_parameters,
)

G_F_RANGE = (300.0, 6000.0)
"""Contact stiffness parameters, Pa/Pa, for which the model is reduced: three times beyond Table 6 of the paper."""
N_SNAPSHOT = 4
N_MODEL = 20
"""Modes, rigid-body modes included, that the reduced model is made for."""


@dataclass(frozen=True, eq=False, kw_only=True)
class CandidateModel:
    """The reduced model of a stack with all effects that it can have.

    Attributes
    ----------
    stack : Stack
        Without effects.
    system : ReducedSystem
        With all of them, neutral.
    effects : mapping of str to Effect
        Those that this stack can have.
    impossible : mapping of str to str
        Why the others cannot be.
    """

    stack: Stack
    system: ReducedSystem
    effects: Mapping[str, Effect]
    impossible: Mapping[str, str]


def candidate_model(
    stack: Stack, instruments: Instruments, effects: Mapping[str, Effect], aids: Sequence[Effect] = ()
) -> CandidateModel:
    """Reduce the model of a stack so that it holds for all effects that the stack can have.

    Parameters
    ----------
    stack : Stack
        Of the stack file.
    instruments : Instruments
        Where the test's instruments touch it.
    effects : mapping of str to Effect
        What to consider.
    aids : sequence of Effect
        What further tests could do to the stack; the reduction holds for them too.
    """
    base = replace(stack, instruments=instruments)
    small = assemble(replace(base, mesh=replace(base.mesh, n_x=2, n_y=1)))
    possible, impossible = {}, {}
    for name, effect in effects.items():
        try:
            effect.terms(small)
            possible[name] = effect
        except EffectError as error:
            impossible[name] = str(error)
    sampled = {p.name: (p.lower, p.upper) for p in shared_parameters(possible.values()).values() if p.sampled}
    system = reduce(
        base.with_effects(*possible.values(), *aids),
        G_f_range=G_F_RANGE,
        n_snapshot=N_SNAPSHOT * (1 + len(sampled)),
        n_mode=N_MODEL,
        ranges=sampled,
    )
    return CandidateModel(stack=base, system=system, effects=possible, impossible=impossible)


def instruments_of(modes: ModalModel) -> Instruments:
    """Return where the instruments of a test touched the stack."""
    place = {int(n): i for i, n in enumerate(modes.geometry.node)}
    x, y, z = modes.geometry.coordinate[place[int(modes.input.node[0])]]
    sensor = modes.geometry.coordinate[[place[int(n)] for n in modes.node]]
    return Instruments(shaker=(float(x), float(y), float(z)), sensor=sensor)
