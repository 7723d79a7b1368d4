"""Several configurations fitted at once, with parameters of their own and parameters that they share.

Weighted least squares over frequencies, damping ratios and shape vectors, which is maximum likelihood for normal
errors, from several starts, with the derivatives of `solve_modes`.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from typing import get_args

import numpy as np
from numpy.typing import NDArray

from ema.modal.mac import mac
from ema.types.arrays import readonly
from ema.types.threads import single_threaded
from updating.errors import FitError
from updating.fitting.descent import Descent, at_bound, covariance, descend
from updating.fitting.intervals import Method, bootstrap_intervals, normal_intervals, profile_intervals
from updating.fitting.joint_problem import FitSettings, Problem, require_known
from updating.fitting.objective import frequency_error
from updating.fitting.prepared import Prepared, solve_target
from updating.fitting.sensitivity import PRIOR
from updating.fitting.starts import starts
from updating.fitting.subset import select
from updating.workers.workers import distribute


@dataclass(frozen=True, kw_only=True)
class FittedParameter:
    """One fitted parameter.

    Attributes
    ----------
    name, unit : str
        The parameter.
    group : str
        The stack or configuration that it belongs to; empty where all share it.
    value, std : float
        Estimate and standard deviation. The latter counts the misfit: where the model is off by more than the stated
        errors, it grows with it, for frequencies, damping ratios and shapes apart.
    interval : (float, float)
        Of 95 %. An end at a bound is open: the data do not exclude what lies beyond.
    method : "normal", "profile" or "bootstrap"
        Where the interval comes from: the standard deviation, the profile of chi-square, or fits to simulated data.
    lower, upper : float
        Bounds.
    at_bound : bool
        Whether the estimate lies on a bound: then the data ask for a value outside, and `std` means nothing.
    determined : bool
        Whether the data, with the priors, say more than the bounds do: the standard deviation is less than that of
        a uniform distribution between them.
    rank : int
        Place of the parameter, from 1, when those are chosen one after another that the data alone know best (see
        `subset.select`).
    gain : float
        By how many standard deviations the data change when it moves by the spread of a uniform distribution between
        its bounds, without what the parameters of lower rank can do. Below 1 it could as well be fixed.
    """

    name: str
    unit: str
    group: str
    value: float
    std: float
    interval: tuple[float, float]
    method: Method
    lower: float
    upper: float
    at_bound: bool
    determined: bool
    rank: int
    gain: float


@dataclass(frozen=True, eq=False, kw_only=True)
class Start:
    """One descent: where it began and ended, and how the objective fell.

    Attributes
    ----------
    first, last : (n_parameter,) float
        Parameters at the beginning and at the end.
    objective : (n_evaluation,) float
        Half the sum of squares at each point tried, in order.
    converged : bool
        Whether a tolerance was met before the steps ran out.
    """

    first: NDArray[np.float64]
    last: NDArray[np.float64]
    objective: NDArray[np.float64]
    converged: bool

    def __post_init__(self) -> None:
        for name in ("first", "last", "objective"):
            object.__setattr__(self, name, readonly("Start", name, getattr(self, name), (None,)))


@dataclass(frozen=True, eq=False, kw_only=True)
class ConfigurationFit:
    """One configuration of a joint fit.

    Attributes
    ----------
    name : str
        The configuration.
    used : (n_mode,) bool
        Modes that took part; the others are predicted.
    measured_frequency, measured_damping : (n_mode,) float
        What was measured, Hz and ratio.
    frequency, damping : (n_mode,) float
        The fitted model's; NaN where it has no such mode.
    frequency_before, damping_before : (n_mode,) float
        Those of the stack before the fit.
    mac : (n_mode,) float
        MAC of measured and fitted shapes; NaN where modes were paired by class.
    """

    name: str
    used: NDArray[np.bool_]
    measured_frequency: NDArray[np.float64]
    measured_damping: NDArray[np.float64]
    frequency: NDArray[np.float64]
    damping: NDArray[np.float64]
    frequency_before: NDArray[np.float64]
    damping_before: NDArray[np.float64]
    mac: NDArray[np.float64]

    def __post_init__(self) -> None:
        used = readonly("ConfigurationFit", "used", self.used, (None,), bool)
        object.__setattr__(self, "used", used)
        for field in dataclasses.fields(self)[2:]:
            value = readonly("ConfigurationFit", field.name, getattr(self, field.name), used.shape)
            object.__setattr__(self, field.name, value)

    @property
    def relative_error(self) -> NDArray[np.float64]:
        """Error of each frequency, model less measured over measured (n_mode,)."""
        return np.asarray(self.frequency / self.measured_frequency - 1.0)

    @property
    def relative_damping_error(self) -> NDArray[np.float64]:
        """Error of each damping ratio, model less measured over measured (n_mode,); NaN where none was measured."""
        known = np.where(self.measured_damping > 0.0, self.measured_damping, np.nan)
        return np.asarray(self.damping / known - 1.0)


@dataclass(frozen=True, eq=False, kw_only=True)
class JointFit:
    """Several configurations fitted at once.

    Attributes
    ----------
    effect : tuple of str
        The effects whose parameters were fitted.
    parameter : tuple of FittedParameter
        The estimates.
    covariance : (n_parameter, n_parameter) float
        Of the estimates, in their units; zero for those at a bound.
    chi_square : float
        Sum of squared weighted differences, priors included.
    n_residual : int
        Their number.
    configuration : tuple of ConfigurationFit
        What came of each configuration.
    start : tuple of Start
        The convergence record; the best comes first.
    """

    effect: tuple[str, ...]
    parameter: tuple[FittedParameter, ...]
    covariance: NDArray[np.float64]
    chi_square: float
    n_residual: int
    configuration: tuple[ConfigurationFit, ...]
    start: tuple[Start, ...]

    def __post_init__(self) -> None:
        n = len(self.parameter)
        object.__setattr__(self, "covariance", readonly("JointFit", "covariance", self.covariance, (n, n)))

    @property
    def correlation(self) -> NDArray[np.float64]:
        """Correlation of the estimates (n_parameter, n_parameter); zero for those at a bound."""
        std = np.sqrt(np.diag(self.covariance))
        safe = np.where(std > 0.0, std, np.inf)
        return np.asarray(self.covariance / np.outer(safe, safe))

    @property
    def subset(self) -> tuple[FittedParameter, ...]:
        """The parameters that the data alone determine together, the best known first; the others may be fixed."""
        return tuple(sorted((p for p in self.parameter if p.gain > 1.0), key=lambda p: p.rank))

    def value(self, name: str, group: str = "") -> float:
        """Return an estimate.

        Raises
        ------
        FitError
            There is no such parameter.
        """
        for p in self.parameter:
            if (p.name, p.group) == (name, group):
                return p.value
        message = f"no fitted parameter {name!r} of {group or 'all'}; there are " + ", ".join(
            f"{p.name} of {p.group or 'all'}" for p in self.parameter
        )
        raise FitError(message)

    def error(self, *, held_out: bool = False, before: bool = False, damping: bool = False) -> float:
        """Return the mean relative error of frequencies, eq. (2), or of damping ratios.

        Over the modes used, or over those held out; NaN where there are none.
        """
        measured, model = [], []
        for c in self.configuration:
            known = c.measured_damping if damping else c.measured_frequency
            name = ("damping" if damping else "frequency") + ("_before" if before else "")
            found = getattr(c, name)
            chosen = (c.used != held_out) & np.isfinite(known) & np.isfinite(found)
            measured.append(known[chosen])
            model.append(found[chosen])
        together = np.concatenate(measured)
        return frequency_error(together, np.concatenate(model)) if together.size else float("nan")


@single_threaded
def joint_fit(
    prepared: Sequence[Prepared],
    settings: FitSettings | None = None,
    *,
    n_start: int | None = None,
    first: Mapping[str, float] | JointFit | None = None,
    intervals: Method = "normal",
    seed: int = 0,
    executor: Executor | None = None,
) -> JointFit:
    """Fit contact parameters and effects to several configurations at once.

    Parameters
    ----------
    prepared : sequence of Prepared
        The configurations, from `prepare`.
    settings : FitSettings, optional
        What is free, shared, fixed, bounded, known beforehand and held out; by default all effects of the stacks are
        fitted to all modes.
    n_start : int, optional
        Descents: from the effects' nominal values, from near their neutral ones, and from points of a Sobol
        sequence. Each begins with the best G_f of a scan. Without effects there is one; by default 4 with one effect
        parameter and 8 with more, for where an effect acts has several valleys.
    first : mapping of str to float, or JointFit, optional
        Where the first descent begins: values of effects' parameters in place of the nominal ones, or what another
        fit has found, G_f included, with effects that it lacked at their neutral values.
    intervals : "normal", "profile" or "bootstrap"
        Where intervals come from. With "profile", the normal interval of a parameter that configurations share is kept
        where the profile of chi-square confirms it; the others are normal. With "bootstrap", all come from fits
        to simulated data.
    seed : int
        Of the simulated data.
    executor : Executor, optional
        Where descents and fits to simulated data run, such as `updating.workers.workers.workers`; by default here.

    Raises
    ------
    FitError
        A name is unknown, nothing is left to fit, or no descent converges.
    """
    require_known("intervals", [intervals], get_args(Method))
    problem = Problem(prepared, settings or FitSettings())
    found = _descents(problem, n_start, first, executor)
    return _joint_fit(problem, found, intervals, seed, executor)


def _joint_fit(
    problem: Problem, found: Sequence[Descent], intervals: Method, seed: int, executor: Executor | None
) -> JointFit:
    """Return what the best descent found, with standard deviations and intervals, and the record of all."""
    x = found[0].last
    residual, _ = problem.evaluate(x)
    spread, inflation = covariance(problem, x)
    between = normal_intervals(problem, x, spread)
    method: Sequence[Method] = ["normal"] * x.size
    if intervals == "profile":
        between, method = profile_intervals(problem, x, between, inflation)
    elif intervals == "bootstrap":
        between = bootstrap_intervals(problem, x, inflation, seed=seed, executor=executor)
        method = ["bootstrap"] * x.size
    slope = _slopes(problem, x)
    return JointFit(
        effect=problem.effects,
        parameter=_parameters(problem, x, np.sqrt(np.diag(spread)), inflation, between, method),
        covariance=spread * np.outer(slope, slope),
        chi_square=float(residual @ residual),
        n_residual=residual.size,
        configuration=tuple(_configuration(problem, i, x) for i in range(len(problem.prepared))),
        start=tuple(
            Start(
                first=problem.value(descent.first),
                last=problem.value(descent.last),
                objective=descent.objective,
                converged=descent.converged,
            )
            for descent in found
        ),
    )


def _descents(
    problem: Problem,
    n_start: int | None,
    first: Mapping[str, float] | JointFit | None,
    executor: Executor | None,
) -> list[Descent]:
    """Descend from every start and return the descents, the best first."""
    usual = 4 if len(problem.of_effects) == 1 else 8
    n = (n_start or usual) if problem.of_effects else 1
    near = {(p.name, p.group): p.value for p in first.parameter} if isinstance(first, JointFit) else {}
    given = {} if first is None or isinstance(first, JointFit) else first
    found = list(distribute(partial(descend, problem), starts(problem, n, given, near), executor))
    found.sort(key=lambda descent: descent.cost)
    if not found[0].converged:
        message = (
            f"the fit did not converge in {found[0].objective.size} evaluations; fix or bound a parameter"
        )
        raise FitError(message)
    return found


def _slopes(problem: Problem, x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the derivative of each parameter by its search variable."""
    return np.array([f.slope(v) for f, v in zip(problem.free, problem.value(x), strict=True)])


