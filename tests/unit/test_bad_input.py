"""Bad input, one situation a row: what the command says, that it fails, and that it leaves nothing half-written."""

import json
import os
import pickle
import re
import shutil
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from ema.campaign.campaign import read_campaign
from ema.io.uff import write_uff
from ema.types.frf import FRF, Dofs, Geometry
from updating.commands.command_line import main
from updating.results import identified
from updating.results.identified import assignments
from updating.results.store import read_frf, write_frf

pytestmark = pytest.mark.usefixtures("all_undrawn")
PUBLISHED = Path(__file__).parents[2] / "data/pirnat2013"
STRUCTURE = '[structure]\nstack = "stack.toml"\n'
FILES = """\
pressure_kPa = 320
files = ["run_*.csv"]
output = ["1+z", "2+z", "3+z", "4+z", "5+z", "6+z"]
input = ["1+z"]
[identification]
order = 12
"""
PRESSING = 'normal_modulus_GPa = 5\n[pressing]\ncurve = "curve.csv"\nplate = "rigid"'
POINTS = "node,x,y,z\n1,-150,-40,5\n2,-150,40,5\n3,0,-40,5\n4,0,40,5\n5,150,-40,5\n6,150,40,5\n"
SHAPE = np.array([[1.0, -1.0, 0.1, -0.1, -1.0, 1.0], [1.0, 1.0, -0.8, -0.8, 1.0, 1.0]])


def functions(start=1.0, step=1.0, n_line=200):
    """Accelerances of two modes at 50 and 110 Hz with a little noise: frequencies and (6, n_line)."""
    frequency = start + step * np.arange(n_line)
    s = 2j * np.pi * frequency
    value = np.zeros((6, n_line), complex)
    for shape, omega in zip(SHAPE, 2 * np.pi * np.array([50.0, 110.0]), strict=True):
        value += s**2 * np.outer(shape, shape[0] / (s**2 + 0.02 * omega * s + omega**2))
    return frequency, value * (1 + 1e-4 * np.random.default_rng(0).standard_normal(value.shape))


def table(frequency, value):
    rows = zip(frequency, value.T, strict=True)
    return "".join(f"{f:.9g},{','.join(f'{z.real:.9g},{z.imag:.9g}' for z in values)}\n" for f, values in rows)


@pytest.fixture
def folder(tmp_path, monkeypatch, stack_text, campaign_text):
    """A sound campaign of six points in two runs, and its small stack, in the working directory."""
    frequency, value = functions()
    stack = stack_text.replace("height_mm = 65", "height_mm = 10").replace("n_lamina = 240", "n_lamina = 20")
    files = {"stack.toml": stack + "[mesh]\nn_x = 4\nn_y = 2\n"}
    files |= {"campaign.toml": STRUCTURE + campaign_text + FILES, "points.csv": POINTS}
    files |= {"run_1.csv": table(frequency, value[:3]), "run_2.csv": table(frequency, value[3:])}
    for name, text in files.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def lamella(monkeypatch, capsys, *arguments):
    """Run the command line; return its exit code and what it said, in one line, without the progress of a slow run."""
    monkeypatch.setattr(sys, "argv", ["lamella", *arguments])
    try:
        main()
        code = 0
    except SystemExit as stopped:
        code = stopped.code
    said = capsys.readouterr()
    complained = (line for line in said.err.splitlines() if not re.search(r" \(\d+ s\)$", line))
    return code, " ".join(said.out.split()), " ".join(" ".join(complained).split())


def changed(name, *pairs):
    def damage(folder):
        text = (folder / name).read_text(encoding="utf-8")
        for old, new in pairs:
            assert old in text
            text = text.replace(old, new, 1)
        (folder / name).write_text(text, encoding="utf-8")

    return damage


def stack(old, new):
    return changed("stack.toml", (old, new))


def campaign(old, new):
    return changed("campaign.toml", (old, new))


def holds(name, text):
    return lambda folder: (folder / name).write_bytes(text if isinstance(text, bytes) else text.encode())


def gone(name):
    return lambda folder: (folder / name).unlink()


def all_of(*damages):
    return lambda folder: [damage(folder) for damage in damages]


