"""The five verdicts, and when a further effect beside a strong one is named."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.special import ndtri

from updating.diagnosis import verdict
from updating.diagnosis.calibration import (
    HALVES,
    HELPS,
    MODEL_FORM,
    OVERRULED,
    P_ADEQUATE,
    SEPARATE,
    SHOWS,
    STRAINED,
    SURE,
    VISIBLE,
)
from updating.diagnosis.discrepancy import MEDIAN, SPREAD, Sizes
from updating.diagnosis.evidence import DiagnosisScatter, Evidence
from updating.diagnosis.held_out import LeftOut
from updating.diagnosis.hypotheses import STATED_PLACE
from updating.diagnosis.search import Search, is_form, log_odds
from updating.diagnosis.verdict import decide

EFFECTS = tuple("abcdefgh")
PRICE = float(np.log(0.5 / len(EFFECTS)))
"""Logarithm of the prior odds of one effect."""


def explanation(
    effects, odds, *, misfit=100.0, losses=0.0, left_out=None, score=0.0, strain=0.0, left=None,
    at_a_point=0.0, between=0.0, known=9.0,
):  # fmt: skip
    """An explanation with the logarithm of its odds against the base model, and so many times the usual size left.

    What an effect leaves has nothing to do with what it takes away: `misfit` of frequencies, `losses` of damping. If
    nothing else is said, each effect halves the error of frequencies left out.
    """
    n = len(effects)
    left_out = (0.5**n, 1.0, 1.0) if left_out is None else left_out
    left = 1.1 - 0.1 * max(n, 1) if left is None else left
    value = np.zeros(4)
    value[0 if not effects else 1], value[2 if not effects else 3] = np.sqrt([misfit, losses])
    return SimpleNamespace(
        effects=tuple(effects),
        log_evidence=odds - PRICE * len(effects),
        misfit=misfit + losses,
        mean=Sizes(frequency=left * MEDIAN["frequency"]),
        residual=SimpleNamespace(value=value, kind=np.repeat(["frequency", "damping"], 2)),
        left_out=(*left_out, score),
        strain=strain,
        at_a_point=at_a_point,
        nuisance=np.array([known, between]),
    )


BASE = explanation("", 0.0, misfit=10_000.0, left_out=(1.0, 1.0, 1.0), strain=12.0, left=20.0)
TOO_MUCH, ENOUGH = (share * float(np.exp(SPREAD * ndtri(1.0 - P_ADEQUATE))) for share in (1.25, 0.75))
"""Times of the usual that a right model does not leave, and that it may: the one is not halved by the other."""
INADEQUATE = explanation("", 0.0, misfit=10_000.0, left_out=(1.0, 1.0, 1.0), strain=12.0, left=TOO_MUCH)
FINE = explanation("", 0.0, misfit=100.0, left_out=(1.0, 1.0, 1.0), strain=12.0)


@pytest.fixture(autouse=True)
def predicted(monkeypatch):
    """What is left out is said by `left_out` of each explanation, and what is left always looks like one point."""
    kinds = ("frequency", "damping", "shape")
    monkeypatch.setattr(
        verdict,
        "left_out",
        lambda _, own: LeftOut(**dict(zip(kinds, own.left_out, strict=False)), score=own.left_out[3:]),
    )
    monkeypatch.setattr(
        verdict, "point_change", lambda _, at: SimpleNamespace(beside=at.effects, log_odds=at.at_a_point)
    )


def found(*fitted, base=BASE, lacking=()):
    evidence = SimpleNamespace(
        effects=dict.fromkeys(EFFECTS),
        scatter=DiagnosisScatter(),
        lacking=lacking,
        hypotheses={},
        nuisances=("G_f", "G_f[M1]"),
        prior_std=np.ones(2),
    )
    return Search(evidence=evidence, base=base, fitted=fitted, screened=(), mixed_up=())


def names(explanations):
    return ["".join(own.effects) for own in explanations]


def test_odds_are_those_of_the_evidence_less_the_price_of_each_effect():
    own, evidence = explanation("ab", 7.0), SimpleNamespace(effects=dict.fromkeys(EFFECTS))
    assert log_odds(evidence, own, BASE) == pytest.approx(7.0)
    assert own.log_evidence == pytest.approx(7.0 + 2.0 * np.log(2.0 * len(EFFECTS)))


def test_nothing_is_missing_where_no_effect_shows_and_a_right_model_leaves_as_much():
    decision = decide(found(explanation("a", SHOWS - 0.1), base=FINE))
    assert (decision.verdict, decision.left, decision.point) == ("nothing missing", (), None)
    assert names(decision.steps) == [""]


def test_an_effect_that_shows_is_identified():
    decision = decide(found(explanation("a", 9.0), explanation("b", 9.0 - SEPARATE - 0.1)))
    assert decision.verdict == "identified"
    assert names(decision.left) == ["a"]
    assert names(decision.steps) == ["", "a"]
    assert decision.point is None


def test_what_is_nearly_as_probable_cannot_be_told_apart_and_the_most_probable_comes_first():
    fitted = [explanation("b", 8.5), explanation("a", 9.0), explanation("c", 7.0), explanation("d", 5.0)]
    decision = decide(found(*fitted))
    assert decision.verdict == "one of"
    assert names(decision.left) == ["a", "b", "c"]


@pytest.mark.parametrize(
    ("beside", "left", "helps"),
    [
        ((0.5, 1.0, 0.5), 0.55, False),  # shapes alone bring nobody a name beside another
        ((0.35, 1.0, 1.0), 0.55, True),
        ((0.5, 0.7, 1.0), 0.55, True),  # of damping alone
        ((2.0, 1.0, 1.0), 0.45, True),  # what halves that which is left
    ],
)
def test_each_of_several_effects_helps_beside_the_others(beside, left, helps):
    """`a` alone has modes left out at half the base model's error and as much as usual left, `b` stands beside it."""
    alone = explanation("a", 30.0, misfit=5000.0, left_out=(0.5, 1.0, 1.0))
    both = explanation("ab", 60.0, misfit=1.0, losses=4000.0, left_out=beside, left=left)
    other = explanation("b", 10.0, misfit=9000.0, left_out=(1.5, 1.5, 1.0), left=15.0)
    decision = decide(found(alone, other, both))
    assert names(decision.left)[0] == ("ab" if helps else "a")


