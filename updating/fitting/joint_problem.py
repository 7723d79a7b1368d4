"""The least-squares problem of a joint fit: from search variables to weighted differences and their derivatives."""

from __future__ import annotations

import difflib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from model import Modes
from model.stack.effect import Parameter, shared_parameters
from updating.errors import FitError
from updating.fitting.fit import D_F_BOUNDS, G_F_BOUNDS
from updating.fitting.prepared import Prepared, solve_target
from updating.fitting.sensitivity import PRIOR, Scatter, whitened_residual

Scope = Literal["all", "specimen", "configuration"]
"""Who shares a parameter: all configurations, those of one stack, or nobody."""

Differences = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Weighted differences (n_residual,) and their derivatives (n_residual, n_variable)."""

RATIOS = ("young", "density", "normal_modulus")
"""Parameters of every stack, as ratios to the values of its file."""
_RATIO_BOUNDS = (0.5, 2.0)
_PRESSURE_REACH = 5.0  # bounds of a pressure that has a prior, in standard deviations


@dataclass(frozen=True, eq=False, kw_only=True)
class FitSettings:
    """What is fitted in a joint fit, what is known beforehand, and how the data weigh.

    Attributes
    ----------
    effects : collection of str or None
        Effects of the stacks whose parameters are free; None is all. The others keep the stacks' values.
    free : collection of str
        Further parameters of the stacks that are free, as ratios to what their files say: "young", "density",
        "normal_modulus". They are hardly ever known without a prior.
    scope : mapping of parameter name to "all", "specimen" or "configuration"
        Who shares a parameter; by default the configurations of one stack share G_f and d_f, and all share the others.
    fixed : mapping of str to float
        Values of parameters that are not fitted.
    bounds : mapping of str to (float, float)
        In place of the default bounds: those of `fit` for G_f and d_f, the plausible ranges for effects.
    priors : mapping of str to (float, float)
        Mean and standard deviation of a normal distribution from other knowledge, for each group of a parameter.
    hold_out : mapping of str to collection of int
        Modes by configuration, counted from 0, that do not take part and are predicted.
    damping : bool
        Whether damping ratios take part; without, d_f is no parameter.
    scatter : Scatter
        Standard deviation beyond the identification's.
    """

    effects: Collection[str] | None = None
    free: Collection[str] = ()
    scope: Mapping[str, Scope] = field(default_factory=dict)
    fixed: Mapping[str, float] = field(default_factory=dict)
    bounds: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    priors: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    hold_out: Mapping[str, Collection[int]] = field(default_factory=dict)
    damping: bool = True
    scatter: Scatter = field(default_factory=Scatter)


@dataclass(frozen=True, kw_only=True)
class Free:
    """A free parameter of one group, searched by its logarithm or as it is."""

    name: str
    unit: str
    group: str
    lower: float
    upper: float
    logarithmic: bool
    nominal: float
    neutral: float

    def inward(self, value: float) -> float:
        """Return the search variable of a value."""
        return float(np.log(value)) if self.logarithmic else value / (self.upper - self.lower)

    def outward(self, x: float) -> float:
        """Return the value of a search variable."""
        return float(np.exp(x)) if self.logarithmic else x * (self.upper - self.lower)

    def slope(self, value: float) -> float:
        """Return the derivative of the value by the search variable."""
        return value if self.logarithmic else self.upper - self.lower


class Problem:
    """The least-squares problem: from a vector of search variables to weighted differences and derivatives."""

    def __init__(self, prepared: Sequence[Prepared], settings: FitSettings) -> None:
        self.prepared, self.fixed, self.scatter = tuple(prepared), dict(settings.fixed), settings.scatter
        self.damping = settings.damping and any(np.any(np.isfinite(p.target.damping)) for p in prepared)
        there = {effect.name: effect for p in prepared for effect in p.target.stack.effects}
        self.effects = tuple(there) if settings.effects is None else tuple(settings.effects)
        require_known("effect", self.effects, there)
        _require_names(settings, prepared, {"G_f", "d_f", *RATIOS, *shared_parameters(there.values())})
        self.used = [
            p.used & ~np.isin(np.arange(p.used.size), list(settings.hold_out.get(p.target.name, ())))
            for p in prepared
        ]
        if not any(np.any(used) for used in self.used):
            message = "no mode is left to fit"
            raise FitError(message)
        # asked for twice: values, derivatives
        self._latest: tuple[NDArray[np.float64], Differences] | None = None
        self.block = np.empty(0, np.int64)
        self.priors: dict[int, tuple[float, float]] = {}
        self.free: list[Free] = []
        self.column: list[dict[str, int]] = [{} for _ in self.prepared]
        of_effects = shared_parameters(there[name] for name in self.effects)
        self._add_all(settings, of_effects)
        self.low = np.array([f.inward(f.lower) for f in self.free])
        self.high = np.array([f.inward(f.upper) for f in self.free])
        self.of_effects = [j for j, f in enumerate(self.free) if f.name in of_effects]

    def _add_all(self, settings: FitSettings, of_effects: Mapping[str, Parameter]) -> None:
        """Free what the settings say: contact, ratios, effects, pressures."""
        candidates = [
            _contact("G_f", "Pa/Pa", G_F_BOUNDS, nominal=1000.0),
            *([_contact("d_f", "s/Pa", D_F_BOUNDS, nominal=1e-10)] if self.damping else []),
            *(_contact(name, "1", _RATIO_BOUNDS, nominal=1.0) for name in settings.free),
            *of_effects.values(),
        ]
        for parameter in candidates:
            if parameter.name not in settings.fixed:
                usual: Scope = "specimen" if parameter.name in ("G_f", "d_f") else "all"
                scope = settings.scope.get(parameter.name, usual)
                self._add(parameter, scope, settings.bounds, settings.priors.get(parameter.name))
        if settings.scatter.pressure > 0.0 and "pressure" not in settings.fixed:
            self._add_pressures(settings.scatter.pressure)
        if not self.free:
            message = "no parameter is left to fit"
            raise FitError(message)

    def _add_pressures(self, std: float) -> None:
        """Free the pressure of each configuration, with its nominal value as the mean of a prior."""
        for p, column in zip(self.prepared, self.column, strict=True):
            nominal = p.target.stack.contact.pressure
            reach = np.exp(_PRESSURE_REACH * std)
            column["pressure"] = len(self.free)
            self.priors[len(self.free)] = (nominal, std * nominal)
            self.free.append(
                Free(
                    name="pressure", unit="Pa", group=p.target.name, lower=nominal / reach,
                    upper=nominal * reach, logarithmic=True, nominal=nominal, neutral=nominal,
                )
            )  # fmt: skip

    def _add(
        self,
        parameter: Parameter,
        scope: Scope,
        bounds: Mapping[str, tuple[float, float]],
        prior: tuple[float, float] | None,
    ) -> None:
        lower, upper = bounds.get(parameter.name, (parameter.lower, parameter.upper))
        if not lower < upper:
            message = f"bounds of {parameter.name}: {lower:g} is not below {upper:g}"
            raise FitError(message)
        groups: dict[str, int] = {}
        known: set[str] = set()
        for p, used, column in zip(self.prepared, self.used, self.column, strict=True):
            kind = {"all": "", "specimen": p.target.specimen, "configuration": p.target.name}
            group = kind[scope]
            if group not in groups:
                groups[group] = len(self.free)
                if prior is not None:
                    self.priors[len(self.free)] = prior
                self.free.append(
                    Free(
                        name=parameter.name, unit=parameter.unit, group=group, lower=lower, upper=upper,
                        logarithmic=parameter.scale == "log" and lower > 0.0,
                        nominal=float(np.clip(parameter.nominal, lower, upper)),
                        neutral=float(np.clip(parameter.neutral, lower, upper)),
                    )
                )  # fmt: skip
            column[parameter.name] = groups[group]
            if prior is not None or np.any(used):
                known.add(group)
        for group in groups:
            if group not in known:
                message = f"{group}: all its modes are held out, so its own {parameter.name} cannot be fitted"
                raise FitError(message)

    def value(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return all free parameters at search variables x."""
        return np.array([f.outward(xi) for f, xi in zip(self.free, x, strict=True)])

    def modes(
        self, i: int, x: NDArray[np.float64], by: Collection[str] = ()
    ) -> tuple[Modes, NDArray[np.int64]]:
        """Return the modes of configuration i at x and the column of each measured one; derivatives `by` names."""
        value = self.value(x)
        given = {name: float(value[j]) for name, j in self.column[i].items()}
        return solve_target(self.prepared[i], {**self.fixed, **given}, by)

    def evaluate(self, x: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the weighted differences of all configurations and priors at x, and their derivatives by x."""
        if self._latest is not None and np.array_equal(self._latest[0], x):
            return self._latest[1]
        value = self.value(x)
        slope = np.array([f.slope(v) for f, v in zip(self.free, value, strict=True)])
        residuals, jacobians, blocks = [], [], []
        for i, (p, used) in enumerate(zip(self.prepared, self.used, strict=True)):
            if not np.any(used):
                continue
            modes, column = self.modes(i, x, self.column[i])
            residual, by_parameter, block = whitened_residual(
                p.target, used, modes, column, self.scatter, with_damping=self.damping
            )
            blocks.append(block)
            jacobian = np.zeros((residual.size, x.size))
            for k, name in enumerate(modes.parameter):
                j = self.column[i][name]
                jacobian[:, j] = by_parameter[:, k] * slope[j]
            residuals.append(residual)
            jacobians.append(jacobian)
        for j, (mean, std) in self.priors.items():
            row = np.zeros((1, x.size))
            row[0, j] = slope[j] / std
            residuals.append(np.array([(value[j] - mean) / std]))
            jacobians.append(row)
            blocks.append(np.array([PRIOR]))
        self.block = np.concatenate(blocks)
        found = np.concatenate(residuals), np.vstack(jacobians)
        self._latest = (x.copy(), found)
        return found


def _contact(name: str, unit: str, bounds: tuple[float, float], *, nominal: float) -> Parameter:
    return Parameter(
        name=name, unit=unit, nominal=nominal, lower=bounds[0], upper=bounds[1], neutral=nominal,
        scale="log" if bounds[0] > 0.0 else "lin", source="Table 6 of Pirnat et al. (2013), widened",
    )  # fmt: skip


def _require_names(settings: FitSettings, prepared: Sequence[Prepared], known: Collection[str]) -> None:
    """Require that the settings name parameters and configurations that there are."""
    require_known("free: parameter", settings.free, RATIOS)
    for what, given in (("scope", settings.scope), ("bounds", settings.bounds), ("priors", settings.priors)):
        require_known(f"{what}: parameter", given, known)
    in_models = {name for p in prepared for name in p.system.theta}
    require_known("fixed: parameter", settings.fixed, {*known, *in_models})
    require_known("hold_out: configuration", settings.hold_out, {p.target.name for p in prepared})


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
            message = f"{what} {name!r} is unknown; {hint}"
            raise FitError(message)
