"""A measurement beside its model before anything is concluded: force, scale, sensors misread, a pressure that is none.

A measured modal constant is the product of the shape at the response and at the force. Along the model's shape at the
responses it gives the shape at the force, mode by mode, which only few places of the stack have; and its size is
that of shapes of unit modal mass, which the stack's mass sets. A sensor that is turned over or read in another unit in
all runs makes shapes that no other frequency of the model has.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from ema.modal.configurations import factor_text
from ema.modal.mac import mac
from ema.types.modal_model import ModalModel
from lamella_shared import Integers, Reals
from model import Modes, Observation, ReducedSystem, Stack, observe, sample_points, solve_modes
from updating.correlation.pairing import N_MODE
from updating.correlation.registration import register
from updating.errors import PairingError

_FEWEST_MODES = 4
_DOUBTFUL, _BETTER = 0.15, 0.25
"""Share of the shape at the force that the stated place leaves at least, and what of it another place leaves at most,
for the force to be said to act there."""
_SCALE = 1.3
"""Factor from which the scale is wrong: calibration, density and the mass of clamps leave less."""


@dataclass(frozen=True, kw_only=True)
class ForcePlace:
    """Where the force acts, as the modal constants have it.

    Attributes
    ----------
    stated, likely : (float, float)
        Its place along x and y as the points file has it, and the place that fits best, m.
    left, left_likely : float
        Share of the squared shape at the force, over the modes, that each of the two leaves.
    factor : float
        Measured modal constants over the model's; negative where the force, or all sensors, are turned.
    n_mode : int
        Modes that tell of it.
    """

    stated: tuple[float, float]
    likely: tuple[float, float]
    left: float
    left_likely: float
    factor: float
    n_mode: int

    @property
    def misplaced(self) -> bool:
        """Whether another place fits clearly better."""
        near = 0.02  # m, within which places are one
        apart = float(np.hypot(self.likely[0] - self.stated[0], self.likely[1] - self.stated[1]))
        return self.left > _DOUBTFUL and self.left_likely < _BETTER * self.left and apart > near


@dataclass(frozen=True, kw_only=True)
class RigCheck:
    """What a configuration beside the model says of its measurement.

    Attributes
    ----------
    name : str
        The configuration.
    sensor : int
        Number of the sensor of each run, from 1, that was turned over or misread in all of them; 0 where none was.
    reads : float
        How many times too much it reads; negative where it was turned over.
    force : ForcePlace, optional
        Where the force acts; none where too few modes tell.
    pressure : str
        Why the stated pressure cannot be, in words; empty where it can.
    """

    name: str
    sensor: int
    reads: float
    force: ForcePlace | None
    pressure: str = ""

    @property
    def findings(self) -> tuple[str, ...]:
        """What a user should read."""
        found = [self.pressure] if self.pressure else []
        if self.sensor:
            found.append(_misread(self.sensor, self.reads))
        if self.force is not None and self.force.misplaced:
            found.append(
                f"the force does not act where the points file has it, at {_place(self.force.stated)}: "
                f"{100.0 * self.force.left:.0f} % of the measured modal constants contradict that, and "
                f"{100.0 * self.force.left_likely:.1f} % a place near {_place(self.force.likely)}. Its point, or those "
                "of the sensors, are listed wrongly; effects of the shaker are sought in the wrong place"
            )
        elif self.force is not None and self.force.left < _DOUBTFUL and not self.sensor:
            found += _scale(self.force.factor)
        return tuple(f"{self.name}: {text}" for text in found)


def _misread(sensor: int, reads: float) -> str:
    """Say that a sensor is turned, or that its size is wrong, and how to correct it."""
    turned, sized = reads < 0.0, abs(np.log(abs(reads))) > np.log(_SCALE)
    what = ["upside down"] if turned else []
    what += [f"{factor_text(abs(reads))} as large as it should be"] if sized else []
    scale = (-1.0 if turned else 1.0) / (abs(reads) if sized else 1.0)
    return (
        f"sensor {sensor} of each run seems to be {' and '.join(what)} in all of them: corrected, its shapes are "
        f"those of the model at their frequencies. Correct it with a [[correction]] of scale = {scale:.3g} on it"
    )


def _place(at: tuple[float, float]) -> str:
    return f"x = {1e3 * at[0]:.0f}, y = {1e3 * at[1]:.0f} mm"


def _scale(factor: float) -> list[str]:
    """Say that all functions are too large or too small for the mass of the stack, or turned."""
    found = []
    if factor < 0.0:
        found.append(
            "all functions have the opposite sign to the model's: the force or all sensors are turned, or their "
            "directions are stated the other way round"
        )
    if abs(np.log(abs(factor))) > np.log(_SCALE):
        found.append(
            f"all functions are {factor_text(abs(factor))} as large as the mass of the stack file allows: check the "
            "unit, the calibration, and the masses of stack and clamps"
        )
    return found


def check_rig(system: ReducedSystem, pressure: float, measured: ModalModel, G_f_range: tuple[float, float]) -> RigCheck:
    """Put a measurement beside the model and say what contradicts it about force, scale and sensors.

    Parameters
    ----------
    system : ReducedSystem
        The model; its effects, if it has some, stay neutral.
    pressure : float
        Of the configuration, Pa.
    measured : ModalModel
        The identified modes; the first input is looked at.
    G_f_range : (float, float)
        Contact stiffness parameters that are tried, Pa per Pa.

    Raises
    ------
    PairingError
        Measured points do not lie on the stack.
    """
    trials = 25  # of G_f
    stack = system.stack
    responses = register(stack, measured.geometry, measured.node, measured.direction).observation
    places = _places(system, measured)
    n_dof, n_place = responses.node.size, len(places)
    everywhere = Observation(
        node=np.concatenate([responses.node, np.zeros(n_place, dtype=np.int64)]),
        location=np.vstack([responses.location, places]),
        direction=np.vstack([responses.direction, np.tile(measured.input.direction[0], (n_place, 1))]),
    )
    observed = observe(system, everywhere)
    equations = system.base(("G_f", "d_f", "pressure"))
    observed = replace(observed, reduced_rows=observed.reduced_rows[:, : equations.size])
    tried = np.geomspace(*G_f_range, trials if stack.n_lamina > 1 else 1)
    modes = [
        solve_modes(
            equations,
            G_f=float(g),
            d_f=0.0,
            n_mode=min(N_MODE, equations.size),
            observation=observed,
            parameters={"pressure": pressure},
            by=(),
        ).elastic()
        for g in tried
    ]
    gain = _gain(measured, modes, n_dof)
    nearest, (row, column) = _nearest(measured, gain, modes, n_dof)
    force = _force_place(measured, gain, nearest, (row, column), places) if n_place else None
    sensor, reads = _wrong(measured.sensor, gain, force)
    return RigCheck(name=measured.name, sensor=sensor, reads=reads, force=force, pressure=_no_pressure(stack, pressure))


def _no_pressure(stack: Stack, pressure: float) -> str:
    """Say why a pressure, Pa, cannot be that of a bolted stack: less than its weight, or more than steel bears."""
    largest = 2e8  # Pa, at which sheets of soft steel yield
    gravity = 9.81  # m/s**2
    weight = 0.5 * stack.material.density * gravity * stack.height
    if stack.n_lamina == 1 or weight <= pressure <= largest:
        return ""
    bound = (
        f"less than the stack's own weight brings, {weight / 1e3:.2g} kPa"
        if pressure < weight
        else f"more than sheets of steel bear, {largest / 1e3:.0f} kPa"
    )
    return f"the pressure between the laminas is stated as {pressure / 1e3:.3g} kPa, {bound}: check its unit"


def upright(checked: RigCheck) -> RigCheck:
    """Return a check that found no sensor turned over or misread in all runs.

    Raises
    ------
    PairingError
        One was: shapes and all that follows from them would be nobody's.
    """
    if checked.sensor:
        raise PairingError(checked.findings[0])
    return checked


def _gain(measured: ModalModel, modes: Sequence[Modes], n_dof: int) -> Reals:
    """Return the factor on each component that makes the shapes the model's: one but for a sensor that is wrong."""
    # Mean distance of the measured modes from the model's from which sensors are doubted, and what is left of it
    # where one is corrected.
    wrong, right = 0.2, 0.35
    # Factors that are tried on a sensor, and 1 among them; shapes are right within a quarter
    gains = np.geomspace(1.0 / 40.0, 40.0, 19)
    # Mean distance that a corrected sensor must leave: one side turned makes torsion of bending, and a few modes of a
    # poor model lie as near that way round.
    close = 0.1
    fewest_points = 3  # Points that a sensor must have visited to be taken for one that roves.
    sound, sensor = np.ones(measured.sensor.size), measured.sensor
    least = min(_distance(measured, sound, one, n_dof)[0] for one in modes)
    number = int(sensor.max()) + 1
    roves = number > 1 and np.bincount(sensor).min() >= fewest_points
    if not roves or least < wrong or measured.frequency.size < _FEWEST_MODES:
        return sound
    # Of two sensors either can be corrected by the other's factor, as the size of a shape is arbitrary.
    tried = [
        np.where(sensor == k, sign * gain, 1.0)
        for k in range(1 if number == 2 else 0, number)
        for gain in gains
        for sign in (1.0, -1.0)
    ]
    distance = [min(_distance(measured, gain, one, n_dof)[0] for one in modes) for gain in tried]
    best = int(np.argmin(distance))
    if distance[best] > min(right * least, close):
        return sound
    return _refined(measured, tried[best], modes, n_dof)


