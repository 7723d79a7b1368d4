"""How contact stiffness grows with pressure: G = G_f p against G ~ p^n, from stacks measured at two torques."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from ema.types.arrays import readonly
from updating.fitting.prepared import Prepared
from updating.fitting.shared_opt_G import SharedFit, fit_shared_opt_G

_RANGE = (-1.0, 2.0)  # of the exponent: stiffness that falls with pressure must not be excluded beforehand


@dataclass(frozen=True, eq=False, kw_only=True)
class PressureLaw:
    """The exponent n of G ~ p^n, one for all stacks, and what it does to predicting one torque from another.

    Attributes
    ----------
    exponent, std : float
        Estimate and standard deviation.
    interval : (float, float)
        Of 95 %, Student's.
    jackknife : (float, float)
        Of 95 %, from the estimates without each stack in turn: it counts how much stacks differ.
    stack : tuple of str
        The stacks.
    own : (n_stack,) float
        Exponent of each stack alone.
    measured : (n_stack, n_mode) float
        Frequencies at the lower torque, Hz; NaN where not measured.
    linear, power : (n_stack, n_mode) float
        The same predicted from the higher torque and all other stacks, with n = 1 and with n, Hz.
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


def pressure_law(prepared: Sequence[Prepared], *, effects: Collection[str] = ()) -> PressureLaw:
    """Fit n by opt_G to stacks measured at two pressures, G_f of each stack its own and the effects' parameters shared.

    Parameters
    ----------
    prepared : sequence of Prepared
        Two configurations of each specimen, with the effect pressure_exponent on their stacks.
    effects : collection of str
        Further effects.

    Raises
    ------
    FitError
        A fit fails.
    """
    low, high = _pairs(prepared)
    every = [own for pair in zip(low, high, strict=True) for own in pair]
    power, linear = _fit(every, effects, {}), _fit(every, effects, {"exponent": 1.0})
    refitted, without, own = [], [], []
    shared = {p.name: p.value for p in power.parameter}
    for i, (weak, strong) in enumerate(zip(low, high, strict=True)):
        rest = {name: value for name, value in shared.items() if name != "exponent"}
        own.append(_exponent(_fit([weak, strong], effects, rest, first=power))[0])
        others = every[: 2 * i] + every[2 * i + 2 :]
        known = _fit(others, effects, {}, first=power)
        without.append(_exponent(known)[0])
        fixed = {p.name: p.value for p in known.parameter}
        refitted.append(_fit([weak], effects, fixed, first=power).frequency[0])
    n, std, interval = _exponent(power)
    spread = float(np.sqrt((len(low) - 1) * np.var(without)) * stdtrit(len(low) - 1, 0.975))
    return PressureLaw(
        exponent=n,
        std=std,
        interval=interval,
        jackknife=(n - spread, n + spread),
        stack=tuple(one.target.specimen for one in low),
        own=np.array(own),
        measured=np.array([one.target.frequency for one in low]),
        linear=np.array(linear.left_out[::2]),
        power=np.array(power.left_out[::2]),
        refitted=np.array(refitted),
    )


def _fit(
    prepared: Sequence[Prepared],
    effects: Collection[str],
    fixed: Mapping[str, float],
    *,
    first: SharedFit | None = None,
) -> SharedFit:
    """Fit from everywhere, with configurations left out in turn; or only from another fit, without."""
    return fit_shared_opt_G(
        prepared,
        (*effects, "pressure_exponent"),
        fixed=fixed,
        bounds={"exponent": _RANGE},
        first=first,
        anew=first is None,
        left_out=first is None,
    )


def _exponent(found: SharedFit) -> tuple[float, float, tuple[float, float]]:
    """Return the exponent, its standard deviation and interval."""
    (j,) = (j for j, p in enumerate(found.parameter) if p.name == "exponent")
    p = found.parameter[j]
    return p.value, found.std[j], (p.lower, p.upper)


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
