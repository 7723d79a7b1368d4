"""Every key of every file format goes through a command: a key that no file here has makes this fail."""

import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args, get_origin

import h5py
import numpy as np
import pytest
from pydantic import BaseModel
from scipy.io import wavfile
from typer.testing import CliRunner

from ema.campaign.campaign_file import CampaignFile
from model.stack.stack_file import StackFile
from updating.commands import diagnose, update
from updating.commands.command_line import app
from updating.commands.update import UpdateFile
from updating.diagnosis.evidence import ScatterFile
from updating.pooled.campaign_file import SpecimensFile
from updating.virtual.vibration_test import VirtualTestFile

DATA = Path(__file__).parents[2] / "data"
N = 10
FREQUENCY = np.arange(60.0, 240.0, 0.5)
NATURAL = np.array([110.0, 190.0])
OUTPUT = ", ".join(f'"{n}+z"' for n in range(1, N + 1))
POINTS = """
[points]
file = "points.csv"
unit = "mm"
lines = [[1, 2, 3]]
without_coordinates = [99]
"""
STEEL = """
[material]
young_GPa = 200
poisson = 0.28
density_kg_m3 = 7650
"""
STACK = f"""
name = "small"
length_mm = 300
width_mm = 60
height_mm = 40
n_lamina = 12
[mesh]
n_x = 6
n_y = 2
{STEEL}
transverse_ratio = 0.98
shear_ratio = 0.97
[contact]
G_f = 1500
d_f_s_per_Pa = 1e-11
pressure_kPa = 160
normal_modulus_GPa = 1
"""
CONTACT = "[contact]\nG_f = 1500\nd_f_s_per_Pa = 1e-11\n"

CAMPAIGN_TABLE = f"""
[campaign]
name = "keys"
project = "Stack of laminations"
author = "A. Miller"
date = 2026-03-01
[structure]
stack = "stack.toml"
{POINTS}
[measurement]
format = "csv"
unit = "(m/s2)/N"
exponential_window_s = 5
sensor_mass_g = 0.001
[measurement.table]
layout = "magnitude-phase"
delimiter = "semicolon"
decimal = ","
header_rows = 1
encoding = "latin-1"
axis_column = 0
axis_start = 60
axis_step = 0.5
columns = {[[2 * i + 2, 2 * i + 3] for i in range(N)]}
coherence_columns = {[2 * N + 2] * N}
phase_unit = "rad"
magnitude_unit = "dB"
[[configuration]]
name = "M1"
stack = 4
torque_Nm = 1.5
pressure_kPa = 160
height_mm = 64.8
force_N = 2
files = ["set.txt"]
output = [{OUTPUT}]
input = ["1+z"]
[[configuration.force_level]]
force_N = 10
files = ["set.txt"]
output = [{OUTPUT}]
input = ["1+z"]
[[correction]]
files = "set.txt"
function = 3
scale = -1
conjugate = false
reason = "upside down"
[[correction]]
output = "4+z"
new_output = "4-z"
new_input = "1-z"
reason = "both turned"
[[correction]]
output = "5+z"
exclude = true
reason = "loose"
[identification]
band_Hz = [60, 240]
order = 8
"""
STATE = f"""
[[configuration]]
name = "%s"
%s
files = ["set.csv"]
output = [{OUTPUT}]
input = ["1+z"]
"""
CAMPAIGN_STATES = f"""
[campaign]
name = "keys"
{POINTS}
[measurement]
unit = "(m/s2)/N"
[measurement.table]
layout = "real-imaginary"
{STATE % ("before", "")}
{STATE % ("before again", 'repeat_of = "before"')}
{STATE % ("after", 'compare_to = "before"')}
[reassembly]
frequency = 0.002
damping = 0.1
shape = 0.03
[identification]
band_Hz = [60, 240]
order = 8
"""
CAMPAIGN_BELOW = f"""
[campaign]
name = "functions below each other"
{POINTS}
[measurement]
unit = "(m/s2)/N"
[measurement.table]
layout = "real-imaginary"
output_columns = [1]
input_columns = [2]
direction = "+z"
axis_column = 3
columns = [[4, 5]]
[[configuration]]
name = "M1"
files = ["below.csv"]
[identification]
band_Hz = [60, 240]
order = 8
"""
CAMPAIGN_TIME = f"""
[campaign]
name = "keys"
{POINTS}
[measurement.table]
layout = "time"
sampling_Hz = 600
[measurement.time]
window = "boxcar"
estimator = "H2"
response_end = 0.9
force_s = 1.5
force = 1
force_unit = "N"
response_unit = "m/s2"
[[configuration]]
name = "M1"
[[configuration.run]]
files = ["blow_1.csv", "blow_2.csv"]
output = [{OUTPUT}]
input = "1+z"
[identification]
band_Hz = [60, 240]
order = 8
"""
CAMPAIGN_BLOCKS = CAMPAIGN_TIME.replace("response_end = 0.9\nforce_s = 1.5\n", "block_s = 2\noverlap = 0.5\n").replace(
    '["blow_1.csv", "blow_2.csv"]', '"record.csv"'
)
CAMPAIGN_HITS = CAMPAIGN_BLOCKS.replace("block_s = 2\noverlap = 0.5\n", "block_s = 1.5\nbefore_hit_s = 0.05\n")

