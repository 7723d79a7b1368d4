"""The least-squares problem of a joint fit: from search variables to weighted differences and their derivatives."""

from __future__ import annotations

import difflib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
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

    def __init__(
        self,
        prepared: Sequence[Prepared],
        *,
        effects: Collection[str] | None,
        free: Collection[str],
        scope: Mapping[str, Scope],
        fixed: Mapping[str, float],
        bounds: Mapping[str, tuple[float, float]],
        priors: Mapping[str, tuple[float, float]],
        hold_out: Mapping[str, Collection[int]],
        damping: bool,
        scatter: Scatter,
    ) -> None:
        self.prepared, self.fixed, self.damping, self.scatter = tuple(prepared), dict(fixed), damping, scatter
        stacks = [p.target.stack for p in prepared]
        there = {effect.name: effect for stack in stacks for effect in stack.effects}
        self.effects = tuple(there) if effects is None else tuple(effects)
        require_known("effect", self.effects, there)
        parameters = shared_parameters(there[name] for name in self.effects)
        every = {"G_f", "d_f", *RATIOS, *shared_parameters(there.values())}
        require_known("free: parameter", free, RATIOS)
        for what, given in (("scope", scope), ("bounds", bounds), ("priors", priors)):
            require_known(f"{what}: parameter", given, every)
        require_known("fixed: parameter", fixed, {*every, *(n for p in prepared for n in p.system.theta)})
        require_known("hold_out: configuration", hold_out, {p.target.name for p in prepared})
        self.used = [
            p.used & ~np.isin(np.arange(p.used.size), list(hold_out.get(p.target.name, ()))) for p in prepared
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
        candidates = [
            _contact("G_f", "Pa/Pa", G_F_BOUNDS, nominal=1000.0),
            *([_contact("d_f", "s/Pa", D_F_BOUNDS, nominal=1e-10)] if damping else []),
            *(_contact(name, "1", _RATIO_BOUNDS, nominal=1.0) for name in free),
            *parameters.values(),
        ]
        for parameter in candidates:
            if parameter.name in fixed:
                continue
            own = parameter.name in ("G_f", "d_f")
            given_scope = scope.get(parameter.name, "specimen" if own else "all")
            self._add(parameter, given_scope, bounds, priors.get(parameter.name))
        if scatter.pressure > 0.0 and "pressure" not in fixed:
            self._add_pressures(scatter.pressure)
        if not self.free:
            message = "no parameter is left to fit"
            raise FitError(message)
        self.low = np.array([f.inward(f.lower) for f in self.free])
        self.high = np.array([f.inward(f.upper) for f in self.free])
        self.of_effects = [j for j, f in enumerate(self.free) if f.name in parameters]

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