def untouched(folder):
    pass


def not_numbers(*runs):
    rows = "".join(f"{line}{',nan' * 6}\n" for line in range(1, 201))
    return all_of(*(holds(f"run_{run}.csv", rows) for run in runs))


def noise(folder):
    for seed, run in enumerate(("run_1.csv", "run_2.csv")):
        value = np.random.default_rng(seed).standard_normal((3, 200)) + 0j
        holds(run, table(functions()[0], value))(folder)


def second_axis(run=2, **axis):
    return lambda folder: holds(f"run_{run}.csv", table(*((f := functions(**axis))[0], f[1][3:])))(folder)


def clamps(*tables):
    def damage(folder):
        with (folder / "stack.toml").open("a", encoding="utf-8") as file:
            file.writelines(f"[[clamps]]\n{keys}\n" for keys in tables)

    return damage


def direction(written):
    return campaign('"1+z", "2', f'{{node = 1, direction = {written}}}, "2')


def many_points(folder):
    with (folder / "points.csv").open("a", encoding="utf-8") as file:
        file.writelines(f"{node},0,0,5\n" for node in range(7, 100_007))


NAMED = campaign('"run_*.csv"', '"run_1.csv", "run_2.csv"')


def pipe(name):
    return all_of(NAMED, gone(name), lambda folder: os.mkfifo(folder / name))


def endless(name):
    return all_of(NAMED, gone(name), lambda folder: (folder / name).symlink_to("/dev/zero"))


def universal(cut=None, kind=None):
    """Give the functions as a universal file, cut to a share of its bytes, or as sets of another kind."""

    def damage(folder):
        frequency, value = functions()
        dofs = Dofs(node=np.arange(1, 7), direction=np.tile([0.0, 0.0, 1.0], (6, 1)))
        frf = FRF(
            frequency=frequency, value=value[:, None], quantity="accelerance", output=dofs,
            input=Dofs(node=[1], direction=[[0.0, 0.0, 1.0]]), run=np.zeros(6, int), source=("a",) * 6,
        )  # fmt: skip
        points = Geometry(node=np.arange(1, 7), coordinate=np.zeros((6, 3)), line=np.empty((0, 2), int))
        write_uff(folder / "all.uff", points, frf if kind is None else None)
        content = (folder / "all.uff").read_bytes()
        (folder / "all.uff").write_bytes(content[: int(len(content) * (cut or 1.0))])
        output = 'output = ["1+z", "2+z", "3+z", "4+z", "5+z", "6+z"]\ninput = ["1+z"]\n'
        changed("campaign.toml", ('"run_*.csv"', '"all.uff"'), (output, ""))(folder)

    return damage


def arrays(axes='["frequency", "output"]', frf="H"):
    """Give the functions as an HDF5 file of the arrays H and f, described like this."""

    def damage(folder):
        frequency, value = functions()
        with h5py.File(folder / "run.h5", "w") as file:
            file["H"], file["f"] = value.T, frequency
        table = f'[measurement.variables]\nfrf = "{frf}"\nfrequency = "f"\naxes = {axes}\n'
        changed("campaign.toml", ('[measurement.table]\nlayout = "real-imaginary"\n', table), ("run_*.csv", "run.h5"))(
            folder
        )

    return damage


def published(name, old, new):
    """Put the published campaign beside it, with a table damaged."""

    def damage(folder):
        shutil.copytree(PUBLISHED, folder, dirs_exist_ok=True)
        content = (PUBLISHED / name).read_bytes()
        assert old in content
        (folder / name).write_bytes(content.replace(old, new, 1))

    return damage


MESH = '[outline]\nkind = "mesh"\nfile = "mesh.pkl"\n'


class Planted:
    """Ends the process where its pickle is read."""

    def __reduce__(self):
        return os._exit, (77,)


def planted(name):
    return holds(name, pickle.dumps(Planted()))


UPDATE = 'name = "one"\n'
UPDATED = '[[campaign]]\nfile = "campaign.toml"\n'
ONE_POINT = all_of(
    gone("run_2.csv"),
    holds("run_1.csv", table(functions()[0], functions()[1][:1])),
    campaign(', "2+z", "3+z", "4+z", "5+z", "6+z"', ""),
)
SECOND = '[[configuration]]\nname = "m1"\nfiles = ["run_1.csv"]\noutput = ["1+z"]\n[identification]'

