"""The law of a contact that slips beside its sliders, one by one, and beside Segalman's formulas."""

import numpy as np
import pytest

from model.contact.contact import SlipLaw

LAWS = [
    SlipLaw(friction=0.2, exponent=-0.5),
    SlipLaw(friction=0.2, exponent=0.0, spike=0.3),
    SlipLaw(friction=0.2, exponent=-0.8, spike=2.0),
]
STRAIN = np.array([1e-3, 0.05, 0.4, 0.99, 1.01, 1.7, 6.0])


def cycle(law, x, n_step=4000, n_slider=2000):
    """Stress over a cycle of strain x cos(angle), from sliders alone, after a first cycle."""
    limit, stiffness = law.sliders(n_slider)
    angle = 2 * np.pi * np.arange(n_step) / n_step
    strain, held, before = x * np.cos(angle), np.zeros(limit.size), 0.0
    stress = np.zeros(n_step)
    for t in range(2 * n_step):
        now = strain[t % n_step]
        held = np.clip(held + now - before, -limit, limit)
        stress[t % n_step], before = stiffness @ held, now
    return angle, stress


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("x", [0.05, 0.4, 1.7])
def test_softening_and_loss_are_the_first_harmonic_of_sliders(law, x):
    angle, stress = cycle(law, x, n_step=800, n_slider=400)
    first = 2 * np.mean(stress * np.exp(-1j * angle)) / x
    np.testing.assert_allclose(law.softening(np.array([x])), 1 - first.real, rtol=5e-3, atol=1e-5)
    np.testing.assert_allclose(law.loss(np.array([x])), first.imag, rtol=1e-2)


@pytest.mark.parametrize("law", LAWS)
def test_stress_is_that_of_the_sliders(law):
    limit, stiffness = law.sliders(4000)
    expected = [stiffness @ np.minimum(limit, x) for x in STRAIN]
    np.testing.assert_allclose(law.stress(STRAIN), expected, rtol=1e-5)
    assert law.stress(np.array([50.0]))[0] == law.strength


def test_the_formulas_are_segalmans():
    """J. Appl. Mech. 72, 2005: F_S, K_T, chi and beta give phi_max (eq. 23), R (eq. 24) and the loss (eq. 28)."""
    friction, G_f, chi, beta = 0.3, 1500.0, -0.4, 0.6
    law = SlipLaw(friction=friction, exponent=chi, spike=beta)
    phi_max = friction * (1 + beta) / (G_f * (beta + (chi + 1) / (chi + 2)))
    R = friction * (chi + 1) / (phi_max ** (chi + 2) * (beta + (chi + 1) / (chi + 2)))
    assert law.sliding_strain(G_f) == pytest.approx(phi_max)
    u = 0.3 * phi_max
    force = G_f * u - R * u ** (chi + 2) / ((chi + 1) * (chi + 2))
    lost = 4 * R * u ** (chi + 3) / ((chi + 3) * (chi + 2))
    assert G_f * phi_max * law.stress(np.array([0.3]))[0] == pytest.approx(force)
    assert np.pi * G_f * u**2 * law.loss(np.array([0.3]))[0] == pytest.approx(lost)


@pytest.mark.parametrize("law", LAWS)
def test_growth_is_the_derivative_of_softening(law):
    step = 1e-5
    ahead, behind = (law.softening(STRAIN * np.exp(s)) for s in (step, -step))
    np.testing.assert_allclose(law.growth(STRAIN), (ahead - behind) / (2 * step), rtol=1e-3, atol=1e-6)


def test_softening_has_no_jump_where_everything_slides():
    for law in LAWS:
        below, above = law.softening(np.array([1 - 1e-7, 1 + 1e-7]))
        assert above == pytest.approx(below, rel=1e-3)


def test_nothing_moves_nothing_lost():
    law = LAWS[0]
    assert law.softening(np.zeros(1)) == law.loss(np.zeros(1)) == 0.0


@pytest.mark.parametrize("wrong", [{"friction": 0.0}, {"exponent": -1.0}, {"spike": -0.1}])
def test_a_law_that_cannot_be_is_refused(wrong):
    with pytest.raises(ValueError, match="friction must be above 0"):
        SlipLaw(**{"friction": 0.1, **wrong})
