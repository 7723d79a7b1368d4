"""Modes that other programs identified: read from their files, written, and used as identified ones are."""

import dataclasses
import json
import warnings
from pathlib import Path

import numpy as np
import pytest

import ema
from ema.io.found_modes import FoundModes, read_modes_table
from ema.io.modes_uff import read_modes_uff
from ema.io.sdynpy import read_modes_numpy
from ema.modal.read_modes import USUAL, modal_model_of
from tests.command import lamella
from updating.report.results import read_results

pytestmark = pytest.mark.usefixtures("all_undrawn")
REALDATA = Path(__file__).parents[2].parent / "shared/realdata/uff-oddities-pyuff"
REAL = pytest.mark.skipif(not REALDATA.exists(), reason=f"real files are not at {REALDATA}")
COORDINATE = np.array([[0.1 * i, 0.05 * (i % 2), 0.02] for i in range(6)])
GEOMETRY = ema.Geometry(node=np.arange(1, 7), coordinate=COORDINATE, line=np.array([[1, 2], [3, 4]]))
FREQUENCY, DAMPING = np.array([101.25, 207.5, 333.0]), np.array([0.004, 0.006, 0.011])
RNG = np.random.default_rng(7)
SHAPE = RNG.standard_normal((6, 3)) + 0.1j * RNG.standard_normal((6, 3))
Z = np.tile([0.0, 0.0, 1.0], (6, 1))
FORCE = ema.Dof(2, (0.0, 0.0, 1.0))


def model(scaled=True, geometry=GEOMETRY, direction=Z):
    nothing = np.full(3, np.nan)
    found = FoundModes(
        source="somewhere", frequency=FREQUENCY, damping=DAMPING, frequency_std=nothing, damping_std=nothing,
        shape=SHAPE, shape_std=nothing, scaled=np.full(3, scaled), node=np.arange(1, 7), direction=direction,
    )  # fmt: skip
    return modal_model_of(found, name="M1", geometry=geometry, force=FORCE)


def alike(found, expected, tolerance=1e-4):
    """Compare modes, with shapes up to their sign."""
    np.testing.assert_allclose(found.frequency, expected.frequency, rtol=tolerance)
    np.testing.assert_allclose(found.damping, expected.damping, rtol=10 * tolerance)
    assert found.node.tolist() == expected.node.tolist()
    np.testing.assert_allclose(found.direction, expected.direction, atol=1e-6)
    sign = np.sign(np.sum(found.shape * expected.shape.conj(), axis=0).real)
    np.testing.assert_allclose(found.shape * sign, expected.shape, atol=tolerance * np.abs(expected.shape).max())


@pytest.mark.parametrize("turned", [False, True])
def test_universal_file_comes_back_with_scale_and_complex_shapes(tmp_path, turned):
    axes, direction = np.broadcast_to(np.eye(3), (6, 3, 3)), Z
    if turned:  # local axes about x: what is along z of a point lies askew
        c, s = np.cos(0.4), np.sin(0.4)
        axes = np.broadcast_to([[1, 0, 0], [0, c, s], [0, -s, c]], (6, 3, 3))
        direction = np.tile(axes[0, 2], (6, 1))
    geometry = dataclasses.replace(GEOMETRY, axes=axes)
    expected = model(geometry=geometry, direction=direction)
    ema.write_uff(tmp_path / "modes.uff", geometry, modal_model=expected)
    found = read_modes_uff(tmp_path / "modes.uff", geometry)
    assert found.scaled.all()
    keep = np.abs(found.direction @ direction[0]) > 0.999
    kept = {name: getattr(found, name)[keep] for name in ("node", "direction", "shape", "sensor")}
    found = dataclasses.replace(found, **kept)
    alike(found, expected)


def test_modal_mass_in_the_units_of_the_file(tmp_path):
    """In mm and N a modal mass of one is a tonne, so that shapes of unit modal mass in SI are smaller by sqrt(1000)."""
    head = "    -1\n   164\n         5mm, N                        2\n"
    head += "  1.0000000000000000D+03  1.0000000000000000D+00  1.0000000000000000D+00\n  2.7315000000000000D+02\n"
    (tmp_path / "m.unv").write_text(head + "    -1\n" + data_set_55(100.0, 4.0, 0.01))
    found = read_modes_uff(tmp_path / "m.unv", GEOMETRY)
    np.testing.assert_allclose(found.shape[:, 0], np.array([1.0, -2.0]) / np.sqrt(4.0 * 1e3), rtol=1e-6)
    assert found.scaled.all()


