"""MATLAB and HDF5 files as sources of FRFs: what a campaign file says of their variables, and what is wrong."""

import h5py
import numpy as np
import pytest
from pydantic import ValidationError
from scipy.io import savemat

from ema.campaign.campaign import read_campaign
from ema.campaign.measurement import read_measurement
from ema.io import array_files
from ema.io.measured_function import parse_unit
from ema.io.variables import VariableLayout, read_variables
from ema.types.errors import CampaignError, MeasurementError

FREQUENCY = np.array([10.0, 10.5, 11.0, 11.5])
rng = np.random.default_rng(0)
VALUE = rng.standard_normal((4, 3, 2)) + 1j * rng.standard_normal((4, 3, 2))  # frequency, output, input
UNIT = parse_unit("g/N")
WHOLE = {
    "H": VALUE,
    "f": FREQUENCY,
    "coh": np.abs(VALUE) / 10,
    "points": np.array([1, 2, 12]),
    "directions": np.array([3, -3, 1]),
    "shakers": np.array([45, 46]),
    "what": "a text",
    "cell": np.array([1, "b"], dtype=object),
}
LAYOUT = {
    "frf": "H",
    "axes": ["frequency", "output", "input"],
    "frequency": "f",
    "output_point": "points",
    "output_direction": "directions",
    "input_point": "shakers",
    "input_direction": "-Z",
    "coherence": "coh",
}


def v73(file, content):
    """Write variables as MATLAB 7.3 does: axes reversed, complex numbers as pairs, cells apart."""
    with h5py.File(file, "w", userblock_size=512) as written:
        for name, value in content.items():
            if name in ("what", "cell"):
                written[f"#refs#/{name}"] = np.arange(4.0)
                continue
            array = np.atleast_2d(value).T
            if np.iscomplexobj(array):
                pairs = np.empty(array.shape, [("real", float), ("imag", float)])
                pairs["real"], pairs["imag"] = array.real, array.imag
                array = pairs
            written[name.replace(".", "/")] = array


def hdf5(file, content):
    with h5py.File(file, "w") as written:
        for name, value in content.items():
            if name != "cell":
                written[name] = value


def mat(file, content):
    savemat(file, content, do_compression=True)


def mat4(file, content):
    savemat(file, {k: v for k, v in content.items() if k != "cell" and np.ndim(v) < 3}, format="4")


WRITERS = {"mat": mat, "mat 7.3": v73, "hdf5": hdf5}


def read(tmp_path, kind, content, **layout):
    file = tmp_path / ("a.h5" if kind == "hdf5" else "a.mat")
    (mat4 if kind == "mat 4" else WRITERS[kind])(file, content)
    return read_variables(file, VariableLayout(**layout), UNIT, matlab=kind != "hdf5")


def block(functions, kind="frf"):
    return np.array([f.value for f in functions if f.kind == kind])


@pytest.mark.parametrize("kind", WRITERS)
def test_a_whole_description(tmp_path, kind):
    functions = read(tmp_path, kind, WHOLE, **LAYOUT)
    assert [f.kind for f in functions] == ["frf"] * 6 + ["coherence"] * 6
    in_order = VALUE.reshape(4, 6).T
    np.testing.assert_allclose(block(functions), 9.80665 * in_order, rtol=1e-14)
    np.testing.assert_allclose(block(functions, "coherence"), np.abs(in_order) / 10, rtol=1e-14)
    assert [f.output for f in functions[:6:2]] == [(1, 3), (2, -3), (12, 1)]
    assert [f.input for f in functions[:2]] == [(45, -3), (46, -3)]
    assert functions[0].quantity == "accelerance"
    np.testing.assert_array_equal(functions[7].abscissa, FREQUENCY)
    assert functions[3].source.endswith("variable 'H', output 2, input 2")


