"""Tables of a stack file beyond sheets and uniform contact: pressing, torque and force, layers, supports, outline."""

from pathlib import Path

import numpy as np
import pytest

import model
from model.stack.parts import EdgeSupport, PatchSupport, Pressing

DATA = Path(__file__).parents[2] / "data"
CONTACT = f'torque_Nm = 1.5\ntorque_table = "{DATA}/pirnat2013/table2_pressure.csv"\n'
TABLES = f"""[pressing]
curve = "{DATA}/contact/compression_standin.csv"
plate_thickness_mm = 20
[[clamps]]
mass_kg = 2.0
x_mm = 100
footprint_mm = [40, 60]
[[clamps]]
mass_kg = 2.0
x_mm = -100
[[interlayers]]
below = 80
thickness_mm = 2
shear_modulus_MPa = 1.5
normal_modulus_MPa = 60
density_kg_m3 = 1150
[[interlayers]]
below = 160
thickness_mm = 2
shear_modulus_MPa = 1.5
normal_modulus_MPa = 60
density_kg_m3 = 1150
[[supports]]
edge = "left"
condition = "clamped"
[[supports]]
patch_mm = [10, 20, 30, 40]
across_N_m3 = 5e6
laminas = "bottom"
"""


@pytest.fixture
def text(stack_text):
    """Every table that a stack file can have."""
    contact = stack_text.index("pressure_kPa")
    return stack_text[:contact].replace("height_mm = 65", "height_mm = 69") + CONTACT + TABLES


def read(tmp_path: Path, text: str) -> model.Stack:
    path = tmp_path / "stack.toml"
    path.write_text(text)
    return model.read_stack(path)


def test_every_table_becomes_si(tmp_path, text):
    stack = read(tmp_path, text)
    assert stack.contact.pressure == pytest.approx(160e3)
    assert isinstance(stack.pressing, Pressing)
    assert stack.pressing.plate_rigidity == pytest.approx(200e9 * 0.02**3 / 12 / 0.91)
    tangent = (160e3 + 40e3) / 3.6e-4  # of the stand-in's law
    assert stack.contact.normal_modulus == pytest.approx(tangent, rel=0.02)
    assert stack.pitch == pytest.approx(0.065 / 240)
    np.testing.assert_allclose(stack.spacing[[79, 80, 159]], stack.pitch + np.array([2e-3, 0.0, 2e-3]))
    assert stack.interlayers[1].shear_modulus == 1.5e6
    edge, patch = stack.supports
    assert isinstance(edge, EdgeSupport)
    assert (edge.along, edge.across, edge.rotation) == (np.inf, np.inf, np.inf)
    assert isinstance(patch, PatchSupport)
    assert (patch.x, patch.size, patch.across, patch.laminas) == (0.01, (0.03, 0.04), 5e6, "bottom")


def test_bolt_forces_give_the_mean_pressure_and_the_shares(tmp_path, text):
    text = text.replace("torque_Nm = 1.5\n", "").replace("[[clamps]]", "[[clamps]]\nforce_N = 3600")
    text = text.replace("force_N = 3600", "force_N = 1200", 1)
    stack = read(tmp_path, text)
    assert stack.contact.pressure == pytest.approx(4800 / 0.024)
    assert [clamp.share for clamp in stack.clamps] == [1200, 3600]


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("torque_Nm = 1.5", "", "must be given by one of contact.pressure_kPa, contact.torque_Nm, clamps.force_N"),
        ("torque_Nm = 1.5", "torque_Nm = 1.5\npressure_kPa = 160", "given are contact.pressure_kPa, contact.torque_Nm"),
        ("torque_Nm = 1.5", "torque_Nm = 4", "lies outside the table"),
        ("plate_thickness_mm = 20", "", "give the plates either"),
        ("compression_standin", "nothing", "nothing.csv: cannot be read"),
        ("below = 160", "below = 80", "can hold one layer"),
        ("below = 160", "below = 240", "from 1 to 239"),
        ('edge = "left"\n', "", "give either edge or patch_mm"),
        ('condition = "clamped"', 'condition = "clamped"\nacross_N_m2 = 1.0', "stiffness goes with"),
        ("across_N_m3 = 5e6", "across_N_m2 = 5e6", "a patch along_N_m3, across_N_m3"),
        ("length_mm = 300", "", "length_mm is missing; a rectangle needs it"),
        ("[pressing]", '[outline]\nkind = "ring"\n[pressing]', "length_mm does not go with outline.kind = 'ring'"),
    ],
)
def test_faults_are_named(tmp_path, text, old, new, says):
    with pytest.raises(model.StackError) as caught:
        read(tmp_path, text.replace(old, new))
    assert says in str(caught.value)
