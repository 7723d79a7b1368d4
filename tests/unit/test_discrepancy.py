"""What separates a model that is nearly right from a measurement: how sizes, noise and structure come together."""

import numpy as np
import pytest
import scipy.linalg as la

from updating.diagnosis.discrepancy import (
    CLOSEST,
    CORRELATION,
    KINDS,
    MEDIAN,
    Block,
    Discrepancy,
    MeasuredShape,
    Mixing,
    Sizes,
    alike,
    block_of,
    log_density,
    log_together,
    mixing_of,
    shape_block,
)

FREQUENCY = np.array([240.0, 312.0, 520.0, 930.0, 0.0])
N_DOF = 12
SHAPE = np.random.default_rng(1).normal(size=(N_DOF, FREQUENCY.size))


def covariance(rng, n, rank=None):
    root = rng.normal(size=(n, rank or n))
    return root @ root.T + (0.0 if rank else 0.1) * np.eye(n)


@pytest.mark.parametrize("rank", [None, 2, 1])
@pytest.mark.parametrize("seed", range(5))
def test_rotation_makes_noise_white_and_discrepancy_uncorrelated(seed, rank):
    rng = np.random.default_rng(seed)
    noise, form = covariance(rng, 7), covariance(rng, 7, rank)
    block = block_of(np.arange(7), noise, form)
    np.testing.assert_allclose(block.rotation @ noise @ block.rotation.T, np.eye(7), atol=1e-9)
    np.testing.assert_allclose(block.rotation @ form @ block.rotation.T, np.diag(block.growth), atol=1e-8)
    assert np.all(block.growth >= 0.0)
    assert block.log_noise == pytest.approx(np.linalg.slogdet(noise)[1])


def test_likelihood_of_rotated_rows_is_that_of_the_rows_at_any_size():
    rng = np.random.default_rng(3)
    noise, form, value, size = covariance(rng, 6), covariance(rng, 6), rng.normal(size=6), 0.3
    block = block_of(np.arange(6), noise, form)
    whole, variance = noise + size**2 * form, 1.0 + size**2 * block.growth
    assert np.sum((block.rotation @ value) ** 2 / variance) == pytest.approx(value @ la.solve(whole, value))
    assert np.sum(np.log(variance)) + block.log_noise == pytest.approx(np.linalg.slogdet(whole)[1])


def test_rows_stay_where_they_are_whatever_the_order_of_blocks():
    def block(row, factor):
        row = np.array(row)
        return Block(row=row, rotation=factor * np.eye(row.size), growth=factor * row, log_noise=0.0)

    found = Discrepancy(blocks=(block([3, 1], 2.0), block([0, 2], 5.0)))
    np.testing.assert_allclose(found.rotated(np.ones(4)), [5.0, 2.0, 5.0, 2.0])
    np.testing.assert_allclose(found.rotated(np.ones((4, 3)))[:, 1], [5.0, 2.0, 5.0, 2.0])
    np.testing.assert_allclose(found.growth, [0.0, 2.0, 10.0, 6.0])


def test_each_kind_of_row_has_its_own_size_and_priors_have_none():
    kind = np.array(["shape", "frequency", "prior", "damping"])
    np.testing.assert_allclose(Sizes(frequency=1.0, damping=2.0, shape=3.0).of(kind), [3.0, 1.0, 0.0, 2.0])


@pytest.mark.parametrize("kind", KINDS)
def test_prior_of_a_size_is_a_density_and_nine_of_ten_lie_within_a_factor_of_five(kind):
    logs = np.linspace(-6.0, 6.0, 4001)
    density = np.exp(log_density(kind, MEDIAN[kind] * np.exp(logs)))
    within = np.abs(logs) <= np.log(5.0)
    assert np.trapezoid(density, logs) == pytest.approx(1.0, abs=1e-6)
    assert np.trapezoid(density[within], logs[within]) == pytest.approx(0.9, abs=2e-3)


@pytest.mark.parametrize(
    ("frequency", "shape", "plausible"),
    [(0.003, 1e-4, True), (0.019, 1e-3, True), (0.1, 0.1, True), (0.1, 0.03, False), (0.04, 0.004, False)],
)
def test_frequencies_are_not_far_off_where_shapes_are_nearly_right(frequency, shape, plausible):
    found = log_together(np.array([[frequency, 0.1, shape]]))
    assert found.shape == (1,)
    assert found[0] == 0.0 if plausible else found[0] < -5.0


