"""What a diagnosis says in words, to an engineer who has not seen the program before."""

import itertools
from dataclasses import replace

import pytest

from model import catalogue
from updating.correlation.rig_check import ForcePlace, RigCheck
from updating.diagnosis.answer import (
    ContactAmplitude,
    Diagnosis,
    MixedUp,
    ModeError,
    NextTest,
    PointChange,
    Pulled,
    Ranked,
    SensorGain,
    Sizes,
    confounded_in,
    overstated_in,
)
from updating.diagnosis.moved import misstated, pulled_text
from updating.diagnosis.text import next_command, second_level_text, sentences
from updating.fitting.fit import ParameterEstimate
from updating.report.answer import headline
from updating.results.text import in_percent, interval_text, percent, quantity, together

NAN = float("nan")
LABELS = {
    "clamp_inertia": "clamp rotary inertia",
    "stinger_mass": "moving mass at the shaker",
    "clamp_mass": "clamp mass",
    "stated_pressure": "a pressure or torque stated wrongly",
}


def parameter(name="stinger_moving_mass", value=5.02e-3, unit="kg", **given):
    default = {"lower": 0.7 * value, "upper": 1.3 * value, "at_bound": False}
    return ParameterEstimate(name=name, unit=unit, value=value, **(default | given))


def ranked(*effects, error=0.05, left_out=0.08, damping=0.2, parameters=()):
    return Ranked(
        effects=effects,
        explained=0.0,
        log_odds=0.0,
        probability=0.5,
        parameter=tuple(parameters),
        frequency_error=error,
        damping_error=damping,
        left_out_error=left_out,
        left_out_damping_error=NAN,
        left_out_configuration_error=NAN,
        left_out_configuration_damping_error=NAN,
        misfit=1.0,
        n_residual=10,
        discrepancy=Sizes(frequency=0.004, damping=0.1),
    )


BASE = ranked(error=0.198, left_out=0.241, damping=0.5)
INERTIA = ranked(
    "clamp_inertia", error=0.057, left_out=0.08, parameters=[parameter("clamp_roll_inertia", 0.0123, "kg m2")]
)
STINGER = ranked("stinger_mass", error=0.06, left_out=0.09, parameters=[parameter()])
BOTH = ranked("clamp_inertia", "stinger_mass", error=0.01, left_out=0.02)


def mode_error(mode, base, explained=NAN):
    return ModeError(configuration="M1", mode=mode, frequency=100.0 * mode, std=0.1, base=base, explained=explained)


def diagnosis(verdict, *left, steps=(), **given):
    default = dict.fromkeys(Diagnosis.__dataclass_fields__, ()) | {
        "verdict": verdict,
        "set": tuple(one.effects for one in left),
        "labels": LABELS,
        "measurement": ("stated_pressure",),
        "confounded": {},
        "explained": 0.78,
        "steps": steps or (BASE, *left[:1]),
        "discrepancy": Sizes(frequency=0.004, damping=0.1),
        "discrepancy_spread": Sizes(frequency=0.3, damping=0.3),
        "point_change": None,
        "ranking": (BASE, INERTIA, STINGER, BOTH, *left),
        "errors": (mode_error(1, 0.02), mode_error(2, -0.012), mode_error(3, 0.001)),
        "n_used": {"M1": (9, 10), "M2": (10, 10)},
        "stack": None,
        "unlisted": None,
        "models": {},
    }
    return Diagnosis(**(default | given))


def test_nothing_missing():
    first, last = sentences(diagnosis("nothing missing"))
    assert first == (
        "Nothing is missing that these data can show. The model's frequencies are off by 20 % in the mean; beyond the "
        "noise the model is right to 0.40 % of a frequency and 10 % of a damping ratio."
    )
    assert last == "The answer rests on 9 of 10 modes of M1, 10 of 10 modes of M2."


