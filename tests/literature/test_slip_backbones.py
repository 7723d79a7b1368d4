"""Slip laws beside published measurements of structures whose joints slip."""

import numpy as np
import pytest

from model.contact.contact import SlipLaw

AMPLITUDE = np.geomspace(1e-3, 1e3, 4000)


def backbone(law, held):
    """Frequency over that of a sticking joint, and damping ratio, of a mode of which the joint holds a share."""
    left = 1.0 - held * law.softening(AMPLITUDE)
    return np.sqrt(left), held * law.loss(AMPLITUDE) / (2.0 * left)


def test_a_friction_damped_beam_from_stick_to_slide():
    """M. Scheel, T. Weigele, M. Krack, J. Sound Vib. 485, 2020: a beam with a dry contact that all slides at once.

    From full stick to mainly sliding its frequency falls by 36 %, and its damping ratio reaches 15 %. The fall alone
    tells the share that the contact holds, and with it how large the damping gets.
    """
    held = 1.0 - (1.0 - 0.36) ** 2
    frequency, damping = backbone(SlipLaw(friction=0.3, exponent=-0.5, spike=1e6), held)
    assert frequency[-1] == pytest.approx(1.0 - 0.36, abs=0.01)
    assert damping.max() == pytest.approx(0.15, abs=0.02)
    # a joint that slips little by little would lose less at its worst
    assert backbone(SlipLaw(friction=0.3, exponent=-0.5), held)[1].max() < damping.max() - 0.02


@pytest.mark.parametrize("exponent", [-0.9, -0.5, -0.1])
def test_loss_of_a_cycle_grows_with_a_power_between_two_and_three(exponent):
    """D. J. Segalman, J. Appl. Mech. 72, 2005: measured lap joints lose energy with such powers of the force."""
    law, x = SlipLaw(friction=0.3, exponent=exponent), np.array([1e-4, 2e-4])
    lost, stress = law.loss(x) * x**2, law.stress(x)
    power = np.log(lost[1] / lost[0]) / np.log(stress[1] / stress[0])
    assert 2.0 < power < 3.3
