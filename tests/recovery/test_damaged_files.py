"""Damaged files are read or refused with a message; no other exception, no hang, no unbounded memory.

    pytest tests/recovery/test_damaged_files.py -m benchmark -s

reads far more of them and says how many were refused and how long the slowest took.
"""

import contextlib
import os
import re
import shutil
from functools import partial
from pathlib import Path

import h5py
import numpy as np
import pytest
from nptdms import ChannelObject, TdmsWriter
from scipy.io import savemat

import model
from ema.campaign.campaign import read_campaign
from ema.campaign.measurement import read_measurement
from ema.identification.poles_file import read_poles, write_poles
from ema.io.array_histories import read_histories
from ema.io.guess_table import guess_table
from ema.io.guess_variables import guess_variables
from ema.io.table import TableLayout, read_points, read_table
from ema.io.uff import read_uff_functions, read_uff_geometry, write_uff
from ema.io.units import parse_unit
from ema.io.variables import VariableLayout, read_variables
from ema.quality.channels import check
from ema.types.errors import EmaError, IdentificationError
from ema.types.frf import FRF
from ema.types.geometry import Dofs, Geometry
from updating import LAMELLA_ERRORS
from updating.commands.update_file import read_update_file
from updating.errors import StoreError
from updating.fitting.modal_table import read_modal_table
from updating.published.campaign import read_published
from updating.results.store import read_document, read_frf, write_frf
from updating.virtual.vibration_test_file import read_virtual_test

DATA = Path(__file__).parents[2] / "data"
REAL = Path(__file__).parents[2].parent / "shared/realdata"
COUNTS = [10, pytest.param(600, marks=pytest.mark.benchmark)]
TWO_SENSORS = TableLayout(
    layout="real-imaginary", header_rows=1, columns=((2, 3), (5, 6)), coherence_columns=(4, 7)
)


def own_frf():
    """Small, with local axes, for a universal file of our own: units, local axes, points, lines and 58b."""
    rng = np.random.default_rng(0)
    axes = np.stack([np.eye(3), np.linalg.qr(rng.normal(size=(3, 3)))[0]])
    geometry = Geometry(node=[1, 2], coordinate=rng.normal(size=(2, 3)), line=[[1, 2]], axes=axes)
    frf = FRF(
        frequency=np.arange(20.0),
        value=rng.normal(size=(2, 1, 20)) + 0j,
        quantity="accelerance",
        output=Dofs(node=[1, 2], direction=[[0, 0, 1], axes[1, 0]]),
        input=Dofs(node=[9], direction=[[0, 0, 1]]),
        run=[0, 0],
        source=("a", "b"),
    )
    return geometry, frf


def both(*reads):
    """Read a file in several ways, each of which may refuse it."""

    def read(file):
        refused = []
        for one in reads:
            try:
                one(file)
            except EmaError as error:
                refused.append(error)
        if refused:
            raise refused[0]

    return read


def measured(file):
    """The functions of a run are merged with those of the others and checked."""
    campaign = read_campaign(file.parents[1] / "campaign.toml")
    check(read_measurement(campaign, "M1"))


def table(layout):
    return lambda file: read_table(file, layout, parse_unit("g/N"))


UNIVERSAL = both(read_uff_functions, read_uff_geometry)
# reader: the file, among those that stand beside it in its folder, and what may be raised
READERS = {
    "run of a campaign": (measured, "demo_stack/M1/run_01.uff", EmaError),
    "universal file": (UNIVERSAL, "demo_stack/M1/run_02.uff", EmaError),
    "table of real and imaginary parts": (table(TWO_SENSORS), "hidden_effect/b/M1/run_01.csv", EmaError),
    "what a table seems to hold": (guess_table, "hidden_effect/b/M1/run_01.csv", EmaError),
    "points": (lambda file: read_points(file, parse_unit("mm")), "demo_stack/points.csv", EmaError),
    "campaign": (read_campaign, "demo_stack/campaign.toml", EmaError),
    "campaign of tables": (read_campaign, "hidden_effect/b/campaign.toml", EmaError),
    "stack": (model.read_stack, "demo_stack/stack.toml", model.StackError),
    "stack with a curve and an outline": (model.read_stack, "stator/stack.toml", model.StackError),
    "compression curve": (
        lambda file: model.read_stack(file.parents[1] / "stator/stack.toml"),
        "contact/compression_standin.csv",
        model.StackError,
    ),
    "update file": (read_update_file, "demo_stack/update.toml", LAMELLA_ERRORS),
    "virtual test": (read_virtual_test, "demo_stack/virtual_test.toml", LAMELLA_ERRORS),
    "modal table's campaign": (read_modal_table, "pirnat2013/table7.toml", LAMELLA_ERRORS),
    "modal table": (
        lambda file: read_modal_table(file.with_name("campaign.toml")),
        "pirnat2013/table7_frequencies_320kPa.csv",
        LAMELLA_ERRORS,
    ),
    "published table": (
        lambda file: read_published(file.parent),
        "pirnat2013/table6_contact_parameters.csv",
        LAMELLA_ERRORS,
    ),
    "result": (read_document, "demo_stack/truth.json", StoreError),
}


