"""Measured points on the model."""

from pathlib import Path

import numpy as np
import pytest

from ema import Geometry
from model import read_stack
from updating import PairingError, register

STACK = read_stack(Path(__file__).parents[2] / "data/demo_stack/stack.toml")
UP = np.array([[0.0, 0.0, 1.0]])


def geometry(*places):
    return Geometry(node=np.arange(1, len(places) + 1), coordinate=np.array(places), line=np.empty((0, 2)))


def test_a_point_on_the_face_is_sampled_in_the_outer_lamina():
    top = STACK.height / 2
    found = register(STACK, geometry((0.1, 0.02, top)), np.array([1]), UP)
    np.testing.assert_allclose(found.observation.location, [[0.1, 0.02, top - STACK.pitch / 2]])
    np.testing.assert_allclose(found.distance, STACK.pitch / 2)


def test_order_and_direction_are_those_that_were_asked_for():
    g = geometry((0.1, 0.0, 0.0), (0.2, 0.0, 0.0))
    found = register(STACK, g, np.array([2, 1, 2]), np.array([[0, 0, -1.0], [0, 1.0, 0], [1.0, 0, 0]]))
    assert found.observation.node.tolist() == [2, 1, 2]
    np.testing.assert_allclose(found.observation.location[:, 0], [0.2, 0.1, 0.2])
    np.testing.assert_allclose(found.observation.direction[0], [0, 0, -1])


def test_points_in_millimetres_are_refused_with_a_hint():
    with pytest.raises(PairingError, match="check the unit and the origin") as caught:
        register(STACK, geometry((100.0, 0.0, 0.0), (0.1, 0.0, 0.0)), np.array([1, 2]), np.repeat(UP, 2, axis=0))
    assert "1 of 2 measured points" in str(caught.value)
    assert "point 1 at (100000.0, 0.0, 0.0) mm" in str(caught.value)


def test_a_point_without_coordinates_is_named():
    with pytest.raises(PairingError, match=r"points \[7\] were measured but have no coordinates"):
        register(STACK, geometry((0.1, 0.0, 0.0)), np.array([7]), UP)
