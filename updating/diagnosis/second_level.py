"""What a second force level would show of contact that slips, where a test has one level alone."""

from __future__ import annotations

import numpy as np

from model.effects.contact_slip import EFFECT, STRAIN
from updating.diagnosis.evidence import Evidence, solved
from updating.diagnosis.explanation import Explanation
from updating.diagnosis.slipping import N_SHARE, slipped

FORCE = 3.0
"""Force of the second level over that of the first."""
_DRIFT = 2e-4  # of a frequency, by which tests on one day differ


def second_level(evidence: Evidence, own: Explanation) -> float | None:
    """Return by how many standard deviations usual slip would move frequencies at three times the force.

    What the amplitude of a test at one level is, nobody knows: the first is taken to shear the contact by the strain at
    which the effect's strength is stated. Slip grows with the amplitude and thus somewhat less than with the force; a
    frequency that is measured twice differs by noise and drift.

    Parameters
    ----------
    evidence : Evidence
        Measurement and model.
    own : Explanation
        What the stack is taken to be.

    Returns
    -------
    float or None
        None where several levels are there, or no contact.
    """
    if not evidence.touching or any(tested.strain is not None for tested in evidence.tested):
        return None
    values = {p.name: p.nominal for p in EFFECT.parameters}
    moved, first = [], 0
    for c, (used, tested) in enumerate(zip(evidence.used, evidence.tested, strict=True)):
        theta = evidence.theta(own.nuisance, c)
        modes = solved(evidence, c, {**theta, **own.effect_values}, ("G_f",))
        column = own.residual.partner[first : first + used.size]
        first += used.size
        held = 2.0 * theta["G_f"] * modes.frequency_gradient[column, 0] / modes.frequency[column]
        root = [
            slipped(EFFECT, values, np.full((used.size, N_SHARE), times * STRAIN), held).root
            for times in (1.0, FORCE)
        ]
        noise = np.hypot(tested.modes.frequency_std[used] / tested.modes.frequency[used], _DRIFT)
        moved.append(np.log(root[1] / root[0]) / (np.sqrt(2.0) * noise))
    return float(np.linalg.norm(np.concatenate(moved)))
