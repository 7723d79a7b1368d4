"""Time histories in arrays of MATLAB, HDF5, NumPy and TDMS files, and in files side by side: as those of text files.

Sound files: rate, calibration, and what is wrong with them.
"""

import datetime

import h5py
import numpy as np
import pytest
from nptdms import ChannelObject, TdmsWriter
from scipy.io import savemat, wavfile

import ema
from ema.campaign.campaign import read_campaign
from ema.campaign.measurement import read_measurement
from ema.io.array_histories import guess_histories, pulse_share, read_histories, read_wav
from ema.io.measured_function import is_uneven, rate_of_rounded
from ema.io.table import TableLayout, read_table
from ema.io.variables import VariableLayout
from ema.types.errors import CampaignError, MeasurementError

RATE, N, HITS, CHANNELS = 2560.0, 600, 3, 3
TIME = np.arange(N) / RATE
BASE = """
[campaign]
name = "histories"
[points]
file = "points.csv"
unit = "mm"
{measurement}
[measurement.time]
window = "boxcar"
force_unit = "N"
response_unit = "g"
[[configuration]]
name = "M1"
{files}
"""


def blows(seed=0):
    """A force and two responses that ring, (hit, channel, time)."""
    rng = np.random.default_rng(seed)
    value = np.zeros((HITS, CHANNELS, N))
    for hit in value:
        hit[0, 20:23] = rng.uniform(20, 60) * np.array([0.4, 1.0, 0.5])
        for k, f in enumerate((150.0, 340.0), start=1):
            ring = np.exp(-40 * TIME) * np.sin(2 * np.pi * f * TIME)
            hit[k] = np.convolve(hit[0], ring)[:N] + 1e-3 * rng.normal(size=N)
    return value


def frf(folder, measurement, files):
    return measured(folder, measurement, files).frf


def measured(folder, measurement, files):
    (folder / "points.csv").write_text("node,x,y,z\n1,0,0,0\n2,100,0,0\n")
    (folder / "c.toml").write_text(BASE.format(measurement=measurement, files=files))
    return read_measurement(read_campaign(folder / "c.toml"), "M1")


RUN = '[[configuration.run]]\nfiles = {}\noutput = ["1+z", "2+z"]\ninput = "1+z"'


@pytest.fixture
def of_text(tmp_path):
    """The functions of three blows in text files."""
    folder = tmp_path / "text"
    folder.mkdir()
    for k, hit in enumerate(blows()):
        np.savetxt(folder / f"hit{k}.csv", np.column_stack([TIME, *hit]), delimiter=",")
    return frf(folder, '[measurement.table]\nlayout = "time"', RUN.format('"hit*.csv"'))


def variables(text):
    return f"[measurement.variables]\n{text}"


@pytest.mark.parametrize(
    ("keys", "content"),
    [
        ('history = "y"\naxes = ["hit", "channel", "time"]\nsampling_Hz = 2560', lambda v: {"y": v}),
        ('history = "y"\naxes = ["time", "channel", "hit"]\nsampling_Hz = "fs"', lambda v: {"y": v.T, "fs": RATE}),
        ('history = "y"\naxes = ["hit", "time", "channel"]\ntime = "t"',
         lambda v: {"y": v.transpose(0, 2, 1), "t": TIME}),
        ('history = ["F", "A"]\naxes = ["hit", "channel", "time"]\ntime = "t"',
         lambda v: {"F": v[:, 0], "A": v[:, 1:], "t": TIME}),
        ('history = ["F", "A", "B"]\naxes = ["time", "hit"]\ntime = "t"\nsampling_Hz = 2560',
         lambda v: {"F": v[:, 0].T, "A": v[:, 1].T, "B": v[:, 2].T, "t": np.round(TIME, 3)}),
        ('history = "y"\naxes = ["hit", "channel", "time"]\ntime = "first channel"',
         lambda v: {"y": np.concatenate([np.broadcast_to(TIME, (HITS, 1, N)), v], axis=1)}),
    ],
)  # fmt: skip
@pytest.mark.parametrize("kind", ["mat", "npz", "h5", "v7.3"])
def test_histories_of_arrays_give_the_functions_of_those_of_text(tmp_path, of_text, kind, keys, content):
    arrays = content(blows())
    if kind == "mat":
        savemat(tmp_path / "a.mat", arrays)
    elif kind == "npz":
        np.savez(tmp_path / "a.npz", **arrays)
    else:
        with h5py.File(tmp_path / ("a.h5" if kind == "h5" else "a.mat"), "w") as file:
            for name, value in arrays.items():
                file[name] = np.atleast_2d(value).T if kind == "v7.3" else value  # MATLAB turns the axes around
    found = frf(tmp_path, variables(keys), RUN.format(f'"a.{"mat" if kind == "v7.3" else kind}"'))
    np.testing.assert_allclose(found.value, of_text.value, rtol=1e-9)
    np.testing.assert_allclose(found.frequency, of_text.frequency)
    np.testing.assert_allclose(found.coherence, of_text.coherence, rtol=1e-9)
    assert found.quantity == of_text.quantity