def test_identified():
    first, right, *_ = sentences(diagnosis("identified", STINGER))
    assert first == (
        "Identified: moving mass at the shaker (stinger_mass), stinger_moving_mass = 5.02 g (95 %: 3.51 g to 6.53 g). "
        "It explains 78 % of the misfit. With it the mean frequency error falls from 20 % to 6.0 %; where each mode "
        "is predicted from all others, it goes from 24 % to 9.0 %."
    )
    assert right == (
        "With it the model is right to 0.40 % of a frequency and 10 % of a damping ratio, beyond the noise."
    )


def test_modes_left_out_that_are_predicted_worse_are_explained():
    few = replace(STINGER, left_out_error=0.3)
    text = sentences(diagnosis("identified", few, ranking=(BASE, few)))[0]
    assert text.endswith(
        "where each mode is predicted from all others, it goes from 24 % to 30 % (too few modes determine "
        "the values of what was added to predict another mode)."
    )


def test_a_discrepancy_that_a_laboratory_states_is_said_to_be_stated():
    found = diagnosis("identified", STINGER, discrepancy_spread=Sizes(frequency=0.3, damping=0.0))
    assert "0.40 % of a frequency and 10 % of a damping ratio (as stated), beyond the noise." in sentences(found)[1]


def test_a_fault_of_the_measurement_is_no_physical_effect():
    one = ranked(
        "stated_pressure", error=0.01, left_out=NAN, parameters=[parameter("G_f[M1]", 1.2, "1", lower=1.1, upper=1.3)]
    )
    found = diagnosis("identified", one)
    assert sentences(found)[0] == (
        "Not the model but the measurement: a pressure or torque stated wrongly (stated_pressure), pressure at M1 1.2 "
        "times the stated one (95 %: 1.1 to 1.3). It explains 78 % of the misfit. With it the mean frequency error "
        "falls from 20 % to 1.0 %."
    )
    assert next_command(found, "a.toml", "out") is None


@pytest.mark.parametrize(("lower", "upper", "stated"), [(-0.4, -0.2, True), (-0.4, 0.1, False), (0.2, 0.4, False)])
def test_clamps_that_a_file_has_too_heavy_are_no_missing_mass(lower, upper, stated):
    value = parameter("clamp_added_mass", (lower + upper) / 2.0, lower=lower, upper=upper)
    effect = catalogue()["clamp_mass"]
    found = overstated_in(ranked("clamp_mass", parameters=[value]), {"clamp_mass": effect})
    assert found == ({"clamp_mass": effect.overstated} if stated else {})


def test_clamps_whose_mass_ends_at_its_bound_are_stated_too_heavy():
    value = parameter("clamp_added_mass", -0.5, lower=-0.5, upper=0.02, at_bound=True)
    effects = {"clamp_mass": catalogue()["clamp_mass"]}
    assert set(overstated_in(ranked("clamp_mass", parameters=[value]), effects)) == {"clamp_mass"}


def test_what_a_wrong_statement_does_as_well_is_said():
    assert confounded_in(["clamp_mass", "air_damping"], catalogue()) == {"clamp_mass": "the mass of the clamps"}
    one = ranked("clamp_mass", parameters=[parameter("clamp_added_mass", 0.4)])
    found = diagnosis("identified", one, confounded={"clamp_mass": "the mass of the clamps"})
    assert (
        "Whether it is clamp mass or the mass of the clamps that the stack file states wrongly, no vibration test can "
        "tell: check the file first."
    ) in sentences(found)


def test_one_of_several():
    text = sentences(diagnosis("one of", STINGER, INERTIA))
    assert text[0].startswith(
        "One of these, and the data cannot tell which: moving mass at the shaker (stinger_mass); or clamp rotary "
        "inertia (clamp_inertia). With the first the mean frequency error falls from 20 % to 6.0 %"
    )
    assert text[1:3] == (
        "If it is moving mass at the shaker (stinger_mass): stinger_moving_mass = 5.02 g (95 %: 3.51 g to 6.53 g).",
        "If it is clamp rotary inertia (clamp_inertia): clamp_roll_inertia = 0.0123 kg m2 (95 %: 0.00861 kg m2 to "
        "0.016 kg m2).",
    )
    assert text[3].startswith("With the first the model is right to")


