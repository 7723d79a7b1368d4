"""Block elimination over specimens against one dense Gaussian problem of all of them."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.linalg as la

from updating.diagnosis.discrepancy import CORRELATION, KINDS, MEDIAN, MeasuredShape, Mixing, block_of
from updating.diagnosis.evidence import Rows
from updating.diagnosis.residual import Spread
from updating.pooled.algebra import Block, Strengths, bounded, grams, joined, log_evidence, reduced
from updating.pooled.common import latents_of, separated
from updating.pooled.fit import SCALES, Weighing
from updating.pooled.linear import Scales

N_OWN, N_LATENT, N_EFFECT = 4, 3, 2
SIZE = (0.5, 0.8, 0.3)
WEIGHED = Strengths(size=SIZE, own=(0.3, 0.5, 0.2, 0.4), mean=(0.6, 0.2, 0.9, 0.5), latent=(0.4, 0.7, 0.2))
PRIOR = np.array([2.0, 3.0, 1.5])
PLACE = [np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]), np.array([[1.0, 0.0, 1.0], [0.0, 0.0, 0.0]])]
"""The first effect is the rig's, the second the first specimen's, and the second specimen has more of the first."""


def block(seed, n=14):
    rng = np.random.default_rng(seed)
    return Block(
        value=rng.normal(size=n),
        own=rng.normal(size=(n, N_OWN)),
        shared=rng.normal(size=(n, N_LATENT)),
        effect=rng.normal(size=(n, N_EFFECT)),
        kind=np.array([KINDS[i % 3] for i in range(n)]),
        growth=rng.uniform(0.5, 2.0, n),
        away=rng.normal(size=N_OWN),
        mean=np.array([2, 0, 1, 3]),
    )


BLOCKS = [block(1), block(2, 17)]


def dense(blocks):
    """Mean and covariance of all data, and their covariance with means, latents and effects."""
    size = dict(zip(KINDS, SIZE, strict=True))
    shared_var = np.concatenate([np.square(WEIGHED.mean), np.square(WEIGHED.latent), 1.0 / PRIOR])
    rows, own = [], []
    for b, place in zip(blocks, PLACE, strict=False):
        mean = np.zeros((b.value.size, len(WEIGHED.mean)))
        mean[:, b.mean] = b.own
        rows.append(np.hstack([-mean, b.shared, -b.effect @ place]))
        variance = 1.0 + np.array([size[k] for k in b.kind]) ** 2 * b.growth
        own.append(np.diag(variance) + b.own @ np.diag(np.square(WEIGHED.own)) @ b.own.T)
    by = np.vstack(rows)
    return (
        np.concatenate([b.own @ b.away for b in blocks]),
        la.block_diag(*own) + by * shared_var @ by.T,
        shared_var[:, None] * by.T,
    )


def solved(blocks):
    own = reduced(blocks, [WEIGHED] * len(blocks), [grams(b, SIZE) for b in blocks])
    return own, joined(own, WEIGHED, PLACE[: len(blocks)], (np.zeros(3), PRIOR))


def test_evidence_is_that_of_the_dense_problem():
    _, joint = solved(BLOCKS)
    m = joint.slope.size
    found = log_evidence(joint, joint.step(np.full(3, -9.0), np.full(3, 9.0), 0.0), np.zeros(m))
    mean, covariance, _ = dense(BLOCKS)
    left = np.concatenate([b.value for b in BLOCKS]) - mean
    expected = -0.5 * (left @ np.linalg.solve(covariance, left) + np.linalg.slogdet(covariance)[1])
    assert found == pytest.approx(expected, abs=1e-9)


def test_what_is_shared_is_that_of_the_dense_problem():
    _, joint = solved(BLOCKS)
    mean, covariance, cross = dense(BLOCKS)
    left = np.concatenate([b.value for b in BLOCKS]) - mean
    expected = cross @ np.linalg.solve(covariance, left)
    assert joint.step(np.full(3, -9.0), np.full(3, 9.0), 0.0) == pytest.approx(expected, abs=1e-8)


def test_own_coordinates_go_with_what_is_shared():
    own, joint = solved(BLOCKS)
    step = joint.step(np.full(3, -9.0), np.full(3, 9.0), 0.0)
    n = len(WEIGHED.mean) + N_LATENT
    b, place = BLOCKS[0], PLACE[0]
    x = -own[0].back @ np.concatenate([step[:n], place @ step[n:], [1.0]])
    size = dict(zip(KINDS, SIZE, strict=True))
    weight = 1.0 / (1.0 + np.array([size[k] for k in b.kind]) ** 2 * b.growth)
    rest = b.value - b.shared @ step[4:n] + b.effect @ place @ step[n:]
    prior = np.square(WEIGHED.own) ** -1.0
    gradient = b.own.T @ (weight * (rest + b.own @ x)) + prior * (x + b.away - step[b.mean])
    assert gradient == pytest.approx(np.zeros(N_OWN), abs=1e-9)


def test_a_specimen_that_is_left_out_is_a_summand_less():
    own, joint = solved(BLOCKS)
    _, one = solved(BLOCKS[:1])
    other = joined(own[1:], WEIGHED, PLACE[1:], (np.zeros(3), np.zeros(3)))
    known = np.concatenate([np.square(WEIGHED.mean), np.square(WEIGHED.latent)]) ** -1.0
    both = one.precision + other.precision - np.diag(np.append(known, np.zeros(3)))
    assert joint.precision == pytest.approx(both, abs=1e-10)


def test_a_step_stays_within_its_bounds():
    precision, slope = np.array([[2.0, 0.5], [0.5, 1.0]]), np.array([-4.0, -1.0])
    assert bounded(precision, slope, np.full(2, -9.0), np.full(2, 9.0)) == pytest.approx([2.0, 0.0], abs=1e-8)
    assert bounded(precision, slope, np.zeros(2), np.ones(2)) == pytest.approx([1.0, 0.5])


def test_a_discrepancy_is_common_to_specimens_and_torques():
    """Own and shared parts together are the covariance that one stack's configurations have."""
    modes = SimpleNamespace(shape=np.zeros((1, 2)))
    tested, used = [SimpleNamespace(modes=modes)] * 2, [np.arange(2)] * 2
    rows = Rows.of(tested, used, used, touching=True)
    mesh = SimpleNamespace(mesh=np.array([2e-4, -1e-4]))
    evidence = SimpleNamespace(
        rows=rows,
        scatter=SimpleNamespace(mesh=0.3),
        shift=[mesh, mesh],
        used=used,
    )
    noise = np.array([1e-4, 2e-4, 3e-4, 1e-4])
    shapes = tuple(
        MeasuredShape(
            row=row,
            mode=i,
            shape=np.ones(1),
            std=np.ones(1),
            slope=np.zeros((1, 1)),
            mixing=Mixing(root=np.ones((1, 1)), steady=np.ones((1, 1)), meets=False),
        )
        for (_, i), row in rows.shape.items()
    )
    spread = Spread(frequency=noise, damping=10.0 * noise, shape=shapes)
    latents = latents_of([evidence], [spread])
    divided = separated(evidence, spread, latents)
    strength = np.array([1.0 if own.kind == "mesh" else np.sqrt(CORRELATION) * 3e-3 for own in latents])
    frequency = np.flatnonzero(evidence.rows.kind == "frequency")
    rotation = np.zeros((12, 12))
    for own in divided.own.blocks:
        rotation[np.ix_(own.row, own.row)] = own.rotation
    turned = np.linalg.inv(rotation)
    rotated = np.diag(1.0 + 9e-6 * divided.own.growth) + divided.shared * strength**2 @ divided.shared.T
    found = (turned @ rotated @ turned.T)[np.ix_(frequency, frequency)]
    error = 0.3 * np.tile(mesh.mesh, 2)
    same = np.tile(np.eye(2), (2, 2))
    expected = np.diag(noise**2 - error**2) + same * np.outer(error, error)
    expected += 9e-6 * (CORRELATION * same + (1.0 - CORRELATION) * np.eye(4))
    assert found == pytest.approx(expected, rel=1e-9, abs=1e-18)


