"""Solutions with a matrix shifted to an eigenvalue, where it is singular."""

import numpy as np

from model.solvers.eigen import inverse_iterated, orthogonal_answers


def test_a_singular_matrix_gives_its_vector():
    matrix, right = np.diag([0.0, 1e9, 2e9]), np.array([1.0, 1e-3, 0.0])
    np.testing.assert_allclose(inverse_iterated(matrix, right), [1.0, 0.0, 0.0], atol=1e-12)


def test_answers_beside_a_mode_are_those_of_all_other_modes():
    rng = np.random.default_rng(0)
    vectors = np.linalg.qr(rng.standard_normal((6, 6)))[0]
    values = np.array([1e5, 2e5, 3e5, 5e5, 8e5, 1e9])
    matrix = (vectors * (values - values[2])) @ vectors.T
    load = rng.standard_normal((6, 2))
    others = [0, 1, 3, 4, 5]
    expected = (vectors[:, others] / (values[others] - values[2])) @ (vectors[:, others].T @ load)
    np.testing.assert_allclose(
        orthogonal_answers(matrix, vectors[:, 2], load), expected, rtol=1e-6, atol=1e-9 * abs(expected).max()
    )
