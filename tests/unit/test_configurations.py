"""What configurations state beside what they show: copies, pressures, torques, and the scale of all functions.

Repeats of one condition are compared, and their scatter is reported beside what the intervals say.

References and repeats in a campaign file: what is refused, and what a file without fault gives.
"""

from types import SimpleNamespace

import numpy as np
import pytest

from ema import CampaignError, Comparison, Configuration, read_campaign, repeats
from ema.modal.configurations import contradicted, factor_text
from ema.quality.structure import content_digests, shared_functions
from ema.types.frf import Dofs

N_DOF, FREQUENCY = 6, (np.array([200.0, 300.0, 450.0]), np.array([240.0, 370.0, 560.0]))
SHAPE = np.random.default_rng(1).normal(size=(N_DOF, 8))


def configuration(name, torque=None, pressure=None):
    return SimpleNamespace(name=name, stack=None, height=None, torque=torque, pressure=pressure)


def model(name, frequency, factor=1.0, force=9):
    """Return modes of one set of mass-normalised shapes, functions multiplied by a factor, or by one of each."""
    pole = 2.0 * np.pi * np.nan_to_num(frequency, nan=100.0) * (-0.002 + 1j)
    return SimpleNamespace(
        name=name,
        frequency=frequency,
        pole=pole,
        residue=(np.reshape(factor, (len(np.atleast_1d(factor)), -1)) * SHAPE[:, : len(pole)] / (2j * pole.imag))[
            :, None, :
        ],
        node=np.arange(1, N_DOF + 1),
        direction=np.tile([0.0, 0.0, 1.0], (N_DOF, 1)),
        sensor=np.arange(N_DOF) % 2,
        input=Dofs(node=np.array([force]), direction=np.array([[0.0, 0.0, 1.0]])),
    )


def findings(first, second, frequency=FREQUENCY, factor=1.0, force=9):
    one = np.array(frequency)
    names = (first.name, second.name)
    comparison = Comparison(name=names, frequency=one, frequency_std=one, damping=one, damping_std=one, mac=one)
    models = [model(names[0], one[0]), model(names[1], one[1], factor, force)]
    return contradicted([first, second], models, comparison)


M1, M2 = configuration("M1", 1.5, 160e3), configuration("M2", 3.0, 320e3)


def test_what_agrees_is_not_remarked():
    assert findings(M1, M2) == ()
    assert findings(configuration("M1"), configuration("M2")) == ()


def test_a_stack_that_gets_softer_under_pressure_is_remarked():
    (found,) = findings(configuration("M1", pressure=320e3), configuration("M2", pressure=160e3))
    assert "softer under pressure: from M2 to M1" in found
    assert "(160 to 320 kPa)" in found
    assert "19 %" in found
    (found,) = findings(configuration("M1", torque=3.0), configuration("M2", torque=1.5))
    assert "the stated torque rises (1.5 to 3 N m)" in found


def test_pressure_that_falls_or_is_out_of_proportion_to_torque_is_remarked():
    both = findings(configuration("M1", 1.5, 320e3), configuration("M2", 3.0, 160e3))
    assert any("pressure falls as the torque rises" in line for line in both)
    (found,) = findings(M1, configuration("M2", 3.0, 256e3))
    assert "106.7 and 85.33 kPa for each N m" in found
    assert findings(M1, configuration("M2", 3.0, 305e3)) == ()


@pytest.mark.parametrize(
    ("factor", "said"),
    [
        (1.0 / 9.80665, "0.102 times (g for m/s² would do this) as large as those of M1 (3 modes"),
        (-1.0, "all functions of M2 have the opposite sign to those of M1"),
        (1j, "are turned by 90 degrees against those of M1"),
    ],
)
def test_functions_of_another_scale_sign_or_phase_are_named(factor, said):
    (found,) = findings(M1, M2, factor=factor)
    assert said in found


def test_scale_is_not_compared_where_it_cannot_be():
    assert findings(M1, M2, factor=1.2) == ()  # sensors of one calibration
    assert findings(M1, M2, factor=10.0, force=8) == ()  # the force elsewhere
    assert findings(M1, M2, (FREQUENCY[0], np.full(3, np.nan)), 10.0) == ()


def test_a_sensor_whose_gain_changed_is_named_and_shapes_that_changed_are_not():
    many = (np.linspace(200.0, 900.0, 8), np.linspace(230.0, 1000.0, 8))
    odd = np.arange(N_DOF) % 2 == 1
    (found,) = findings(M1, M2, many, factor=np.where(odd, 1.1, 1.0))
    assert found.startswith(
        "sensor 2 of each run reads 1.1 times as much beside the others in M2 as in M1 (median of 8"
    )
    assert findings(M1, M2, many, factor=np.where(odd, 1.01, 1.0)) == ()
    rng = np.random.default_rng(3)
    changed = np.where(odd[:, None], 1.05 + 0.1 * rng.standard_normal((N_DOF, 8)), 1.0)
    assert findings(M1, M2, many, factor=changed) == ()
    assert findings(M1, M2, factor=np.where(odd, 1.1, 1.0)) == ()  # three modes tell too little


def test_a_factor_is_said_with_the_units_that_have_it():
    assert factor_text(1.7) == "1.7 times"
    assert factor_text(4.4) == "4.4 times (N for lbf would do this)"
    assert factor_text(0.104) == "0.104 times (g for m/s² would do this)"


