"""The evidence of an explanation against plain numerical integration, where that can be done."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import logsumexp

from updating.diagnosis.discrepancy import MEDIAN, Sizes, log_density, log_together
from updating.diagnosis.explanation import RANGE_PRECISION, TRUST, weights
from updating.diagnosis.marginal import Linearized, marginal

NOISE = 1e-4
Z95 = 1.96


def problem(value, column, kind="frequency", prior_std=None, *, trust=1e-9):
    """A linear problem of one coordinate; its prior is flat over a range of 1 where none is given."""
    n = len(value)
    kinds = np.full(n, kind) if isinstance(kind, str) else kind
    column = np.asarray(column, dtype=float).reshape(n, -1)
    m = column.shape[1]
    flat = prior_std is None
    return Linearized(
        value=np.asarray(value) / NOISE,
        jacobian=column / NOISE,
        kind=kinds,
        growth=np.full(n, NOISE**-2.0),
        prior_value=np.zeros(m),
        prior_precision=np.zeros(m) if flat else np.full(m, prior_std**-2.0),
        trust=np.full(m, trust),
        unseen=np.full(m, RANGE_PRECISION if flat else 0.0),
        free=np.ones(m, dtype=bool),
    )


def integrated(value, column, kind, prior_std):
    """Return the logarithm of the evidence, less what depends on the noise alone, on a fine grid of both."""
    logs = np.linspace(np.log(1.0 / 300.0), np.log(300.0), 801)
    size = MEDIAN[kind] * np.exp(logs)
    best = -(column @ value) / (column @ column)
    x = best + np.linspace(-0.5, 0.5, 4001) * (1.0 if kind == "damping" else 0.1)
    variance = NOISE**2 + size**2
    left = np.sum((value[:, None] + np.outer(column, x)) ** 2, axis=0)  # measured less modelled
    log = -0.5 * (left / variance[:, None] + len(value) * np.log(variance / NOISE**2)[:, None])
    if prior_std is not None:
        log = log - 0.5 * (x / prior_std) ** 2 - np.log(prior_std * np.sqrt(2.0 * np.pi))
    log += log_density(kind, size)[:, None]
    return logsumexp(log) + np.log((logs[1] - logs[0]) * (x[1] - x[0]))


@pytest.mark.parametrize("prior_std", [0.02, None])
@pytest.mark.parametrize(
    ("kind", "n", "size"), [("frequency", 12, 2e-3), ("damping", 25, 0.3), ("shape", 300, 0.013)]
)
def test_it_is_the_integral_over_parameter_and_size(kind, n, size, prior_std):
    rng = np.random.default_rng(n)
    column = rng.normal(size=n)
    value = size * rng.normal(size=n) + 0.01 * column
    found = marginal(problem(value, column, kind, prior_std))
    assert found.log_evidence == pytest.approx(integrated(value, column, kind, prior_std), abs=0.05)


def test_it_does_not_depend_on_where_a_size_falls():
    """Many data know their size to some per cent: a grid that is coarser than that gives and takes tens."""
    value = np.random.default_rng(2).normal(size=400)
    none = np.zeros(400)
    scaled = [marginal(problem(s * value, none, "shape", 1.0)).log_evidence for s in (1e-2, 1.4e-2, 2e-2)]
    density = log_density("shape", np.array([1e-2, 1.4e-2, 2e-2]))
    expected = -400.0 * np.log([1.0, 1.4, 2.0]) + density - density[0]
    assert np.array(scaled) - scaled[0] == pytest.approx(expected, abs=0.1)


@pytest.mark.parametrize("true", [2e-3, 8e-3, 2e-2])
def test_size_is_recovered_with_its_spread(true):
    found = []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        own = marginal(problem(true * rng.normal(size=30), rng.normal(size=30), prior_std=1.0))
        found.append((np.log(own.mean.frequency / true), own.spread.frequency))
    off, spread = np.array(found).T
    assert abs(np.mean(off)) < 0.1
    assert np.std(off) == pytest.approx(np.mean(spread), rel=0.35)


def test_without_data_of_a_kind_its_prior_is_left():
    found = marginal(problem(np.zeros(3), np.ones(3), "frequency", 1.0))
    assert found.mean.shape == pytest.approx(MEDIAN["shape"], rel=0.05)
    assert found.spread.shape == pytest.approx(np.log(5.0) / 1.645, rel=0.1)


def test_a_stated_size_is_taken_as_stated():
    rng = np.random.default_rng(4)
    value, column = 0.02 * rng.normal(size=40), rng.normal(size=40)
    own = problem(value, column, prior_std=0.1)
    stated = Sizes(frequency=1e-3, damping=0.7, shape=0.3)
    found = marginal(own, stated, ("frequency",))
    assert [found.likeliest.frequency, found.mean.frequency] == pytest.approx([1e-3, 1e-3])
    assert found.spread.frequency == 0.0
    assert found.mean.damping == pytest.approx(MEDIAN["damping"], rel=0.05)
    variance = NOISE**2 + 1e-6
    precision = column @ column / variance + 100.0
    best = -(column @ value) / variance / precision
    left = np.sum((value + column * best) ** 2) / variance + 100.0 * best**2
    expected = -0.5 * (left + 40 * np.log(variance / NOISE**2) + np.log(precision) - np.log(100.0))
    assert found.log_evidence == pytest.approx(expected, abs=1e-2)
    assert found.covariance[0, 0] == pytest.approx(1.0 / precision, rel=1e-6)


@pytest.mark.parametrize(
    "near", [None, (Sizes(frequency=0.2), Sizes(frequency=0.02, damping=0.2, shape=0.01))]
)
def test_sizes_far_beyond_the_usual_are_integrated_over_as_well(near):
    """A model that is far off leaves a tenth and more of frequencies; the size of one kind then sways the other's."""
    rng, prior_std = np.random.default_rng(6), 0.3
    kind = np.repeat(["frequency", "shape"], [16, 300])
    column = np.concatenate([np.ones(16), 0.3 * rng.normal(size=300)])
    value = np.repeat([0.25, 0.15], [16, 300]) * rng.normal(size=316) + 0.2 * column
    found = marginal(problem(value, column, kind, prior_std), near=near)
    logs = [np.linspace(np.log(size) - 1.5, np.log(size) + 1.5, 301) for size in (0.25, 0.15)]
    variance = [NOISE**2 + np.exp(2.0 * own) for own in logs]
    parts = [(value[kind == own], column[kind == own]) for own in ("frequency", "shape")]
    precision, slope, constant = prior_std**-2.0, 0.0, 2.0 * np.log(prior_std)
    for axis, (own, (y, c)) in enumerate(zip(variance, parts, strict=True)):
        over = np.expand_dims(own, 1 - axis)
        precision, slope = precision + c @ c / over, slope + c @ y / over
        constant = constant + y @ y / over + y.size * np.log(over / NOISE**2)
    log = -0.5 * (constant - slope**2 / precision + np.log(precision))
    log += log_density("frequency", np.exp(logs[0]))[:, None] + log_density("shape", np.exp(logs[1]))
    size = np.exp(
        np.stack(np.meshgrid(logs[0], np.full(1, np.log(MEDIAN["damping"])), logs[1], indexing="ij"), axis=-1)
    )
    log += log_together(size)[:, 0]
    expected = logsumexp(log) + sum(np.log(own[1] - own[0]) for own in logs)
    assert found.log_evidence == pytest.approx(expected, abs=0.02)
    assert found.mean.frequency == pytest.approx(0.25, rel=0.5)


