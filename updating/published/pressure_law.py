"""How contact stiffness grows with pressure: G = G_f p against G ~ p^n, from stacks measured at two torques."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from ema.types.arrays import readonly
from updating.fitting.intervals import Method
from updating.fitting.joint_fit import JointFit, joint_fit
from updating.fitting.joint_problem import FitSettings
from updating.fitting.prepared import Prepared
from updating.fitting.sensitivity import Scatter

_RANGE = (-1.0, 2.0)  # of the exponent: stiffness that falls with pressure must not be excluded beforehand


@dataclass(frozen=True, eq=False, kw_only=True)
class PressureLaw:
    """The exponent n of G ~ p^n, one for all stacks, and what it does to predicting one torque from another.

    Attributes
    ----------
    exponent, std : float
        Estimate and standard deviation from the curvature at the optimum.
    interval : (float, float)
        Of 95 %, from the profile of chi-square or, where that confirms it, from `std`.
    jackknife : (float, float)
        Of 95 %, from the estimates without each stack in turn: it counts how much stacks differ.
    stack : tuple of str
        The stacks.
    own : (n_stack,) float
        Exponent of each stack alone.
    measured : (n_stack, n_mode) float
        Frequencies at the lower torque, Hz; NaN where not measured.
    linear, power : (n_stack, n_mode) float
        The same predicted from the higher torque, G_f fitted there: with n = 1, and with n and the effects' parameters
        of the other stacks, Hz.
    refitted : (n_stack, n_mode) float
        The same with G_f fitted at the lower torque itself: the least error that any law could have.
    """

    exponent: float
    std: float
    interval: tuple[float, float]
    jackknife: tuple[float, float]
    stack: tuple[str, ...]
    own: NDArray[np.float64]
    measured: NDArray[np.float64]
    linear: NDArray[np.float64]
    power: NDArray[np.float64]
    refitted: NDArray[np.float64]

    def __post_init__(self) -> None:
        n = len(self.stack)
        object.__setattr__(self, "own", readonly("PressureLaw", "own", self.own, (n,)))
        for name in ("measured", "linear", "power", "refitted"):
            object.__setattr__(self, name, readonly("PressureLaw", name, getattr(self, name), (n, None)))

    def error(self, law: str) -> float:
        """Return the mean relative error, eq. (2), at the lower torque by "linear", "power" or "refitted"."""
        return float(np.nanmean(np.abs(getattr(self, law) / self.measured - 1.0)))


def pressure_law(
    prepared: Sequence[Prepared], *, effects: Collection[str] = (), scatter: Scatter
) -> PressureLaw:
    """Fit n to stacks measured at two pressures, G_f of each stack its own and the effects' parameters shared.

    Parameters
    ----------
    prepared : sequence of Prepared
        Two configurations of each specimen, with the effect pressure_exponent on their stacks.
    effects : collection of str
        Further effects.
    scatter : Scatter
        Standard deviation of the model.

    Raises
    ------
    FitError
        A fit fails.
    """
    low, high = _pairs(prepared)
    stacks = tuple(one.target.specimen for one in low)
    best = _fit(prepared, effects, scatter, {}, intervals="profile")
    estimate = next(p for p in best.parameter if p.name == "exponent")
    n = estimate.value
    shared = {p.name: p.value for p in best.parameter if not p.group}
    own, without, linear, power, refitted = [], [], [], [], []
    for weak, strong in zip(low, high, strict=True):
        rest = {name: value for name, value in shared.items() if name != "exponent"}
        own.append(_fit([weak, strong], effects, scatter, rest).value("exponent"))
        remaining = _fit([p for p in prepared if p not in (weak, strong)], effects, scatter, {}, best)
        known = {p.name: p.value for p in remaining.parameter if not p.group}
        without.append(known["exponent"])
        # the other parameters are fitted to the same data under each law: only what n does is compared
        held = {weak.target.name: range(weak.target.frequency.size)}
        proportional = _fit(
            [p for p in prepared if p not in (weak, strong)], effects, scatter, {"exponent": 1.0}, best
        )
        fixed = {p.name: p.value for p in proportional.parameter if not p.group} | {"exponent": 1.0}
        linear.append(_fit([weak, strong], effects, scatter, fixed, held=held).configuration[0].frequency)
        power.append(_fit([weak, strong], effects, scatter, known, held=held).configuration[0].frequency)
        refitted.append(_fit([weak], effects, scatter, known).configuration[0].frequency)
    spread = float(np.sqrt((len(stacks) - 1) * np.var(without)) * stdtrit(len(stacks) - 1, 0.975))
    return PressureLaw(
        exponent=n,
        std=estimate.std,
        interval=estimate.interval,
        jackknife=(n - spread, n + spread),
        stack=stacks,
        own=np.array(own),
        measured=np.array([one.target.frequency for one in low]),
        linear=np.array(linear),
        power=np.array(power),
        refitted=np.array(refitted),
    )


def _fit(
    prepared: Sequence[Prepared],
    effects: Collection[str],
    scatter: Scatter,
    fixed: Mapping[str, float],
    first: JointFit | None = None,
    held: Mapping[str, Collection[int]] | None = None,
    intervals: Method = "normal",
) -> JointFit:
    return joint_fit(
        prepared,
        FitSettings(
            effects=(*effects, "pressure_exponent"),
            fixed=fixed,
            bounds={"exponent": _RANGE},
            hold_out=held or {},
            damping=False,
            scatter=scatter,
        ),
        n_start=1 if first else None,
        first=first,
        intervals=intervals,
    )


def _pairs(prepared: Sequence[Prepared]) -> tuple[list[Prepared], list[Prepared]]:
    """Return the configuration of lower and of higher pressure of each specimen that has both."""
    specimens = dict.fromkeys(one.target.specimen for one in prepared)
    low, high = [], []
    for specimen in specimens:
        both = sorted(
            (one for one in prepared if one.target.specimen == specimen),
            key=lambda one: one.target.stack.contact.pressure,
        )
        if len(both) == 2:
            low.append(both[0])
            high.append(both[1])
    return low, high
