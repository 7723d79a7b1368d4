"""The answer of a diagnosis: everything that is written, printed and drawn of it."""

from __future__ import annotations

import builtins
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from lamella_shared import Shown
from model import Effect, Stack
from updating.correlation.rig_check import RigCheck
from updating.fitting.fit import ModelFit, ParameterEstimate
from updating.inference.decide import Unlisted

VISIBLE = 3.0
"""Change of the data, in standard deviations, that an effect must be able to cause to be visible."""
POINT_SHOWS = 5.0
"""Logarithm of the odds, the number of points counted, from which a change at one point is named."""
POINT_EXPLAINS = 0.5
"""Share of what an explanation leaves beyond its degrees of freedom that a change at one point must explain to be
reported: what only looks a little like one sends people to look in the wrong place."""
EXCLUDED = 5.0
"""Distance, in standard deviations, from which an effect of usual strength is excluded: more than 3, for it is to
first order."""
MIXED_UP = 10.0
"""Logarithm of the odds, all that is tried counted, from which points of a measurement are taken to be mixed up."""
FAR = 3.0
"""Standard deviations of its prior from which a nuisance is reported as pulled from it."""


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


Verdict = Literal["nothing missing", "identified", "one of", "partly explained", "unlike anything"]


Telling = Literal["frequency", "damping"]


@dataclass(frozen=True, kw_only=True)
class Ranked:
    """One explanation in the ranking.

    Attributes
    ----------
    effects : tuple of str
        Which; none is the base model.
    explained : float
        Share of the misfit that it explains: of the squared logarithms of measured over modelled frequencies and
        damping ratios and of what shapes differ by, each over the discrepancy that the best explanation leaves.
    log_odds : float
        Logarithm of the posterior odds against the base model.
    probability : float
        Posterior probability among all that were fitted.
    parameter : tuple of ParameterEstimate
        Its parameters; of a hypothesis about the measurement, what was stated wrongly and by how much.
    frequency_error, damping_error : float
        Mean relative errors over all modes, the deviations of G_f and d_f of each configuration as they are fitted.
    left_out_error, left_out_damping_error : float
        The same where each mode is predicted from all others, to first order; NaN where none can be, or where an
        explanation is far behind.
    left_out_configuration_error, left_out_configuration_damping_error : float
        Of frequencies and damping ratios where each configuration is predicted from the others.
    misfit : float
        Sum of its squared differences from the data, over their variances of noise and discrepancy.
    n_residual : int
        Number of these differences.
    discrepancy : Sizes
        What it leaves beside the noise: of a frequency and of a damping ratio.
    nuisance : mapping of str to float
        What all fits may move, as it was fitted with this explanation: logarithms of ratios to what the stack file
        states, or m, by the names that `Moved` has.
    modelled : mapping of str to (n,) float
        Natural frequencies of the elastic modes of its model, Hz, by state, to somewhat above the band.
    pulled : tuple of Pulled
        What is known of the stack or of the measurement and would have to be far off.
    """

    effects: tuple[str, ...]
    explained: float
    log_odds: float
    probability: float
    parameter: tuple[ParameterEstimate, ...]
    frequency_error: float
    damping_error: float
    left_out_error: float
    left_out_damping_error: float
    left_out_configuration_error: float
    left_out_configuration_damping_error: float
    misfit: float
    n_residual: int
    discrepancy: Sizes
    nuisance: Mapping[str, float] = field(default_factory=dict)
    modelled: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    pulled: tuple[Pulled, ...] = ()

    def error(self, kind: Telling) -> float:
        """Return the mean relative error of frequencies or of damping ratios."""
        return self.frequency_error if kind == "frequency" else self.damping_error

    def left_out(self, kind: Telling) -> float:
        """Return the same where each mode is predicted from all others."""
        return self.left_out_error if kind == "frequency" else self.left_out_damping_error