def test_many_that_cannot_be_told_apart_are_counted():
    many = [ranked(f"effect_{i}", error=0.01) for i in range(6)]
    first = sentences(diagnosis("one of", *many))[0]
    assert "effect_3 (effect_3); or one of 2 more. " in first
    assert "effect_4" not in first


@pytest.mark.parametrize(
    ("share", "start"), [(0.78, "Most of the misfit (78 %) is "), (0.3, "Part of the misfit (30 %) is ")]
)
def test_partly_explained(share, start):
    found = diagnosis(
        "partly explained",
        INERTIA,
        explained=share,
        too_large=("frequency",),
        discrepancy=Sizes(frequency=0.03, damping=0.1),
        errors=(mode_error(1, 0.3, 0.02), mode_error(2, -0.2, -0.061), mode_error(3, 0.1, NAN)),
    )
    first, _, large, where, *_ = sentences(found)
    assert first == (
        f"{start}clamp rotary inertia (clamp_inertia), clamp_roll_inertia = 0.0123 kg m2 (95 %: 0.00861 kg m2 to 0.016 "
        "kg m2). With it the mean frequency error falls from 20 % to 5.7 %; where each mode is predicted from all "
        "others, it goes from 24 % to 8.0 %."
    )
    assert large == (
        "What remains is more than a model leaves to which nothing is missing: 3.0 % of a frequency, where right "
        "models leave 1.4 % at most."
    )
    assert where == (
        "With it the model still misses these frequencies most: M1, mode 3 at 300.0 Hz (measured 10 % lower); M1, mode "
        "2 at 200.0 Hz (measured 6.1 % higher); M1, mode 1 at 100.0 Hz (measured 2.0 % lower)."
    )


def test_something_unlisted_stands_beside_or_before_what_is_named():
    either = diagnosis("one of", INERTIA, unlisted="instead")
    assert "clamp rotary inertia (clamp_inertia); or something that no effect" in sentences(either)[0]
    assert headline(either).endswith("clamp rotary inertia; or something that no effect of the catalogue describes.")
    part = sentences(diagnosis("partly explained", INERTIA, unlisted="beside"))
    assert any("no effect of the catalogue describes is clearly more probable than nothing" in t for t in part)
    none = diagnosis("unlike anything", unlisted="refused", ranking=(INERTIA, BASE))
    assert "is more probable than any" in sentences(none)[0]
    assert "is more probable than any" in headline(none)


def test_what_is_nearly_as_likely_is_named():
    text = sentences(diagnosis("partly explained", INERTIA, STINGER))
    assert text[0].endswith(" Nearly as likely: moving mass at the shaker (stinger_mass).")


def test_what_every_explanation_holds_is_said_to_be_missing():
    text = sentences(diagnosis("one of", INERTIA, BOTH))
    assert text[0].startswith(
        "Missing is clamp rotary inertia (clamp_inertia), clamp_roll_inertia = 0.0123 kg m2 (95 %"
    )
    assert (
        "Whether moving mass at the shaker (stinger_mass) is missing as well, the data cannot tell. With the first the "
        "mean frequency error falls from 20 % to 5.7 %" in text[0]
    )
    assert headline(diagnosis("one of", INERTIA, BOTH)) == (
        "What the model lacks is clamp rotary inertia. Whether it lacks moving mass at the shaker as well, the data "
        "cannot tell."
    )


def test_each_step_has_its_fall():
    text = sentences(diagnosis("identified", BOTH, steps=(BASE, INERTIA, BOTH)))
    assert text[0].startswith(
        "Identified: clamp rotary inertia (clamp_inertia) together with moving mass at the shaker (stinger_mass). It "
    )
    assert text[1] == (
        "Step by step: clamp rotary inertia (clamp_inertia) lowers the mean frequency error from 20 % to 5.7 % (24 % "
        "to 8.0 % where each mode is predicted from all others); moving mass at the shaker (stinger_mass) lowers the "
        "mean frequency error from 5.7 % to 1.0 % (8.0 % to 2.0 % where each mode is predicted from all others)."
    )