def test_to_take_back_what_another_has_spoilt_is_no_help():
    """Each lowers the error of modes left out beside the others, and all together predict as badly as none."""
    far = {"left_out": (1.7, 0.9, 1.0), "left": 0.85 * TOO_MUCH, "strain": 12.0}
    one = explanation("c", 20.0, misfit=4000.0, **far)
    two = [explanation(pair, 30.0, misfit=3000.0, **far) for pair in ("ab", "ac", "bc")]
    useless = explanation(
        "abc", 60.0, misfit=100.0, left_out=(1.02, 0.85, 1.0), strain=12.0, left=0.45 * TOO_MUCH
    )
    decision = decide(found(one, *two, useless, base=INADEQUATE))
    assert (decision.verdict, decision.left) == ("unlike anything", ())


@pytest.mark.parametrize(
    ("effects", "above", "named"),
    [("b", OVERRULED + 0.1, []), ("b", OVERRULED - 0.1, ["a"]), ("ab", OVERRULED + 0.1, ["a"])],
)
def test_what_is_far_more_probable_overrules_what_has_none_of_its_effects(effects, above, named):
    """It predicts no better what is left out, so it is not named itself."""
    helpful = explanation("a", 30.0, left=ENOUGH)
    probable = explanation(effects, 30.0 + above, left_out=(1.0, 1.0, 1.0), strain=12.0, left=ENOUGH)
    decision = decide(found(helpful, probable, base=INADEQUATE))
    assert names(decision.left) == named


def test_what_is_far_more_probable_overrules_the_part_that_would_be_named():
    """`b` beside `a` may be no more than the error of its form; so `a` would be named alone, for all their odds."""
    alone = explanation("a", 500.0, misfit=1000.0, left=ENOUGH)
    both = explanation("ab", 530.0, misfit=300.0)
    probable = explanation("c", 500.0 + OVERRULED + 0.1, left_out=(1.0, 1.0, 1.0), strain=12.0, left=ENOUGH)
    assert names(decide(found(alone, both, base=INADEQUATE)).left) == ["a"]
    assert names(decide(found(alone, both, probable, base=INADEQUATE)).left) == []


def test_what_is_as_probable_and_does_not_help_is_not_listed():
    useless = explanation("b", 10.0, left_out=(1.0, 1.0, 1.0), strain=12.0, left=ENOUGH)
    decision = decide(found(explanation("a", 9.0), useless, base=INADEQUATE))
    assert decision.verdict == "identified"
    assert names(decision.left) == ["a"]


def test_what_only_adds_an_effect_to_another_says_nothing_new():
    """Beside two together, one of them alone may do, and others together; what is one of these and more may not."""
    fitted = [explanation("ab", 9.0), explanation("c", 8.0), explanation("cd", 8.5), explanation("ef", 8.2)]
    decision = decide(
        found(*fitted, explanation("a", 4.0, misfit=5000.0), explanation("b", 1.0, misfit=6000.0))
    )
    assert names(decision.left) == ["ab", "ef", "c"]


