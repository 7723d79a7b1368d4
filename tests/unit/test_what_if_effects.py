"""What can be tried in the workbench: effects in an order that matters, sliders in groups and what they are set to."""

import asyncio
import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from model import Contact, catalogue, read_stack
from updating.diagnosis.answer import Diagnosis, Ranked
from updating.fitting.fit import ParameterEstimate
from updating.report.results import Results
from updating.workbench import comparison_panel, diagnosis_panel, identification_panel, what_if_panel
from updating.workbench.diagnosis_panel import CHANGES
from updating.workbench.what_if import FIRST, NEXT, Knob, effect_choices, explanation, slider_rows, values_of
from updating.workbench.what_if_panel import fitted_sentence

MASS = ParameterEstimate(
    name="clamp_added_mass", unit="kg", value=0.3, lower=0.1, upper=0.5, at_bound=False
)  # fmt: skip


def ranked(*effects, parameter=()):
    made = dict.fromkeys(Ranked.__dataclass_fields__, 0.0)
    return Ranked(**made | {"effects": effects, "parameter": parameter})


def results(**given):
    empty = {
        "name": "campaign", "tested": (), "missing": (), "ledger": (),
        "diagnosis": None, "updated": None, "pooled": None, "folder": Path("out/x"), "campaign": None, "origin": {},
    }  # fmt: skip
    return Results(**(empty | given))


def diagnosed():
    made = dict.fromkeys(Diagnosis.__dataclass_fields__, ())
    ranking = (ranked("clamp_mass", parameter=(MASS,)), ranked("weld_seam"), ranked())
    return Diagnosis(**made | {"set": (("clamp_mass",),), "ranking": ranking})


def test_what_was_found_comes_first_then_what_was_tried_then_all_others_by_family():
    listed = effect_choices(results(diagnosis=diagnosed()))
    assert [one["value"] for one in listed[:2]] == ["clamp_mass", "weld_seam"]
    assert FIRST in listed[0]["subtitle"]
    assert NEXT in listed[1]["subtitle"]
    assert {one["value"] for one in listed} == set(catalogue())
    families = [one["subtitle"] for one in listed[2:]]
    assert families == sorted(families)
    assert len(effect_choices(results())) == len(listed)


def knob(name):
    return Knob(name=name, unit="1", lower=0.0, upper=1.0, start=0.5, logarithmic=False)


def test_sliders_stand_in_groups_with_a_heading_each():
    rows = slider_rows(
        [knob(n) for n in ("G_f", "d_f", "pressure", "clamp_added_mass", "middle_loss")],
        ["clamp_mass", "lost_contact_middle"],
    )
    assert [one["head"] for one in rows] == [
        "contact, of the base model", "", "",
        f"{catalogue()['clamp_mass'].label} (inertia)", "lost contact in the middle (pressure field)",
    ]  # fmt: skip


def stack():
    contact = Contact(G_f=1000.0, d_f=1e-11, pressure=2e5, normal_modulus=1e12)
    given = read_stack(Path(__file__).parents[2] / "data/demo_stack/stack.toml")
    return replace(given, contact=contact)


def test_sliders_are_set_to_what_the_diagnosis_fitted_for_the_configuration():
    one = replace(ranked("clamp_mass", parameter=(MASS,)), nuisance={"G_f": 0.1, "G_f[M2]": 0.02, "d_f": -0.5})
    given = results(diagnosis=replace(diagnosed(), stack=stack(), ranking=(one,)))
    assert values_of(given, "M2", ["clamp_mass"]) == pytest.approx(
        {"G_f": 1000.0 * math.exp(0.12), "d_f": 1e-11 * math.exp(-0.5), "clamp_added_mass": 0.3}
    )
    assert values_of(given, "M1", ["clamp_mass"])["G_f"] == pytest.approx(1000.0 * math.exp(0.1))
    assert values_of(results(), "M2", ["clamp_mass"]) == {}


def test_an_answer_counts_with_what_it_says_of_the_measurement_and_others_as_they_were_fitted():
    with_place = ranked("clamp_mass", "stated_place")
    given = replace(
        diagnosed(), set=(with_place.effects,), measurement=("stated_place",),
        ranking=(with_place, ranked("weld_seam"), ranked()),
    )  # fmt: skip
    assert explanation(results(diagnosis=given), ["clamp_mass"]) is with_place
    assert explanation(results(diagnosis=given), []) is given.ranking[2]
    assert explanation(results(diagnosis=given), ["weld_seam"]) is given.ranking[1]
    assert explanation(results(diagnosis=given), ["glue"]) is None
    assert explanation(results(), []) is None


def test_what_a_fit_changed_is_said_with_the_numbers_of_the_diagnosis():
    base, one = ranked(), ranked("clamp_mass", parameter=(MASS,))
    base = replace(base, frequency_error=0.043, left_out_error=0.15)
    one = replace(one, frequency_error=0.00039, left_out_error=0.00093)
    text = fitted_sentence(results(diagnosis=replace(diagnosed(), ranking=(one, base))), ["clamp_mass"])
    assert text == (
        "Mean frequency error 4.3 % before and 0.039 % after the fit, of modes left out 15 % and 0.093 %; "
        "clamp_added_mass = 300 g (100 g to 500 g)."
    )


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
    one = diagnosis_panel._Commands(state, SimpleNamespace(results=results))
    monkeypatch.setattr(diagnosis_panel, "opening", lambda _: SimpleNamespace(badge="", sentence=""))

    async def run(words, done):
        assert state.stale == CHANGES[word]
        await done(0)

    one.command = SimpleNamespace(run=run)

    async def whole():
        one.start([word, "campaign.toml"])
        assert state.stale == CHANGES[word]
        await one._task

    asyncio.run(whole())
    assert state.stale == ""
    assert not state.has_changes


@pytest.mark.parametrize(
    ("panel", "flag"),
    [(identification_panel, "stabilizing"), (comparison_panel, "comparing"), (what_if_panel, "preparing")],
)
def test_what_a_panel_holds_is_grey_until_it_has_read_the_configuration_that_is_chosen(panel, flag):
    entered = []

    class Page(State):
        def update(self, given):
            vars(self).update(given)

        def change(self, *names):
            return entered.append if "panel" in names else lambda call: call

    state = Page()
    panel.panel(SimpleNamespace(state=state, controller=SimpleNamespace()), None)
    assert getattr(state, flag)
    setattr(state, flag, False)
    entered[0](panel="Measurement", configuration="M2")
    assert getattr(state, flag)


def test_a_report_makes_nothing_grey(monkeypatch):
    state = State(stale="", said=[], running="")
    one = diagnosis_panel._Commands(state, SimpleNamespace(results=results))

    async def run(*_):
        pass

    one.command = SimpleNamespace(run=run)

    async def whole():
        one.start(["report", "out"])
        await one._task

    asyncio.run(whole())
    assert state.stale == ""


def test_results_that_belong_to_earlier_modes_are_left_out_and_said(monkeypatch):
    state = State()
    monkeypatch.setattr(diagnosis_panel, "opening", lambda _: SimpleNamespace(badge="", sentence=""))
    given = replace(results(), remarks=("M1/fit.json comes from another modal_model.json than is here.",))
    diagnosis_panel._Commands(state, SimpleNamespace(results=lambda: given)).refresh()
    assert state.remarks == ["M1/fit.json comes from another modal_model.json than is here."]
    assert (state.has_steps, state.has_changes) == (False, False)