CAMPAIGN_ARRAYS = CAMPAIGN_TIME.replace(
    '[measurement.table]\nlayout = "time"\nsampling_Hz = 600\n',
    '[measurement.variables]\nhistory = "blows"\naxes = ["hit", "time", "channel"]\ntime = "first channel"\n'
    "sampling_Hz = 600\n",
).replace('["blow_1.csv", "blow_2.csv"]', '"blows.npz"')
CAMPAIGN_WAV = f"""
[campaign]
name = "sound files"
{POINTS}
[measurement]
full_scale = 5
[measurement.time]
window = "boxcar"
force_unit = "N"
response_unit = "m/s2"
[[configuration]]
name = "M1"
[[configuration.run]]
files = ["blow_1.wav", "blow_2.wav"]
output = [{OUTPUT}]
input = ["1+z"]
[identification]
band_Hz = [60, 240]
order = 8
"""
CAMPAIGN_BESIDE = CAMPAIGN_TIME.replace('["blow_1.csv", "blow_2.csv"]', '[["force_*.csv", "response_*.csv"]]')


def variables(frf, frequency):
    return f"""
[campaign]
name = "keys"
{POINTS}
[measurement]
format = "hdf5"
unit = "(m/s2)/N"
[measurement.variables]
{frf}
{frequency}
axes = ["frequency", "output"]
coherence = "coherence"
output_point = "points"
output_direction = "+z"
input_point = 1
input_direction = "+z"
[[configuration]]
name = "M1"
files = ["set.h5"]
[identification]
band_Hz = [60, 240]
order = 8
"""


STACK_PRESSED = f"""
name = "pressed"
length_mm = 300
width_mm = 60
height_mm = 40
n_lamina = 12
[mesh]
n_x = 4
n_y = 2
{STEEL}{CONTACT}
[pressing]
curve = "{DATA / "contact/compression_standin.csv"}"
plate_thickness_mm = 15
plate_young_GPa = 210
[[clamps]]
mass_kg = 0.1
x_mm = -50
y_mm = 0
footprint_mm = [30, 60]
distribution = "faces"
force_N = 3000
[[clamps]]
mass_kg = 0.1
x_mm = 50
force_N = 3000
"""
STACK_RIGID = f"""
{STACK_PRESSED.partition("[pressing]")[0]}
[pressing]
curve = "{DATA / "contact/compression_standin.csv"}"
plate = "rigid"
[[clamps]]
mass_kg = 0.1
x_mm = 0
force_N = 3000
"""
STACK_HELD = f"""
name = "held"
length_mm = 300
width_mm = 60
height_mm = 40
n_lamina = 12
[mesh]
n_x = 4
n_y = 2
{STEEL}{CONTACT}
torque_Nm = 1.5
torque_table = "torque.csv"
normal_modulus_GPa = 1
[[interlayers]]
below = 6
thickness_mm = 0.1
shear_modulus_MPa = 5
normal_modulus_MPa = 50
density_kg_m3 = 1200
[[supports]]
edge = "left"
condition = "elastic"
along_N_m2 = 1e6
across_N_m2 = 1e6
rotation_N = 1e3
laminas = "bottom"
[[supports]]
patch_mm = [100, 0, 40, 40]
along_N_m3 = 1e8
across_N_m3 = 1e8
"""