def tdms(file, hits):
    """Write a group for each hit and a channel for each sensor, as LabVIEW does, with the step of time and the unit."""
    with TdmsWriter(file) as writer:
        writer.write_segment(
            [
                ChannelObject(f"hit {k}", name, value, {"wf_increment": 1.0 / RATE, "unit_string": unit})
                for k, hit in enumerate(hits)
                for name, unit, value in zip(("Force", "ai1", "ai2"), ("N", "g", "g"), hit, strict=True)
            ]
        )


def test_histories_of_labview_give_the_functions_of_those_of_text(tmp_path, of_text):
    tdms(tmp_path / "a.tdms", blows())
    keys = 'history = ["hit */Force", "hit */ai1", "hit */ai2"]\naxes = ["hit", "time"]\nsampling_Hz = 2560'
    found = frf(tmp_path, variables(keys), RUN.format('"a.tdms"'))
    np.testing.assert_allclose(found.value, of_text.value, rtol=1e-9)
    np.testing.assert_allclose(found.coherence, of_text.coherence, rtol=1e-9)


@pytest.mark.parametrize(("late", "fits"), [(0.0, True), (0.3 / RATE, True), (0.5, False)])
def test_channels_of_labview_that_begin_at_other_times_are_no_record(tmp_path, late, fits):
    begin = datetime.datetime(2015, 11, 20, 20, 13, 43)
    with TdmsWriter(tmp_path / "a.tdms") as writer:
        for k, hit in enumerate(blows()):
            start = begin + datetime.timedelta(minutes=k)
            writer.write_segment(
                [
                    ChannelObject(f"hit {k}", name, value, {
                        "wf_increment": 1.0 / RATE, "wf_start_offset": 0.0,
                        "wf_start_time": start + datetime.timedelta(seconds=late if name != "Force" else 0.0)})
                    for name, value in zip(("Force", "ai1", "ai2"), hit, strict=True)
                ]
            )  # fmt: skip
    names = ("hit */Force", "hit */ai1", "hit */ai2")
    layout = VariableLayout(history=names, axes=("hit", "time"), sampling_Hz=RATE)
    if fits:
        assert len(read_histories(tmp_path / "a.tdms", layout, matlab=False)[0]) == len(blows())
        return
    with pytest.raises(MeasurementError, match=r"channel 'hit 0/ai2' begins 0\.5 s after 'hit 0/Force'"):
        read_histories(tmp_path / "a.tdms", layout, matlab=False)


def test_a_channel_of_labview_that_is_not_there_is_named_among_those_that_are(tmp_path):
    tdms(tmp_path / "a.tdms", blows()[:1])
    layout = VariableLayout(history=("hit 0/Farce",), axes=("time",), sampling_Hz=RATE)
    with pytest.raises(MeasurementError, match=r"'hit 0/Farce' \(history\): no numbers .* hit 0/Force \(600\)"):
        read_histories(tmp_path / "a.tdms", layout, matlab=False)


