"""What changed, and where: a measured plate with cuts, and stacks that a second model simulates."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

import model
from ema import FRF, Dofs, Geometry, change, identify_frf
from model.stack.parts import EdgeSupport
from tests.independent.solid import Solid
from tests.recovery.changed_stacks import pair
from updating.changes.compare import what_changed
from updating.changes.reference import fit_reference
from updating.diagnosis.candidates import candidate_model, instruments_of
from updating.errors import FitError

PLATE = Path(__file__).parents[2].parent / "shared/realdata/plate-cantilever-changes-iqs"
measured = pytest.mark.skipif(not PLATE.exists(), reason=f"the measured plate is not at {PLATE}")
PRESSURE = 1e5
REFERENCE = ("A1", "A2", "A3")


@cache
def identified(name, highest=900.0):
    """Return the modes of a state of the plate; the force is at point 30, against z."""
    data = np.load(PLATE / f"{name}.npz")
    points = np.genfromtxt(PLATE / "points.csv", delimiter=",", skip_header=1)
    frf = FRF(
        frequency=data["frequency"],
        value=data["frf"][:, None],
        quantity="accelerance",
        output=Dofs(node=np.arange(1, 82), direction=np.tile([0.0, 0.0, 1.0], (81, 1))),
        input=Dofs(node=[30], direction=[[0.0, 0.0, -1.0]]),
        run=np.zeros(81),
        source=(name,) * 81,
    )
    geometry = Geometry(node=points[:, 0].astype(int), coordinate=1e-3 * points[:, 1:], line=np.empty((0, 2)))
    return identify_frf(frf.band(40.0, highest), geometry, name=name)


@cache
def plate_model():
    """Return the model of the plate, clamped along its front edge; all states have the same points."""
    stack = model.Stack(
        name="plate",
        length=0.300,
        width=0.274,
        height=4.98e-3,
        n_lamina=1,
        material=model.Material(young=72.587e9, poisson=0.3, density=2716.0),
        mesh=model.Mesh(n_x=10, n_y=9),
        supports=(EdgeSupport(edge="front", along=np.inf, across=np.inf, rotation=np.inf),),
    )
    effects = {"support_compliance": model.catalogue()["support_compliance"]}
    return candidate_model(stack, instruments_of(identified("A1")), effects)


@cache
def fitted(*names):
    """Return the model of the plate beside a reference."""
    return fit_reference(plate_model(), [(name, PRESSURE, identified(name)) for name in names])


def found(state, *reference):
    seen = change([identified(state)], [identified(name) for name in reference]).changed
    return what_changed(fitted(*reference), [(state, PRESSURE, identified(state))], seen=seen)


@measured
@pytest.mark.parametrize(
    ("state", "reference"),
    [
        pytest.param("A2", ("A1",), marks=pytest.mark.slow),
        pytest.param("A3", ("A1", "A2"), marks=pytest.mark.slow),
        pytest.param("B8", ("B7",), marks=pytest.mark.slow),
    ],
    ids=["A2", "A3", "B8"],
)
def test_of_a_plate_that_has_not_changed_nothing_is_named(state, reference):
    answer = found(state, *reference)
    assert answer.verdict == "unchanged"
    assert answer.left == ()
    assert len(answer.sentences) == 1


@measured
@pytest.mark.parametrize(("state", "length"), [("C60", 0.060), pytest.param("C140", 0.140, marks=pytest.mark.slow)])
def test_a_cut_is_less_stiffness_beside_the_middle_of_the_clamp(state, length):
    answer = found(state, *REFERENCE)
    assert answer.verdict == "one of"
    assert "crack" in answer.left
    assert set(answer.left) <= {"crack", "hole", "softer_patch", "softer_edge"}
    for name in answer.left:
        one = answer.kind(name)
        assert abs(one.place[0]) < 0.015  # independent fits put it at 140 to 160 mm of 300 mm
        assert one.place[1] < -0.137 + 0.025  # within 25 mm of the clamp
    cut = answer.kind("crack")
    assert cut.lower < 1.05 * length
    assert cut.upper > 0.95 * length
    assert any(sentence.startswith("Where: x = ") for sentence in answer.sentences)


@measured
@pytest.mark.parametrize("state", ["S3", *(pytest.param(state, marks=pytest.mark.slow) for state in ("C20", "H15"))])
def test_of_a_small_change_nothing_wrong_is_said(state):
    answer = found(state, *(("B7", "B8") if state == "H15" else REFERENCE))
    right = {
        "C20": {"crack", "hole", "softer_patch", "softer_edge"},
        "S3": {"stiffener", "stiffer_patch"},
        "H15": {"hole", "crack", "softer_patch", "softer_edge", "removed_mass"},
    }
    assert set(answer.left) <= right[state]


@cache
def stack_model():
    stack = model.read_stack(Path(__file__).parents[2] / "data/demo_stack/stack.toml")
    stack = stack.with_contact(pressure=320e3)
    return candidate_model(stack, instruments_of(pair_of(1, "nothing")[0][2]), {})


PLANTED = {
    "nothing": {},
    "loose bolt": {"loose_bolt": {"loss": 0.4, "stiffness": 2e8, "clamp": 0.1}},
    "lost contact": {"lost_contact_patch": {"loss": 0.13}},
    "mass": {"point_mass": {"mass": 0.1}},
}


@cache
def pair_of(seed, what):
    return pair(seed, PLANTED[what], Solid())


def answered(seed, what):
    tests = pair_of(seed, what)
    return what_changed(fit_reference(stack_model(), tests[:2]), tests[2:])


@pytest.mark.slow
def test_of_a_stack_that_was_assembled_anew_nothing_is_named():
    answer = answered(1, "nothing")
    assert answer.verdict == "unchanged"
    assert set(answer.impossible) == {
        "absorber",  # no mode was split
        "firmer_edge",
        "firmer_mounting",
        "greater_term",
        "lesser_term",
        "softer_edge",
        "softer_mounting",
        "stiffener",
    }


@pytest.mark.slow
@pytest.mark.parametrize(
    ("what", "kind", "x", "y"),
    [
        ("loose bolt", "loose_clamp", -0.109, 0.0),
        ("lost contact", "lost_contact", 0.0, 0.0),
        ("mass", "added_mass", 0.2325, 0.0312),
    ],
)
def test_a_change_of_a_stack_is_named_and_placed(what, kind, x, y):
    answer = answered(1, what)
    assert answer.left[0] == kind
    one = answer.kind(kind)
    assert abs(one.place[0] - x) < 0.1 * 0.465
    assert abs(one.place[1] - y) < 0.0312 / 2.0
    if what == "loose bolt":
        assert one.part == "clamp 1"
    if what == "mass":
        assert one.lower < 0.1 < one.upper
    assert answer.map.sum() == pytest.approx(1.0)


@measured
def test_too_few_modes_are_refused_by_name():
    with pytest.raises(FitError, match=r"A2: 2 of its modes .* what changed takes 3"):
        what_changed(fitted("A1"), [("A2", PRESSURE, identified("A2", 200.0))])