def outlined(table):
    return f"""
name = "outlined"
height_mm = 10
n_lamina = 4
[outline]
{table}
[mesh]
n_x = 8
{STEEL}{CONTACT}
pressure_kPa = 320
normal_modulus_GPa = 1
"""


STATOR = """kind = "stator"
outer_mm = 200
inner_mm = 110
slot_mm = 160
n_tooth = 6
tooth_width_mm = 30
hole_mm = 8
hole_circle_mm = 182
n_hole = 4
"""
POLYGON = """kind = "polygon"
boundary_mm = [[0, 0], [100, 0], [100, 60], [0, 60]]
holes_mm = [[[40, 20], [60, 20], [60, 40], [40, 40]]]
"""
MESH = 'kind = "mesh"\nfile = "mesh.obj"\n'
OBJ = "v 0 0 0\nv 100 0 0\nv 100 60 0\nv 0 60 0\nv 50 30 0\nf 1 2 5\nf 2 3 5\nf 3 4 5\nf 4 1 5\n"


def virtual(noise):
    return f"""
[campaign]
name = "small"
[structure]
stack = "stack.toml"
mesh = [6, 2]
[points]
n_station = 3
[shaker]
place_mm = [-130, 20, -20]
force_cell_mass_g = 10
stinger_N_m = 2000
[measurement]
band_Hz = [300, 2000]
step_Hz = 10
{noise}
sensor_mass_g = 5
dummy_masses = true
format = "csv"
seed = 7
[[configuration]]
name = "M1"
torque_Nm = 1.5
pressure_kPa = 160
G_f = 1600
d_f_s_per_Pa = 2e-11
[[effect]]
name = "contact_loss"
values = {{ contact_eta = 0.005 }}
[deviation]
torque = [0.05]
[spread]
density = 0.01
"""


UPDATE = """
name = "all keys"
effects = ["steel_loss"]
damping = false
[[campaign]]
file = "campaign.toml"
name = "keys"
configurations = ["M1"]
[parameter.G_f]
scope = "specimen"
bounds = [200, 6000]
[parameter.young]
prior = [1.0, 0.02]
[parameter.density]
fixed = 1.01
[parameter.steel_eta]
start = 0.01
[hold_out]
M1 = [2]
[scatter]
frequency = 0.01
damping = 0.1
pressure = 0.03
"""
SPECIMENS = f"""
[campaign]
name = "three stacks"
[structure]
stack = "stack.toml"
{POINTS.replace("without_coordinates = [99]", "")}
[measurement]
unit = "(m/s2)/N"
[measurement.table]
layout = "real-imaginary"
[reassembly]
frequency = 0.002
[[correction]]
reason = "as it is"
[identification]
band_Hz = [60, 240]
order = 8
[[specimen]]
name = "S1"
stack = "stack.toml"
height_mm = 39
n_lamina = 12
notes = {{treatment = "glued"}}
[specimen.material]
young_GPa = 190
poisson = 0.29
density_kg_m3 = 7600
transverse_ratio = 0.99
shear_ratio = 0.98
[[specimen.configuration]]
name = "M1"
torque_Nm = 1.5
pressure_kPa = 160
modes = "modes.csv"
shapes = "shapes.csv"
force = "1+z"
[[specimen]]
name = "S2"
compare_to = "S1"
[[specimen.configuration]]
name = "M1"
files = ["set.csv"]
output = [{OUTPUT}]
input = ["1+z"]
[[specimen]]
name = "S3"
[[specimen.configuration]]
name = "M1"
[[specimen.configuration.run]]
files = ["set.csv"]
output = [{OUTPUT}]
input = ["1+z"]
[[specimen]]
name = "S4"
repeat_of = "S1"
[[specimen.configuration]]
name = "M1"
modal_model = "earlier/M1/modal_model.json"
"""
SCATTER = "\n".join(f"{name} = 0.02" for name in ScatterFile.model_fields)
CAMPAIGN_MODES = f"""
[campaign]
name = "modes that another program identified"
{POINTS}
[modes]
frequency_std = 0.002
damping_std = 0.2
shape_std = 0.03
[[configuration]]
name = "M1"
modes = "file"
files = ["found.csv"]
input = "1+z"
"""
DIAGNOSED = CAMPAIGN_TABLE.replace("height_mm = 64.8", "height_mm = 40")


