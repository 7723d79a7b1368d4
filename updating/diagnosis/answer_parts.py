"""Parts of an answer: what it leaves, what it says of sensors and points, of the contact, and of further tests."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Kind = Literal["mass", "spring"]
"""What a change at one point is: added mass, or a spring to the ground."""


@dataclass(frozen=True, kw_only=True)
class Sizes:
    """Sizes of the discrepancy, relative to a frequency and to a damping ratio; NaN of what is not compared."""

    frequency: float
    damping: float


@dataclass(frozen=True, kw_only=True)
class Moved:
    """A quantity that every fit may move: of the stack file, or of the measurement.

    Attributes
    ----------
    name, label, unit : str
        The coordinate, what a person calls it, and its unit; G_f in 1 is Pa per Pa, and a ratio.
    stated, value, std : float
        As stated, as fitted, and the standard deviation of that.
    prior : float, optional
        Standard deviation of what is known of it beforehand; None of what nothing is known of.
    deviations : float, optional
        By how many of these it was moved.
    """

    name: str
    label: str
    unit: str
    stated: float
    value: float
    std: float
    prior: float | None
    deviations: float | None


@dataclass(frozen=True, kw_only=True)
class SensorGain:
    """The gain of an accelerometer that roves, relative to that of the first.

    Attributes
    ----------
    sensor : int
        Its place among the outputs of a run, from 1.
    excess : float
        By which share it reads higher.
    std : float
        Standard deviation of that.
    """

    sensor: int
    excess: float
    std: float


@dataclass(frozen=True, kw_only=True)
class NextTest:
    """How well a further test would tell the explanations apart that are left.

    Attributes
    ----------
    name, instruction : str
        The test.
    distance : float
        Smallest discrimination distance between two explanations after it; above 3 it separates them.
    now : float
        The same before it.
    """

    name: str
    instruction: str
    distance: float
    now: float


@dataclass(frozen=True, kw_only=True)
class PointChange:
    """The change at a single point that explains most of what a model leaves unexplained, by a linear step.

    Attributes
    ----------
    beside : tuple of str
        Effects that the model has.
    node : int
        The measured point.
    kind : "mass" or "spring"
        What acts there, in the measured direction; a spring is fixed to the ground.
    size : float
        How much of it, kg or N/m; negative where the model has too much.
    log_odds : float
        Logarithm of its odds, the number of points counted.
    """

    beside: tuple[str, ...]
    node: int
    kind: Kind
    size: float
    log_odds: float


@dataclass(frozen=True, kw_only=True)
class MixedUp:
    """Points that were mixed up.

    Attributes
    ----------
    kind : "exchanged", "turned" or "scaled"
        Two points were measured in each other's place, a sensor was turned over, or it read by a factor too much.
    configuration : tuple of str
        Where.
    node : tuple of int
        The points.
    log_odds : float
        Logarithm of the odds against data that are as they are stated.
    factor : float
        What is read over what is there; -1 of a sensor that was turned over, 1 of points that were exchanged.
    """

    kind: Literal["exchanged", "turned", "scaled"]
    configuration: tuple[str, ...]
    node: tuple[int, ...]
    log_odds: float
    factor: float


@dataclass(frozen=True, kw_only=True)
class ContactAmplitude:
    """How far a mode shears the contact at a force level, by the model's shape at the measured motion.

    Attributes
    ----------
    configuration : str
        The level.
    mode : int
        Its number there, from 1.
    frequency : float
        Measured, Hz.
    motion : float
        Displacement amplitude at the driving point, m.
    strain, largest_strain : float
        Shear strain amplitude of the contact: mean over its energy, and of the sixteenth that is sheared most.
    slip : float
        How far faces move against each other at the largest strain, m, elastic part included.
    softening, loss : float
        By which share slip makes the contact softer, and its loss factor, both means over its energy, with the first
        explanation that is left; 0 where slip is not in it.
    """

    configuration: str
    mode: int
    frequency: float
    motion: float
    strain: float
    largest_strain: float
    slip: float
    softening: float
    loss: float
