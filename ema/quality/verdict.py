"""What a quality check says about one channel or the whole measurement."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


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
    """

    check: str
    level: Literal["pass", "warn", "fail"]
    channel: tuple[int, ...]
    band: tuple[float, float] | None
    message: str
    force: tuple[int, ...] = ()
