"""From measured functions to a modal model, without any frequency guess.

The way: poles of all model orders (`lscf`), clusters over the orders (`stabilization`), poles that are no
modes taken away (`significance`), all modes refined together (`refinement`), shapes (`shapes`).
"""

from __future__ import annotations

from collections.abc import Iterator

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
from ema.shapes import shapes_from_residues
from ema.significance import is_split, judge, likeliest_pole, variance_inflation
from ema.stabilization import MAX_DAMPING, stabilization

DEFAULT_ORDER = 60
MAX_MOVE = 5.0
"""Half bandwidths that refinement may move a pole; one that moves further was no estimate of that mode."""
MAX_SEARCH = 30
"""Resonances tried in the residuals."""


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
        Highest model order, to be well above the number of modes in the band; 60 where not given.

    Raises
    ------
    MeasurementError
        A function is not finite or zero throughout, or the lines do not ascend evenly.
    IdentificationError
        The band holds too few lines, or no mode stands out of the noise.
    """
    order = DEFAULT_ORDER if order is None else order
    frf = _by_reciprocity(frf)
    _check(frf, name)
    lower, upper = band if band is not None else (frf.frequency[frf.frequency > 0.0][0], frf.frequency[-1])
    inside = frf.band(max(lower, np.finfo(float).tiny), upper)
    if inside.frequency.size < 2 * order:
        message = (
            f"{name}: {inside.frequency.size} lines in {lower:g}-{upper:g} Hz of "
            f"{frf.frequency[0]:g}-{frf.frequency[-1]:g} Hz are too few for order {order}: widen the band or "
            f"lower the order to {inside.frequency.size // 2} or less"
        )
        raise IdentificationError(message)
    candidates = stabilization(inside, order=order).chosen
    value = inside.value.reshape(-1, inside.frequency.size)
    fit = _modes(inside.frequency, value, candidates, inside.quantity, (lower, upper))
    if fit.pole.size == 0:
        message = (
            f"{name}: none of {candidates.size} stable poles in {lower:g}-{upper:g} Hz stands out of "
            "the noise as a mode: check the data, or give another band"
        )
        raise IdentificationError(message)
    return _model(fit, inside, geometry, name, (float(lower), float(upper)))


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
    frequency: NDArray[np.float64],
    value: NDArray[np.complex128],
    candidates: NDArray[np.complex128],
    quantity: Quantity,
    band: tuple[float, float],
) -> Fit:
    """Refine what looks like a mode, then look for modes in what is left until none is found."""
    fit = _refined(frequency, value, _screen(frequency, value, candidates, quantity), quantity, band)
    tried = fit.pole
    for _ in range(MAX_SEARCH):
        more = likeliest_pole(frequency, fit, tried)
        if more is None:
            break
        tried = np.append(tried, more)
        trial = np.append(fit.pole, more)
        if judge(frequency, linear_fit(frequency, value, trial, quantity), quantity).accepted[-1]:
            extended = _refined(frequency, value, trial, quantity, band)
            if extended.pole.size > fit.pole.size and not is_split(extended, -1):
                fit = extended
                tried = np.concatenate([tried, fit.pole])
    rank = np.argsort(np.abs(fit.pole))
    return linear_fit(frequency, value, fit.pole[rank], quantity)


def _refined(
    frequency: NDArray[np.float64],
    value: NDArray[np.complex128],
    pole: NDArray[np.complex128],
    quantity: Quantity,
    band: tuple[float, float],
) -> Fit:
    """Refine, take away what is no mode, and refine again until every pole is one."""
    while True:
        fit = refine(frequency, value, pole, quantity)
        keep = judge(frequency, fit, quantity).accepted & _sound(fit, pole, band)
        if keep.all():
            return fit
        pole = pole[keep]


def _screen(
    frequency: NDArray[np.float64],
    value: NDArray[np.complex128],
    candidates: NDArray[np.complex128],
    quantity: Quantity,
) -> NDArray[np.complex128]:
    """Candidates left when the least likely one is taken away until all are modes at fixed poles."""
    pole = candidates
    while pole.size:
        verdicts = judge(frequency, linear_fit(frequency, value, pole, quantity), quantity)
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


def _frequency_damping_std(
    pole: NDArray[np.complex128], covariance: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Carry the poles' covariance to ``abs(s) / 2 pi`` and ``-Re(s) / abs(s)``: standard deviations."""
    size = np.abs(pole)
    block = np.stack([covariance[2 * r : 2 * r + 2, 2 * r : 2 * r + 2] for r in range(pole.size)])
    to_frequency = np.stack([pole.real, pole.imag], axis=1) / (2.0 * np.pi * size[:, None])
    to_damping = np.stack([-(pole.imag**2), pole.real * pole.imag], axis=1) / size[:, None] ** 3
    frequency_std, damping_std = (
        np.sqrt(np.einsum("ri,rij,rj->r", row, block, row)) for row in (to_frequency, to_damping)
    )
    return frequency_std, damping_std


def _model(fit: Fit, frf: FRF, geometry: Geometry, name: str, band: tuple[float, float]) -> ModalModel:
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
    frequency_std, damping_std = _frequency_damping_std(fit.pole, pole_covariance)
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
        run=np.unique(frf.run),
        run_pole=np.tile(fit.pole, (np.unique(frf.run).size, 1)),
        run_frequency_std=np.tile(frequency_std, (np.unique(frf.run).size, 1)),
        run_damping_std=np.tile(damping_std, (np.unique(frf.run).size, 1)),
        run_probability=np.ones((np.unique(frf.run).size, n_mode)),
    )
