"""From measured functions to a modal model, without any frequency guess.

The way: poles of all model orders (`lscf`), clusters over the orders (`stabilization`), poles that are no
modes taken away (`significance`), all modes refined together (`refinement`), shapes (`shapes`).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ema.campaign import Campaign
from ema.errors import IdentificationError, MeasurementError
from ema.frf import FRF, Quantity
from ema.geometry import Geometry
from ema.mac import frac
from ema.measurement import read_measurement
from ema.modes import ModalModel
from ema.refinement import Fit, linear_fit, refine
from ema.roving import RunPoles, frequency_damping_std, run_poles
from ema.shapes import shapes_from_residues
from ema.significance import is_confined, is_split, judge, likeliest_poles, variance_inflation
from ema.stabilization import MAX_DAMPING, stabilization

DEFAULT_ORDER = 60
MIN_LINES = 16
"""Fewest lines that a band may hold."""
MAX_MOVE = 5.0
"""Half bandwidths that refinement may move a pole; one that moves further was no estimate of that mode."""


@dataclass(frozen=True, eq=False, kw_only=True)
class _Data:
    """The functions to fit as rows, above 0 Hz and within the band."""

    frequency: NDArray[np.float64]
    value: NDArray[np.complex128]
    run: NDArray[np.int64]
    quantity: Quantity

    def linear_fit(self, pole: NDArray[np.complex128]) -> Fit:
        return linear_fit(self.frequency, self.value, pole, self.quantity)


def identify(campaign: Campaign) -> Iterator[tuple[str, ModalModel]]:
    """Identify every configuration of a campaign, one after the other.

    Yields
    ------
    (name, ModalModel)
        In the order of the campaign file, each as soon as it is done.

    Raises
    ------
    MeasurementError, IdentificationError
        See `identify_frf` and the reading of measurements.
    """
    options = campaign.identification
    for configuration in campaign.configurations:
        measurement = read_measurement(campaign, configuration.name)
        yield (
            configuration.name,
            identify_frf(
                measurement.frf,
                measurement.geometry,
                name=configuration.name,
                band=options.band,
                order=options.order,
            ),
        )


def identify_frf(
    frf: FRF,
    geometry: Geometry,
    *,
    name: str,
    band: tuple[float, float] | None = None,
    order: int | None = None,
) -> ModalModel:
    """Identify the modes of one configuration.

    Parameters
    ----------
    frf : FRF
        Measured functions. With more inputs than outputs (a roving hammer) they are used as if response and
        force had changed places, which linear structures allow (reciprocity): the model's outputs, and so its
        shapes, are then at the inputs of `frf`.
    geometry : Geometry
        The measured points; handed on to the model.
    name : str
        The configuration, for the model and for messages.
    band : (float, float), optional
        Frequency band, Hz; all lines above 0 Hz where not given.
    order : int, optional
        Highest model order, to be well above the number of modes in the band. Where not given 60, less in
        bands of few lines.

    Raises
    ------
    MeasurementError
        A function is not finite or zero throughout, or the lines do not ascend evenly.
    IdentificationError
        The band holds too few lines, or no mode stands out of the noise.
    """
    frf = _by_reciprocity(frf)
    _check(frf, name)
    lower, upper = band if band is not None else (frf.frequency[frf.frequency > 0.0][0], frf.frequency[-1])
    inside = frf.band(max(lower, np.finfo(float).tiny), upper)
    n_line = inside.frequency.size
    if order is None:
        order = min(DEFAULT_ORDER, n_line // 3)
    if n_line < max(MIN_LINES, 2 * order):
        message = (
            f"{name}: {n_line} lines in {lower:g}-{upper:g} Hz of {frf.frequency[0]:g}-{frf.frequency[-1]:g} Hz "
            f"are too few for order {order}: widen the band"
        )
        raise IdentificationError(message)
    candidates = stabilization(inside, order=order).chosen
    data = _Data(
        frequency=inside.frequency,
        value=inside.value.reshape(-1, inside.frequency.size),
        run=np.repeat(inside.run, inside.input.node.size),
        quantity=inside.quantity,
    )
    fit, runs = _modes(data, candidates, (lower, upper))
    if fit.pole.size == 0:
        message = (
            f"{name}: none of {candidates.size} stable poles in {lower:g}-{upper:g} Hz stands out of "
            "the noise as a mode: check the data, or give another band"
        )
        raise IdentificationError(message)
    return _model(fit, runs, inside, geometry, name, (float(lower), float(upper)))


def _by_reciprocity(frf: FRF) -> FRF:
    """Exchange response and force where there are more inputs than outputs."""
    n_output, n_input, _ = frf.value.shape
    if n_input <= n_output:
        return frf
    return FRF(
        frequency=frf.frequency,
        value=frf.value.swapaxes(0, 1),
        quantity=frf.quantity,
        output=frf.input,
        input=frf.output,
        run=np.zeros(n_input, dtype=int),
        source=(", ".join(dict.fromkeys(frf.source)),) * n_input,
        coherence=None if frf.coherence is None else frf.coherence.swapaxes(0, 1),
    )


def _check(frf: FRF, name: str) -> None:
    """Refuse what would spoil a fit in silence."""
    step = np.diff(frf.frequency)
    if step.size == 0 or np.any(np.abs(step - np.median(step)) > 0.01 * np.median(step)):
        message = f"{name}: the frequency lines do not ascend in even steps; resample the functions"
        raise MeasurementError(message)
    finite = np.isfinite(frf.value).all(axis=-1)
    silent = ~np.any(frf.value, axis=-1)
    for bad, what in ((~finite, "holds NaN or infinity"), (silent, "is zero at every line")):
        for o, i in np.argwhere(bad)[:1]:
            message = (
                f"{name}: the function of point {frf.output.node[o]} over point {frf.input.node[i]} "
                f"({frf.source[o]}) {what}; exclude it from the campaign"
            )
            raise MeasurementError(message)


def _modes(
    data: _Data, candidates: NDArray[np.complex128], band: tuple[float, float]
) -> tuple[Fit, RunPoles]:
    """Refine what looks like a mode, then look for modes in what is left until none is found."""
    fit = _refined(data, _screen(data, candidates), band)
    searching = True
    while searching:
        searching = False
        for more in likeliest_poles(data.frequency, _run_by_run(data, fit)):
            trial = np.append(fit.pole, more)
            if not judge(data.frequency, data.linear_fit(trial), data.quantity).accepted[-1]:
                continue
            extended = _refined(data, trial, band)
            if extended.pole.size > fit.pole.size and not is_split(extended, -1):
                fit = extended
                searching = True
                break
    fit = data.linear_fit(fit.pole[np.argsort(np.abs(fit.pole))])
    return fit, run_poles(data.frequency, data.value, data.run, fit, data.quantity)


def _run_by_run(data: _Data, fit: Fit) -> Fit:
    """Leave the residuals of each run at its own poles where runs disagree: a shifted mode is no second one."""
    runs = run_poles(data.frequency, data.value, data.run, fit, data.quantity)
    if not runs.disagree():
        return fit
    residual, noise = np.empty_like(fit.residual), np.empty_like(fit.noise)
    for number, pole in zip(runs.run, runs.pole, strict=True):
        own = data.run == number
        alone = linear_fit(data.frequency, data.value[own], pole, data.quantity)
        residual[own], noise[own] = alone.residual, alone.noise
    return replace(fit, residual=residual, noise=noise)


def _refined(data: _Data, pole: NDArray[np.complex128], band: tuple[float, float]) -> Fit:
    """Refine, take away what is no mode, and refine again until every pole is one."""
    while True:
        fit = refine(data.frequency, data.value, pole, data.quantity)
        keep = judge(data.frequency, fit, data.quantity).accepted & _sound(fit, pole, band)
        keep &= ~is_confined(fit, data.run)
        if keep.all():
            return fit
        pole = pole[keep]


def _screen(data: _Data, candidates: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Candidates left when the least likely one is taken away until all are modes at fixed poles."""
    pole = candidates
    while pole.size:
        verdicts = judge(data.frequency, data.linear_fit(pole), data.quantity)
        if verdicts.accepted.all():
            break
        score = np.where(verdicts.accepted, np.inf, verdicts.score)
        pole = np.delete(pole, np.argmin(score))
    return pole


