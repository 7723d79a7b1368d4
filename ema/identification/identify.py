"""From measured functions to a modal model, without any frequency guess.

The way: poles of all model orders, and clusters over the orders (`stabilization`), the choice of those that are modes
(`selection`), refined together (`maximum_likelihood`) and run by run (`band_fit`), shapes (`shapes`). All of it is done
in the quantity whose noise is even (`ema.quality.peaks.whitest`).
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from ema.campaign.campaign import Campaign
from ema.campaign.measurement import Measurement, read_force_levels, read_measurement
from ema.identification.band_fit import BandFit, fit_band
from ema.identification.doubtful_modes import check_modes, check_references
from ema.identification.evidence import Left
from ema.identification.functions import inside, resonant
from ema.identification.maximum_likelihood import Fit
from ema.identification.run_poles import RunPoles, frequency_damping_std, variance_along
from ema.identification.shapes import shapes_from_residues, with_repeated_roots
from ema.identification.stabilization import highest_order, stabilization
from ema.identification.uncertainty import with_unknown_lines
from ema.modal.mac import check_complexity, frac
from ema.modal.runs import over_runs, run_changes
from ema.quality.channels import check, usable
from ema.quality.explained import ExplainedPower, check_explained, explained_power
from ema.quality.linearity import check_force_levels
from ema.quality.peaks import whitest
from ema.quality.verdict import Verdict, at_points
from ema.types.arrays import single_threaded
from ema.types.errors import EmaError, IdentificationError, MeasurementError
from ema.types.frf import FRF, Dofs, Geometry, Quantity, driving_points
from ema.types.modal_model import ModalModel, UnexplainedPeak
from lamella_shared import Complexes, Reals

_LOG = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False, kw_only=True)
class Identification:
    """One configuration from its files to its modes.

    Attributes
    ----------
    measurement : Measurement
        What was identified, without the channels that failed a check; its notes say which.
    verdicts : tuple of Verdict
        What the checks found before the identification, and how much of the power the modes explain.
    modal_model : ModalModel
        The modes.
    explained : ExplainedPower
        Share of the measured power that they explain.
    """

    measurement: Measurement
    verdicts: tuple[Verdict, ...]
    modal_model: ModalModel
    explained: ExplainedPower


@dataclass(frozen=True, kw_only=True)
class Failure:
    """A configuration that could not be identified.

    Attributes
    ----------
    name : str
        The configuration.
    error : EmaError
        Why, written for the user.
    """

    name: str
    error: EmaError


def identify(campaign: Campaign, poles: Mapping[str, Complexes] | None = None) -> Iterator[Identification]:
    """Read, check and identify every configuration of a campaign, one after the other.

    One that cannot be used does not end the others: its error is raised after the last of them.

    Parameters
    ----------
    campaign : Campaign
    poles : mapping of str to (n_mode,) complex, optional
        Poles chosen by hand, rad/s, by the name of the configuration; the others are found.

    Yields
    ------
    Identification
        In the order of the campaign file, each as soon as it is done.

    Raises
    ------
    MeasurementError, IdentificationError
        See `read_measurement`, `check_linearity`, `usable` and `identify_frf`. Where several configurations fail, the
        error is of the first one's kind and lists them all.
    """
    failures: list[Failure] = []
    for configuration in campaign.configurations:
        result = try_identify(campaign, configuration.name, (poles or {}).get(configuration.name))
        if isinstance(result, Failure):
            failures.append(result)
        else:
            yield result
    if len(failures) == 1:
        raise failures[0].error
    if failures:
        raise type(failures[0].error)("\n".join(f"{failure.name}: {failure.error}" for failure in failures))


def try_identify(campaign: Campaign, name: str, pole: Complexes | None = None) -> Identification | Failure:
    """Read, check and identify one configuration, or say why that is not possible.

    Parameters
    ----------
    campaign : Campaign
    name : str
        The configuration.
    pole : (n_mode,) complex, optional
        Poles chosen by hand, rad/s.
    """
    try:
        return _identified(campaign, name, pole)
    except EmaError as error:
        return Failure(name=name, error=error)


def _identified(campaign: Campaign, name: str, pole: Complexes | None) -> Identification:
    _LOG.info("%s", name)
    options = campaign.identification
    measurement = read_measurement(campaign, name)
    verdicts = check(measurement, options.band)
    kept = usable(measurement, verdicts)
    levels = read_force_levels(campaign, name)
    verdicts += check_force_levels(measurement, verdicts, levels, options.band)
    verdicts = at_points(verdicts, measurement.frf.output)
    modal_model = identify_frf(
        kept.frf,
        kept.geometry,
        name=name,
        band=options.band,
        order=options.order,
        pole=pole,
        sensor_mass=campaign.sensor_mass,
    )
    notes = (*_unscaled(modal_model), *_without_sensors(modal_model, campaign.sensor_mass))
    kept = replace(kept, notes=(*kept.notes, *notes))
    identified = kept.frf.by_reciprocity()
    explained = explained_power(identified, modal_model)
    further = (
        *check_explained(explained, modal_model),
        *check_modes(identified, modal_model),
        *check_references(identified, modal_model),
        *check_complexity(modal_model),
    )
    verdicts += at_points(further, identified.output)
    return Identification(measurement=kept, verdicts=verdicts, modal_model=modal_model, explained=explained)


@single_threaded
def identify_frf(
    frf: FRF,
    geometry: Geometry,
    *,
    name: str,
    band: tuple[float, float] | None = None,
    order: int | None = None,
    pole: Complexes | None = None,
    sensor_mass: float = 0.0,
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
    pole : (n_mode,) complex, optional
        Poles chosen by hand (`ema.identification.picking`), rad/s. They are refined; none is added or taken away.
    sensor_mass : float
        Mass of each roving sensor, kg, to be taken out (`ema.modal.runs`); 0 where it is not stated. A sensor that
        stays while a hammer roves is part of the structure.

    Raises
    ------
    MeasurementError
        A function is not finite or zero throughout, or the lines do not ascend evenly.
    IdentificationError
        The band holds too few lines, or no mode stands out of the noise.
    """
    frf = frf.by_reciprocity()
    _check(frf, name)
    lower, upper = band if band is not None else (frf.frequency[frf.frequency > 0.0][0], frf.frequency[-1])
    band = float(lower), float(upper)
    lines = frf.band(max(band[0], np.finfo(float).tiny), band[1])
    if order is None:
        order = highest_order(lines.frequency.size)
    _require_lines(lines, frf, order, band, name)
    if pole is not None:
        _require_inside(pole, band, name)
    white = lines.convert(whitest(lines))
    quantity, n_input = lines.quantity, lines.input.node.size
    del lines  # large
    result = fit_band(white, order, pole, band)
    _require_modes(result.fit, white, order, pole, band, name)
    white = replace(white, value=result.value)
    model = _model(result, white, quantity, geometry, name, band)
    model = with_repeated_roots(model, white)
    changes = run_changes(model, frf.run, sensors_rove=not frf.reciprocal)
    model = over_runs(model, frf.run, 0.0 if frf.reciprocal else sensor_mass, changes)
    model = with_unknown_lines(model, white.frequency)
    return replace(model, unexplained=_unexplained(result.left, n_input))


