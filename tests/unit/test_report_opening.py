"""The first screen of a report: what it says, what it draws, and what it tells one to run next."""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from updating.diagnosis.answer import Diagnosis, ModeError, Ranked
from updating.report.answer import fit_sentences, headline, opening, opening_section
from updating.report.change_part import mode_changes, mode_picture, step_chart, step_picture, steps
from updating.report.part import Picture, Section, printed
from updating.report.results import Results
from updating.report.state_part import _surface

NAN = float("nan")
LABELS = {"clamp_mass": "clamp mass", "weld_seam": "weld seams on the long sides", "own": "an own effect"}


def ranked(*effects, error, left_out):
    given = dict.fromkeys(Ranked.__dataclass_fields__, 0.0)
    return Ranked(**given | {"effects": effects, "frequency_error": error, "left_out_error": left_out, "parameter": ()})


BASE = ranked(error=0.034, left_out=0.043)
MASS = ranked("clamp_mass", error=0.010, left_out=0.016)
BOTH = ranked("clamp_mass", "weld_seam", error=0.0005, left_out=0.0014)


def results(**given):
    empty = {
        "name": "campaign", "tested": (), "missing": (), "ledger": (),
        "diagnosis": None, "pooled": None, "updated": None, "folder": Path("out/x"),
        "campaign": Path("my test/x.toml"), "origin": {},
    }  # fmt: skip
    return Results(**(empty | given))


def diagnosis(**given):
    default = {"labels": LABELS, "ranking": (BASE, MASS, BOTH), "steps": (BASE,), "explained": 0.99}
    return Diagnosis(**(dict.fromkeys(Diagnosis.__dataclass_fields__, ()) | default | given))


def first(**given):
    return opening(results(diagnosis=diagnosis(**given)))


def test_what_was_found_is_said_in_one_sentence_with_the_name_that_a_person_uses():
    one = first(verdict="identified", set=(("clamp_mass",),))
    assert one.badge == "effect identified"
    assert one.sentence == (
        "What the model lacks is clamp mass: with it the mean frequency error falls from 3.4 % to 1.0 %, of modes left "
        "out from 4.3 % to 1.6 %."
    )
    assert one.command == "lamella fit 'my test/x.toml' -o out/x --effect clamp_mass"


def test_the_badge_says_what_was_identified():
    assert first(verdict="identified", set=(("clamp_mass", "weld_seam"),)).badge == "effects identified"
    one = first(verdict="identified", set=(("clamp_mass",),), measurement=("clamp_mass",))
    assert one.badge == "fault of the measurement identified"


@pytest.mark.parametrize(("apart", "said"), [(0.026, True), (0.02, False), (float("nan"), False)])
def test_how_badly_a_whole_configuration_is_predicted_is_said_where_it_matters(apart, said):
    mass = replace(MASS, left_out_error=0.007, left_out_configuration_error=apart)
    for verdict in ("identified", "partly explained"):
        sentence = first(verdict=verdict, set=(("clamp_mass",),), ranking=(BASE, mass)).sentence
        assert ("A whole configuration that is left out is predicted to 2.6 % only: its contact is" in sentence) == said


def test_where_frequencies_hardly_gain_the_errors_of_damping_tell_what_it_is_worth():
    base, loss = (
        replace(ranked(*effects, error=1.3e-4, left_out=1e-3), damping_error=fit, left_out_damping_error=left)
        for effects, fit, left in (((), 0.15, 0.2), (("clamp_mass",), 0.024, 0.03))
    )
    found = diagnosis(verdict="identified", set=(("clamp_mass",),), ranking=(base, loss), steps=(base, loss))
    assert headline(found) == (
        "What the model lacks is clamp mass: with it the mean error of damping ratios falls from 15 % to 2.4 %, of "
        "modes left out from 20 % to 3.0 %."
    )
    picture = step_picture(steps(results(diagnosis=found)))
    drawn = json.loads(picture.chart)
    assert drawn["layout"]["yaxis"]["title"]["text"] == "mean error of damping ratios [%]"
    assert drawn["data"][0]["y"][0] == pytest.approx(15.0)
    assert "damping ratios" in picture.alt


@pytest.mark.parametrize(
    ("verdict", "left", "tone", "words"),
    [
        ("nothing missing", (), "good", "lacks nothing that these data can show: its frequencies are off by 3.4 %"),
        ("unlike anything", (), "open", "unlike anything in the catalogue"),
        ("partly explained", (("clamp_mass",),), "open", "A part of what is missing is clamp mass"),
        ("one of", (("clamp_mass",), ("weld_seam",)), "open", "which: clamp mass; or weld seams on the long sides."),
    ],
)  # fmt: skip
def test_every_verdict_has_its_sentence(verdict, left, tone, words):
    one = first(verdict=verdict, set=left)
    assert (one.badge, one.tone) == (verdict, tone)
    assert words in one.sentence
    assert "_" not in one.sentence


def test_what_the_data_cannot_tell_apart_asks_for_another_test():
    one = first(verdict="one of", set=(("clamp_mass",), ("weld_seam",)), next_tests=(object(),))
    assert one.command == "lamella next-test 'my test/x.toml' -o out/x"


def test_an_effect_that_was_added_is_not_added_again():
    done = SimpleNamespace(effects=("clamp_mass",))
    found = diagnosis(verdict="identified", set=(("clamp_mass",),))
    assert opening(results(diagnosis=found, ledger=(done,))).command == "lamella open out/x"