def data_set_55(frequency, mass, damping, *, last="  0.00000E+00 0.00000E+00-2.00000E+00"):
    numbers = f"{frequency:13.5E}{mass:13.5E}{damping:13.5E}{0.0:13.5E}"
    return (
        "    -1\n    55\n"
        + 5 * "NONE\n"
        + f"{1:10}{2:10}{2:10}{8:10}{2:10}{3:10}\n{2:10}{4:10}{0:10}{1:10}\n{numbers}\n"
        f"{1:10}\n  0.00000E+00 0.00000E+00 1.00000E+00\n{2:10}\n{last}\n    -1\n"
    )


def data_set_2414(form, values):
    head = f"{1:10}\nmode\n{1:10}\n" + 5 * "NONE\n" + f"{1:10}{2 if form == 2 else 3:10}{2:10}{8:10}{form:10}{3:10}\n"
    head += 2 * f"{1:10}{0:10}{1:10}{0:10}{1:10}{1:10}{0:10}{0:10}\n"
    one = f"{0.0:13.5E}{100.0:13.5E}{0.0:13.5E}{4.0:13.5E}{0.01:13.5E}{0.0:13.5E}\n"
    eigen = "".join(f"{x:13.5E}" for x in (-6.28319, 628.287, 0.0, 0.0, 0.0, 0.0)) + "\n"
    return f"    -1\n  2414\n{head}{one}{eigen}{1:10}\n{values}\n    -1\n"


def test_data_set_2414_real_and_complex(tmp_path):
    (tmp_path / "real.unv").write_text(data_set_2414(2, "  0.00000E+00 0.00000E+00 3.00000E+00"))
    found = read_modes_uff(tmp_path / "real.unv", GEOMETRY)
    assert (found.frequency[0], found.damping[0], found.scaled[0]) == (100.0, 0.01, True)
    np.testing.assert_allclose(found.shape, [[1.5]])
    (tmp_path / "complex.unv").write_text(
        data_set_2414(5, " 0.00000E+00 0.00000E+00 0.00000E+00 0.00000E+00 3.00000E+00-4.00000E+00")
    )
    found = read_modes_uff(tmp_path / "complex.unv", GEOMETRY)
    np.testing.assert_allclose(found.frequency, 100.0, rtol=1e-4)
    np.testing.assert_allclose(found.damping, 0.01, rtol=1e-4)
    np.testing.assert_allclose(found.shape, [[3 - 4j]])
    assert not found.scaled[0]


def test_exported_tables_come_back(tmp_path):
    expected = model()
    ema.write_modes_csv(tmp_path / "modes.csv", expected)
    ema.write_shapes_csv(tmp_path / "shapes.csv", expected)
    found = read_modes_table((tmp_path / "shapes.csv", tmp_path / "modes.csv"))
    alike(found, expected, 1e-12)
    assert found.scaled.all()
    np.testing.assert_allclose(found.frequency_std, expected.frequency_std)


def test_one_table_with_decimal_commas_and_percent(tmp_path):
    (tmp_path / "m.csv").write_text("frequency_Hz;damping_percent;1+z;2-z_real;2-z_imag\n100,5;0,4;1;0,5;-0,1\n")
    found = read_modes_table((tmp_path / "m.csv",))
    assert (found.frequency[0], found.damping[0]) == (100.5, pytest.approx(0.004))
    np.testing.assert_allclose(found.shape[:, 0], [1.0, 0.5 - 0.1j])
    np.testing.assert_allclose(found.direction, [[0, 0, 1], [0, 0, -1]])


@pytest.mark.parametrize("suffix", [".npy", ".npz"])
def test_shapes_of_sdynpy(tmp_path, suffix):
    """The structure of SDynPy's ShapeArray for real shapes: modal mass 4, direction codes; a rotation is left out."""
    coordinate = [("node", "uint64"), ("direction", "int8")]
    kind = [("frequency", "f8"), ("damping", "f8"), ("coordinate", coordinate, (3,)), ("shape_matrix", "f8", (3,)),
            ("modal_mass", "f8"), ("comment1", "<U80")]  # fmt: skip
    array = np.zeros(2, kind)
    array["frequency"], array["damping"], array["modal_mass"] = [200.0, 100.0], [0.01, 0.02], 4.0
    array["coordinate"]["node"], array["coordinate"]["direction"] = [1, 2, 2], [3, -3, 5]
    array["shape_matrix"] = [[1.0, 2.0, 9.0], [3.0, -4.0, 9.0]]
    path = tmp_path / f"shapes{suffix}"
    np.save(path, array) if suffix == ".npy" else np.savez(path, shapes=array)
    found = read_modes_numpy(path, GEOMETRY)
    assert found.frequency.tolist() == [200.0, 100.0]
    assert found.scaled.all()
    np.testing.assert_allclose(found.shape, [[0.5, 1.5], [1.0, -2.0]])
    np.testing.assert_allclose(found.direction, [[0, 0, 1], [0, 0, -1]])


