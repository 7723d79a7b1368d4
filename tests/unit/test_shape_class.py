"""Names of modes from their shapes."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from model import read_stack
from updating.correlation.shape_class import class_grid, shape_classes

STACK = read_stack(Path(__file__).parents[2] / "data/demo_stack/stack.toml")


def modes(w, u=lambda x, y: 0 * x):
    """Modes of one column whose out-of-plane and in-plane motion are functions of x and y (each from -1 to 1)."""
    grid = class_grid(STACK)
    x, y = 2 * grid.location[:, 0] / STACK.length, 2 * grid.location[:, 1] / STACK.width
    value = np.where(grid.direction[:, 2] == 1, w(x, y), np.where(grid.direction[:, 0] == 1, u(x, y), 0.0))
    return SimpleNamespace(shape=value[:, None])


@pytest.mark.parametrize(
    ("w", "name"),
    [
        (lambda x, y: x**2 - 0.3, "bending 1"),
        (lambda x, y: x * (x**2 - 0.5), "bending 2"),
        (lambda x, y: np.cos(2 * np.pi * x) + 0.2 * y**2, "bending 3"),
        (lambda x, y: x * y, "torsion 1"),
        (lambda x, y: (x**2 - 0.4) * y + 0.05, "torsion 2"),
        (lambda x, y: 1 + 0 * x, "other"),
    ],
)
def test_shapes_have_their_names(w, name):
    assert shape_classes(modes(w)) == (name,)


def test_in_plane_motion_has_no_name():
    assert shape_classes(modes(lambda x, y: 0.1 * x * y, u=lambda x, y: np.sin(3 * x))) == ("other",)
