"""Measured configurations as a diagnosis takes them: beside the model, what separates them, and what may be wrong."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Annotated, Any, Protocol

import numpy as np
import scipy
from numpy.typing import NDArray
from pydantic import Field, create_model

from ema.io.files import Section
from ema.modal.mac import mac
from ema.types.modal_model import ModalModel
from lamella_shared import read_form
from model import Effect, Modes, Observation, Observed, ReducedEquations, Stack, contact_strain, observe, solve_modes
from updating.correlation.registration import register
from updating.diagnosis.candidates import G_F_RANGE, N_MODEL, CandidateModel
from updating.diagnosis.slipping import AtLevel, silent_effects, strain_shares
from updating.errors import FitError

Vector = NDArray[np.float64]

POINTS_SHIFT = "points_x"
"""Nuisance: how far all measured points sit along x from where the files have them, m."""
DECAY = "window"
"""Nuisance: the rate, 1/s, by which an exponential window that nobody stated makes everything decay faster."""
D_F_START = 2e-11
"""Contact damping parameter, s, from which a search starts where the stack states none."""


@dataclass(frozen=True, kw_only=True)
class DiagnosisScatter:
    """What a laboratory knows of what separates a right model from a right measurement, relative standard deviations.

    Attributes
    ----------
    frequency, damping : float, optional
        Discrepancy of a model to which nothing is missing: of a frequency and of a damping ratio. They are estimated
        where they are not stated, see `updating.inference.discrepancy`.
    gain : float
        Of an accelerometer that roves, relative to that of the first.
    stiffness, loss : float
        Of G_f and d_f between configurations: reassembly and torque.
    young, density, normal_modulus, length, width, height : float
        Of what the stack file says of the steel, of the contact across, and of the dimensions.
    clamp_place : float
        Of where the clamps sit along x and y, m.
    points_shift : float
        Of how far all points together sit along x from where the files have them, m.
    """

    frequency: float | None = None
    damping: float | None = None
    gain: float = 0.01
    stiffness: float = 0.03
    loss: float = 0.06
    young: float = 0.02
    density: float = 0.01
    normal_modulus: float = 0.2
    length: float = 1e-3
    width: float = 2e-3
    height: float = 2e-3
    clamp_place: float = 2e-3
    points_shift: float = 1e-3


class Identified(Protocol):
    """Modes with standard deviations, as `ema.ModalModel` has them."""

    @property
    def frequency(self) -> Vector:
        """Natural frequencies (n_mode,), Hz."""

    @property
    def frequency_std(self) -> Vector:
        """Their standard deviations."""

    @property
    def damping(self) -> Vector:
        """Damping ratios (n_mode,)."""

    @property
    def damping_std(self) -> Vector:
        """Their standard deviations."""

    @property
    def shape(self) -> NDArray[np.complex128]:
        """Shapes (n_dof, n_mode)."""

    @property
    def shape_std(self) -> Vector:
        """Standard deviations of their components."""

    @property
    def sensor(self) -> NDArray[np.int64]:
        """The accelerometer that measured each component, (n_dof,), from 0."""


@dataclass(frozen=True, eq=False, kw_only=True)
class SomeModes:
    """Some of the modes that were identified, see `Identified`."""

    frequency: Vector
    frequency_std: Vector
    damping: Vector
    damping_std: Vector
    shape: NDArray[np.complex128]
    shape_std: Vector
    sensor: NDArray[np.int64]


def some_of(modes: Identified, kept: NDArray[np.bool_], *, damping: bool) -> SomeModes:
    """Return the modes that are kept, (n_mode,) bool; without damping, their ratios are said to be unknown."""
    unknown = 1e3  # relative standard deviation of what does not take part
    std = modes.damping_std if damping else unknown * modes.damping
    return SomeModes(
        frequency=modes.frequency[kept],
        frequency_std=modes.frequency_std[kept],
        damping=modes.damping[kept],
        damping_std=std[kept],
        shape=modes.shape[:, kept],
        shape_std=modes.shape_std[:, kept],
        sensor=modes.sensor,
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class Tested:
    """One configuration: its pressure and what was identified.

    Attributes
    ----------
    name : str
        The configuration.
    pressure : float
        Mean pressure, Pa.
    modes : Identified
        The identified modes, or those that a test is expected to give.
    known : mapping of str to float
        Values of effect parameters that the test sets, such as a known mass.
    state : str
        What it has in common with other force levels of the same state; empty where it is a state of its own.
    strain : (n_mode, n_share) float, optional
        Strains of equal parts of the contact's energy in resonance of each mode, where amplitudes are known.
    motion : (n_mode,) float, optional
        Displacement amplitude at the driving point there, m.
    """

    name: str
    pressure: float
    modes: Identified
    known: Mapping[str, float] = field(default_factory=dict)
    state: str = ""
    strain: Vector | None = None
    motion: Vector | None = None

    @property
    def assembled(self) -> str:
        """What was put together once: all its force levels share this name."""
        return self.state or self.name


def pair(
    shape: NDArray[np.complex128] | Vector, frequency: Vector, modelled_shape: Vector, modelled_frequency: Vector
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Pair measured with modelled modes by MAC less a small penalty for distance in frequency."""
    far = np.abs(np.log(frequency[:, None] / modelled_frequency))
    row, column = scipy.optimize.linear_sum_assignment(mac(shape, modelled_shape) - np.minimum(far, 0.5), maximize=True)
    return row, column