@pytest.mark.parametrize("kind", WRITERS)
@pytest.mark.parametrize("axes", [("output", "frequency", "input"), ("input", "output", "frequency")])
def test_the_order_of_the_axes(tmp_path, kind, axes):
    order = [("frequency", "output", "input").index(axis) for axis in axes]
    turned = {name: v.transpose(order) if np.ndim(v) == 3 else v for name, v in WHOLE.items()}
    functions = read(tmp_path, kind, turned, **(LAYOUT | {"axes": axes}))
    np.testing.assert_allclose(block(functions), 9.80665 * VALUE.reshape(4, 6).T, rtol=1e-14)


@pytest.mark.parametrize("kind", [*WRITERS, "mat 4"])
def test_parts_and_a_frequency_step(tmp_path, kind):
    content = {"re": VALUE[:, :, 0].real, "im": VALUE[:, :, 0].imag}
    layout = {"real": "re", "imaginary": "im", "axis_start": 10, "axis_step": 0.5}
    functions = read(tmp_path, kind, content, **layout)
    np.testing.assert_allclose(block(functions), 9.80665 * VALUE[:, :, 0].T, rtol=1e-14)
    np.testing.assert_allclose(functions[0].abscissa, FREQUENCY)
    assert functions[0].output is None


@pytest.mark.parametrize("kind", [*WRITERS, "mat 4"])
@pytest.mark.parametrize(
    ("axes", "shape"),
    [(["frequency"], 4), (["output", "frequency"], (1, 4)), (["frequency", "output", "input"], (4, 1))],
)
def test_axes_of_length_one_may_be_left_out(tmp_path, kind, axes, shape):
    content = {"H": VALUE[:, 0, 0].reshape(shape), "f": FREQUENCY}
    (function,) = read(tmp_path, kind, content, frf="H", frequency="f", axes=axes)
    np.testing.assert_allclose(function.value, 9.80665 * VALUE[:, 0, 0], rtol=1e-14)


@pytest.mark.parametrize("kind", WRITERS)
def test_structures_and_groups(tmp_path, kind):
    inner = {"H": VALUE[:, :, 0], "f": FREQUENCY}
    content, names = {"data": {"frf": inner}}, {"frf": "data.frf.H", "frequency": "data.frf.f"}
    if kind == "mat 7.3":
        content = {f"data.frf.{name}": value for name, value in inner.items()}
    if kind == "hdf5":
        content = {f"data/frf/{name}": value for name, value in inner.items()}
        names = {"frf": "/data/frf/H", "frequency": "data/frf/f"}
    functions = read(tmp_path, kind, content, **names)
    np.testing.assert_allclose(block(functions), 9.80665 * VALUE[:, :, 0].T, rtol=1e-14)


@pytest.mark.parametrize("kind", WRITERS)
@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"frf": "G"}, r"variable 'G' \(frf\): no numbers of that name; the file holds .*H \(4 x 3 x 2\)"),
        ({"frf": "cell"}, r"variable 'cell' \(frf\): no numbers of that name"),
        ({"frf": "coh"}, r"variable 'coh' \(frf\): its numbers are real.* 'real' and 'imaginary'"),
        ({"axes": ["frequency", "output"]}, r"'H' \(frf\): 4 x 3 x 2 are more axes than axes = "),
        ({"axes": ["output", "frequency", "input"]}, r"'f' \(frequency\): expected 3 real numbers.*is the order axes"),
        ({"frequency": "down"}, r"variable 'down' \(frequency\): value 3: the frequency does not ascend"),
        ({"coherence": "f"}, r"'f' \(coherence\): .* in the shape of 'H'"),
        ({"coherence": "H"}, r"'H' \(coherence\): expected real numbers"),
        ({"output_point": "f"}, r"variable 'f' \(output_point\): .*4.* numbers for 3 outputs"),
        ({"output_point": "halves"}, r"variable 'halves' \(output_point\): expected whole numbers"),
        ({"output_direction": "points"}, r"variable 'points' \(output_direction\): value 3 is 12, expected a dir"),
        ({"input_direction": "z"}, r"variable 'z' \(input_direction\): no numbers of that name"),
        ({"input_point": 10**25}, r"\(input_point\): value 1 is 1e\+25, expected a point number"),
    ],
)  # fmt: skip
def test_faults_are_named(tmp_path, kind, changes, said):
    content = WHOLE | {"down": FREQUENCY[[0, 2, 1, 3]], "halves": np.array([0.5, 1, 2])}
    with pytest.raises(MeasurementError, match=said) as fault:
        read(tmp_path, kind, content, **(LAYOUT | changes))
    assert str(fault.value).startswith(str(tmp_path / "a."))