def test_unlike_anything():
    first, where, _ = sentences(diagnosis("unlike anything"))
    assert first == (
        "Something is missing that is unlike anything in the catalogue. The model's frequencies are off by 20 % in the "
        "mean, and with none of the effects that were tried does it predict better what it was not fitted to."
    )
    assert where == (
        "The model misses these frequencies most: M1, mode 1 at 100.0 Hz (measured 2.0 % lower); M1, mode 2 at 200.0 "
        "Hz (measured 1.2 % higher); M1, mode 3 at 300.0 Hz (measured 0.10 % lower)."
    )


@pytest.mark.parametrize(
    ("verdict", "left", "end"),
    [("unlike anything", (), "."), ("partly explained", (INERTIA,), "; what was said is of the other modes.")],
)
def test_a_measured_mode_that_the_model_lacks_is_named(verdict, left, end):
    text = sentences(diagnosis(verdict, *left, lacking=("M1, mode 4 at 431.2 Hz",)))
    assert f"The model has no mode like what was measured as M1, mode 4 at 431.2 Hz{end}" in text


@pytest.mark.parametrize(
    ("given", "text"),
    [
        (
            {"beside": (), "kind": "mass", "size": -0.0123},
            "The measurement looks as if there were 12.3 g less mass than the model has, at or near point 12 in the "
            "measured direction. Look there.",
        ),
        (
            {"beside": ("clamp_mass",), "kind": "spring", "size": 2.5e5},
            "The measurement looks as if there were 250 kN/m more stiffness than the model with clamp mass "
            "(clamp_mass) has, at or near point 12 in the measured direction. Look there.",
        ),
    ],
)
def test_what_is_left_at_a_point_is_told(given, text):
    one = PointChange(node=12, log_odds=9.0, **given)
    assert text in sentences(diagnosis("unlike anything", point_change=one))


def test_what_contradicts_the_measurement_comes_first():
    force = ForcePlace(stated=(0.21, 0.02), likely=(-0.21, 0.02), left=0.9, left_likely=0.01, factor=1.0, n_mode=6)
    reported = sentences(diagnosis("nothing missing", rig=(RigCheck(name="M1", sensor=0, reads=1.0, force=force),)))
    assert reported[0].startswith(
        "First of all: M1: the force does not act where the points file has it, at x = 210, y = 20 mm"
    )
    assert reported[1].startswith("Nothing is missing")


def test_errors_of_the_measurement_come_second():
    both = (
        MixedUp(kind="turned", configuration=("M1", "M2"), node=(7,), log_odds=40.0, factor=-1.0),
        MixedUp(kind="exchanged", configuration=("M2",), node=(3, 4), log_odds=40.0, factor=1.0),
        MixedUp(kind="scaled", configuration=("M1",), node=(5,), log_odds=40.0, factor=2.04),
    )
    assert sentences(diagnosis("nothing missing", mixed_up=both))[1:4] == (
        "In M1 and M2 the sensor at point 7 seems to have been turned over: check the campaign file. The answer takes "
        "the points as corrected.",
        "In M2 points 3 and 4 seem to have been exchanged: check the campaign file. The answer takes the points as "
        "corrected.",
        "In M1 the sensor at point 5 seems to read 2.04 times what is there: check the campaign file. The answer takes "
        "the points as corrected.",
    )


@pytest.mark.parametrize(
    ("before", "after", "said"),
    [
        ({}, {"left_out": NAN}, "With it the mean frequency error falls from 20 % to 5.0 %."),
        (
            {"error": 5e-4},
            {"error": 6e-4, "damping": 0.02},
            "With it the mean error of damping ratios falls from 20 % to 2.0 %; that of frequencies goes from 0.050 % "
            "to 0.060 %.",
        ),
    ],
)
def test_what_falls_is_said_and_nothing_else_is_said_to_fall(before, after, said):
    base, one = ranked(**({"error": 0.2} | before)), ranked("clamp_mass", **after)
    assert sentences(diagnosis("identified", one, ranking=(base, one)))[0].endswith(said)


