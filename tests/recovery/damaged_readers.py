"""Every reader of the program, and the file that it reads: of the shipped data, or made here as small as it can be."""

import shutil
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

import h5py
import numpy as np
from nptdms import ChannelObject, TdmsWriter
from scipy.io import savemat, wavfile

import model
from ema.campaign.campaign import read_campaign
from ema.campaign.draft import draft
from ema.campaign.draft_file import draft_file
from ema.campaign.measurement import read_measurement
from ema.identification.exchange import read_poles, write_poles
from ema.io.array_histories import read_histories, read_wav
from ema.io.found_modes import read_modes_table
from ema.io.guess_table import guess_table
from ema.io.guess_variables import guess_variables
from ema.io.measured_function import parse_unit
from ema.io.modes_uff import read_modes_uff
from ema.io.sdynpy import read_data_arrays, read_modes_numpy
from ema.io.table import TableLayout, read_points, read_table
from ema.io.uff import read_uff_functions, read_uff_geometry, write_uff
from ema.io.variables import VariableLayout, read_variables
from ema.modal.read_modes import modal_model_of
from ema.quality.channels import check
from ema.types.errors import EmaError, IdentificationError
from ema.types.frf import FRF, Dofs, Geometry
from tests.studies.published.campaign import read_published
from tests.studies.published.modal_table import read_modal_table
from updating import LAMELLA_ERRORS
from updating.commands.update import read_update_file
from updating.errors import StoreError
from updating.pooled.campaign_file import read_specimens, specimens_of
from updating.pooled.specimen import classes
from updating.results.store import read_document, read_frf, write_frf
from updating.virtual.vibration_test import read_virtual_test

DATA = Path(__file__).parents[2] / "data"
TWO_SENSORS = TableLayout(layout="real-imaginary", header_rows=1, columns=((2, 3), (5, 6)), coherence_columns=(4, 7))
SHIPPED = ("demo_stack", "hidden_effect/b", "hidden_effect/pooled_a", "pirnat2013", "stator", "contact")

LABVIEW = "\n".join(
    ["LabVIEW Measurement", "Separator\tTab", "***End_of_Header***", "", "Channels\t2", "Samples\t40\t40",
     "Y_Unit_Label\tN\tg", "Delta_X\t0.001\t0.001", "***End_of_Header***", "X_Value\tforce\tacc\tComment",
     *(f"{k / 1000:.6f}\t{k % 7:.4e}\t{k % 5:.4e}" for k in range(40))]
)  # fmt: skip


def write_files(folder: Path, copy: Callable[[str, str], object] = shutil.copy2) -> None:
    """Put all files that are read into a folder: shipped ones by `copy`, of the demo stack few runs, to be quick."""
    most = shutil.ignore_patterns("run_[12]*", "run_0[4-9]*")
    for name in SHIPPED:
        ignore = most if name == "demo_stack" else None
        shutil.copytree(DATA / name, folder / name, ignore=ignore, copy_function=copy)
    made = folder / "made"
    made.mkdir()
    geometry, frf = own_frf()
    write_uff(made / "own.uff", geometry, frf)
    write_frf(made / "measurement.npz", frf)
    write_poles(made / "poles.txt", np.array([-3.0 + 500j, -10.0 + 900j]))
    rows = [f"{f},{f / 3:.6g},{-f / 7:.4e}" for f in range(30)]
    (made / "table.csv").write_text("\n".join(rows), encoding="utf-8")
    rows = [f"{k / 2560:.9f},{k / 3:.6g},{-k / 7:.4e}" for k in range(40)]
    (made / "histories.csv").write_text("\n".join(["t,force [N],a", *rows]), encoding="utf-8")
    rows = [f"{f} {f / 3:.6g} {-f / 7:.4e}" for f in range(30)]
    (made / "blanks.txt").write_text("\n".join(["# f re im", "", "#", *rows]), encoding="utf-8")
    (made / "labview.lvm").write_text(LABVIEW, encoding="utf-8")
    _write_functions(made)
    _write_histories(made)
    _write_modes(made)