def _refined(measured: ModalModel, gain: Reals, modes: Sequence[Modes], n_dof: int) -> Reals:
    """Return the factor of one sensor that fits the paired modes best, from one of those tried."""
    nearest, (row, column) = _nearest(measured, gain, modes, n_dof)
    wrong = gain != 1.0
    if not row.size or not wrong.any():
        return gain
    shape, model = measured.shape[:, row].real, nearest.shape[:n_dof, column]
    along = [np.sum(shape[of] * model[of], axis=0) / np.sum(model[of] ** 2, axis=0) for of in (wrong, ~wrong)]
    found = float(np.sum(along[1] * along[0]) / np.sum(along[0] ** 2))
    return np.where(wrong & (abs(np.log(abs(found))) > np.log(_SCALE) or found < 0.0), found, 1.0)


def _nearest(
    measured: ModalModel, gain: Reals, modes: Sequence[Modes], n_dof: int
) -> tuple[Modes, tuple[NDArray[np.intp], NDArray[np.intp]]]:
    """Return the model's modes that are nearest over G_f, and which of them are which."""
    found = [_distance(measured, gain, one, n_dof) for one in modes]
    best = int(np.argmin([one[0] for one in found]))
    return modes[best], found[best][1:]


def _wrong(sensor: Integers, gain: Reals, force: ForcePlace | None) -> tuple[int, float]:
    """Return the number, from 1, of the sensor that is wrong, and what it reads; 0 and 1 where none is.

    Of two sensors the force tells which: its sign and the mass of the stack are right only with one of them.
    """
    wrong = np.flatnonzero(gain != 1.0)
    if not wrong.size:
        return 0, 1.0
    number, factor = int(sensor[wrong[0]]), float(gain[wrong[0]])
    if int(sensor.max()) == 1 and force is not None and _off(force.factor / factor) < _off(force.factor):
        return 1, factor
    return number + 1, 1.0 / factor