def own_variance(mixing, apart=()):
    """The variance that a lone shape of two components has of its own, by directions, in a discrepancy of unit size."""
    rows = Rows.of([SimpleNamespace(modes=SimpleNamespace(shape=np.zeros((2, 1))))], [np.arange(1)], [np.arange(1)],
                   touching=True)  # fmt: skip
    own = MeasuredShape(row=rows.shape[0, 0], mode=0, shape=np.array([1.0, 0.0]), std=np.full(2, 1e-3),
                        slope=np.zeros((2, 1)), mixing=mixing)  # fmt: skip
    evidence = SimpleNamespace(
        rows=rows,
        scatter=SimpleNamespace(mesh=0.0),
        shift=[SimpleNamespace(mesh=np.zeros(1))],
        used=[np.arange(1)],
    )
    spread = Spread(frequency=np.full(1, 1e-4), damping=np.full(1, 1e-2), shape=(own,))
    block = separated(evidence, spread, latents_of([evidence], [spread]), apart).own.blocks[0]
    turned = np.linalg.inv(block.rotation)
    return turned @ np.diag(block.growth) @ turned.T, turned @ turned.T


def test_a_shape_has_a_tenth_of_its_variance_of_its_own():
    root = np.diag([0.2, 0.5])
    form, _ = own_variance(Mixing(root=root, steady=root, meets=False))
    assert form == pytest.approx((1.0 - CORRELATION) * root**2, abs=1e-9)


