"""Which explanation of many specimens leads, what is not told from it, and the verdict."""

from dataclasses import replace

import numpy as np
import pytest

from updating.pooled.verdict import not_told_apart, verdict_of
from updating.results.pooled_answer import Part, PooledRanked


def ranked(*effects, odds=30.0, error=0.002):
    parts = (
        Part(
            effect=effect, level="rig", of="", specimens=("S1", "S2"), label=effect, scatter=0.0,
            parameter=(), log_odds=20.0,
        )
        for effect in effects
    )  # fmt: skip
    return PooledRanked(
        parts=tuple(parts), log_odds=odds, probability=0.9, frequency_error=error, left_out_error=error,
        left_out_torque_error=error, left_out_score=10.0 if effects else 0.0, relieves=False,
    )  # fmt: skip


BASE = ranked(odds=0.0, error=0.12)
INERTIA = ranked("clamp_inertia")
UNSEEN = replace(ranked("clamp_inertia", error=0.115), left_out_score=-1.0)
ONE = tuple(replace(part, level="specimen") for part in INERTIA.parts)


@pytest.mark.parametrize(
    ("first", "adequate", "n_near", "verdict"),
    [
        (INERTIA, True, 1, "identified"),
        (INERTIA, True, 2, "one of"),
        (replace(INERTIA, log_odds=2.0), True, 1, "unlike anything"),
        (replace(INERTIA, left_out_score=-1.0), True, 1, "identified"),  # all told the base model so, too
        (UNSEEN, True, 1, "unlike anything"),
        (replace(UNSEEN, relieves=True), True, 1, "identified"),
        (replace(UNSEEN, relieves=True, parts=ONE), True, 1, "unlike anything"),
        (ranked("clamp_inertia", error=0.03), False, 1, "partly explained"),
        (ranked("clamp_inertia", error=0.11), False, 1, "unlike anything"),
    ],
)
def test_the_verdict_asks_for_odds_prediction_and_what_remains(first, adequate, n_near, verdict):
    assert verdict_of(first, BASE, adequate=(adequate, False), n_near=n_near) == verdict


def test_nothing_is_missing_where_the_base_model_is_adequate_itself():
    found = [verdict_of(UNSEEN, BASE, adequate=(True, adequate), n_near=1) for adequate in (True, False)]
    assert found == ["nothing missing", "unlike anything"]


EDGE = ranked("edge_pressure", odds=40.0, error=0.048)
ROLL = ranked("clamp_inertia", odds=34.0, error=0.042)
BOTH = ranked("edge_pressure", "clamp_inertia", odds=33.0, error=0.03)
WEAK = ranked("waviness", odds=3.0, error=0.01)
SCATTER = 0.002 * np.array([1.0, -1.0, 0.5, -0.5])


def errors(ranking):
    return [own.left_out_error + SCATTER * k for k, own in enumerate(ranking)]


def test_odds_lead_where_a_model_is_nearly_right():
    ranking = (EDGE, ROLL, BASE)
    assert not_told_apart(ranking, BASE, errors(ranking), adequate=True) == [0]
    assert not_told_apart(
        (EDGE, replace(ROLL, log_odds=38.0), BASE), BASE, errors(ranking), adequate=True
    ) == [
        0,
        1,
    ]


def test_the_best_prediction_leads_where_none_is():
    ranking = (EDGE, ROLL, BOTH, WEAK, BASE)
    assert not_told_apart(ranking, BASE, errors(ranking), adequate=False) == [
        1,
        0,
    ]  # odds of the first are the largest


def test_what_predicts_as_well_within_its_scatter_is_not_told_from_the_first():
    ranking = (replace(EDGE, left_out_error=0.0425), replace(EDGE, log_odds=36.0), replace(ROLL), BASE)
    found = not_told_apart(ranking, BASE, errors(ranking), adequate=False)
    assert found[0] == 2
    assert 1 not in found


@pytest.mark.parametrize(("error", "leads"), [(0.03, True), (0.04, False)])
def test_an_explanation_of_more_effects_leads_where_it_halves_the_error(error, leads):
    """Odds count little what a model misses alike in all specimens: an inertia beside a law of pressure."""
    law = replace(ROLL, log_odds=40.0, left_out_error=0.065)
    ranking = (law, replace(BOTH, log_odds=37.0, left_out_error=error), BASE)
    found = not_told_apart(ranking, BASE, errors(ranking), adequate=False)
    assert (found[0] == 1) == leads
    assert found == ([1] if leads else [0])  # what leaves twice as much is not "as well", whatever its odds


def test_an_explanation_that_is_not_believed_leads_nowhere():
    assert not_told_apart(
        (replace(EDGE, left_out_score=-1.0, parts=ONE), BASE), BASE, errors((EDGE, BASE)), adequate=False
    ) == [0]
