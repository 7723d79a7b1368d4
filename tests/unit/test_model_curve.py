from pathlib import Path

import numpy as np
import pytest

import model
from model.stack.parts import CompressionCurve, read_curve

DATA = Path(__file__).parents[2] / "data/contact"


def test_standin_follows_the_law_that_its_readme_states():
    curve = read_curve(DATA / "compression_standin.csv")
    strain = np.linspace(0.0, 1.9e-3, 200)
    pressure, tangent = curve.evaluate(strain)
    law = 40e3 * np.expm1(strain / 3.6e-4)
    np.testing.assert_allclose(pressure, law, rtol=1e-3, atol=300.0)
    np.testing.assert_allclose(tangent[10:], (law[10:] + 40e3) / 3.6e-4, rtol=0.02)


def test_contact_does_not_pull_and_the_tangent_is_the_derivative():
    curve = CompressionCurve(strain=[0.0, 1e-3, 1.5e-3, 3e-3], pressure=[0.0, 1e4, 1e5, 2e5])
    pressure, tangent = curve.evaluate(np.array([-1e-3, -1e-12, 0.0]))
    np.testing.assert_array_equal(pressure, 0.0)
    assert tangent[0] == tangent[1] == 0.0
    assert tangent[2] == pytest.approx(0.5e7)
    strain, h = np.linspace(1e-5, 4e-3, 100), 1e-9
    slope = (curve.evaluate(strain + h)[0] - curve.evaluate(strain - h)[0]) / (2 * h)
    np.testing.assert_allclose(curve.evaluate(strain)[1], slope, rtol=1e-4, atol=10.0)
    assert np.all(np.diff(curve.evaluate(strain)[0]) > 0.0)
    assert curve.evaluate(np.array([curve.strain_at(5e4)]))[0][0] == pytest.approx(5e4, rel=1e-12)


def test_beyond_its_end_the_curve_is_straight_but_gives_no_strain():
    curve = CompressionCurve(strain=[0.0, 1e-3, 2e-3], pressure=[0.0, 1e5, 3e5])
    pressure, tangent = curve.evaluate(np.array([2e-3, 3e-3]))
    assert pressure[1] == pytest.approx(pressure[0] + tangent[0] * 1e-3)
    with pytest.raises(model.StackError, match="ends at 300 kPa"):
        curve.strain_at(3.1e5)


@pytest.mark.parametrize(
    ("strain", "pressure", "message"),
    [
        ([0.0, 1e-3], [0.0, 1e5], "at least 3"),
        ([1e-4, 1e-3, 2e-3], [0.0, 1e5, 2e5], r"must be \(0, 0\)"),
        ([0.0, 1e-3, 2e-3], [0.0, 2e5, 1e5], "pressure must rise .* point 3 has 100000 after 200000"),
        ([0.0, 1e-3, 1e-3], [0.0, 1e5, 2e5], "strain must rise"),
        ([0.0, 1e-3, 2e-3], [0.0, 1e-320, 2e5], "pressure must rise .* by 1e-12 of the largest"),
        ([0.0, 1e-3, np.inf], [0.0, 1e5, 2e5], "strain must be finite, but that of point 3"),
        ([0.0, 1e-3, 2e-3], [0.0, 1e5, np.inf], "pressure must be finite, but that of point 3"),
    ],
)
def test_impossible_curves_are_refused(strain, pressure, message):
    with pytest.raises(model.StackError, match=message):
        CompressionCurve(strain=strain, pressure=pressure)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("strain,pressure\n0,0\n", "curve.csv: column pressure_kPa is missing"),
        ("strain,pressure_kPa\n0,0\n1e-3,x\n", "row 2: .* must be numbers"),
        ("# a comment\nstrain,pressure_kPa\n0,0\n1e-3,10\n", "curve.csv: compression curve: 2 points"),
    ],
)
def test_damaged_files_are_refused_with_their_place(tmp_path, text, message):
    path = tmp_path / "curve.csv"
    path.write_text(text)
    with pytest.raises(model.StackError, match=message):
        read_curve(path)
