"""What a quality check says about one channel or the whole measurement, and what each check is called."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

from ema.types.frf import Dofs


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
    message: str
    channel: tuple[int, ...] = ()
    band: tuple[float, float] | None = None
    force: tuple[int, ...] = ()
    point: tuple[int, ...] = ()

    @property
    def finding(self) -> str:
        """What was found, behind how grave it is."""
        return f"{_GRAVITY[self.level]}{self.message}"

    @property
    def text(self) -> str:
        """The finding behind what the check is called."""
        return f"{label(self.check)}: {self.finding}"


_GRAVITY = {"pass": "", "warn": "warning: ", "fail": "failure: "}

NOTES = "What was odd in the files and how it was read, and whether runs differ from each other."
"""What notes on a measurement are, which no check makes."""


def listing(names: Sequence[str], most: int = 4, separator: str = ", ") -> str:
    """Return some names in one text, of many the first ones."""
    return separator.join(names[:most]) + (f"{separator}..." if len(names) > most else "")


def at_points(verdicts: Sequence[Verdict], output: Dofs) -> tuple[Verdict, ...]:
    """Return verdicts with the points of the outputs that they are about, whose positions are those in `output`."""
    return tuple(replace(v, point=tuple(int(output.node[c]) for c in v.channel)) for v in verdicts)


CHECKS = {
    "number": ("finite values", "A value that is not a number or infinite spoils every fit."),
    "axis": ("frequency axis", "Frequencies must rise in equal steps, the same for all functions."),
    "dead": ("responding sensors", "A sensor that gives nothing but noise, or a cable that is loose."),
    "clipped": ("no overload", "An amplifier that was overdriven cuts off what is above its range."),
    "copied": ("no copies", "Two channels with the same values: one file or cable was taken twice."),
    "states": ("one state", "All runs must be of one state of the structure: same torque, temperature, masses."),
    "unshared": ("shared resonances", "A channel whose resonances no other channel has measures something else."),
    "coherence": ("coherence", "Below 1 near a resonance, force and response hold noise or are not linear."),
    "driving point": (
        "power at the driving point",
        "Where force and response act at the same place, the force can only give power, never take it.",
    ),
    "force sign": ("sign of the force", "A force stated the wrong way round turns all functions of its input."),
    "sign": ("sign of the sensors", "A sensor that is mounted or stated the wrong way round turns its motion."),
    "scale": ("calibration", "A sensor whose size fits its neighbours only after multiplication has a wrong factor."),
    "swapped": ("places of the sensors", "Two channels, each of which fits the place of the other, are exchanged."),
    "unexplained": ("shapes", "A channel that no smooth shape through its neighbours explains."),
    "neighbours": ("agreement of neighbours", "Neighbouring points of a stiff body move nearly alike."),
    "reciprocity": ("reciprocity", "Force at A and response at B give the same function as the other way round."),
    "unit": ("unit of the functions", "Size and phase tell a receptance, a mobility and an accelerance apart."),
    "resolution": ("frequency resolution", "A resonance needs several lines across its half-power bandwidth."),
    "explained": ("explained power", "The share of the measured power that the identified modes make."),
    "peak": ("peaks without a mode", "A peak of many channels at which no mode was identified."),
    "complexity": ("real shapes", "Points of a lightly damped structure move in phase or against it."),
    "linearity": ("linearity", "Functions measured at several forces must be the same."),
}  # fmt: skip
"""Of each check, by its key in `Verdict.check`, its name and what it looks at."""


def label(check: str) -> str:
    """Return what a check is called."""
    return CHECKS.get(check, (check, ""))[0]


def meaning(check: str) -> str:
    """Return in one sentence what a check looks at; empty for one that is not listed."""
    return CHECKS.get(check, ("", ""))[1]
