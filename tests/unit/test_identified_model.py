"""The report shows the base model and the model with what was identified, and switches between them."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from ema import Geometry
from model import catalogue, find_effects, observe, read_stack, reduce, solve_modes
from tests.recovery.reference_models import modal_model
from updating.correlation.registration import register
from updating.diagnosis.answer import Diagnosis, Ranked
from updating.diagnosis.explained_model import explained_stack
from updating.errors import FitError
from updating.fitting.fit import Fit, ParameterEstimate, fit
from updating.report import results as module
from updating.report.answer import before_after_table, frac_sentence
from updating.report.modes_part import by_model, complexity_table, pair_tables
from updating.report.page import render
from updating.report.part import Picture, Section, of_model
from updating.report.results import (
    Addition,
    IdentifiedModel,
    Results,
    identified_effects,
    identified_model,
    with_models,
)
from updating.report.results import Tested as Configuration
from updating.results.store import read_result, write_result
from updating.results.text import Table

EFFECT, PARAMETER, VALUE = "lost_contact_middle", "middle_loss", 0.4


def results(**given):
    empty = {
        "name": "campaign", "tested": (), "missing": (), "ledger": (),
        "diagnosis": None, "updated": None, "pooled": None, "folder": Path("out/x"), "campaign": None, "origin": {},
    }  # fmt: skip
    return Results(**(empty | given))


def estimate(name, value):
    return ParameterEstimate(name=name, unit="1", value=value, lower=0.0, upper=1.0, at_bound=False)


def diagnosis(*effects, parameter=(), measurement=()):
    made = dict.fromkeys(Ranked.__dataclass_fields__, 0.0) | {"effects": effects, "parameter": parameter}
    given = {"set": (effects,), "ranking": (Ranked(**made),), "measurement": measurement}
    return Diagnosis(**(dict.fromkeys(Diagnosis.__dataclass_fields__, ()) | given))


def test_effects_and_values_are_those_of_the_answer():
    one = (estimate(PARAMETER, VALUE), estimate("length", 0.99))
    found = identified_effects(
        results(diagnosis=diagnosis(EFFECT, "stated_size", parameter=one, measurement=("stated_size",)))
    )
    assert (found.effects, found.value) == ((EFFECT,), {PARAMETER: VALUE})
    assert found.source == Path("out/x/diagnosis.json")


def test_without_a_diagnosis_the_last_model_of_the_ledger_is_what_was_found():
    entries = tuple(
        SimpleNamespace(effects=effects, shared=(estimate(PARAMETER, VALUE),) if effects else ())
        for effects in ((), (EFFECT,))
    )
    found = identified_effects(results(ledger=entries))
    assert (found.effects, found.value) == ((EFFECT,), {PARAMETER: VALUE})
    assert identified_effects(results(ledger=entries[:1])) is None


@pytest.mark.parametrize("effects", [("stated_size",), ("own_effect",)])
def test_what_is_wrong_with_the_measurement_and_an_effect_of_a_file_change_no_model(effects):
    assert identified_effects(results(diagnosis=diagnosis(*effects, measurement=("stated_size",)))) is None


def campaign_stack():
    stack = read_stack(Path(__file__).parents[2] / "data/demo_stack/stack.toml")
    return replace(stack, n_lamina=12, mesh=replace(stack.mesh, n_x=6, n_y=2))


@pytest.fixture(scope="module")
def tested():
    """A configuration whose modes are those of a coarse stack that has lost contact in the middle, and its fit."""
    stack = campaign_stack()
    true = stack.with_effects(*find_effects((EFFECT,), catalogue()), **{PARAMETER: VALUE})
    x, y = np.meshgrid(np.linspace(-0.45, 0.45, 6) * stack.length, [-0.4 * stack.width, 0.4 * stack.width])
    coordinate = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, stack.height / 2)])
    n = len(coordinate)
    geometry = Geometry(node=np.arange(1, n + 1), coordinate=coordinate, line=np.empty((0, 2), int))
    seen = register(true, geometry, geometry.node, np.tile([0.0, 0.0, 1.0], (n, 1))).observation
    system = reduce(true)
    modes = solve_modes(system, G_f=800.0, d_f=1e-11, n_mode=14, observation=observe(system, seen)).elastic()
    table = SimpleNamespace(
        configuration=SimpleNamespace(name="M1"), frequency=modes.frequency[:5], damping=modes.damping[:5],
        frequency_std=1e-4 * modes.frequency[:5], damping_std=1e-2 * modes.damping[:5], shape=modes.shape[:, :5],
        shape_std=1e-3 * np.abs(modes.shape[:, :5]) + 1e-6,
    )  # fmt: skip
    measured = modal_model(table, geometry, (0.0, 1.1 * float(modes.frequency[4])))
    return Configuration(
        name="M1", torque=None, pressure=None, folder=Path("none"), quality=None,
        measured=replace(measured, read_from="modes.csv"), fit=fit(stack, measured),
    )  # fmt: skip


FOUND = Addition(effects=(EFFECT,), value={PARAMETER: VALUE}, source=Path("diagnosis.json"))


@pytest.fixture(scope="module")
def with_model(tested):
    return replace(tested, identified=identified_model(None, FOUND, tested))


def test_effects_at_their_values_with_G_f_fitted_again_meet_what_they_made(with_model):
    base, one = with_model.fit, with_model.identified
    assert one.fit.error < 1e-4 < base.error
    assert one.fit.G_f.value == pytest.approx(800.0, rel=1e-3)
    assert one.fit.d_f.value == pytest.approx(1e-11, rel=1e-2)
    assert one.fit.stack.effect_values[PARAMETER] == VALUE
    assert np.isnan(one.frac)  # modes that were read have no functions


def test_a_model_that_is_read_back_is_still_that_of_a_stack(with_model, tmp_path):
    """Functions and slides are those of the stack: without it a report made again has the base model's alone."""
    write_result(tmp_path / "identified_model.json", with_model.identified, inputs=(), options={})
    again = read_result(tmp_path / "identified_model.json", IdentifiedModel).fit
    assert isinstance(again, Fit)
    assert again.stack.effect_values == with_model.identified.fit.stack.effect_values
    assert again.G_f.value == with_model.identified.fit.G_f.value