@pytest.mark.parametrize(
    ("name", "value", "std", "text"),
    [
        (
            "G_f[M1]",
            0.336,
            0.03,
            "the contact stiffness G_f at M1 would have to differ from the other torques' by 40 %; reassembly and "
            "torque explain 3.0 %.",
        ),
        (
            "young",
            -0.1,
            0.02,
            "the stack's Young's modulus would have to differ from the file's by -9.5 %; what is known of it leaves "
            "2.0 %.",
        ),
        (
            "length",
            0.01,
            1e-3,
            "the stack's length would have to differ from the file's by 1.0 %; what is known of it leaves 0.10 %.",
        ),
        (
            "clamp_2_y",
            0.0082,
            2e-3,
            "clamp 2 would have to sit 8.2 mm farther along y than the file has it; what is known of it leaves 2 mm.",
        ),
        (
            "points_x",
            -0.005,
            1e-3,
            "all measured points would have to sit -5 mm farther along x than the file has them; what is known of it "
            "leaves 1 mm.",
        ),
        (
            "window",
            2.0,
            1e-3,
            "every free vibration would have to decay faster by 2 1/s, as an exponential window makes it, and the "
            "campaign states none.",
        ),
    ],
)
def test_what_would_have_to_be_far_off_is_said_in_words(name, value, std, text):
    one = Pulled(name=name, value=value, std=std)
    assert pulled_text([one]) == [text]
    assert f"Beware: {text}" in sentences(diagnosis("nothing missing", pulled=(one,)))
    assert f"Without it, {text}" in sentences(diagnosis("identified", STINGER, relieved=(one,)))


@pytest.mark.parametrize(
    ("name", "value", "unit", "text"),
    [
        ("G_f[M1]", 1.2, "1", "pressure at M1 1.2 times the stated one"),
        ("gain[sensor 2]", 0.95, "1", "sensor 2 reads 0.95 times what sensor 1 does"),
        ("length", 1.01, "1", "length 1.01 times the stated one"),
        ("clamp_1_x", 5e-3, "m", "clamp 1 sits 5 mm farther along x"),
        ("points_x", 5e-3, "m", "all points sit 5 mm farther along x"),
        ("window", 2.1, "1/s", "every free vibration decays faster by 2.1 1/s"),
        ("clamp_pitch", 5e-3, "kg m2", "clamp_pitch = 0.005 kg m2"),
    ],
)
def test_what_was_stated_wrongly_is_said_in_words(name, value, unit, text):
    assert misstated(parameter(name, value, unit)).startswith(f"{text} (95 %: ")


def test_a_parameter_at_the_end_of_its_range_makes_its_explanation_doubtful():
    one = ranked("stinger_mass", error=0.01, parameters=[parameter(at_bound=True)])
    assert (
        "Beware: stinger_moving_mass of moving mass at the shaker (stinger_mass) lies at the end of what is plausible, "
        "so that explanation is doubtful."
    ) in sentences(diagnosis("identified", one, ranking=(BASE, one)))


def test_a_sensor_that_reads_otherwise_is_told():
    gains = (SensorGain(sensor=2, excess=-0.012, std=0.002), SensorGain(sensor=3, excess=0.004, std=0.002))
    reported = [one for one in sentences(diagnosis("nothing missing", sensor_gains=gains)) if "Sensor" in one]
    assert reported == [
        "Sensor 2 of each run reads 1.2 % lower than sensor 1 (95 %: ± 0.39 %): check its calibration. It is taken "
        "into account."
    ]


@pytest.mark.parametrize(
    ("distance", "text"),
    [
        (4.2, "To tell them apart, add 1 kg: they would differ by 4.2 standard deviations, now by 1.1."),
        (2.0, "None of the further tests that were considered would tell them apart by 3 standard deviations."),
    ],
)
def test_the_next_test_is_one_that_tells_them_apart(distance, text):
    test = NextTest(name="mass", instruction="add 1 kg", distance=distance, now=1.1)
    assert text in sentences(diagnosis("one of", STINGER, INERTIA, next_tests=(test,)))