def test_a_file_of_labview_that_is_cut_off_gives_the_hits_that_are_whole(tmp_path, capfd):
    """The library reads what is there and prints the rest to the terminal; half a hit is none."""
    tdms(tmp_path / "a.tdms", blows())
    whole = (tmp_path / "a.tdms").read_bytes()
    layout = VariableLayout(history=("hit */Force", "hit */ai1"), axes=("hit", "time"), sampling_Hz=RATE)
    (every,) = read_histories(tmp_path / "a.tdms", layout, matlab=False)
    (tmp_path / "a.tdms").write_bytes(whole[:-3000])
    (left,) = read_histories(tmp_path / "a.tdms", layout, matlab=False)
    assert len(left) == len(every) - 1
    for one, there in zip(left, every, strict=False):
        for a, b in zip(one, there, strict=True):
            np.testing.assert_array_equal(a.value, b.value)
    keys = 'history = ["hit */Force", "hit */ai1", "hit */ai2"]\naxes = ["hit", "time"]\nsampling_Hz = 2560'
    notes = measured(tmp_path, variables(keys), RUN.format('"a.tdms"')).notes
    assert any("a.tdms: is cut off" in note and "whole" in note for note in notes)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("segments", [1, 4])
def test_one_record_that_is_cut_off_goes_as_far_as_its_shortest_channel(tmp_path, segments):
    with TdmsWriter(tmp_path / "a.tdms") as writer:
        for k in range(segments):
            block = np.arange(500.0) + 500.0 * k
            writer.write_segment([ChannelObject("g", name, block) for name in ("force", "acc")])
    whole = (tmp_path / "a.tdms").read_bytes()
    (tmp_path / "a.tdms").write_bytes(whole[:-2000])
    layout = VariableLayout(history=("g/force", "g/acc"), axes=("time",), sampling_Hz=RATE)
    ((force, acc),) = read_histories(tmp_path / "a.tdms", layout, matlab=False)[0]
    n = 500 * segments - 250
    assert n - 2 <= force.value.size == acc.value.size <= n
    np.testing.assert_array_equal(force.value, np.arange(float(force.value.size)))
    (tmp_path / "a.tdms").write_bytes(whole[: len(whole) // (3 * segments)])
    with pytest.raises(MeasurementError, match=r"a\.tdms: is cut off: it holds fewer numbers"):
        read_histories(tmp_path / "a.tdms", layout, matlab=False)


def structures(file, hits):
    """Write a list of structures, and cells, as MATLAB 7.3 does: references to what lies apart."""
    with h5py.File(file, "w") as written:
        parts = {"force": [h[:1] for h in hits], "acc": [h[1:] for h in hits]}
        apart = {
            field: [written.create_dataset(f"#refs#/{field}{k}", data=v.T).ref for k, v in enumerate(one)]
            for field, one in parts.items()
        }
        for field, one in apart.items():
            written.create_dataset(f"data/{field}", data=np.array(one, dtype=h5py.ref_dtype)[:, None])
        cell = written.create_dataset("acc", data=np.array(apart["acc"], dtype=h5py.ref_dtype)[:, None])
        cell.attrs["MATLAB_class"] = np.bytes_("cell")
        written["fs"] = np.array([[RATE]])


@pytest.mark.parametrize("kind", ["mat", "v7.3", "h5"])
@pytest.mark.parametrize("second", ["data(*).acc", "acc{*}"])
def test_each_structure_or_cell_is_a_hit_as_long_as_the_shortest(tmp_path, of_text, kind, second):
    hits = [np.pad(hit, ((0, 0), (0, 7 * k))) for k, hit in enumerate(blows())]
    first, sampling = "data(*).force", "fs"
    if kind == "mat":
        rows = np.empty(HITS, dtype=[("force", object), ("acc", object)])
        cell = np.empty(HITS, dtype=object)
        for k, hit in enumerate(hits):
            rows[k], cell[k] = (hit[:1], hit[1:]), hit[1:]
        savemat(tmp_path / "a.mat", {"data": rows, "acc": cell, "fs": RATE})
    elif kind == "v7.3":
        structures(tmp_path / "a.mat", hits)
    else:
        first, second, sampling = "hit_*/force", "hit_*/acc", "hit_*/fs"
        with h5py.File(tmp_path / "a.h5", "w") as file:
            for k, hit in enumerate(hits):
                file[f"hit_{k + 9}/force"], file[f"hit_{k + 9}/acc"], file[f"hit_{k + 9}/fs"] = (hit[0], hit[1:], RATE)
    axes = '["hit", "channel", "time"]'
    keys = f'history = ["{first}", "{second}"]\naxes = {axes}\nsampling_Hz = "{sampling}"'
    found = frf(tmp_path, variables(keys), RUN.format('"a.*"'))
    np.testing.assert_allclose(found.value, of_text.value, rtol=1e-9)
    np.testing.assert_allclose(found.coherence, of_text.coherence, rtol=1e-9)


def test_two_stars_are_points_and_blows(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        for point in (2, 10):
            for k, hit in enumerate(blows(point)):
                file[f"point_{point}/hit_{k}/force"], file[f"point_{point}/hit_{k}/acc"] = (
                    hit[0],
                    hit[1 if point == 2 else 2],
                )
    keys = 'history = ["point_*/hit_*/force", "point_*/hit_*/acc"]\naxes = ["run", "hit", "time"]\nsampling_Hz = 2560'
    found = frf(tmp_path, variables(keys), 'files = "a.h5"\noutput = ["1+z", "2+z"]\ninput = "1+z"')
    assert found.run.tolist() == [0, 1]
    peaks = found.frequency[np.abs(found.value[:, 0]).argmax(axis=1)]
    np.testing.assert_allclose(peaks, [150.0, 340.0], atol=5.0)
    with h5py.File(tmp_path / "a.h5", "a") as file:
        del file["point_10/hit_0"]
    with pytest.raises(
        MeasurementError, match=r"'point_10/hit_1/force' .*: 1 runs, 2 hits.* do not fit the 1 runs, 3 hits"
    ):
        frf(tmp_path, variables(keys), 'files = "a.h5"\noutput = ["1+z", "2+z"]\ninput = "1+z"')


def test_names_with_a_star_that_do_not_fit_are_named(tmp_path):
    np.savez(tmp_path / "a.npz", a1=np.ones((N, 2)), a2=np.ones((N, 3)), b1=np.ones((N, 2)))
    hits = FORM | {"axes": ("hit", "time", "channel")}
    layout = VariableLayout.model_validate(hits | {"history": ("a*",)})
    with pytest.raises(MeasurementError, match=r"'a2' .*3 channels .* do not fit the .*2 channels .* of 'a1'"):
        read_histories(tmp_path / "a.npz", layout, matlab=False)
    layout = VariableLayout.model_validate(hits | {"history": ("c*",)})
    with pytest.raises(MeasurementError, match=r"'c\*' \(history\): no numbers of that name"):
        read_histories(tmp_path / "a.npz", layout, matlab=False)
    with pytest.raises(ValueError, match=r"'a\*': each \* stands for one of the first axes"):
        VariableLayout.model_validate(FORM | {"history": ("a*",)})


def test_runs_of_an_array_are_runs_of_their_own(tmp_path):
    """A roving accelerometer: for each of two points three blows."""
    np.save(tmp_path / "a.npy", np.stack([blows()[:, [0, 1]], blows(1)[:, [0, 2]]]))
    keys = 'history = "array"\naxes = ["run", "hit", "channel", "time"]\nsampling_Hz = 2560'
    found = frf(tmp_path, variables(keys), 'files = "a.npy"\noutput = ["1+z", "2+z"]\ninput = "1+z"')
    assert found.run.tolist() == [0, 1]
    assert "run 2, hit 1, channel 2" in found.source[1]
    peaks = found.frequency[np.abs(found.value[:, 0]).argmax(axis=1)]
    np.testing.assert_allclose(peaks, [150.0, 340.0], atol=5.0)


@pytest.mark.parametrize("kind", ["csv", "npy"])
def test_files_side_by_side_are_channels_of_one_record(tmp_path, of_text, kind):
    for k, hit in enumerate(blows()):
        for name, value in (("force", hit[:1]), ("acc", hit[1:])):
            if kind == "csv":
                np.savetxt(tmp_path / f"hit{k}_{name}.csv", np.column_stack([TIME, *value]), delimiter=",")
            else:
                np.save(tmp_path / f"hit{k}_{name}.npy", value)
    measurement = '[measurement.table]\nlayout = "time"'
    if kind == "npy":
        measurement = variables('history = "array"\naxes = ["channel", "time"]\nsampling_Hz = 2560')
    found = frf(tmp_path, measurement, RUN.format(f'[["hit*_force.{kind}", "hit*_acc.{kind}"]]'))
    np.testing.assert_allclose(found.value, of_text.value, rtol=1e-9)


@pytest.mark.parametrize(
    ("names", "said"),
    [
        ('[["hit*_force.csv", "hit1_acc.csv"]]', r"'hit\*_force\.csv' is hit0_force\.csv, hit1.*\(3 files\); 'hit1"),
        ('[["hit0_force.csv", "hit0_force.csv"]]', "none twice"),
        ('["hit0_acc.csv", ["hit0_force.csv"]]', "either all text, or all lists"),
        ('[["hit0_force.csv", "hit0_acc.csv"], ["hit1_force.csv"]]', "each of as many"),
        ('[["hit0_force.csv", "late.csv"]]', r"late\.csv: its times begin at 0\.5 s, those of .*hit0_force\.csv"),
    ],
)  # fmt: skip
def test_files_that_do_not_fit_side_by_side_are_named(tmp_path, names, said):
    for k, hit in enumerate(blows()):
        for name, value in (("force", hit[0]), ("acc", hit[1])):
            np.savetxt(tmp_path / f"hit{k}_{name}.csv", np.column_stack([TIME, value]), delimiter=",")
    np.savetxt(tmp_path / "late.csv", np.column_stack([TIME + 0.5, blows()[0, 1]]), delimiter=",")
    with pytest.raises((CampaignError, MeasurementError), match=said):
        frf(tmp_path, '[measurement.table]\nlayout = "time"', RUN.format(names))


def test_files_side_by_side_are_of_histories(tmp_path):
    text = BASE.format(measurement='[measurement.table]\nlayout = "complex"', files='files = [["a.csv", "b.csv"]]')
    begin, _, rest = text.partition("[measurement.time]")
    unit = '[measurement]\nunit = "g/N"\n[measurement.table]'
    begin = begin.replace("[measurement.table]", unit)
    (tmp_path / "c.toml").write_text(begin + rest[rest.index("[[conf") :])
    for name, content in (("points", "node,x,y,z\n1,0,0,0\n"), ("a", "1,1\n"), ("b", "1,1\n")):
        (tmp_path / f"{name}.csv").write_text(content)
    with pytest.raises(CampaignError, match=r"inner brackets.*need \[measurement\.time\]"):
        read_campaign(tmp_path / "c.toml")


def test_histories_say_how_they_are_averaged(tmp_path):
    text = BASE.format(
        measurement=variables('history = "y"\naxes = ["time"]\nsampling_Hz = 1'), files='files = "a.mat"'
    )
    begin, _, rest = text.partition("[measurement.time]")
    (tmp_path / "c.toml").write_text(begin + rest[rest.index("[[conf") :])
    with pytest.raises(CampaignError, match=r"'history' .* needs \[measurement\.time\]"):
        read_campaign(tmp_path / "c.toml")


FORM = {"history": ("y",), "axes": ("time", "channel"), "sampling_Hz": RATE}


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"axes": ("frequency", "output")}, "axes of time histories"),
        ({"sampling_Hz": None}, "need 'time'"),
        ({"coherence": ("c",), "output_point": 1}, "'coherence', 'output_point': of FRFs"),
        ({"history": None, "frf": ("H",), "axes": ("frequency",), "frequency": "f"}, "belong to 'history'"),
        ({"axes": ("time", "time")}, "each once"),
    ],
)
def test_impossible_descriptions_are_refused(changes, said):
    with pytest.raises(ValueError, match=said):
        VariableLayout.model_validate({k: v for k, v in (FORM | changes).items() if v is not None})


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"history": ("z",)}, r"variable 'z' \(history\): no numbers of that name"),
        ({"history": ("c",)}, "its numbers are complex"),
        ({"history": ("cube",)}, r"5 x 4 x 3 have 3 axes, axes = \['time', 'channel'\]"),
        ({"history": ("y", "few")}, r"'few' \(history\): .* and 5 samples do not fit the .* 600 samples of 'y'"),
        ({"sampling_Hz": None, "time": "few"}, "expected 600 real numbers"),
        ({"sampling_Hz": None, "time": "rounded"},
         r"value 2: the time does not ascend; .* 600 samples in 0\.234 s are 2560 Hz"
         r".*sampling_Hz = 2560, under \[measurement\.variables\]"),
        ({"sampling_Hz": None, "time": "first channel", "history": ("one",)}, "the times in its first channel"),
        ({"sampling_Hz": "y"}, "expected one positive number, found 1800"),
        ({"sampling_Hz": "zero"}, r"expected a positive number, found 0\.0"),
    ],
)  # fmt: skip
def test_faults_are_named(tmp_path, changes, said):
    content = {
        "y": np.ones((N, 3)), "c": np.ones((N, 2)) * 1j, "cube": np.ones((5, 4, 3)), "few": np.ones((5, 2)),
        "rounded": np.round(TIME, 3), "one": np.ones(N), "zero": 0.0,
    }  # fmt: skip
    np.savez(tmp_path / "a.npz", **content)
    layout = VariableLayout.model_validate({k: v for k, v in (FORM | changes).items() if v is not None})
    with pytest.raises(MeasurementError, match=said):
        read_histories(tmp_path / "a.npz", layout, matlab=False)