@pytest.mark.parametrize("kind", WRITERS)
def test_parts_that_do_not_fit(tmp_path, kind):
    with pytest.raises(MeasurementError, match=r"'re' \(real\) and 'f' \(imaginary\): expected real numbers in one"):
        read(tmp_path, kind, {"re": VALUE[:, :, 0].real, "f": FREQUENCY}, real="re", imaginary="f", axis_step=1)


@pytest.mark.parametrize("kind", WRITERS)
def test_an_array_beyond_all_measure_is_not_read(tmp_path, kind, monkeypatch):
    monkeypatch.setattr(array_files, "LARGEST", 20)
    with pytest.raises(MeasurementError, match=r"'H' \(frf\): holds 4 x 3 x 2, expected 1 to 20 values"):
        read(tmp_path, kind, WHOLE, **LAYOUT)


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("a.mat", b"MATLAB 5.0 MAT-file" + bytes(400), "cannot be read as a MATLAB file"),
        ("a.h5", b"f,re,im\n1,2,3\n", "is not an HDF5 file"),
        ("a.h5", b"\x89HDF\r\n\x1a\n" + bytes(100), "cannot be read as a HDF5 file"),
        ("none.mat", None, "cannot be read: No such file"),
    ],
)
def test_files_of_another_kind(tmp_path, name, content, said):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(MeasurementError, match=said):
        read_variables(tmp_path / name, VariableLayout(**LAYOUT), UNIT, matlab=name.endswith("mat"))


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"frf": None}, "give either 'frf'"),
        ({"real": "re"}, "give either 'frf'"),
        ({"frf": None, "real": "re"}, "give either 'frf'"),
        ({"axes": ["output"]}, "'frequency' always"),
        ({"axes": ["frequency", "frequency"]}, "once"),
        ({"frequency": None}, "axis_step must be positive"),
        ({"output_direction": None}, "belong together"),
        ({"input_point": None}, "belong together"),
    ],
)
def test_impossible_descriptions_are_refused(changes, said):
    with pytest.raises(ValidationError, match=said):
        VariableLayout(**(LAYOUT | changes))


CAMPAIGN = """
[campaign]
name = "arrays"
[points]
file = "points.csv"
unit = "mm"
[measurement]
unit = "m/s2/N"
[measurement.variables]
frf = "H"
frequency = "f"
[[configuration]]
name = "M1"
files = ["run.mat", "run.h5"]
output = ["1+z", "2+z", "3+z", "4+z", "5+z", "6+z"]
input = ["1+z"]
"""


@pytest.fixture
def folder(tmp_path):
    content = {"H": VALUE[:, :, 0], "f": FREQUENCY}
    mat(tmp_path / "run.mat", content)
    hdf5(tmp_path / "run.h5", {"H": VALUE[:, :, 1], "f": FREQUENCY})
    (tmp_path / "points.csv").write_text("node,x,y,z\n" + "".join(f"{n},{n},0,0\n" for n in range(1, 7)))
    (tmp_path / "campaign.toml").write_text(CAMPAIGN)
    return tmp_path