def test_configurations_that_share_functions_are_named():
    rng = np.random.default_rng(2)
    blocks = [SimpleNamespace(value=rng.normal(size=(3, 1, 5)) + 0j) for _ in range(2)]
    digests = {name: content_digests(block) for name, block in zip(("M1", "M2"), blocks, strict=True)}
    assert shared_functions(digests) == ()
    digests["M3"] = (*digests["M1"][:2], digests["M2"][0])
    assert shared_functions(digests) == (
        "M1 and M3 share 2 of 3 functions to the last digit: files of one stand in the other, too, which is no second "
        "measurement",
        "M2 and M3 share 1 of 3 functions to the last digit: files of one stand in the other, too, which is no second "
        "measurement",
    )


def repeated(name, **state):
    stated = {"stack": "4", "torque": 2.5, "pressure": None, "height": None, **state}
    return Configuration(name=name, files=(), **stated)


def comparison(names, frequency):
    frequency = np.array(frequency)
    return Comparison(
        name=names,
        frequency=frequency,
        frequency_std=np.where(np.isnan(frequency), np.nan, 1e-5 * frequency),
        damping=np.where(np.isnan(frequency), np.nan, 0.01),
        damping_std=np.where(np.isnan(frequency), np.nan, 1e-4),
        mac=np.ones_like(frequency),
    )


def test_repeats_that_differ_by_more_than_their_intervals_are_told():
    # 0.35 % apart with intervals of 0.001 %: nothing compared them
    names = ("A", "B", "A again")
    states = [repeated("A"), repeated("B", torque=5.0), repeated("A again")]
    rows = [[200.0, 300.0, 400.0], [220.0, 330.0, np.nan], [200.7, 300.0, np.nan]]
    (found,) = repeats(states, comparison(names, rows))
    assert found.name == ("A", "A again")
    np.testing.assert_allclose(found.frequency, [200.35, 300.0])
    np.testing.assert_allclose(found.scatter, [0.7 / np.sqrt(2), 0.0], atol=1e-12)
    np.testing.assert_allclose(found.stated, [2e-3, 3e-3], rtol=2e-3)
    assert found.finding.startswith("A, A again state the same condition: frequencies scatter by 0.12 %")
    assert "0.25 % at 200.35 Hz" in found.finding


@pytest.mark.parametrize("states", [({"torque": None}, {"torque": None}), ({}, {"stack": "5"})])
def test_what_states_no_condition_or_another_one_is_no_repeat(states):
    configurations = [repeated(name, **state) for name, state in zip("AB", states, strict=True)]
    assert repeats(configurations, comparison(("A", "B"), [[200.0], [201.0]])) == ()


def test_repeats_without_a_common_mode():
    rows = [[200.0, np.nan], [np.nan, 300.0]]
    (found,) = repeats([repeated("A"), repeated("B")], comparison(("A", "B"), rows))
    assert found.finding == "A, B state the same condition, but share no mode"


@pytest.fixture
def campaign(tmp_path, campaign_text):
    """Read a campaign of configurations with these keys, all of one file."""
    (tmp_path / "points.csv").write_text("node,x,y,z\n1,0,0,0\n")
    (tmp_path / "frf.csv").write_text("1,0,0\n")
    head = campaign_text.rpartition("[[configuration]]")[0]

    def read(**configurations):
        text = head + "".join(
            f'[[configuration]]\nname = "{name}"\nfiles = "frf.csv"\noutput = "1+z"\ninput = "1+z"\n{keys}\n'
            for name, keys in configurations.items()
        )
        (tmp_path / "campaign.toml").write_text(text)
        return read_campaign(tmp_path / "campaign.toml")

    return read


def test_a_reference_may_be_a_name_or_a_list(campaign):
    found = campaign(A="", B='repeat_of = "A"', C='compare_to = "A"', D='compare_to = ["A", "C"]')
    assert [one.compare_to for one in found.configurations] == [(), (), ("A",), ("A", "C")]
    assert found.configuration("B").repeat_of == "A"
    assert found.reassembly.frequency == 0.003


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"A1": "", "B": 'compare_to = "A2"'}, "configuration 'B': compare_to: no 'A2'; .*A1"),
        ({"A": 'compare_to = "A"'}, "'A': compare_to: names itself"),
        ({"A": 'repeat_of = "A"'}, "'A': repeat_of: names itself"),
        ({"A": "", "B": 'compare_to = ["A", "A"]'}, "'B': compare_to: names one state twice"),
        ({"A": 'compare_to = "B"', "B": 'compare_to = "A"'}, "goes round: A -> B -> A"),
        ({"A": 'compare_to = "C"', "B": 'compare_to = "A"', "C": 'compare_to = "B"'}, "goes round: A -> C -> B -> A"),
        ({"A": 'compare_to = "B"', "B": 'repeat_of = "A"'}, "'B' is a repeat of it"),
        ({"A": "", "B": 'repeat_of = "A"', "C": 'repeat_of = "B"'}, "'B' is a repeat itself; .*'A'"),
        ({"A": "", "B": "", "C": 'repeat_of = "B"\ncompare_to = "A"'}, "move compare_to to 'B'"),
    ],
)  # fmt: skip
def test_what_makes_no_sense_is_refused_by_its_name(campaign, keys, said):
    with pytest.raises(CampaignError, match=said) as caught:
        campaign(**keys)
    assert "campaign.toml" in str(caught.value)