def _parameters(
    problem: Problem,
    x: NDArray[np.float64],
    std: NDArray[np.float64],
    inflation: NDArray[np.float64],
    between: NDArray[np.float64],
    method: Sequence[Method],
) -> tuple[FittedParameter, ...]:
    """Return the estimates at x, with standard deviations and intervals of the search variables."""
    value, slope, bounded = problem.value(x), _slopes(problem, x), at_bound(problem, x)
    uniform = (problem.high - problem.low) / np.sqrt(12.0)
    _, jacobian = problem.evaluate(x)
    data = (problem.block != PRIOR)[:, None] * jacobian / inflation[:, None]
    order, gain = select(data * uniform)
    rank = np.argsort(order)
    return tuple(
        FittedParameter(
            name=f.name, unit=f.unit, group=f.group, value=float(value[j]), std=float(std[j] * slope[j]),
            interval=(f.outward(float(between[j, 0])), f.outward(float(between[j, 1]))), method=method[j],
            lower=f.lower, upper=f.upper, at_bound=bool(bounded[j]),
            determined=bool(not bounded[j] and std[j] < uniform[j]), rank=int(rank[j]) + 1, gain=float(gain[j]),
        )
        for j, f in enumerate(problem.free)
    )  # fmt: skip


def _configuration(problem: Problem, i: int, x: NDArray[np.float64]) -> ConfigurationFit:
    prepared = problem.prepared[i]
    target, contact = prepared.target, prepared.target.stack.contact
    after, column = problem.modes(i, x)
    before, column_before = solve_target(prepared, {"G_f": contact.G_f, "d_f": contact.d_f}, ())
    likeness = np.full(target.frequency.size, np.nan)
    if not target.shape_class:
        likeness = mac(target.shape, after.shape)[np.arange(column.size), column]
    return ConfigurationFit(
        name=target.name,
        used=problem.used[i],
        measured_frequency=target.frequency,
        measured_damping=target.damping,
        frequency=np.where(column >= 0, after.frequency[column], np.nan),
        damping=np.where(column >= 0, after.damping[column], np.nan),
        frequency_before=np.where(column_before >= 0, before.frequency[column_before], np.nan),
        damping_before=np.where(column_before >= 0, before.damping[column_before], np.nan),
        mac=likeness,
    )