def test_what_the_data_do_not_show_leaves_the_evidence_as_it_is():
    value = 1e-3 * np.random.default_rng(5).normal(size=20)
    one = problem(value, np.ones(20), prior_std=0.1)
    two = replace(
        one,
        jacobian=np.hstack([one.jacobian, np.zeros((20, 1))]),
        prior_value=np.zeros(2),
        prior_precision=np.append(one.prior_precision, 0.0),
        trust=np.full(2, 1e-9),
        unseen=np.append(one.unseen, RANGE_PRECISION),
        free=np.ones(2, dtype=bool),
    )
    assert marginal(two).log_evidence == pytest.approx(marginal(one).log_evidence, abs=1e-6)


@pytest.mark.parametrize(("step", "kept"), [(1.0, 0.1), (0.3, 0.6), (0.002, 1.0)])
def test_a_far_linear_step_is_not_believed(step, kept):
    """Each lowers the misfit by 20 to first order, which holds near the fit alone."""
    direction = np.random.default_rng(6).normal(size=30)
    direction *= np.sqrt(20.0) * 1e-2 / np.linalg.norm(direction) / step
    value, stated = -step * direction, (Sizes(shape=1e-2), ("shape",))
    own = problem(value, direction, "shape", trust=TRUST)
    near = replace(own, trust=np.full(1, 1e-9))
    nothing = replace(own, free=np.zeros(1, dtype=bool))  # the same volume, and no step
    none, linear, found = (marginal(x, *stated).log_evidence for x in (nothing, near, own))
    assert linear - none == pytest.approx(10.0, rel=1e-2)
    assert (found - none) / (linear - none) == pytest.approx(kept, abs=0.06)


def test_a_coordinate_at_the_end_of_its_range_does_not_move():
    column = np.ones(20)
    value = -0.01 * column
    own = problem(value, column)
    held = replace(own, free=np.zeros(1, dtype=bool))
    still = marginal(problem(value, 0.0 * column)).log_evidence
    assert marginal(own).log_evidence > marginal(held).log_evidence + 10.0
    assert marginal(held).log_evidence < still + 1e-6


def test_intervals_hold_the_truth():
    """95 % intervals of two parameters under a discrepancy of unknown size, correlated as it may be."""
    rng, held = np.random.default_rng(7), []
    for _ in range(200):
        column = rng.normal(size=(14, 2))
        true = 0.05 * rng.normal(size=2)
        data = column @ true + 3e-3 * np.exp(0.5 * rng.normal()) * rng.normal(size=14)
        best = np.linalg.lstsq(column, data, rcond=None)[0]
        own = problem(data - column @ best, -column, prior_std=0.05)
        found = marginal(replace(own, prior_value=-best))
        std = np.sqrt(np.diag(found.covariance))
        held.append(np.abs(best - true) < Z95 * std)
    assert 0.90 <= np.mean(held) <= 0.99


def test_what_is_due_to_noise_alone_is_told_from_what_discrepancies_leave():
    rng = np.random.default_rng(7)
    column = rng.normal(size=20)
    found = marginal(problem(2e-3 * rng.normal(size=20), column, prior_std=1.0))
    assert found.noise_variance == pytest.approx([NOISE**2 / (column @ column)], rel=1e-6)
    assert found.covariance[0, 0] > 100.0 * found.noise_variance[0]


def test_a_fit_is_weighed_by_no_size_that_is_implausible_beside_shapes():
    far, near = Sizes(frequency=0.1, shape=0.03), Sizes(frequency=0.04, shape=0.05)
    assert weights(far, ()).frequency == pytest.approx(0.03)
    assert weights(far, ("frequency",)) == far
    assert weights(near, ()) == near
