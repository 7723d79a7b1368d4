"""The command `effects`, effects of `model` and `simulate` from the command line, and a user's own file."""

import json
import re
from pathlib import Path

import pytest

import model
from model.effects.conformance import effect_faults
from tests.command import lamella
from updating.commands.model import with_named_effects

pytestmark = pytest.mark.usefixtures("all_undrawn")
ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "data/effects_example/gap_spring.py"
STACK = """
name = "small"
length_mm = 300
width_mm = 60
height_mm = 50
n_lamina = 10
[material]
young_GPa = 200
poisson = 0.28
density_kg_m3 = 7650
[contact]
G_f = 1500
d_f_s_per_Pa = 1.5e-11
pressure_kPa = 160
normal_modulus_GPa = 1
[mesh]
n_x = 6
n_y = 2
"""


@pytest.fixture
def stack_file(tmp_path):
    path = tmp_path / "stack.toml"
    path.write_text(STACK, encoding="utf-8")
    return path


def frequencies(folder):
    return json.loads((folder / "modes.json").read_text(encoding="utf-8"))["result"]["frequency"]


def test_effects_lists_every_effect_once():
    done = lamella("effects")
    assert done.returncode == 0, done.stderr
    first = " ".join(line.split("│")[1] for line in done.stdout.splitlines() if line.startswith("│"))
    assert sorted(re.findall(r"\((\w+)\)", first)) == sorted(model.catalogue())
    assert "clamp rotary inertia" in " ".join(first.split())
    assert "kg m2" in done.stdout


def test_effects_explains_one_on_the_users_stack(tmp_path, stack_file):
    done = lamella("effects", "fill_factor", "--stack", stack_file, "-o", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    for text in ("Enters:", "Range:", "Does:", "Mistaken for:", "fill_ratio", "160 kPa", "320 kPa"):
        assert text in done.stdout
    assert (tmp_path / "out/fill_factor.png").read_bytes().startswith(b"\x89PNG")
    # without clamps all of the mass is the laminas': every mode rises by 0.97 ** -0.5 - 1
    changes = [line for line in done.stdout.splitlines() if "frequency [%]" in line]
    assert len(changes) == 2
    assert all(line.count("+1.53") == 4 for line in changes)


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (("effects", "clamp_inertai", "--effect-file", EXAMPLE), "did you mean clamp_inertia"),
        (("effects", "x", "--effect-file", "nowhere.py"), "nowhere.py"),
        (("model", "STACK", "-o", "OUT", "--effect", "clamp_mass"), "clamp_mass: the stack has no clamps"),
    ],
)
def test_what_cannot_be_is_said(tmp_path, stack_file, arguments, expected):
    here = {"STACK": stack_file, "OUT": tmp_path / "out"}
    done = lamella(*(here.get(a, a) for a in arguments))
    assert done.returncode == 1
    assert expected in done.stderr.replace("\n", " ")
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("option", "expected"),
    [
        ("fil_factor", "did you mean fill_factor"),
        ("fill_factor:fill_ration=1", "did you mean fill_ratio"),
        ("fill_factor:r=1", "it has fill_ratio"),
        ("fill_factor:fill_ratio=2", "outside its range, 0.93 to 1.05"),
        ("fill_factor:fill_ratio=a", "must be a number"),
        ("fill_factor:0.98", "must be parameter=value"),
    ],
)
def test_a_wrong_option_is_said(option, expected):
    stack = model.read_stack(ROOT / "data/demo_stack/stack.toml")
    with pytest.raises(model.EffectError, match=expected):
        with_named_effects(stack, [option], model.catalogue())


def test_named_effects_have_nominal_values_but_for_those_given():
    known = model.catalogue()
    stack = model.read_stack(ROOT / "data/demo_stack/stack.toml")
    changed = with_named_effects(stack, ["clamp_inertia:clamp_station=0.3", "fill_factor"], known)
    assert changed.effect_values == {"clamp_roll_inertia": 0.003, "clamp_station": 0.3, "fill_ratio": 0.97}


def test_model_takes_effects(tmp_path, stack_file):
    for folder, options in {"base": (), "less": ("--effect", "fill_factor:fill_ratio=0.95")}.items():
        done = lamella("model", stack_file, "-o", tmp_path / folder, "-n", 3, *options)
        assert done.returncode == 0, done.stderr
    base, less = frequencies(tmp_path / "base"), frequencies(tmp_path / "less")
    assert less == pytest.approx([f * 0.95**-0.5 for f in base], rel=1e-4)


def test_the_example_has_thirty_lines_and_no_faults():
    assert len(EXAMPLE.read_text(encoding="utf-8").splitlines()) <= 30
    assert effect_faults(model.read_effect(EXAMPLE)) == ()


@pytest.mark.slow
def test_a_new_file_alone_makes_an_effect(tmp_path, stack_file):
    """A file written by following the README: listed, explained, checked and used, and nothing else is touched."""
    mine = tmp_path / "mine.py"
    text = EXAMPLE.read_text(encoding="utf-8").replace("gap_spring", "my_wedge")
    mine.write_text(text, encoding="utf-8")
    listed = lamella("effects", "--effect-file", mine)
    assert listed.returncode == 0, listed.stderr
    assert "my_wedge" in listed.stdout
    assert "my_wedge" not in lamella("effects").stdout
    solved = {}
    for folder, options in {"base": (), "mine": ("--effect", "my_wedge", "--effect-file", mine)}.items():
        done = lamella("model", stack_file, "-o", tmp_path / folder, "-n", 3, *options)
        assert done.returncode == 0, done.stderr
        solved[folder] = frequencies(tmp_path / folder)
    assert all(b > 1.0005 * a for a, b in zip(solved["base"], solved["mine"], strict=True))


def test_a_faulty_file_is_reported(tmp_path):
    mine = tmp_path / "mine.py"
    text = EXAMPLE.read_text(encoding="utf-8")
    mine.write_text(text.replace("Mistaken for:", "Like").replace("lower=0.0", "lower=-1e10"), encoding="utf-8")
    done = lamella("effects", "gap_spring", "--effect-file", mine)
    assert done.returncode == 1
    assert "lacks a paragraph that begins with 'Mistaken for:'" in done.stdout.replace("\n", " ")
    assert "the matrix K is negative" in done.stdout.replace("\n", " ")