def test_long_lists_are_folded_to_a_count():
    out, unseen = (*"abcd", "clamp_inertia", "f", "g"), ("x",)
    text = sentences(diagnosis("identified", STINGER, ruled_out=out, not_visible=unseen))
    assert text[-3:-1] == (
        "Ruled out at their usual strength: 7 effects (a, b, c, d, clamp rotary inertia and 2 more).",
        "Too weak to show in these data at any plausible strength: 1 effect (x).",
    )


def test_the_next_command_adds_what_was_found_and_nothing_of_the_measurement():
    both = ranked("stated_pressure", "clamp_inertia")
    assert next_command(diagnosis("identified", both), "a/campaign.toml", "out/a") == (
        "lamella fit a/campaign.toml -o out/a --effect clamp_inertia"
    )
    assert next_command(diagnosis("one of", BOTH, STINGER), "my test/a.toml", "out") == (
        "lamella fit 'my test/a.toml' -o out --effect clamp_inertia --effect stinger_mass"
    )
    assert next_command(diagnosis("nothing missing"), "a.toml", "out") is None
    stated = [("--scatter", "lab.toml")]
    assert next_command(diagnosis("identified", STINGER), "a.toml", "out", stated) == (
        "lamella fit a.toml -o out --effect stinger_mass --scatter lab.toml"
    )


def test_every_sentence_is_whole_and_has_no_number_that_nobody_reads():
    made = (
        diagnosis("nothing missing"), diagnosis("identified", STINGER), diagnosis("one of", STINGER, INERTIA),
        diagnosis("partly explained", INERTIA, too_large=("damping",)), diagnosis("unlike anything"),
    )  # fmt: skip
    for text in itertools.chain.from_iterable(map(sentences, made)):
        assert text[0].isupper()
        assert text.endswith(".")
        assert not {"nan", "inf", "e-0", "e+0", "  ", "()", ".."} & {
            part for part in ("nan", "inf", "e-0", "e+0", "  ", "()", "..") if part in text
        }


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (5.02e-3, "kg", "5.02 g"),
        (1.25, "kg", "1.25 kg"),
        (0.99999, "kg", "1000 g"),
        (-0.0123, "kg", "-12.3 g"),
        (1.2e-3, "m", "1.2 mm"),
        (0.3, "m", "300 mm"),
        (3.5e7, "Pa", "35 MPa"),
        (1480.0, "Pa/Pa", "1480 Pa/Pa"),
        (2.1e11, "Pa", "210 GPa"),
        (2.5e5, "N/m", "250 kN/m"),
        (-2e6, "N/m", "-2 MN/m"),
        (0.05, "Pa s", "0.05 Pa s"),
        (0.0, "N/m", "0 N/m"),
        (2.1, "1/s", "2.1 1/s"),
        (0.0051, "kg m2", "0.0051 kg m2"),
        (0.8, "1", "0.8"),
        (0.8, "", "0.8"),
        (1500.0, "1", "1500"),
    ],
)
def test_quantities_are_read_in_units_of_their_size(value, unit, text):
    assert quantity(value, unit) == text


def test_the_ends_of_an_interval_are_in_the_unit_of_the_value():
    one = parameter("clamp_added_mass", 1.0, "kg", lower=0.881, upper=1.13)
    assert interval_text(one) == "clamp_added_mass = 1 kg (95 %: 0.881 kg to 1.13 kg)"
    none = parameter("stinger_moving_mass", 0.0, "kg", lower=0.0, upper=0.002)
    assert interval_text(none) == "stinger_moving_mass = 0 g (95 %: 0 g to 2 g)"


@pytest.mark.parametrize(
    ("share", "text"),
    [(0.198, "20 %"), (0.057, "5.7 %"), (1e-4, "0.010 %"), (1.0, "100 %"), (1.5, "150 %"), (0.994, "99 %"),
     (0.0, "0.0 %"), (-0.05, "-5.0 %"), (NAN, "an unknown share")],
)  # fmt: skip
def test_shares_are_percent_with_two_digits(share, text):
    assert percent(share) == text