def test_every_table_and_picture_is_there_for_both_models_and_that_with_what_was_found_comes_first(with_model):
    found, base = pair_tables(with_model, with_model.fit, {})
    assert (found.model, base.model) == ("found", "base")
    assert "error of the base model [%]" in found.header
    assert found.rows[0][found.header.index("error [%]")] in ("+0.00", "-0.00")
    before = found.rows[0][found.header.index("error of the base model [%]")]
    assert before == base.rows[0][base.header.index("error [%]")] != "+0.00"
    made = by_model(with_model, lambda one: (picture(str(one.error)),))
    assert [p.model for p in made] == ["found", "base"]
    assert [p.name for p in made] == ["mac_M1_found", "mac_M1"]
    alone = by_model(replace(with_model, identified=None), lambda _: (picture(""),))
    assert [(p.model, p.name) for p in alone] == [("", "mac_M1")]


def picture(caption):
    return Picture(name="mac_M1", content=b"x", form="svg", data="", alt="", caption=caption)


def test_a_page_has_a_switch_only_where_it_holds_two_models():
    table = Table(title="T", header=("h",), rows=(("1",),))
    both = [*of_model([table], "found"), *of_model([table], "base")]
    page = render("title", (Section(title="outer", parts=(Section(title="inner", blocks=tuple(both)),)),))
    assert page.count('<div data-model="found">') == page.count('<div data-model="base">') == 1
    assert 'value="found" checked' in page
    assert 'class="models"' not in render("title", (Section(title="one", blocks=(table,)),))


def test_errors_before_and_after_stand_beside_each_other(with_model):
    one = replace(with_model, identified=replace(with_model.identified, base_frac=0.3, frac=0.8))
    other = replace(one, name="M2", identified=replace(one.identified, base_frac=0.1, frac=0.6))
    made = results(tested=(one, other))
    table = before_after_table(made)
    assert table.rows[0][0] == "M1"
    assert float(table.rows[0][2]) < 1e-3 < float(table.rows[0][1])
    assert table.rows[0][-2:] == ("0.300", "0.800")
    assert frac_sentence(made) == ("The likeness of modelled and measured FRFs (mean FRAC) rises from 0.20 to 0.70.",)
    assert "mean FRAC, base" not in before_after_table(results(tested=(with_model,))).header
    assert frac_sentence(results(tested=(with_model,))) == ()


RATIOS = {"G_f": 0.05, "G_f[M1]": -0.02, "young": 0.004, "height": 0.002, "clamp_1_x": 0.003}


