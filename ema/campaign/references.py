"""Which state of a campaign is compared with which: references, repeats, and the scatter that reassembly brings."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

from ema.io.form import did_you_mean

FREQUENCY_SCATTER = 3e-3
DAMPING_SCATTER = 0.2
SHAPE_SCATTER = 2e-2
"""Relative standard deviations of a state that is assembled and measured anew, where the campaign states none. Bolted
structures change by 0.1 to 0.5 % of a frequency and by 5 to 30 % of a damping ratio; a cantilever plate that was
clamped anew moved by up to 0.4 %. Sensors that are put back are off by about 1 % in gain and 1 to 2 mm in place,
which is 2 % of a shape's length."""


@dataclass(frozen=True, kw_only=True)
class Reassembly:
    """Standard deviations between two assemblies of one and the same structure.

    Attributes
    ----------
    frequency, damping : float
        Relative ones of natural frequencies and of damping ratios.
    shape : float
        Of a shape, over its length.
    """

    frequency: float = FREQUENCY_SCATTER
    damping: float = DAMPING_SCATTER
    shape: float = SHAPE_SCATTER


class State(Protocol):
    """What may name a reference: a configuration or a specimen."""

    @property
    def name(self) -> str:
        """Unique among those that may be named."""

    @property
    def compare_to(self) -> tuple[str, ...]:
        """Names of the reference and its repeats; empty where the state has none."""

    @property
    def repeat_of(self) -> str | None:
        """Name of the state that this one measures again."""


def reference_faults(states: Sequence[State]) -> Iterator[str]:
    """Say what is wrong with the references and repeats of states, as "'NAME': key: what is wrong".

    A name may be unknown, or that of the state itself or of its repeat, and references may go round.
    """
    by_name = {own.name: own for own in states}
    for own in states:
        named = [("compare_to", name) for name in own.compare_to]
        named += [] if own.repeat_of is None else [("repeat_of", own.repeat_of)]
        for key, name in named:
            if name == own.name:
                yield f"{own.name!r}: {key}: names itself; name another state"
            elif name not in by_name:
                yield f"{own.name!r}: {key}: no {name!r}; {did_you_mean(name, list(by_name))}"
            elif key == "compare_to" and by_name[name].repeat_of == own.name:
                yield f"{own.name!r}: compare_to: {name!r} is a repeat of it, not a reference"
            elif key == "repeat_of":
                yield from _faults_of_repeat(own, by_name[name])
        if len(set(own.compare_to)) < len(own.compare_to):
            yield f"{own.name!r}: compare_to: names one state twice: {', '.join(own.compare_to)}"
    way = _circle(by_name)
    if len(way) > 2:  # one that names itself is said above
        yield f"{way[0]!r}: compare_to: goes round: {' -> '.join(way)}; one of them needs no reference"


def _faults_of_repeat(own: State, first: State) -> Iterator[str]:
    """Check a repeat, which has its reference from the state that it repeats."""
    if own.compare_to:
        yield f"{own.name!r}: a repeat has the reference of what it repeats: move compare_to to {first.name!r}"
    if first.repeat_of is not None:
        yield f"{own.name!r}: repeat_of: {first.name!r} is a repeat itself; name what it repeats: {first.repeat_of!r}"


def repeats_of(states: Sequence[State], names: Sequence[str]) -> tuple[str, ...]:
    """Return names followed by those of the states that repeat one of them, each once."""
    again = (own.name for own in states if own.repeat_of in names)
    return tuple(dict.fromkeys((*names, *again)))


def _circle(by_name: Mapping[str, State]) -> list[str]:
    """Return the names of a circle of references, none where there is none."""
    done: set[str] = set()

    def follow(name: str, way: list[str]) -> list[str]:
        if name in way:
            return [*way[way.index(name) :], name]
        if name in done:
            return []
        done.add(name)
        ways = (follow(other, [*way, name]) for other in by_name[name].compare_to if other in by_name)
        return next((found for found in ways if found), [])

    return next((found for found in (follow(name, []) for name in by_name) if found), [])
