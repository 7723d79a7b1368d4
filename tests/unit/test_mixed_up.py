"""Points of a measurement that were mixed up are found and put right; clean data stay as they are."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from updating.diagnosis.discrepancy import Discrepancy, MeasuredShape, Mixing, Sizes, mixing_of, shape_block
from updating.diagnosis.mixed_up import put_right

N_DOF, N_MODE, NAMES = 16, 4, ("M1", "M2")
FREQUENCY = np.array([240.0, 312.0, 520.0, 930.0])
NODE = np.arange(101, 101 + N_DOF)
STD, SIZE = 2e-3, 0.02
PLACE = np.linspace(0.0, np.pi, N_DOF)
MODELLED = np.column_stack([np.cos((k + 2) * PLACE) for k in range(N_MODE)])
MODELLED /= np.linalg.norm(MODELLED, axis=0)


@dataclass(frozen=True)
class Modes:
    shape: Any
    shape_std: Any


@dataclass(frozen=True)
class Configuration:
    name: str
    modes: Modes


@dataclass(frozen=True)
class Fake:
    """What is read of an `Evidence`, of shapes alone."""

    tested: Any
    used: Any
    observed: Any
    sensor: Any
    rows: Any
    covariance: Discrepancy
    sizes: Sizes


def shapes(seed):
    """Return the shapes of both configurations as a model that is nearly right is met by them."""
    rng = np.random.default_rng(seed)
    found = []
    common = rng.normal(size=(N_DOF, N_MODE))
    for _ in NAMES:
        own = np.sqrt(0.9) * common + np.sqrt(0.1) * rng.normal(size=common.shape)
        lean = [mixing_of(m, FREQUENCY, MODELLED) for m in range(N_MODE)]
        leaning = np.column_stack(
            [SIZE / n * (mixing.root @ own[:, m]) for m, (mixing, n) in enumerate(lean)]
        )
        found.append(MODELLED + leaning + STD * rng.normal(size=own.shape))
    return found


def evidence_of(measured, nodes=(NODE, NODE)):
    rows = {
        (c, r): N_DOF * (N_MODE * c + r) + np.arange(N_DOF)
        for c in range(len(measured))
        for r in range(N_MODE)
    }
    block = shape_block(
        [
            MeasuredShape(
                row=rows[c, r],
                mode=r,
                shape=own[:, r] / np.linalg.norm(own[:, r]),
                std=np.full(N_DOF, STD),
                slope=np.zeros((N_DOF, 1)),
                mixing=Mixing.over(*mixing_of(r, FREQUENCY, MODELLED)),
            )
            for c, own in enumerate(measured)
            for r in range(N_MODE)
        ]
    )
    return Fake(
        tested=tuple(
            Configuration(
                name, Modes(own.astype(complex), np.full(own.shape, STD) * (1.0 + np.arange(N_DOF))[:, None])
            )
            for name, own in zip(NAMES, measured, strict=True)
        ),
        used=(np.arange(N_MODE),) * len(measured),
        observed=tuple(SimpleNamespace(node=own) for own in nodes),
        sensor=(np.arange(N_DOF) % 2,) * len(measured),
        rows=SimpleNamespace(shape=rows, kind=np.full(N_DOF * N_MODE * len(measured), "shape")),
        covariance=Discrepancy(blocks=(block,)),
        sizes=Sizes(shape=SIZE),
    )


def residual_of(evidence):
    """Return what separates measured from modelled shapes, whitened."""
    off = np.concatenate(
        [
            (own.modes.shape.real / np.linalg.norm(own.modes.shape, axis=0) - MODELLED).T.ravel()
            for own in evidence.tested
        ]
    )
    weight = 1.0 / np.sqrt(1.0 + evidence.sizes.shape**2 * evidence.covariance.growth)
    return SimpleNamespace(value=weight * evidence.covariance.rotated(off))


def corrected(evidence):
    return put_right(evidence, residual_of(evidence))


@pytest.mark.parametrize("seed", range(5))
def test_clean_data_stay_as_they_are(seed):
    evidence = evidence_of(shapes(seed))
    found, mixed_up = corrected(evidence)
    assert mixed_up is None
    assert found is evidence


@pytest.mark.parametrize(("where", "names"), [((1,), ("M2",)), ((0, 1), NAMES)])
@pytest.mark.parametrize("seed", range(3))
def test_two_points_that_were_exchanged_are_put_right(seed, where, names):
    right = shapes(seed)
    wrong = [own.copy() for own in right]
    for c in where:
        wrong[c][[3, 8]] = wrong[c][[8, 3]]
    found, mixed_up = corrected(evidence_of(wrong))
    assert (mixed_up.kind, mixed_up.configuration, mixed_up.node) == ("exchanged", names, (104, 109))
    assert mixed_up.log_odds > 10.0
    for c, own in enumerate(found.tested):
        np.testing.assert_array_equal(own.modes.shape.real, right[c])
        swapped = c in where
        assert (own.modes.shape_std[3, 0] == 9.0 * STD) == swapped  # scatter goes with its value
        assert found.sensor[c][3] == (0 if swapped else 1)


@pytest.mark.parametrize("where", [(0,), (0, 1)])
def test_a_sensor_that_was_turned_over_is_put_right(where):
    right = shapes(7)
    wrong = [own.copy() for own in right]
    for c in where:
        wrong[c][5] *= -1.0
    found, mixed_up = corrected(evidence_of(wrong))
    assert (mixed_up.kind, mixed_up.node) == ("turned", (106,))
    assert mixed_up.configuration == tuple(NAMES[c] for c in where)
    for own, expected in zip(found.tested, right, strict=True):
        np.testing.assert_array_equal(own.modes.shape.real, expected)


@pytest.mark.parametrize("factor", [2.0, 0.5, 1.2])
@pytest.mark.parametrize("where", [(0,), (0, 1)])
def test_a_sensor_that_reads_by_a_factor_too_much_is_put_right(where, factor):
    right = shapes(7)
    wrong = [own.copy() for own in right]
    for c in where:
        wrong[c][5] *= factor
    found, mixed_up = corrected(evidence_of(wrong))
    assert (mixed_up.kind, mixed_up.node) == ("scaled", (106,))
    assert mixed_up.configuration == tuple(NAMES[c] for c in where)
    assert mixed_up.factor == pytest.approx(factor, rel=0.05)
    for own, expected in zip(found.tested, right, strict=True):
        np.testing.assert_allclose(own.modes.shape.real[5], expected[5], rtol=0.05)


def test_points_that_differ_between_configurations_are_mixed_up_in_one_alone():
    wrong = shapes(8)
    for own in wrong:
        own[5] *= -1.0
    mixed_up = corrected(evidence_of(wrong, (NODE, NODE + 1)))[1]
    assert len(mixed_up.configuration) == 1


@pytest.mark.parametrize("seed", range(4))
def test_what_is_promised_is_what_the_misfit_falls_by(seed):
    """To the letter, for the whole covariance counts: of the components with each other and of all shapes."""
    wrong = shapes(seed)
    if seed % 2:
        wrong[0][[3, 8]] = wrong[0][[8, 3]]
    else:
        wrong[0][5] *= -1.0
    evidence = evidence_of(wrong)
    found, mixed_up = corrected(evidence)
    before, after = (np.sum(residual_of(own).value ** 2) for own in (evidence, found))
    tried = 3 * (N_DOF * (N_DOF + 3) // 2)
    assert mixed_up.log_odds == pytest.approx(0.5 * (before - after) - np.log(tried), rel=1e-6)
