"""Slip in the contact over the amplitude: what the force levels of a test show of it, and what a second level would."""

from __future__ import annotations

import numpy as np

from model.effects.contact_slip import EFFECT, STRAIN
from updating.diagnosis.answer import ContactAmplitude
from updating.diagnosis.fit_settings import scaled
from updating.diagnosis.slipping import N_SHARE, slipped
from updating.diagnosis.stack_model import StackModel
from updating.inference.explain import Explanation

FORCE = 3.0
"""Force of the second level over that of the first."""


def second_level(model: StackModel, explanation: Explanation) -> float | None:
    """Return by how many standard deviations usual slip would move frequencies at three times the force.

    The amplitude of a test at one level is unknown: the first is taken to shear the contact by the strain at which the
    effect's strength is stated. Slip grows with the amplitude, and thus somewhat less than with the force. A frequency
    that is measured twice differs by noise and drift.

    Parameters
    ----------
    model : StackModel
        Measurement and model.
    explanation : Explanation
        The fit that stands for the stack.

    Returns
    -------
    float or None
        None where several levels are there, or no contact.
    """
    drift = 2e-4  # of a frequency, by which tests on one day differ
    if not model.touching or any(tested.strain is not None for tested in model.tested):
        return None
    values = {p.name: p.nominal for p in EFFECT.parameters}
    local, moved = model.about(explanation.coordinates, [explanation.x]), []
    contact = [c.name for c in explanation.coordinates].index("G_f")
    for c, (state, errors) in enumerate(zip(model.states, explanation.errors, strict=True)):
        modal = local.modal(explanation.x, c)
        stiffness = modal.stiffness[modal.moves.tolist().index(contact)]  # what the contact holds
        held = np.einsum("ri,ij,rj->r", errors.weight, stiffness, errors.weight) / errors.eigenvalue
        root = [
            slipped(EFFECT, values, np.full((held.size, N_SHARE), times * STRAIN), held).root for times in (1.0, FORCE)
        ]
        noise = np.hypot(state.frequency_std / state.frequency, drift)
        moved.append(np.log(root[1] / root[0]) / (np.sqrt(2.0) * noise))
    return float(np.linalg.norm(np.concatenate(moved)))


def contact_amplitudes(model: StackModel, explanation: Explanation) -> tuple[ContactAmplitude, ...]:
    """Return the amplitudes of the contact, level by level; none where no amplitude was measured.

    Parameters
    ----------
    model : StackModel
        Measurement and model.
    explanation : Explanation
        Whose slip it is, if it has any.
    """
    effect, amplitudes = model.slip, []
    values = {}
    if effect is not None and effect.name in explanation.terms:
        values = {p.name: scaled(p, explanation.value(p.name))[0] for p in effect.parameters}
    for tested in model.tested:
        if tested.strain is None or tested.motion is None:
            continue
        for r, strain in enumerate(tested.strain):
            softening, loss = (
                effect.over_strain(values, strain)
                if values and effect is not None and effect.over_strain is not None
                else np.zeros((2, 1))
            )
            amplitudes.append(
                ContactAmplitude(
                    configuration=tested.name,
                    mode=r + 1,
                    frequency=float(tested.modes.frequency[r]),
                    motion=float(tested.motion[r]),
                    strain=float(np.mean(strain)),
                    largest_strain=float(strain[-1]),
                    slip=float(strain[-1] * np.mean(model.stack.spacing)),
                    softening=float(np.mean(softening)),
                    loss=float(np.mean(loss)),
                )
            )
    return tuple(amplitudes)