TABLE = {
    # missing, empty and unreadable files
    "no campaign": ("fit nowhere.toml", untouched, ["nowhere.toml", "No such file"]),
    "no stack": ("fit campaign.toml", gone("stack.toml"), ["stack.toml", "No such file"]),
    "no points": ("ema campaign.toml", gone("points.csv"), ["points.csv", "no such file"]),
    "no update file": ("update nowhere.toml", untouched, ["nowhere.toml", "No such file"]),
    "no virtual test": ("simulate nowhere.toml", untouched, ["nowhere.toml", "No such file"]),
    "no curve": ("model stack.toml", stack("normal_modulus_GPa = 5", PRESSING), ["curve.csv", "No such file"]),
    "no effect file": ("model stack.toml --effect-file mine.py", untouched, ["mine.py", "EFFECT = Effect("]),
    "no poles": ("ema campaign.toml --poles .", untouched, ["no */poles.txt", "lamella ema"]),
    "no stack named": ("fit campaign.toml", campaign('stack = "stack.toml"', ""),
                       ['add stack = "stack.toml" under [structure]']),
    "empty campaign": ("ema campaign.toml", holds("campaign.toml", ""), ["configuration: this key is missing"]),
    "empty stack": ("model stack.toml", holds("stack.toml", ""), ["stack.toml: name: this key is missing"]),
    "empty run": ("ema campaign.toml", holds("run_2.csv", ""), ["run_2.csv", "no rows of numbers"]),
    "empty poles": ("ema campaign.toml --poles .",
                    all_of(lambda f: (f / "M1").mkdir(), holds("M1/poles.txt", "")), ["poles.txt", "holds no pole"]),
    "folder for a file": ("model .", untouched, ["is a folder", "give a file"]),
    "bytes for text": ("ema campaign.toml", holds("campaign.toml", bytes(range(256))), ["not a TOML file"]),
    "brackets without end": ("ema campaign.toml", holds("campaign.toml", "x = " + "[" * 3000), ["not a TOML file"]),
    "brackets without end in a stack": ("model stack.toml", holds("stack.toml", "x = " + "[" * 3000),
                                        ["not a TOML file"]),
    "no name of a file": ("ema campaign.toml", campaign('"points.csv"', '"\\u0000.csv"'), ["null byte"]),
    "no name of a universal file": ("ema campaign.toml", campaign('"points.csv"', '"\\u0000.uff"'), ["null byte"]),
    "no name of a curve": ("model stack.toml",
                           stack("normal_modulus_GPa = 5", PRESSING.replace("curve.csv", "\\u0000")), ["null byte"]),
    "another program's points": ("ema campaign.toml", holds("points.csv", b"\x93\xff\x00\x01"),
                                 ["points.csv", "cannot be read as text", "encoding"]),
    # a file for another purpose
    "stack for a virtual test": ("simulate stack.toml", untouched,
                                 ["shaker: this key is missing", "n_lamina: unknown key; Allowed: campaign"]),
    "folder without results": ("report .", untouched, ["no campaign.json", "lamella fit"]),
    # names that no file can have
    "name of a run that is too long": ("ema campaign.toml", campaign('"run_*.csv"', f'"{"9" * 5000}"'),
                                       ["configuration 'M1'", "names no file: File name too long"]),
    "pattern that is too long": ("ema campaign.toml", campaign('"run_*.csv"', f'"{"9" * 5000}/*.csv"'),
                                 ["configuration 'M1'", "names no file: File name too long"]),
    "name of points that is too long": ("ema campaign.toml", campaign('"points.csv"', f'"{"9" * 5000}"'),
                                        ["points.file", "names no file: File name too long"]),
    "name of a stack that is too long": ("model " + "9" * 300, untouched, ["File name too long"]),
    "name of a mesh that is too long": ("model stack.toml", all_of(
        changed("stack.toml", ("length_mm = 300\nwidth_mm = 80\n", "")),
        lambda f: holds("stack.toml", (f / "stack.toml").read_text() + MESH.replace("mesh.pkl", "9" * 300))(f)),
        ["File name too long"]),
    # universal files
    "cut off in its points": ("ema campaign.toml", universal(cut=0.05), ["all.uff: no function (dataset 58)"]),
    "cut off in a header": ("ema campaign.toml", universal(cut=0.9), ["all.uff: data set 8 (58b): no data values"]),
    "wrong data set": ("ema campaign.toml", universal(kind="points"),
                       ["all.uff: no function (dataset 58) in the file; it holds data sets"]),
    # files of arrays
    "variable that is not there": ("ema campaign.toml", arrays(frf="G"),
                                   ["run.h5: variable 'G' (frf)", "the file holds H (200 x 6), f (200)"]),
    "axes in another order": ("ema campaign.toml", arrays(axes='["output", "frequency"]'),
                              ["run.h5: variable 'f' (frequency)", "is the order axes = ['output', 'frequency']"]),
    # wrong numbers
    "text for a number": ("ema campaign.toml", holds("run_2.csv", "1,2,3,4,5,6,7\n2,soft,4,5,6,7,8\n"),
                          ["run_2.csv: row 2, column 2: expected a number, found 'soft'"]),
    "no number at all": ("ema campaign.toml", not_numbers(1, 2), ["'M1' cannot be used", "200 values are not numbers"]),
    "NaN for a coordinate": ("ema campaign.toml", changed("points.csv", ("150,-40", "nan,-40")), ["row 2", "finite"]),
    "no resonance": ("ema campaign.toml", noise, ["M1", "no", "stands out of the noise", "check the data"]),
    "band beside the data": ("ema campaign.toml", campaign("order = 12", "band_Hz = [500, 600]"),
                             ["M1", "the band holds no more than one frequency line"]),
    "order beyond the data": ("ema campaign.toml", campaign("order = 12", "order = 500"), ["too few for order 500"]),
    # points
    "unit of length": ("fit campaign.toml", campaign('unit = "mm"', 'unit = "m"'),
                       ["6 of 6 measured points lie more than 10 mm from the stack", "check the unit"]),
    "point without coordinates": ("fit campaign.toml", changed("points.csv", ("6,150,40,5\n", "")),
                                  ["run_2.csv: column 6, 7: point 6 of the response is not in", "points.csv"]),
    "point that is said to have none": ("fit campaign.toml", all_of(changed("points.csv", ("6,150,40,5\n", "")),
                                        campaign('unit = "mm"', 'unit = "mm"\nwithout_coordinates = [6]')),
                                        ["points [6] were measured but have no coordinates"]),
    "force at a point without coordinates": ("diagnose campaign.toml", all_of(
        campaign('input = ["1+z"]', 'input = ["7+z"]'),
        campaign('unit = "mm"', 'unit = "mm"\nwithout_coordinates = [7]')),
        ["point 7", "force", "has no coordinates"]),
    "fewer points than modes": ("fit campaign.toml", ONE_POINT,
                                ["M1: 2 modes were measured at 1 degrees of freedom", "measure at more points"]),
    "fewer points than modes, diagnosed": ("diagnose campaign.toml", ONE_POINT, ["2 modes", "1 degrees of freedom"]),
    "no pair of modes": ("fit campaign.toml --threshold 1.0", untouched, ["no measured mode", "MAC"]),
    # unknown keys, effects and names
    "key of a virtual test": ("simulate stack.toml", holds("stack.toml", "[shaker]\nplace_m = 1\n"),
                              ["shaker.place_m: unknown key; did you mean 'place_mm'?"]),
    "effect": ("model stack.toml --effect clamp_inertja", untouched, ["'clamp_inertja'; did you mean clamp_inertia"]),
    "effect of a fit": ("fit campaign.toml --effect clamp_inertja", untouched, ["did you mean clamp_inertia"]),
    "parameter": ("model stack.toml --effect pressure_exponent:exponnt=0.5", untouched, ["did you mean exponent?"]),
    "value": ("model stack.toml --effect pressure_exponent:exponent=many", untouched, ["must be a number", "'many'"]),
    "value out of range": ("model stack.toml --effect pressure_exponent:exponent=nan", untouched, ["0.2 to 1.3"]),
    "effect file that fails": ("model stack.toml --effect-file mine.py", holds("mine.py", "import nothing_here"),
                               ["mine.py: ModuleNotFoundError"]),
    "effect file without end": ("model stack.toml --effect-file mine.py", holds("mine.py", "x = 1"),
                                ["mine.py: has no EFFECT"]),
    "configuration": ("pick campaign.toml M2", untouched, ["no configuration 'M2'; Allowed: M1"]),
    "bytes in a table of modes": ("fit campaign.toml", published("modes.csv", b"364", b"\xff"), ["modes.csv"]),
    "names of one folder": ("ema campaign.toml", campaign("[identification]", SECOND),
                            ["'M1' and 'm1' would both be written to the folder m1"]),
    # impossible values
    "negative pressure": ("model stack.toml", stack("pressure_kPa = 320", "pressure_kPa = -320"),
                          ["contact: pressure must be positive, got -320000.0"]),
    "negative pressure of a test": ("fit campaign.toml", campaign("pressure_kPa = 320", "pressure_kPa = -320"),
                                    ["configuration[1].pressure_kPa", "greater than 0", "-320"]),
    "height that is no number": ("fit campaign.toml", campaign("pressure_kPa = 320", "height_mm = nan"),
                                 ["configuration[1].height_mm", "finite"]),
    "two heights, diagnosed": ("diagnose campaign.toml", all_of(campaign("[identification]", SECOND),
                               campaign("pressure_kPa = 320", "height_mm = 12")),
                               ["a diagnosis is of one stack", "the heights 10 and 12 mm"]),
    "zero laminas": ("model stack.toml", stack("n_lamina = 20", "n_lamina = 0"), ["n_lamina must be positive, got 0"]),
    "no elements": ("model stack.toml", stack("n_x = 4", "n_x = 0"), ["mesh: n_x must be positive, got 0"]),
    "Poisson's ratio": ("model stack.toml", stack("poisson = 0.28", "poisson = 1.2"), ["between -1 and 1"]),
    "infinite stiffness": ("model stack.toml", stack("young_GPa = 200", "young_GPa = inf"),
                           ["material.young_GPa", "found inf", "less than or equal to 1000000000000"]),
    "curve that falls": ("model stack.toml", all_of(stack("normal_modulus_GPa = 5", PRESSING),
                         holds("curve.csv", "strain,pressure_kPa\n0,0\n0.01,100\n0.02,50\n")),
                         ["curve.csv", "must rise", "point 3"]),
    "interlayer of nothing": ("model stack.toml", stack("normal_modulus_GPa = 5",
                              "normal_modulus_GPa = 5\n[[interlayers]]\nbelow = 10\nthickness_mm = 1\n"
                              "shear_modulus_MPa = 0\nnormal_modulus_MPa = 0\ndensity_kg_m3 = 1000"),
                              ["shear_modulus must be positive, got 0"]),
    "singular model": ("model stack.toml", stack("G_f = 825", "G_f = 1e-300"), ["not positive definite", "singular"]),
    "more modes than the model has": ("model stack.toml -n 200", stack("n_lamina = 20", "n_lamina = 1"),
                                      ["the model has no more than", "ask for fewer"]),
    "mass beyond any": ("model stack.toml", clamps("mass_kg = 1e300\nx_mm = 0"),
                          ["clamps[1].mass_kg", "found 1e+300", "less than"]),
    "clamp longer than the stack": ("model stack.toml", clamps("mass_kg = 1\nx_mm = 0\nfootprint_mm = [400, 80]"),
                                    ["clamps[1]: footprint_mm is 400 mm along x, but the stack is 300 mm"]),
    "clamp wider than the stack": ("model stack.toml", clamps("mass_kg = 1\nx_mm = 0\nfootprint_mm = [40, 90]"),
                                   ["clamps[1]: footprint_mm is 90 mm along y, but the stack is 80 mm"]),
    "clamps in one place": ("model stack.toml", clamps("mass_kg = 1\nx_mm = 0\nfootprint_mm = [40, 80]",
                                                       "mass_kg = 1\nx_mm = 30\nfootprint_mm = [40, 80]"),
                            ["clamps[1] and clamps[2]", "overlap by 10 mm along x and 80 mm along y"]),
    "true for a number of laminas": ("model stack.toml", stack("n_lamina = 20", "n_lamina = true"),
                          ["n_lamina", "found True"]),
    "true for a length": ("model stack.toml", stack("height_mm = 10", "height_mm = true"),
                          ["height_mm", "number, found True"]),
    "true for a pressure": ("ema campaign.toml", campaign("pressure_kPa = 320", "pressure_kPa = true"),
                            ["configuration[1].pressure_kPa", "number", "True"]),
    "true for a point": ("ema campaign.toml", campaign('"1+z", "2', '{node = true, direction = [0, 0, 1]}, "2'),
                         ["configuration[1].output[1]", "is not a DOF"]),
    "starts, which are gone": ("update update.toml", holds("update.toml", UPDATE + "starts = true\n" + UPDATED),
                               ["update.toml: starts", "unknown key"]),
    # directions, bands, points
    "table for a direction": ("ema campaign.toml", direction("{x = 1}"), ["output[1]", "is not a DOF", "'12+z'"]),
    "date in a direction": ("ema campaign.toml", direction("[1979-05-27, 0, 1]"), ["output[1]", "is not a DOF"]),
    "lists in a direction": ("ema campaign.toml", direction("[[0, 1], [2]]"), ["output[1]", "is not a DOF"]),
    "true in a direction": ("ema campaign.toml", direction("[0, 0, true]"), ["output[1]", "is not a DOF"]),
    "direction of two": ("ema campaign.toml", direction("[0, 1]"), ["output[1]", "is not a DOF"]),
    "point beyond any": ("ema campaign.toml", campaign('"1+z", "2', f'"{"9" * 20}+z", "2'),
                          ["9" * 20, "0 to 2147483647"]),
    "infinite band": ("ema campaign.toml", campaign("order = 12", "band_Hz = [0, inf]"),
                          ["band_Hz must be", "[0.0, inf]"]),
    "band without a number": ("ema campaign.toml", campaign("order = 12", "band_Hz = [10, nan]"), ["[10.0, nan]"]),
    "band beyond any": ("ema campaign.toml", campaign("order = 12", "band_Hz = [10, 1e308]"), ["band_Hz", "<= 1e+09"]),
    "decimal commas between commas": ("ema campaign.toml",
                                      changed("points.csv", ("1,-150,-40,5", "1,-150,5,-40,5,5,0")),
                                      ["points.csv: row 2 has more cells", "decimal commas", "semicolons or tabs"]),
    "negative frequencies": ("ema campaign.toml", all_of(*(second_axis(run, start=-120.0) for run in (1, 2))),
                             ["run_1.csv: column 2, 3", "down to -120 Hz", "one-sided"]),
    # what is too large, or no file
    "cell of a megabyte": ("ema campaign.toml", holds("run_2.csv", f"1,{'x' * 10**6},3,4,5,6,7\n"),
                           ["row 1, column 2: expected a number, found 'xxx", "x...'"]),
    "cell of a megabyte in the points": ("ema campaign.toml", holds("points.csv", f"node,x,y,z\n1,{'x' * 10**6},3,4\n"),
                                         ["points.csv: row 2", "131072"]),
    "head of a megabyte": ("ema campaign.toml", holds("points.csv", f"node,x,y,z{'x' * 10**6}\n1,2,3,4\n"),
                           ["points.csv: row 1", "131072"]),
    "points by the million": ("ema campaign.toml", many_points, ["points.csv: holds 100006 points, at most 100000"]),
    "pipe for a run": ("ema campaign.toml", pipe("run_2.csv"), ["'run_2.csv' is a pipe or a device"]),
    "pipe for points": ("ema campaign.toml", pipe("points.csv"), ["'points.csv' is a pipe or a device"]),
    "pipe for a stack": ("model stack.toml", pipe("stack.toml"), ["stack.toml", "is a pipe or a device"]),
    "pipe for a campaign": ("fit campaign.toml", pipe("campaign.toml"), ["campaign.toml", "is a pipe or a device"]),
    "pickle for a mesh": ("model stack.toml", all_of(changed("stack.toml", ("length_mm = 300\nwidth_mm = 80\n", "")),
                          lambda f: holds("stack.toml", (f / "stack.toml").read_text() + MESH)(f), planted("mesh.pkl")),
                          ["mesh.pkl: a pickle runs code"]),
    "pipe for poles": ("ema campaign.toml --poles .", all_of(lambda f: (f / "M1").mkdir(), holds("M1/poles.txt", ""),
                       pipe("M1/poles.txt")), ["poles.txt", "is a pipe or a device"]),
    "device for a run": ("ema campaign.toml", endless("run_2.csv"), ["'run_2.csv' is a pipe or a device"]),
    "device for a curve": ("model stack.toml", all_of(stack("normal_modulus_GPa = 5", PRESSING), holds("curve.csv", ""),
                           endless("curve.csv")), ["curve.csv", "is a pipe or a device"]),
}  # fmt: skip


