"""The reduced model of a stack with all effects that it can have: what every explanation is computed with."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ema.modes import ModalModel
from model import (
    Effect,
    EffectError,
    Instruments,
    Parameter,
    ReducedSystem,
    Stack,
    assemble,
    enriched,
    reduce,
    truncated,
)

G_F_RANGE = (300.0, 6000.0)
"""Contact stiffness parameters, Pa/Pa, for which the model is reduced: three times beyond Table 6 of the paper."""
N_SNAPSHOT = 4
N_MODEL = 20
"""Modes, rigid-body modes included, that the reduced model is made for."""
DIMENSIONS = ("length", "width", "height")
RESIZED = 1e-3
"""Relative change of a dimension from which its influence is taken."""
_PLACES = 11
_TRUNCATED = 0.06  # amplitude of a direction that modes need no more: errors of frequency are below 1e-4


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
    resized : mapping of str to ReducedSystem
        The stack without effects with one dimension larger by `RESIZED`.
    """

    stack: Stack
    system: ReducedSystem
    effects: Mapping[str, Effect]
    impossible: Mapping[str, str]
    resized: Mapping[str, ReducedSystem]


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
    system = reduce(
        base.with_effects(*possible.values(), *aids),
        G_f_range=G_F_RANGE,
        n_snapshot=N_SNAPSHOT,
        n_mode=N_MODEL,
    )
    sampled = [effect for effect in possible.values() if any(p.sampled for p in effect.parameters)]
    system = enriched(system, [at for effect in sampled for at in effect.combinations(_inside)], N_MODEL)
    system = truncated(system, _corners(possible.values()), N_MODEL, _TRUNCATED)
    return CandidateModel(
        stack=base,
        system=system,
        effects=possible,
        impossible=impossible,
        resized={
            name: reduce(
                replace(base, **{name: (1.0 + RESIZED) * getattr(base, name)}),
                G_f_range=G_F_RANGE,
                n_snapshot=N_SNAPSHOT,
                n_mode=N_MODEL,
            )
            for name in (DIMENSIONS if base.outline is None else ("height",))
        },
    )


def instruments_of(modes: ModalModel) -> Instruments:
    """Return where the instruments of a test touched the stack."""
    place = {int(n): i for i, n in enumerate(modes.geometry.node)}
    x, y, z = modes.geometry.coordinate[place[int(modes.input.node[0])]]
    sensor = modes.geometry.coordinate[[place[int(n)] for n in modes.node]]
    return Instruments(shaker=(float(x), float(y), float(z)), sensor=sensor)


def _inside(parameter: Parameter) -> tuple[float, ...]:
    """Return values of a parameter for which the model is made: several where it is sampled, else a typical one."""
    if not parameter.sampled:
        return (parameter.nominal,)
    span = parameter.upper - parameter.lower
    return tuple(parameter.lower + share * span for share in (1 / 6, 1 / 2, 5 / 6))


def _corners(effects: Iterable[Effect]) -> Iterator[dict[str, float]]:
    """Return parameters with one effect at a time over its range, each at two contact stiffnesses."""
    stiffness = np.geomspace(*G_F_RANGE, 6)
    for i, effect in enumerate(effects):
        for j, corner in enumerate(effect.combinations(lambda p: p.trials(_PLACES))):
            for G_f in stiffness[(i + j) % 3 :: 3]:
                yield {"G_f": float(G_f), **corner}
