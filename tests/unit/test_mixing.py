"""Shapes that lean towards other modes: as much as small masses make them, or more."""

import numpy as np
import pytest
import scipy.linalg as la
from scipy.stats import kstest

from updating.mixing import Mixing, p_value

N_DOF, N_MODE, NOISE = 44, 7, 2e-4
FREQUENCY = np.array([240.0, 256.0, 305.0, 522.0, 540.0, 926.0, 970.0])
RNG = np.random.default_rng(8)
MODELLED = RNG.normal(size=(N_DOF, N_MODE)) + 0.5
MODELLED /= np.linalg.norm(MODELLED, axis=0)


def played(rng, mass, form=0.0, small=5e-4):
    """Modes of a stack of unit modal masses with further ones of that size, measured with noise."""
    added = rng.normal(size=(N_MODE, N_MODE)) * mass
    _, turned = la.eigh(np.diag(FREQUENCY**2), np.eye(N_MODE) + (added + added.T) / np.sqrt(2.0))
    turned *= np.sign(np.diag(turned))
    measured = MODELLED @ turned
    measured /= np.linalg.norm(measured, axis=0)
    return Mixing(
        measured=measured + NOISE * rng.normal(size=measured.shape),
        modelled=MODELLED,
        frequency=FREQUENCY,
        form=np.full(N_MODE, form),
        small=small,
    )


@pytest.mark.parametrize(("mass", "small"), [(0.0, 1e-9), (5e-4, 5e-4)])
def test_probabilities_are_uniform_where_masses_are_as_small_as_said(mass, small):
    rng = np.random.default_rng(1)
    found = [p_value([played(rng, mass, small=small), played(rng, mass, small=small)]) for _ in range(300)]
    assert kstest(found, "uniform").pvalue > 0.01


def test_masses_that_are_four_times_larger_are_seen():
    rng = np.random.default_rng(2)
    assert np.median([p_value([played(rng, 2e-3)]) for _ in range(50)]) < 1e-3


def test_what_the_form_of_an_effect_may_be_off_by_is_not_missed():
    rng = np.random.default_rng(3)
    assert np.median([p_value([played(rng, 2e-3, form=0.05)]) for _ in range(50)]) > 0.5


def test_few_sensors_or_one_mode_say_nothing():
    own = played(np.random.default_rng(4), 1e-2)
    few = Mixing(
        measured=own.measured[:8], modelled=own.modelled[:8], frequency=FREQUENCY, form=own.form, small=5e-4
    )
    one = Mixing(
        measured=own.measured[:, :1],
        modelled=own.modelled[:, :1],
        frequency=FREQUENCY[:1],
        form=own.form[:1],
        small=5e-4,
    )
    assert p_value([few, one]) == 1.0
