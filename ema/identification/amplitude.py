"""Frequency and damping of each mode over amplitude, from several force levels or from a free decay.

At each line of functions measured with a force of constant amplitude, a structure that is not linear moves with
another amplitude, so the functions are no sum of poles: where it softens, a
resonance leans to the left, and the pole that fits it best is that of no amplitude. Its motion in one mode is nearly
harmonic, so at each line the mode has the frequency and damping of the amplitude there (A. Carrella, D. J. Ewins,
Identifying and quantifying structural nonlinearities in engineering applications from measured frequency response
functions, Mech. Syst. Signal Process. 25, 2011):

    1 / h = (omega_r(a)**2 (1 + i loss(a)) - omega**2) / c

h is the mode's receptance, filtered out of all functions by its residues once the other modes are taken away, and a
its amplitude. Where the two flanks have the same amplitude they have the same omega_r, which tells the constant c.

One free decay passes all amplitudes. The motion in one mode is filtered out by its shape and a band, its envelope and
phase are those of the analytic signal (M. Feldman, Non-linear system vibration analysis using Hilbert transform, I.
Free vibration analysis method FREEVIB, Mech. Syst. Signal Process. 8, 1994), and a short time at once an exponential
is fitted to it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ema.campaign.campaign import Campaign
from ema.campaign.measurement import Measurement, read_force_levels
from ema.identification.identify import identify_frf
from ema.modal.configurations import compare
from ema.quality.channels import check, usable
from ema.types.errors import EmaError, MeasurementError
from ema.types.frf import DERIVATIVE, FRF, Dofs, Quantity, driving_points
from ema.types.modal_model import ModalModel, synthesize
from lamella_shared import Booleans, Complexes, Integers, Reals, arrays


@dataclass(frozen=True, eq=False, kw_only=True)
class Level:
    """One force level of a state: what was measured and identified.

    Attributes
    ----------
    force : float
        Amplitude of the force at every line, N.
    frf : FRF
        The functions.
    modal_model : ModalModel
        What was identified from them.
    """

    force: float
    frf: FRF
    modal_model: ModalModel


@dataclass(frozen=True, eq=False, kw_only=True)
@arrays({"level": "force", "level column": "frequency frequency_std damping damping_std motion rms_motion mac mode"})
class AmplitudeDependence:
    """Modes of one state of a structure over their amplitude, one row a force level, one column a mode.

    Attributes
    ----------
    name : str
        The configuration.
    level : tuple of str
        Names of the levels, by ascending force.
    force : (n_level,) float
        Amplitude of the force, N.
    point : str
        Degree of freedom that `motion` is of: the driving point where all levels measured it, else the one that moves
        most.
    frequency, frequency_std : (n_level, n_mode) float
        Natural frequency at the amplitude of resonance and its standard deviation, Hz; NaN where a level lacks a mode.
    damping, damping_std : (n_level, n_mode) float
        Damping ratios likewise.
    motion : (n_level, n_mode) float
        Displacement amplitude of `point` in resonance, in this mode alone, m.
    rms_motion : (n_level, n_mode) float
        Root mean square of the displacement amplitudes of all responses of the level, m.
    mode : (n_level, n_mode) int
        Number of the mode among those of its level, from 0; -1 where it has none.
    mac : (n_level, n_mode) float
        MAC with the same mode at the next lower level that has it.
    """

    name: str
    level: tuple[str, ...]
    force: Reals
    point: str
    frequency: Reals
    frequency_std: Reals
    damping: Reals
    damping_std: Reals
    motion: Reals
    rms_motion: Reals
    mode: Integers
    mac: Reals

    @property
    def softening(self) -> Reals:
        """Share by which each frequency changes from the smallest to the largest amplitude, (n_mode,); NaN of one."""
        return _between_ends(self.frequency)

    @property
    def findings(self) -> tuple[str, ...]:
        """What a user should read, a line for each mode that at least two levels have."""
        return tuple(self._findings())

    def _findings(self) -> Iterator[str]:
        # Standard deviations by which a change from the lowest to the highest amplitude must exceed 0 to be
        # reported.
        # Share of a frequency by which tests of one linear structure on one day differ: less is no change with
        # amplitude.
        drift = 2e-4
        damping_drift = 0.03  # share of a damping ratio by which such tests differ
        shows = 3.0
        for r, share in enumerate(self.softening):
            if np.isnan(share):
                continue
            seen = np.flatnonzero(np.isfinite(self.frequency[:, r]))
            low, high = seen[0], seen[-1]
            f, xi = self.frequency[:, r], self.damping[:, r]
            f_std = np.hypot(*(self.frequency_std[[low, high], r] / f[[low, high]]))
            xi_std = np.hypot(*(self.damping_std[[low, high], r] / xi[[low, high]]))
            grown = xi[high] / xi[low] - 1.0
            softer = share < -shows * np.hypot(f_std, drift)
            changed = abs(share) > shows * np.hypot(f_std, drift) or abs(grown) > shows * np.hypot(
                xi_std, damping_drift
            )
            what = (
                "contact that slips does this"
                if softer and grown > 0.0
                else "not linear"
                if changed
                else "no change with amplitude shows"
            )
            yield (
                f"{f[low]:.5g} Hz: from {self.motion[low, r]:.2g} to {self.motion[high, r]:.2g} m at {self.point} the "
                f"frequency changes by {100 * share:+.2g} % and the damping ratio from {100 * xi[low]:.2g} to "
                f"{100 * xi[high]:.2g} %: {what}"
            )


def _between_ends(table: Reals) -> Reals:
    """Return last over first number of each column, less 1; NaN where a column has fewer than two."""
    change = np.full(table.shape[1], np.nan)
    for r, column in enumerate(table.T):
        known = column[np.isfinite(column)]
        if known.size > 1:
            change[r] = known[-1] / known[0] - 1.0
    return change


def amplitude_dependence(name: str, levels: Sequence[Level]) -> AmplitudeDependence:
    """Follow the modes of one state of a structure from force level to force level.

    A mode goes on as the one of the next level with the most similar shape (`ema.modal.configurations`), however far
    its frequency moves; over few shared responses frequencies must agree to 10 %.

    Parameters
    ----------
    name : str
        The configuration.
    levels : sequence of Level
        At least one, in any order.
    """
    ordered = sorted(levels, key=lambda level: level.force)
    of_level = [resonances(level.frf, level.modal_model) for level in ordered]
    tracked = compare([level.modal_model for level in ordered])
    mode = np.full(tracked.frequency.shape, -1)
    for k, level in enumerate(ordered):
        for r, f in enumerate(level.modal_model.frequency):
            mode[k, tracked.frequency[k] == f] = r
    place, point = _reference([level.modal_model for level in ordered])
    motion = [level.force * modes.response[o, i] for level, modes, (o, i) in zip(ordered, of_level, place, strict=True)]
    rms = [
        level.force * np.sqrt(np.mean(modes.response[:, i] ** 2, axis=0))
        for level, modes, (_, i) in zip(ordered, of_level, place, strict=True)
    ]

    def table(values: Sequence[Reals]) -> Reals:
        return np.array([np.where(modes >= 0, value[modes], np.nan) for modes, value in zip(mode, values, strict=True)])

    return AmplitudeDependence(
        name=name,
        level=tuple(level.modal_model.name for level in ordered),
        force=np.array([level.force for level in ordered]),
        point=point,
        frequency=table([modes.frequency for modes in of_level]),
        frequency_std=table([modes.frequency_std for modes in of_level]),
        damping=table([modes.damping for modes in of_level]),
        damping_std=table([modes.damping_std for modes in of_level]),
        motion=table(motion),
        rms_motion=table(rms),
        mode=mode,
        mac=tracked.mac,
    )


def at_resonance(level: Level) -> ModalModel:
    """Return the modes of a level with frequencies and damping ratios at the amplitude of resonance."""
    modes: Resonances = resonances(level.frf, level.modal_model)
    return replace(
        level.modal_model,
        frequency=modes.frequency,
        damping=modes.damping,
        frequency_std=modes.frequency_std,
        damping_std=modes.damping_std,
    )


def _reference(models: Sequence[ModalModel]) -> tuple[list[tuple[int, int]], str]:
    """Return output and input of each level that motion is stated for, and the name of that degree of freedom."""
    names = [{_name(model, k): k for k in range(model.node.size)} for model in models]
    shared = [key for key in names[0] if all(key in other for other in names)]
    driven = {
        _name(models[0], o): i
        for o, i, _ in driving_points(_outputs(models[0]), models[0].input)
        if _name(models[0], o) in shared
    }
    size = np.abs(models[0].residue).sum(axis=(1, 2))
    point = next(iter(driven), max(shared or names[0], key=lambda key: size[names[0][key]]))
    return [(places.get(point, 0), driven.get(point, 0)) for places in names], point


def _outputs(model: ModalModel) -> Dofs:
    return Dofs(node=model.node, direction=model.direction)


def _name(model: ModalModel, k: int) -> str:
    return _outputs(model).name(k)


def identify_force_levels(campaign: Campaign, name: str) -> tuple[tuple[Level, ...], tuple[str, ...]]:
    """Identify a configuration at its other force levels.

    Parameters
    ----------
    campaign : Campaign
    name : str
        The configuration.

    Returns
    -------
    levels : tuple of Level
        Those that can be identified.
    lost : tuple of str
        What is wrong with the others; they do not end these.

    Raises
    ------
    CampaignError, MeasurementError
        The files of a level cannot be read.
    """
    levels, lost = [], []
    for measurement in read_force_levels(campaign, name):
        try:
            levels.append(_level(campaign, measurement))
        except EmaError as error:
            lost.append(f"{measurement.name} is left out of the modes over amplitude: {error}")
    return tuple(levels), tuple(lost)


def _level(campaign: Campaign, measurement: Measurement) -> Level:
    options, force = campaign.identification, measurement.configuration.force
    kept = usable(measurement, check(measurement, options.band))
    modes = identify_frf(
        kept.frf,
        kept.geometry,
        name=measurement.name,
        band=options.band,
        order=options.order,
        sensor_mass=campaign.sensor_mass,
    )
    return Level(force=float(force or 0.0), frf=kept.frf, modal_model=modes)


@dataclass(frozen=True, eq=False, kw_only=True)
@arrays({"n": "frequency damping frequency_std damping_std", "any any n": "response"})
class Resonances:
    """Modes at the amplitude that they have in resonance.

    Attributes
    ----------
    frequency, damping : (n_mode,) float
        Natural frequencies, Hz, and damping ratios at that amplitude.
    frequency_std, damping_std : (n_mode,) float
        Their standard deviations.
    response : (n_output, n_input, n_mode) float
        Displacement of each output in that mode alone, over the force, m/N.
    """

    frequency: Reals
    damping: Reals
    frequency_std: Reals
    damping_std: Reals
    response: Reals


def resonances(frf: FRF, modal_model: ModalModel) -> Resonances:
    """Return the modes of functions that were measured with a force of constant amplitude, at resonance.

    Parameters
    ----------
    frf : FRF
        The functions that were identified.
    modal_model : ModalModel
        What was identified: its poles say where to look, and its residues filter. Modes of which a bandwidth holds too
        few lines stay as they are there.
    """
    lines = frf.band(max(modal_model.band[0], np.finfo(float).tiny), modal_model.band[1]).convert("receptance")
    # residual terms stay in: beside leaning resonances a fit bends them, and the filter passes little of them
    beside = replace(modal_model, lower=0.0 * modal_model.lower, upper=0.0 * modal_model.upper)
    rest = lines.value - synthesize(beside, lines.frequency, "receptance")
    power = (2.0 * np.pi * lines.frequency) ** DERIVATIVE[modal_model.quantity]
    modes = [_resonance(lines.frequency, rest, modal_model, r, power) for r in range(modal_model.frequency.size)]
    table = np.array([row for row, _ in modes]).reshape(-1, 4)
    return Resonances(
        frequency=table[:, 0],
        damping=table[:, 1],
        frequency_std=table[:, 2],
        damping_std=table[:, 3],
        response=np.stack([response for _, response in modes], axis=-1),
    )


def _resonance(
    frequency: Reals,
    rest: Complexes,
    model: ModalModel,
    r: int,
    power: Reals,
    *,
    reach: float = 1.2,
    min_lines: int = 8,
) -> tuple[tuple[float, float, float, float], Reals]:
    """Return frequency, damping and their standard deviations of a mode, and its response over the force, m/N.

    `reach`, `min_lines`: half bandwidths to either side of the largest response, over which frequency grows evenly
    with amplitude.
    """
    pole, residue = model.pole[r], model.residue[..., r]
    s, scale = 2j * np.pi * frequency, 2j * pole.imag
    constant = residue * scale
    constant = np.real(constant)  # of a real mode; what is complex is noise or damping that couples modes
    alone = residue[..., None] / (s - pole) + residue.conj()[..., None] / (s - pole.conj())
    size = float(np.sum(constant**2))
    h = np.tensordot(constant, rest + alone, axes=2) / size
    noise = np.sqrt(np.sum((constant * model.noise) ** 2)) / size / power
    near = np.abs(frequency - frequency[np.argmax(np.where(_around(frequency, pole), np.abs(h), 0.0))])
    chosen = near <= reach * -pole.real / (2.0 * np.pi)
    stated = (model.frequency[r], model.damping[r], model.frequency_std[r], model.damping_std[r])
    if np.count_nonzero(chosen) < min_lines:
        return stated, np.abs(constant) / (2.0 * model.damping[r] * np.abs(pole) ** 2)
    values, peak = _over_amplitude(2.0 * np.pi * frequency[chosen], h[chosen], noise[chosen])
    # what a window and the mass of sensors do to poles is taken out of these as it is of the model's
    ratio = 2.0 * np.pi * model.frequency[r] / abs(pole)
    damping = values[1] - model.decay_rate / (2.0 * np.pi * values[0])
    return (values[0] * ratio, damping, values[2] * ratio, values[3]), np.abs(constant) * peak


def _around(frequency: Reals, pole: complex) -> Booleans:
    """Tell the lines within two bandwidths of a pole, and the nearest line."""
    off = np.abs(frequency - abs(pole) / (2.0 * np.pi))
    return off <= max(4.0 * -pole.real / (2.0 * np.pi), float(off.min()))


def _over_amplitude(omega: Reals, h: Complexes, noise: Reals) -> tuple[tuple[float, float, float, float], float]:
    """Return frequency, Hz, damping, their standard deviations and abs(h), s2, where the amplitude is largest."""
    inverse, size = 1.0 / h, np.abs(h)
    weight = size**2 / noise
    peak = _vertex(omega, size)
    less = size / peak - 1.0
    columns = np.column_stack([np.ones(omega.size), less, less**2, -inverse.real])
    (square, _, _, c), covariance = _weighted(columns, omega**2, weight)
    loss, loss_covariance = _weighted(columns[:, :3], c * inverse.imag / omega**2, weight)
    w = np.sqrt(square)
    lost = float(loss[0])
    std = (
        np.sqrt(covariance[0, 0]) / (2.0 * w),
        np.hypot(np.sqrt(loss_covariance[0, 0]), lost * np.sqrt(covariance[3, 3]) / c),
    )
    return (float(w / (2.0 * np.pi)), lost / 2.0, float(std[0] / (2.0 * np.pi)), float(std[1] / 2.0)), peak


def _weighted(columns: Reals, value: Reals, weight: Reals) -> tuple[Reals, Reals]:
    """Return the least-squares solution and its covariance, with the scatter that the rows show."""
    scale = np.linalg.norm(columns * weight[:, None], axis=0)
    q, triangle = np.linalg.qr(columns * weight[:, None] / scale)
    solution = np.linalg.solve(triangle, q.T @ (weight * value))
    left = weight * value - (columns * weight[:, None] / scale) @ solution
    inverse = np.linalg.inv(triangle) / scale[:, None]
    freedom = max(value.size - columns.shape[1], 1)
    return solution / scale, inverse @ inverse.T * float(left @ left) / freedom


def _vertex(omega: Reals, size: Reals) -> float:
    """Return the largest value of a curve, of the parabola through its five highest lines."""
    top = int(np.clip(np.argmax(size), 2, size.size - 3))
    x = omega[top - 2 : top + 3] - omega[top]
    a, b, c = np.polyfit(x, size[top - 2 : top + 3], 2)
    return float(c - b**2 / (4.0 * a)) if a < 0.0 else float(size[top])


_CYCLES = 12.0  # in one fit; over fewer the band lets too little through


@dataclass(frozen=True, eq=False, kw_only=True)
@arrays({"n": "amplitude frequency frequency_std damping damping_std"})
class RingDown:
    """A mode over its amplitude, from a free decay, in the order of time.

    Attributes
    ----------
    amplitude : (n,) float
        Displacement amplitude at the strongest channel, m, for responses in SI units.
    frequency, frequency_std : (n,) float
        Natural frequency and its standard deviation, Hz.
    damping, damping_std : (n,) float
        Damping ratio likewise.
    """

    amplitude: Reals
    frequency: Reals
    frequency_std: Reals
    damping: Reals
    damping_std: Reals


def ring_down(
    response: Reals,
    rate: float,
    *,
    shape: Reals,
    frequency: Reals,
    mode: int,
    quantity: Quantity,
    overlap: float = 0.5,
    floor: float = 5.0,
) -> RingDown:
    """Follow one mode through a free decay.

    Parameters
    ----------
    response : (n_channel, n_sample)
        Free motion, from when the force has ended; without offset.
    rate : float
        Sampling rate, Hz.
    shape : (n_channel, n_mode)
        Real shapes of the modes in the record at these channels.
    frequency : (n_mode,)
        Their frequencies, Hz.
    mode : int
        The one to follow, from 0.
    quantity : "receptance", "mobility" or "accelerance"
        Whether the responses are displacement, velocity or acceleration.
    overlap : float
        Share of a fit that the next one overlaps.
    floor : float
        Times the noise at the end of the record, below which nothing is fitted.

    Raises
    ------
    MeasurementError
        The record is too short or too noisy for the mode, or channels and shapes do not fit.
    """
    left_out = 1.5  # fits left out at either end, where the band is still filling
    record, shapes = np.atleast_2d(response), np.atleast_2d(shape)
    _require_fitting(record, shapes, np.size(frequency))
    # with fewer channels than modes, the one that is sought alone
    used = shapes if shapes.shape[0] >= shapes.shape[1] else shapes[:, [mode]]
    filtered = np.linalg.pinv(used)[mode if used is shapes else 0] @ record
    signal = _analytic(filtered, rate, np.asarray(frequency, dtype=float), mode)
    size = int(np.ceil(_CYCLES / frequency[mode] * rate))
    step, edge = max(int(size * (1.0 - overlap)), 1), int(left_out * size)
    noise = float(np.sqrt(np.mean(np.abs(signal[-edge - size : -edge]) ** 2))) if signal.size > 2 * edge + size else 0.0
    starts = range(edge, signal.size - edge - size, step)
    fits = [_exponential(signal[i : i + size], rate) for i in starts]
    largest = max((fit[0] for fit in fits), default=0.0)
    ended = noise < 0.1 * largest
    fits = [fit for fit in fits if fit[0] > floor * noise or not ended]
    if len(fits) < 2:
        raise MeasurementError(
            f"ring-down: {signal.size} samples at {rate:g} Hz are too short, or too noisy, for a mode at "
            f"{frequency[mode]:g} Hz: {_CYCLES:g} cycles at once are fitted, and the ends are left out"
        )
    table = np.array(fits)
    omega = np.hypot(table[:, 1], table[:, 2])
    strongest = float(np.abs(shapes[:, mode]).max())
    return RingDown(
        amplitude=strongest * table[:, 0] / omega ** DERIVATIVE[quantity],
        frequency=omega / (2.0 * np.pi),
        frequency_std=table[:, 3] / (2.0 * np.pi),
        damping=table[:, 1] / omega,
        damping_std=table[:, 3] / omega,
    )


def _require_fitting(record: Reals, shape: Reals, n_frequency: int) -> None:
    if record.shape[0] != shape.shape[0] or shape.shape[1] != n_frequency:
        raise MeasurementError(
            f"ring-down: {record.shape[0]} channels, shapes of {shape.shape[0]} channels and {shape.shape[1]} modes, "
            f"and {n_frequency} frequencies do not belong together"
        )


def _analytic(
    signal: Reals, rate: float, frequency: Reals, mode: int, *, width: float = 0.15, gap: float = 0.45
) -> Complexes:
    """Return the analytic signal of a band around a mode, whose flanks are half a cosine.

    `width`: half width of the band over the mode's frequency, less where modes are near.
    `gap`: share of the distance to the next mode.
    """
    centre = frequency[mode]
    others = np.abs(np.delete(frequency, mode) - centre)
    half = min(width * centre, gap * float(others.min(initial=np.inf)))
    padded = 2 * signal.size  # what is filtered at one end must not come back at the other
    line = np.fft.fftfreq(padded, 1.0 / rate)
    off = np.clip((np.abs(line - centre) / half - 0.5) / 0.5, 0.0, 1.0)
    band = np.where(line > 0.0, 1.0 + np.cos(np.pi * off), 0.0)
    return np.asarray(np.fft.ifft(np.fft.fft(signal, padded) * band)[: signal.size])


def _exponential(signal: Complexes, rate: float) -> tuple[float, float, float, float]:
    """Return amplitude in the middle, decay rate, angular frequency and the standard deviation of both, 1/s."""
    time = (np.arange(signal.size) - 0.5 * (signal.size - 1)) / rate
    value = np.log(np.abs(signal)) + 1j * np.unwrap(np.angle(signal))
    slope = complex(time @ value / (time @ time))
    middle = complex(value.mean())
    left = value - middle - slope * time
    # what is left is smooth, for the band made it so: about one number a cycle is independent
    std = float(np.sqrt(np.mean(np.abs(left) ** 2) / 2.0 / (np.mean(time**2) * _CYCLES)))
    return float(np.exp(middle.real)), -slope.real, slope.imag, std
