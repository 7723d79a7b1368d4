"""What each physical effect does to the error, on data used and on data held out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import ArrayLike, NDArray

from updating.fitting.estimate import ParameterEstimate
from updating.fitting.joint_fit import FittedParameter, JointFit, joint_fit
from updating.fitting.joint_problem import FitSettings
from updating.fitting.prepared import Prepared
from updating.workers.workers import distribute


@dataclass(frozen=True, eq=False, kw_only=True)
class Entry:
    """One line of the ledger.

    Attributes
    ----------
    effects : tuple of str
        Effects that were added; none is the base model.
    error : float
        Mean relative frequency error, eq. (2), after the fit.
    mode_error : float
        The same of each mode of each configuration, predicted by a fit to all others.
    configuration_error : float
        The same of each configuration predicted by a fit without it, at its nominal pressure. What it shares with no
        other, such as the contact parameters of a stack that was measured once, is fitted to it.
        NaN where there is one configuration only, or where the others leave a shared parameter undetermined.
    damping_error, mode_damping_error, configuration_damping_error : float
        The same of damping ratios; NaN where they did not take part.
    chi_square : float
        Of the fit to all data.
    n_residual : int
        Number of weighted differences in it.
    shared : tuple of ParameterEstimate
        The effects' parameters.
    pressure : tuple of FittedParameter
        Pressure of each configuration, where it was free about its nominal value. A pressure far off says that
        the model could meet these data by that alone.
    """

    effects: tuple[str, ...]
    error: float
    mode_error: float
    configuration_error: float
    damping_error: float
    mode_damping_error: float
    configuration_damping_error: float
    chi_square: float
    n_residual: int
    shared: tuple[ParameterEstimate, ...]
    pressure: tuple[FittedParameter, ...]


@dataclass(frozen=True, eq=False, kw_only=True)
class Ledger:
    """The ledger as it is written."""

    entry: tuple[Entry, ...]


def ledger(
    prepared: Sequence[Prepared],
    effects: Sequence[str],
    settings: FitSettings | None = None,
    *,
    executor: Executor | None = None,
) -> tuple[Entry, ...]:
    """Fit the base model, the base model with each effect, and with all of them.

    Parameters
    ----------
    prepared : sequence of Prepared
        The configurations, whose stacks have these effects.
    effects : sequence of str
        Their names.
    settings : FitSettings, optional
        As in `joint_fit`; which effects are fitted and which modes are held out is chosen here.
    executor : Executor, optional
        Where the fits run; by default here.

    Raises
    ------
    FitError
        A fit fails.
    """
    settings = settings or FitSettings()
    alone: list[tuple[str, ...]] = [(), *((name,) for name in effects)]
    fits = list(distribute(partial(_fit, prepared, settings), alone, executor))
    if len(effects) > 1:  # all together begin with the best one, than which they may not come out worse
        best = min(fits, key=lambda fit: fit.chi_square)
        fits.append(_fit(prepared, settings, tuple(effects), first=best, n_start=4))
    return tuple(distribute(partial(_entry, prepared, settings), fits, executor))


def _entry(prepared: Sequence[Prepared], settings: FitSettings, whole: JointFit) -> Entry:
    effects = whole.effect
    by_mode, by_configuration = _Errors(), _Errors()
    for p in prepared:
        for r in np.flatnonzero(p.used):
            if sum(np.count_nonzero(other.used) for other in _kin(prepared, p)) > 1:
                fit = _fit(prepared, settings, effects, first=whole, hold_out={p.target.name: [int(r)]})
                by_mode.add(fit, p.target.name, [int(r)])
    for one in prepared if len(prepared) > 1 else ():
        predicted = _without(prepared, one, effects, settings, whole)
        if predicted is not None:
            by_configuration.add(predicted, one.target.name, np.flatnonzero(one.used))
    return Entry(
        effects=effects,
        error=whole.error(),
        mode_error=by_mode.frequency(),
        configuration_error=by_configuration.frequency(),
        damping_error=whole.error(damping=True) if settings.damping else float("nan"),
        mode_damping_error=by_mode.damping() if settings.damping else float("nan"),
        configuration_damping_error=by_configuration.damping() if settings.damping else float("nan"),
        chi_square=whole.chi_square,
        n_residual=whole.n_residual,
        shared=tuple(_estimate(p) for p in whole.parameter if not p.group),
        pressure=tuple(p for p in whole.parameter if p.name == "pressure"),
    )


def _estimate(p: FittedParameter) -> ParameterEstimate:
    return ParameterEstimate(
        name=p.name,
        unit=p.unit,
        value=p.value,
        lower=p.interval[0],
        upper=p.interval[1],
        at_bound=p.at_bound,
        determined=p.determined,
    )


def _without(
    prepared: Sequence[Prepared],
    one: Prepared,
    effects: tuple[str, ...],
    settings: FitSettings,
    whole: JointFit,
) -> JointFit | None:
    """Return a fit that predicts one configuration from the others; None where they do not determine enough."""
    rest = [p for p in prepared if p is not one]
    if not any(np.any(p.used) for p in rest):
        return None
    kin = len(_kin(prepared, one)) > 1
    alone = any(scope == "configuration" for scope in settings.scope.values())
    if kin and not alone:
        out = {one.target.name: range(one.used.size)}
        apart = _fit(prepared, settings, effects, first=whole, hold_out=out)
    else:
        apart = _fit(rest, settings, effects, first=whole)
    if not all(p.determined or p.at_bound for p in apart.parameter if not p.group):
        return None
    if kin and not alone:
        return apart
    known_of = {p.name: p.value for p in apart.parameter if p.group in ("", one.target.specimen)}
    return _fit([one], settings, effects, fixed=known_of)


def _kin(prepared: Sequence[Prepared], one: Prepared) -> list[Prepared]:
    """Return the configurations of one stack."""
    return [p for p in prepared if p.target.specimen == one.target.specimen]


def _fit(
    prepared: Sequence[Prepared],
    settings: FitSettings,
    effects: tuple[str, ...],
    *,
    first: JointFit | None = None,
    n_start: int | None = None,
    fixed: Mapping[str, float] | None = None,
    hold_out: Mapping[str, Sequence[int]] | None = None,
) -> JointFit:
    own = replace(
        settings, effects=effects, fixed={**settings.fixed, **(fixed or {})}, hold_out=hold_out or {}
    )
    return joint_fit(prepared, own, first=first, n_start=n_start or (None if first is None else 1))


class _Errors:
    """Errors of predicted modes, collected over several fits."""

    def __init__(self) -> None:
        self._frequency: list[NDArray[np.float64]] = []
        self._damping: list[NDArray[np.float64]] = []

    def add(self, fit: JointFit, configuration: str, modes: ArrayLike) -> None:
        (found,) = (c for c in fit.configuration if c.name == configuration)
        self._frequency.append(np.abs(found.relative_error[np.asarray(modes)]))
        self._damping.append(np.abs(found.relative_damping_error[np.asarray(modes)]))

    def frequency(self) -> float:
        return _mean(self._frequency)

    def damping(self) -> float:
        return _mean(self._damping)


def _mean(errors: list[NDArray[np.float64]]) -> float:
    together = np.concatenate(errors) if errors else np.empty(0)
    return float(np.nanmean(together)) if np.any(np.isfinite(together)) else float("nan")
