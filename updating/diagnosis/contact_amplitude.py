"""How far each mode of each force level shears the contact, through the model's shape at the measured motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from updating.diagnosis.evidence import Evidence
from updating.diagnosis.explanation import Explanation
from updating.diagnosis.slipping import slip_effect


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


def contact_amplitudes(evidence: Evidence, own: Explanation) -> tuple[ContactAmplitude, ...]:
    """Return the amplitudes of the contact, level by level; none where no amplitude was measured.

    Parameters
    ----------
    evidence : Evidence
        Measurement and model.
    own : Explanation
        Whose slip it is, if it has any.
    """
    effect = slip_effect(evidence.effects)
    named = effect is not None and effect.name in own.effects
    found = []
    for c, r in evidence.modes:
        tested = evidence.tested[c]
        if tested.strain is None or tested.motion is None:
            continue
        strain = tested.strain[r]
        softening, loss = (
            effect.over_strain(own.effect_values, strain)
            if named and effect is not None and effect.over_strain is not None
            else np.zeros((2, 1))
        )
        found.append(
            ContactAmplitude(
                configuration=tested.name,
                mode=r + 1,
                frequency=float(tested.modes.frequency[r]),
                motion=float(tested.motion[r]),
                strain=float(np.mean(strain)),
                largest_strain=float(strain[-1]),
                slip=float(strain[-1] * np.mean(evidence.stack.spacing)),
                softening=float(np.mean(softening)),
                loss=float(np.mean(loss)),
            )
        )
    return tuple(found)