def test_unlike_anything_where_much_is_left_and_no_effect_shows():
    decision = decide(found(explanation("a", SHOWS - 0.1)))
    assert (decision.verdict, decision.left) == ("unlike anything", ())
    assert decision.point.beside == ()
    assert names(decision.steps) == [""]


@pytest.mark.parametrize(
    ("given", "helps"),
    [
        ({"left_out": (HELPS + 0.01, 1.0, 1.0)}, False),
        ({"left_out": (HELPS - 0.01, 1.0, 1.0)}, True),
        ({"left_out": (1.0, HELPS - 0.01, 1.0)}, True),  # of damping alone
        ({"left_out": (1.0, 1.0, HELPS - 0.01)}, True),  # of shapes alone
        ({"left_out": (np.nan, 1.0, 1.0)}, False),
        ({"left_out": (np.nan, np.nan, np.nan)}, True),  # where none can be left out, evidence decides
        ({"left_out": (1.0, 1.0, 1.0), "strain": 12.0 - STRAINED**2 - 0.1}, True),
        ({"left_out": (0.1, 1.0, 1.0), "score": -SHOWS - 0.1}, False),  # in all, it predicts worse
        ({"left_out": (1.0, 1.0, 1.0), "left": (HALVES - 0.01) * TOO_MUCH}, True),
    ],
)
def test_unlike_anything_where_what_shows_predicts_no_mode_that_it_has_not_seen(given, helps):
    own = explanation("a", 50.0, **({"strain": 12.0, "left": ENOUGH} | given))
    decision = decide(found(own, base=INADEQUATE))
    assert decision.verdict == ("identified" if helps else "unlike anything")
    assert names(decision.left) == (["a"] if helps else [])


@pytest.mark.parametrize(
    ("odds", "given", "named"),
    [
        (SURE - 0.1, {"left_out": (HALVES + 0.01, 1.0, 1.0)}, []),
        (SURE + 0.1, {"left_out": (HALVES + 0.01, 1.0, 1.0)}, ["a"]),
        (SURE - 0.1, {"left_out": (1.0, HALVES - 0.01, 1.0)}, ["a"]),  # of damping alone
        (SURE - 0.1, {"left_out": (1.0, 1.0, HALVES - 0.01)}, []),  # shapes alone are not so sure
        (SURE - 0.1, {"left_out": (np.nan, np.nan, np.nan)}, ["a"]),
        (SURE - 0.1, {"left_out": (1.0, 1.0, 1.0), "strain": 12.0 - STRAINED**2 - 0.1}, ["a"]),
        (SURE - 0.1, {"left_out": (1.0, 1.0, 1.0), "left": (HALVES - 0.01) * TOO_MUCH}, ["a"]),
    ],
)
def test_an_effect_that_halves_nothing_must_be_surer(odds, given, named):
    own = explanation("a", odds, **({"strain": 12.0, "left": ENOUGH} | given))
    assert names(decide(found(own, base=INADEQUATE)).left) == named


def test_unlike_anything_where_a_change_at_one_point_explains_more_than_the_best_effect():
    fitted = explanation("a", 20.0)
    for of_point, expected in ((20.0, "identified"), (20.0 + SEPARATE + 1.0, "unlike anything")):
        base = explanation("", 0.0, misfit=10_000.0, left_out=(1.0, 1.0, 1.0), left=20.0, at_a_point=of_point)
        decision = decide(found(fitted, base=base))
        assert decision.verdict == expected
        assert (decision.point is None) == (expected == "identified")


def test_what_every_test_strains_is_no_relief():
    """Of what is known of steel and dimensions, some is off by two deviations; further off it asks for a reason."""
    for known, expected in ((STRAINED - 0.1, "unlike anything"), (STRAINED + 0.1, "identified")):
        base = explanation("", 0.0, left_out=(1.0, 1.0, 1.0), strain=12.0, left=TOO_MUCH, known=known)
        relieved = 12.0 - STRAINED**2 - 0.1
        relieving = explanation("a", 50.0, left_out=(1.0, 1.0, 1.0), strain=relieved, left=ENOUGH)
        assert decide(found(relieving, base=base)).verdict == expected