@pytest.mark.parametrize("rate", [1000.0, 2048.0, 2560.0, 1651.6, 44100.0])
@pytest.mark.parametrize(
    "form",
    [
        lambda t: np.round(t, 3),
        lambda t: np.floor(t * 1e4) / 1e4,
        lambda t: np.round(t, 4) - 0.05,
        lambda t: np.array([float(f"{x:.2e}") for x in t]),
    ],
)
def test_the_rate_of_rounded_times(rate, form):
    assert rate_of_rounded(form(np.arange(4000) / rate)) == pytest.approx(rate, rel=1e-9)


def test_times_of_no_rate_have_none():
    steps = np.random.default_rng(0).integers(0, 3, 1000)
    assert rate_of_rounded(np.cumsum(steps) * 1e-3) is None
    assert rate_of_rounded(np.zeros(100)) is None


def test_a_table_of_rounded_times(tmp_path):
    rows = "".join(f"{t:.3f},{np.sin(k):.4f},{np.cos(k):.4f}\n" for k, t in enumerate(TIME))
    (tmp_path / "a.csv").write_text(rows)
    with pytest.raises(MeasurementError, match=r"row 2: the time does not ascend; .*sampling_Hz = 2560"):
        read_table(tmp_path / "a.csv", TableLayout(layout="time"), None)
    channels = read_table(tmp_path / "a.csv", TableLayout(layout="time", sampling_Hz=2560), None)
    assert len(channels) == 2
    np.testing.assert_allclose(channels[0].abscissa, TIME)
    with pytest.raises(ValueError, match="sampling_Hz is of time histories"):
        TableLayout(layout="complex", sampling_Hz=2560)