def _require_lines(
    lines: FRF, frf: FRF, order: int, band: tuple[float, float], name: str, *, min_lines: int = 6
) -> None:
    """Refuse a band of functions that holds too few lines for a model order.

    `min_lines`: fewest lines that a band may hold.
    """
    if lines.frequency.size < max(min_lines, 2 * order):
        raise IdentificationError(
            f"{name}: {lines.frequency.size} lines in {band[0]:g}-{band[1]:g} Hz of "
            f"{frf.frequency[0]:g}-{frf.frequency[-1]:g} Hz are too few for order {order}: widen the band"
        )


def _require_modes(
    fit: Fit, white: FRF, order: int, chosen: Complexes | None, band: tuple[float, float], name: str
) -> None:
    """Refuse a band without any mode."""
    if resonant(fit.pole, band).any():
        return
    if _modes_of_conjugates(white, order, band):
        raise IdentificationError(
            f"{name}: the phase rises through the resonances, as of the complex conjugates of FRFs: the sign of "
            "the imaginary part or of the phase is wrong. If that is so, write conjugate = true with 'files' and "
            "'reason' in a [[correction]] of the campaign file"
        )
    n_stable = stabilization(white, order=order).chosen.size if chosen is None else chosen.size
    raise IdentificationError(
        f"{name}: none of {n_stable} stable poles in {band[0]:g}-{band[1]:g} Hz stands out of "
        "the noise as a mode: check the data, or give another band"
    )


def _modes_of_conjugates(white: FRF, order: int, band: tuple[float, float]) -> bool:
    """Whether the complex conjugates of functions without a mode have one.

    Noise may leave them no stable pole, too: what their peaks hold is asked for, as of the functions themselves.
    """
    turned = replace(white, value=white.value.conj())
    return bool(resonant(fit_band(turned, order, None, band).fit.pole, band).any())


