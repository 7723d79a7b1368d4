"""A stack as an explanation was fitted with it, and its modes beside those of each configuration."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ema.plot import palette
from ema.types.arrays import single_threaded
from ema.types.modal_model import ModalModel
from lamella_shared import arrays
from model import Effect, Stack, observe, solve_modes
from updating.correlation.pairing import pair
from updating.correlation.registration import register
from updating.correlation.rig_check import RigCheck
from updating.diagnosis.answer import Moved, Ranked, Sizes
from updating.diagnosis.candidates import DIMENSIONS
from updating.diagnosis.evidence import D_F_START
from updating.errors import FitError
from updating.fitting.fit import Fit, frequency_error, kept_estimate, opt_d, opt_G, reduced_about
from updating.results.ledger import Entry

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_CLAMP = re.compile(r"clamp_(\d+)_([xy])")


def explained_stack(
    stack: Stack, explanation: Ranked, effects: Sequence[Effect], *, state: str, pressure: float | None = None
) -> Stack:
    """Return a stack with everything that an explanation moved, as it is in one configuration.

    Parameters
    ----------
    stack : Stack
        As its file states it.
    explanation : Ranked
        The explanation.
    effects : sequence of Effect
        Those of its effects that change the stack.
    state : str
        The configuration.
    pressure : float, optional
        Its pressure, Pa; by default that of the stack.
    """
    at, contact, material = explanation.nuisance, stack.contact, stack.material

    def ratio(*names: str) -> float:
        return float(np.exp(sum(at.get(name, 0.0) for name in names)))

    moved = [(int(m[1]) - 1, m[2], value) for name, value in at.items() if (m := _CLAMP.fullmatch(name))]
    clamps = list(stack.clamps)
    for i, axis, value in moved:
        clamps[i] = replace(clamps[i], **{axis: getattr(clamps[i], axis) + value})
    known = {p.name for effect in effects for p in effect.parameters}
    values = {p.name: p.value for p in explanation.parameter if p.name in known}
    made = replace(
        stack,
        **{name: ratio(name) * getattr(stack, name) for name in DIMENSIONS},
        material=replace(material, young=ratio("young") * material.young, density=ratio("density") * material.density),
        contact=replace(
            contact,
            G_f=ratio("G_f", f"G_f[{state}]") * contact.G_f,
            d_f=ratio("d_f", f"d_f[{state}]") * (contact.d_f or D_F_START),
            normal_modulus=ratio("normal_modulus") * contact.normal_modulus,
            pressure=contact.pressure if pressure is None else pressure,
        ),
        clamps=tuple(clamps),
    )
    return made.with_effects(*effects, **values) if effects else made


@single_threaded
def explained_model(
    stack: Stack, measured: ModalModel, modelled: Sequence[float], rig: RigCheck, *, threshold: float = 0.8
) -> Fit:
    """Put a stack as an explanation has it beside measured modes; nothing is fitted.

    Parameters
    ----------
    stack : Stack
        The stack.
    measured : ModalModel
        The identified modes.
    modelled : sequence of float
        The explanation's natural frequencies, Hz: those of an ever finer mesh.
    rig : RigCheck
        What contradicts the measurement.
    threshold : float
        Smallest MAC that makes a pair.

    Raises
    ------
    EffectError, FitError, PairingError, SolveError
        The stack cannot have its effects, no mode pairs, or points of the measurement do not lie on it.
    """
    n_mode = 22  # that are solved for pairing, rigid-body modes included
    registration = register(stack, measured.geometry, measured.node, measured.direction)
    system, contact = reduced_about(stack, n_mode), stack.contact
    observed = observe(system, registration.observation)
    modes = solve_modes(system, G_f=contact.G_f, d_f=contact.d_f, n_mode=n_mode, observation=observed, by=()).elastic()
    modes = replace(modes, frequency=modes.frequency * finer_ratio(modes.frequency, modelled))
    pairing = pair(measured, modes, threshold=threshold)
    if pairing.measured.size == 0:
        raise FitError(f"{measured.name}: no measured mode pairs with this model by a MAC of {threshold:g}")
    frequency, damping = measured.frequency[pairing.measured], measured.damping[pairing.measured]
    return Fit(
        name=measured.name,
        stack=stack,
        G_f=kept_estimate("G_f", "Pa/Pa", contact.G_f, opt_G(frequency, modes.frequency[pairing.model])),
        d_f=kept_estimate("d_f", "s/Pa", contact.d_f, opt_d(damping, modes.damping[pairing.model])),
        modes=modes,
        pairing=pairing,
        distance=registration.distance,
        error=frequency_error(frequency, modes.frequency[pairing.model]),
        rig=rig,
    )


def finer_ratio(frequency: NDArray[np.float64], modelled: Sequence[float]) -> NDArray[np.float64]:
    """Return an explanation's frequencies, of an ever finer mesh, over those of a mesh, (n,), both ascending.

    The explanation has the lowest of them; the last ratio holds for the others.
    """
    n = min(frequency.size, len(modelled))
    ratio = np.asarray(modelled[:n]) / frequency[:n]
    return np.append(ratio, np.full(frequency.size - n, ratio[-1] if n else 1.0))


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
        Estimate and standard deviation, what the model misses being integrated out.
    interval : (float, float)
        Of 95 %. An end at a bound is open: the data do not exclude what lies beyond.
    lower, upper : float
        Bounds.
    at_bound : bool
        Whether the estimate lies on a bound: then the data ask for a value outside, and `std` means nothing.
    determined : bool
        Whether the data, with what is known beforehand, say more than the bounds do: the standard deviation is less
        than that of a uniform distribution between them.
    """

    name: str
    unit: str
    group: str
    value: float
    std: float
    interval: tuple[float, float]
    lower: float
    upper: float
    at_bound: bool
    determined: bool


