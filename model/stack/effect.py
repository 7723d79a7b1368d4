"""What a physical effect is: a few parameters and the terms that they add to the equations of motion."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np

from model.stack.errors import EffectError

Family = Literal["inertia", "boundary", "contact law", "pressure field", "treatments", "steel", "damping", "amplitude"]
Scale = Literal["lin", "log"]

PRESSURE_REFERENCE = 160e3
"""Pressure, Pa, at which effects that depend on pressure have their stated strength: M1 of the paper's Table 2."""
OMEGA_REFERENCE = 2.0 * math.pi * 500.0
"""Angular frequency, rad/s, at which effects that depend on frequency have their stated strength."""


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """A parameter of an effect.

    Attributes
    ----------
    name : str
        Its name; effects that name the same parameter share it.
    unit : str
        SI unit; "1" for a plain number.
    nominal : float
        A strength that is typical where the effect is present.
    lower, upper : float
        Plausible range.
    neutral : float
        Value at which the effect vanishes, or, for a parameter that only shapes it, a value inside the range.
    scale : "lin" or "log"
        How strengths are drawn and searched between the bounds.
    source : str
        Where the range comes from.
    sampled : bool
        Whether modes change so much over the range that a reduced model is made for several values of it.
    n_start : int
        Values, evenly over its range, from which fits start, of a location or of a strength of unknown order; 0 where
        they start from the nominal value and from a fifth of it.
    """

    name: str
    unit: str
    nominal: float
    lower: float
    upper: float
    neutral: float = 0.0
    scale: Scale = "lin"
    source: str
    sampled: bool = False
    n_start: int = 0

    def __post_init__(self) -> None:
        if not self.name.isidentifier():
            raise EffectError(f"parameter name {self.name!r}: must be one word of letters, digits and underscores")
        if not self.unit or not self.source:
            raise EffectError(f'parameter {self.name}: unit and source must be stated ("1" for a plain number)')
        if not self.lower < self.upper:
            raise EffectError(f"parameter {self.name}: lower {self.lower:g} must be below upper {self.upper:g}")
        for name in ("nominal", "neutral"):
            if not self.lower <= getattr(self, name) <= self.upper:
                raise EffectError(
                    f"parameter {self.name}: {name} {getattr(self, name):g} lies outside its range, "
                    f"{self.lower:g} to {self.upper:g}"
                )
        if self.scale not in get_args(Scale):
            raise EffectError(f"parameter {self.name}: scale must be 'lin' or 'log', got {self.scale!r}")

    @property
    def is_location(self) -> bool:
        """Whether it says where an effect acts and not how strongly: it is neutral inside its range."""
        return bool(self.n_start) and self.lower < self.neutral < self.upper

    def trials(self, n: int) -> tuple[float, ...]:
        """Return values to try: n where it is sampled, `n_start` of a location, else the ends and the nominal one."""
        n = n if self.sampled else self.n_start
        if n:
            spaced = np.geomspace if self.scale == "log" else np.linspace
            return tuple(np.clip(spaced(self.lower, self.upper, n), self.lower, self.upper).tolist())
        return (self.lower, self.nominal, self.upper)


@dataclass(frozen=True, eq=False, kw_only=True)
class Effect:
    """A physical effect that the base model lacks.

    Attributes
    ----------
    name : str
        One word: its key in files and on the command line.
    label : str
        What a person calls it: a short noun phrase in lower case, such as "clamp rotary inertia".
    family : str
        One of `Family`.
    summary : str
        One line.
    description : str
        The text for the user, normally the file's docstring: what it is, then paragraphs that begin with
        "Enters:", "Range:", "Does:" and "Mistaken for:".
    parameters : tuple of Parameter
        What it is controlled by. At their neutral values the terms vanish.
    terms : callable
        From the equations of motion of all laminas without effects (a `model.Assembly`, which has the stack and the
        plan) to the `model.Term` objects that the effect adds. It raises EffectError when the stack lacks what it
        needs.
    overstated : str
        What a person calls it where its first parameter is below the neutral value, if that is no physical effect but
        says that the stack file states too much; empty otherwise.
    stated : str
        What in a stack file, stated wrongly, does the same in every vibration test; empty where nothing does.
    grounded : bool
        Whether it ties the stack to the ground, so that rigid-body motion meets a force.
    frequency_dependent : bool
        Whether factors of its terms use the parameter `omega`, the angular frequency.
    over_strain : callable, optional
        Of an effect that follows amplitude: from its parameters and shear strain amplitudes of the contact to the share
        by which the tangential contact is softer there and its loss factor. Where amplitudes are known it takes the
        place of the terms.
    """

    name: str
    label: str
    family: Family
    summary: str
    description: str
    parameters: tuple[Parameter, ...]
    terms: Callable[[Any], tuple[Any, ...]]  # a stack holds effects, and the equations come from a stack
    overstated: str = ""
    stated: str = ""
    grounded: bool = False
    frequency_dependent: bool = False
    over_strain: Callable[[Mapping[str, float], Any], tuple[Any, Any]] | None = None

    def __post_init__(self) -> None:
        if not self.name.isidentifier():
            raise EffectError(f"effect name {self.name!r}: must be one word of letters, digits and underscores")
        if self.family not in get_args(Family):
            raise EffectError(
                f"effect {self.name}: family must be one of {', '.join(get_args(Family))}, got {self.family!r}"
            )
        if not self.parameters:
            raise EffectError(f"effect {self.name}: needs at least one parameter")

    @property
    def printed(self) -> str:
        """The effect as a person reads it, the key beside the label."""
        return f"{self.label} ({self.name})"

    @property
    def n_sampled(self) -> int:
        """Number of its parameters that are sampled."""
        return sum(p.sampled for p in self.parameters)

    def combinations(self, values: Callable[[Parameter], Iterable[float]]) -> Iterator[dict[str, float]]:
        """Return all combinations of some values of each parameter."""
        for chosen in itertools.product(*map(values, self.parameters)):
            yield dict(zip([p.name for p in self.parameters], chosen, strict=True))


def shared_parameters(effects: Iterable[Effect]) -> dict[str, Parameter]:
    """Return the parameters of several effects by name.

    Raises
    ------
    EffectError
        Two effects name the same parameter and do not agree about it.
    """
    found: dict[str, tuple[Effect, Parameter]] = {}
    for effect in effects:
        for parameter in effect.parameters:
            other = found.setdefault(parameter.name, (effect, parameter))
            if other[1] != parameter:
                differing = [
                    f"{key} {getattr(other[1], key)!r} against {getattr(parameter, key)!r}"
                    for key in ("unit", "nominal", "lower", "upper", "neutral", "scale", "source")
                    if getattr(other[1], key) != getattr(parameter, key)
                ]
                raise EffectError(
                    f"effects {other[0].name} and {effect.name} share the parameter {parameter.name} but do not "
                    f"agree: {'; '.join(differing)}"
                )
    return {name: parameter for name, (_, parameter) in found.items()}
