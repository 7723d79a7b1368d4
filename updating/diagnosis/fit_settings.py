"""What is known of parameters before a fit: who shares them, priors, bounds, values that are fixed."""

from __future__ import annotations

import difflib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, TypeVar, get_args

import numpy as np
from numpy.typing import NDArray

from model import Effect, Parameter, Stack
from updating.diagnosis.evidence import D_F_START, DiagnosisScatter
from updating.errors import FitError
from updating.inference.protocol import Coordinate

Vector = NDArray[np.float64]


def scaled(parameter: Parameter, coordinate: float) -> tuple[float, float]:
    """Return a parameter's value at a coordinate in units of its range, 0 at neutral, and its derivative."""
    if parameter.scale == "log":
        span = np.log(parameter.upper / parameter.lower)
        value = parameter.neutral * np.exp(span * coordinate)
        return float(value), float(span * value)
    span = parameter.upper - parameter.lower
    return parameter.neutral + span * coordinate, span


def coordinate_of(parameter: Parameter, value: float) -> float:
    """Return the coordinate, in units of its range, of a parameter's value."""
    if parameter.scale == "log":
        return float(np.log(value / parameter.neutral) / np.log(parameter.upper / parameter.lower))
    return (value - parameter.neutral) / (parameter.upper - parameter.lower)


def bounds_of(parameters: Sequence[Parameter]) -> tuple[Vector, Vector]:
    """Return lower and upper bounds of the coordinates of parameters."""
    return (
        np.array([coordinate_of(p, p.lower) for p in parameters]),
        np.array([coordinate_of(p, p.upper) for p in parameters]),
    )


def free_coordinate(p: Parameter) -> Coordinate:
    """Return the coordinate of an effect's parameter: in units of its range, 0 at neutral, with a wide prior."""
    (low,), (high,) = bounds_of([p])
    if p.n_start:
        starts = tuple(float(low + (i + 0.5) / p.n_start * (high - low)) for i in range(p.n_start))
    else:
        nominal = coordinate_of(p, p.nominal)
        starts = tuple(float(np.clip(share * nominal, low, high)) for share in (0.2, 1.0))
    return Coordinate(name=p.name, std=1.0, lower=float(low), upper=float(high), starts=starts, step=0.1, longest=0.4)


T = TypeVar("T")
Scope = Literal["all", "specimen", "configuration"]
"""Who shares a parameter: all configurations, those of one stack, or nobody."""
SCOPES: tuple[Scope, ...] = get_args(Scope)

CONTACT = {"G_f": "contact stiffness", "d_f": "contact damping"}
"""Contact parameters, with what a person calls them."""
RATIOS = ("young", "density", "normal_modulus")
"""Parameters of every stack, as ratios to the values of its file."""
_RATIO_BOUNDS = (0.5, 2.0)


