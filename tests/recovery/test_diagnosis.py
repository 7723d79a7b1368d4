"""Diagnoses of virtual tests whose hidden effect is known to the test alone."""

import shutil
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import model
from tests.studies import modal_data
from tests.studies.blind import blind_test, candidates_of, simulated
from updating.diagnosis.diagnosis import conclude, searched
from updating.diagnosis.evidence import assemble_evidence

SPECIFICATION = Path(__file__).parents[2] / "data" / "demo_stack" / "virtual_test.toml"
CONSIDERED = ("clamp_mass", "contact_direction", "pressure_exponent", "contact_loss", "clamp_rods", "temperature")


@pytest.fixture(scope="module")
def catalogue():
    return {name: effect for name, effect in model.catalogue().items() if name in CONSIDERED}


@pytest.fixture(scope="module")
def candidates(catalogue):
    return candidates_of(SPECIFICATION, catalogue)


@pytest.fixture(scope="module")
def coarse(tmp_path_factory):
    """The same test on a coarser mesh of fewer laminas, in a third of the time."""
    folder = tmp_path_factory.mktemp("coarse")
    shutil.copytree(SPECIFICATION.parent, folder, ignore=shutil.ignore_patterns("M*"), dirs_exist_ok=True)
    stack = (folder / "stack.toml").read_text(encoding="utf-8")
    for fine, rough in (("n_x = 18", "n_x = 8"), ("n_y = 4", "n_y = 2"), ("n_lamina = 240", "n_lamina = 60")):
        assert fine in stack
        stack = stack.replace(fine, rough)
    (folder / "stack.toml").write_text(stack, encoding="utf-8")
    test = SPECIFICATION.read_text(encoding="utf-8")
    assert "mesh = [24, 6]" in test
    (folder / SPECIFICATION.name).write_text(test.replace("mesh = [24, 6]", "mesh = [12, 3]"), encoding="utf-8")
    return folder / SPECIFICATION.name