def _require_inside(pole: Complexes, band: tuple[float, float], name: str) -> None:
    """Refuse poles chosen by hand that the band does not hold."""
    if not inside(pole, band).all():
        outside = np.abs(pole[~inside(pole, band)]) / (2.0 * np.pi)
        raise IdentificationError(
            f"{name}: chosen poles at {', '.join(f'{f:.6g}' for f in outside)} Hz are not within "
            f"{band[0]:g}-{band[1]:g} Hz by a half bandwidth: widen the band or take them away"
        )


def _unscaled(modal_model: ModalModel) -> tuple[str, ...]:
    """Say which shapes are not mass-normalised although a driving point was measured."""
    output = Dofs(node=modal_model.node, direction=modal_model.direction)
    if modal_model.scaled.all() or not driving_points(output, modal_model.input):
        return ()
    listed = ", ".join(f"{f:.5g} Hz" for f in modal_model.frequency[~modal_model.scaled])
    return (
        f"shapes at {listed} are not mass-normalised: the residue at the driving point is weaker than three "
        "standard deviations (a nodal line) or has the wrong sign or phase",
    )


def _without_sensors(modal_model: ModalModel, stated: float) -> tuple[str, ...]:
    """Say what the mass of the sensors was worth, or that it was not taken out although it is stated."""
    shift = np.array(modal_model.sensor_shift)
    if not shift.size:
        return (
            ()
            if stated == 0.0
            else (
                "the mass of the sensors is not taken out: no mode is mass-normalised by a driving point or differs "
                "enough from run to run, or the hammer roves",
            )
        )
    mass = f"{1e3 * modal_model.sensor_mass:.3g} g each, " if modal_model.sensor_mass > 0.0 else ""
    source = "as stated" if stated > 0.0 else "as the runs tell"
    listed = ", ".join(f"{100 * share:+.2f} % (mode {r + 1})" for r, share in enumerate(shift) if share != 0.0)
    kept = ", ".join(f"{r + 1}" for r in np.flatnonzero(shift == 0.0))
    rest = f"; not of mode {kept}, whose shift is not known" if kept else ""
    return (
        f"frequencies are those of the structure without the sensors ({mass}{source}), which shift them by "
        f"{listed}{rest}",
    )


