"""What a pooled diagnosis says in words, and its page."""

from dataclasses import replace

import pytest

from updating.fitting.fit import ParameterEstimate
from updating.report.page import write_report
from updating.report.pooled_part import contact_chart, grouping, pooled_section
from updating.results.pooled import (
    ContactState,
    Contrast,
    ModeAnswer,
    Part,
    PooledDiagnosis,
    PooledRanked,
    SpecimenAnswer,
    sentences,
)
from updating.results.store import read_result, write_result


def estimate(name="G_f", value=1500.0, unit="1"):
    return ParameterEstimate(name=name, unit=unit, value=value, lower=0.9 * value, upper=1.1 * value, at_bound=False)


def part(effect="clamp_inertia", level="rig", of="", specimens=("S1", "S2", "S3"), **given):
    one = {"label": "inertia of the clamps", "parameter": (estimate("clamp_roll_inertia", 2e-3, "kg m2"),)}
    return Part(effect=effect, level=level, of=of, specimens=specimens, log_odds=20.0, **(one | given))


def ranked(*parts, odds=30.0, error=0.002):
    return PooledRanked(
        parts=parts,
        log_odds=odds,
        probability=0.9,
        frequency_error=error,
        left_out_error=1.5 * error,
        left_out_torque_error=2.0 * error,
    )


GLUED = part("adhesive_edges", "specimen", "S2", ("S2",), label="glue along the long edges")
BASE = ranked(odds=0.0, error=0.08)


def answer(verdict="identified", ranking=None, left=1, contrasts=()):
    found = PooledDiagnosis(
        name="three stacks",
        verdict=verdict,
        ranking=ranking or (ranked(part(), GLUED), BASE),
        left=left,
        specimens=tuple(
            SpecimenAnswer(
                name=name,
                notes={"treatment": "glued" if name == "S2" else "none"},
                n_mode=12,
                G_f=estimate(),
                d_f=estimate("d_f", 9e-12, "s/Pa"),
                base_error=0.08,
                error=0.002,
                left_out_error=0.003,
                odd=("adhesive_edges",) if name == "S2" and verdict == "identified" else (),
                states=tuple(
                    ContactState(
                        name=torque, pressure=pressure, G_f=estimate(value=value), d_f=estimate("d_f", 9e-12, "s/Pa")
                    )
                    for torque, pressure, value in (("M1", 1.6e5, 1600.0), ("M2", 3.2e5, 1400.0))
                ),
                modes=(
                    ModeAnswer(
                        configuration="M1",
                        frequency=400.0,
                        damping=0.01,
                        base_frequency=432.0,
                        model_frequency=400.8,
                        base_damping=0.02,
                        model_damping=0.011,
                    ),
                ),
            )
            for name in ("S1", "S2", "S3")
        ),
        contrasts=contrasts,
        scales={"frequency": 2e-3, "damping": 0.1, "stiffness": 0.15, "loss": 0.3},
        not_visible=("temperature",),
        impossible={},
        relieved=(),
        pulled=(),
        sentences=(),
    )
    return replace(found, sentences=sentences(found))


def test_the_first_sentence_is_the_answer():
    first, odd, *_ = answer().sentences
    assert first == (
        "Identified: inertia of the clamps (clamp_inertia), of the rig, the same in all 3 specimens: "
        "clamp_roll_inertia = 0.002 kg m2 (95 %: 0.0018 kg m2 to 0.0022 kg m2); and glue along the long edges "
        "(adhesive_edges), of specimen S2 alone: clamp_roll_inertia = 0.002 kg m2 (95 %: 0.0018 kg m2 to "
        "0.0022 kg m2). Mean frequency errors, before and with it: fitted 8.0 % and 0.20 %; a specimen predicted "
        "from the others 12 % and 0.30 %; a torque predicted from all else 16 % and 0.40 %."
    )
    assert odd == "Odd among the 3 specimens: S2 (adhesive_edges)."


def test_what_is_more_probable_and_predicts_nothing_better_is_said():
    """The table has it with a higher probability."""
    likelier = ranked(part(), GLUED, part("clamp_pitch_inertia", label="pitch of the clamps"), odds=47.0)
    found = answer(ranking=(ranked(part(), GLUED), likelier, BASE))
    (said,) = [one for one in sentences(found) if one.startswith("By the odds alone,")]
    assert "pitch of the clamps (clamp_pitch_inertia), of the rig" in said
    assert "beside it would be the answer" in said
    assert "from 0.30 % to 0.30 %" in said
    assert not any(one.startswith("By the odds") for one in sentences(answer()))


def test_what_would_have_to_be_far_off_without_it_comes_next_and_what_is_so_with_it_last():
    found = replace(answer(), relieved=("the stack's density would have to differ from the file's by 4.1 %.",))
    assert sentences(found)[1] == (
        "Without it, in the mean of all specimens, the stack's density would have to differ from the file's by 4.1 %."
    )


def test_nothing_missing_names_no_effect():
    text = " ".join(answer("nothing missing").sentences)
    assert text.startswith(
        "Nothing is missing that these 3 specimens can show. The model's frequencies are off by 8.0 %"
    )
    assert "clamp_inertia" not in text
    assert "No specimen is odd" in text


@pytest.mark.parametrize(
    ("verdict", "start"),
    [
        ("partly explained", "Part of what is missing: inertia of the clamps"),
        ("unlike anything", "Something is missing that no effect of the catalogue explains"),
    ],
)
def test_what_remains_is_said_first(verdict, start):
    assert answer(verdict).sentences[0].startswith(start)


