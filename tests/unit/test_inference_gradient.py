"""The gradient of what a fit minimises, beside differences of that itself."""

from dataclasses import replace

import numpy as np
import pytest

from tests.unit.test_inference import BASE, TERM, Chain, matrices, measured
from updating.inference.discrepancy import Sizes, joined, shared_levels
from updating.inference.equation_error import equation_errors, shape_noise
from updating.inference.tree import Passing, Tree, pulls, tree_problem

SIZES = Sizes(stiffness=3e-3, damping=0.2)
SHARES = (0.5, 0.3, 0.2)
PATHS = (("rig", "S1", "low"), ("rig", "S1", "high"), ("rig", "S2", "low"))
COORDINATES = (*BASE, *TERM.coordinates)
AT = np.array([0.01, -0.02, 0.05])
FEW = slice(0, 15, 4)  # sensors, by which some modes are hardly seen


def states():
    found = []
    for i, path in enumerate(PATHS):
        one = measured(*matrices({"stiffness": 0.01 * i, "loss": 0.1})[:2], seed=i, name=path[-1])
        found.append(one)
    return found


class Blind(Chain):
    """The chain with few sensors."""

    def modal(self, x, state):
        one = super().modal(x, state)
        return replace(one, rows=one.rows[FEW], beyond_rows=one.beyond_rows[FEW], row_change=one.row_change[:, FEW])


def seen(one):
    shape = one.shape[FEW]
    return replace(one, shape=shape / np.linalg.norm(shape, axis=0))


@pytest.fixture(params=["all", "few"])
def problems(request):
    """What makes the problem at coordinates, in full and on a tree."""
    measured_states = [one if request.param == "all" else seen(one) for one in states()]
    model = (Chain if request.param == "all" else Blind)(tuple(measured_states), COORDINATES)
    noise = [np.maximum(shape_noise(one, model.modal(AT, i)), 1e-3) for i, one in enumerate(measured_states)]

    def at(x, tree):
        errors = [equation_errors(one, model.modal(x, i), noise[i], x.size) for i, one in enumerate(measured_states)]
        if tree:
            return tree_problem(errors, Tree(paths=PATHS, shares=SHARES), x.size)
        return joined(errors, shared_levels(PATHS, SHARES))

    return at


@pytest.mark.parametrize("tree", [False, True])
def test_the_gradient_is_that_of_differences(problems, tree):
    def cost(x):
        problem = problems(x, tree)
        found = problem.weighed(SIZES)
        return 0.5 * found.misfit + found.log - problem.log_map

    problem = problems(AT, tree)
    weighed = problem.weighed(SIZES)
    found = weighed.slope + problem.beside(SIZES).sum(axis=0)
    std = np.diag(weighed.hessian + problem.curvature) ** -0.5
    step = 1e-2 * std
    for i in range(AT.size):
        one = step[i] * np.eye(AT.size)[i]
        difference = (cost(AT + one) - cost(AT - one)) / (2.0 * step[i])
        assert found[i] * std[i] == pytest.approx(difference * std[i], rel=0.05, abs=0.1)


def test_errors_are_weighed_on_the_tree_as_by_the_covariance_in_full(problems):
    full, tree = problems(AT, tree=False), problems(AT, tree=True)
    inverse = np.linalg.inv(full.noise + SIZES.stiffness**2 * full.discrepancy)
    pull, first = inverse @ full.value, 0
    for one, (by_tree, blocks) in zip(full.errors, pulls(tree, SIZES.stiffness), strict=True):
        n, m = one.value.shape
        np.testing.assert_allclose(by_tree.ravel(), pull[first : first + n * m], rtol=1e-6, atol=1e-6 * abs(pull).max())
        for r in range(n):
            at = slice(first + r * m, first + (r + 1) * m)
            np.testing.assert_allclose(blocks[r], inverse[at, at], rtol=1e-5, atol=1e-6 * abs(inverse[at, at]).max())
        first += n * m
    assert Passing(tree, SIZES.stiffness).root().product.shape == (4, 4)