def _unexplained(left: Left, n_input: int) -> tuple[UnexplainedPeak, ...]:
    """Give the peaks that no mode was found for with their outputs."""
    return tuple(
        UnexplainedPeak(
            frequency=peak.frequency,
            share=peak.share,
            channel=tuple(int(c) for c in np.unique(np.flatnonzero(peak.left > 0.5) // n_input)),
            reason=reason,
        )
        for peak, reason in left
    )


def _check(frf: FRF, name: str) -> None:
    """Refuse what would spoil a fit in silence."""
    step = np.diff(frf.frequency)
    if step.size == 0 or np.any(np.abs(step - np.median(step)) > 0.01 * np.median(step)):
        raise MeasurementError(f"{name}: the frequency lines do not ascend in even steps; resample the functions")
    finite = np.isfinite(frf.value).all(axis=-1)
    silent = ~np.any(frf.value, axis=-1)
    for bad, what in ((~finite, "holds NaN or infinity"), (silent, "is zero at every line")):
        for o, i in np.argwhere(bad)[:1]:
            raise MeasurementError(
                f"{name}: the function of point {frf.output.node[o]} over point {frf.input.node[i]} "
                f"({frf.source[o]}) {what}; exclude it from the campaign"
            )


def _as_measured(fit: Fit, frf: FRF, quantity: Quantity, *, at_once: int = 1 << 19) -> tuple[Reals, Reals, Reals]:
    """Return noise, correlation and relative error (n_output, n_input) of a fit of `frf` in the measured quantity.

    `at_once`: values of functions that are compared at once.
    """
    n_output, n_input, n_line = frf.value.shape
    shape = n_output, n_input
    square, whole, left, likeness = np.empty((4, *shape))
    value = frf.value.reshape(-1, n_line)
    few = max(1, at_once // (n_input * n_line))
    for first in range(0, n_output, few):  # some outputs at a time: all may be large
        outputs = slice(first, min(first + few, n_output))
        rows = slice(n_input * outputs.start, n_input * outputs.stop)
        residual = fit.left(rows, frf.frequency, value, frf.quantity).reshape(-1, n_input, n_line)
        some = frf.outputs(np.isin(np.arange(n_output), np.arange(outputs.start, outputs.stop)))
        measured = some.convert(quantity).value
        fitted = replace(some, value=some.value - residual).convert(quantity).value
        square[outputs] = np.sum(np.abs(measured - fitted) ** 2, axis=-1)
        whole[outputs] = np.sum(np.abs(measured) ** 2, axis=-1)
        left[outputs] = np.sum(np.abs(residual) ** 2, axis=-1)
        for o, pair in enumerate(zip(measured, fitted, strict=True), start=first):
            likeness[o] = frac(*pair)
    noise = fit.noise.reshape(shape) * np.sqrt(square / left)
    return noise, likeness, np.sqrt(square / whole)


def _model(
    result: BandFit, frf: FRF, quantity: Quantity, geometry: Geometry, name: str, band: tuple[float, float]
) -> ModalModel:
    """Collect the results of a fit of `frf`; noise and errors are those of the measured quantity."""
    n_output, n_input, _ = frf.value.shape
    fit, runs = result.fit, result.runs
    poles = fit.pole[: fit.pole.size - result.n_background]
    n_mode = int(np.count_nonzero(resonant(poles, band)))  # the others come last
    inflation = np.repeat(np.sqrt(runs.enlargement), 2)
    variance_of_poles = fit.pole_covariance * np.outer(inflation, inflation)
    growth = runs.growth(*frequency_damping_std(fit.pole, variance_of_poles))
    covariance = variance_of_poles * np.outer(growth, growth)
    frequency_std, damping_std = frequency_damping_std(fit.pole, covariance)
    residue = fit.residue.reshape(n_output, n_input, fit.pole.size)
    variance = variance_along(fit.residue, fit.residue_covariance() * np.outer(inflation, inflation))
    variance = variance.reshape(residue.shape)[..., :n_mode]
    pole = fit.pole[:n_mode]
    free = _without_window(pole, frf.decay_rate)
    joined, its_own = _joined(fit, runs, frf) if runs.disagree() else (residue, variance)
    shapes = shapes_from_residues(pole, joined[..., :n_mode], its_own[..., :n_mode], frf.output, frf.input)
    noise, correlation, error = _as_measured(fit, frf, quantity)
    return ModalModel(
        name=name,
        frequency=np.abs(free) / (2.0 * np.pi),
        damping=-free.real / np.abs(free),
        frequency_std=frequency_std[:n_mode],
        damping_std=damping_std[:n_mode],
        pole=pole,
        residue=residue[..., :n_mode],
        outside_pole=fit.pole[n_mode:],
        outside_residue=residue[..., n_mode:],
        lower=fit.lower.reshape(n_output, n_input),
        upper=fit.upper.reshape(n_output, n_input),
        shape=shapes.shape,
        shape_std=shapes.std,
        scaled=shapes.scaled,
        node=frf.output.node,
        direction=frf.output.direction,
        sensor=frf.sensor,
        input=frf.input,
        band=band,
        geometry=geometry,
        quantity=quantity,
        covariance=covariance[: 2 * n_mode, : 2 * n_mode],
        residue_std=np.sqrt(variance),
        noise=noise,
        correlation=correlation,
        error=error,
        run=runs.run,
        run_pole=runs.pole[:, :n_mode],
        run_frequency_std=runs.frequency_std[:, :n_mode],
        run_damping_std=runs.damping_std[:, :n_mode],
        run_probability=runs.probability[:, :n_mode],
        decay_rate=frf.decay_rate,
        run_outside_pole=runs.pole[:, n_mode:] if runs.followed else None,
    )


def _joined(fit: Fit, runs: RunPoles, frf: FRF) -> tuple[Complexes, Reals]:
    """Return residues of runs that disagree, each at its own poles, and their variance, (n_output, n_input, n_mode).

    Residues at a pole that a run does not have are too small. They are made those of the pole of all runs: a modal
    constant is a residue times its own frequency.
    """
    shape = (*frf.value.shape[:2], fit.pole.size)
    ratio = (runs.pole.imag[np.searchsorted(runs.run, frf.run)] / fit.pole.imag)[:, None, :]
    return np.asarray(runs.residue.reshape(shape) * ratio, dtype=complex), runs.variance.reshape(shape) * ratio**2


def _without_window(pole: Complexes, decay_rate: float) -> Complexes:
    """Return poles without what an exponential window added to their decay rates (Fladung and Rost 1997).

    Raises
    ------
    IdentificationError
        A mode decays more slowly than the window alone would let it.
    """
    free = pole + decay_rate
    wrong = free.real >= 0.0
    if decay_rate > 0.0 and np.any(wrong):
        hertz, decay = np.abs(pole[wrong][0]) / (2.0 * np.pi), -pole[wrong][0].real
        raise IdentificationError(
            f"the mode at {hertz:.6g} Hz decays by {decay:.4g} 1/s, but the exponential window alone, as it is stated, "
            f"would add {decay_rate:.4g} 1/s; state the time constant of the window that was used"
        )
    return free
