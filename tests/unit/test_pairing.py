"""Pairing by MAC."""

from types import SimpleNamespace

import numpy as np
import pytest

from updating.errors import PairingError
from updating.pairing import pair


def modes(shape, frequency=None):
    n_dof, n_mode = shape.shape
    return SimpleNamespace(
        frequency=np.arange(1.0, n_mode + 1) if frequency is None else frequency,
        damping=np.full(n_mode, 0.01),
        shape=shape,
        node=np.arange(n_dof),
        direction=np.tile([0.0, 0.0, 1.0], (n_dof, 1)),
    )


@pytest.fixture
def shape():
    return np.random.default_rng(4).standard_normal((30, 5))


def test_pairs_follow_shapes_not_order(shape):
    found = pair(modes(shape[:, [3, 0, 4]]), modes(shape))
    assert found.model.tolist() == [3, 0, 4]
    assert found.measured.tolist() == [0, 1, 2]
    assert found.unpaired_model.tolist() == [1, 2]
    np.testing.assert_allclose(found.paired_mac, 1.0)


def test_scale_phase_and_sign_do_not_matter(shape):
    found = pair(modes(shape * [-2.0, 1j, 3.0, 1e-6, 1.0]), modes(shape))
    np.testing.assert_allclose(found.paired_mac, 1.0)


def test_a_stranger_stays_unpaired(shape):
    stranger = np.random.default_rng(5).standard_normal((30, 1))
    found = pair(modes(np.hstack([shape[:, :2], stranger])), modes(shape))
    assert found.unpaired_measured.tolist() == [2]
    assert found.measured.tolist() == [0, 1]


def test_one_model_mode_is_never_given_twice(shape):
    near = shape[:, [0]] + 0.05 * shape[:, [1]]
    found = pair(modes(np.hstack([shape[:, [0]], near])), modes(shape))
    assert found.measured.size == np.unique(found.model).size == 1


def test_a_weak_pair_does_not_displace_a_strong_one():
    a, b, c = np.eye(3)
    measured = modes(np.column_stack([a, a + 0.9 * b]))
    model = modes(np.column_stack([a, c]))
    assert pair(measured, model, threshold=0.8).measured.tolist() == [0]


def test_different_points_are_refused(shape):
    with pytest.raises(PairingError, match="30 measured, 20 in the model"):
        pair(modes(shape), modes(shape[:20]))


def test_different_directions_are_refused(shape):
    other = modes(shape)
    other.direction = np.tile([1.0, 0.0, 0.0], (30, 1))
    with pytest.raises(PairingError, match="directions differ at points"):
        pair(modes(shape), other)