@pytest.mark.parametrize("time", [[0.0, np.inf, np.inf], [-1.7e308, 1.7e308, 1.75e308], [0.0]])
def test_times_that_are_none_are_uneven(time):
    assert is_uneven(np.array(time))
    assert not is_uneven(np.arange(3.0))


def test_a_record_that_is_not_finite_has_no_pulse():
    assert pulse_share(np.array([[0.0, np.inf, 0.0], [-np.inf, np.inf, 0.0]])).tolist() == [1.0, 1.0]


SOUND_RATE = 2560


@pytest.mark.parametrize(
    ("kind", "full", "middle"), [("int16", 2**15, 0), ("int32", 2**31, 0), ("uint8", 2**7, 2**7), ("float32", 1.0, 0)]
)
def test_samples_come_in_the_stated_unit_at_the_rate_of_the_header(tmp_path, kind, full, middle):
    share = np.column_stack([0.5 * np.sin(np.arange(400.0)), np.full(400, -0.25)])
    wavfile.write(tmp_path / "a.wav", SOUND_RATE, (share * full + middle).astype(kind))
    force, response = read_wav(tmp_path / "a.wav", (500.0, 100.0))
    assert force.abscissa[1] == 1.0 / SOUND_RATE
    np.testing.assert_allclose(force.value, 500.0 * share[:, 0], atol=500.0 / 127)
    np.testing.assert_allclose(response.value, -25.0, atol=100.0 / 127)
    both = read_wav(tmp_path / "a.wav", (2.0,))
    np.testing.assert_allclose(both[1].value, -0.5, atol=2.0 / 127)