@dataclass(frozen=True, eq=False, kw_only=True)
@arrays(
    {
        "mode": "used measured_frequency measured_damping frequency damping frequency_left_out frequency_before "
        "damping_before mac"
    }
)
class ConfigurationFit:
    """One configuration of a joint fit.

    Attributes
    ----------
    name : str
        The configuration.
    used : (n_mode,) bool
        Modes that took part; the others are predicted.
    measured_frequency, measured_damping : (n_mode,) float
        What was measured, Hz and ratio; damping NaN where it did not take part.
    frequency, damping : (n_mode,) float
        The fitted model's.
    frequency_left_out : (n_mode,) float
        Of the model, where the configuration is left out and predicted from the others; NaN where there are none. The
        contact of a stack that was measured once is fitted to it.
    frequency_before, damping_before : (n_mode,) float
        Those of the stack before the fit.
    mac : (n_mode,) float
        MAC of measured and fitted shapes; NaN where classes stand for shapes.
    """

    name: str
    used: NDArray[np.bool_]
    measured_frequency: NDArray[np.float64]
    measured_damping: NDArray[np.float64]
    frequency: NDArray[np.float64]
    damping: NDArray[np.float64]
    frequency_left_out: NDArray[np.float64]
    frequency_before: NDArray[np.float64]
    damping_before: NDArray[np.float64]
    mac: NDArray[np.float64]

    @property
    def relative_error(self) -> NDArray[np.float64]:
        """Error of each frequency, model less measured over measured (n_mode,)."""
        return np.asarray(self.frequency / self.measured_frequency - 1.0)

    @property
    def left_out_error(self) -> NDArray[np.float64]:
        """The same where the configuration is predicted from the others (n_mode,)."""
        return np.asarray(self.frequency_left_out / self.measured_frequency - 1.0)