@pytest.mark.parametrize("situation", list(TABLE))
def test_it_is_said_and_nothing_is_half_written(folder, monkeypatch, capsys, situation):
    command, damage, words = TABLE[situation]
    damage(folder)
    options = [] if command.startswith("report") else ["-o", "out"]
    code, out, said = lamella(monkeypatch, capsys, *command.split(), *options)
    assert code == 1, out
    assert said.startswith("Error: ")
    for part in words:
        assert part in said
    whole(folder / "out")


def whole(output):
    """Assert that what a failed command leaves are complete results, and nothing beside them."""
    left = [file for file in output.rglob("*") if file.is_file()]
    assert {file.name for file in left} <= {
        "campaign.json", "measurement.npz", "quality.json", "modal_model.json"
    }  # fmt: skip
    for file in left:
        if file.suffix == ".json":
            assert set(json.loads(file.read_text(encoding="utf-8"))) == {"kind", "provenance", "result", "digest"}


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (not_numbers(2), ["left out: 4+z", "200 values are not numbers"]),
        (universal(cut=0.5), ["the header announces 200 values, the data hold 136", "cropped", "1 to 136 Hz"]),
        (second_axis(step=0.7), ["left out, its 200 lines from 1 to 140.3 Hz are not among those of the others"]),
        (second_axis(start=20.0), ["cropped to their common lines, 20 to 200 Hz"]),
        (all_of(changed("points.csv", ("6,150,40,5\n", "")),
                campaign('unit = "mm"', 'unit = "mm"\nwithout_coordinates = [6]')),
         ["points without coordinates", "[6]"]),
        (campaign('"(m/s2)/N"', '"m/N"'), ["the apparent mass is", "check [measurement] unit"]),
    ],
    ids=["NaN in a run", "cut off in a function", "another step", "another start", "point without coordinates",
         "wrong unit"],
)  # fmt: skip
def test_what_can_be_done_without_is_left_out_and_said(folder, monkeypatch, capsys, damage, words):
    """The identification goes on with the rest: both modes are found."""
    damage(folder)
    monkeypatch.setattr("updating.commands.ema._write_tables_and_pictures", lambda *_, **__: None)  # to be quick
    code, out, said = lamella(monkeypatch, capsys, "ema", "campaign.toml", "-o", "out")
    assert code == 0, said
    for part in words:
        assert part in out
    assert re.search(r" 1 . +50\.0", out)
    assert re.search(r" 2 . +110\.0", out)


