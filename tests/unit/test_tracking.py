"""Modes followed through crossings, and pairing beside them."""

from types import SimpleNamespace

import numpy as np
import pytest

import model
from updating.correlation.pairing import cross_orthogonality, pair, track
from updating.correlation.shape_class import class_grid, shape_classes
from updating.errors import PairingError


def stack_with(offset):
    """A stack whose first torsion and first bending cross; clamps off the centre line make them veer."""
    return model.Stack(
        name="test",
        length=0.465,
        width=0.0624,
        height=0.064,
        n_lamina=40,
        material=model.Material(young=200e9, poisson=0.28, density=7650.0),
        contact=model.Contact(G_f=1480.0, d_f=1.5e-11, pressure=320e3, normal_modulus=1e9),
        clamps=tuple(
            model.Clamp(mass=2.84, x=x, y=y, footprint=(0.04, 0.05))
            for x, y in ((-0.109, 0.0), (-0.0254, 0.0), (0.0254, 0.0), (0.109, offset))
        ),
        mesh=model.Mesh(n_x=10, n_y=2),
    )


VALUES = np.geomspace(2500.0, 20_000.0, 25)


@pytest.fixture(scope="module")
def symmetric():
    return model.reduce(stack_with(0.0), G_f_range=(2000.0, 25_000.0))


@pytest.fixture(scope="module")
def veering():
    return model.reduce(stack_with(0.003), G_f_range=(2000.0, 25_000.0))


def solve(system, G_f, observation, n_mode=20):
    return model.solve_modes(system, G_f=G_f, d_f=1e-11, n_mode=n_mode, observation=observation).elastic()


def edges(stack):
    """Four edges, eleven stations."""
    half = np.array([stack.length, stack.width, stack.height]) / 2.0
    grid = np.meshgrid(np.linspace(-1.0, 1.0, 11), [-1.0, 1.0], [-1.0, 1.0], indexing="ij")
    return model.Observation(
        node=np.arange(44),
        location=half * np.stack(grid, axis=-1).reshape(-1, 3),
        direction=np.tile([0.0, 0.0, 1.0], (44, 1)),
    )


def test_tracks_keep_their_shape_class_where_the_order_changes(symmetric):
    grid = class_grid(symmetric.stack)
    steps = [solve(symmetric, value, grid) for value in VALUES]
    found = track(steps, symmetric.matrix("M", symmetric.theta), n_mode=4)
    names = np.array([np.array(shape_classes(s))[c] for s, c in zip(steps, found.column, strict=True)])
    assert set(names[:, 0]) == {names[0, 0]}
    assert set(names[:, 1]) == {names[0, 1]}
    assert {names[0, 0], names[0, 1]} == {"torsion 1", "bending 1"}
    sign = np.sign(found.frequency[:, 0] - found.frequency[:, 1])
    assert set(sign) == {-1.0, 1.0}
    assert found.cross_orthogonality.min() > 0.95


def test_tracks_go_through_veering_by_shape(veering):
    grid = edges(veering.stack)
    steps = [solve(veering, value, grid) for value in VALUES]
    mass = veering.matrix("M", veering.theta)
    found = track(steps, mass, n_mode=2)
    start, end = steps[0].coordinate[:, :2], steps[-1].coordinate[:, found.column[-1]]
    assert np.diag(cross_orthogonality(start, end, mass)).min() > 0.9
    assert np.diff(found.frequency, axis=1)[0] * np.diff(found.frequency, axis=1)[-1] < 0.0


def test_too_few_modes_are_refused(symmetric):
    steps = [solve(symmetric, value, edges(symmetric.stack), n) for value, n in ((3000.0, 12), (4000.0, 8))]
    with pytest.raises(PairingError, match="step 1 has 2 modes, but 4 are to be followed"):
        track(steps, np.eye(symmetric.size), n_mode=4)


def pairs_right(system, noise, seed):
    """Share of right pairs of the two crossing modes: G_f of measurement and model anywhere around the crossing.

    A pair is right if both modes are mostly the same of the two that cross; a pair of pairs that is one subspace
    is right if it holds both.
    """
    grid = edges(system.stack)
    mass = system.matrix("M", system.theta)
    steps = [solve(system, value, grid, 16) for value in VALUES]
    gap = [abs(s.frequency[1] / s.frequency[0] - 1.0) for s in steps]
    around = VALUES[int(np.argmin(gap))] * np.geomspace(0.6, 1.6, 9)
    reference = steps[0].coordinate[:, :2]
    trials = [solve(system, value, grid, 16) for value in around]
    family = [cross_orthogonality(t.coordinate, reference, mass) ** 2 for t in trials]
    rng, right = np.random.default_rng(seed), []
    for test, one in zip(trials, family, strict=True):
        shape = test.shape[:, :4]
        size = np.sqrt(np.mean(shape**2, axis=0))
        measured = SimpleNamespace(
            frequency=test.frequency[:4],
            damping=test.damping[:4],
            shape=shape + noise * size * rng.standard_normal(shape.shape),
            node=test.node,
            direction=test.direction,
        )
        for trial, theirs in zip(trials, family, strict=True):
            found = pair(measured, trial)
            partner = dict(zip(found.measured.tolist(), found.model.tolist(), strict=True))
            number = dict(zip(found.measured.tolist(), found.subspace.tolist(), strict=True))
            whole = 0 in number and number[0] == number.get(1)
            for r in (0, 1):
                share = theirs[partner[r]] if r in partner else np.zeros(2)
                same = np.argmax(share) == np.argmax(one[r])
                right.append(share.sum() > 0.8 and (whole or same))
    return np.mean(right)


@pytest.mark.parametrize("noise", [0.01, 0.05])
def test_crossing_modes_pair_whatever_their_order(symmetric, veering, noise):
    assert pairs_right(symmetric, noise, seed=0) == 1.0
    assert pairs_right(veering, noise, seed=0) > 0.97