@dataclass(frozen=True)
class Used:
    """A file of a format, and the command that reads it."""

    form: type[BaseModel]
    text: str
    command: str
    slow: bool = False


FILES = {
    "table": Used(CampaignFile, CAMPAIGN_TABLE, "ema"),
    "changed states": Used(CampaignFile, CAMPAIGN_STATES, "ema"),
    "functions below each other": Used(CampaignFile, CAMPAIGN_BELOW, "ema"),
    "time histories": Used(CampaignFile, CAMPAIGN_TIME, "ema"),
    "arrays of histories": Used(CampaignFile, CAMPAIGN_ARRAYS, "ema"),
    "files side by side": Used(CampaignFile, CAMPAIGN_BESIDE, "ema"),
    "sound files": Used(CampaignFile, CAMPAIGN_WAV, "ema"),
    "read modes": Used(CampaignFile, CAMPAIGN_MODES, "ema"),
    "hits": Used(CampaignFile, CAMPAIGN_HITS, "ema", slow=True),
    "blocks": Used(CampaignFile, CAMPAIGN_BLOCKS, "ema", slow=True),
    "variables": Used(CampaignFile, variables('frf = "H"', "axis_start = 60\naxis_step = 0.5"), "ema"),
    "parts": Used(CampaignFile, variables('real = "re"\nimaginary = "im"', 'frequency = "f"'), "ema", slow=True),
    "polar parts": Used(
        CampaignFile,
        variables('magnitude = "dB"\nphase = "angle"\nmagnitude_unit = "dB"\nphase_unit = "rad"', 'frequency = "f"'),
        "ema",
        slow=True,
    ),
    "stack": Used(StackFile, STACK, "model -n 1", slow=True),
    "pressed stack": Used(StackFile, STACK_PRESSED, "model -n 1", slow=True),
    "rigid plates": Used(StackFile, STACK_RIGID, "model -n 1", slow=True),
    "held stack": Used(StackFile, STACK_HELD, "model -n 1"),
    "stator": Used(StackFile, outlined(STATOR), "model -n 1", slow=True),
    "polygon": Used(StackFile, outlined(POLYGON), "model -n 1"),
    "mesh": Used(StackFile, outlined(MESH), "model -n 1", slow=True),
    "averaged test": Used(
        VirtualTestFile, virtual("averages = 8\nforce_noise = 0.01\nresponse_noise = 0.02"), "simulate"
    ),
    "noisy test": Used(VirtualTestFile, virtual("noise = 0.01"), "simulate", slow=True),
    "updating": Used(UpdateFile, UPDATE, "update", slow=True),
    "specimens": Used(SpecimensFile, SPECIMENS, "diagnose", slow=True),
    "scatter": Used(ScatterFile, SCATTER, "diagnose campaign.toml --scatter"),
}
FORMS = (CampaignFile, StackFile, VirtualTestFile, UpdateFile, SpecimensFile, ScatterFile)