def test_wrong_sound_files_say_what_and_where(tmp_path):
    path = tmp_path / "a.wav"
    wavfile.write(path, SOUND_RATE, np.zeros((400, 2), np.int16))
    with pytest.raises(ema.MeasurementError, match=r"a.wav: has 2 channels, and 'full_scale' .* 3 numbers"):
        read_wav(path, (1.0, 2.0, 3.0))
    path.write_bytes(path.read_bytes()[:700])
    with pytest.raises(ema.MeasurementError, match="cannot be read as a WAV file"):
        read_wav(path, (1.0,))
    path.write_text("no sound")
    with pytest.raises(ema.MeasurementError, match="cannot be read as a WAV file"):
        read_wav(path, (1.0,))


@pytest.mark.parametrize("keys", ["", "full_scale = 5\n", '[measurement.time]\nwindow = "boxcar"\n'])
def test_a_campaign_of_sound_files_asks_for_its_calibration(tmp_path, keys):
    (tmp_path / "points.csv").write_text("node,x,y,z\n1,0,0,0\n")
    wavfile.write(tmp_path / "a.wav", SOUND_RATE, np.zeros((400, 2), np.int16))
    (tmp_path / "campaign.toml").write_text(
        f"""
[campaign]
name = "sound"
[points]
file = "points.csv"
unit = "mm"
[measurement]
{keys}
[[configuration]]
name = "M1"
files = ["a.wav"]
"""
    )
    with pytest.raises(ema.CampaignError, match=r"sound files \(.wav\) .* need 'full_scale'"):
        ema.read_campaign(tmp_path / "campaign.toml")


@pytest.mark.parametrize("channel_last", [True, False])
def test_as_many_blows_as_channels_are_told_apart_by_the_force(channel_last):
    """Where lengths do not tell, one order of the axes explains the responses, and the other does not."""
    rng = np.random.default_rng(0)
    force = np.zeros((600, 4))
    force[[40, 43, 47, 52], range(4)] = 1.0, 2.0, 0.5, 3.0
    ringing = np.exp(-np.arange(600) / 60.0) * rng.standard_normal((4, 600))
    response = np.array([[np.convolve(f, h)[:600] for h in ringing] for f in force.T])  # (hit, channel, sample)
    response = response.transpose(2, 0, 1) if channel_last else response.transpose(2, 1, 0)
    found = guess_histories({"Xhammer": force, "Y": response, "fs": np.array(1000.0)}, {})
    assert found.keys["axes"] == (["time", "hit", "channel"] if channel_last else ["time", "channel", "hit"])