@pytest.mark.parametrize(
    ("other", "said"),
    [
        (part(level="group", of="A"), "cannot tell whose the effect is: it may as well be inertia of the clamps"),
        (part("clamp_mass", label="clamp mass"), "cannot tell which effect it is: it may as well be clamp mass"),
    ],
)  # fmt: skip
def test_what_data_cannot_tell_is_said(other, said):
    first, second, *_ = answer("one of", (ranked(part()), ranked(other, odds=29.0), BASE), 2).sentences
    assert first.startswith("Most probable: inertia of the clamps")
    assert said in second


def test_what_all_that_fits_has_is_told_once():
    law, mass = part("pressure_exponent", label="law of pressure"), part("clamp_mass", label="clamp mass")
    others = ranked(law, mass, odds=29.0), ranked(law, part(), mass, odds=28.5), ranked(law, odds=28.0)
    text = answer("one of", (ranked(law, part()), *others, BASE), 4).sentences[1]
    assert text == (
        "These data cannot tell which effect it is: beside law of pressure (pressure_exponent) it may as well be "
        "clamp mass (clamp_mass), of the rig; or inertia of the clamps (clamp_inertia), of the rig together with "
        "clamp mass (clamp_mass), of the rig; or nothing more."
    )


def test_what_lowers_the_error_is_not_passed_over_where_it_is_not_believed():
    low = answer("unlike anything", (BASE, ranked(part(), odds=0.0, error=0.04))).sentences[0]
    assert "which inertia of the clamps (clamp_inertia)" in low
    assert "not probable enough" in low
    high = answer("unlike anything", (BASE, ranked(part(), odds=0.0, error=0.08))).sentences[0]
    assert "none of what was tried lowers much" in high


def test_a_change_by_a_treatment_is_told_from_none():
    changed = Contrast(
        group="treatment = glued", parameter="G_f", label="contact stiffness", ratio=2.0, lower=1.5, upper=2.6
    )
    same = replace(changed, parameter="d_f", label="contact damping", ratio=1.1, lower=0.8, upper=1.4)
    text = " ".join(answer(contrasts=(changed, same)).sentences)
    assert "glued have 2.00 times the contact stiffness G_f of the others (95 %: 1.50 to 2.60)" in text
    assert "No change beyond the scatter of specimens: d_f of treatment = glued: 1.10 times" in text


def test_the_answer_is_kept_and_has_a_page(tmp_path):
    path = tmp_path / "pooled_diagnosis.json"
    write_result(path, answer(), inputs=(), options={})
    assert read_result(path, PooledDiagnosis).sentences == answer().sentences
    page = write_report(tmp_path).read_text(encoding="utf-8")
    assert "Identified: inertia of the clamps" in page
    assert all(f">{one}<" in page for one in ("S1", "S2", "S3", "treatment", "glued"))


def test_a_specimen_leads_to_its_torques_and_the_odd_one_is_marked():
    overview, *each = pooled_section(answer()).parts
    (table,) = (one for one in overview.blocks if one.kind == "table")
    assert table.link == ("#specimen-s1", "#specimen-s2", "#specimen-s3")
    assert [one.anchor for one in each] == ["specimen-s1", "specimen-s2", "specimen-s3"]
    modes, contact = each[0].blocks
    assert modes.rows == (("M1", "400.0", "432.0", "+8.00", "400.8", "+0.200", "1.0", "2.0", "1.1"),)
    assert [row[0] for row in contact.rows] == ["M1", "M2"]
    errors, stiffness, _ = overview.pictures
    head, *rows = errors.data.splitlines()
    assert (head, rows[4]) == ("series,at,mean frequency error [%]", "with what was identified,S2,0.2")
    head, *rows = stiffness.data.splitlines()
    assert head == "series,pressure [kPa],contact stiffness G_f [1],lower,upper"
    assert rows[2:4] == ["S2,160,1600,1440,1760", "S2,320,1400,1260,1540"]


def test_a_specimen_without_damping_is_not_given_that_of_the_others(tmp_path):
    first, *others = answer().specimens
    states = tuple(replace(state, d_f=None) for state in first.states)
    modes = tuple(replace(mode, damping=float("nan")) for mode in first.modes)
    found = replace(answer(), specimens=(replace(first, d_f=None, states=states, modes=modes), *others))
    write_result(tmp_path / "a.json", found, inputs=(), options={})
    kept = read_result(tmp_path / "a.json", PooledDiagnosis)
    assert kept.specimens[0].states == states
    section = pooled_section(kept).parts[1]
    assert [row[-1] for row in section.blocks[1].rows] == ["-", "-"]
    assert section.blocks[0].rows[0][6] == "-"
    assert "d_f" not in " ".join(section.text)
    traces = contact_chart(kept.specimens, "d_f", "treatment").traces
    assert [len(one["x"]) for one in traces] == [0, 2, 2]


def test_specimens_of_one_treatment_have_one_colour():
    traces = contact_chart(answer().specimens, "G_f", "treatment").traces
    colour = {one["name"]: one["line"]["color"] for one in traces}
    assert colour["S1"] == colour["S3"] != colour["S2"]
    assert [one["y"] for one in traces] == [[1600.0, 1400.0]] * 3


def test_specimens_are_grouped_by_their_treatment_else_by_a_note_that_several_share():
    notes = [{"date": "1", "maker": "A"}, {"date": "2", "maker": "A"}, {"date": "3", "maker": "B"}]
    found = [replace(one, notes=given) for one, given in zip(answer().specimens, notes, strict=True)]
    assert grouping(answer().specimens) == "treatment"
    assert grouping(found) == "maker"
    assert grouping([replace(one, notes={}) for one in found]) == ""
