"""Matrices of low rank in ranges that they share, against the same in full."""

import weakref

import numpy as np
import pytest

from model.reduction.reduced_equations import InRange, full, in_ranges, n_row, summed

N = 90


@pytest.fixture
def matrices():
    """Three of one range of 12 directions that begin after the sixth row, one in full, and one of another range."""
    rng = np.random.default_rng(3)
    root = np.zeros((N, 12))
    root[6:] = rng.normal(size=(N - 6, 12))
    cores = [rng.normal(size=(k, k)) for k in (6, 12, 3)]
    shared = [root[:, : len(c)] @ (c + c.T) @ root[:, : len(c)].T for c in cores]
    other = rng.normal(size=(N, 35))
    whole = rng.normal(size=(N, N))
    return [*shared, whole @ whole.T, other @ other.T]


def test_matrices_in_ranges_are_the_same_in_full(matrices):
    for one, found in zip(matrices, in_ranges(matrices), strict=True):
        np.testing.assert_allclose(full(found), one, atol=1e-11 * np.abs(one).max())
        assert n_row(found) == N


def test_those_that_overlap_share_a_range_and_full_ones_stay(matrices):
    first, second, third, whole, other = in_ranges(matrices)
    assert first.range is second.range is third.range
    assert first.range.shape == (N, 12)
    assert whole is matrices[3]
    assert isinstance(other, InRange)
    assert other.range.shape == (N, 35)


def test_matrices_come_one_by_one_and_go_with_the_range_that_they_share():
    """All in full at once would be most of what a model takes while it is built."""
    rng = np.random.default_rng(6)
    roots = np.linalg.qr(rng.normal(size=(N, 80)))[0].reshape(N, 4, 20)
    made_before = []

    class Watched(np.ndarray):
        pass

    def made():
        for root in roots.transpose(1, 0, 2):
            matrix = (root @ root.T).view(Watched)
            made_before.append(weakref.ref(matrix))
            yield matrix
            assert alive() <= 3

    def alive():
        return sum(one() is not None for one in made_before)

    assert len(in_ranges(made())) == 4
    assert alive() == 0


def test_what_a_matrix_does_not_feel_stays_exactly_zero(matrices):
    """Rounding there, times a large stiffness, would move rigid-body motion."""
    rng = np.random.default_rng(4)
    felt = rng.normal(size=(N, 4))
    found = in_ranges([felt @ felt.T, *matrices])[2]
    assert isinstance(found, InRange)
    assert not full(found)[:6].any()


def test_directions_that_hardly_differ_spoil_no_matrix():
    """What they differ by is mostly rounding: taken for a direction of its own it lies along the others."""
    rng = np.random.default_rng(5)
    root = np.linalg.qr(rng.normal(size=(N, 12)))[0]
    near = [root + 10.0**-k * rng.normal(size=root.shape) for k in (4, 6, 8, 10, 12)]
    matrices = [one @ one.T for one in (root, *near)]
    for one, found in zip(matrices, in_ranges(matrices), strict=True):
        np.testing.assert_allclose(full(found), one, atol=1e-11)


def test_a_sum_of_both_kinds_is_that_of_the_full_ones(matrices):
    factors = [2.0, -0.5, 3.0, 1.0, 0.25]
    expected = sum(f * one for f, one in zip(factors, matrices, strict=True))
    found = summed(N, zip(factors, in_ranges(matrices), strict=True))
    np.testing.assert_allclose(found, expected, atol=1e-11 * np.abs(expected).max())


def test_a_matrix_of_zeros_has_no_directions():
    (found,) = in_ranges([np.zeros((N, N))])
    assert not full(found).any()
