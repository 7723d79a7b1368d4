"""What a quality check says about one channel or the whole measurement."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

from ema.types.geometry import Dofs


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """Outcome of one quality check.

    Attributes
    ----------
    check : str
        What was checked: "not a number", "dead", "clipped", "scale", "sign", "swapped", "coherence", ...
    level : {"pass", "warn", "fail"}
        A channel with a "fail" is left out of the identification by `usable`.
    channel : tuple of int
        Positions of the outputs it is about; empty for the measurement as a whole.
    band : (float, float) or None
        Frequency band of the finding, Hz; None where it has none.
    message : str
        What was found, with its number, and what to do about it.
    force : tuple of int
        Positions of the inputs whose direction is stated the wrong way round; `usable` turns them.
    point : tuple of int
        Numbers of the points of those outputs, once `at_points` has looked them up: positions change when channels are
        left out.
    """

    check: str
    level: Literal["pass", "warn", "fail"]
    channel: tuple[int, ...]
    band: tuple[float, float] | None
    message: str
    force: tuple[int, ...] = ()
    point: tuple[int, ...] = ()


def at_points(verdicts: Sequence[Verdict], output: Dofs) -> tuple[Verdict, ...]:
    """Return verdicts with the points of the outputs that they are about, whose positions are those in `output`."""
    return tuple(replace(v, point=tuple(int(output.node[c]) for c in v.channel)) for v in verdicts)
