"""Contact stiffness G_f by opt_G, then contact damping d_f by opt_d, as the paper does it (eqs. 1 and 2, Fig. 11)."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import scipy
from numpy.typing import ArrayLike

from ema import Campaign, Configuration
from ema.modal.mac import mac
from ema.types.arrays import single_threaded
from ema.types.modal_model import ModalModel
from lamella_shared import Complexes, Integers, Reals, Shown, arrays
from model import Modes, Observed, ReducedSystem, Stack, observe, reduce, solve_modes
from updating.correlation.pairing import LEAST_MAC, N_MODE, Pairing, pair, require_points
from updating.correlation.registration import register, visible
from updating.correlation.rig_check import RigCheck, check_rig, upright
from updating.errors import FitError


@dataclass(frozen=True, kw_only=True)
class ParameterEstimate:
    """A parameter with its 95 % interval.

    Attributes
    ----------
    name, unit : str
        Which.
    value, lower, upper : float
        The estimate and the ends of its 95 % interval.
    at_bound : bool
        Whether it lies on an end of its plausible range: then the data ask for a value outside.
    determined : bool
        Whether the data say more of it than its range does.
    """

    name: str
    unit: str
    value: float
    lower: float
    upper: float
    at_bound: bool
    determined: bool = True

    @property
    def remark(self) -> str:
        """What must be said of it beside the interval; often nothing."""
        return "at its bound" if self.at_bound else "" if self.determined else "not determined"


def opt_G(f_exp: ArrayLike, f_num: ArrayLike) -> float:
    """Objective of the contact stiffness, Hz: root of the summed squared frequency differences.

    Source: Pirnat, Čepon, Boltežar 2013, eq. (1), left.
    """
    return float(np.linalg.norm(np.asarray(f_exp, float) - np.asarray(f_num, float)))


def opt_d(xi_exp: ArrayLike, xi_num: ArrayLike) -> float:
    """Objective of the contact damping: root of the summed squared damping-ratio differences.

    Source: Pirnat, Čepon, Boltežar 2013, eq. (1), right.
    """
    return float(np.linalg.norm(np.asarray(xi_exp, float) - np.asarray(xi_num, float)))


def frequency_error(f_exp: ArrayLike, f_num: ArrayLike) -> float:
    """Mean relative frequency error as a ratio (0.144, not 14.4).

    Source: Pirnat, Čepon, Boltežar 2013, eq. (2), there in percent.
    """
    f_exp, f_num = np.asarray(f_exp, float), np.asarray(f_num, float)
    return float(np.mean(np.abs(f_exp - f_num) / f_exp))


Prediction = tuple[Reals, Reals]
"""Model values (n,) and their derivatives with respect to the parameter (n,)."""

G_F_BOUNDS = (100.0, 10_000.0)
"""Default search of G_f, Pa per Pa: a decade about the published 992 to 1900 (Table 6) on either side."""

D_F_BOUNDS = (0.0, 1e-8)
"""Default search of d_f, s/Pa: up to thirty times the largest published value (Table 6)."""

DOUBTFUL = 0.3
"""Mean frequency error from which a fit is none: the published model leaves half of it, 14.4 % (Table 7)."""

N_SNAPSHOT_WIDE = 6
"""Values of G_f at which the reduction is exact; six over two decades keep frequencies within 1e-5 between them."""

FREQUENCY_FORM, DAMPING_FORM = 1e-3, 1e-2
"""Relative errors of frequencies and damping ratios that a right model has for its form alone: of the mesh, of nominal
sizes, of a contact law that is smooth. An interval that leaves them out promises digits that nobody can measure."""


@dataclass(frozen=True, eq=False, kw_only=True)
@arrays({"any 2": "history"})
class Estimate:
    """One fitted parameter.

    Attributes
    ----------
    name, unit : str
        The parameter; an empty unit means a plain number.
    value, std : float
        Estimate and standard deviation. The latter propagates the standard deviations of the measured values
        and the scatter that the model leaves unexplained, so it grows with the misfit; the scatter counts as
        `FREQUENCY_FORM` or `DAMPING_FORM` at least.
    lower, upper : float
        Bounds of the search; both the value of a parameter that is kept, because nothing depends on it.
    at_bound : bool
        Whether the estimate lies on a bound: then the data ask for a value outside, and `std` means nothing.
    objective : float
        Objective of eq. (1) at the estimate, in the unit of the fitted values.
    history : (n_evaluation, 2) float
        Every parameter value tried and its objective, in order: first the scan of the bounds, then the descent.
    """

    name: str
    unit: str
    value: float
    std: float
    lower: float
    upper: float
    at_bound: bool
    objective: float
    history: Reals


@dataclass(frozen=True, eq=False, kw_only=True)
@arrays({"any": "distance"})
class ModelFit(Shown):
    """A model fitted to one configuration.

    Attributes
    ----------
    name : str
        The configuration.
    modes : Modes
        Elastic modes of the fitted model at the measured DOFs.
    pairing : Pairing
        Measured modes against `modes`.
    distance : (n_dof,) float
        Distance between measured and sampled points, m.
    error : float
        Mean relative frequency error over the pairs, eq. (2), as a ratio.
    """

    name: str
    modes: Modes
    pairing: Pairing
    distance: Reals
    error: float

    @property
    def findings(self) -> tuple[str, ...]:
        """What a user should read before using the parameters."""
        return ()

    @property
    def box(self) -> list[float] | None:
        """Length, width and height of the body that shapes are drawn in, m; None where the model is no stack."""
        return None


@dataclass(frozen=True, eq=False, kw_only=True)
class Fit(ModelFit):
    """The laminated model fitted to one configuration.

    Attributes
    ----------
    stack : Stack
        The stack with the fitted contact parameters.
    G_f, d_f : Estimate
        Contact stiffness (Pa per Pa) and contact damping (s/Pa).
    rig : RigCheck
        What contradicts the measurement about force, scale and sensors.
    """

    stack: Stack
    G_f: Estimate
    d_f: Estimate
    rig: RigCheck

    @property
    def box(self) -> list[float]:
        """Length, width and height of the stack, m."""
        return [self.stack.length, self.stack.width, self.stack.height]

    @property
    def findings(self) -> tuple[str, ...]:
        """What a user should read before using the parameters."""
        if self.error <= DOUBTFUL:
            return self.rig.findings
        text = (
            f"{self.name}: the model's frequencies are off by {100.0 * self.error:.0f} % in the mean at the best G_f: "
            "these are hardly the modes of this stack, and G_f and d_f mean nothing. Check points, directions, stack"
        )
        return (*self.rig.findings, text)


@single_threaded
def fit(
    stack: Stack,
    measured: ModalModel,
    *,
    threshold: float = LEAST_MAC,
    G_f_bounds: tuple[float, float] = G_F_BOUNDS,
    d_f_bounds: tuple[float, float] = D_F_BOUNDS,
    tolerance: float = 0.01,
) -> Fit:
    """Fit G_f to the measured frequencies and then d_f to the measured damping ratios.

    One lamina has no contact: it is put beside the measurement as it is.

    Modes are paired by MAC. The set of measured modes that takes part is the one that pairs best over a scan of
    the bounds; it is kept during the descent, so that the objective never gains or loses a term.

    Parameters
    ----------
    stack : Stack
        The stack at the configuration's pressure; its G_f and d_f do not matter.
    measured : ModalModel
        The identified modes.
    threshold : float
        Smallest MAC that makes a pair.
    G_f_bounds, d_f_bounds : (float, float)
        Bounds of the contact parameters, Pa per Pa and s/Pa.
    tolerance : float
        Largest distance between a measured point and the stack, m.

    Raises
    ------
    PairingError
        Points or modes of the measurement do not match the model, there are fewer points than modes, or a sensor was
        upside down in all runs.
    FitError
        No mode pairs anywhere within the bounds, or none at the best G_f.
    """
    n_snapshot_mode = 18  # of each snapshot; over the range of G_f they span more
    require_points(measured)
    registration = register(stack, measured.geometry, measured.node, measured.direction, tolerance=tolerance)
    single = stack.n_lamina == 1
    n_mode = N_MODE if single else n_snapshot_mode  # no G_f gives one lamina other modes
    system = reduce(stack, G_f_range=G_f_bounds, n_snapshot=1 if single else N_SNAPSHOT_WIDE, n_mode=n_mode)
    observed = observe(system, registration.observation)
    rig = upright(check_rig(system, stack.contact.pressure, measured, G_f_bounds))
    trials = [_elastic(system, observed, g, 0.0) for g in np.geomspace(*G_f_bounds, 13)]
    between = f" for any G_f between {G_f_bounds[0]:g} and {G_f_bounds[1]:g}"
    used = modes_that_pair(measured, trials, threshold=threshold, beside=between)
    G_f, d_f = _estimates(system, observed, measured, used, (G_f_bounds, d_f_bounds))
    modes = _elastic(system, observed, G_f.value, d_f.value)
    pairing = _paired(measured, modes, threshold)
    return Fit(
        name=measured.name,
        stack=replace(stack, contact=replace(stack.contact, G_f=G_f.value, d_f=d_f.value)),
        G_f=G_f,
        d_f=d_f,
        modes=modes,
        pairing=pairing,
        distance=registration.distance,
        error=frequency_error(measured.frequency[pairing.measured], modes.frequency[pairing.model]),
        rig=rig,
    )


@lru_cache(maxsize=4)
def reduced_about(stack: Stack, n_mode: int) -> ReducedSystem:
    """Reduce a fitted stack about its contact, once for all that is shown of it.

    Parameters
    ----------
    stack : Stack
        With the fitted contact.
    n_mode : int
        Modes that are exact there, the six rigid-body modes included.
    """
    return reduce(stack, n_snapshot=1, n_mode=n_mode)  # in the middle of the range, at the fitted G_f


def _paired(measured: ModalModel, modes: Modes, threshold: float) -> Pairing:
    """Return pairs of modes; refuse a fit that leaves none, for its error would be of nothing."""
    pairing = pair(measured, modes, threshold=threshold)
    if pairing.measured.size == 0:
        raise FitError(
            f"{measured.name}: at the best G_f none of {measured.frequency.size} measured modes pairs with the model "
            f"by a MAC of {threshold:g}; check points and signs, and that all runs are of one state"
        )
    return pairing


def _estimates(
    system: ReducedSystem,
    observed: Observed,
    measured: ModalModel,
    used: Integers,
    bounds: tuple[tuple[float, float], tuple[float, float]],
) -> tuple[Estimate, Estimate]:
    """Return G_f from the frequencies of the modes used, and d_f from their damping ratios."""
    shape = measured.shape[:, used]
    contact = system.stack.contact
    if system.stack.n_lamina == 1:
        modes = _elastic(system, observed, contact.G_f, contact.d_f)
        column = _assign(shape, modes)
        return (
            kept_estimate("G_f", "Pa/Pa", contact.G_f, opt_G(measured.frequency[used], modes.frequency[column])),
            kept_estimate("d_f", "s/Pa", contact.d_f, opt_d(measured.damping[used], modes.damping[column])),
        )

    def frequencies(value: float) -> Prediction:
        modes = _elastic(system, observed, value, 0.0)
        column = _assign(shape, modes)
        return modes.frequency[column], modes.frequency_gradient[column, modes.parameter.index("G_f")]

    G_f = estimate_stiffness(frequencies, measured.frequency[used], measured.frequency_std[used], bounds=bounds[0])
    reference = _elastic(system, observed, G_f.value, 1e-10)
    other_damping = np.zeros(used.size)  # damping by effects, without any of the contact
    if system.stack.effects:
        undamped = _elastic(system, observed, G_f.value, 0.0)
        other_damping = undamped.damping[_assign(shape, undamped)]
    slope = (reference.damping[_assign(shape, reference)] - other_damping) / 1e-10
    d_f = estimate_damping(slope, measured.damping[used] - other_damping, measured.damping_std[used], bounds=bounds[1])
    return G_f, d_f


def kept_estimate(name: str, unit: str, value: float, objective: float) -> Estimate:
    """Return a parameter that nothing depends on, at its value."""
    return Estimate(
        name=name,
        unit=unit,
        value=value,
        std=0.0,
        lower=value,
        upper=value,
        at_bound=False,
        objective=objective,
        history=np.array([[value, objective]]),
    )


def estimate_stiffness(
    predict: Callable[[float], Prediction],
    target: Reals,
    target_std: Reals,
    *,
    bounds: tuple[float, float],
    n_scan: int = 25,
) -> Estimate:
    """Minimise opt_G, eq. (1), over G_f: a scan on a logarithmic grid, then Gauss-Newton steps in log G_f.

    Parameters
    ----------
    predict : callable
        Model frequencies (n,) and their derivatives with respect to G_f at a value of G_f.
    target, target_std : (n,) float
        Measured frequencies and their standard deviations, Hz.
    bounds : (float, float)
        Bounds of G_f, both positive.
    n_scan : int
        Number of grid values of the scan.
    """
    history: list[tuple[float, float]] = []

    def evaluate(value: float) -> Prediction:
        frequency, gradient = predict(value)
        history.append((value, opt_G(target, frequency)))
        return frequency, gradient

    grid = np.geomspace(*bounds, n_scan)
    objective = [opt_G(target, evaluate(g)[0]) for g in grid]
    start = float(grid[int(np.argmin(objective))])

    def residual(x: Reals) -> Reals:
        return evaluate(float(np.exp(x[0])))[0] - target

    def jacobian(x: Reals) -> Reals:
        value = float(np.exp(x[0]))
        return (predict(value)[1] * value)[:, None]

    low, high = np.log(bounds)
    first, ends = [np.clip(np.log(start), low, high)], ([low], [high])
    solution = scipy.optimize.least_squares(residual, first, jac=jacobian, bounds=ends, xtol=1e-10, ftol=1e-12)
    value = float(np.exp(solution.x[0]))
    frequency, gradient = predict(value)
    return Estimate(
        name="G_f",
        unit="Pa/Pa",
        value=value,
        std=_standard_deviation(gradient, frequency - target, target_std, FREQUENCY_FORM * target),
        lower=bounds[0],
        upper=bounds[1],
        at_bound=bool(np.min(np.abs(solution.x[0] - np.array([low, high]))) < 1e-6),
        objective=opt_G(target, frequency),
        history=np.array(history),
    )


def estimate_damping(slope: Reals, target: Reals, target_std: Reals, *, bounds: tuple[float, float]) -> Estimate:
    """Minimise opt_d, eq. (1), over d_f.

    Damping ratios are proportional to d_f (contact damping beta = d_f p, to first order in damping), so the
    minimum is a linear least-squares solution and needs no descent.

    Parameters
    ----------
    slope : (n,) float
        Model damping ratio per unit d_f, Pa/s.
    target, target_std : (n,) float
        Measured damping ratios and their standard deviations.
    bounds : (float, float)
        Bounds of d_f, s/Pa.
    """
    free = float(slope @ target / (slope @ slope))
    value = float(np.clip(free, *bounds))
    trial = np.unique(np.append(np.linspace(0.0, 2.0 * max(value, 1e-13), 9), value))
    return Estimate(
        name="d_f",
        unit="s/Pa",
        value=value,
        std=_standard_deviation(slope, slope * value - target, target_std, DAMPING_FORM * target),
        lower=bounds[0],
        upper=bounds[1],
        at_bound=value != free,
        objective=opt_d(target, slope * value),
        history=np.array([(d, opt_d(target, slope * d)) for d in trial]),
    )


def _standard_deviation(gradient: Reals, residual: Reals, target_std: Reals, form: Reals) -> float:
    """Return the standard deviation of an unweighted least-squares estimate of one parameter.

    The residual's covariance is the measurement's plus the scatter beyond it that the model leaves unexplained, which
    is at least the error of its form.
    """
    scatter = residual @ residual / (residual.size - 1) if residual.size > 1 else 0.0
    unexplained = max(0.0, scatter - float(np.mean(target_std**2)))
    beyond = np.maximum(unexplained, form**2)
    variance = np.sum(gradient**2 * (target_std**2 + beyond)) / np.sum(gradient**2) ** 2
    return float(np.sqrt(variance))


def modes_that_pair(
    measured: ModalModel, trials: Sequence[Modes], *, threshold: float = LEAST_MAC, beside: str = ""
) -> Integers:
    """Return the measured modes that pair where MAC values, those of subspaces for close modes, sum to most.

    `beside` says in the error what the elastic modes that are tried are of.
    """
    pairs = [pair(measured, modes, threshold=threshold) for modes in trials]
    best = max(pairs, key=lambda p: float(np.sum(p.subspace_mac)))
    if best.measured.size == 0:
        raise FitError(
            f"{measured.name}: no measured mode reaches a MAC of {threshold:g} with the model{beside}; the largest is "
            f"{max(float(p.mac.max()) for p in pairs):.2f}. Check point numbers, directions and signs of the "
            "measurement, or lower the threshold."
        )
    return best.measured


def _elastic(system: ReducedSystem, observed: Observed, G_f: float, d_f: float) -> Modes:
    return solve_modes(system, G_f=G_f, d_f=d_f, n_mode=N_MODE, observation=observed).elastic()


def _assign(shape: Complexes, modes: Modes) -> Integers:
    """Return the model mode of each measured shape by the largest sum of MAC values, without a threshold."""
    likeness = np.where(visible(modes.shape), mac(shape, modes.shape), 0.0)
    return np.asarray(scipy.optimize.linear_sum_assignment(likeness, maximize=True)[1])


def model_file(campaign: Campaign, job: str) -> Path:
    """Return the file of the model's stack, which `job`, such as "a fit", needs.

    Raises
    ------
    FitError
        The campaign names none, or no file of the points, by which shapes are compared.
    """
    if campaign.stack is None:
        raise FitError(f'{campaign.path}: {job} needs the model\'s stack; add stack = "stack.toml" under [structure]')
    if campaign.points is None:
        raise FitError(
            f"{campaign.path}: {job} compares shapes and needs the coordinates of the points; add file = "
            '"points.csv" and its unit under [points]'
        )
    return campaign.stack


def stack_in_state(stack: Stack, configuration: Configuration) -> Stack:
    """Put a configuration's pressure and height, where it states them, in place of those of the stack file."""
    if configuration.pressure is not None:
        stack = stack.with_contact(pressure=configuration.pressure)
    return stack if configuration.height is None else replace(stack, height=configuration.height)


def specimen_name(name: str, height: float, heights: Collection[float]) -> str:
    """Name the stack of a configuration: configurations of other heights (m) are other stacks."""
    return name if len(set(heights)) == 1 else f"{name}, {1e3 * height:g} mm"