@REAL
def test_shapes_of_real_files():
    found = read_modes_uff(REALDATA / "uff55_translation.uff", GEOMETRY)
    assert found.frequency.tolist() == [10.0, 12.0, 13.0]
    assert np.isnan(found.damping).all()  # written as 0
    np.testing.assert_allclose(found.shape[::3, 1], [1.82904, -0.0398226, -0.500397, 1.98289])
    found = read_modes_uff(REALDATA / "uff55_translation_rotation.uff", GEOMETRY)
    np.testing.assert_allclose(found.frequency, 97.013)
    np.testing.assert_allclose(found.shape[:3, 0], [0.053569, 0.020271, 0.0046623])  # rotations are no part of it
    found = read_modes_uff(REALDATA / "uff55 sample_test record10.uff", GEOMETRY)
    np.testing.assert_allclose(found.frequency, np.hypot(0.1111111, 41.11111) / 2 / np.pi, rtol=1e-6)
    shape = found.shape[found.node == 111111, 0]
    expected = (0.1111111 + 0.09111111j) / (0.007111111 + 0.004111111j)  # whatever modal A makes of their scale
    np.testing.assert_allclose(shape[0] / shape[1], expected, rtol=1e-6)


@REAL
def test_a_temperature_is_no_mode():
    with pytest.raises(ema.MeasurementError, match=r"no mode shape .*holds no mode \(static\)"):
        read_modes_uff(REALDATA / "heat_engine_housing.uff", GEOMETRY)


GOOD = "frequency_Hz,damping,1+z,2+z\n100,0.01,1,2\n"


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("m.csv", GOOD.replace("0.01", "1.2"), r"row 2: the damping ratio is 1.2, .* damping_percent"),
        ("m.csv", GOOD.replace("100", "1oo"), r"row 2: frequency_hz is '1oo', expected a number"),
        ("m.csv", GOOD.replace("100", "-3"), r"row 2: frequency_Hz is -3, expected a number above 0"),
        ("m.csv", GOOD.replace(",1+z,2+z", ",a,b"), "holds no shapes: expected a column for each DOF, such as 12"),
        ("m.csv", GOOD.replace(",1,2", ",0,0"), "the shape of mode 1 is zero at every point"),
        ("m.csv", GOOD.replace("2+z", "9+z"), r"shapes at points \[9\], which are not in .*points.csv; add them"),
        ("m.csv", GOOD.replace(",1,2", ",1,2,3"), "row 2 has 5 cells, and row 1 4 names"),
        ("m.csv", GOOD.replace("2+z", "1+z"), "row 1 names the column '1\\+z' twice"),
        ("m.unv", data_set_55(9.0, 1.0, 0.01, last="  0.00000E+00"), r"\(55\): point 2 has 1 finite values, expect"),
        ("m.unv", data_set_55(9.0, 1.0, 0.01).replace("    2\n  0", "    x\n  0"), "a point number, found 'x'"),
        ("m.unv", data_set_55(0.0, 1.0, 0.01), "no mode shape .*frequency 0 Hz"),
        ("m.unv", data_set_55(9.0, 1.0, 0.01).replace("NONE\n", ""), "line 6 of the set should be 6 whole numbers"),
        ("m.npy", "no array", "cannot be read as a NumPy file"),
        ("m.mat", "x", "modes are read from universal files"),
    ],
)  # fmt: skip
def test_wrong_files_say_what_and_where(tmp_path, name, text, said):
    write_campaign(tmp_path, [name])
    (tmp_path / name).write_text(text)
    with pytest.raises(ema.MeasurementError, match=said) as error:
        ema.read_modes(ema.read_campaign(tmp_path / "campaign.toml"), "M1")
    assert name in str(error.value)


