"""Several configurations fitted at once, with parameters of their own and parameters that they share.

Weighted least squares over frequencies, damping ratios and shape vectors, which is maximum likelihood for normal
errors, from several starts, with the derivatives of `solve_modes`.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from ema.arrays import readonly
from ema.mac import mac
from updating.errors import FitError
from updating.joint_problem import Problem, Scope
from updating.objective import frequency_error
from updating.prepared import Prepared, solve_target
from updating.sensitivity import Scatter

_AT_BOUND = 1e-4  # of the range


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
        errors, it grows with the root of chi-square over the degrees of freedom.
    lower, upper : float
        Bounds.
    at_bound : bool
        Whether the estimate lies on a bound: then the data ask for a value outside, and `std` means nothing.
    determined : bool
        Whether the data, with the priors, say more than the bounds do: the standard deviation is less than that of
        a uniform distribution between them.
    """

    name: str
    unit: str
    group: str
    value: float
    std: float
    lower: float
    upper: float
    at_bound: bool
    determined: bool


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

    def error(self, *, held_out: bool = False, before: bool = False) -> float:
        """Return the mean relative frequency error, eq. (2), over the modes used, or over those held out.

        NaN where there are none.
        """
        measured, model = [], []
        for c in self.configuration:
            f = c.frequency_before if before else c.frequency
            chosen = (c.used != held_out) & np.isfinite(c.measured_frequency) & np.isfinite(f)
            measured.append(c.measured_frequency[chosen])
            model.append(f[chosen])
        together = np.concatenate(measured)
        return frequency_error(together, np.concatenate(model)) if together.size else float("nan")


def joint_fit(
    prepared: Sequence[Prepared],
    *,
    effects: Collection[str] | None = None,
    scope: Mapping[str, Scope] | None = None,
    fixed: Mapping[str, float] | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    priors: Mapping[str, tuple[float, float]] | None = None,
    hold_out: Mapping[str, Collection[int]] | None = None,
    damping: bool = True,
    scatter: Scatter | None = None,
    n_start: int = 4,
    first: Mapping[str, float] | None = None,
) -> JointFit:
    """Fit contact parameters and effects to several configurations at once.

    Parameters
    ----------
    prepared : sequence of Prepared
        The configurations, from `prepare`.
    effects : collection of str, optional
        Effects of the stacks whose parameters are free; by default all. The others keep the stacks' values.
    scope : mapping of parameter name to "all", "specimen" or "configuration", optional
        Who shares a parameter; by default each configuration has its own G_f and d_f, and all share the effects'.
    fixed : mapping of str to float, optional
        Values of parameters that are not fitted.
    bounds : mapping of str to (float, float), optional
        In place of the default bounds: those of `fit` for G_f and d_f, the plausible ranges for effects.
    priors : mapping of str to (float, float), optional
        Mean and standard deviation of a normal distribution from other knowledge, for each group of a parameter.
    hold_out : mapping of str to collection of int, optional
        Modes by configuration, counted from 0, that do not take part and are predicted.
    damping : bool
        Whether damping ratios take part; without, d_f is no parameter.
    scatter : Scatter, optional
        Standard deviation beyond the identification's; the default of `Scatter`.
    n_start : int
        Descents: from the effects' nominal values, from near their neutral ones, and from points of a Sobol
        sequence. Each begins with the best G_f of a scan. Without effects there is one.
    first : mapping of str to float, optional
        Values of effects' parameters from which the first descent begins, in place of the nominal ones.

    Raises
    ------
    FitError
        A name is unknown, nothing is left to fit, or no descent converges.
    """
    problem = Problem(
        prepared,
        effects=effects,
        scope=scope or {},
        fixed=fixed or {},
        bounds=bounds or {},
        priors=priors or {},
        hold_out=hold_out or {},
        damping=damping and any(np.any(np.isfinite(p.target.damping)) for p in prepared),
        scatter=scatter or Scatter(),
    )
    starts = []
    for begin in problem.starts(n_start if problem.has_effects else 1, first or {}):
        history: list[float] = []

        def residual(x: NDArray[np.float64], record: list[float] = history) -> NDArray[np.float64]:
            value = problem.evaluate(x)[0]
            record.append(0.5 * float(value @ value))
            return value

        found = least_squares(
            residual,
            begin,
            jac=lambda x: problem.evaluate(x)[1],
            bounds=(problem.low, problem.high),
            x_scale="jac",
            xtol=1e-8,
            ftol=1e-10,
            max_nfev=100,
        )
        starts.append((found.cost, found.x, begin, history, found.status > 0))
    starts.sort(key=lambda s: s[0])
    if not starts[0][-1]:
        message = f"the fit did not converge in {len(starts[0][3])} evaluations; fix or bound a parameter"
        raise FitError(message)
    return _result(
        problem,
        starts[0][1],
        tuple(
            Start(
                first=problem.value(begin),
                last=problem.value(last),
                objective=np.array(history),
                converged=converged,
            )
            for _, last, begin, history, converged in starts
        ),
    )


def _result(problem: Problem, x: NDArray[np.float64], starts: tuple[Start, ...]) -> JointFit:
    residual, jacobian = problem.evaluate(x)
    value = problem.value(x)
    reach = problem.high - problem.low
    at_bound = np.minimum(x - problem.low, problem.high - x) < _AT_BOUND * reach
    slope = np.array([f.slope(v) for f, v in zip(problem.free, value, strict=True)])
    inner = np.flatnonzero(~at_bound)
    degrees = max(1, residual.size - inner.size)
    inflation = max(1.0, float(residual @ residual) / degrees)
    covariance = np.zeros((x.size, x.size))
    covariance[np.ix_(inner, inner)] = inflation * np.linalg.pinv(
        jacobian[:, inner].T @ jacobian[:, inner], rcond=1e-12, hermitian=True
    )
    std = np.sqrt(np.diag(covariance))
    seen = np.linalg.norm(jacobian, axis=0) > 0.0
    return JointFit(
        effect=problem.effects,
        parameter=tuple(
            FittedParameter(
                name=f.name, unit=f.unit, group=f.group, value=float(value[j]),
                std=float(std[j] * slope[j]), lower=f.lower, upper=f.upper, at_bound=bool(at_bound[j]),
                determined=bool(seen[j] and not at_bound[j] and std[j] < reach[j] / np.sqrt(12.0)),
            )
            for j, f in enumerate(problem.free)
        ),
        covariance=covariance * np.outer(slope, slope),
        chi_square=float(residual @ residual),
        n_residual=residual.size,
        configuration=tuple(_configuration(problem, i, x) for i in range(len(problem.prepared))),
        start=starts,
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
