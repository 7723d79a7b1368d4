"""Effects that many stacks share, by opt_G of the paper, eq. (1), over all of them, each stack with its G_f.

For modes of a table, which are known by class and have no stated uncertainty. The squares are of relative differences,
so that all modes weigh the same. It does not ask what stacks lack: `lamella diagnose` asks that of shapes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from ema.types.arrays import single_threaded
from model import Parameter, shared_parameters
from model.reduction.reduction import sobol
from tests.studies.published.target import Prepared, solve_target
from updating.errors import FitError
from updating.fitting.fit import G_F_BOUNDS, ParameterEstimate, frequency_error

Vector = NDArray[np.float64]
Kept = Sequence[NDArray[np.bool_]]

_SCAN = 15  # values of G_f tried before each descent
_LACKING = 1.0  # logarithm of the ratio of frequencies that a mode which the model lacks counts as
_AT_BOUND = 1e-4  # of the range


@dataclass(frozen=True, eq=False, kw_only=True)
class SharedFit:
    """Stacks fitted together.

    Attributes
    ----------
    effects : tuple of str
        What they share.
    parameter : tuple of ParameterEstimate
        The effects' parameters, with Student's intervals of 95 % from what the fit leaves.
    std : tuple of float
        Their standard deviations.
    G_f : mapping of str to float
        Contact stiffness of each stack, Pa per Pa.
    measured, frequency : tuple of (n_mode,) float
        By configuration, Hz; NaN where a mode was not measured, or the model lacks it.
    left_out : tuple of (n_mode,) float
        The same where the configuration is left out: shared parameters by the others, and so G_f where the stack has
        another; else G_f is fitted to it. NaN where there is no other.
    mode_left_out : tuple of (n_mode,) float
        The same where each mode is left out, to first order about the fit.
    objective : float
        Sum of squared relative differences.
    """

    effects: tuple[str, ...]
    parameter: tuple[ParameterEstimate, ...]
    std: tuple[float, ...]
    G_f: Mapping[str, float]
    measured: tuple[Vector, ...]
    frequency: tuple[Vector, ...]
    left_out: tuple[Vector, ...]
    mode_left_out: tuple[Vector, ...]
    objective: float

    def error(self, of: tuple[Vector, ...] | None = None) -> float:
        """Return the mean relative error, eq. (2), of `frequency` or of others; NaN of none."""
        measured, modelled = np.concatenate(self.measured), np.concatenate(of or self.frequency)
        known = np.isfinite(measured) & np.isfinite(modelled)
        return frequency_error(measured[known], modelled[known]) if known.any() else float("nan")


@single_threaded
def fit_shared_opt_G(
    prepared: Sequence[Prepared],
    effects: Sequence[str],
    *,
    fixed: Mapping[str, float] | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    first: SharedFit | None = None,
    anew: bool = True,
    left_out: bool = True,
) -> SharedFit:
    """Fit effects that all configurations share, and G_f of each stack.

    Parameters
    ----------
    prepared : sequence of Prepared
        The configurations; those of one specimen share G_f.
    effects : sequence of str
        Effects of their stacks; the others stay neutral.
    fixed : mapping of str to float, optional
        Parameters that are not fitted.
    bounds : mapping of str to (float, float), optional
        In place of plausible ranges.
    first : SharedFit, optional
        Another fit of these stacks, from which this one starts as well: one more effect may not make it worse.
    anew : bool
        Whether it starts elsewhere, too.
    left_out : bool
        Whether configurations and modes are left out in turn.

    Raises
    ------
    FitError
        No mode is measured that a model has.
    """
    problem = _Problem(prepared, effects, fixed or {}, bounds or {})
    kept = [state.used for state in prepared]
    starts = [problem.scanned(t, kept) for t in problem.starts()] if anew or first is None else []
    if first is not None:
        starts.append(problem.near(first))
    tried = [problem.descend(start, kept) for start in starts]
    x = min(tried, key=lambda start: float(np.sum(problem.evaluate(start, kept)[0] ** 2)))
    residual, jacobian = problem.evaluate(x, kept)
    parameter, std = _estimates(problem, x, residual, jacobian)
    nothing = tuple(np.full(state.used.size, np.nan) for state in prepared)
    return SharedFit(
        effects=tuple(effects),
        parameter=parameter,
        std=std,
        G_f={name: float(np.exp(x[problem.n + i])) for i, name in enumerate(problem.specimen)},
        measured=tuple(np.where(state.used, state.target.frequency, np.nan) for state in prepared),
        frequency=problem.frequencies(x),
        left_out=_configurations(problem, x, kept) if left_out else nothing,
        mode_left_out=_modes(problem, residual, jacobian, kept) if left_out else nothing,
        objective=float(residual @ residual),
    )


class _Problem:
    """From search variables to relative differences: shared parameters as shares of their ranges, then ln G_f."""

    def __init__(
        self,
        prepared: Sequence[Prepared],
        effects: Sequence[str],
        fixed: Mapping[str, float],
        bounds: Mapping[str, tuple[float, float]],
    ) -> None:
        self.prepared, self.fixed = tuple(prepared), dict(fixed)
        there = {effect.name: effect for state in prepared for effect in state.target.stack.effects}
        named = shared_parameters(there[name] for name in effects).values()
        self.free: list[Parameter] = [_bounded(p, bounds) for p in named if p.name not in fixed]
        self.n = len(self.free)
        self.specimen = tuple(dict.fromkeys(state.target.specimen for state in prepared))
        self.column = [self.n + self.specimen.index(state.target.specimen) for state in prepared]
        if not any(state.used.any() for state in prepared):
            message = "no mode is left to fit"
            raise FitError(message)

    def value(self, j: int, t: float) -> tuple[float, float]:
        """Return a shared parameter at a share of its range, and its derivative by that."""
        p = self.free[j]
        if p.scale == "log" and p.lower > 0.0:
            span = np.log(p.upper / p.lower)
            value = p.lower * np.exp(span * t)
            return float(value), float(span * value)
        return p.lower + (p.upper - p.lower) * t, p.upper - p.lower

    def share(self, j: int, value: float) -> float:
        """Return the share of its range at which a shared parameter has a value."""
        p = self.free[j]
        if p.scale == "log" and p.lower > 0.0:
            return float(np.log(value / p.lower) / np.log(p.upper / p.lower))
        return (value - p.lower) / (p.upper - p.lower)

    def _solved(self, i: int, x: Vector, by: Sequence[str]) -> tuple[Vector, Vector]:
        """Return frequencies of a configuration, (n_mode,), and relative derivatives by some parameters."""
        given = {p.name: self.value(j, float(x[j]))[0] for j, p in enumerate(self.free)}
        given["G_f"] = float(np.exp(x[self.column[i]]))
        modes, column = solve_target(self.prepared[i], {**self.fixed, **given}, by)
        lacking = column < 0
        frequency = np.where(lacking, np.nan, modes.frequency[column])
        order = [modes.parameter.index(name) for name in by]
        slope = modes.frequency_gradient[column][:, order] / modes.frequency[column][:, None]
        return frequency, np.where(lacking[:, None], 0.0, slope)

    def frequencies(self, x: Vector) -> tuple[Vector, ...]:
        """Return the frequencies of all configurations, Hz; NaN of modes that the model lacks."""
        return tuple(self._solved(i, x, ())[0] for i in range(len(self.prepared)))

    def evaluate(self, x: Vector, kept: Kept) -> tuple[Vector, Vector]:
        """Return logarithms of modelled over measured frequencies, and their derivatives by the search variables."""
        residuals, jacobians = [], []
        names = [*(p.name for p in self.free), "G_f"]
        scale = np.array([*(self.value(j, float(x[j]))[1] for j in range(self.n)), 0.0])
        for i, (state, used) in enumerate(zip(self.prepared, kept, strict=True)):
            if not used.any():
                continue
            frequency, slope = self._solved(i, x, names)
            log = np.log(frequency[used] / state.target.frequency[used])
            rows = np.zeros((int(used.sum()), x.size))
            rows[:, : self.n] = slope[used, : self.n] * scale[: self.n]
            rows[:, self.column[i]] = slope[used, self.n] * np.exp(x[self.column[i]])
            residuals.append(np.where(np.isfinite(log), log, _LACKING))
            jacobians.append(rows)
        return np.concatenate(residuals), np.vstack(jacobians)

    def starts(self) -> list[Vector]:
        """Return shares of the ranges that fits start from: nominal ones, near neutral, and points between."""
        if not self.n:
            return [np.zeros(0)]
        nominal = np.array([self.share(j, p.nominal) for j, p in enumerate(self.free)])
        neutral = np.array([self.share(j, p.neutral) for j, p in enumerate(self.free)])
        further = sobol(2 if self.n == 1 else 8, self.n)[: 2 if self.n == 1 else 6]
        return [nominal, neutral + 0.05 * (nominal - neutral), *further]

    def near(self, fit: SharedFit) -> Vector:
        """Return the search variables of another fit, with effects that it lacks neutral."""
        known = {p.name: p.value for p in fit.parameter}
        shares = [self.share(j, known.get(p.name, p.neutral)) for j, p in enumerate(self.free)]
        return np.array([*shares, *(np.log(fit.G_f[name]) for name in self.specimen)])

    def scanned(self, shares: Vector, kept: Kept) -> Vector:
        """Return search variables at some shares, each G_f the best of a grid."""
        grid = np.log(np.geomspace(*G_F_BOUNDS, _SCAN + 2)[1:-1])
        cost = np.zeros((len(self.specimen), _SCAN))
        for k, log in enumerate(grid):
            x = np.concatenate([shares, np.full(len(self.specimen), log)])
            for i, (state, used) in enumerate(zip(self.prepared, kept, strict=True)):
                off = np.log(self._solved(i, x, ())[0][used] / state.target.frequency[used])
                off = np.where(np.isfinite(off), off, _LACKING)
                cost[self.column[i] - self.n, k] += float(off @ off)
        return np.concatenate([shares, grid[np.argmin(cost, axis=1)]])

    def descend(self, x: Vector, kept: Kept, moving: NDArray[np.intp] | None = None) -> Vector:
        """Return where a descent from some search variables ends; only some may move."""
        chosen = np.arange(x.size) if moving is None else moving
        if not chosen.size:
            return x
        low = np.concatenate([np.zeros(self.n), np.full(len(self.specimen), np.log(G_F_BOUNDS[0]))])
        high = np.concatenate([np.ones(self.n), np.full(len(self.specimen), np.log(G_F_BOUNDS[1]))])
        inside = 1e-6 * (high - low)
        known: dict[bytes, tuple[Vector, Vector]] = {}

        def at(y: Vector) -> tuple[Vector, Vector]:
            key = y.tobytes()
            if key not in known:
                known.clear()
                whole = x.copy()
                whole[chosen] = y
                known[key] = self.evaluate(whole, kept)
            return known[key]

        solution = scipy.optimize.least_squares(
            lambda y: at(y)[0],
            np.clip(x, low + inside, high - inside)[chosen],
            jac=lambda y: at(y)[1][:, chosen],
            bounds=(low[chosen], high[chosen]),
            x_scale="jac",
            xtol=1e-8,
            ftol=1e-9,
            max_nfev=60,
        )
        whole = x.copy()
        whole[chosen] = solution.x
        return whole


def _bounded(p: Parameter, bounds: Mapping[str, tuple[float, float]]) -> Parameter:
    lower, upper = bounds.get(p.name, (p.lower, p.upper))
    nominal, neutral = (float(np.clip(value, lower, upper)) for value in (p.nominal, p.neutral))
    return replace(p, lower=lower, upper=upper, nominal=nominal, neutral=neutral)


def _estimates(
    problem: _Problem, x: Vector, residual: Vector, jacobian: Vector
) -> tuple[tuple[ParameterEstimate, ...], tuple[float, ...]]:
    """Return the shared parameters with intervals, and standard deviations; those at a bound are taken as known."""
    n = problem.n
    at_bound = np.zeros(x.size, dtype=bool)
    at_bound[:n] = np.minimum(x[:n], 1.0 - x[:n]) < _AT_BOUND
    inner = np.flatnonzero(~at_bound & (np.abs(jacobian).max(axis=0, initial=0.0) > 0.0))
    degrees = max(residual.size - inner.size, 1)
    spread = np.full(x.size, np.inf)
    spread[at_bound] = 0.0
    covariance = np.linalg.pinv(jacobian[:, inner].T @ jacobian[:, inner], hermitian=True)
    spread[inner] = np.sqrt(np.maximum(np.diag(covariance), 0.0) * float(residual @ residual) / degrees)
    reach = float(scipy.special.stdtrit(degrees, 0.975)) * spread[:n]
    ends = np.clip(np.stack([x[:n] - reach, x[:n] + reach]), 0.0, 1.0)
    estimates, std = [], []
    for j, p in enumerate(problem.free):
        value, slope = problem.value(j, float(x[j]))
        lower, upper = (problem.value(j, float(end))[0] for end in ends[:, j])
        estimates.append(
            ParameterEstimate(
                name=p.name, unit=p.unit, value=value, lower=lower, upper=upper, at_bound=bool(at_bound[j]),
                determined=bool(not at_bound[j] and spread[j] < 12.0**-0.5),
            )
        )  # fmt: skip
        std.append(float(spread[j] * slope))
    return tuple(estimates), tuple(std)


def _configurations(problem: _Problem, x: Vector, kept: Kept) -> tuple[Vector, ...]:
    """Return the frequencies of each configuration, left out in turn."""
    frequencies = []
    for i, state in enumerate(problem.prepared):
        rest = [used & (i != k) for k, used in enumerate(kept)]
        if not any(used.any() for used in rest):
            frequencies.append(np.full(state.used.size, np.nan))
            continue
        there = problem.descend(x, rest)
        alone = problem.column.count(problem.column[i]) == 1
        if alone:  # nothing else determines its contact
            only = [used & (i == k) for k, used in enumerate(kept)]
            there = problem.descend(there, only, np.array([problem.column[i]]))
        frequencies.append(problem._solved(i, there, ())[0])  # of the same module
    return tuple(frequencies)


def _modes(problem: _Problem, residual: Vector, jacobian: Vector, kept: Kept) -> tuple[Vector, ...]:
    """Return the frequency of each mode, left out in turn, by the leverage that it has on the fit."""
    moving = np.abs(jacobian).max(axis=0) > 0.0
    basis = np.linalg.svd(jacobian[:, moving], full_matrices=False)[0]
    free = np.maximum(1.0 - np.sum(basis**2, axis=1), 1e-6)
    predicted, first, frequencies = residual / free, 0, []
    for state, used in zip(problem.prepared, kept, strict=True):
        left_out, n = np.full(used.size, np.nan), int(used.sum())
        left_out[used] = state.target.frequency[used] * np.exp(predicted[first : first + n])
        frequencies.append(left_out)
        first += n
    return tuple(frequencies)