def test_a_campaign_of_arrays(folder):
    frf = read_measurement(read_campaign(folder / "campaign.toml"), "M1").frf
    np.testing.assert_allclose(frf.value[:, 0], np.vstack([VALUE[:, :, 0].T, VALUE[:, :, 1].T]))
    np.testing.assert_array_equal(frf.run, [0, 0, 0, 1, 1, 1])


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('unit = "m/s2/N"', "", "MATLAB, HDF5, NumPy and TDMS files need 'unit' and .measurement.variables."),
        ('[measurement.variables]\nfrf = "H"\nfrequency = "f"', "", "need 'unit' and .measurement.variables."),
        ("frf =", "frff =", "measurement.variables.frff: unknown key; did you mean 'frf'"),
        ('unit = "m/s2/N"', '[measurement.time]\nwindow = "hann"', "measurement: .* is of files of FRFs"),
    ],
)
def test_what_a_campaign_must_say(folder, old, new, said):
    assert old in CAMPAIGN
    (folder / "campaign.toml").write_text(CAMPAIGN.replace(old, new))
    with pytest.raises(CampaignError, match=said):
        read_campaign(folder / "campaign.toml")


@pytest.mark.parametrize("kind", WRITERS)
def test_several_variables_with_frequencies_in_their_first_column(tmp_path, kind):
    content = {f"H1_{k + 2}": np.column_stack([FREQUENCY, VALUE[:, k, 0]]) for k in range(2)}
    functions = read(tmp_path, kind, content, frf=["H1_2", "H1_3"], frequency="first column")
    np.testing.assert_allclose(block(functions), 9.80665 * VALUE[:, :2, 0].T, rtol=1e-14)
    np.testing.assert_array_equal(functions[1].abscissa, FREQUENCY)
    assert functions[1].source.endswith("variable 'H1_3', output 1, input 1")


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ({"G": np.column_stack([FREQUENCY + 1, VALUE[:, 1, 0]])}, "'G' .frequency.: expected .* the same as in 'H'"),
        ({"G": VALUE[:, 1, 0]}, "'G' .frf.: expected the frequencies in its first column"),
        ({"G": np.column_stack([FREQUENCY, VALUE[:, 1, 0]])[1:]}, "'G' .frf.: .* do not fit"),
        ({"G": np.column_stack([FREQUENCY, VALUE[:, 1, 0]]), "coh": np.ones((len(FREQUENCY), 2))},
         "'coh' .coherence.: expected one for each of the 2"),
    ],
)  # fmt: skip
def test_several_variables_that_do_not_fit(tmp_path, content, said):
    content = {"H": np.column_stack([FREQUENCY, VALUE[:, 0, 0]])} | content
    coherence = ["coh"] if "coh" in content else None
    with pytest.raises(MeasurementError, match=said):
        read(tmp_path, "mat", content, frf=["H", "G"], frequency="first column", coherence=coherence)


def test_files_of_numpy_are_read(tmp_path):
    np.savez(tmp_path / "a.npz", H=VALUE, f=FREQUENCY, what=np.array([{"an": "object"}], dtype=object))
    np.save(tmp_path / "b.npy", VALUE)
    with array_files.arrays_in(tmp_path / "a.npz", matlab=False) as arrays:
        assert list(arrays) == ["H", "f"]  # objects could be programs
        np.testing.assert_array_equal(arrays["H"].read(), VALUE)
    with array_files.arrays_in(tmp_path / "b.npy", matlab=False) as arrays:
        assert arrays["array"].shape == VALUE.shape
        np.testing.assert_array_equal(arrays["array"].read(), VALUE)


def test_a_damaged_file_of_numpy_is_said_to_be_one(tmp_path):
    np.save(tmp_path / "b.npy", VALUE)
    (tmp_path / "b.npy").write_bytes((tmp_path / "b.npy").read_bytes()[:30])
    with (
        pytest.raises(MeasurementError, match="as a NumPy file"),
        array_files.arrays_in(tmp_path / "b.npy", matlab=False),
    ):
        pass