@contextmanager
def coarse_truth():
    """Have tests simulated on a mesh that is coarser, too, and finer than that of the model all the same."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(modal_data, "QUICK_MESH", model.Mesh(n_x=12, n_y=3))
        yield


@pytest.fixture(scope="module")
def quick(coarse, catalogue):
    """The candidates of the coarse test; a loss factor, which moves no frequency, is left out."""
    with coarse_truth():
        return candidates_of(coarse, {name: effect for name, effect in catalogue.items() if name != "contact_loss"})


def diagnosed(candidates, effects, values, seed, specification=SPECIFICATION):
    test = blind_test(specification, seed, effects, values)
    return conclude(candidates, assemble_evidence(candidates, simulated(test)[:2]))


def test_nothing_is_missing_where_nothing_is_hidden(quick, coarse):
    with coarse_truth():
        found = diagnosed(quick, (), {}, 11, coarse)
    assert found.verdict == "nothing missing"
    assert found.set == ()
    assert found.too_large == ()
    assert {"clamp_rods", "temperature"} <= set(found.not_visible)
    assert {"contact_direction", "pressure_exponent"} <= set(found.ruled_out)
    assert not set(found.ruled_out) & set(found.not_visible)
    assert found.sentences[0].startswith("Nothing is missing that these data can show")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "values"), [("contact_direction", {"G_yz_ratio": 0.8}), ("pressure_exponent", {"exponent": 0.5})]
)
def test_a_hidden_effect_is_named_and_its_parameter_found(candidates, catalogue, name, values):
    found = diagnosed(candidates, (catalogue[name],), values, 12)
    assert found.verdict in ("identified", "one of")
    assert found.set[0] == (name,)
    told_apart_by_none = {effect for effects in found.set[1:] for effect in effects}
    assert told_apart_by_none <= set(found.measurement)  # two torques stated wrongly do as an exponent does
    assert found.verdict == "identified" or name == "pressure_exponent"
    assert name not in found.ruled_out
    assert {"contact_direction", "pressure_exponent"} - {name} <= set(found.ruled_out)
    best = next(x for x in found.ranking if x.effects == (name,))
    (parameter,) = best.parameter
    assert parameter.lower < values[parameter.name] < parameter.upper
    assert best.frequency_error < 0.3 * found.ranked(()).frequency_error


@pytest.mark.slow
def test_clamps_that_a_file_has_too_heavy_are_no_physical_effect(candidates, catalogue):
    found = diagnosed(candidates, (catalogue["clamp_mass"],), {"clamp_added_mass": -0.3}, 16)
    assert found.set[0] == ("clamp_mass",)
    assert "clamp_mass" in found.measurement
    assert found.labels["clamp_mass"] == catalogue["clamp_mass"].overstated
    assert found.sentences[0].startswith("Not the model but the measurement: clamps that are lighter than stated")


@pytest.mark.slow  # `tests/unit/test_unlisted.py` asks it of a chain of masses
def test_an_effect_that_is_not_in_the_catalogue_is_not_given_a_name_with_confidence(quick, coarse, catalogue):
    offered = replace(quick, effects={k: v for k, v in quick.effects.items() if k != "contact_direction"})
    found = diagnosed(offered, (catalogue["contact_direction"],), {"G_yz_ratio": 0.6}, 13, coarse)
    assert found.verdict == "unlike anything"
    assert found.set == ()


@pytest.mark.slow
def test_a_mass_that_no_effect_of_the_catalogue_is_gets_no_name_and_shows_where_it_sits(candidates):
    """It moves with the stack at the shaker."""
    moving, mass = model.catalogue()["stinger_mass"], 0.05
    test = blind_test(SPECIFICATION, 15, (moving,), {moving.parameters[0].name: mass})
    tested = simulated(test)[:2]
    found = conclude(candidates, assemble_evidence(candidates, tested))
    assert found.set == ()
    point = found.point_change
    assert point.kind == "mass"
    assert 0.2 * mass < point.size < 2.0 * mass
    points = dict(zip(tested[0][2].geometry.node, tested[0][2].geometry.coordinate, strict=True))
    shaker = points[tested[0][2].input.node[0]]
    assert np.linalg.norm(points[point.node] - shaker) < 0.03


@pytest.mark.slow
@pytest.mark.parametrize("seed", [31, 32])
@pytest.mark.parametrize("each", ["one of two sensors", "every point"])
def test_sensors_that_read_one_per_cent_too_high_are_no_missing_effect(candidates, catalogue, seed, each):
    test = blind_test(SPECIFICATION, seed, (catalogue["contact_direction"],), {"G_yz_ratio": 0.8})

    def read(modes):
        place = np.arange(len(modes.shape))
        every = np.random.default_rng(seed).standard_normal(place.size)
        gain = place % 2 if each == "one of two sensors" else every
        return replace(modes, shape=(1.0 + 0.01 * gain[:, None]) * modes.shape)

    tested = [(name, pressure, read(modes)) for name, pressure, modes in simulated(test)[:2]]
    found = conclude(candidates, assemble_evidence(candidates, tested))
    assert found.verdict == "identified"
    assert found.set == (("contact_direction",),)
    if each == "one of two sensors":
        (gain,) = found.sensor_gains
        assert gain.excess == pytest.approx(0.01, abs=3.0 * gain.std)
        assert gain.std < 0.0015


@pytest.mark.blind
def test_an_effect_that_brings_unseen_modes_below_the_measured_ones_is_still_named():
    """Strong enough, clamps that pitch add modes that the sensors miss; the last measured one is then the 22nd."""
    (effect,) = model.find_effects(["clamp_pitch_inertia"], model.catalogue())
    candidates = candidates_of(SPECIFICATION, {effect.name: effect})
    found = diagnosed(candidates, (effect,), {"clamp_pitch": 0.0051}, 51031)
    assert found.verdict == "identified"
    assert found.set == (("clamp_pitch_inertia",),)


@pytest.mark.slow
def test_an_effect_that_does_nothing_is_no_evidence(candidates, catalogue):
    test = blind_test(SPECIFICATION, 12, (catalogue["contact_direction"],), {"G_yz_ratio": 0.8})
    evidence = assemble_evidence(candidates, simulated(test)[:2])
    one = ("contact_direction",)
    _, found, _ = searched(candidates, evidence, [one, (*one, "clamp_rods")])
    single, both = found.fitted[frozenset(one)], found.fitted[frozenset((*one, "clamp_rods"))]
    assert both.log_evidence == pytest.approx(single.log_evidence, abs=0.3)
