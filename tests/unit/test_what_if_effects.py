"""What can be tried in the workbench: effects in an order that matters, sliders in groups and what they are set to."""

import asyncio
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from model import catalogue
from updating.diagnosis.answer import Diagnosis, Ranked
from updating.fitting.estimate import ParameterEstimate
from updating.report.results import Results
from updating.workbench import diagnosis_room, what_if_effects
from updating.workbench.diagnosis_room import CHANGES
from updating.workbench.what_if import Knob
from updating.workbench.what_if_effects import (
    FIRST,
    NEXT,
    effect_choices,
    fitted_values,
    found_values,
    slider_rows,
)

MASS = ParameterEstimate(
    name="clamp_added_mass", unit="kg", value=0.3, lower=0.1, upper=0.5, at_bound=False
)  # fmt: skip


def ranked(*effects, parameter=()):
    made = dict.fromkeys(Ranked.__dataclass_fields__, 0.0)
    return Ranked(**made | {"effects": effects, "parameter": parameter})


def results(**given):
    empty = {
        "name": "campaign", "tested": (), "table": (), "shape_class": (), "missing": (), "ledger": (),
        "diagnosis": None, "updated": None, "pooled": None, "folder": Path("out/x"), "campaign": None, "origin": {},
    }  # fmt: skip
    return Results(**(empty | given))


def diagnosed():
    made = dict.fromkeys(Diagnosis.__dataclass_fields__, ())
    ranking = (ranked("clamp_mass", parameter=(MASS,)), ranked("weld_seam"), ranked())
    return Diagnosis(**made | {"set": (("clamp_mass",),), "ranking": ranking})


def test_what_was_found_comes_first_then_what_was_tried_then_all_others_by_family():
    listed = effect_choices(results(diagnosis=diagnosed()))
    assert [own["value"] for own in listed[:2]] == ["clamp_mass", "weld_seam"]
    assert FIRST in listed[0]["subtitle"]
    assert NEXT in listed[1]["subtitle"]
    assert {own["value"] for own in listed} == set(catalogue())
    families = [own["subtitle"] for own in listed[2:]]
    assert families == sorted(families)
    assert len(effect_choices(results())) == len(listed)


def knob(name):
    return Knob(name=name, unit="1", lower=0.0, upper=1.0, start=0.5, logarithmic=False)


def test_sliders_stand_in_groups_with_a_heading_each():
    rows = slider_rows(
        [knob(n) for n in ("G_f", "d_f", "pressure", "clamp_added_mass", "middle_loss")],
        ["clamp_mass", "lost_contact_middle"],
    )
    assert [own["head"] for own in rows] == [
        "contact, of the base model", "", "",
        f"{catalogue()['clamp_mass'].label} (inertia)", "lost contact in the middle (pressure field)",
    ]  # fmt: skip
    assert [own["free"] for own in rows] == [True, True, False, True, True]


def test_sliders_are_set_to_the_answer_with_contact_fitted_to_the_configuration(monkeypatch):
    def fitted(G_f):
        value = SimpleNamespace(G_f=SimpleNamespace(value=G_f), d_f=SimpleNamespace(value=1e-11))
        return SimpleNamespace(fit=value)

    tested = tuple(
        SimpleNamespace(name=name, identified=fitted(g)) for name, g in (("M1", 900.0), ("M2", 950.0))
    )
    given = results(diagnosis=diagnosed(), tested=tested)
    monkeypatch.setattr(what_if_effects, "with_identified_models", lambda own: own)
    assert found_values(given, "M2") == (
        ("clamp_mass",), {"clamp_added_mass": 0.3, "G_f": 950.0, "d_f": 1e-11}
    )  # fmt: skip
    assert found_values(results(), "M2") == ((), {})


def test_sliders_follow_a_fit_with_what_is_shared_and_what_is_the_configurations_own():
    parameters = [
        SimpleNamespace(name=name, group=group, value=value)
        for name, group, value in (
            ("clamp_added_mass", "", 0.3), ("G_f", "stack", 900.0), ("d_f", "M1", 1e-11), ("d_f", "M2", 2e-11)
        )
    ]  # fmt: skip
    assert fitted_values(parameters, "M2", ["M1", "M2"]) == {
        "clamp_added_mass": 0.3, "G_f": 900.0, "d_f": 2e-11
    }  # fmt: skip


class State(SimpleNamespace):
    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass

    def dirty(self, *_):
        pass


@pytest.mark.parametrize("word", CHANGES)
def test_what_is_about_to_be_replaced_is_grey_and_says_so_until_the_command_has_ended(word, monkeypatch):
    state = State(stale="", said=[], running="")
    own = diagnosis_room._Commands(state, SimpleNamespace(results=results))
    monkeypatch.setattr(diagnosis_room, "opening", lambda _: SimpleNamespace(badge="", sentence=""))

    async def run(words, done):
        assert state.stale == CHANGES[word]
        await done(0)

    own.command = SimpleNamespace(run=run)

    async def whole():
        own.start([word, "campaign.toml"])
        assert state.stale == CHANGES[word]
        await own._task

    asyncio.run(whole())
    assert state.stale == ""
    assert not state.has_changes


def test_a_report_makes_nothing_grey(monkeypatch):
    state = State(stale="", said=[], running="")
    own = diagnosis_room._Commands(state, SimpleNamespace(results=results))

    async def run(*_):
        pass

    own.command = SimpleNamespace(run=run)

    async def whole():
        own.start(["report", "out"])
        await own._task

    asyncio.run(whole())
    assert state.stale == ""


def test_results_that_belong_to_earlier_modes_are_left_out_and_said(monkeypatch):
    state = State()
    monkeypatch.setattr(diagnosis_room, "opening", lambda _: SimpleNamespace(badge="", sentence=""))
    given = replace(results(), remarks=("M1/fit.json comes from another modal_model.json than is here.",))
    diagnosis_room._Commands(state, SimpleNamespace(results=lambda: given)).refresh()
    assert state.remarks == ["M1/fit.json comes from another modal_model.json than is here."]
    assert (state.has_steps, state.has_changes) == (False, False)