@pytest.mark.parametrize("command", ["ema", "fit"])
def test_a_configuration_that_cannot_be_used_does_not_end_the_others(folder, monkeypatch, capsys, command):
    text = (folder / "campaign.toml").read_text(encoding="utf-8")
    first = text.index("[[configuration]]")
    end = text.index("[identification]")
    noise = text[first:end].replace("M1", "M0").replace("run_*.csv", "noise.csv")
    (folder / "campaign.toml").write_text(text[:first] + noise + text[first:], encoding="utf-8")
    frequency, value = functions()
    rng = np.random.default_rng(1)
    noise = rng.standard_normal(value.shape) + 1j * rng.standard_normal(value.shape)
    (folder / "noise.csv").write_text(table(frequency, noise), encoding="utf-8")
    monkeypatch.setattr("updating.workers.workers.n_processor", lambda: 1)  # to be quick
    code, out, said = lamella(monkeypatch, capsys, command, "campaign.toml", "-o", "out")
    assert code == 1
    assert re.search(r"Error: M0: .*noise", said)
    assert (folder / "out/M1/modal_model.json").exists()
    assert re.search(r" 1 . +50\.0", out)
    assert (folder / "out/report.html").exists() == (command == "fit")
    assert not (folder / "out/M0").exists()


def test_a_full_disk_leaves_no_part_of_a_file(folder, monkeypatch, capsys):
    """A limit on the size of files stands for the disk: the system refuses in the middle of a file."""
    resource = pytest.importorskip("resource")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    monkeypatch.setattr("updating.commands.ema._write_tables_and_pictures", lambda *_, **__: None)
    resource.setrlimit(resource.RLIMIT_FSIZE, (5000, hard))
    try:
        code, _, said = lamella(monkeypatch, capsys, "ema", "campaign.toml", "-o", "out")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert code == 1
    assert re.search(r"cannot write \S+/out/M1/\S+: .+ Choose another folder with -o, or make room", said)
    whole(folder / "out")
    assert not (folder / "out/M1/modal_model.json").exists()
    code, out, _ = lamella(monkeypatch, capsys, "ema", "campaign.toml", "-o", "out")  # there is room again
    assert code == 0
    assert "50.000" in out


