"""Roots from those of a neighbouring polynomial are those of the companion matrix, or none are given."""

import numpy as np
import pytest

from ema.identification.stabilization import nearby_roots


def polynomial(n, seed, *, real=True):
    """Ascending coefficients without the leading one, and roots around the unit circle."""
    rng = np.random.default_rng(seed)
    half = (1 + 0.05 * rng.standard_normal(n // 2)) * np.exp(1j * np.pi * rng.uniform(0, 1, n // 2))
    root = np.concatenate([half, half.conj() if real else -half])
    coefficient = np.poly(root)[:0:-1]
    return coefficient.real if real else coefficient, root


@pytest.mark.parametrize("real", [True, False])
@pytest.mark.parametrize("n", [10, 40])
def test_all_roots_are_found_from_those_of_the_order_before(n, real):
    coefficient, root = polynomial(n, 1, real=real)
    moved = root[: n - 2] * (1 + 0.02 * np.random.default_rng(2).standard_normal(n - 2))
    found = nearby_roots(coefficient, moved)
    gap = np.abs(found[:, None] - root)
    assert sorted(gap.argmin(axis=1)) == list(range(n))
    assert gap.min(axis=1).max() < 1e-6


def test_what_does_not_end_is_left_to_others():
    assert nearby_roots(np.full(6, np.nan), np.exp(1j * np.arange(4.0))) is None
    triple = np.poly([0.9, 0.9, 0.9, -0.5])[:0:-1]
    found = nearby_roots(triple, np.array([0.8 + 0.1j, 0.8 - 0.1j, 1.0 + 0.1j]))
    assert found is None or np.abs(np.sort(found.real) - [-0.5, 0.9, 0.9, 0.9]).max() < 1e-3
