"""What no term describes, as a rival of every term: on a chain of masses with a hidden mass or spring."""

import numpy as np
import pytest

from tests.unit.test_inference import TERM, matrices, measured
from tests.unit.test_inference_search import SHARES, Choice, searched, states
from updating.inference.beside import Beside
from updating.inference.decide import decide
from updating.inference.search import Search, begin, search
from updating.inference.unlisted import _change, unlisted_gain


def with_mass(at, size):
    """Measured states of the chain with a mass at one point that no term has."""
    given = []
    for i, stiffer in enumerate((0.0, 1e-4)):
        stiffness, mass, _ = matrices({"stiffness": stiffer})
        mass[at, at] += size
        given.append(measured(stiffness, mass, seed=i, name="AB"[i]))
    return tuple(given)


def of_base(given):
    model = Choice(given, (TERM,))
    common, base = begin(model, shares=SHARES, starts=[np.zeros(2)])
    return model, common, base


def test_a_change_that_no_term_describes_raises_the_evidence_and_nothing_does_not():
    model, common, base = of_base(with_mass(22, 1.0))
    assert unlisted_gain(base, common, model.states) > 10.0
    model, common, base = of_base(states(0.0))
    assert unlisted_gain(base, common, model.states) < 0.0


def test_what_only_resembles_the_hidden_is_not_named(monkeypatch):
    """Without the rival, the term that comes nearest would be named if it predicted better."""
    model, common, base = of_base(with_mass(10, 1.0))
    monkeypatch.setattr(Search, "helps", lambda *_: True)
    found = search(model, common, base, say=lambda _: None)
    decision = decide(found)
    assert found.refused
    assert (decision.verdict, decision.left, decision.unlisted) == ("unlike anything", (), "refused")
    monkeypatch.setattr(Search, "odds_unlisted", lambda *_: -np.inf)
    assert search(model, common, base, say=lambda _: None).chosen.terms == ("spot",)


def test_a_term_that_is_needed_beside_the_rival_is_named_in_part(monkeypatch):
    """A mass at another height than the term's: something unlisted does better, and the term beside it does best."""
    model, common, base = of_base(states(0.4))
    likelier = lambda among, at, changed=(): 1e6 + (100.0 if at.terms else 0.0)  # noqa: E731
    monkeypatch.setattr(Search, "odds_unlisted", likelier)
    found = search(model, common, base, say=lambda _: None)
    assert found.chosen.terms == ("spot",)
    assert decide(found).verdict == "partly explained"
    monkeypatch.setattr(Search, "odds_unlisted", lambda *_: 1e6)
    assert search(model, common, base, say=lambda _: None).chosen.terms == ()


def test_what_is_left_of_several_terms_is_weighed_against_the_rival_too(monkeypatch):
    """The step to several terms was weighed; a part of them that remains was not."""
    model, common, base = of_base(with_mass(10, 1.0))
    monkeypatch.setattr(Search, "helps", lambda *_: True)
    part = frozenset({"spot"})
    monkeypatch.setattr("updating.inference.search._needed", lambda model, common, among, fitted, chosen: fitted[part])
    found = search(model, common, base, say=lambda _: None)
    assert found.refused
    assert found.chosen.terms == ()


def test_the_right_term_beats_the_rival_and_leaves_nothing_to_it():
    found = searched(0.4, (TERM,))
    decision = decide(found)
    assert (decision.verdict, decision.unlisted) == ("identified", None)
    assert found.odds(found.chosen) > found.odds_unlisted(found.base, ["spot"])
    assert unlisted_gain(found.chosen, found.setting, found.measured) < 1.0


def test_the_rival_of_a_strong_change_in_one_direction_fits_it_nearly_as_well():
    """Errors that are linear in the direction gave it 52 where the right term has 36,304."""
    found = searched(0.4, (TERM,))
    behind = found.odds(found.chosen) - found.odds_unlisted(found.base, ["spot"])
    assert 4.0 < behind < 100.0


@pytest.mark.parametrize("of_mass", [False, True])
def test_derivatives_of_a_model_with_a_change_beside_it_are_those_of_differences(of_mass):
    model, _, base = of_base(states(0.2))
    beside = Beside(base, model.states, of_mass, -1.0)
    n, m = base.x.size, base.errors[1].value.shape[1]
    draw = np.random.default_rng(4)
    x = np.concatenate([base.x + 1e-3, 0.05 * draw.standard_normal(m)])
    step = 1e-6 * draw.standard_normal(n + m)
    before, here, after = (beside.modal(at, 1) for at in (x - step, x, x + step))
    by_step = np.einsum("q,qss->s", step[here.moves], here.stiffness)
    by_step -= here.eigenvalue * np.einsum("q,qss->s", step[here.moves], here.mass)
    np.testing.assert_allclose((after.eigenvalue - before.eigenvalue) / 2.0, by_step, rtol=1e-4)


def test_a_rival_in_states_that_do_not_differ_from_the_model_gains_nothing():
    given = (*states(0.0)[:1], *with_mass(22, 1.0)[1:])
    model, common, base = of_base(given)
    both, one, other = (unlisted_gain(base, common, model.states, among) for among in (None, [1], [0]))
    assert one > both
    assert one > other + 3.0


@pytest.mark.parametrize("of_mass", [False, True])
def test_derivatives_by_the_direction_are_those_of_differences(of_mass):
    _, _, base = of_base(states(0.2))
    change = _change(base.errors, None, of_mass, -1.0)
    direction, step = np.random.default_rng(2).standard_normal((2, base.errors[0].value.shape[1]))
    ends = [change.at(direction + sign * 1e-6 * step)[0] for sign in (1.0, -1.0)]
    np.testing.assert_allclose((ends[0] - ends[1]) / 2e-6, change.at(direction)[1] @ step, rtol=1e-6, atol=1e-8)