def test_an_effect_of_a_file_that_the_page_does_not_know_is_not_in_a_command():
    one = first(verdict="identified", set=(("own",),), ranking=(BASE, ranked("own", error=0.01, left_out=0.02)))
    assert "--effect" not in one.command


def test_the_way_of_the_error_goes_from_the_base_model_over_each_effect_to_what_is_left():
    way = steps(results(diagnosis=diagnosis(verdict="identified", steps=(BASE, MASS, BOTH))))
    assert [one.name for one in way] == ["base model", "clamp mass", "weld seams on the long sides"]
    drawn = json.loads(step_picture(way).chart)["data"]
    assert [trace["measure"] for trace in drawn] == [["absolute", "relative", "relative", "total"]] * 2
    np.testing.assert_allclose(drawn[0]["y"][:3], [3.4, -2.4, -0.95])
    np.testing.assert_allclose(drawn[1]["y"][:3], [4.3, -2.7, -1.46])
    bars = printed(step_chart(way), (6.4, 3.6)).axes[0].containers[1]
    assert [b.get_height() for b in bars] == pytest.approx([4.3, 2.7, 1.46, 0.14])
    assert [b.get_y() for b in bars] == pytest.approx([0.0, 1.6, 0.14, 0.0])


@pytest.mark.parametrize("n", [0, 1, 2])
def test_where_the_model_fails_stands_side_by_side_of_all_configurations(n):
    names = [f"M{k}" for k in range(n)]
    blank = Picture(name="", content=b"", form="svg", data="", alt="", caption="", width="half")
    maps = tuple(Section(title=name, blocks=(replace(blank, name=f"error_map_{name}"),)) for name in names)
    fit = SimpleNamespace(pairing=SimpleNamespace(measured=np.arange(3)), error=0.01)
    tested = tuple(
        SimpleNamespace(name=name, identified=None, fit=SimpleNamespace(name=name, **vars(fit))) for name in names
    )
    one = diagnosis(
        verdict="identified", set=(("clamp_mass",),), steps=(BASE, MASS),
        errors=(ModeError(configuration="M1", mode=1, frequency=100.0, base=0.02, explained=0.001, std=0.0),),
    )  # fmt: skip
    _, *pictures = opening_section(results(diagnosis=one, tested=tested), maps).blocks
    halves = [picture.name for picture in pictures if picture.width == "half"]
    assert len(halves) % 2 == 0
    assert halves[-n:] == [f"error_map_{name}" for name in names][-n:] or n == 0


def test_nothing_that_was_added_has_no_steps():
    assert steps(results(diagnosis=diagnosis(verdict="nothing missing"))) == ()


def test_modes_are_drawn_before_and_after():
    errors = tuple(
        ModeError(configuration="M1", mode=r, frequency=100.0 * r, std=0.1, base=0.01 * r, explained=after)
        for r, after in ((1, 0.001), (2, -0.002))
    )
    picture = mode_picture(mode_changes(results(diagnosis=diagnosis(verdict="identified", errors=errors))))
    before, after = json.loads(picture.chart)["data"]
    np.testing.assert_allclose(before["y"], [1.0, 2.0])
    np.testing.assert_allclose(after["y"], [0.1, -0.2])
    assert before["x"] == [["M1", "M1"], ["1: 100 Hz", "2: 200 Hz"]]


def test_an_updating_says_what_it_changed_and_not_that_no_model_was_fitted():
    configuration = SimpleNamespace(
        name="M1", used=np.array([True, False]), measured_frequency=np.array([100.0, 200.0]),
        frequency_before=np.array([103.0, 210.0]), frequency=np.array([100.1, 209.0]),
    )  # fmt: skip

    def error(*, before=False, held_out=False):
        return NAN if held_out else 0.03 if before else 0.001

    fit = SimpleNamespace(error=error, configuration=(configuration,))
    modes = SimpleNamespace(frequency=np.array([100.0, 200.0]))
    given = results(tested=(SimpleNamespace(name="M1", measured=modes, fit=None),), updated=SimpleNamespace(fit=fit))
    one = opening(given)
    assert one.badge == "fitted"
    assert one.sentence == ("1 configuration fitted together: the mean frequency error goes from 3.0 % to 0.10 %.")
    (change,) = mode_changes(given)
    assert (change.mode, change.base, change.explained) == (1, pytest.approx(0.03), pytest.approx(0.001))


def test_the_outside_of_a_block_has_every_face_once():
    corner, triangle, box = _surface(np.array([0.0, 1.0, 3.0]), np.array([0.0, 2.0]), np.array([0.0, 1.0]))
    a, b, c = corner[triangle].swapaxes(0, 1)
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    assert area.sum() == pytest.approx(2 * (3 * 2 + 3 * 1 + 2 * 1))
    assert [area[box == k].sum() for k in (0, 1)] == pytest.approx([2 * (2 + 1) + 2, 2 * (4 + 2) + 2])


@pytest.mark.parametrize(("verdict", "badge"), [("unchanged", "no change seen"), ("identified", "changed")])
def test_what_only_a_model_sees_is_a_change(verdict, badge):
    named = SimpleNamespace(verdict=verdict, left=("glued_patch",), sentences=("sheets hold together more", "there"))
    state = SimpleNamespace(
        change=SimpleNamespace(changed=False), what_changed=named, fit=None,
        measured=SimpleNamespace(frequency=np.ones(6)),
    )  # fmt: skip
    assert opening(results(tested=(state,))).badge == badge
    assert "fitted to references alone" in fit_sentences(results(tested=(state,)))[0]
