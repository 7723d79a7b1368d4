"""Close modes as subspaces."""

import numpy as np
import pytest

from ema.modal.configurations import clusters
from ema.modal.mac import mac
from updating.correlation.pairing import rotate_onto, span_mac, subspace_mac


@pytest.fixture
def basis():
    return np.linalg.qr(np.random.default_rng(0).standard_normal((12, 4)))[0]


def test_clusters_follow_gaps_in_any_order():
    found = clusters([300.0, 100.0, 102.0, 200.0, 304.0], close=0.03)
    assert [group.tolist() for group in found] == [[1, 2], [3], [0, 4]]


def test_a_single_shape_has_its_mac(basis):
    a, b = basis[:, [0]] + 0.5 * basis[:, [1]], basis[:, [0]]
    np.testing.assert_allclose(subspace_mac(a, b), mac(a, b)[0])
    np.testing.assert_allclose(span_mac(a, b), mac(a, b)[0])


def test_principal_angles_of_planes_with_a_common_line(basis):
    angle = 0.3
    other = np.column_stack([basis[:, 0], np.cos(angle) * basis[:, 1] + np.sin(angle) * basis[:, 2]])
    skew = other @ np.array([[2.0, 1.0], [0.0, 3.0]])  # the same plane in other words
    np.testing.assert_allclose(subspace_mac(basis[:, :2], skew), [1.0, np.cos(angle) ** 2])


def test_complex_shapes(basis):
    turned = basis[:, :2] * np.exp(1j * np.array([0.3, 1.2]))
    np.testing.assert_allclose(subspace_mac(turned, basis[:, :2]), 1.0)


def test_rotation_undoes_a_rotation(basis):
    c, s = np.cos(0.7), np.sin(0.7)
    mixed = basis[:, :2] @ np.array([[c, -s], [s, c]])
    np.testing.assert_allclose(rotate_onto(mixed, 5.0 * basis[:, :2]), basis[:, :2], atol=1e-12)