def write_campaign(folder, files, more="", modes=""):
    rows = [f"{n},{x},{y},{z}" for n, (x, y, z) in zip(GEOMETRY.node, 1e3 * COORDINATE, strict=True)]
    (folder / "points.csv").write_text("\n".join(["node,x,y,z", *rows]) + "\n")
    for file in files:
        (folder / file).touch()
    text = f"""
[campaign]
name = "read"
[points]
file = "points.csv"
unit = "mm"
{modes}
[[configuration]]
name = "M1"
modes = "file"
files = {json.dumps(files)}
{more}
"""
    (folder / "campaign.toml").write_text(text)
    return folder / "campaign.toml"


def written_tables(folder, more='input = "2+z"', modes=""):
    path = write_campaign(folder, ["modes.csv", "shapes.csv"], more, modes)
    ema.write_modes_csv(folder / "modes.csv", model())
    ema.write_shapes_csv(folder / "shapes.csv", model())
    return ema.read_campaign(path)


def test_read_modes_are_a_modal_model(tmp_path):
    found = ema.read_modes(written_tables(tmp_path), "M1")
    expected = model()
    alike(found.modal_model, expected, 1e-9)
    np.testing.assert_allclose(found.modal_model.residue, expected.residue, rtol=1e-9)
    np.testing.assert_allclose(found.modal_model.covariance, expected.covariance, rtol=1e-9)
    assert found.modal_model.input.name(0) == "2+z"
    assert any("not identified here" in note for note in found.notes)
    assert any("1 % of the shape" in note for note in found.notes)  # the tables state the other two


def test_stated_deviations_take_the_place_of_usual_ones(tmp_path):
    path = write_campaign(
        tmp_path, ["m.csv"], modes="[modes]\nfrequency_std = 0.002\ndamping_std = 0.3\nshape_std = 0.05\n"
    )
    (tmp_path / "m.csv").write_text("frequency_Hz,damping,1+z,2+z\n200,0.01,1,1\n100,,1,-1\n")
    found = ema.read_modes(ema.read_campaign(path), "M1")
    m = found.modal_model
    np.testing.assert_allclose(m.frequency_std, [0.2, 0.4])
    np.testing.assert_allclose(m.shape_std, 0.05)
    np.testing.assert_allclose(m.damping_std[1], 0.003)
    assert m.damping_std[0] > 1.0  # not stated: it says nothing
    assert not any("usual" in note for note in found.notes)
    assert any("the damping of the modes at 100 Hz is not stated" in note for note in found.notes)
    assert any('write input = "12+z"' in note for note in found.notes)
    assert USUAL.frequency == 1e-3


def test_commands_work_from_read_modes_and_skip_what_needs_functions(tmp_path):
    written_tables(tmp_path)
    out = tmp_path / "out"
    run = lamella("ema", tmp_path / "campaign.toml", "-o", out)
    assert run.returncode == 0, run.stdout + run.stderr
    assert "read from modes.csv" in run.stdout
    files = {file.name for file in (out / "M1").iterdir()}
    assert {"modal_model.json", "quality.json", "modes.uff", "modes.csv", "shapes.csv", "shape_03.png"} <= files
    assert not {"measurement.npz", "frf.png", "stabilization.png", "poles.txt"} & files
    document = json.loads((out / "M1/modal_model.json").read_text())
    assert document["provenance"]["options"]["modes"] == "read, not identified"
    assert "modes.csv" in document["provenance"]["inputs"]
    stamp = (out / "M1/modal_model.json").stat().st_mtime_ns
    assert lamella("ema", tmp_path / "campaign.toml", "-o", out).returncode == 0
    assert (out / "M1/modal_model.json").stat().st_mtime_ns == stamp  # read back, not made anew
    run = lamella("report", out)
    assert run.returncode == 0, run.stdout + run.stderr
    page = (out / "report.html").read_text()
    assert "Modes read from modes.csv" in page
    assert "there are no functions to show" in page
    tested = read_results(out).tested[0]
    assert not tested.has_functions
    run = lamella("pick", tmp_path / "campaign.toml", "M1", "-o", out)
    assert run.returncode != 0
    assert "no functions" in " ".join(run.stderr.split())


def test_new_drafts_a_campaign_of_modes(tmp_path):
    written_tables(tmp_path)
    (tmp_path / "campaign.toml").unlink()
    run = lamella("new", tmp_path)
    assert run.returncode == 0, run.stdout + run.stderr
    campaign = ema.read_campaign(tmp_path / "campaign.toml")
    assert [c.name for c in campaign.configurations] == ["modes"]
    alike(ema.read_modes(campaign, "modes").modal_model, model(), 1e-9)


