"""What an explanation says of modes and configurations that it has not seen, against fits without them."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.linalg as la
from scipy.stats import multivariate_normal

from updating.diagnosis.discrepancy import Discrepancy, Sizes, alike, block_of
from updating.diagnosis.held_out import mispredicted
from updating.diagnosis.residual import Residual

N_MODE, N_CONFIGURATION, N_DOF = 4, 3, 3
SIZES = Sizes(frequency=2e-3, damping=0.05, shape=0.02)
PRIOR_STD = 0.5


def problem(seed=5, n_coordinate=3, column=None):
    """Three configurations of four modes: rows, covariances, and what a linear fit with one prior leaves."""
    rng = np.random.default_rng(seed)
    kind, mode, configuration = [], [], []
    for c in range(N_CONFIGURATION):
        for name, n in (("frequency", 1), ("damping", 1), ("shape", N_DOF)):
            kind += [name] * (n * N_MODE)
            mode += np.repeat(np.arange(N_MODE), n).tolist()
        configuration += [c] * (len(kind) - len(configuration))
    kind, mode, configuration = np.array(kind), np.array(mode), np.array(configuration)
    n = kind.size
    blocks, noise, form = [], np.zeros((n, n)), np.zeros((n, n))

    def add(rows, own_noise, own_form):
        blocks.append(block_of(rows, own_noise, own_form))
        noise[np.ix_(rows, rows)], form[np.ix_(rows, rows)] = own_noise, own_form

    shape = np.flatnonzero(kind == "shape")
    root, shared = rng.normal(size=(shape.size, 6)), 0.02 * rng.normal(size=(shape.size, 4))
    add(shape, 1e-4 * np.eye(shape.size) + shared @ shared.T, root @ root.T)
    for name in ("frequency", "damping"):
        for m in range(N_MODE):
            rows = np.flatnonzero((kind == name) & (mode == m))
            add(rows, np.diag(rng.uniform(0.5, 2.0, rows.size) * 1e-6), alike(rows.size))
    discrepancy = Discrepancy(blocks=tuple(blocks))
    covariance = noise + np.diag(SIZES.of(kind)) @ form @ np.diag(SIZES.of(kind))
    jacobian = rng.normal(size=(n, n_coordinate)) * np.where(kind == "frequency", 0.01, 0.1)[:, None]
    if column is not None:
        jacobian = np.column_stack([jacobian, column(kind, mode, configuration)])
    data = jacobian @ rng.normal(size=jacobian.shape[1]) * 0.3
    data += np.linalg.cholesky(covariance) @ rng.normal(size=n)
    prior = np.zeros((1, jacobian.shape[1]))
    prior[0, 0] = -1.0 / PRIOR_STD
    weight = 1.0 / np.sqrt(1.0 + SIZES.of(kind) ** 2 * discrepancy.growth)
    white = np.vstack([weight[:, None] * discrepancy.rotated(-jacobian), prior])
    target = np.append(weight * discrepancy.rotated(data), 0.0)
    best = np.linalg.lstsq(-white, target, rcond=None)[0]
    first = np.flatnonzero(kind == "frequency")
    found = Residual(
        value=target + white @ best,
        jacobian=white,
        kind=np.append(kind, "prior"),
        rotated=np.zeros(n),
        rotated_jacobian=np.zeros((n, 0)),
        log_frequency=np.zeros(first.size),
        log_damping=np.zeros(first.size),
        partner=np.zeros(first.size, dtype=int),
    )
    row = {
        (c, m): np.flatnonzero((kind == "shape") & (mode == m) & (configuration == c))
        for c in range(N_CONFIGURATION)
        for m in range(N_MODE)
    }
    rows = SimpleNamespace(kind=kind, mode=mode, configuration=configuration, shape=row)
    along = {key: rng.normal(size=N_DOF) for key in row}
    unit_shapes = {key: own / np.linalg.norm(own) for key, own in along.items()}
    evidence = SimpleNamespace(rows=rows, covariance=discrepancy, sizes=SIZES, unit_shapes=unit_shapes)
    return evidence, found, data, jacobian, covariance


def refitted(evidence, data, jacobian, covariance, by):
    """Return the errors of rows that are left out, predicted by fits to all others, and the densities of each group."""
    group = getattr(evidence.rows, by)
    left, score = np.full(data.size, np.nan), []
    for number in np.unique(group):
        out = group == number
        inside = covariance[np.ix_(~out, ~out)]
        weighted = la.solve(inside, jacobian[~out], assume_a="pos")
        gram = weighted.T @ jacobian[~out]
        gram[0, 0] += PRIOR_STD**-2.0
        if np.linalg.cond(gram) > 1e12:
            continue
        best = la.solve(gram, weighted.T @ data[~out])
        pull = covariance[np.ix_(out, ~out)] @ la.inv(inside)
        left[out] = data[out] - jacobian[out] @ best - pull @ (data[~out] - jacobian[~out] @ best)
        slope = jacobian[out] - pull @ jacobian[~out]
        spread = covariance[np.ix_(out, out)] - pull @ covariance[np.ix_(~out, out)]
        spread += slope @ la.solve(gram, slope.T)
        score.append(multivariate_normal(cov=spread).logpdf(left[out]))
    return left, score


def mean_error(left):
    return np.nanmean(np.abs(np.expm1(-left)))


@pytest.mark.parametrize("by", ["mode", "configuration"])
@pytest.mark.parametrize("seed", range(3))
def test_it_is_what_fits_to_all_other_data_leave(seed, by):
    evidence, found, *known = problem(seed)
    (left, score), kind = refitted(evidence, *known, by), evidence.rows.kind
    said = mispredicted(evidence, found.value, found.jacobian, by)
    assert said.frequency == pytest.approx(mean_error(left[kind == "frequency"]), rel=1e-6)
    assert said.damping == pytest.approx(mean_error(left[kind == "damping"]), rel=1e-6)
    across = [
        np.linalg.norm(left[row] - along * (along @ left[row]))
        for row, along in ((row, evidence.unit_shapes[key]) for key, row in evidence.rows.shape.items())
    ]
    np.testing.assert_allclose(said.score, score, rtol=1e-6)
    assert said.shape == pytest.approx(np.mean(np.minimum(across, 1.0)), rel=1e-6)


def test_what_correlates_with_a_configuration_helps_to_predict_it():
    """A mode is missed by nearly the same in all configurations: that is known once it was seen."""
    evidence, found, *_ = problem(4)
    by_configuration, by_mode = (
        mispredicted(evidence, found.value, found.jacobian, by) for by in ("configuration", "mode")
    )
    assert by_configuration.frequency < 0.7 * by_mode.frequency


@pytest.mark.parametrize("by", ["mode", "configuration"])
def test_what_other_data_do_not_determine_is_passed_over(by):
    def alone(kind, mode, configuration):
        group = {"mode": mode, "configuration": configuration}[by]
        return ((group == 1) & (kind == "frequency")).astype(float)

    evidence, found, *known = problem(6, column=alone)
    (left, _), kind = refitted(evidence, *known, by), evidence.rows.kind
    passed = getattr(evidence.rows, by) == 1
    assert np.isnan(left[passed]).all()
    assert np.isfinite(left[~passed]).all()
    assert mispredicted(evidence, found.value, found.jacobian, by).frequency == pytest.approx(
        mean_error(left[kind == "frequency"]), rel=1e-6
    )


def test_where_nothing_can_be_predicted_nothing_is_said():
    evidence, found, *_ = problem(7, column=lambda kind, mode, _: np.eye(N_MODE)[mode])
    said = mispredicted(evidence, found.value, found.jacobian)
    assert np.isnan([said.frequency, said.damping, said.shape]).all()


def test_a_prediction_that_fails_altogether_has_an_error_all_the_same():
    def hardly(kind, mode, configuration):
        return np.where(kind == "frequency", np.where(mode == 0, 1.0, 1e-3), 0.0)

    evidence, found, *_ = problem(8, column=hardly)
    far = Residual(**{**vars(found), "value": found.value * 1e5})
    assert 0.3 < mispredicted(evidence, far.value, far.jacobian).frequency < 2.0


def test_rows_that_all_but_coincide_can_be_left_out():
    """A discrepancy far above the noise makes rows of a shape the same to the last digit."""
    evidence, found, *_ = problem(9)
    shapes = evidence.covariance.blocks[0]
    same = np.ones_like(shapes.rotation)
    blocks = (replace(shapes, rotation=same), *evidence.covariance.blocks[1:])
    evidence.covariance = Discrepancy(blocks=blocks)
    assert np.isfinite(mispredicted(evidence, found.value, found.jacobian).frequency)
