"""Inverse iteration at an eigenvalue that is met exactly."""

import numpy as np

from model.eigen import inverse_iterated


def test_a_singular_matrix_gives_its_vector():
    matrix, right = np.diag([0.0, 1e9, 2e9]), np.array([1.0, 1e-3, 0.0])
    np.testing.assert_allclose(inverse_iterated(matrix, right), [1.0, 0.0, 0.0], atol=1e-12)