def unit_shape(measured: NDArray[np.complex128] | Vector) -> Vector:
    """Return measured shapes, (n_dof, n_mode), turned real and at unit length."""
    turned = np.real(measured * np.exp(-0.5j * np.angle(np.sum(measured**2, axis=0))))
    return np.asarray(turned / np.linalg.norm(measured, axis=0))


MEASUREMENT = "measurement"
"""Family of these hypotheses."""
STATED_PRESSURE, STATED_SIZE, STATED_PLACE = "stated_pressure", "stated_size", "stated_place"
SENSOR_GAIN, STATED_POINTS, WINDOW = "sensor_gain", "stated_points", "exponential_window"
LABELS = {
    STATED_PRESSURE: "a pressure or torque stated wrongly",
    STATED_SIZE: "dimensions of the stack stated wrongly",
    STATED_PLACE: "clamps that sit elsewhere than stated",
    SENSOR_GAIN: "the calibration of a roving accelerometer",
    STATED_POINTS: "measured points that all sit farther along the stack than stated",
    WINDOW: "the damping of an exponential window",
}
"""What each is called."""
PRESSURE, SIZE, GAIN = 0.07, 0.01, 0.3
"""Standard deviations of logarithms where something was stated wrongly."""
PLACE = 8e-3
"""The same of a place, m."""
FALL = 3.0
"""The same of a decay, 1/s: of a window that falls to a hundredth in 1.5 s."""


_KEYS: dict[str, Any] = {
    field.name: (Annotated[float, Field(gt=0, lt=1)], field.default) for field in fields(DiagnosisScatter)
}
ScatterFile = create_model("ScatterFile", __base__=Section, __doc__="The form of the whole file.", **_KEYS)


def read_scatter(path: Path) -> DiagnosisScatter:
    """Read standard deviations, relative to the value, under the names of `DiagnosisScatter`; what is not stated stays.

    Raises
    ------
    FitError
        The file is missing, is not TOML, or has a key that is unknown or no number between 0 and 1.
    """
    return DiagnosisScatter(**read_form(path, ScatterFile, FitError).model_dump())


Campaigned = tuple[str, float, ModalModel]  # name, pressure in Pa, identified modes

_TRIALS = 17


@dataclass(frozen=True, eq=False, kw_only=True)
class Assembled:
    """Configurations beside a model.

    Attributes
    ----------
    stack : Stack
        Without effects.
    tested : tuple of Tested
        The configurations.
    observation : tuple of Observation
        The measured points of each.
    effects : mapping of str to Effect
        Those that these data can show.
    impossible : mapping of str to str
        Why effects of the catalogue that are not among these cannot be.
    scatter : DiagnosisScatter
        What separates a right model from a right measurement.
    start : mapping of str to float
        ln G_f and ln d_f over the stack file's, near which the base model comes nearest; 0 without contact.
    """

    stack: Stack
    tested: tuple[Tested, ...]
    observation: tuple[Observation, ...]
    effects: Mapping[str, Effect]
    impossible: Mapping[str, str]
    scatter: DiagnosisScatter
    start: Mapping[str, float]


def assemble_evidence(
    candidates: CandidateModel,
    tested: Sequence[Campaigned],
    *,
    scatter: DiagnosisScatter | None = None,
    levels: Mapping[str, AtLevel] | None = None,
) -> Assembled:
    """Put measured configurations beside a model and look where its contact comes nearest to them.

    Parameters
    ----------
    candidates : CandidateModel
        The model.
    tested : sequence of (str, float, ModalModel)
        Name, pressure in Pa and identified modes of each configuration.
    scatter : DiagnosisScatter, optional
        What separates a right model from a right measurement.
    levels : mapping of str to AtLevel, optional
        Which force level each configuration is, by its name, where some are levels of one state.

    Raises
    ------
    FitError
        No configuration is given, or no measured mode of one resembles one of the model.
    PairingError
        Measured points do not lie on the stack.
    """
    if not tested:
        raise FitError("nothing to compare: no configuration was identified")
    base, silent = candidates.stack, silent_effects(candidates.effects, several_levels=bool(levels))
    observation = tuple(
        register(base, modes.geometry, modes.node, modes.direction).observation for _, _, modes in tested
    )
    configurations = _as_tested(tested, levels or {})
    observed = tuple(observe(candidates.system, o) for o in observation)
    touching = base.n_lamina > 1
    G_f = _nearest(candidates.system.equations, configurations, observed)
    if levels and touching:
        configurations = _with_contact_strain(candidates, configurations, observed, G_f, levels)
    d_f = np.log(D_F_START / base.contact.d_f) if base.contact.d_f > 0.0 else 0.0
    return Assembled(
        stack=base,
        tested=configurations,
        observation=observation,
        effects={name: effect for name, effect in candidates.effects.items() if name not in silent},
        impossible={**candidates.impossible, **silent},
        scatter=scatter or DiagnosisScatter(),
        start={
            "G_f": float(np.log(G_f / base.contact.G_f)) if touching else 0.0,
            "d_f": float(d_f) if touching else 0.0,
        },
    )