def every_form(form: type[BaseModel]) -> Iterator[type[BaseModel]]:
    """The form of a file and those of all tables in it."""
    yield form
    for field in form.model_fields.values():
        for inner, _ in _inner(field.annotation, named=False):
            yield from every_form(inner)


def _inner(annotation: Any, *, named: bool) -> Iterator[tuple[type[BaseModel], bool]]:
    """The forms of the tables under a key, and whether each has a name that the user gives."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation, named
    mapping = get_origin(annotation) in (dict, Mapping)
    for part in get_args(annotation):
        yield from _inner(part, named=named or mapping)


def used(form: type[BaseModel], given: dict[str, Any]) -> Iterator[tuple[type[BaseModel], str]]:
    """Every key of a file, with the form of its table."""
    for key, value in given.items():
        yield form, key
        for inner, named in _inner(form.model_fields[key].annotation, named=False):
            tables = value.values() if named else value if isinstance(value, list) else [value]
            for table in tables:
                yield from used(inner, table)


def test_no_key_is_left_out():
    known = {(form, key) for whole in FORMS for form in every_form(whole) for key in form.model_fields}
    found = {pair for file in FILES.values() for pair in used(file.form, tomllib.loads(file.text))}
    assert sorted(f"{form.__name__}.{key}" for form, key in known - found) == []


def extended(form: type[BaseModel]) -> Iterator[type[BaseModel]]:
    """The forms that extend another and are not extended themselves: what these share is in each of them."""
    for each in form.__subclasses__():
        yield from extended(each) if each.__subclasses__() else (each,)


def test_no_format_is_left_out():
    """Every form of the package is that of one of these files or of a table in it."""
    ours = {each for each in extended(BaseModel) if each.__module__.split(".")[0] in ("ema", "model", "updating")}
    # No command reads structure files of matrices; `tests/unit/test_matrices.py` uses their keys.
    ours = {each for each in ours if not each.__module__.startswith("model.matrices")}
    parts = {form for whole in FORMS for form in every_form(whole)}
    assert sorted(each.__name__ for each in ours - parts if each.model_fields) == []


def functions():
    """Accelerances of a bar of two modes with a little noise, (N, n_line)."""
    omega, one = 2 * np.pi * FREQUENCY, 2 * np.pi * NATURAL
    shape = np.cos(np.pi * np.outer(np.linspace(0, 1, N), [2, 3])) + 0.1
    value = (shape * shape[0]) @ (-(omega**2) / (one[:, None] ** 2 - omega**2 + 0.02j * one[:, None] * omega))
    rng = np.random.default_rng(0)
    return value + 0.01 * (rng.normal(size=value.shape) + 1j * rng.normal(size=value.shape))


def record(folder):
    """Four impacts of 4 s on the same bar, each decayed when the next one comes."""
    rate, n = 600.0, 4 * 2400
    line = np.fft.rfftfreq(n, 1 / rate)
    omega, one = 2 * np.pi * line, 2 * np.pi * NATURAL
    shape = np.cos(np.pi * np.outer(np.linspace(0, 1, N), [2, 3])) + 0.1
    frf = (shape * shape[0]) @ (-(omega**2) / (one[:, None] ** 2 - omega**2 + 0.02j * one[:, None] * omega))
    force = np.zeros(n)
    for k in range(60, n, 1200):
        force[k : k + 3] = 0.3, 1.0, 0.4
    response = np.fft.irfft(frf * np.fft.rfft(force), n)
    response += 1e-3 * np.std(response) * np.random.default_rng(0).normal(size=response.shape)
    table = np.column_stack([np.arange(n) / rate, force, *response])
    for name, rows in (("record", table), ("blow_1", table[:1200]), ("blow_2", table[1200:2400])):
        np.savetxt(folder / f"{name}.csv", rows, delimiter=",")
        wavfile.write(folder / f"{name}.wav", int(rate), rows[:, 1:] / 5.0)
    for name, rows in (("1", table[:1200]), ("2", table[1200:2400])):
        np.savetxt(folder / f"force_{name}.csv", rows[:, :2], delimiter=",")
        np.savetxt(folder / f"response_{name}.csv", np.delete(rows, 1, axis=1), delimiter=",")
    np.savez(folder / "blows.npz", blows=table[:2400].reshape(2, 1200, -1))


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The files that those above name."""
    value = functions()
    rows = [f"{n},{800 * at},0,0" for n, at in zip(range(1, N + 1), np.linspace(0, 1, N), strict=True)]
    (tmp_path / "points.csv").write_text("\n".join(["node,x,y,z", *rows]))
    one = [FREQUENCY, *(part for v in value for part in (v.real, v.imag))]
    np.savetxt(tmp_path / "set.csv", np.column_stack(one), delimiter=",")
    below = [(n, 1, f, h.real, h.imag) for n, v in enumerate(value, 1) for f, h in zip(FREQUENCY, v, strict=True)]
    np.savetxt(tmp_path / "below.csv", below, delimiter=",", fmt=["%d", "%d", "%.9g", "%.9g", "%.9g"])
    one = [FREQUENCY, *(p for v in value for p in (20 * np.log10(abs(v)), np.angle(v))), 0.99 + 0 * FREQUENCY]
    text = "\n".join(";".join(f"{x:.9g}" for x in row).replace(".", ",") for row in np.column_stack(one))
    (tmp_path / "set.txt").write_text(f"größte Zeile\n{text}\n", encoding="latin-1")
    with h5py.File(tmp_path / "set.h5", "w") as file:
        file["f"], file["H"], file["re"], file["im"] = FREQUENCY, value.T, value.T.real, value.T.imag
        file["dB"], file["angle"] = 20 * np.log10(abs(value.T)), np.angle(value.T)
        file["coherence"], file["points"] = np.full(value.T.shape, 0.99), np.arange(1, N + 1)
    record(tmp_path)
    (tmp_path / "found.csv").write_text("frequency_Hz,damping,1+z,2+z\n110,0.01,1,0.5\n190,0.01,1,-0.5\n")
    for name, text in (
        ("stack.toml", STACK), ("campaign.toml", DIAGNOSED),
        ("torque.csv", "torque_Nm,pressure_kPa\n1.5,160\n3,320\n"), ("mesh.obj", OBJ),
        ("modes.csv", "mode,frequency_Hz,damping\n1,300,0.002\n"),
        ("shapes.csv", "node,x,y,z,mode_1_real,mode_1_imag\n1,0,0,1,1,0\n2,0,0,1,0.5,0\n"),
    ):  # fmt: skip
        (tmp_path / name).write_text(text, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


class ReachedError(Exception):
    """All has been read, identified and stored: what remains are numbers."""


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=pytest.mark.slow) if file.slow else n for n, file in FILES.items()]
)
def test_a_command_takes_every_key(folder, monkeypatch, undrawn, name):
    def reached(*_, **__):
        raise ReachedError

    monkeypatch.setattr(diagnose, "diagnose_stack", reached)  # they take minutes
    monkeypatch.setattr(diagnose, "diagnose_specimens", reached)
    monkeypatch.setattr(update, "joint_fit", reached)
    if name == "specimens":
        done = CliRunner().invoke(app, ["ema", "campaign.toml", "-o", "earlier"])
        assert done.exit_code == 0, done.output
    (folder / "file.toml").write_text(FILES[name].text, encoding="utf-8")
    command, *options = FILES[name].command.split()
    named = [*options, "file.toml"] if options[-1:] == ["--scatter"] else ["file.toml", *options]
    done = CliRunner().invoke(app, [command, *named, "-o", "out"])
    if command in ("diagnose", "update"):
        assert isinstance(done.exception, ReachedError), done.output
    else:
        assert done.exit_code == 0, (done.output, done.exception)
    assert any((folder / "out").rglob("*.*"))
