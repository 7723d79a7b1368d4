"""Errors on a tree of states: the same as with their covariance in full, from its leaves to its root."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg as la

from tests.unit.test_inference import BASE, TERM, Chain, errors, matrices, measured
from updating.inference.discrepancy import DAMPING, STIFFNESS, SizePrior, Sizes, joined, shared_levels
from updating.inference.explain import explain, setting
from updating.inference.tree import Passing, Tree, tree_problem

SIZES = Sizes(stiffness=3e-3, damping=0.2)
SHARES = (0.5, 0.0, 0.3, 0.2)
PATHS = (
    ("rig", "", "S1", "low"),
    ("rig", "", "S1", "high"),
    ("rig", "", "S2", "low"),
    ("rig", "glued", "S3", "low"),
    ("rig", "glued", "S3", "high"),
)


def turned(one, angle):
    """The same errors by a model of which two modes are turned into each other in its coordinates."""
    turn = np.eye(one.shape.shape[1])
    turn[:2, :2] = [[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]]
    return replace(one, shape=one.shape @ turn)


@pytest.fixture(scope="module")
def every():
    coordinates = (*BASE, *TERM.coordinates)
    found = []
    for i, path in enumerate(PATHS):
        state = measured(*matrices({"stiffness": 0.01 * i, "loss": 0.1})[:2], seed=i, name=path[-1])
        found.append(turned(errors(state, [0.0, 0.0, 0.05], coordinates), 0.1 * i))
    return found


@pytest.mark.parametrize("shares", [SHARES, (0.9, 0.0, 0.0, 0.1), (0.0, 0.0, 0.6, 0.4), (0.0, 0.0, 0.0, 1.0)])
def test_the_tree_weighs_as_the_covariance_in_full(every, shares):
    # one state leads to another by way of the first
    full = joined(every, shared_levels(PATHS, shares)).weighed(SIZES)
    found = tree_problem(every, Tree(paths=PATHS, shares=shares), 3).weighed(SIZES)
    assert found.misfit == pytest.approx(full.misfit, rel=1e-8)
    assert found.log == pytest.approx(full.log, rel=1e-8)
    np.testing.assert_allclose(found.slope, full.slope, rtol=1e-7, atol=1e-7 * np.abs(full.slope).max())
    np.testing.assert_allclose(found.hessian, full.hessian, rtol=1e-7, atol=1e-7 * np.abs(full.hessian).max())


def test_what_is_left_out_counts_no_more(every):
    """A state, or some of its errors, left out: as where they had not been measured."""
    tree = Tree(paths=PATHS, shares=SHARES)
    problem = tree_problem(every, tree, 3)
    passing = Passing(problem, SIZES.stiffness)
    whole = passing.root()
    without = problem.whole(passing.root({1: None}))
    rest = [one for i, one in enumerate(every) if i != 1]
    paths = tuple(one for i, one in enumerate(PATHS) if i != 1)
    fewer = tree_problem(rest, Tree(paths=paths, shares=SHARES), 3).of_stiffness(SIZES.stiffness)
    np.testing.assert_allclose(without.hessian, fewer.hessian, rtol=1e-8)
    assert without.misfit == pytest.approx(fewer.misfit, rel=1e-8)
    np.testing.assert_array_equal(passing.root().product, whole.product)


def test_coordinates_of_single_states_stand_among_all(every):
    """Each state has the second coordinate to itself: as derivatives of five coordinates that are nought elsewhere."""
    tree, n = Tree(paths=PATHS, shares=SHARES), 2 + len(every)
    one = [replace(e, touched=np.array([0, 2 + i, 1])) for i, e in enumerate(every)]
    wide = []
    for e in one:
        jacobian, damping = np.zeros((*e.value.shape, n)), np.zeros((len(e.damping), n))
        curvature = np.zeros((len(e.value), n, n))
        jacobian[:, :, e.touched], damping[:, e.touched] = e.jacobian, e.damping_jacobian
        curvature[np.ix_(range(len(e.value)), e.touched, e.touched)] = e.curvature
        wide.append(
            replace(e, jacobian=jacobian, damping_jacobian=damping, curvature=curvature, touched=None)
        )  # fmt: skip
    full, found = tree_problem(wide, tree, n), tree_problem(one, tree, n)
    np.testing.assert_allclose(found.weighed(SIZES).hessian, full.weighed(SIZES).hessian, rtol=1e-9, atol=1e-6)
    np.testing.assert_allclose(found.curvature, full.curvature)


def test_a_fit_by_the_tree_ends_where_one_in_full_does():
    stiffness, mass, _ = matrices({"loss": 0.3, "stiffness": 0.02})
    value, vector = la.eigh(stiffness, mass)
    force, rng, states = mass @ vector * np.sqrt(value), np.random.default_rng(3), []
    for i, path in enumerate(PATHS):
        e = 1e-3 * rng.standard_normal((len(value), len(value)))
        each = measured(stiffness + force @ (e + e.T) @ force.T, mass, seed=i, name=path[-1])
        states.append(replace(each, path=path))
    model = Chain(tuple(states))
    start = np.zeros(3)
    local = model.about((*BASE, *TERM.coordinates), [start])
    known = (SizePrior.exactly(4e-3), SizePrior.exactly(0.1))
    for priors, near in ((known, 0.1), ((STIFFNESS, DAMPING), 0.3)):  # a grid steps over what is looked for
        full = setting(model, local, start, shares=SHARES, priors=priors)
        by_tree = replace(full, tree=Tree(paths=PATHS, shares=SHARES))
        one, other = (explain(model, [TERM], each, np.array([0.0, 0.0, 0.2])) for each in (full, by_tree))
        np.testing.assert_allclose(other.x, one.x, atol=near * one.std.max())
        np.testing.assert_allclose(other.std, one.std, rtol=near)
        assert other.log_evidence == pytest.approx(one.log_evidence, abs=5.0 * near)