def telling(base: Ranked, explanation: Ranked) -> Telling:
    """Return which errors tell what an explanation is worth: those of damping ratios, where frequencies hardly gain."""
    gain = 0.8  # frequency error over that of the base model, above which frequencies hardly gain
    if explanation.frequency_error <= gain * base.frequency_error or not np.isfinite(explanation.damping_error):
        return "frequency"
    gains = explanation.damping_error * base.frequency_error < explanation.frequency_error * base.damping_error
    return "damping" if gains and explanation.damping_error < base.damping_error else "frequency"


def overstated_in(explanation: Ranked, effects: Mapping[str, Effect]) -> dict[str, str]:
    """Return what an explanation has of effects that say no more than that a file states too much, and their labels."""
    value = {p.name: p for p in explanation.parameter}
    labels = {}
    for effect in (effects[name] for name in explanation.effects if name in effects and effects[name].overstated):
        neutral, estimate = effect.parameters[0].neutral, value[effect.parameters[0].name]
        if estimate.upper < neutral or (estimate.at_bound and estimate.value < neutral):
            labels[effect.name] = effect.overstated
    return labels


def confounded_in(names: Collection[str], effects: Mapping[str, Effect]) -> dict[str, str]:
    """Return what a stack file may state wrongly that does the same as one of some effects, by the effect."""
    return {name: effect.stated for name, effect in effects.items() if name in names and effect.stated}


@dataclass(frozen=True, kw_only=True)
class ModeError:
    """A measured mode and how far the model's frequency is from it.

    Attributes
    ----------
    configuration : str
        Of the campaign.
    mode : int
        Its number there, from 1.
    frequency, std : float
        Measured, with its standard deviation, Hz.
    base, explained : float
        Relative error of the model's frequency without effects and with the first candidate; NaN without one.
    """

    configuration: str
    mode: int
    frequency: float
    std: float
    base: float
    explained: float


@dataclass(frozen=True, kw_only=True)
class Pulled:
    """A nuisance that is pulled from its prior by the answer.

    Attributes
    ----------
    name : str
        As `Evidence.nuisances` has it.
    value, std : float
        How far it is off, and the standard deviation of what is known: of a ratio's logarithm, or m.
    """

    name: str
    value: float
    std: float