def _write_modes(made: Path) -> None:
    """Write modes in the forms of other programs."""
    geometry, _ = own_frf()
    shapes = "node,x,y,z,mode_1_real,mode_1_imag,mode_2_real,mode_2_imag\n1,0,0,1,1,0.1,1,0\n2,0,0,1,-1,0,1,0.2\n"
    (made / "modes.csv").write_text("frequency_Hz,damping,shape_std\n100,0.01,0.02\n200,0.02,0.02\n")
    (made / "shapes.csv").write_text(shapes)
    found = read_modes_table((made / "modes.csv", made / "shapes.csv"))
    one = modal_model_of(found, name="M", geometry=geometry, force=None)
    write_uff(made / "modes.uff", geometry, modal_model=one)
    kind = [("frequency", "f8"), ("damping", "f8"), ("coordinate", [("node", "u8"), ("direction", "i1")], (2,)),
            ("shape_matrix", "f8", (2,)), ("modal_mass", "f8")]  # fmt: skip
    array = np.zeros(2, kind)
    array["frequency"], array["damping"], array["modal_mass"] = [100.0, 200.0], 0.01, 1.0
    array["coordinate"]["node"], array["coordinate"]["direction"] = [1, 2], 3
    array["shape_matrix"] = [[1.0, -1.0], [1.0, 1.0]]
    np.save(made / "shapes.npy", array)
    kind = [("abscissa", "f8", (20,)), ("ordinate", "c16", (20,)), ("coordinate", kind[2][1], (2,))]
    array = np.zeros(2, kind)
    array["abscissa"], array["ordinate"] = np.arange(20.0), 1 + 2j
    array["coordinate"]["node"], array["coordinate"]["direction"] = [[1, 2], [2, 2]], 3
    np.savez(made / "functions.npz", data=array, function_type=4)
    wavfile.write(made / "blow.wav", 2560, (1e4 * np.sin(np.arange(300.0))).astype(np.int16).reshape(150, 2))


def own_frf() -> tuple[Geometry, FRF]:
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


def _write_functions(made: Path) -> None:
    """Write files of arrays, whose own structure is damaged."""
    content = {"f": np.arange(30.0), "H": np.arange(60.0).reshape(30, 2) * (1 + 2j)}
    savemat(made / "plain.mat", {"group": content})
    savemat(made / "compressed.mat", {"group": content}, do_compression=True)
    with h5py.File(made / "functions.h5", "w") as written:
        for name, value in content.items():
            written.create_dataset(f"group/{name}", data=value, chunks=True, compression="gzip")


def _write_histories(made: Path) -> None:
    """Write a list of structures, groups, arrays of NumPy, and segments of LabVIEW, with a sampling rate."""
    blows = np.zeros((2, 2, 600))
    blows[:, 0, 20], blows[:, 1] = 1.0, np.sin(np.arange(600))
    rows = np.empty(2, dtype=[("y", object)])
    rows["y"] = list(blows)
    savemat(made / "blows.mat", {"data": rows, "fs": 2560.0})
    with h5py.File(made / "blows.h5", "w") as written:
        written["fs"] = 2560.0
        for k, blow in enumerate(blows):
            written[f"hit_{k}/y"] = blow
    np.savez(made / "blows.npz", y=blows, fs=2560.0)
    step = {"wf_increment": 1.0 / 2560, "unit_string": "N"}
    with TdmsWriter(made / "blows.tdms") as writer:
        for k in range(2):  # one segment follows the other
            writer.write_segment([ChannelObject(f"hit {k}", "F", np.sin(np.arange(40.0)), step)])


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


def specimens(file):
    """The modes and shapes of all specimens."""
    specimens_of(read_specimens(file.parents[1] / "campaign.toml"), lambda _: None)


def table(layout):
    return lambda file: read_table(file, layout, parse_unit("g/N"))


def functions(mark, *, matlab):
    layout = VariableLayout(frf=f"group{mark}H", frequency=f"group{mark}f")
    return partial(read_variables, layout=layout, unit=parse_unit("m/s2/N"), matlab=matlab)


def histories(name, *, axes=("hit", "channel", "time"), sampling="fs", matlab=False):
    """Read them, and look into the file for a draft."""
    layout = VariableLayout(history=(name,), axes=axes, sampling_Hz=sampling)
    return both(partial(read_histories, layout=layout, matlab=matlab), partial(guess_variables, matlab=matlab))


def drafted(file):
    """Draft the campaign file of a folder with this file alone, as `lamella new` does."""
    with tempfile.TemporaryDirectory() as folder:
        shutil.copy(file, folder)
        draft_file(draft(Path(folder)))