@pytest.mark.parametrize(("share", "text"), [(1.18, "118"), (0.0106, "1.1"), (NAN, "-")])
def test_a_column_of_percent_has_plain_numbers(share, text):
    assert in_percent(share) == text


def test_an_interval_says_what_must_be_said_of_it():
    assert interval_text(parameter(determined=False)).endswith("6.53 g, not determined)")
    assert interval_text(parameter(at_bound=True)).endswith("6.53 g, at its bound)")


def test_two_torques_that_differ_are_one_difference():
    each = Pulled(name="G_f[M1]", value=-0.13, std=0.03), Pulled(name="G_f[M2]", value=0.13, std=0.03)
    said = sentences(diagnosis("nothing missing", pulled=each))
    assert (
        "Beware: the contact stiffness G_f would have to be 30 % higher at M2 than at M1, beyond what their pressures "
        "do; reassembly and torque explain 4.3 %."
    ) in said


def amplitude(configuration, mode, strain, softening):
    return ContactAmplitude(
        configuration=configuration, mode=mode, frequency=250.0, motion=1e-6, strain=strain,
        largest_strain=2.0 * strain, slip=5e-4 * strain, softening=softening, loss=0.5 * softening,
    )  # fmt: skip


def test_amplitudes_are_told_with_what_slip_makes_of_them():
    levels = (amplitude("M1", 4, 1.2e-6, 0.021), amplitude("M1 at 4 N", 1, 2.4e-5, 0.094))
    text = sentences(diagnosis("identified", STINGER, contact=levels))[2]
    assert text.startswith(
        "By the model's shapes, these 2 force levels shear the contact by 1.2e-06 (mode 4 of M1) to 2.4e-05 (mode 1 of "
        "M1 at 4 N), where faces move by up to 0.012 µm against each other. slip_softening is the share by which slip "
        "makes the contact softer at a strain of 1e-05, which lies within that;"
    )
    assert "1e-05, which was not tested;" in sentences(diagnosis("identified", STINGER, contact=levels[:1]))[2]
    linear = tuple(replace(one, softening=0.0) for one in levels)
    assert sentences(diagnosis("nothing missing", contact=linear))[1].endswith(
        "against each other; that it slips there is not said."
    )


def test_one_level_asks_for_a_second_where_that_would_show_slip():
    assert "by 12 standard deviations" in second_level_text(diagnosis("nothing missing", second_level=12.3))
    assert second_level_text(diagnosis("nothing missing", second_level=1.0)) is None
    assert second_level_text(diagnosis("nothing missing", second_level=None)) is None


def test_what_is_more_probable_than_the_answer_is_not_passed_over_in_silence():
    """The table has it first: a reader would take it for the answer."""
    likelier = replace(ranked("stinger_mass", error=0.19, left_out=0.25, damping=0.5), log_odds=9.0)
    none = diagnosis("nothing missing", ranking=(likelier, BASE))
    said = " ".join(sentences(none))
    assert "By the odds alone, moving mass at the shaker (stinger_mass) would be the answer" in said
    assert "from 20 % to 19 % (24 % to 25 % where each mode is predicted from all others)" in said
    assert "It predicts other modes no better" in said
    assert [one.effects for one in none.shown(1)] == [("stinger_mass",), ()]
    beside = replace(ranked("clamp_inertia", "stinger_mass", error=0.056, left_out=0.06), log_odds=9.0)
    named = diagnosis("identified", INERTIA, ranking=(beside, INERTIA, BASE))
    assert "By the odds alone, moving mass at the shaker (stinger_mass) beside it" in " ".join(sentences(named))
    near = replace(beside, log_odds=2.0)
    silent = diagnosis("identified", INERTIA, ranking=(near, INERTIA, BASE))
    assert "By the odds alone," not in " ".join(sentences(silent))


def test_what_acts_at_once_reads_as_a_list_from_three_on():
    assert [together(names) for names in ((), ("A",), ("A", "B"), ("A", "B", "C"))] == [
        "",
        "A",
        "A together with B",
        "A, B and C together",
    ]
