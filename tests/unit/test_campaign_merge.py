"""Runs become one block of FRFs: duplicates, gaps, axes, quantities and signs by rule, each with a note."""

import numpy as np
import pytest

from ema.campaign.campaign import read_campaign
from ema.campaign.measurement import read_measurement
from ema.io.uff import write_uff
from ema.types.errors import CampaignError, MeasurementError
from ema.types.frf import FRF, Dofs, Geometry

GEOMETRY = Geometry(node=[1, 2, 3, 4, 9, 11, 12, 13, 45], coordinate=np.eye(9, 3), line=[[1, 2]])
FREQUENCY = 1.0 * np.arange(1, 41)
HEAD = """
[campaign]
name = "t"
[points]
file = "points.uff"
[[configuration]]
name = "A"
files = ["run*.uff"]
"""


def value(output, force, frequency=FREQUENCY):
    """Return a receptance that differs between pairs and obeys reciprocity."""
    return 1.0 / ((output + force) - (frequency / 20) ** 2 + 0.1j)


def run(folder, name, outputs, inputs, *, frequency=FREQUENCY, quantity="accelerance", scale=1.0, coherence=None):
    axis = np.array([[0, 0, np.sign(n)] for n in outputs], float)
    force_axis = np.array([[0, 0, np.sign(n)] for n in inputs], float)
    block = np.array([[np.sign(o * i) * value(abs(o), abs(i), frequency) for i in inputs] for o in outputs])
    frf = FRF(
        frequency=frequency,
        value=scale * block,
        quantity=quantity,
        output=Dofs(node=np.abs(outputs), direction=axis),
        input=Dofs(node=np.abs(inputs), direction=force_axis),
        run=np.zeros(len(outputs)),
        source=("x",) * len(outputs),
        coherence=None if coherence is None else np.full(block.shape, coherence),
    )
    write_uff(folder / f"run{name}.uff", GEOMETRY, frf)


def measure(folder, text=HEAD):
    write_uff(folder / "points.uff", GEOMETRY)
    (folder / "campaign.toml").write_text(text)
    return read_measurement(read_campaign(folder / "campaign.toml"), "A")


def test_roving_accelerometers(tmp_path):
    run(tmp_path, 1, [1, -2], [45], coherence=0.9)
    run(tmp_path, 2, [3, 4], [45], coherence=0.8)
    measurement = measure(tmp_path)
    frf = measurement.frf
    assert frf.value.shape == (4, 1, 40)
    np.testing.assert_array_equal(frf.output.node, [1, 2, 3, 4])
    np.testing.assert_array_equal(frf.output.direction[:, 2], [1, -1, 1, 1])
    np.testing.assert_array_equal(frf.run, [0, 0, 1, 1])
    np.testing.assert_allclose(frf.coherence[:, 0, 0], [0.9, 0.9, 0.8, 0.8], rtol=1e-6)
    np.testing.assert_allclose(frf.value[1, 0], -value(2, 45), rtol=1e-6)
    assert measurement.notes == ()


def test_roving_hammer_is_given_by_reciprocity_and_is_one_run(tmp_path):
    for n in (1, 2, 3):
        run(tmp_path, n, [-2], [n])
    measurement = measure(tmp_path)
    frf = measurement.frf
    np.testing.assert_array_equal(frf.output.node, [1, 2, 3])
    np.testing.assert_array_equal(frf.input.direction, [[0, 0, -1]])
    np.testing.assert_array_equal(frf.run, [0, 0, 0])
    np.testing.assert_allclose(frf.value[2, 0], -value(3, 2), rtol=1e-6)
    one_run, turned = measurement.notes
    assert "3 files are one run" in one_run
    assert "by reciprocity" in turned


def test_runs_that_are_stated_stay_though_the_hammer_roves(tmp_path):
    for n in (1, 2, 3):
        run(tmp_path, n, [-2], [n])
    runs = "".join(f'[[configuration.run]]\nfiles = "run{n}.uff"\n' for n in (1, 2, 3))
    measurement = measure(tmp_path, HEAD.replace('files = ["run*.uff"]\n', runs))
    np.testing.assert_array_equal(measurement.frf.run, [0, 1, 2])


def test_forces_one_after_the_other_at_many_sensors_are_no_roving_hammer(tmp_path):
    run(tmp_path, 1, [1, 2, 3], [1])
    run(tmp_path, 2, [1, 2, 3], [2])
    assert measure(tmp_path).notes == ()


def test_the_last_of_duplicates_is_used(tmp_path):
    run(tmp_path, 1, [1, 2], [45])
    run(tmp_path, 2, [2, 3], [45], scale=2)
    measurement = measure(tmp_path)
    np.testing.assert_allclose(measurement.frf.value[1, 0], 2 * value(2, 45), rtol=1e-6)
    assert measurement.frf.run.tolist() == [0, 1, 1]
    (note,) = measurement.notes
    assert "2+z over 45+z is measured twice" in note
    assert "differs by 50 %" in note


def test_a_gap_leaves_out_the_least(tmp_path):
    run(tmp_path, 1, [1, 2, 3, 4], [1])
    run(tmp_path, 2, [1, 2, 3], [2])
    measurement = measure(tmp_path)
    assert measurement.frf.value.shape == (3, 2, 40)
    assert measurement.notes == ("response 4+z is left out: not measured with all of the others",)


