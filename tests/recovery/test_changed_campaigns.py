"""The two shipped campaigns with a change: what the control and the changed state are said to be."""

from functools import cache
from pathlib import Path

import pytest

import ema
import model
from updating.changes.compare import what_changed
from updating.changes.reference import fit_reference
from updating.diagnosis.candidates import candidate_model, instruments_of

DATA = Path(__file__).parents[2] / "data/hidden_effect"
REFERENCE = ("before", "before_again")
pytestmark = pytest.mark.slow


@cache
def identified(name):
    campaign = ema.read_campaign(DATA / name / "campaign.toml")
    return {one.modal_model.name: one.modal_model for one in ema.identify(campaign)}


@cache
def fitted(name):
    stack = model.read_stack(DATA / name / "stack.toml").with_contact(pressure=320e3)
    tests = identified(name)
    candidates = candidate_model(stack, instruments_of(tests["before"]), {})
    return fit_reference(candidates, [(one, 320e3, tests[one]) for one in REFERENCE])


def answered(name, state):
    tests = identified(name)
    seen = ema.change([tests[state]], [tests[one] for one in REFERENCE]).changed
    return seen, what_changed(fitted(name), [(state, 320e3, tests[state])], seen=seen)


@pytest.mark.parametrize("name", ["change_a", "change_b"])
def test_nothing_is_named_of_the_control(name):
    seen, answer = answered(name, "control")
    assert not seen
    assert answer.left == ()


def test_the_transport_loosened_the_bolt_of_one_clamp():
    seen, answer = answered("change_a", "after")
    assert seen
    assert "loose_clamp" in answer.left
    assert answer.kind("loose_clamp").part == "clamp 4"
    assert abs(answer.kind(answer.left[0]).place[0] - 0.109) < 0.1 * 0.465


def test_the_repair_glued_a_patch_of_one_side():
    """Modes moved by 1 % at most: without a model that is not seen."""
    _, answer = answered("change_b", "after")
    assert "glued_patch" in answer.left
    x, y, _ = answer.kind("glued_patch").best
    assert abs(x - 0.45 * 0.465 / 2.0) < 0.1 * 0.465
    assert y > 0.0