@dataclass(frozen=True, eq=False, kw_only=True)
class Diagnosis(Shown):
    """The answer.

    Attributes
    ----------
    stack : Stack or None
        The model's stack, as its file states it, with the instruments of the test; None of matrices.
    verdict : str
        "nothing missing", "identified", "one of", "partly explained" or "unlike anything".
    set : tuple of tuple of str
        The explanations that the data cannot tell apart; one where identified, none where nothing is missing.
    labels : mapping of str to str
        What a person calls each effect and hypothesis.
    measurement : tuple of str
        Those of them that are about the measurement, or about what files state of it.
    confounded : mapping of str to str
        Effects of the first of the set that no vibration test tells from a wrong statement in the stack file, and of
        what.
    explained : float
        Share of the misfit that the first of the set explains.
    steps : tuple of Ranked
        From the base model to the first of the set, one effect at a time.
    discrepancy, discrepancy_spread : Sizes
        What the first of the set, or the base model, leaves beside the noise; standard deviations of the logarithms.
    too_large : tuple of str
        Kinds of data in which that is more than a right model leaves.
    mixed_up : tuple of MixedUp
        Points of the measurement that were mixed up, and were corrected.
    pulled : tuple of Pulled
        Nuisances that are far off with the first of the set, or the base model.
    moved : tuple of Moved
        Every quantity of stack file and measurement that fits may move, with the first of the set, or the base model.
    relieved : tuple of Pulled
        Nuisances that are far off with the base model, but not with the first of the set.
    point_change : PointChange, optional
        What is left looks like this.
    ranking : tuple of Ranked
        All that were fitted in full, the most probable first.
    errors : tuple of ModeError
        The modes that were used.
    n_used : mapping of str to (int, int)
        How many modes of each configuration the answer rests on, and how many were identified.
    signatures : mapping of str to (n,) float
        Relative change of the frequencies of `errors` by the best single effects, each fitted alone.
    ruled_out : tuple of str
        Effects whose usual strength these data exclude beside every explanation that is left.
    not_visible : tuple of str
        Effects that these data would not show even at the end of their plausible range.
    lacking : tuple of str
        Measured modes that the model lacks amid those that it has.
    unseen : tuple of str
        Measured modes that were not compared: the model has modes there that the sensors do not see.
    impossible : mapping of str to str
        Effects that this stack cannot have, and why.
    sensor_gains : tuple of SensorGain
        Of roving accelerometers beside the first, with the first explanation that is left, or the base model.
    next_tests : tuple of NextTest
        Further tests by how well they would tell the candidates apart.
    second_level : float, optional
        By how many standard deviations slip of the usual strength would move frequencies at three times the force;
        None where several levels were tested, or no contact is there.
    contact : tuple of ContactAmplitude
        How far each mode shears the contact at each force level; none where no amplitude was measured.
    rig : tuple of RigCheck
        What contradicts each configuration's measurement about force, scale and sensors.
    sentences : tuple of str
        The answer in plain words.
    unlisted : "instead", "beside", "refused" or None
        Whether something that no effect of the catalogue describes explains the data nearly as well as what is named,
        is clearly more probable beside it than nothing, or is more probable than any effect that could be named.
    models : mapping of str to tuple of ModelFit
        Of matrices by configuration the base model and, where something was identified, the model with that; a stack's
        are solved anew.
    """

    stack: Stack | None
    verdict: Verdict
    set: tuple[tuple[str, ...], ...]
    labels: Mapping[str, str]
    measurement: tuple[str, ...]
    confounded: Mapping[str, str]
    explained: float
    steps: tuple[Ranked, ...]
    discrepancy: Sizes
    discrepancy_spread: Sizes
    too_large: tuple[str, ...]
    mixed_up: tuple[MixedUp, ...]
    pulled: tuple[Pulled, ...]
    moved: tuple[Moved, ...]
    relieved: tuple[Pulled, ...]
    point_change: PointChange | None
    ranking: tuple[Ranked, ...]
    errors: tuple[ModeError, ...]
    n_used: Mapping[str, tuple[int, int]]
    signatures: Mapping[str, tuple[float, ...]]
    ruled_out: tuple[str, ...]
    not_visible: tuple[str, ...]
    lacking: tuple[str, ...]
    unseen: tuple[str, ...]
    impossible: Mapping[str, str]
    sensor_gains: tuple[SensorGain, ...]
    next_tests: tuple[NextTest, ...]
    second_level: float | None
    contact: tuple[ContactAmplitude, ...]
    rig: tuple[RigCheck, ...]
    sentences: tuple[str, ...]
    unlisted: Unlisted | None = None
    models: Mapping[str, tuple[ModelFit, ...]] = field(default_factory=dict)

    def has(self, effects: Sequence[str]) -> bool:
        """Tell whether some effects together were fitted."""
        return any(builtins.set(explanation.effects) == builtins.set(effects) for explanation in self.ranking)

    def shown(self, most: int) -> tuple[Ranked, ...]:
        """Return the most probable explanations, and in any case those of the answer and the base model."""
        answer = [builtins.set(effects) for effects in (*self.set, ())]
        return tuple(
            explanation
            for i, explanation in enumerate(self.ranking)
            if i < most or builtins.set(explanation.effects) in answer
        )

    def ranked(self, effects: Sequence[str]) -> Ranked:
        """Return an explanation by its effects, in any order.

        Raises
        ------
        KeyError
            It was not fitted.
        """
        for explanation in self.ranking:
            if builtins.set(explanation.effects) == builtins.set(effects):
                return explanation
        raise KeyError(effects)