def test_axes(tmp_path):
    run(tmp_path, 1, [1, 2], [45])
    run(tmp_path, 2, [3], [45], frequency=FREQUENCY[5:35])
    run(tmp_path, 3, [4], [45], frequency=FREQUENCY + 0.5)
    measurement = measure(tmp_path)
    np.testing.assert_allclose(measurement.frf.frequency, FREQUENCY[5:35])
    np.testing.assert_array_equal(measurement.frf.output.node, [1, 2, 3])
    np.testing.assert_allclose(measurement.frf.value[2, 0], value(3, 45)[5:35], rtol=1e-6)
    np.testing.assert_allclose(measurement.frf.value[0, 0], value(1, 45)[5:35], rtol=1e-6)
    assert any("run3.uff: data set 4 (58b): left out" in note for note in measurement.notes)
    assert any("cropped to their common lines, 6 to 35 Hz" in note for note in measurement.notes)


def test_quantities(tmp_path):
    run(tmp_path, 1, [1], [45])
    run(tmp_path, 2, [2], [45], quantity="receptance")
    measurement = measure(tmp_path)
    assert measurement.frf.quantity == "accelerance"
    expected = -((2 * np.pi * FREQUENCY) ** 2) * value(2, 45)
    np.testing.assert_allclose(measurement.frf.value[1, 0], expected, rtol=1e-6)
    assert "receptance are differentiated to accelerance" in measurement.notes[0]


def test_corrections(tmp_path):
    run(tmp_path, 1, [1, 2], [45])
    run(tmp_path, 2, [3, 4], [45])
    text = HEAD + (
        '[[correction]]\nfiles = "run1.uff"\nfunction = 2\nscale = -2\nconjugate = true\n'
        'new_input = "45-z"\nreason = "cable"\n'
        '[[correction]]\noutput = "3+z"\nexclude = true\nreason = "loose"\n'
        '[[correction]]\nfiles = "run1.uff"\nfunction = 1\nnew_input = "45-z"\nreason = "cable"\n'
        '[[correction]]\nfiles = "run2.uff"\nnew_input = "45-z"\nreason = "cable"\n'
    )
    measurement = measure(tmp_path, text)
    np.testing.assert_array_equal(measurement.frf.output.node, [1, 2, 4])
    np.testing.assert_allclose(measurement.frf.value[1, 0], -2 * value(2, 45).conj(), rtol=1e-6)
    np.testing.assert_array_equal(measurement.frf.input.direction, [[0, 0, -1]])
    assert any("corrected as the campaign file says: loose" in note for note in measurement.notes)


def test_a_correction_of_several_files_lists_them_as_a_configuration_does(tmp_path):
    for k in (1, 2, 3):
        run(tmp_path, k, [k], [45])
    correction = '[[correction]]\nfiles = ["run1.uff", "run3.uff"]\nscale = -2\nreason = "amplifier"\n'
    measurement = measure(tmp_path, HEAD + correction)
    expected = [factor * value(k, 45) for k, factor in ((1, -2), (2, 1), (3, -2))]
    np.testing.assert_allclose(measurement.frf.value[:, 0], expected, rtol=1e-6)


def test_dofs_from_the_campaign_file(tmp_path):
    run(tmp_path, 1, [1, 2], [45])
    run(tmp_path, 2, [3], [45])
    listed = 'output = ["11+x", "12-y", "13+z"]\ninput = ["9+z"]\n'
    measurement = measure(tmp_path, HEAD + listed)
    np.testing.assert_array_equal(measurement.frf.output.node, [11, 12, 13])
    np.testing.assert_array_equal(measurement.frf.output.direction[1], [0, -1, 0])
    np.testing.assert_array_equal(measurement.frf.run, [0, 0, 1])
    with pytest.raises(CampaignError, match=r"output: 2 DOFs are listed for 3 FRFs in run1\.uff, run2\.uff"):
        measure(tmp_path, HEAD + 'output = ["11+x", "12-y"]\n')


@pytest.mark.parametrize(
    ("outputs", "inputs", "role"),
    [([1, 7], [45], r"5 \(58b\): point 7 of the response"), ([1], [54], r"4 \(58b\): point 54 of the force")],
)
def test_a_point_that_is_not_listed_is_refused(tmp_path, outputs, inputs, role):
    run(tmp_path, 1, outputs, inputs)
    with pytest.raises(MeasurementError, match=rf"run1\.uff: data set .*{role} is not in .*points\.uff"):
        measure(tmp_path)


def test_a_point_may_be_said_to_have_no_coordinates(tmp_path):
    run(tmp_path, 1, [1, 7], [54])
    text = HEAD.replace('"points.uff"', '"points.uff"\nwithout_coordinates = [7, 54]')
    measurement = measure(tmp_path, text)
    np.testing.assert_array_equal(measurement.frf.output.node, [1, 7])
    assert "points without coordinates, measured but not drawn: [7]" in measurement.notes


def test_a_correction_may_put_a_function_to_a_point_that_is_listed(tmp_path):
    run(tmp_path, 1, [1, 7], [45])
    text = '[[correction]]\noutput = "7+z"\nnew_output = "2+z"\nreason = "mistyped"\n'
    np.testing.assert_array_equal(measure(tmp_path, HEAD + text).frf.output.node, [1, 2])


def test_what_the_file_does_not_say_is_asked_for(tmp_path):
    run(tmp_path, 1, [1], [45])
    file = tmp_path / "run1.uff"
    data = file.read_bytes()
    assert data.count(b"         1   3") == 1
    file.write_bytes(data.replace(b"         1   3", b"         0   0"))
    with pytest.raises(MeasurementError, match=r"does not state the output DOF .*such as output = \['12\+z'\]"):
        measure(tmp_path)
    file.write_bytes(
        data.replace(b"        12    0    0    0", b"         0    0    0    0").replace(b"m/s^2", b"V    ")
    )
    with pytest.raises(MeasurementError, match=r"does not state which quantity .*say \[measurement\] unit"):
        measure(tmp_path)
