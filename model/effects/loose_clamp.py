"""Loose clamp: one of the clamps presses the stack less than the others, and its mass rides on a spring.

A bolt that was forgotten, that yielded, or that came loose by vibration. What presses less also touches less: the
clamp no longer moves as one with the sheets under it, but on the compliance c of its seat.

Enters: pressure p (1 - a f(x, y)), f a bell about that clamp, less its mean: the share 1 - b of one as wide as the cone
    of 30 degrees in which pressure spreads down to half the height, the share b of one of half the clamps' mean
    spacing, for clamps are as stiff as that where they press evenly. The clamp's mass m becomes the apparent mass
    m / (1 - omega^2 m c) of a rigid body on springs (Den Hartog, Mechanical Vibrations, 3.2), as it shifts and rocks.
    Clamps are numbered along the stack, evenly from 0 to 1; away from the number of a clamp both fade. Stiffness is
    affine in a, damping a polynomial of it; the clamp has modes of its own.
Range: a from 0 to 0.95 of the pressure lost at the clamp; b from 0 to 1; c from 0 to 100 nm/N; any clamp.
Does: at the nominal clamp, the second of four, lowers B2 by 9 to 10 %, T2 by 10 to 18 %, B1 by 3 % and T1 by 1.0 to
    1.4 %, and adds modes of the clamp on its seat; shapes lose their symmetry unless the clamp is in the middle. (Demo
    stack, nominal strength.)
Mistaken for: lost contact in the middle, pressure_along, clamps that are heavier than stated, an absorber.
"""

from __future__ import annotations

import itertools
from functools import partial
from typing import Any

import numpy as np

from lamella_shared import Reals
from model.effects.parts import Bell, clamp_bells, clamps_of, pressure_change, rigid_clamp
from model.elements.equations import Assembly, Riding, Term, Theta
from model.stack.effect import Effect, Parameter
from model.stack.errors import EffectError


def terms(assembly: Assembly) -> tuple[Term, ...]:
    """Return what each clamp takes from the pressure, and what its mass gains on a spring."""
    stack = assembly.stack
    clamps = sorted(clamps_of(assembly, "loose_clamp"), key=lambda clamp: (clamp.x, clamp.y))
    if len(clamps) < 2:
        raise EffectError("loose_clamp: a single clamp that presses less is a lower pressure")

    bells = (
        pressure_change(
            assembly,
            f"loose_clamp {i} {name}",
            "clamp_loss",
            partial(_lost, bell=bell),
            partial(share, i=i, n=len(clamps)),
        )
        for i, clamp in enumerate(clamps)
        for name, bell, share in zip(("narrow", "wide"), clamp_bells(stack, clamp), (_narrow, _wide), strict=True)
    )
    rides = (
        Term(
            name=f"loose_clamp {i} mass",
            target="M",
            factor=Riding(
                mass=clamp.mass,
                compliance=partial(_compliance, i=i, n=len(clamps)),
                share=partial(_share, i=i, n=len(clamps)),
            ),
            krons=rigid_clamp(assembly, clamp),
        )
        for i, clamp in enumerate(clamps)
        if clamp.mass > 0.0
    )
    return (*itertools.chain.from_iterable(bells), *rides)


def _lost(x: Reals, y: Reals, bell: Bell) -> Reals:
    """Return what is lost of the pressure, -1 in the middle of a bell."""
    return -bell(x, y)


def _share(t: Theta, i: int, n: int) -> Any:
    """Return the share of clamp i of n: 1 at its number, and 0 half a number away, without a kink."""
    away = t["clamp_number"] * (n - 1) - i
    return np.cos(np.pi * away) ** 2 if abs(np.real(away)) < 0.5 else 0.0 * away


def _narrow(t: Theta, i: int, n: int) -> Any:
    """Return the share of the narrow bell about clamp i of n."""
    return (1.0 - t["clamp_reach"]) * _share(t, i, n)


def _wide(t: Theta, i: int, n: int) -> Any:
    """Return the share of the wide bell about clamp i of n."""
    return t["clamp_reach"] * _share(t, i, n)


def _compliance(t: Theta, i: int, n: int) -> Any:
    """Return the compliance of the seat of clamp i of n, m/N: all of it but where next to nothing rides."""
    # Share of a clamp that is next to nothing: with less, its seat is rigid, so that other clamps add no modes.
    nothing = 0.02
    share = _share(t, i, n)
    return t["clamp_compliance"] * (1.0 + nothing) * share / (share + nothing)


EFFECT = Effect(
    name="loose_clamp",
    label="a loose clamp",
    family="pressure field",
    summary="One clamp that presses less and rides on its seat",
    description=__doc__,
    parameters=(
        Parameter(
            name="clamp_loss",
            unit="1",
            nominal=0.5,
            lower=0.0,
            upper=0.95,
            source="a from 0 to 0.95 of the pressure lost at the clamp",
        ),
        Parameter(
            name="clamp_number",
            unit="1",
            nominal=1.0 / 3.0,
            lower=0.0,
            upper=1.0,
            neutral=0.5,
            source="0 is the first clamp along the stack, 1 the last",
            n_start=12,
        ),
        Parameter(
            name="clamp_reach",
            unit="1",
            nominal=0.5,
            lower=0.0,
            upper=1.0,
            neutral=0.5,
            source="0 is the bell of a cone of 30 degrees, 1 that of a stiff clamp, half the clamps' mean spacing wide",
            n_start=1,
        ),
        Parameter(
            name="clamp_compliance",
            unit="m/N",
            nominal=1e-8,
            lower=0.0,
            upper=1e-7,
            source="c from 0 to 100 nm/N, assumed: from a rigid seat to one on which 1 kg resonates at 500 Hz",
        ),
    ),
    terms=terms,
    frequency_dependent=True,
)