@dataclass(frozen=True, eq=False, kw_only=True)
class FitSettings:
    """What is known of a fit's parameters beforehand, and what is left out.

    Without any, everything is as a diagnosis has it.

    Attributes
    ----------
    scope : mapping of parameter name to "all", "specimen" or "configuration"
        Who shares a parameter. By default G_f and d_f of a stack scatter about those of all stacks, those of a
        configuration about those of its stack by a few per cent, and all share the parameters of effects.
    fixed : mapping of str to float
        Values of parameters that are not fitted.
    bounds : mapping of str to (float, float)
        In place of the default bounds: those of a diagnosis for G_f and d_f, plausible ranges for effects.
    priors : mapping of str to (float, float)
        Mean and standard deviation of a normal distribution from other knowledge, for each that shares the parameter;
        of contact and ratios it is taken for that of the logarithm.
    free : collection of str
        Of "young", "density" and "normal_modulus", ratios to what the stack's file says, those of which nothing is
        known but bounds. The others are known as in a diagnosis.
    start : mapping of str to float
        Values of effects' parameters near which a fit begins.
    hold_out : mapping of str to collection of int
        Modes by configuration, counted from 0, that do not take part and are predicted.
    damping : bool
        Whether damping ratios take part; without, d_f is no parameter.
    scatter : DiagnosisScatter
        What separates a right model from a right measurement.
    """

    scope: Mapping[str, Scope] = field(default_factory=dict)
    fixed: Mapping[str, float] = field(default_factory=dict)
    bounds: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    priors: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    free: Collection[str] = ()
    start: Mapping[str, float] = field(default_factory=dict)
    hold_out: Mapping[str, Collection[int]] = field(default_factory=dict)
    damping: bool = True
    scatter: DiagnosisScatter = field(default_factory=DiagnosisScatter)

    def require(self, effects: Mapping[str, Effect], n_mode: Mapping[str, int]) -> None:
        """Require that everything that is named there exists and is possible.

        Parameters
        ----------
        effects : mapping of str to Effect
            Those that are fitted.
        n_mode : mapping of str to int
            Number of modes of each configuration.

        Raises
        ------
        FitError
            Something does not exist or is impossible; the message says what would be right.
        """
        of_effects = {p.name for effect in effects.values() for p in effect.parameters}
        known = {*CONTACT, *RATIOS, *of_effects}
        require_known("free: parameter", self.free, RATIOS)
        for what in ("scope", "bounds", "priors", "fixed", "start"):
            require_known(f"{what}: parameter", getattr(self, what), known)
        for name, (lower, upper) in self.bounds.items():
            if not lower < upper:
                raise FitError(f"bounds of {name}: {lower:g} is not below {upper:g}")
        for name in (*CONTACT, *RATIOS):
            stated = [self.fixed.get(name, 1.0), self.priors.get(name, (1.0, 0.0))[0]]
            if min(stated) <= 0.0:
                raise FitError(f"{name} must be above 0, found {min(stated):g}")
        for name, scope in self.scope.items():
            if scope == "configuration" and name not in CONTACT:
                raise FitError(
                    f"scope of {name}: all configurations of a stack have the same; it can be 'all' or 'specimen'"
                )
        for effect in effects.values():
            scopes = {self.scope.get(p.name, "all") for p in effect.parameters}
            if len(scopes) > 1:
                names = ", ".join(p.name for p in effect.parameters)
                raise FitError(f"scope of {names}: parameters of one effect are shared alike; give them one scope")
        require_known("hold_out: configuration", self.hold_out, n_mode)
        for name, modes in self.hold_out.items():
            if max(modes, default=0) >= n_mode[name]:
                raise FitError(f"hold_out.{name}: there is no mode {max(modes) + 1}; it has {n_mode[name]}")
            if set(modes) >= set(range(n_mode[name])):
                raise FitError(
                    f"{name}: all its modes are held out, so nothing of it can be fitted; leave it out instead"
                )

    @property
    def of_base(self) -> FitSettings:
        """What is said of the base model alone, without parameters of effects."""
        return replace(
            self,
            scope=_of_base(self.scope),
            fixed=_of_base(self.fixed),
            bounds=_of_base(self.bounds),
            priors=_of_base(self.priors),
            start={},
        )

    def apart(self, effect: Effect) -> bool:
        """Tell whether each stack has an effect of its own."""
        return any(self.scope.get(p.name) == "specimen" for p in effect.parameters)

    def stack(self, stack: Stack) -> Stack:
        """Return a stack with what is fixed, and with the means of priors, in place of what its file says."""
        value = {name: mean for name, (mean, _) in self.priors.items()} | dict(self.fixed)
        contact, material = stack.contact, stack.material
        return replace(
            stack,
            material=replace(
                material,
                young=value.get("young", 1.0) * material.young,
                density=value.get("density", 1.0) * material.density,
            ),
            contact=replace(
                contact,
                G_f=value.get("G_f", contact.G_f),
                d_f=value.get("d_f", contact.d_f),
                normal_modulus=value.get("normal_modulus", 1.0) * contact.normal_modulus,
            ),
        )

    def of_stack(self, usual: Sequence[Coordinate], stack: Stack) -> tuple[Coordinate, ...]:
        """Return the nuisances of one stack, as `stack` has it, with what is known of them."""
        several = any("[" in c.name and c.name.startswith(tuple(CONTACT)) for c in usual)
        levels: list[Scope] = ["all", "configuration"] if several else ["all"]
        return tuple(
            self.part(c, c.name.partition("[")[0], "configuration" if "[" in c.name else "all", levels, c, stack)
            for c in usual
        )

    def part(
        self, coordinate: Coordinate, name: str, level: Scope, levels: Sequence[Scope], usual: Coordinate, stack: Stack
    ) -> Coordinate:
        """Return the coordinate of a level's contribution to a parameter, with its prior.

        Parameters
        ----------
        coordinate : Coordinate
            The contribution, as it is without settings.
        name : str
            The parameter.
        level, levels : Scope
            Whose it is, and what levels the parameter has.
        usual : Coordinate
            The parameter as it is of one stack alone.
        stack : Stack
            What coordinates are relative to.
        """
        farthest = 8.0  # prior standard deviations that a parameter may move
        # Standard deviation of the logarithm of a contact parameter that each configuration has for itself: a factor of
        # 3.
        wide = 1.0
        if name not in (*CONTACT, *RATIOS):
            return coordinate
        if name in self.fixed:
            return _pinned(coordinate)
        scope = self.scope.get(name)
        std = self._std(name, usual)
        if std is None:
            if level == "specimen" and scope == "all":
                return _pinned(coordinate)
            if level == "configuration" and scope == "configuration":
                return replace(coordinate, std=wide, step=0.1)
            return self._bounded(coordinate, name, stack) if level == "all" else coordinate
        wanted = scope or ("specimen" if name in CONTACT else "all")
        bearing = [shared_by for shared_by in SCOPES[: SCOPES.index(wanted) + 1] if shared_by in levels][-1]
        if level == bearing:
            moved = replace(coordinate, std=std, step=min(coordinate.step, 0.1))
            if level != "all" or name in RATIOS:
                moved = replace(moved, lower=-farthest * std, upper=farthest * std)
            return self._bounded(moved, name, stack)
        inner = SCOPES.index(level) > SCOPES.index(bearing)
        scatters = inner and level == "configuration"  # by reassembly, always
        return coordinate if scatters else _pinned(coordinate)

    def _std(self, name: str, usual: Coordinate) -> float | None:
        """Return the standard deviation of the logarithm of a parameter; None where nothing is said of it."""
        if name in self.priors:
            mean, std = self.priors[name]
            return std / mean
        if name in RATIOS and (name in self.free or name in self.bounds):
            return float(np.inf)
        return usual.std if name in RATIOS and name in self.scope else None

    def _bounded(self, coordinate: Coordinate, name: str, stack: Stack) -> Coordinate:
        """Return a coordinate between the bounds that are stated; without any, that of a free ratio between usual ones.

        A model that is reduced for a range of G_f holds in that alone.
        """
        bounds = self.bounds.get(name)
        if bounds is None:
            if np.isfinite(coordinate.std) or name in CONTACT:
                return coordinate
            bounds = _RATIO_BOUNDS
        origin = {"G_f": stack.contact.G_f, "d_f": stack.contact.d_f or D_F_START}.get(name)
        if origin is None:
            origin = self.priors.get(name, (1.0, 0.0))[0]
        lower, upper = (float(np.log(end / origin)) if end > 0.0 else -np.inf for end in bounds)
        lower = max(lower, coordinate.lower) if name == "G_f" else lower
        upper = min(upper, coordinate.upper) if name == "G_f" else upper
        if not lower < upper:
            raise FitError(f"bounds of {name}: none of {bounds[0]:g} to {bounds[1]:g} is what the model is made for")
        return replace(coordinate, lower=lower, upper=upper)

    def tells(self, effects: Mapping[str, Effect]) -> bool:
        """Tell whether anything is said of the parameters of effects."""
        stated = {*self.fixed, *self.bounds, *self.priors, *self.start}
        return any(p.name in stated for effect in effects.values() for p in effect.parameters)

    def effects(self, effects: Mapping[str, Effect]) -> dict[str, Effect]:
        """Return effects whose coordinates are 0 at what is fixed and at the means of priors, between stated bounds."""
        return {
            name: replace(effect, parameters=tuple(self._parameter(p) for p in effect.parameters))
            for name, effect in effects.items()
        }

    def _parameter(self, p: Parameter) -> Parameter:
        lower, upper = self.bounds.get(p.name, (p.lower, p.upper))
        middle = self.fixed.get(p.name, self.priors.get(p.name, (p.neutral, 0.0))[0])
        if p.name in self.fixed:
            lower, upper = min(lower, middle), max(upper, middle)
        return replace(
            p,
            lower=lower,
            upper=upper,
            neutral=float(np.clip(middle, lower, upper)),
            nominal=float(np.clip(p.nominal, lower, upper)),
        )

    def of_effect(self, p: Parameter) -> Coordinate:
        """Return the coordinate of an effect's parameter, of those that `effects` returns, with what is known of it."""
        coordinate = free_coordinate(p)
        if p.name in self.fixed:
            return _pinned(coordinate)
        if p.name in self.priors:
            coordinate = replace(coordinate, std=self.priors[p.name][1] / abs(scaled(p, 0.0)[1]))
        if p.name in self.start:
            coordinate = replace(
                coordinate, starts=(coordinate_of(p, float(np.clip(self.start[p.name], p.lower, p.upper))),)
            )
        return coordinate


def _of_base(given: Mapping[str, T]) -> dict[str, T]:
    return {name: value for name, value in given.items() if name in (*CONTACT, *RATIOS)}


def _pinned(coordinate: Coordinate) -> Coordinate:
    """Return a coordinate that stays where it is."""
    pinned = 1e-6  # standard deviation of what is fixed
    return replace(coordinate, std=pinned, lower=0.0, upper=0.0, starts=(0.0,))


def is_pinned(coordinate: Coordinate) -> bool:
    """Tell whether a coordinate is fixed."""
    return coordinate.lower == coordinate.upper


def require_known(what: str, given: Collection[str], known: Collection[str]) -> None:
    """Require that all given names are known.

    Raises
    ------
    FitError
        One is not; the message has the closest one.
    """
    for name in given:
        if name not in known:
            close = difflib.get_close_matches(name, known, n=1)
            hint = f"did you mean {close[0]}?" if close else f"there are {', '.join(sorted(known)) or 'none'}"
            raise FitError(f"{what} {name!r} is unknown; {hint}")