UNIVERSAL = both(read_uff_functions, read_uff_geometry)
# reader: how, the file, among those that stand beside it in its folder, and what may be raised
READERS = {
    "run of a campaign": (measured, "demo_stack/M1/run_01.uff", EmaError),
    "universal file": (UNIVERSAL, "demo_stack/M1/run_02.uff", EmaError),
    "universal file of our own": (UNIVERSAL, "made/own.uff", EmaError),
    "table of real and imaginary parts": (table(TWO_SENSORS), "hidden_effect/b/M1/run_01.csv", EmaError),
    "what a table seems to hold": (guess_table, "hidden_effect/b/M1/run_01.csv", EmaError),
    "small table": (table(TableLayout(layout="real-imaginary")), "made/table.csv", EmaError),
    "table of complex numbers": (table(TableLayout(layout="complex")), "made/table.csv", EmaError),
    "table of histories": (
        both(table(TableLayout(layout="time", header_rows=1)), guess_table),
        "made/histories.csv",
        EmaError,
    ),
    "MATLAB": (functions(".", matlab=True), "made/plain.mat", EmaError),
    "MATLAB, compressed": (functions(".", matlab=True), "made/compressed.mat", EmaError),
    "HDF5": (functions("/", matlab=False), "made/functions.h5", EmaError),
    "histories of MATLAB": (histories("data(*).y", matlab=True), "made/blows.mat", EmaError),
    "histories of HDF5": (histories("hit_*/y"), "made/blows.h5", EmaError),
    "histories of NumPy": (histories("y"), "made/blows.npz", EmaError),
    "histories of LabVIEW": (histories("hit */F", axes=("hit", "time"), sampling=2560.0), "made/blows.tdms", EmaError),
    "sound file": (lambda file: read_wav(file, (2.0,)), "made/blow.wav", EmaError),
    "modes of a universal file": (lambda file: read_modes_uff(file, own_frf()[0]), "made/modes.uff", EmaError),
    "modes of a table": (
        lambda file: read_modes_table((file, file.with_name("shapes.csv"))),
        "made/modes.csv",
        EmaError,
    ),
    "shapes of a table": (
        lambda file: read_modes_table((file.with_name("modes.csv"), file)),
        "made/shapes.csv",
        EmaError,
    ),
    "shapes of SDynPy": (lambda file: read_modes_numpy(file, own_frf()[0]), "made/shapes.npy", EmaError),
    "functions of SDynPy": (lambda file: read_data_arrays(file, parse_unit("g/N")), "made/functions.npz", EmaError),
    "first campaign file, of functions of SDynPy": (drafted, "made/functions.npz", EmaError),
    "first campaign file, of a table": (drafted, "made/table.csv", EmaError),
    "first campaign file, of blanks": (drafted, "made/blanks.txt", EmaError),
    "first campaign file, of histories": (drafted, "made/histories.csv", EmaError),
    "first campaign file, of LabVIEW's text": (drafted, "made/labview.lvm", EmaError),
    "first campaign file, of a universal file": (drafted, "made/own.uff", EmaError),
    "first campaign file, of MATLAB": (drafted, "made/plain.mat", EmaError),
    "first campaign file, of HDF5": (drafted, "made/blows.h5", EmaError),
    "first campaign file, of NumPy": (drafted, "made/blows.npz", EmaError),
    "first campaign file, of TDMS": (drafted, "made/blows.tdms", EmaError),
    "points": (lambda file: read_points(file, parse_unit("mm")), "demo_stack/points.csv", EmaError),
    "campaign": (read_campaign, "demo_stack/campaign.toml", EmaError),
    "campaign of tables": (read_campaign, "hidden_effect/b/campaign.toml", EmaError),
    "campaign of specimens": (read_specimens, "hidden_effect/pooled_a/campaign.toml", LAMELLA_ERRORS),
    "modes of a specimen": (specimens, "hidden_effect/pooled_a/S1/M1_modes.csv", LAMELLA_ERRORS),
    "shapes of a specimen": (specimens, "hidden_effect/pooled_a/S1/M1_shapes.csv", LAMELLA_ERRORS),
    "modes of all specimens": (
        lambda file: classes(file, {"specimen": "1", "configuration": "M2"}),
        "pirnat2013/modes.csv",
        LAMELLA_ERRORS,
    ),
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
        lambda file: read_modal_table(file.with_name("table7.toml")),
        "pirnat2013/table7_frequencies_320kPa.csv",
        LAMELLA_ERRORS,
    ),
    "published table": (
        lambda file: read_published(file.parent),
        "pirnat2013/table6_contact_parameters.csv",
        LAMELLA_ERRORS,
    ),
    "result": (read_document, "demo_stack/truth.json", StoreError),
    "poles": (read_poles, "made/poles.txt", IdentificationError),
    "functions that a run wrote": (read_frf, "made/measurement.npz", StoreError),
}
