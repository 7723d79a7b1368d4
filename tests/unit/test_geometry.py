"""Points, local axes and degrees of freedom."""

import numpy as np
import pytest

from ema.types.frf import Dofs, Geometry

TURNED = np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]])  # rows: the local axes


def test_directions_are_those_of_the_local_axes():
    geometry = Geometry(node=[3, 8], coordinate=np.zeros((2, 3)), line=np.empty((0, 2)), axes=[np.eye(3), TURNED])
    assert geometry.direction(3, -2) == (0, -1, 0)
    assert geometry.direction(8, 1) == (0, 1, 0)
    assert geometry.direction(8, -2) == (1, 0, 0)
    assert geometry.direction(21, 3) == (0, 0, 1)  # a reference that is not among the points


def test_axes_are_global_unless_given():
    geometry = Geometry(node=[1, 2], coordinate=np.zeros((2, 3)), line=np.empty((0, 2)))
    np.testing.assert_array_equal(geometry.axes, [np.eye(3)] * 2)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"node": [1, 1]}, r"point numbers must be unique, repeated: \[1\]"),
        ({"coordinate": np.zeros((2, 2))}, r"Geometry.coordinate: expected shape \(2, 3\), got \(2, 2\)"),
        ({"axes": np.zeros((1, 3, 3))}, r"Geometry.axes: expected shape \(2, 3, 3\), got \(1, 3, 3\)"),
    ],
)
def test_wrong_shapes_are_named(change, said):
    with pytest.raises(ValueError, match=said):
        Geometry(**({"node": [1, 2], "coordinate": np.zeros((2, 3)), "line": np.empty((0, 2))} | change))


def test_dofs_are_named_as_in_a_campaign_file():
    dofs = Dofs(node=[12, 4, 7], direction=[[0, 0, 1], [-1, 0, 0], [0, 0.6, 0.8]])
    assert [dofs.name(i) for i in range(3)] == ["12+z", "4-x", "7 along [0.0, 0.6, 0.8]"]