@pytest.mark.parametrize(
    ("left_out", "expected"),
    [
        ((1.1, 1.1, 0.5), "a"),
        ((HELPS + 0.01, 1.1, 0.5), "a"),
        ((HELPS - 0.01, 1.1, 0.5), "ab"),
        ((1.1, HELPS - 0.01, 0.5), "ab"),
    ],
)
def test_several_effects_that_meet_shapes_alone_are_met_by_chance(left_out, expected):
    together = explanation("ab", SHOWS + 60.0, left_out=left_out, strain=12.0)
    alone = explanation("a", SHOWS + 30.0, misfit=1000.0, left_out=(1.0, 1.0, 0.5))
    decision = decide(found(alone, together))
    assert names(decision.left) == [expected]


def test_what_is_named_must_itself_help():
    """Two effects help, but the second may be no more than the error of the first one's form, which does not."""
    first = explanation("a", 500.0, misfit=1000.0, left_out=(1.0, 1.0, 0.9), strain=12.0, left=ENOUGH)
    both = explanation("ab", 530.0, misfit=300.0, left_out=(0.5, 1.0, 0.9), strain=12.0)
    assert decide(found(first, both, base=INADEQUATE)).verdict == "unlike anything"


def test_several_effects_may_relieve_what_differs_between_torques():
    strained = explanation(
        "", 0.0, misfit=10_000.0, left_out=(1.0, 1.0, 1.0), left=20.0, between=STRAINED + 1.0
    )
    together = explanation("ab", SHOWS + 60.0, left_out=(1.1, 1.1, 0.5))
    first = explanation("a", SHOWS + 30.0, misfit=1000.0)
    assert decide(found(first, together, base=strained)).verdict == "identified"


def test_one_effect_may_be_seen_in_shapes_alone():
    assert decide(found(explanation("a", SHOWS + 30.0, left_out=(1.1, 1.1, 0.5)))).verdict == "identified"


def test_partly_explained_where_what_remains_is_more_than_a_right_model_leaves():
    decision = decide(found(explanation("a", 50.0, left=6.0), explanation("b", 49.0)))
    assert decision.verdict == "partly explained"
    assert names(decision.left) == ["a", "b"]
    assert decision.point.beside == ("a",)


@pytest.mark.parametrize(
    ("fitted", "base", "expected"),
    [((), FINE, "unlike anything"), ((explanation("a", 9.0),), BASE, "partly explained")],
)
def test_a_model_that_lacks_a_measured_mode_is_not_complete(fitted, base, expected):
    assert decide(found(*fitted, base=base, lacking=((0, 2),))).verdict == expected


def test_a_weak_effect_beside_a_strong_one_may_be_no_more_than_the_error_of_its_form():
    """The strong one brings 9000 of the misfit; 9 % of that may be left by its form."""
    for beside, left, verdict_of, first in (
        (300.0, 1.0, "identified", "a"), (300.0, 6.0, "partly explained", "a"), (100.0, 1.0, "identified", "ab")
    ):  # fmt: skip
        strong = explanation("a", 500.0, misfit=1000.0, left=left)
        decision = decide(found(strong, explanation("ab", 530.0, misfit=beside)))
        assert decision.verdict == verdict_of
        assert names(decision.left)[0] == first
        assert names(decision.steps) == ["", "a", "ab"]


def test_the_error_of_form_is_a_share_of_what_is_explained_and_the_base_model_has_none():
    least = MODEL_FORM**2 * 9000.0
    strong = explanation("a", 500.0, misfit=1000.0)
    assert is_form(BASE, strong, explanation("ab", 0.0, misfit=1000.0 - 0.99 * least))
    assert not is_form(BASE, strong, explanation("ab", 0.0, misfit=1000.0 - 1.01 * least))
    assert not is_form(BASE, BASE, explanation("a", 0.0, misfit=9999.0))


def test_a_loss_beside_what_changes_frequencies_is_no_error_of_its_form():
    strong = explanation("a", 500.0, misfit=1000.0, losses=50.0)
    for brought, form in ((0.9 * VISIBLE**2, True), (1.1 * VISIBLE**2, False)):
        loss = explanation("ab", 510.0, misfit=1000.0, losses=50.0 - brought)
        assert is_form(BASE, strong, loss) is form
        assert names(decide(found(strong, loss)).left)[0] == ("a" if form else "ab")


def test_what_brings_more_than_an_error_of_form_goes_before_what_fits_it_better():
    """Of two that are nearly as probable beside a strong one, that which its form cannot have left is named."""
    strong = explanation("a", 500.0, misfit=1000.0, losses=50.0)
    filler, loss = (
        explanation("ab", 512.0, misfit=900.0, losses=50.0),
        explanation("ac", 510.0, misfit=1000.0),
    )
    decision = decide(found(strong, filler, loss))
    assert names(decision.left) == ["ac"]
    assert names(decision.steps) == ["", "a", "ac"]
    both = explanation("abc", 525.0, misfit=900.0)
    decision = decide(found(strong, filler, loss, both))
    assert names(decision.left) == ["ac"]
    assert names(decision.steps) == ["", "a", "ac", "abc"]