def test_the_shape_of_a_mode_that_meets_another_takes_no_part():
    root = np.eye(2)
    _, noise = own_variance(Mixing(root=root, steady=root, meets=True))
    assert np.diag(noise).min() > 1e9


def test_a_shape_takes_no_part_that_is_told_apart_for_another_place():
    """Else an evidence weighed where modes are close would be of other data than one weighed where they are not."""
    root = np.eye(2)
    _, near = own_variance(Mixing(root=root, steady=root, meets=True))
    _, told = own_variance(Mixing(root=root, steady=root, meets=False), apart={0})
    assert told == pytest.approx(near)


class Hill(Weighing):
    """An evidence that is largest where a model is far off: sixty times the usual in frequency."""

    LARGEST = Scales(frequency=0.2, damping=1.5, own_frequency=0.1, stiffness=0.4)

    def __init__(self):
        self.looks = 0

    def log_evidence(self, scales):
        self.looks += 1
        away = [np.log(getattr(scales, name) / getattr(self.LARGEST, name)) for name in SCALES]
        return -20.0 * float(np.sum(np.square(away)))


def test_scales_are_found_however_far_off_a_model_is():
    hill = Hill()
    found, top = hill.likeliest(Scales())
    for name in SCALES:
        assert getattr(found, name) == pytest.approx(getattr(Hill.LARGEST, name), rel=0.02)
    assert top == pytest.approx(0.0, abs=0.02)
    assert hill.looks < 32 * len(SCALES)
    stays, _ = Hill().likeliest(Scales(), stated=("frequency",))
    assert stays.frequency == Scales().frequency


def test_what_is_own_counts_with_what_is_common():
    usual = Scales()
    assert [usual.whole(kind) for kind in KINDS] == pytest.approx([MEDIAN[kind] for kind in KINDS])
    assert usual.adequate
    apart = Scales(own_frequency=0.3)  # stacks are built unlike each other by a tenth
    assert apart.own("frequency") == 0.3
    assert apart.own("shape") == apart.shape
    assert apart.whole("frequency") == pytest.approx(np.sqrt(0.9 * 3e-3**2 + 0.1 * 0.3**2))
    assert not apart.adequate


def test_frequencies_are_not_left_to_shapes_that_are_nearly_right():
    """As of a single stack: all of them would drift away together, and the contact stiffness with them."""
    flown = Scales(frequency=0.13, own_frequency=0.02, shape=0.004, own_shape=0.004)
    weighed = flown.weights(())
    assert weighed.whole("frequency") == pytest.approx(0.01)
    assert weighed.own_frequency / weighed.frequency == pytest.approx(0.02 / 0.13)
    assert weighed.shape == flown.shape
    assert flown.weights(("frequency",)) == flown  # what a laboratory states is taken as stated
    assert Scales().weights(()) == Scales()
    bent = replace(flown, shape=0.2)
    assert flown.log_prior() < bent.log_prior() - 20.0
    assert flown.log_prior(("shape",)) > flown.log_prior() + 30.0  # a stated size says nothing of the other


def test_scatter_of_specimens_is_no_discrepancy_of_the_model():
    """Twelve specimens of four modes, each off by 5 % of its own: what the model misses alike stays small."""
    rng = np.random.default_rng(3)
    modes, specimens = 4, 12
    noise = 1e-3 * np.eye(modes)
    own = block_of(np.arange(modes), noise**2, (1.0 - CORRELATION) * np.eye(modes))
    blocks = [
        Block(
            value=own.rotation @ (0.05 * rng.standard_normal(modes)),
            own=np.zeros((modes, 0)),
            shared=own.rotation,
            effect=np.zeros((modes, 0)),
            kind=np.full(modes, "frequency"),
            growth=own.growth,
            away=np.zeros(0),
            mean=np.zeros(0, dtype=int),
        )
        for _ in range(specimens)
    ]

    def weigh(common, apart):
        weighed = Strengths(
            size=(apart, 0.1, 0.02), own=(), mean=(), latent=(np.sqrt(CORRELATION) * common,) * modes
        )
        found = reduced(blocks, [weighed] * len(blocks), [grams(own, weighed.size) for own in blocks])
        joint = joined(found, weighed, [np.zeros((0, 0))] * specimens, (np.zeros(0), np.zeros(0)))
        step = joint.step(np.zeros(0), np.zeros(0), 1.0)
        return (
            log_evidence(joint, step, np.zeros(modes))
            + Scales(frequency=common, own_frequency=apart).log_prior()
        )

    apart = 0.05 / np.sqrt(1.0 - CORRELATION)
    right = weigh(3e-3, apart)
    assert right > weigh(0.05, apart) + 2.0  # each mode missed alike
    assert (
        right > weigh(0.05 / np.sqrt(CORRELATION), 3e-3) + 50.0
    )  # what was supposed before: nearly all alike