def _as_tested(given: Sequence[Campaigned], levels: Mapping[str, AtLevel]) -> tuple[Tested, ...]:
    states = {name: level.state for name, level in levels.items()}
    return tuple(Tested(name=name, pressure=p, modes=modes, state=states.get(name, "")) for name, p, modes in given)


def _with_contact_strain(
    candidates: CandidateModel,
    tested: Sequence[Tested],
    observed: Sequence[Observed],
    G_f: float,
    levels: Mapping[str, AtLevel],
) -> tuple[Tested, ...]:
    """Return the configurations with the strains that the contact has, by the base model's shapes, at their levels."""
    contact, with_strains = contact_strain(candidates.system), []
    for configuration, points in zip(tested, observed, strict=True):
        if configuration.name not in levels:
            with_strains.append(configuration)
            continue
        base = _solved(candidates.system.equations, configuration, points, G_f)
        column = np.argmax(mac(configuration.modes.shape, base.shape), axis=1)
        amplitude = levels[configuration.name].rms_motion / np.sqrt(np.mean(base.shape[:, column] ** 2, axis=0))
        coordinate = np.zeros((candidates.system.size, column.size))
        coordinate[: len(base.coordinate)] = base.coordinate[:, column]
        shares = [strain_shares(contact, x) for x in coordinate.T]
        strain = amplitude[:, None] * np.array(shares)
        with_strains.append(replace(configuration, strain=strain, motion=levels[configuration.name].motion))
    return tuple(with_strains)


def _solved(equations: ReducedEquations, configuration: Tested, observed: Observed, G_f: float) -> Modes:
    """Return the elastic modes of a configuration without effects."""
    known = {"pressure": configuration.pressure, **configuration.known}
    base = equations.base(("G_f", "d_f", *known))
    return solve_modes(
        base,
        G_f=G_f,
        d_f=D_F_START,
        n_mode=min(N_MODEL, base.size),  # one lamina without effects has few
        observation=replace(observed, reduced_rows=observed.reduced_rows[:, : base.size]),
        parameters=known,
        by=(),
    ).elastic()


def _nearest(equations: ReducedEquations, tested: Sequence[Tested], observed: Sequence[Observed]) -> float:
    """Return the G_f with which the base model has most of the measured modes, of those tried over its range.

    Raises
    ------
    FitError
        It has none of a configuration there.
    """
    G_f = min(np.geomspace(*G_F_RANGE, _TRIALS).tolist(), key=lambda trial: _far(equations, tested, observed, trial)[0])
    n_used = _far(equations, tested, observed, G_f)[1]
    unlike = [configuration.name for configuration, n in zip(tested, n_used, strict=True) if not n]
    if unlike:
        raise FitError(
            f"no measured mode of {' or '.join(unlike)} resembles one of the model, so nothing of it would be used; "
            "check points, directions and signs there, and that its files are of this stack"
        )
    return float(G_f)


def _far(
    equations: ReducedEquations, tested: Sequence[Tested], observed: Sequence[Observed], G_f: float
) -> tuple[float, list[int]]:
    """Return how far the measured modes are from the base model's in all, and how many of each it has."""
    mac_used = 0.6  # from which a measured mode counts as one that the model has
    cost, used = 0.0, []
    for configuration, points in zip(tested, observed, strict=True):
        modes = _solved(equations, configuration, points, G_f)
        row, column = pair(configuration.modes.shape, configuration.modes.frequency, modes.shape, modes.frequency)
        alike = mac(configuration.modes.shape, modes.shape)[row, column]
        far = np.log(configuration.modes.frequency[row] / modes.frequency[column])
        cost += float(np.sum(np.minimum((far / 0.2) ** 2, 1.0) + 1.0 - alike))
        used.append(int(np.count_nonzero(alike >= mac_used)))
    return cost, used
