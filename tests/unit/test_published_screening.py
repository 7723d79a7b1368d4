"""The screening of effects on the published campaign: what is tried, in which order, and what is said of it."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from updating.fitting.joint_fit import FittedParameter
from updating.published import screening as published_screening
from updating.published.campaign import read_published
from updating.published.screening import Screening, Tried, screen
from updating.published.tables import screening_csv, screening_table, survivors
from updating.published.verdict import published_verdict

DATA = read_published(Path(__file__).parents[2] / "data/pirnat2013")


def parameter(*, at_bound=False):
    return FittedParameter(
        name="a", unit="1", group="", value=1.0, std=0.1, interval=(0.8, 1.2), method="normal", lower=0.0,
        upper=1.0, at_bound=at_bound, determined=not at_bound, rank=1, gain=2.0,
    )  # fmt: skip


def tried(*effects, error, at_bound=False, note=""):
    return Tried(effects=effects, error=error, shared=(parameter(at_bound=at_bound),), note=note)


@pytest.fixture
def errors(monkeypatch):
    """Replace the fits: the error of each effect is given, a pair has the smaller one."""
    begun = []
    given = {"A": 0.1, "B": 0.03, "C": np.nan, "D": 0.12, "E": 0.2, "F": 0.15}
    stack = SimpleNamespace(effects=())
    one = SimpleNamespace(target=SimpleNamespace(stack=stack))
    monkeypatch.setattr(published_screening, "prepare_published", lambda *_, **__: ((one,), ()))

    class Fit:
        def __init__(self, effects):
            self.parameter = (parameter(),)
            self.error = lambda: min(given[e] for e in effects)

    def fit(_, settings, first, **__):
        effects = settings.effects
        begun.append((effects, first))
        if any(np.isnan(given[e]) for e in effects):
            message = "no mode of its class"
            raise published_screening.UpdatingError(message)
        return Fit(effects)

    monkeypatch.setattr(published_screening, "joint_fit", fit)
    return SimpleNamespace(names=list(given), begun=begun)


def test_a_pair_begins_where_the_better_of_the_two_ended(errors):
    screen(DATA, "C1", errors.names, seconds=60.0)
    assert dict(errors.begun)[("B",)] == {}
    assert dict(errors.begun)["B", "A"] == {"a": 1.0}


def test_all_are_tried_alone_then_the_best_with_each_then_the_next_best_among_themselves(errors):
    found = screen(DATA, "C1", errors.names, seconds=60.0).tried
    assert [t.effects for t in found[:6]] == [(name,) for name in errors.names]
    assert [t.effects for t in found[6:10]] == [("B", "A"), ("B", "D"), ("B", "F"), ("B", "E")]
    assert ("A", "D") in [t.effects for t in found[10:]]
    assert found[2].note == "no mode of its class"


def test_what_there_is_no_time_for_is_listed(errors):
    found = screen(DATA, "C1", errors.names, seconds=-1.0).tried
    assert len(found) == len(errors.names)
    assert all("not tried" in t.note for t in found)


def test_what_survives_is_said():
    one = Screening(calibration="C1", tried=(tried("A", error=0.039), tried("B", error=0.03, at_bound=True)))
    two = Screening(calibration="C0", tried=(tried("A", error=0.05), tried("B", error=0.04)))
    assert "under C1, C0: A; under some of them: B." in survivors([one, two])
    text = screening_csv([one, two]).decode()
    assert "C1,B,0.03,True,a = 1 1," in text
    table = screening_table([one, two])
    assert list(table.columns[0].cells) == ["B", "A"]
    assert list(table.columns[1].cells) == ["3.00!", "3.90"]


def test_the_verdict_names_what_stands_out_and_says_what_is_left():
    far = [tried("C", error=0.15), tried("D", error=0.14)]
    alone = Screening(calibration="C1", tried=(tried("A", error=0.033), *far, tried("A", "C", error=0.032)))
    said = published_verdict([alone], DATA.table)
    assert said.startswith(
        "C1: identified: A. The error falls from 15.0% to 3.3%; the next, D, leaves 14.0%."
    )
    assert "No pair that was tried calls for a second effect: the best, A with C, leaves 3.2%." in said
    assert "without a result" not in said
    assert "16 times what a frequency is known to" in said
    cut = (*alone.tried, tried("A", "D", error=np.nan, note="not tried: the time was over"))
    assert "Pairs without a result: 1." in published_verdict(
        [Screening(calibration="C1", tried=cut)], DATA.table
    )
    close = Screening(calibration="C1", tried=(tried("A", error=0.033), tried("B", error=0.034), *far))
    assert published_verdict([close], DATA.table).startswith("C1: one of: A or B.")
    bound = Screening(calibration="C1", tried=(tried("A", error=0.033, at_bound=True), *far))
    assert "unlike anything" in published_verdict([bound], DATA.table)
    two = Screening(calibration="C1", tried=(tried("A", error=0.08), *far, tried("A", "D", error=0.01)))
    assert "A second effect is called for: A with D leave 1.0%" in published_verdict([two], DATA.table)
