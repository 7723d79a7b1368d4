"""What each physical effect does to the error, on data used and on data held out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from updating.joint_fit import FittedParameter, JointFit, joint_fit
from updating.prepared import Prepared
from updating.sensitivity import Scatter


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
        The same of each mode predicted by a fit without it (the mode of the same number of all configurations).
    configuration_error : float
        The same of each configuration with shared parameters from the others and its own contact parameters
        fitted; NaN where there is one only.
    chi_square : float
        Of the fit to all data.
    n_residual : int
        Number of weighted differences in it.
    shared : tuple of FittedParameter
        The effects' parameters.
    """

    effects: tuple[str, ...]
    error: float
    mode_error: float
    configuration_error: float
    chi_square: float
    n_residual: int
    shared: tuple[FittedParameter, ...]


def ledger(
    prepared: Sequence[Prepared],
    effects: Sequence[str],
    *,
    damping: bool = True,
    scatter: Scatter | None = None,
) -> tuple[Entry, ...]:
    """Fit the base model, the base model with each effect, and with all of them.

    Parameters
    ----------
    prepared : sequence of Prepared
        The configurations, whose stacks have these effects.
    effects : sequence of str
        Their names.
    damping : bool
        Whether damping ratios take part.
    scatter : Scatter, optional
        Standard deviation beyond the identification's.

    Raises
    ------
    FitError
        A fit fails.
    """
    sets = [(), *((name,) for name in effects), *([tuple(effects)] if len(effects) > 1 else [])]
    return tuple(_entry(prepared, chosen, damping, scatter) for chosen in sets)


def _entry(
    prepared: Sequence[Prepared], effects: tuple[str, ...], damping: bool, scatter: Scatter | None
) -> Entry:
    whole = joint_fit(prepared, effects=effects, damping=damping, scatter=scatter)
    known = _shared(whole)
    n_mode = max(p.used.size for p in prepared)
    by_mode: list[NDArray[np.float64]] = []
    for r in range(n_mode):
        out = {p.target.name: [r] for p in prepared if r < p.used.size and p.used[r]}
        fit = joint_fit(
            prepared, effects=effects, hold_out=out, damping=damping, scatter=scatter, n_start=1, first=known
        )
        by_mode += [np.abs(c.relative_error[[r]]) for c in fit.configuration if c.name in out]
    by_configuration: list[NDArray[np.float64]] = []
    for one in prepared if len(prepared) > 1 else ():
        rest = [p for p in prepared if p is not one]
        others = joint_fit(rest, effects=effects, damping=damping, scatter=scatter, n_start=1, first=known)
        own = joint_fit([one], effects=effects, fixed=_shared(others), damping=damping, scatter=scatter)
        by_configuration.append(np.abs(own.configuration[0].relative_error[one.used]))
    return Entry(
        effects=effects,
        error=whole.error(),
        mode_error=_mean(by_mode),
        configuration_error=_mean(by_configuration),
        chi_square=whole.chi_square,
        n_residual=whole.n_residual,
        shared=tuple(p for p in whole.parameter if not p.group),
    )


def _shared(fit: JointFit) -> dict[str, float]:
    return {p.name: p.value for p in fit.parameter if not p.group}


def _mean(errors: list[NDArray[np.float64]]) -> float:
    return float(np.nanmean(np.concatenate(errors))) if errors else float("nan")
