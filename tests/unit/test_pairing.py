"""Pairing by MAC."""

from types import SimpleNamespace

import numpy as np
import pytest

from updating.correlation.pairing import pair
from updating.errors import PairingError


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


def turned(shape, degrees):
    """Two shapes mixed by a rotation in the plane that they span."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return shape @ np.array([[c, -s], [s, c]])


@pytest.fixture
def orthonormal(shape):
    return np.linalg.qr(shape)[0]


def test_close_modes_mixed_differently_pair_as_a_subspace(orthonormal):
    mixed = orthonormal.copy()
    mixed[:, 1:3] = turned(orthonormal[:, 1:3], 45.0)
    frequency = np.array([100.0, 200.0, 201.0, 300.0, 400.0])
    found = pair(modes(orthonormal, frequency), modes(mixed, frequency))
    assert found.measured.tolist() == found.model.tolist() == [0, 1, 2, 3, 4]
    assert found.subspace[1] == found.subspace[2]
    assert np.unique(found.subspace).size == 4
    np.testing.assert_allclose(found.subspace_mac, 1.0)
    np.testing.assert_allclose(found.paired_mac[1:3], 0.5)


def test_mixed_modes_far_apart_do_not_pair(orthonormal):
    mixed = orthonormal.copy()
    mixed[:, 1:3] = turned(orthonormal[:, 1:3], 45.0)
    frequency = np.array([100.0, 200.0, 250.0, 300.0, 400.0])
    assert pair(modes(orthonormal, frequency), modes(mixed, frequency)).measured.tolist() == [0, 3, 4]


def test_one_mode_measured_twice_does_not_take_two_close_modes(orthonormal):
    """Both lie in the plane of the close modes, but together they do not span it."""
    frequency = np.array([100.0, 200.0, 201.0, 300.0, 400.0])
    twice = turned(orthonormal[:, 1:3], 30.0)[:, [0, 0]] + 0.01 * orthonormal[:, 3:]
    found = pair(modes(twice, np.array([200.0, 260.0])), modes(orthonormal, frequency), threshold=0.8)
    assert found.measured.size == 0


def test_a_mode_with_its_own_partner_is_not_displaced_by_a_cluster(orthonormal):
    """All span the plane of the two close measured modes, one column is a perfect alias of the second."""
    model = np.column_stack([orthonormal[:, 0], orthonormal[:, 1], orthonormal[:, 1], orthonormal[:, 2]])
    stranger = 0.95 * orthonormal[:, 0] + 0.4 * orthonormal[:, 3]
    measured = modes(np.column_stack([orthonormal[:, :2], stranger]), np.array([200.0, 202.0, 300.0]))
    found = pair(measured, modes(model, np.array([210.0, 230.0, 900.0, 950.0])))
    assert dict(zip(found.measured.tolist(), found.model.tolist(), strict=True)) == {0: 0, 1: 1}


def test_frequency_decides_between_shapes_that_look_alike(orthonormal):
    """A common frequency error of 30 % is no reason to take the alias."""
    model = np.column_stack([orthonormal[:, [0, 1, 2]], orthonormal[:, 0] + 0.02 * orthonormal[:, 3]])
    frequency = np.array([100.0, 150.0, 220.0, 290.0])
    noisy = orthonormal[:, :3] + 0.02 * orthonormal[:, [3, 4, 4]]  # nearer to the alias in MAC
    found = pair(modes(noisy, frequency[:3] / 1.3), modes(model, frequency))
    assert found.mac[0, 3] > found.mac[0, 0]
    assert found.model.tolist() == [0, 1, 2]


def test_damping_decides_where_frequency_cannot(orthonormal):
    model = modes(np.column_stack([orthonormal[:, :2], orthonormal[:, 1]]), np.array([100.0, 200.0, 200.0]))
    model.damping = np.array([0.01, 0.05, 0.01])
    measured = modes(orthonormal[:, :2], np.array([100.0, 200.0]))
    measured.damping = np.array([0.01, 0.05])
    assert pair(measured, model).model.tolist() == [0, 1]
    measured.damping = np.array([0.01, 0.01])
    assert pair(measured, model).model.tolist() == [0, 2]


def test_frequency_does_not_overrule_shape(orthonormal):
    other = orthonormal[:, 0] + 0.4 * orthonormal[:, 1]  # MAC 0.86 with the first
    model = modes(np.column_stack([orthonormal[:, 0], other]), np.array([150.0, 100.0]))
    assert pair(modes(orthonormal[:, [0]], np.array([100.0])), model).model.tolist() == [0]


def test_a_mode_that_does_not_move_the_points_finds_no_partner(orthonormal):
    model = modes(orthonormal * [1.0, 1e-12, 1.0, 1.0, 1.0])
    assert pair(modes(orthonormal), model).unpaired_measured.tolist() == [1]


def test_a_frequency_error_that_all_modes_share_does_not_count(orthonormal):
    """The model is softer throughout; the alias happens to lie near the measured frequency."""
    model = np.column_stack([orthonormal[:, :3], orthonormal[:, 0]])
    frequency = np.array([60.0, 120.0, 180.0, 98.0])
    found = pair(modes(orthonormal[:, :3], np.array([100.0, 200.0, 300.0])), modes(model, frequency))
    assert found.model.tolist() == [0, 1, 2]


def test_cross_orthogonality_tells_apart_what_the_mac_confuses(orthonormal):
    """The alias has the measured frequency and a MAC of 0.96, but in the model's mass it is another mode."""
    alias = orthonormal[:, 0] + 0.2 * orthonormal[:, 3]
    model = modes(np.column_stack([orthonormal[:, :2], alias]), np.array([160.0, 200.0, 100.0]))
    found = pair(modes(orthonormal[:, :2], np.array([100.0, 200.0])), model)
    assert found.mac[0, 2] > 0.95
    assert found.model.tolist() == [0, 1]