def test_a_shape_leans_as_wrong_stiffness_and_mass_make_it():
    """Fox and Kapoor's formula against modes of matrices that were changed at random."""
    rng, mode, size, n = np.random.default_rng(5), 1, 1e-4, FREQUENCY.size
    drawn = []
    for _ in range(6000):
        stiffness, mass = (np.triu(rng.normal(size=(n, n))) for _ in range(2))
        stiffness, mass = (own + np.triu(own, 1).T for own in (stiffness, mass))
        change = [size / np.sqrt(2.0) * own for own in (stiffness, mass)]
        value, turned = la.eigh(
            np.diag(FREQUENCY**2) + change[0] * np.outer(FREQUENCY, FREQUENCY), np.eye(n) + change[1]
        )
        own = turned[:, int(np.argmin(np.abs(value - FREQUENCY[mode] ** 2)))]
        moved = own / own[mode]
        moved[mode] = 0.0
        drawn.append(SHAPE @ moved / np.linalg.norm(SHAPE[:, mode]))
    expected = np.cov(np.array(drawn).T, bias=True) / size**2
    root = mixing_of(mode, FREQUENCY, SHAPE)[0].root
    np.testing.assert_allclose(root, root.T, atol=1e-12)
    found = root @ root.T
    np.testing.assert_allclose(found, expected, atol=0.06 * np.abs(expected).max())


def test_modes_of_one_frequency_turn_into_each_other_at_a_finite_rate():
    frequency = np.array([240.0, 312.0, 312.0, 930.0])
    shape = SHAPE[:, :4]
    mixing, length = mixing_of(1, frequency, shape)
    root = mixing.root
    assert np.isfinite(root).all()
    other = shape[:, 2] / np.linalg.norm(shape[:, 2])
    lean = np.sqrt(other @ root @ root.T @ other) * np.linalg.norm(shape[:, 1]) / np.linalg.norm(shape[:, 2])
    assert lean == pytest.approx(CLOSEST, rel=1e-3)
    apart = mixing_of(1, np.array([240.0, 312.0, 312.1, 930.0]), shape)
    assert length == pytest.approx(apart[1], rel=1e-3)  # stated without how close a pair is
    assert length < 20.0


@pytest.mark.parametrize(("other", "meets"), [(312.1, True), (318.0, True), (326.0, False)])
def test_modes_within_three_per_cent_of_a_frequency_meet(other, meets):
    assert mixing_of(1, np.array([240.0, 312.0, other, 930.0]), SHAPE[:, :4])[0].meets == meets


def test_a_mode_that_no_sensor_sees_is_met_by_none():
    shape = SHAPE[:, :4].copy()
    shape[:, 2] = 0.0
    assert not mixing_of(1, np.array([240.0, 312.0, 312.1, 930.0]), shape)[0].meets


def measured(row, mode, shape, std, slope=None, mixing=None):
    n = len(shape)
    return MeasuredShape(
        row=np.asarray(row),
        mode=mode,
        shape=np.asarray(shape, dtype=float) / np.linalg.norm(shape),
        std=np.full(n, std),
        slope=np.zeros((n, 1)) if slope is None else slope,
        mixing=Mixing(root=np.eye(n), steady=np.eye(n), meets=False) if mixing is None else mixing,
    )


def parts(block):
    """Return the covariances of noise and of discrepancy that a block stands for."""
    back = la.inv(block.rotation)
    return back @ back.T, back @ np.diag(block.growth) @ back.T


def test_errors_of_places_are_the_same_in_all_shapes_and_scale_says_nothing():
    rng = np.random.default_rng(6)
    slopes = rng.normal(size=(2, 4, 3))
    own = [measured(range(4 * i, 4 * i + 4), i, rng.normal(size=4), 0.01, slopes[i]) for i in range(2)]
    noise, form = parts(shape_block(own))
    np.testing.assert_allclose(noise[:4, 4:], slopes[0] @ slopes[1].T, atol=1e-8)
    np.testing.assert_allclose(
        noise[:4, :4],
        1e-4 * np.eye(4) + slopes[0] @ slopes[0].T + 100.0 * np.outer(own[0].shape, own[0].shape),
        atol=1e-6,
    )
    np.testing.assert_allclose(form[:4, 4:], 0.0, atol=1e-6)  # other modes are wrong in another way
    np.testing.assert_allclose(form[:4, :4], np.eye(4), atol=1e-6)


