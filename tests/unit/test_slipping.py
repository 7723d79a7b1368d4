"""Contact that slips, in the residual of a diagnosis: limits, derivatives, and beside the mode over its amplitude."""

import numpy as np
import pytest

import model
from model.effects.contact_slip import STRAIN
from updating.diagnosis.slipping import N_SHARE, slip_effect, slipped, strain_shares

STACK = model.Stack(
    name="stack",
    length=0.3,
    width=0.08,
    height=0.06,
    n_lamina=12,
    material=model.Material(young=200e9, poisson=0.28, density=7650.0),
    contact=model.Contact(pressure=320e3, G_f=800.0, d_f=1e-11, normal_modulus=1e9),
    mesh=model.Mesh(n_x=6, n_y=2),
)
EFFECT = model.catalogue()["contact_slip"]
HELD = np.array([0.95, 0.6])
SHARES = np.outer([1.0, 3.0], np.geomspace(1e-7, 1e-5, N_SHARE))


def test_without_slip_a_mode_stays_as_it_is():
    found = slipped(EFFECT, {"slip_softening": 0.0, "slip_exponent": -0.5}, SHARES, HELD)
    np.testing.assert_array_equal(found.root, 1.0)
    np.testing.assert_array_equal(found.added, 0.0)
    assert np.all(found.root_slope[:, 0] < 0.0)  # which shows that it would be seen


def test_derivatives_are_those_of_the_values():
    at = {"slip_softening": 0.2, "slip_exponent": -0.4}
    found = slipped(EFFECT, at, SHARES, HELD)
    for i, name in enumerate(at):
        near = slipped(EFFECT, {**at, name: at[name] + 1e-5}, SHARES, HELD)
        np.testing.assert_allclose((near.root - found.root) / 1e-5, found.root_slope[:, i], rtol=2e-3)
        np.testing.assert_allclose((near.added - found.added) / 1e-5, found.added_slope[:, i], rtol=2e-3)
        before, slope = found.damping(np.array([0.01, 0.02]))
        after = near.damping(np.array([0.01, 0.02]))[0]
        np.testing.assert_allclose((after - before) / 1e-5, slope[:, i], rtol=2e-3)


def test_the_stated_softening_is_that_at_the_stated_strain():
    softening, loss = EFFECT.over_strain({"slip_softening": 0.15, "slip_exponent": -0.3}, np.array([STRAIN]))
    assert softening == pytest.approx(0.15)
    assert 0.0 < loss < softening


def test_only_an_effect_with_a_law_over_strain_follows_amplitude():
    effects = model.catalogue()
    assert slip_effect(effects).name == "contact_slip"
    assert slip_effect({"micro_slip": effects["micro_slip"]}) is None


@pytest.mark.parametrize("mode", [0, 1])
def test_a_mode_is_nearly_that_of_its_backbone(mode):
    system = model.reduce(STACK, n_snapshot=1)
    contact, strain = STACK.contact, model.contact_strain(system)
    law = model.SlipLaw(friction=0.3, exponent=-0.5)
    given = {"mode": mode, "G_f": contact.G_f, "d_f": contact.d_f}
    along = model.backbone(system, strain, law, amplitude=np.append(0.0, np.geomspace(1e-8, 1e-5, 12)), **given)
    at = int(np.argmax(along.frequency < 0.96 * along.frequency[0]))
    assert at > 0
    point = model.Observation(node=[1], location=[[0.1, 0.02, 0.03]], direction=[[0.0, 0.0, 1.0]])
    linear = model.solve_modes(system, G_f=contact.G_f, d_f=contact.d_f, observation=point, by=("G_f",)).elastic()
    held = 2 * contact.G_f * linear.frequency_gradient[mode] / linear.frequency[mode]
    shares = along.amplitude[at] * strain_shares(strain, linear.coordinate[:, mode])[None]
    softening = float(law.softening(np.array([STRAIN / law.sliding_strain(contact.G_f)]))[0])
    found = slipped(EFFECT, {"slip_softening": softening, "slip_exponent": -0.5}, shares, held)
    assert found.root[0] == pytest.approx(along.frequency[at] / along.frequency[0], rel=1.5e-3)
    expected = along.damping[at] - along.damping[0]
    assert found.added[0] == pytest.approx(expected, rel=0.05)