def _off(factor: float) -> tuple[bool, float]:
    """Return how far a factor is from one: its sign first, then its size."""
    return factor < 0.0, float(abs(np.log(abs(factor))))


def _places(system: ReducedSystem, measured: ModalModel) -> Reals:
    """Return places where the force may act, (n, 3) m, the stated one first; none where it is not listed."""
    stations = (41, 9)  # places along x and y where the force may be
    listed = np.flatnonzero(measured.geometry.node == measured.input.node[0])
    if not listed.size:
        return np.empty((0, 3))
    stated = sample_points(system.stack, measured.geometry.coordinate[listed[:1]])[0]
    x, y = (
        np.linspace(-0.5 * size, 0.5 * size, n)
        for size, n in zip((system.stack.length, system.stack.width), stations, strict=True)
    )
    grid = np.stack([*np.meshgrid(x, y), np.full((y.size, x.size), stated[0, 2])], axis=-1)
    return np.vstack([stated, grid.reshape(-1, 3)])


def _distance(
    measured: ModalModel, gain: Reals, modes: Modes, n_dof: int
) -> tuple[float, NDArray[np.intp], NDArray[np.intp]]:
    """Return how far measured modes are from the model's in the mean, by shape and frequency, and which are which."""
    usual_distance = 0.2  # of the logarithm of a frequency
    least_mac = 0.8  # MAC from which a measured mode tells of the force, with the model's shape in its place
    alike = mac(gain[:, None] * measured.shape, modes.shape[:n_dof])
    apart = np.abs(np.log(measured.frequency[:, None] / modes.frequency))
    row, column = scipy.optimize.linear_sum_assignment(alike - np.minimum(apart, 0.5), maximize=True)
    far = np.minimum((apart[row, column] / usual_distance) ** 2, 1.0) + 1.0 - alike[row, column]
    paired = alike[row, column] >= least_mac
    return float(np.mean(far)), row[paired], column[paired]


def _force_place(
    measured: ModalModel, gain: Reals, modes: Modes, pairs: tuple[NDArray[np.intp], NDArray[np.intp]], places: Reals
) -> ForcePlace | None:
    """Return where the force acts as the modal constants of paired modes have it; None where they do not tell.

    The constant of a real mode of unit modal mass is ``2 i omega_d A = phi_o phi_i`` (Ewins, Modal Testing, 2nd ed.,
    sec. 2.8).
    """
    row, column = pairs
    constant = 2j * measured.pole[row].imag * gain[:, None] * measured.residue[:, 0][:, row]
    if row.size < _FEWEST_MODES or not np.any(constant):
        return None
    n_dof = constant.shape[0]
    response, at_place = modes.shape[:n_dof, column], modes.shape[n_dof:, column]
    at_force = np.sum(response * constant.real, axis=0) / np.sum(response**2, axis=0)
    along, size = at_place @ at_force, np.sum(at_place**2, axis=1)
    left = 1.0 - along**2 / np.maximum(size * (at_force @ at_force), np.finfo(float).tiny)
    likely = int(np.argmin(left))
    here = likely if left[0] > _DOUBTFUL else 0
    return ForcePlace(
        stated=(float(places[0, 0]), float(places[0, 1])),
        likely=(float(places[likely, 0]), float(places[likely, 1])),
        left=float(left[0]),
        left_likely=float(left[likely]),
        factor=float(along[here] / size[here]),
        n_mode=int(row.size),
    )
