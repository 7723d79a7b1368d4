"""The modes that a shape may lean towards: elastic ones, and the rigid-body motion that no elastic one holds."""

from types import SimpleNamespace

import numpy as np
import pytest

from updating.diagnosis.mode_space import ModeSpace

N_DOF, N_BASIS = 44, 10
ROWS = np.random.default_rng(3).normal(size=(N_DOF, N_BASIS))


def space(coordinate, frequency):
    modes = SimpleNamespace(shape=ROWS @ coordinate, frequency=np.array(frequency), coordinate=coordinate)
    return ModeSpace.of(modes, SimpleNamespace(reduced_rows=ROWS), SimpleNamespace(supports=()))


def test_a_free_stack_has_all_six_rigid_body_motions_behind_its_elastic_modes():
    coordinate = np.zeros((N_BASIS, 2))
    coordinate[7, 0], coordinate[8, 1] = 1.0, 1.0
    found = space(coordinate, [240.0, 305.0])
    assert found.frequency.tolist() == [240.0, 305.0, *[0.0] * 6]
    np.testing.assert_allclose(found.shape[:, :2], ROWS[:, [7, 8]])
    rigid = found.shape[:, 2:]
    np.testing.assert_allclose(rigid @ rigid.T, ROWS[:, :6] @ ROWS[:, :6].T, atol=1e-9)  # of unit modal mass


def test_what_a_suspension_makes_elastic_is_no_rigid_body_motion_any_more():
    coordinate = np.zeros((N_BASIS, 2))
    coordinate[2, 0], coordinate[8, 1] = 0.99, 1.0
    found = space(coordinate, [12.0, 240.0])
    assert found.frequency.tolist() == [12.0, 240.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    np.testing.assert_allclose(np.linalg.matrix_rank(found.shape), 7)
    others = np.delete(ROWS[:, :6], 2, axis=1)
    assert np.linalg.matrix_rank(np.hstack([found.shape[:, 2:], others])) == 5


@pytest.mark.parametrize(("share", "n"), [(0.5, 6), (0.9, 5)])
def test_an_elastic_mode_that_holds_less_than_half_of_a_motion_leaves_it(share, n):
    coordinate = np.zeros((N_BASIS, 1))
    coordinate[1, 0], coordinate[8, 0] = np.sqrt(0.9 * share), np.sqrt(1.0 - 0.9 * share)
    assert space(coordinate, [100.0]).shape.shape == (N_DOF, 1 + n)


def test_held_altogether_it_has_none():
    coordinate = np.eye(N_BASIS)[:, :8]
    assert space(coordinate, np.linspace(50.0, 400.0, 8)).frequency.size == 8