@pytest.mark.parametrize("name", ["modes.uff", "modes.csv", "shapes.csv", "poles.txt"])
def test_tables_that_cannot_be_written_leave_the_old_ones(folder, monkeypatch, capsys, name):
    monkeypatch.setattr("updating.commands.ema.as_png", lambda _: b"")
    assert lamella(monkeypatch, capsys, "ema", "campaign.toml", "-o", "out")[0] == 0
    os.utime(folder / "out/M1/modal_model.json")  # the tables are to be written again
    old = (folder / "out/M1" / name).read_bytes()

    rename = Path.replace

    def full(part, target):
        if Path(target).name == name:
            raise OSError(28, "No space left on device")
        return rename(part, target)

    monkeypatch.setattr(Path, "replace", full)
    code, _, said = lamella(monkeypatch, capsys, "ema", "campaign.toml", "-o", "out")
    assert code == 1
    assert f"cannot write {folder / 'out/M1' / name}: No space left on device" in said
    assert (folder / "out/M1" / name).read_bytes() == old
    assert not [file for file in (folder / "out/M1").iterdir() if file.name.startswith(".")]


def test_a_folder_without_permission(folder, monkeypatch, capsys):
    def denied(**_):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(tempfile, "mkstemp", denied)
    code, _, said = lamella(monkeypatch, capsys, "ema", "campaign.toml", "-o", "out")
    assert code == 1
    assert "cannot write out/campaign.json: Permission denied. Choose another folder with -o" in said


def test_a_stored_measurement_that_was_changed_is_made_anew(folder):
    (assigned,) = assignments(read_campaign(folder / "campaign.toml"), folder / "out")
    found = identified.identified(assigned)
    stored = folder / "out/M1/measurement.npz"
    content, frf = stored.read_bytes(), read_frf(stored)
    assert identified.read_back(assigned) is not None
    halved = replace(frf, value=0.5 * frf.value)
    for damage in (lambda: stored.write_bytes(content[:-20]), lambda: write_frf(stored, halved), stored.unlink):
        damage()
        assert identified.read_back(assigned) is None
    again = identified.identified(assigned)
    np.testing.assert_array_equal(again.modal_model.pole, found.modal_model.pole)
    np.testing.assert_array_equal(read_frf(stored).value, frf.value)


def test_an_interrupted_run_says_what_is_kept(folder, monkeypatch, capsys):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(identified, "identify", interrupted)
    code, _, said = lamella(monkeypatch, capsys, "ema", "campaign.toml", "-o", "out")
    assert code == 130
    assert "what was done is kept, and the same command goes on from there" in said
    whole(folder / "out")
