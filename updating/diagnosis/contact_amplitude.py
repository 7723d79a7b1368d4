"""How far each mode of each force level shears the contact, through the model's shape at the measured motion."""

from __future__ import annotations

import numpy as np

from updating.diagnosis.answer_parts import ContactAmplitude
from updating.diagnosis.coordinates import scaled
from updating.diagnosis.stack_model import StackModel
from updating.inference.explain import Explanation


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
