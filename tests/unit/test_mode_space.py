"""What of a shape difference is taken out or counts less, for masses that every stack carries may have brought it."""

from types import SimpleNamespace

import numpy as np
import pytest
from updating.diagnosis.mixing import leaning

from updating.diagnosis.evidence import DiagnosisScatter
from updating.diagnosis.mode_space import ModeSpace

N_DOF, SIGMA = 44, 2e-4
RNG = np.random.default_rng(3)
FREQUENCY = np.array([240.0, 305.0, 312.0, 522.0, 926.0, 0.0, 0.0])  # the second and third are within 5 %
SHAPE = RNG.normal(size=(N_DOF, FREQUENCY.size)) * np.linspace(0.5, 2.0, FREQUENCY.size)
SPACE = ModeSpace(shape=SHAPE, frequency=FREQUENCY, mass=5e-4, stiffness=2e-4)


def test_its_own_scale_and_how_close_modes_mix_are_taken_out():
    kept = SPACE.apart(1, SIGMA)
    for mode, left in ((1, 0.0), (2, 0.0), (4, None)):
        length = np.linalg.norm(kept(SHAPE[:, mode]))
        assert length == pytest.approx(0.0, abs=1e-9) if left == 0.0 else length > 1e-3


def test_what_small_masses_turn_scatters_no_more_than_the_sensors():
    """Differences as noise and small masses make them, the rigid-body motion included, are white after it."""
    rng, mode = np.random.default_rng(4), 3
    others = np.flatnonzero(np.abs(FREQUENCY / FREQUENCY[mode] - 1.0) > 0.05)
    turn = np.hypot(*leaning(FREQUENCY[others], FREQUENCY[mode], SPACE.mass, SPACE.stiffness))
    along = SHAPE[:, others] * turn / np.linalg.norm(SHAPE[:, mode])
    drawn = SIGMA * rng.normal(size=(N_DOF, 4000)) + along @ rng.normal(size=(others.size, 4000))
    white = SPACE.apart(mode, SIGMA)(drawn) / SIGMA
    assert np.sum(drawn**2) / SIGMA**2 / 4000 > 2.0 * N_DOF
    values = np.linalg.eigvalsh(white @ white.T / 4000)
    assert values[0] == pytest.approx(0.0, abs=1e-9)
    np.testing.assert_allclose(values[1:], 1.0, atol=0.25)


def test_mixing_is_sought_along_the_lowest_modes_that_the_sensors_see():
    unseen = SHAPE * np.where(np.arange(FREQUENCY.size) == 6, 1e-6, 1.0)
    space = ModeSpace(shape=unseen, frequency=FREQUENCY, mass=5e-4, stiffness=2e-4)
    column = np.array([0, 2])
    own = SHAPE[:, column] / np.linalg.norm(SHAPE[:, column], axis=0)
    found = space.mixing(own, own, column, np.zeros(2))
    assert found.frequency.tolist() == [240.0, 312.0, 0.0, 305.0, 522.0, 926.0]
    np.testing.assert_allclose(found.length, np.linalg.norm(SHAPE[:, [0, 2, 5, 1, 3, 4]], axis=0))
    few = ModeSpace(shape=SHAPE[:8], frequency=FREQUENCY, mass=5e-4, stiffness=2e-4)
    assert few.mixing(own[:8], own[:8], column, np.zeros(2)).frequency.tolist() == [240.0, 312.0, 0.0, 0.0]


def test_what_a_suspension_makes_elastic_is_no_rigid_body_motion_any_more():
    rows = RNG.normal(size=(N_DOF, 10))
    coordinate = np.zeros((10, 2))
    coordinate[2, 0], coordinate[8, 1] = 0.99, 1.0
    modes = SimpleNamespace(shape=rows @ coordinate, frequency=np.array([12.0, 240.0]), coordinate=coordinate)
    found = ModeSpace.of(modes, SimpleNamespace(reduced_rows=rows), DiagnosisScatter())
    assert found.frequency.tolist() == [12.0, 240.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    np.testing.assert_allclose(np.linalg.matrix_rank(found.shape), 7)
    others = np.delete(rows[:, :6], 2, axis=1)
    assert np.linalg.matrix_rank(np.hstack([found.shape[:, 2:], others])) == 5
