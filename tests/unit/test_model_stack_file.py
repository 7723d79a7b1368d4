from pathlib import Path

import pytest

import model

CLAMP = "[[clamps]]\nmass_kg = 2.0\nx_mm = 100\n"


def write(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "stack.toml"
    path.write_text(text)
    return path


def test_units_become_si(tmp_path, stack_text):
    stack = model.read_stack(write(tmp_path, stack_text + CLAMP))
    assert stack.length == pytest.approx(0.3)
    assert stack.pitch == pytest.approx(0.065 / 240)
    assert stack.material.young == pytest.approx(200e9)
    assert stack.contact.pressure == pytest.approx(320e3)
    assert stack.contact.normal_modulus == pytest.approx(5e9)
    assert stack.clamps[0].x == pytest.approx(0.1)
    assert stack.clamps[0].distribution == "height"
    assert stack.mass == pytest.approx(7650 * 0.3 * 0.08 * 0.065 + 2.0)
    assert stack.with_contact(G_f=1000.0).contact.G_f == 1000.0


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("pressure_kPa", "presure_kPa", ["contact.presure_kPa", "did you mean 'pressure_kPa'", "normal_modulus_GPa"]),
        ("poisson = 0.28\n", "", ["material.poisson: this key is missing"]),
        ("G_f = 825", 'G_f = "stiff"', ["contact.G_f", "'stiff'"]),
        ("G_f = 825", "G_f = -1", ["G_f must be positive", "-1"]),
        ("x_mm = 100", "x_mm = 200", ["clamps[1]", "outside the stack", "0.15"]),
        ("x_mm = 100", 'x_mm = 100\ndistribution = "side"', ["clamps[1].distribution", "'side'"]),
        ("length_mm = 300", "length_mm = 0", ["length must be positive"]),
        ("n_lamina = 240", "n_lamina = 1000000000", ["n_lamina = 1000000000", "m thick"]),
        ("[material]", "[material", ["not a TOML file"]),
    ],
)
def test_faults_are_named_with_file_key_and_what_would_be_right(tmp_path, stack_text, old, new, says):
    path = write(tmp_path, (stack_text + CLAMP).replace(old, new))
    with pytest.raises(model.StackError) as caught:
        model.read_stack(path)
    for part in [str(path), *says]:
        assert part in str(caught.value)


def test_missing_file_is_named(tmp_path):
    with pytest.raises(model.StackError, match=r"nowhere\.toml"):
        model.read_stack(tmp_path / "nowhere.toml")


@pytest.mark.parametrize("calibration", ["C0", "C1", "C2", "C3"])
def test_shipped_stacks_are_valid(calibration):
    path = Path(__file__).parents[2] / "data/pirnat2013" / f"stack_{calibration}.toml"
    assert model.read_stack(path).n_lamina == 240
