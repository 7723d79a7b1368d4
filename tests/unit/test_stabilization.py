"""Clusters over model orders.

Roots from those of a neighbouring polynomial are those of the companion matrix, or none are given.
"""

from __future__ import annotations

import numpy as np
import pytest

from ema.identification.stabilization import MIN_CHAIN, nearby_roots, stabilization
from ema.types.frf import FRF, Dofs

F = np.arange(0.5, 1000.0, 0.5)


def frf(frequency: list[float], damping: list[float], noise: float, n: int = 8, seed: int = 0) -> FRF:
    rng = np.random.default_rng(seed)
    pole = 2 * np.pi * np.array(frequency) * (-np.array(damping) + 1j)
    residue = rng.standard_normal((n, pole.size)) / pole.imag / 2j
    s = 2j * np.pi * F
    value = s**2 * (residue @ (1 / (s - pole[:, None])) + residue.conj() @ (1 / (s - pole.conj()[:, None])))
    rms = np.sqrt(np.mean(np.abs(value) ** 2, axis=1, keepdims=True))
    value += noise * rms * (rng.standard_normal(value.shape) + 1j * rng.standard_normal(value.shape)) / np.sqrt(2)
    z = np.tile([0.0, 0.0, 1.0], (n, 1))
    return FRF(
        frequency=F,
        value=value[:, None],
        quantity="accelerance",
        output=Dofs(node=np.arange(n), direction=z),
        input=Dofs(node=[0], direction=z[:1]),
        run=np.zeros(n, dtype=int),
        source=("generated",) * n,
    )


def test_every_mode_has_one_cluster_near_it() -> None:
    diagram = stabilization(frf([120.0, 300.0, 720.0], [0.01, 0.002, 0.005], 0.01), order=40)
    hertz = np.abs(diagram.chosen) / (2 * np.pi)
    for f in (120.0, 300.0, 720.0):
        assert np.count_nonzero(np.abs(hertz / f - 1.0) < 1e-3) == 1


def test_close_modes_stay_two_clusters() -> None:
    diagram = stabilization(frf([400.0, 401.2], [0.002, 0.002], 0.01), order=40)
    hertz = np.abs(diagram.chosen) / (2 * np.pi)
    assert np.sum(np.abs(hertz - 400.0) < 0.1) == 1
    assert np.sum(np.abs(hertz - 401.2) < 0.1) == 1


def test_a_cluster_has_at_most_one_pole_of_each_order_and_is_long() -> None:
    diagram = stabilization(frf([120.0, 300.0], [0.01, 0.002], 0.05), order=40)
    for k in range(diagram.chosen.size):
        orders = diagram.order[diagram.cluster == k]
        assert np.unique(orders).size == orders.size >= MIN_CHAIN
    assert np.all(diagram.pole.real < 0.0)
    np.testing.assert_array_equal(diagram.stable, diagram.cluster >= 0)


def test_more_inputs_than_outputs_are_taken_as_references_of_the_shorter_side() -> None:
    tall = frf([120.0, 300.0], [0.01, 0.002], 0.01)
    wide = FRF(
        frequency=F,
        value=tall.value.swapaxes(0, 1),
        quantity="accelerance",
        output=tall.input,
        input=tall.output,
        run=[0],
        source=("generated",),
    )
    np.testing.assert_allclose(stabilization(wide, order=20).chosen, stabilization(tall, order=20).chosen)


def test_few_lines_get_an_order_that_they_bear() -> None:
    few = frf([300.0], [0.01], 0.001).band(290.0, 310.0)
    assert few.frequency.size == 41
    diagram = stabilization(few)
    assert diagram.order.max() <= 13
    assert np.any(np.abs(np.abs(diagram.chosen) / (2 * np.pi) - 300.0) < 0.1)


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
