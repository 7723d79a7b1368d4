"""Sections of a report from results made by hand: what they say and list."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from updating.diagnosis.answer import Diagnosis, ModeError, Moved, Ranked
from updating.fitting.fit import ParameterEstimate
from updating.report.answer import answer_section, moved_table
from updating.report.ledger_part import interval_table, ledger_chart, ledger_section, signature_chart, signature_section
from updating.report.page import provenance_section, sections
from updating.report.part import printed
from updating.report.results import Results
from updating.results.ledger import Entry

STACK = Path(__file__).parents[2] / "data/demo_stack/stack.toml"
NAN = float("nan")


def results(**given):
    empty = {
        "name": "campaign", "tested": (), "missing": (), "ledger": (),
        "diagnosis": None, "updated": None, "pooled": None, "folder": Path("out/x"), "campaign": Path("x.toml"),
        "origin": {},
    }  # fmt: skip
    return Results(**(empty | given))


def parameter(**given):
    default = {"name": "exponent", "unit": "1", "value": 0.5, "lower": 0.402, "upper": 0.598, "at_bound": False}
    return ParameterEstimate(**(default | given))


def entry(*effects, error, damping=NAN, shared=()):
    return Entry(
        effects=effects, error=error, mode_error=1.5 * error, configuration_error=NAN, damping_error=damping,
        mode_damping_error=damping, configuration_damping_error=damping, chi_square=12.0, n_residual=30,
        shared=shared,
    )  # fmt: skip


def test_the_ledger_says_and_lists_what_the_best_effect_brings():
    two = (entry(error=0.10), entry("a", error=0.02), entry("b", error=0.04))
    section = ledger_section(results(ledger=two))
    assert section.text == (
        "With a the mean frequency error goes from 10 % to 2.0 % on the data fitted, and from 15 % to 3.0 % on modes "
        "held out.",
    )
    errors = section.blocks[1]
    assert errors.rows[1] == ("base + a", "2.0", "3.0", "")
    assert "damping" not in " ".join(errors.header)


def test_bars_of_the_ledger_are_its_errors():
    chart = ledger_chart((entry(error=0.10, damping=0.3), entry("a", error=0.02, damping=0.2)))
    frequency, damping = printed(chart, (9.0, 4.0)).axes
    assert [b.get_width() for b in frequency.containers[0]] == pytest.approx([10.0, 2.0])
    assert [b.get_width() for b in damping.containers[0]] == pytest.approx([30.0, 20.0])
    assert frequency.get_xlabel() == "mean frequency error [%]"


def test_a_parameter_at_its_bound_has_no_interval():
    rows = interval_table(
        results(ledger=(entry("a", error=0.1, shared=(parameter(), parameter(name="k", unit="N/m", at_bound=True))),))
    ).rows
    assert rows[0] == ("all, base + a", "exponent", "", "0.5", "0.402", "0.598", "")
    assert rows[1] == ("all, base + a", "k", "N/m", "0.5", "", "", "at its bound")


def test_a_parameter_that_its_range_alone_holds_is_said_to_be_unknown():
    table = interval_table(results(ledger=(entry("a", error=0.1, shared=(parameter(determined=False),)),)))
    assert table.rows[0][-1] == "not determined"


def test_the_sentences_of_a_diagnosis_come_first():
    made = dict.fromkeys(Diagnosis.__dataclass_fields__, ())
    made |= {"sentences": ("Identified: clamp mass.", "Because.")}
    section = answer_section(results(diagnosis=Diagnosis(**made), missing=("M2",)))
    assert section.text == ("Identified: clamp mass.", "Because.", "Not done yet: M2.")


def test_what_was_moved_is_listed_with_the_farthest_first():
    one = {"std": 0.01, "stated": 1.0, "unit": "1"}
    moved = (
        Moved(name="a", label="gain", value=1.02, prior=0.02, deviations=1.0, **one),
        Moved(name="b", label="pressure", value=0.7, prior=0.1, deviations=-3.0, **one),
        Moved(name="G_f", label="contact stiffness", value=1.1, prior=None, deviations=None, **one),
    )
    made = dict.fromkeys(Diagnosis.__dataclass_fields__, ()) | {"moved": moved}
    rows = moved_table(results(diagnosis=Diagnosis(**made))).rows
    assert rows[0] == ("pressure", "1", "0.7", "0.0196", "0.196", "3.0")
    assert [row[0] for row in rows[1:]] == ["gain", "contact stiffness"]
    assert rows[2][-2:] == ("", "")


def test_the_provenance_names_versions_options_and_every_input():
    made = {"versions": {"lamella": "0.1"}, "options": {"threshold": 0.8}, "inputs": {"a.toml": "12", "b.uff": "34"}}
    other = made | {"options": {}}
    origin = {"M1/fit.json": made, "M2/fit.json": made, "M3/fit.json": other}
    result, inputs = provenance_section(results(origin=origin)).blocks
    assert result.rows[0][:3] == ("M1/fit.json and 1 more", "lamella 0.1", "threshold = 0.8")
    assert result.rows[1][0] == "M3/fit.json"
    assert inputs.rows == (("a.toml", "12"), ("b.uff", "34"))
    assert inputs.folded


def test_what_is_lacking_stands_beside_what_effects_bring_mode_by_mode():
    errors = [
        mode_error("M1", 1, -0.02, 0.0), mode_error("M1", 2, 0.01, 0.0), mode_error("M2", 1, -0.03, 0.0),
    ]  # fmt: skip
    (axes,) = printed(signature_chart(errors, {"a": (0.021, -0.012, 0.0)}), (8.0, 3.6)).axes
    assert [bar.get_height() for bar in axes.patches] == pytest.approx([2.0, -1.0, 3.0])
    line = next(line for line in axes.lines if line.get_label() == "a")
    np.testing.assert_allclose(line.get_ydata(), [2.1, -1.2, 0.0])
    assert axes.get_ylabel() == "change of frequency [%]"
    assert [text.get_text() for text in axes.get_xticklabels()] == [
        "M1, 1: 100 Hz", "M1, 2: 200 Hz", "M2, 1: 100 Hz",
    ]  # fmt: skip


def diagnosis(**given):
    return Diagnosis(**(dict.fromkeys(Diagnosis.__dataclass_fields__, ()) | {"labels": {}} | given))


def ranked(*effects, error, left_out):
    given = dict.fromkeys(Ranked.__dataclass_fields__, 0.0)
    return Ranked(**given | {"effects": effects, "frequency_error": error, "left_out_error": left_out, "parameter": ()})


BASE = ranked(error=0.034, left_out=0.043)


def mode_error(configuration, mode, base, explained):
    return ModeError(
        configuration=configuration, mode=mode, frequency=100.0 * mode, std=0.1, base=base, explained=explained
    )  # fmt: skip


def test_a_model_that_is_too_soft_lacks_what_an_effect_that_stiffens_brings():
    made = diagnosis(
        verdict="identified",
        set=(("stiff", "other"),),
        errors=(mode_error("M1", 1, -0.02, -0.001), mode_error("M2", 2, 0.01, 0.002)),
        signatures={"weak": (0.001, -0.001), "stiff": (0.019, -0.011)},
    )
    picture, table = signature_section(made).blocks
    assert picture.data.splitlines() == [
        "configuration,mode,frequency [Hz],its std [Hz],lacking,stiff,weak",  # the candidate first
        "M1,1,100.0,0.1,0.02,0.019,0.001",
        "M2,2,200.0,0.1,-0.01,-0.011,-0.001",
    ]
    assert table.header[3:] == ("lacking [%]", "left by stiff + other [%]", "stiff [%]", "weak [%]")
    assert table.rows[0] == ("M1", "1", "100.00 ± 0.20", "+2.000", "+0.100", "+1.900", "+0.100")
    shown = sections(results(diagnosis=replace(made, verdict="unlike anything", ranking=(BASE,))))
    titles = [part.title for part in shown]
    assert titles == ["Answer", "In full", "Effect signatures", "Provenance"]


def test_signatures_of_many_configurations_are_several_pictures_and_nothing_left_has_no_column():
    errors = tuple(mode_error(f"M{k}", r, 0.0, NAN) for k in range(4) for r in range(1, 9))
    section = signature_section(diagnosis(errors=errors, signatures={}))
    assert [b.kind for b in section.blocks] == ["picture", "picture", "table"]
    assert [p.name for p in section.pictures] == ["signatures_1", "signatures_2"]
    assert [len(p.data.splitlines()) - 1 for p in section.pictures] == [24, 8]
    assert section.blocks[-1].header[-1] == "lacking [%]"