def explained(with_model, **modelled):
    """A diagnosis of the stack that moves some of what is known, and its answer's own parameter."""
    given = diagnosis(EFFECT, parameter=(estimate(PARAMETER, VALUE),))
    one = replace(given.ranking[0], nuisance=RATIOS, modelled=modelled)
    base = replace(one, effects=(), parameter=())
    return replace(given, stack=with_model.fit.stack, ranking=(one, base), rig=())


def test_a_stack_has_what_an_explanation_moved(with_model):
    stack, (effect,) = with_model.fit.stack, find_effects((EFFECT,), catalogue())
    one = explained(with_model).ranking[0]
    made = explained_stack(stack, one, [effect], state="M1", pressure=1e5)
    assert made.contact.G_f == pytest.approx(stack.contact.G_f * np.exp(0.03))
    assert made.contact.pressure == 1e5
    assert made.material.young == pytest.approx(stack.material.young * np.exp(0.004))
    assert made.height == pytest.approx(stack.height * np.exp(0.002))
    assert made.clamps[0].x == pytest.approx(stack.clamps[0].x + 0.003)
    assert made.clamps[0].y == stack.clamps[0].y
    assert dict(made.effect_values) == {PARAMETER: VALUE, "middle_width": 1.0 / 6.0}
    assert explained_stack(stack, one, [effect], state="M2").contact.G_f == pytest.approx(
        stack.contact.G_f * np.exp(0.05)
    )


def test_a_diagnosis_alone_gives_both_models_with_its_numbers(with_model, tmp_path):
    frequency = tuple((1.001 * with_model.fit.modes.frequency[:8]).tolist())
    given = results(
        folder=tmp_path, tested=(replace(with_model, identified=None, fit=None, folder=tmp_path),),
        diagnosis=explained(with_model, M1=frequency),
    )  # fmt: skip
    for name in ("modal_model.json", "diagnosis.json"):
        (tmp_path / name).write_text(name, encoding="utf-8")
    out = with_models(given)
    assert out.remarks == ()
    (one,) = out.tested
    for fit_ in (one.fit, one.identified.fit):
        assert fit_.modes.frequency[:8] == pytest.approx(frequency, rel=1e-12)
        assert fit_.G_f.value == pytest.approx(with_model.fit.stack.contact.G_f * np.exp(0.03))
    assert one.fit.stack.effects == ()
    assert one.identified.effects == (EFFECT,)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "identified_model", lambda *_: pytest.fail("it is there"))
        again = with_models(given)
    assert again.tested[0].identified.fit.error == one.identified.fit.error
    assert again.origin[f"{tmp_path.name}/base_model.json"]["inputs"]
    (tmp_path / "diagnosis.json").write_text("another answer", encoding="utf-8")
    other = replace(given, diagnosis=explained(with_model, M1=tuple(1.01 * f for f in frequency)))
    assert with_models(other).tested[0].fit.error != one.fit.error


def test_a_model_that_cannot_be_solved_so_leaves_a_remark(with_model, tmp_path, monkeypatch):
    def fail(*_):
        message = "no mode pairs"
        raise FitError(message)

    monkeypatch.setattr(module, "identified_model", fail)
    for name in ("modal_model.json", "diagnosis.json"):
        (tmp_path / name).write_text(name, encoding="utf-8")
    given = results(
        folder=tmp_path, tested=(replace(with_model, identified=None, folder=tmp_path),),
        diagnosis=explained(with_model),
    )  # fmt: skip
    out = with_models(given)
    assert out.tested[0].identified is None
    assert out.tested[0].fit is not None
    assert out.remarks == ("M1: the model of the answer cannot be shown: no mode pairs.",)


@pytest.mark.parametrize("turn", [0.0, 1.5])
def test_complexity_is_folded_unless_a_shape_is_too_complex(with_model, turn):
    shape = with_model.measured.shape.copy()
    shape[::2, 0] *= np.exp(1j * turn)
    given = replace(with_model, measured=replace(with_model.measured, shape=shape))
    assert complexity_table(given).folded == (turn == 0.0)


def test_damping_that_an_effect_brings_is_not_taken_for_the_contacts(with_model):
    (effect,) = find_effects(("steel_loss",), catalogue())
    value = {p.name: p.nominal for p in effect.parameters}
    stack = with_model.identified.fit.stack.with_effects(effect, **value)
    one = fit(stack, with_model.measured)
    without = with_model.identified.fit.d_f.value
    assert one.d_f.value < 0.95 * without  # the steel has a share of the same damping
    np.testing.assert_allclose(
        one.modes.damping[one.pairing.model].mean(), with_model.measured.damping.mean(), rtol=0.1
    )