@dataclass(frozen=True, eq=False, kw_only=True)
@arrays({"parameter parameter": "covariance", "any": "course"})
class JointFit:
    """Several configurations fitted at once.

    Attributes
    ----------
    effect : tuple of str
        The effects whose parameters were fitted.
    parameter : tuple of FittedParameter
        The estimates.
    covariance : (n_parameter, n_parameter) float
        Of the estimates, in their units.
    moved : tuple of Moved
        Every quantity that all fits may move and all configurations share, as stated and as fitted.
    discrepancy : Sizes
        What the model misses of a frequency and of a damping ratio.
    chi_square : float
        Sum of squared errors over their variances, by noise and by what the model misses.
    n_residual : int
        Their number.
    configuration : tuple of ConfigurationFit
        What came of each configuration.
    course : (n_step,) float
        What the fit minimises, minus the logarithm of the posterior density, after each step to the estimates.
    """

    effect: tuple[str, ...]
    parameter: tuple[FittedParameter, ...]
    covariance: NDArray[np.float64]
    moved: tuple[Moved, ...]
    discrepancy: Sizes
    chi_square: float
    n_residual: int
    configuration: tuple[ConfigurationFit, ...]
    course: NDArray[np.float64]

    @property
    def correlation(self) -> NDArray[np.float64]:
        """Correlation of the estimates (n_parameter, n_parameter)."""
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
        raise FitError(
            f"no fitted parameter {name!r} of {group or 'all'}; there are "
            + ", ".join(f"{p.name} of {p.group or 'all'}" for p in self.parameter)
        )

    def error(self, *, held_out: bool = False, before: bool = False, damping: bool = False) -> float:
        """Return the mean relative error of frequencies, eq. (2), or of damping ratios.

        Over the modes used, or over those held out; NaN where there are none.
        """
        measured, model = [], []
        for c in self.configuration:
            known = c.measured_damping if damping else c.measured_frequency
            name = ("damping" if damping else "frequency") + ("_before" if before else "")
            modelled = getattr(c, name)
            chosen = (c.used != held_out) & np.isfinite(known) & np.isfinite(modelled)
            measured.append(known[chosen])
            model.append(modelled[chosen])
        together = np.concatenate(measured)
        return frequency_error(together, np.concatenate(model)) if together.size else float("nan")


@dataclass(frozen=True, eq=False, kw_only=True)
class Updated:
    """What came of an updating.

    Attributes
    ----------
    name : str
        Its title.
    fit : JointFit
        All configurations at once.
    ledger : tuple of Entry
        The error without effects, with each, and with all.
    """

    name: str
    fit: JointFit
    ledger: tuple[Entry, ...]


def correlation_figure(fit: JointFit) -> Figure:
    """Draw the correlation of the estimates; near -1 or 1 the data determine a combination of two, neither alone."""
    from matplotlib.figure import Figure

    written = 12  # parameters up to which every value is written

    names = [f"{p.name} {p.group}".strip() for p in fit.parameter]
    n = len(names)
    figure = Figure(figsize=(4.4 + 0.36 * n, 1.6 + 0.36 * n), layout="constrained")
    axes = figure.subplots()
    image = axes.imshow(fit.correlation, cmap=palette.SIGNED, vmin=-1.0, vmax=1.0)
    if n <= written:
        for i, j in np.ndindex(n, n):
            value = round(float(fit.correlation[i, j]), 2) + 0.0  # no -0.00
            axes.text(
                j, i, f"{value:.2f}", ha="center", va="center", fontsize=7,
                color="white" if abs(value) > 0.6 else "black",
            )  # fmt: skip
    axes.set_title("correlation of the estimates", fontsize=10)
    axes.set_xticks(range(n), [str(i + 1) for i in range(n)], fontsize=8)
    labels = [textwrap.shorten(name, 40, placeholder="…") for name in names]
    axes.set_yticks(range(n), [f"{label}  {i + 1}" for i, label in enumerate(labels)], fontsize=8)
    figure.colorbar(image, ax=axes, shrink=0.8)
    return figure


def convergence_figure(fit: JointFit) -> Figure:
    """Draw what the fit minimises after each step, less its least; it jumps where the model is linearised again."""
    from matplotlib.figure import Figure
    from matplotlib.ticker import MaxNLocator

    figure = Figure(figsize=(6.4, 3.6), layout="constrained")
    axes = figure.subplots()
    axes.plot(np.arange(fit.course.size), fit.course - fit.course.min(initial=np.inf), "o-", markersize=3)
    axes.set_yscale("symlog", linthresh=0.1)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_xlabel("step")
    axes.set_ylabel("minus log posterior density, less its least")
    return figure
