"""Shapes that lean towards other modes: as much as small masses make them, or more."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg as la
from scipy.stats import kstest
from updating.diagnosis.mixing import Mixing, p_value

N_DOF, N_MODE, NOISE = 44, 7, 2e-4
FREQUENCY = np.array([240.0, 256.0, 305.0, 522.0, 540.0, 926.0, 970.0])
RNG = np.random.default_rng(8)
MODELLED = RNG.normal(size=(N_DOF, N_MODE)) + 0.5
MODELLED /= np.linalg.norm(MODELLED, axis=0)


def symmetric(rng, size):
    added = rng.normal(size=(N_MODE, N_MODE)) * size
    return (added + added.T) / np.sqrt(2.0)


def played(rng, mass, stiffness=0.0, form=0.0, small=5e-4, stiff=1e-9, noise=NOISE):
    """Modes of a stack of unit modal masses with further ones and stiffnesses of that size, measured with noise."""
    _, turned = la.eigh(
        np.diag(FREQUENCY**2) + symmetric(rng, stiffness) * np.outer(FREQUENCY, FREQUENCY),
        np.eye(N_MODE) + symmetric(rng, mass),
    )
    turned *= np.sign(np.diag(turned))
    measured = MODELLED @ turned
    measured /= np.linalg.norm(measured, axis=0)
    return Mixing(
        measured=measured + noise * rng.normal(size=measured.shape),
        modelled=MODELLED,
        frequency=FREQUENCY,
        length=np.ones(N_MODE),
        form=np.full(N_MODE, form),
        mass=small,
        stiffness=stiff,
    )


@pytest.mark.parametrize(
    ("mass", "stiffness", "noise"),
    [(1e-9, 1e-9, NOISE), (5e-4, 1e-9, NOISE), (5e-4, 2e-4, NOISE), (5e-4, 2e-4, 1e-7)],
)
def test_probabilities_are_uniform_where_both_are_as_small_as_said(mass, stiffness, noise):
    rng = np.random.default_rng(1)
    scatter = {"small": mass, "stiff": stiffness, "noise": noise}
    found = [p_value([played(rng, mass, stiffness, **scatter) for _ in range(2)]) for _ in range(300)]
    assert kstest(found, "uniform").pvalue > 0.01


def test_masses_that_are_four_times_larger_are_seen():
    rng = np.random.default_rng(2)
    assert np.median([p_value([played(rng, 2e-3)]) for _ in range(50)]) < 1e-3


def test_what_the_form_of_an_effect_may_be_off_by_is_not_missed():
    rng = np.random.default_rng(3)
    assert np.median([p_value([played(rng, 2e-3, form=0.05)]) for _ in range(50)]) > 0.5


def test_few_sensors_or_one_mode_say_nothing():
    own = played(np.random.default_rng(4), 1e-2)
    few = replace(own, measured=own.measured[:8], modelled=own.modelled[:8])
    one = replace(
        own,
        measured=own.measured[:, :1],
        modelled=own.modelled[:, :1],
        frequency=FREQUENCY[:1],
        form=own.form[:1],
    )
    assert p_value([few, one]) == 1.0


def test_modes_of_one_frequency_and_shapes_that_sensors_cannot_part_say_nothing_of_each_other():
    own = played(np.random.default_rng(5), 5e-4)
    twins = replace(own, frequency=np.where(np.arange(N_MODE) == 1, FREQUENCY[0], FREQUENCY))
    alike = MODELLED.copy()
    alike[:, 3] = alike[:, 0]
    same = replace(own, modelled=alike, measured=own.measured + alike - MODELLED)
    assert p_value([twins]) > 1e-3
    assert p_value([same]) > 1e-3


def test_a_measured_mode_may_lean_towards_an_unmeasured_one_beside_it_but_not_far_from_it():
    own = played(np.random.default_rng(6), 5e-4)
    other = RNG.normal(size=(N_DOF, 1)) / np.sqrt(N_DOF)
    leaning = replace(own, measured=own.measured + 0.1 * other * (np.arange(N_MODE) == 0))

    def beside(distance):
        frequency = np.append(FREQUENCY, FREQUENCY[0] * (1.0 + distance))
        modelled = np.hstack([MODELLED, other])
        return replace(leaning, modelled=modelled, frequency=frequency, length=np.ones(N_MODE + 1))

    assert p_value([beside(0.01)]) > 0.05
    assert p_value([beside(2.0)]) < 1e-3


def test_shapes_that_sensors_cannot_part_say_nothing_of_each_other():
    """What parts them is smaller than what a model is right to; its direction is chance."""
    own = played(np.random.default_rng(5), 1e-9)
    twins = [
        np.hstack([MODELLED, MODELLED[:, :1] + 3e-4 * np.random.default_rng(seed).normal(size=(N_DOF, 1))])
        for seed in (6, 7)
    ]
    known = {"frequency": np.append(FREQUENCY, 1200.0), "length": np.ones(N_MODE + 1)}
    off = replace(own, measured=own.measured + 0.7 * (twins[0] - twins[1])[:, -1:])
    one, other = (replace(off, modelled=modelled, **known).misfit()[0] for modelled in twins)
    assert one == pytest.approx(other, rel=0.1)
