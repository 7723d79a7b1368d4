"""Elements of a rectangle end where something begins or ends on it."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

import model
from model.elements.mesh import plan_of, rectangle

STACK = model.read_stack(Path(__file__).parents[2] / "data/demo_stack/stack.toml")
EDGES = (-0.129, -0.089, -0.0454, -0.0054, 0.0054, 0.0454, 0.089, 0.129)


def ends(plan):
    return np.unique(plan.membrane.mesh.p[0].round(9))


@pytest.mark.parametrize("n_x", [5, 16, 24])
def test_elements_end_at_edges_and_are_as_long_as_asked_for(n_x):
    found = ends(rectangle(0.465, 0.06, n_x, 2, EDGES))
    assert set(EDGES) <= set(found.tolist())
    assert np.diff(found).max() <= 1.5 * 0.465 / n_x
    np.testing.assert_allclose(found, -found[::-1], atol=1e-12)


def test_edges_that_nearly_coincide_count_once_and_those_off_the_plan_not_at_all():
    found = ends(rectangle(1.0, 0.1, 4, 1, (-0.502, -0.4999, -0.001, 0.001, 0.7)))
    np.testing.assert_allclose(found, [-0.5, -0.25, 0.0, 0.25, 0.5])


def test_elements_end_where_clamps_do():
    clamps = (model.Clamp(mass=1.0, x=-0.07, y=0.0, footprint=(0.04, 0.02)), model.Clamp(mass=1.0, x=0.1, y=0.0))
    stack = dataclasses.replace(STACK, clamps=clamps, mesh=model.Mesh(n_x=6, n_y=1))
    assert {-0.09, -0.05, 0.1} <= set(ends(plan_of(stack)).tolist())


@pytest.mark.parametrize("ratio", [0.9995, 1.001])
@pytest.mark.parametrize("n_x", [12, 16, 24])
def test_a_length_that_is_slightly_off_does_not_change_the_mesh(n_x, ratio):
    """What a dimension does to frequencies is taken from two models, and must not be what their meshes do."""
    stack = dataclasses.replace(STACK, mesh=model.Mesh(n_x=n_x, n_y=1))
    other = dataclasses.replace(stack, length=ratio * stack.length)
    assert ends(plan_of(other)).size == ends(plan_of(stack)).size