def _sound(fit: Fit, start: NDArray[np.complex128], band: tuple[float, float]) -> NDArray[np.bool_]:
    """Which refined poles are determined by the data and stayed where they started."""
    half_bandwidth = -fit.pole.real
    hertz = np.abs(fit.pole) / (2.0 * np.pi)
    std = np.sqrt(np.diag(fit.pole_covariance)[1::2])
    moved = np.abs(fit.pole - start) > MAX_MOVE * np.maximum(half_bandwidth, -start.real)
    inside = (hertz >= band[0]) & (hertz <= band[1])
    return inside & ~moved & (std < half_bandwidth) & (half_bandwidth <= MAX_DAMPING * np.abs(fit.pole))


def _model(
    fit: Fit, runs: RunPoles, frf: FRF, geometry: Geometry, name: str, band: tuple[float, float]
) -> ModalModel:
    n_output, n_input, _ = frf.value.shape
    inflation = np.repeat(np.sqrt(variance_inflation(frf.frequency, fit)), 2)
    pole_covariance = fit.pole_covariance * np.outer(inflation, inflation)
    n_mode = fit.pole.size
    residue = fit.residue.reshape(n_output, n_input, n_mode)
    covariance = fit.residue_covariance() * np.outer(inflation, inflation)
    parts = np.stack([fit.residue.real, fit.residue.imag], axis=-1)
    unit = parts / np.maximum(np.abs(fit.residue), np.finfo(float).tiny)[..., None]
    blocks = np.stack([covariance[:, 2 * r : 2 * r + 2, 2 * r : 2 * r + 2] for r in range(n_mode)], axis=1)
    variance = np.einsum("ori,orij,orj->or", unit, blocks, unit).reshape(n_output, n_input, n_mode)
    shapes = shapes_from_residues(fit.pole, residue, variance, frf.output, frf.input)
    frequency_std, damping_std = frequency_damping_std(fit.pole, pole_covariance)
    fitted = frf.value - fit.residual.reshape(frf.value.shape)
    measured_power = np.sum(np.abs(frf.value) ** 2, axis=-1)
    residual_power = np.sum(np.abs(fit.residual) ** 2, axis=-1).reshape(n_output, n_input)
    return ModalModel(
        name=name,
        frequency=np.abs(fit.pole) / (2.0 * np.pi),
        damping=-fit.pole.real / np.abs(fit.pole),
        frequency_std=frequency_std,
        damping_std=damping_std,
        pole=fit.pole,
        residue=residue,
        lower=fit.lower.reshape(n_output, n_input),
        upper=fit.upper.reshape(n_output, n_input),
        shape=shapes.shape,
        shape_std=shapes.std,
        scaled=shapes.scaled,
        node=frf.output.node,
        direction=frf.output.direction,
        input=frf.input,
        band=band,
        geometry=geometry,
        quantity=frf.quantity,
        covariance=pole_covariance,
        residue_std=np.sqrt(variance),
        noise=fit.noise.reshape(n_output, n_input),
        correlation=frac(frf.value, fitted),
        error=np.sqrt(residual_power / measured_power),
        driving_point_valid=shapes.valid,
        run=runs.run,
        run_pole=runs.pole,
        run_frequency_std=runs.frequency_std,
        run_damping_std=runs.damping_std,
        run_probability=runs.probability,
    )
