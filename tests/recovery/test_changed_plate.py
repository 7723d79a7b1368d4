"""A measured cantilever plate, intact, mounted anew, cut, stiffened and drilled, each against its reference."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from ema import FRF, Dofs, Geometry, change, identify_frf

PLATE = Path(__file__).parents[2].parent / "shared/realdata/plate-cantilever-changes-iqs"
pytestmark = pytest.mark.skipif(not PLATE.exists(), reason=f"the measured plate is not at {PLATE}")
BAND = (40.0, 500.0)
USED = np.arange(2, 81, 3)
"""Rows of the functions, a third of them, with the point of the force."""


@cache
def identified(name):
    """Return the modes of a state; the force is at point 30, against z."""
    data = np.load(PLATE / f"{name}.npz")
    points = np.genfromtxt(PLATE / "points.csv", delimiter=",", skip_header=1)
    frf = FRF(
        frequency=data["frequency"],
        value=data["frf"][USED][:, None],
        quantity="accelerance",
        output=Dofs(node=USED + 1, direction=np.tile([0.0, 0.0, 1.0], (USED.size, 1))),
        input=Dofs(node=[30], direction=[[0.0, 0.0, -1.0]]),
        run=np.zeros(USED.size),
        source=(name,) * USED.size,
    )
    geometry = Geometry(node=points[:, 0].astype(int), coordinate=1e-3 * points[:, 1:], line=np.empty((0, 2)))
    return identify_frf(frf.band(*BAND), geometry, name=name)


def compared(state, *references):
    return change([identified(state)], [identified(name) for name in references])


@pytest.mark.parametrize(("state", "reference"), [("A2", "A1"), ("A3", "A1"), ("B8", "B7")])
def test_the_intact_plate_has_not_changed(state, reference):
    found = compared(state, reference)
    assert found.mode.size >= 5
    assert not found.changed
    # one mounting repeats to 0.1 %, a new one to 0.5 %
    assert np.abs(found.frequency_shift).max() < (5e-3 if state == "A3" else 1e-3)


@pytest.mark.parametrize("state", ["C60", "C140"])
def test_a_cut_is_a_change_that_lowers_the_first_mode_most(state):
    found = compared(state, "A1", "A2", "A3")
    moved = found.which[:, 0]
    assert {0, 2, 3} <= set(found.reference_mode[moved].tolist())
    assert np.all(found.frequency_shift[moved] < 0.0)
    assert found.reference_mode[np.argmin(found.frequency_shift)] == 0


def test_a_cut_of_140_mm_disturbs_shapes_beside_the_clamp():
    found = compared("C140", "A1", "A2", "A3")
    assert found.location[np.argmin(found.comac), 1] < -0.09  # the clamp is at y = -0.137 m


@pytest.mark.parametrize("state", ["C20", "S3", "H15"])
def test_what_is_small_is_right_or_not_seen(state):
    """A cut and a hole lower the first mode, a stringer raises it, by 1 % each: nothing else may be called changed."""
    found = compared(state, *(("B7", "B8") if state == "H15" else ("A1", "A2", "A3")))
    sign = 1.0 if state == "S3" else -1.0
    moved = found.which[:, 0]
    assert np.all(sign * found.frequency_shift[moved] > 0.0)
    assert not found.which[:, 1:].any()