def test_new_drafts_a_campaign_of_universal_files(tmp_path):
    for name in ("low", "high"):
        ema.write_uff(tmp_path / f"{name}.uff", GEOMETRY, modal_model=model())
    assert lamella("new", tmp_path).returncode == 0
    campaign = ema.read_campaign(tmp_path / "campaign.toml")
    assert [c.name for c in campaign.configurations] == ["high", "low"]
    alike(ema.read_modes(campaign, "low").modal_model, model())


def test_diagnosis_asks_where_the_force_acted(tmp_path, stack_text):
    written_tables(tmp_path, more="pressure_kPa = 100")
    (tmp_path / "stack.toml").write_text(stack_text)
    text = (tmp_path / "campaign.toml").read_text().replace("[points]", '[structure]\nstack = "stack.toml"\n[points]')
    (tmp_path / "campaign.toml").write_text(text)
    run = lamella("diagnose", tmp_path / "campaign.toml", "-o", tmp_path / "out")
    assert run.returncode != 0
    assert "needs to know where the force acted" in " ".join(run.stderr.split())


@pytest.fixture
def quiet():
    """Without the warnings of sdypy-EMA, which cuts the lines at its upper limit and then misses that limit."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


def sdypy_model():
    """A sdypy-EMA model of functions of the modes above, through its own poles and constants."""
    from sdypy import EMA

    frequency = np.arange(0.0, 500.0, 0.25)
    value = np.zeros((6, frequency.size), complex)
    value[:, 1:] = ema.synthesize(model(), frequency[1:], "accelerance")[:, 0]
    one = EMA.Model(value, frequency, lower=20.0, upper=480.0, pol_order_high=30, frf_form="accelerance")
    one.get_poles(show_progress=False)
    one.select_closest_poles(list(FREQUENCY))
    one.get_constants()
    return one


@pytest.mark.usefixtures("quiet")
def test_sdypy_and_back():
    one = sdypy_model()
    output = ema.Dofs(node=np.arange(1, 7), direction=Z)
    found = ema.from_sdypy(one, output=output, force=FORCE, geometry=GEOMETRY)
    poles = np.array([one.all_poles[i][j] for i, j in one.pole_ind])  # those that the constants belong to
    np.testing.assert_allclose(found.frequency, np.sort(np.abs(poles)) / (2.0 * np.pi), rtol=1e-12)
    np.testing.assert_allclose(one.nat_freq, FREQUENCY, rtol=1e-4)
    np.testing.assert_allclose(ema.mac(found.shape, model().shape).diagonal(), 1.0, atol=1e-3)
    lines = one.freq[200:1800]
    np.testing.assert_allclose(
        ema.synthesize(found, lines, "accelerance")[:, 0], one.H[:, 200:1800], rtol=1e-6, atol=1e-6
    )
    from sdypy import EMA

    back = ema.to_sdypy(found, EMA.Model(one.frf, one.freq, lower=20.0, upper=480.0, frf_form="accelerance"))
    np.testing.assert_allclose(back.nat_freq, found.frequency, rtol=1e-12)
    np.testing.assert_allclose(back.A, one.A, rtol=1e-12)
    np.testing.assert_allclose(np.diag(back.auto_mac()), 1.0)
    back.get_constants()  # with the poles that came back
    np.testing.assert_allclose(back.A, one.A, atol=1e-6 * np.abs(one.A).max())


def test_sdypy_model_without_constants_or_with_other_functions_is_refused():
    class Nothing:
        nat_freq = nat_xi = A = None

    output = ema.Dofs(node=np.arange(1, 7), direction=Z)
    with pytest.raises(ema.IdentificationError, match=r"no nat_freq, nat_xi, A; call get_poles\(\)"):
        ema.from_sdypy(Nothing(), output=output, force=FORCE, geometry=GEOMETRY)
    one = Nothing()
    one.nat_freq, one.nat_xi, one.A = FREQUENCY, DAMPING, np.ones((5, 3))
    with pytest.raises(ema.IdentificationError, match="A are 5 x 3, expected 6 outputs x 3 modes"):
        ema.from_sdypy(one, output=output, force=FORCE, geometry=GEOMETRY)
    with pytest.raises(ema.IdentificationError, match="has no residues"):
        ema.to_sdypy(model(scaled=False), Nothing())