def test_one_mode_is_wrong_alike_in_all_configurations_however_its_sign_was_chosen():
    rng = np.random.default_rng(7)
    u, roots = rng.normal(size=4), [covariance(rng, 4) for _ in range(2)]
    own = [
        measured(range(4), 5, u, 0.1, mixing=Mixing(root=roots[0], steady=roots[0], meets=False)),
        measured(range(4, 8), 5, -u, 0.1, mixing=Mixing(root=roots[1], steady=roots[1], meets=False)),
        measured(range(8, 12), 6, u, 0.1),
    ]
    form = parts(shape_block(own))[1]
    np.testing.assert_allclose(form[:4, 4:8], -CORRELATION * roots[0] @ roots[1].T, atol=1e-6)
    np.testing.assert_allclose(form[:8, 8:], 0.0, atol=1e-6)


def test_a_shape_of_other_sensors_is_compared_on_its_own():
    own = [measured(range(4), 0, np.ones(4), 0.1), measured(range(4, 7), 0, np.ones(3), 0.1)]
    form = parts(shape_block(own))[1]
    np.testing.assert_allclose(form[:4, 4:], 0.0, atol=1e-8)


def test_what_changes_between_configurations_is_known_better_than_what_is_common():
    n, size, noise = 3, 0.01, 1e-4
    block = block_of(np.arange(n), noise**2 * np.eye(n), alike(n))
    whole = la.inv(block.rotation) @ np.diag(1.0 + size**2 * block.growth) @ la.inv(block.rotation).T
    common, change = np.ones(n) / np.sqrt(n), np.array([1.0, -1.0, 0.0]) / np.sqrt(2.0)
    assert common @ whole @ common == pytest.approx(size**2 * (1.0 + 2.0 * CORRELATION), rel=1e-2)
    assert change @ whole @ change == pytest.approx(size**2 * (1.0 - CORRELATION), rel=1e-2)


@pytest.mark.parametrize("mode", [5, 12, 18])
def test_modes_above_those_that_are_solved_take_part(mode):
    """Of 120 modes, as dense everywhere, 20 are solved; the rest is seen where none of these reaches."""
    rng, n, n_dof, size = np.random.default_rng(7), 120, 60, 1e-3
    frequency = 100.0 * np.arange(1, n + 1) * (1.0 + 0.1 * rng.normal(size=n) / np.arange(1, n + 1))
    shape = rng.normal(size=(n_dof, n))
    outside = la.null_space(shape[:, :20].T)
    drawn = []
    for _ in range(400):
        stiffness, mass = (size * rng.normal(size=n) / np.sqrt(2.0) for _ in range(2))
        own, others = frequency[mode], np.delete(frequency, mode)
        lean = np.delete(stiffness, mode) * own * others - np.delete(mass, mode) * own**2
        turned = (
            np.delete(shape, mode, axis=1) @ (lean / (own**2 - others**2)) / np.linalg.norm(shape[:, mode])
        )
        drawn.append(np.linalg.norm(outside.T @ turned))
    root = mixing_of(mode, frequency[:20], shape[:, :20])[0].root
    assert np.sqrt(np.mean(np.square(drawn))) == pytest.approx(
        size * np.linalg.norm(outside.T @ root), rel=0.3
    )


def test_close_modes_mix_otherwise_in_each_configuration_and_far_ones_alike():
    """Two modes 1 % apart: what a shape is wrong by along the other says nothing of the next torque."""
    mixing, _ = mixing_of(1, np.array([240.0, 312.0, 315.0, 600.0]), SHAPE[:, :4])
    close, far = (la.null_space(np.delete(SHAPE[:, :4], [1, at], axis=1).T) for at in (2, 3))
    shapes = [measured(np.arange(N_DOF) + N_DOF * c, 5, SHAPE[:, 1], 1e-3, mixing=mixing) for c in range(2)]
    block = shape_block(shapes)
    back = la.inv(block.rotation)
    form = back @ np.diag(block.growth) @ back.T
    own, other = form[:N_DOF, :N_DOF], form[:N_DOF, N_DOF:]
    for space, least, most in ((close, 0.0, 0.05), (far, 0.8, CORRELATION)):
        share = np.trace(space.T @ other @ space) / np.trace(space.T @ own @ space)
        assert least <= share <= most + 1e-9
