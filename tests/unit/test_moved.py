"""What a fit moves beside effects is reported with what was stated and what is known of it."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from model import read_stack
from updating.diagnosis.evidence import DECAY, POINTS_SHIFT
from updating.diagnosis.moved import moved, moved_text
from updating.inference.protocol import Coordinate

STACK = read_stack(Path(__file__).parents[2] / "data/demo_stack/stack.toml")


def of(name, x, std, prior):
    one = SimpleNamespace(
        coordinates=(Coordinate(name=name, std=prior),), x=np.array([x]), std=np.array([std]), n_nuisance=1
    )
    (found,) = moved(STACK, one)
    return found


def test_a_ratio_is_reported_in_the_unit_of_the_stack_file():
    found = of("density", np.log(0.98), 0.005, 0.01)
    assert found.stated == STACK.material.density
    assert found.value == pytest.approx(0.98 * STACK.material.density)
    assert found.std == pytest.approx(0.005 * found.value)
    assert found.prior == pytest.approx(0.01 * STACK.material.density)
    assert found.deviations == pytest.approx(np.log(0.98) / 0.01)
    assert moved_text(found).startswith("density from ")
    assert moved_text(found).endswith(" kg/m3 (2.0)")


def test_a_place_is_reported_in_metres():
    found = of("clamp_2_x", 3e-3, 1e-3, 2e-3)
    assert (found.unit, found.stated) == ("m", STACK.clamps[1].x)
    assert found.value == pytest.approx(STACK.clamps[1].x + 3e-3)
    assert (found.std, found.prior, found.deviations) == (1e-3, 2e-3, pytest.approx(1.5))


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("G_f[M1]", "contact stiffness G_f at M1 over that of all by 10 % (2.0)"),
        ("gain[sensor 2]", "gain of sensor 2 over that of sensor 1 by 10 % (2.0)"),
    ],
)
def test_a_factor_is_reported_in_per_cent(name, text):
    assert moved_text(of(name, np.log(1.1), 0.01, np.log(1.1) / 2.0)) == text


def test_what_nothing_is_known_of_has_no_deviations():
    found = of("G_f", 0.1, 0.01, np.inf)
    assert (found.prior, found.deviations) == (None, None)
    assert found.stated == STACK.contact.G_f


def test_every_nuisance_of_a_stack_has_a_label():
    names = ("G_f", "d_f", "young", "density", "normal_modulus", "length", "width", "height", "clamp_1_y", "d_f[M2]")
    for name in (*names, DECAY, POINTS_SHIFT):
        assert of(name, 0.0, 1.0, 1.0).label