@pytest.fixture
def data(tmp_path):
    """The shipped data by links; of the demo stack few runs, to be quick."""
    most = shutil.ignore_patterns("run_[12]*", "run_0[4-9]*")
    for name in ("demo_stack", "hidden_effect/b", "pirnat2013", "stator", "contact"):
        ignore = most if name == "demo_stack" else None
        shutil.copytree(DATA / name, tmp_path / name, ignore=ignore, copy_function=os.symlink)
    return tmp_path


@pytest.mark.parametrize("count", COUNTS)
@pytest.mark.parametrize("reader", list(READERS))
def test_shipped_files(data, survives, damage, reader, count, own):
    read, name, errors = READERS[reader]
    file = own(data / name)
    survives(read, file, errors, damage(file, count // 5 if reader == "run of a campaign" else count))


EXTREMES = [b"0", b"-1", b"1000000", b"2147483648", b"1e300", b"1e-300", b"nan", b"inf", b"9" * 25]


@pytest.mark.parametrize(
    "reader",
    [
        "campaign",
        "stack",
        "stack with a curve and an outline",
        "update file",
        "virtual test",
        "modal table's campaign",
    ],
)
def test_every_number_of_a_file(data, survives, reader, own):
    """Each in turn is made as small, large or odd as it can be."""
    read, name, errors = READERS[reader]
    file = own(data / name)
    content = file.read_bytes()
    if reader == "campaign":  # point numbers of trace lines: too many of one kind
        content = re.sub(rb"lines = .*", b"lines = [[1, 5]]", content)
    numbers = [m.span() for m in re.finditer(rb"(?<![\w\".])[-+]?\d[\d.eE+-]*", content)]
    inputs = [content[:start] + odd + content[stop:] for start, stop in numbers for odd in EXTREMES]
    survives(read, file, errors, inputs)


@pytest.mark.parametrize("count", COUNTS)
def test_universal_files_of_our_own(tmp_path, survives, damage, count):
    write_uff(tmp_path / "own.uff", *own_frf())
    survives(UNIVERSAL, tmp_path / "own.uff", EmaError, damage(tmp_path / "own.uff", 3 * count))


@pytest.mark.parametrize("count", COUNTS)
@pytest.mark.parametrize("file", sorted(REAL.glob("uff-oddities-pyuff/*.uff")), ids=lambda file: file.stem)
def test_universal_files_of_other_programs(tmp_path, survives, damage, file, count):
    if file.stat().st_size > 1e5:
        pytest.skip("large")
    other = Path(shutil.copy(file, tmp_path / "other.uff"))
    survives(UNIVERSAL, other, EmaError, damage(other, count))


@pytest.mark.parametrize("count", COUNTS)
@pytest.mark.parametrize("layout", ["real-imaginary", "complex"])
def test_small_tables(tmp_path, survives, damage, layout, count):
    file = tmp_path / "small.csv"
    file.write_text("\n".join(f"{f},{f / 3:.6g},{-f / 7:.4e}" for f in range(30)))
    survives(table(TableLayout(layout=layout)), file, EmaError, damage(file, 3 * count))


@pytest.mark.parametrize("count", COUNTS)
@pytest.mark.parametrize("kind", ["mat", "compressed mat", "hdf5"])
def test_files_of_arrays(tmp_path, survives, damage, kind, count):
    """Their own structure is damaged, in a file as small as it can be."""
    content = {"f": np.arange(30.0), "H": np.arange(60.0).reshape(30, 2) * (1 + 2j)}
    file = tmp_path / ("small.h5" if kind == "hdf5" else "small.mat")
    if kind == "hdf5":
        with h5py.File(file, "w") as written:
            for name, value in content.items():
                written.create_dataset(f"group/{name}", data=value, chunks=True, compression="gzip")
    else:
        savemat(file, {"group": content}, do_compression=kind == "compressed mat")
    mark = "/" if kind == "hdf5" else "."
    layout = VariableLayout(frf=f"group{mark}H", frequency=f"group{mark}f")
    read = partial(read_variables, layout=layout, unit=parse_unit("m/s2/N"), matlab=kind != "hdf5")
    survives(read, file, EmaError, damage(file, 3 * count))


@pytest.mark.parametrize("count", COUNTS)
@pytest.mark.parametrize("kind", ["mat", "hdf5", "npz"])
def test_files_of_histories(tmp_path, survives, damage, kind, count):
    """A list of structures, groups, and arrays of NumPy with a sampling rate; read, and looked into for a draft."""
    blows = np.zeros((2, 2, 600))
    blows[:, 0, 20], blows[:, 1] = 1.0, np.sin(np.arange(600))
    history, sampling = (
        ("data(*).y", "fs") if kind == "mat" else ("hit_*/y", "fs") if kind == "hdf5" else ("y", "fs")
    )
    file = tmp_path / {"mat": "a.mat", "hdf5": "a.h5", "npz": "a.npz"}[kind]
    if kind == "mat":
        rows = np.empty(2, dtype=[("y", object)])
        rows["y"] = list(blows)
        savemat(file, {"data": rows, "fs": 2560.0})
    elif kind == "hdf5":
        with h5py.File(file, "w") as written:
            written["fs"] = 2560.0
            for k, blow in enumerate(blows):
                written[f"hit_{k}/y"] = blow
    else:
        np.savez(file, y=blows, fs=2560.0)
    layout = VariableLayout(history=(history,), axes=("hit", "channel", "time"), sampling_Hz=sampling)
    matlab = kind == "mat"
    read = both(
        partial(read_histories, layout=layout, matlab=matlab), partial(guess_variables, matlab=matlab)
    )
    survives(read, file, EmaError, damage(file, 2 * count))


@pytest.mark.parametrize("count", COUNTS)
def test_files_of_labview(tmp_path, survives, damage, count):
    file = tmp_path / "a.tdms"
    step = {"wf_increment": 1.0 / 2560, "unit_string": "N"}
    with TdmsWriter(file) as writer:
        for k in range(2):  # one segment follows the other
            writer.write_segment([ChannelObject(f"hit {k}", "F", np.sin(np.arange(40.0)), step)])
    layout = VariableLayout(history=("hit */F",), axes=("hit", "time"), sampling_Hz=2560.0)
    read = both(partial(read_histories, layout=layout, matlab=False), partial(guess_variables, matlab=False))
    survives(read, file, EmaError, damage(file, 3 * count))


@pytest.mark.parametrize("count", COUNTS)
def test_tables_of_histories(tmp_path, survives, damage, count):
    file = tmp_path / "small.csv"
    file.write_text(
        "t,force [N],a\n" + "\n".join(f"{k / 2560:.3f},{k / 3:.6g},{-k / 7:.4e}" for k in range(40))
    )
    layout = TableLayout(layout="time", header_rows=1)
    survives(both(table(layout), guess_table), file, EmaError, damage(file, 3 * count))


@pytest.mark.parametrize("count", COUNTS)
def test_files_that_a_run_wrote(tmp_path, survives, damage, count):
    write_poles(tmp_path / "poles.txt", np.array([-3.0 + 500j, -10.0 + 900j]))
    survives(read_poles, tmp_path / "poles.txt", IdentificationError, damage(tmp_path / "poles.txt", count))
    write_frf(tmp_path / "measurement.npz", own_frf()[1])
    survives(read_frf, tmp_path / "measurement.npz", StoreError, damage(tmp_path / "measurement.npz", count))


def test_unit_labels():
    rng = np.random.default_rng(0)
    alphabet = list("mgNs/*()^2-1 ²µ%")
    for _ in range(3000):
        with contextlib.suppress(EmaError):
            parse_unit("".join(rng.choice(alphabet, rng.integers(0, 12))))
