"""Measured configurations as a diagnosis takes them, what separates them from a model, and what may be wrong."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Annotated, Any, Protocol

import numpy as np
import scipy
from numpy.typing import NDArray
from pydantic import Field, create_model

from ema.io.files import Section, read_form
from ema.modal.mac import mac
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