def test_what_relieves_the_difference_between_torques_is_no_error_of_form():
    strong = explanation("a", 500.0, misfit=1000.0, strain=STRAINED**2 + 1.0)
    assert is_form(BASE, strong, explanation("ab", 530.0, misfit=990.0, strain=2.0))
    assert not is_form(BASE, strong, explanation("ab", 530.0, misfit=990.0, strain=0.5))
    decision = decide(found(strong, explanation("ab", 530.0, misfit=990.0, strain=0.5)))
    assert names(decision.left) == ["ab"]


def test_what_relieves_the_steel_beside_misplaced_clamps_may_be_an_error_of_their_form():
    placed = explanation([STATED_PLACE], 350.0, misfit=1000.0, strain=45.0)
    beside = explanation([STATED_PLACE, "a"], 365.0, misfit=990.0, strain=30.0)
    assert is_form(BASE, placed, beside)
    assert not is_form(BASE, placed, explanation([STATED_PLACE, "a"], 365.0, misfit=100.0, strain=30.0))


def test_of_two_that_cannot_be_told_apart_the_one_with_fewer_effects_comes_first():
    simple = explanation("a", 20.0, misfit=5000.0)
    decision = decide(found(explanation("ab", 20.0 + SEPARATE - 0.1, misfit=300.0), simple))
    assert (decision.verdict, names(decision.left)) == ("one of", ["a", "ab"])
    assert names(decide(found(explanation("ab", 20.1 + SEPARATE, misfit=300.0), simple)).left) == ["ab"]


def test_the_way_goes_by_the_effect_that_raises_the_odds_most():
    fitted = [explanation("a", 20.0, misfit=6000.0), explanation("b", 5.0, misfit=7000.0)]
    fitted += [explanation("ab", 40.0, misfit=3000.0), explanation("bc", 35.0, misfit=3100.0)]
    decision = decide(found(*fitted, explanation("abc", 60.0, misfit=10.0)))
    assert names(decision.steps) == ["", "a", "ab", "abc"]
    assert decision.verdict == "identified"


def test_a_mode_counts_as_lacking_amid_those_that_the_model_has():
    """Above the last one that it has, the model may just not reach."""
    own = SimpleNamespace(used=(np.array([0, 1, 3]), np.array([0, 1]), np.array([], dtype=int)), mixed=())
    assert Evidence.lacking.fget(own) == ((0, 2),)


def test_a_mode_that_close_modes_of_the_model_span_is_not_lacking():
    own = SimpleNamespace(
        used=(np.array([0, 3]), np.array([0, 2])), mixed=(np.array([1]), np.array([], dtype=int))
    )
    assert Evidence.lacking.fget(own) == ((0, 2), (1, 1))


@pytest.mark.parametrize(
    ("left", "stated", "strain", "expected"),
    [
        (0.45, None, 12.0, "nothing missing"),
        (0.4, None, 12.0, "identified"),
        (0.45, 1e-3, 12.0, "identified"),  # who states a discrepancy trusts the model that far
        (0.45, None, 2.0, "identified"),  # what is known far better than the model is off by
    ],
)
def test_what_takes_next_to_nothing_off_is_of_no_matter_however_sure(left, stated, strain, expected):
    base = explanation("", 0.0, left_out=(1.0, 1.0, 1.0), strain=12.0, left=0.5)
    given = found(explanation("a", 40.0, left=left, strain=strain), base=base)
    given.evidence.scatter = DiagnosisScatter(frequency=stated)
    assert decide(given).verdict == expected


@pytest.mark.parametrize(("strain", "expected"), [(2.0, "unlike anything"), (-10.0, "identified")])
def test_what_a_hypothesis_about_the_measurement_frees_is_no_merit_of_the_effects_beside_it(strain, expected):
    """Here ``s`` supposes a gain; with two effects beside it nothing is predicted better."""
    supposed = explanation("s", 4.0, left_out=(1.0, 1.0, 1.0), strain=2.0, left=TOO_MUCH, misfit=9000.0)
    beside = explanation("sab", 60.0, left_out=(1.1, 1.1, 0.5), strain=strain, left=ENOUGH, misfit=10.0)
    given = found(supposed, beside, base=INADEQUATE)
    given.evidence.hypotheses = {"s": {}}
    assert decide(given).verdict == expected
