"""When a second effect is named, and when it is only said to be possible."""

from types import SimpleNamespace

import numpy as np
import pytest

from updating.diagnosis import verdict
from updating.diagnosis.evidence import Evidence
from updating.diagnosis.point_change import PointChange
from updating.diagnosis.text import _at_a_point, _doubtful
from updating.diagnosis.verdict import decide


def explanation(misfit, *effects):
    return SimpleNamespace(misfit=misfit, effects=effects)


def found(first, second, form):
    """A strong first effect with a misfit of `first` alone and of `second` beside another."""
    return SimpleNamespace(
        base=explanation(10000.0),
        singles=(explanation(first, "clamp_inertia"),),
        pairs=(explanation(second, "stinger_mass", "clamp_inertia"),),
        evidence=SimpleNamespace(scatter=SimpleNamespace(form=form), lacking=()),
    )


@pytest.fixture(autouse=True)
def looked_at(monkeypatch):
    """Every fit is adequate, and no point stands out: return what is said of points, to be changed."""
    said = {"chance": 0.5, "p_value": 0.5}
    monkeypatch.setattr(verdict, "p_value", lambda own: 1.0)
    monkeypatch.setattr(
        verdict,
        "point_change",
        lambda _, at: PointChange(beside=at.effects, node=12, kind="mass", size=-0.0123, gain=24.0, **said),
    )
    return said


def test_a_second_effect_that_brings_enough_is_named():
    decision = decide(found(100.0, 79.0, form=0.0))
    assert decision.left[0].effects == ("stinger_mass", "clamp_inertia")
    assert decision.doubt is None


def test_a_second_effect_within_what_the_first_may_be_off_by_is_in_doubt():
    """1 % of sqrt(9900) standard deviations, 1.645 times, is 1.64; its square, 2.7, comes on top of 20."""
    decision = decide(found(100.0, 79.0, form=0.01))
    assert decision.verdict == "identified"
    assert decision.left[0].effects == ("clamp_inertia",)
    assert decision.doubt.effects == ("stinger_mass",)
    assert decision.doubt.gain == 21.0
    assert decision.doubt.least == pytest.approx(20.0 + (1.645 * 0.01) ** 2 * 9900.0, rel=1e-3)
    assert _doubtful(decision.doubt, decision.left[0]) == (
        "stinger_mass beside it would lower the squared misfit by 21 more. What the form of clamp_inertia may be off "
        "by accounts for up to 23, so stinger_mass may be there and is not named."
    )


def test_what_chance_brings_is_not_in_doubt():
    assert decide(found(100.0, 81.0, form=0.01)).doubt is None


@pytest.mark.parametrize(("lacking", "expected"), [((), "nothing missing"), (((0, 2),), "unlike anything")])
def test_a_model_that_lacks_a_measured_mode_is_not_complete(lacking, expected):
    nothing = found(9999.0, 9998.0, form=0.0)
    nothing.evidence.lacking = lacking
    assert decide(nothing).verdict == expected


@pytest.mark.parametrize(
    ("known", "beside"),
    [(found(100.0, 99.0, 0.0), "clamp_inertia"), (found(9999.0, 9998.0, 0.0), "the base model")],
)
def test_what_is_left_at_one_point_is_unlike_anything_however_likely_the_whole(looked_at, known, beside):
    looked_at["chance"] = 0.0004
    decision = decide(known)
    assert decision.verdict == "unlike anything"
    assert decision.left == ()
    assert _at_a_point(decision.point) == (
        f"This is unlike anything in the catalogue: what {beside} leaves looks like 12 g less mass at or near point 12 "
        "in the measured direction, which lowers the squared misfit by 24. Where nothing is missing, some point does "
        "as much in 4 of 10000 cases. Look there."
    )


@pytest.mark.parametrize(("left", "told"), [(0.5, True), (0.01, False)])
def test_a_point_is_told_of_a_model_that_is_not_adequate_if_it_explains_all_that_is_left(
    looked_at, monkeypatch, left, told
):
    monkeypatch.setattr(verdict, "p_value", lambda own: 1e-9)
    looked_at.update(chance=0.0004, p_value=left)
    decision = decide(found(100.0, 79.0, form=0.0))
    assert decision.verdict == "unlike anything"
    assert decision.left == ()
    assert (decision.point is not None) == told
    assert not told or decision.point.beside == ()  # the fewest effects beside it


def test_what_the_form_of_a_strong_effect_may_be_off_by_is_nothing_at_a_point(looked_at):
    """1.645 times 5 % of what brings 9900, squared: 67, more than the 24 of the point."""
    looked_at["chance"] = 0.0004
    assert decide(found(100.0, 99.0, form=0.05)).verdict == "identified"


def test_a_mode_counts_as_lacking_amid_those_that_the_model_has():
    """Above the last one that it has, the model may just not reach."""
    own = SimpleNamespace(used=(np.array([0, 1, 3]), np.array([0, 1]), np.array([], dtype=int)))
    assert Evidence.lacking.fget(own) == ((0, 2),)
