"""Small files as newcomers bring them: each is drafted and read with the right numbers, or refused with the reason.

Each kind stands for an export that somebody has, or for a report in the trackers of other readers. All hold the same
functions of a structure with two modes, so that one check is enough: what is read after `lamella new`, with its "?"
filled in, are these functions.
"""

import contextlib
import gzip
import random
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np
import pytest
from nptdms import ChannelObject, TdmsWriter
from scipy.io import savemat
from typer.testing import CliRunner

from ema.campaign.campaign import read_campaign
from ema.campaign.draft import draft
from ema.campaign.draft_file import draft_file, draft_modes
from ema.campaign.measurement import read_measurement
from ema.io.uff58 import encode_58b
from ema.types.errors import CampaignError, MeasurementError
from updating.commands.command_line import app
from updating.errors import FitError
from updating.fitting.fit import model_file

pytestmark = pytest.mark.usefixtures("all_undrawn")
FREQUENCY = 0.5 * np.arange(1, 401)
POLES = 2 * np.pi * np.array([60.0, 110.0])
SHAPES = np.array([[1.0, 0.7], [0.4, -1.0], [-0.8, 0.9]])
S = 2j * np.pi * FREQUENCY[:, None]
VALUE = (S**2 / (S**2 + 0.02 * POLES * S + POLES**2)) @ (SHAPES[0] * SHAPES).T  # (line, output)
DEGREES = np.rad2deg(np.angle(VALUE))
DECIBEL = 20 * np.log10(np.abs(VALUE))
OUTPUTS = '["1+z", "2+z", "3+z"]'
Write = Callable[[Path], object]


@dataclass(frozen=True)
class Kind:
    """How a file is written, what is filled in for "?", and how far the numbers may be off."""

    write: Write
    fill: tuple[tuple[str, str], ...] = ()
    rtol: float = 1e-9
    said: str = ""  # in the campaign file
    scale: float = 1.0  # of the numbers in the file into SI
    zero: bool = False  # whether the file has a line at 0 Hz, too


def mat(content) -> Write:
    return lambda folder: savemat(folder / "a.mat", content)


def npz(content) -> Write:
    return lambda folder: np.savez(folder / "a.npz", **content)


def hdf5(content, units=None) -> Write:
    def write(folder):
        with h5py.File(folder / "a.h5", "w") as file:
            for name, value in content.items():
                file[name] = value
                if units and name in units:
                    file[name].attrs["units"] = units[name]

    return write


def sdynpy_array(abscissa, ordinate, dofs):
    """Functions as SDynPy's NDDataArray holds them, (n_function,)."""
    n = abscissa.size
    kind = [("abscissa", "f8", (n,)), ("ordinate", ordinate.dtype, (n,))]
    kind += [(f"comment{k}", "<U80") for k in range(1, 6)]
    kind += [("coordinate", [("node", "u8"), ("direction", "i1")], (len(dofs[0]),))]
    array = np.zeros(len(dofs), kind)
    array["abscissa"], array["ordinate"] = abscissa, ordinate
    for one, ends in zip(array["coordinate"], dofs, strict=True):
        for end, dof in zip(one, ends, strict=True):
            end["node"], end["direction"] = dof
    return array


def text(content, name="a.csv", encoding="utf-8") -> Write:
    return lambda folder: (folder / name).write_bytes(content.encode(encoding))


TITLES = ["f [Hz]", "1+z Re", "1+z Im", "2+z Re", "2+z Im", "3+z Re", "3+z Im"]
PARTS = np.column_stack([FREQUENCY, *(part for v in VALUE.T for part in (v.real, v.imag))])
COMPLEX = np.column_stack([FREQUENCY, VALUE])


def table(titles=TITLES, rows=PARTS, between=",", form=lambda x: f"{x:.17g}"):
    """Return rows of titles (none, or one text or more) and numbers."""
    above = [between.join(titles)] if isinstance(titles, list) else list(titles)
    return "\n".join([*above, *(between.join(map(form, row)) for row in rows)]) + "\n"


def quoted(x):
    return '"' + (x if isinstance(x, str) else f"{x:.17g}".replace(".", ",")) + '"'


def fortran(x):
    return f"{x:.16e}".replace("e", "D")


def savetxt(folder):
    np.savetxt(folder / "a.txt", COMPLEX, header="f 1+z 2+z 3+z")


def python_complex(x):
    return str(complex(x)) if x.imag else f"{x.real:.17g}"


HEADER = {
    "function type": 4,
    "response direction": 3,
    "reference node": 1,
    "reference direction": 3,
    "abscissa specific data type": 18,
    "abscissa units label": "Hz",
    "ordinate numerator specific data type": 12,
    "ordinate denominator specific data type": 13,
    "ordinate denominator units label": "N",
}


def universal(label="m/s^2", scale=1.0, value=VALUE, step=0.5, **header) -> Write:
    """Write the functions to a universal file, with a label of the response's unit."""

    def write(folder):
        sets = [
            encode_58b(
                HEADER | {"response node": n, "ordinate numerator units label": label} | header, step, step, one * scale
            )
            for n, one in enumerate(value.T, start=1)
        ]
        (folder / "a.uff").write_bytes(b"".join(sets))

    return write


def tdms(folder):
    channels = {"f": FREQUENCY}
    channels |= {f"H{k + 1}_re": v.real for k, v in enumerate(VALUE.T)}
    channels |= {f"H{k + 1}_im": v.imag for k, v in enumerate(VALUE.T)}
    with TdmsWriter(folder / "a.tdms") as writer:
        writer.write_segment([ChannelObject("frf", name, value) for name, value in channels.items()])


TIME = np.arange(600) / 1000


def history(folder, titles=("t [s]", "acc [g]"), name="a.csv"):
    rows = "".join(f"{t:.3f},{np.sin(99 * t):.6f}\n" for t in TIME)
    (folder / name).write_text(",".join(titles) + "\n" + rows)


def mixed_units(folder):
    text(table(["f", *(f"{t} [g/N]" for t in TITLES[1:])]), "a.csv")(folder)
    text(table(["f", *(f"{t} [V/N]" for t in TITLES[1:])]), "b.csv")(folder)


def spectra(*above) -> Write:
    return text(table((*above, "f [Hz],Magnitude,Phase"), PARTS[:, :3]))


def pair(value, between=","):
    """Return rows of the frequency and both parts of one function."""
    parts = np.column_stack([FREQUENCY, value.real, value.imag])
    return "".join(between.join(f"{x:.17g}" for x in row) + "\n" for row in parts)


BLOCKS = "".join(
    f"Function {k}: response {k}+Z, reference 1+Z\nf [Hz],Real [(m/s^2)/N],Imag [(m/s^2)/N]\n{pair(v)}\n"
    for k, v in enumerate(VALUE.T, start=1)
)
"""An export of one function after the other, each below its own header."""
COMPOUND = np.zeros(VALUE.T.shape, [("re", "f8"), ("im", "f8")])
COMPOUND["re"], COMPOUND["im"] = VALUE.T.real, VALUE.T.imag
SDYNPY = sdynpy_array(FREQUENCY, VALUE.T, [[(n, 3), (1, 3)] for n in (1, 2, 3)])
SPLIT = {f"{what}{k + 1}": part[:, k] for k in range(3) for what, part in (("mag", np.abs(VALUE)), ("phase", DEGREES))}
ARRAYS = {
    "magnitude and degrees": {"f": FREQUENCY, "H_mag": np.abs(VALUE), "H_phase": DEGREES},
    "dB and rad in names": {"freq": FREQUENCY, "mag_dB": DECIBEL, "phase_rad": np.angle(VALUE)},
    "rad by their size, names without a gap": {
        "freq": FREQUENCY, "Hmag": np.abs(VALUE), "Hang": np.angle(VALUE),
    },
    "units alone": {"freq": FREQUENCY, "FRF_dB": DECIBEL, "FRF_deg": DEGREES},
    "vectors for each function": {"freq": FREQUENCY} | SPLIT,
    "real and imaginary": {"freq": FREQUENCY, "Hreal": VALUE.real, "Himag": VALUE.imag},
    "real and imaginary vectors": {"freq": FREQUENCY}
    | {f"H{k + 1}_re": VALUE[:, k].real for k in range(3)}
    | {f"H{k + 1}_im": VALUE[:, k].imag for k in range(3)},
}  # fmt: skip
KINDS: dict[str, Kind] = {
    **{f"MATLAB: {name}": Kind(mat(content)) for name, content in ARRAYS.items()},
    **{f"HDF5: {name}": Kind(hdf5(content)) for name, content in ARRAYS.items()},
    **{f"NumPy: {name}": Kind(npz(content)) for name, content in ARRAYS.items()},
    "HDF5: units as attributes": Kind(
        hdf5({"f": FREQUENCY, "amp": DECIBEL, "phi": np.angle(VALUE) + 20 * np.pi}, {"amp": "dB", "phi": "rad"})
    ),
    "NumPy: functions of SDynPy": Kind(npz({"data": SDYNPY, "function_type": 4})),
    "NumPy: functions of SDynPy, a matrix of them, by numpy.savez": Kind(npz({"frfs": SDYNPY.reshape(3, 1)})),
    "NumPy: functions of SDynPy, by numpy.save": Kind(lambda folder: np.save(folder / "a.npy", SDYNPY)),
    "text: decimal commas in quotes, commas between": Kind(
        text(table([quoted(t) for t in TITLES], form=quoted)), said='decimal = ","'
    ),
    "text: decimal commas in quotes, semicolons between": Kind(
        text(table([quoted(t) for t in TITLES], between=";", form=quoted)), said='decimal = ","'
    ),
    "text: decimal points in quotes": Kind(text(table(form=lambda x: f'"{x:.17g}"'))),
    "text: quotes where there is a comma alone": Kind(
        text(table(form=lambda x: quoted(x) if "." in f"{x:.17g}" else f"{x:.0f}"))
    ),
    "text: titles and units in quotes, ME'scope": Kind(
        text(
            table(
                ("\t".join(map('"{}"'.format, ["Frequency", *TITLES[1:]])), "\t".join(['"Hz"', *6 * ['"g/N"']])),
                PARTS / [1.0, *6 * [9.80665]],
                "\t",
            ),
            "a.txt",
        ),
        said='unit = "g/N"  # as the header says',
    ),
    "text: titles in quotes, blanks between": Kind(
        text(table([f'"{t}"' for t in TITLES], between=" "), "a.txt"), said='layout = "real-imaginary"'
    ),
    "text: Fortran's exponents": Kind(
        text(table([t.replace(" ", "_") for t in TITLES], between="  ", form=fortran), "a.txt")
    ),
    "text: Fortran's exponents of three digits": Kind(
        text(table((), between=" ", form=lambda x: f"{x:.16e}".replace("e+0", "+00").replace("e-0", "-00")), "a.txt")
    ),
    "text: UTF-16": Kind(text(table(), encoding="utf-16")),
    "text: UTF-16 without a mark": Kind(text(table(), encoding="utf-16-le"), said='encoding = "utf-16-le"'),
    "text: UTF-16, big end first": Kind(text(table(), encoding="utf-16-be")),
    "text: UTF-8 with a mark": Kind(text(table(), encoding="utf-8-sig")),
    "text: Python's complex numbers": Kind(text(table(["f", "1+z", "2+z", "3+z"], COMPLEX, form=python_complex))),
    "text: numpy.savetxt of complex numbers": Kind(savetxt),
    "text: complex numbers with i and blanks": Kind(
        text(table((), COMPLEX, "\t", lambda x: f"{x.real:.17g} + {x.imag:.17g}i".replace("+ -", "- ")), "a.txt")
    ),
    "text: complex numbers with +-": Kind(text(table((), COMPLEX, ",", lambda x: f"({x.real:.17g}+{x.imag:.17g}j)"))),
    "text: volts over N, with the sensor's sensitivity": Kind(
        text(table(["f [Hz]", *(f"{t} [V/N]" for t in TITLES[1:])], PARTS / [1.0, *6 * [98.0665]])),
        fill=(('unit = "?"', 'unit = "V/N/(100 mV/g)"'),),
    ),
    "UFF: volts over N, with the sensor's sensitivity": Kind(
        universal("V", scale=1 / 98.0665),
        fill=(('unit = "?"', 'unit = "V/N/(100 mV/g)"'),),
        rtol=1e-6,  # of single precision
    ),
    "UFF: frequencies in kHz": Kind(
        universal(**{"abscissa units label": "kHz"}, step=5e-4), rtol=1e-6, said="[measurement]"
    ),
    "UFF: frequencies in rad/s": Kind(universal(**{"abscissa units label": "rad/s"}, step=np.pi), rtol=1e-6),
    "UFF: metres per square second as ms-2": Kind(universal("ms-2"), rtol=1e-6),
    "UFF: g": Kind(universal("g", scale=1 / 9.80665), rtol=1e-6),
    "UFF: of function type 0": Kind(universal(**{"function type": 0}), rtol=1e-6),
    "text: a header with an empty row and a lone sign of a comment": Kind(
        text("# test 3\n#\n\n" + table((), between=" "), "a.txt"), said="header_rows = 3"
    ),
    "text: packed": Kind(lambda folder: (folder / "a.csv.gz").write_bytes(gzip.compress(table().encode()))),
    "text: rows that are counted": Kind(
        text(table(["no", *TITLES], np.column_stack([np.arange(1, 401), PARTS]))), said="axis_column = 2"
    ),
    "text: frequencies in kHz": Kind(
        text(table(["f [kHz]", *TITLES[1:]], PARTS / [1e3, *6 * [1.0]])), said="axis_step = 0.5"
    ),
    "text: magnitude in dB and phase in degrees": Kind(
        text(
            table(
                ["f [Hz]", *(f"{n}+z {what}" for n in (1, 2, 3) for what in ("Magnitude (dB)", "Phase (deg)"))],
                np.column_stack([FREQUENCY, *(x for d, a in zip(DECIBEL.T, DEGREES.T, strict=True) for x in (d, a))]),
            )
        ),
        said='magnitude_unit = "dB"',
    ),
    "MATLAB: complex functions in a structure": Kind(mat({"test": {"H": VALUE, "freq": FREQUENCY}})),
    "MATLAB: functions along the second axis": Kind(mat({"FRF": VALUE.T, "f": FREQUENCY})),
    "MATLAB: a step of frequencies": Kind(mat({"H": VALUE, "df": 0.5, "fstart": 0.5}), said="axis_start = 0.5"),
    "TDMS: real and imaginary channels": Kind(tdms),
    "text: blocks of functions, each below a header": Kind(
        text(BLOCKS), said="the 3 segments of the file are functions of their own"
    ),
    "text: a sweep downwards": Kind(text(table(rows=PARTS[::-1]))),
    "text: what Microsoft's library writes for no number, at 0 Hz": Kind(
        text(table([",".join(TITLES), ",".join(["0", *6 * ["1.#QNAN"]])])), said="header_rows = 1"
    ),
    "text: columns that a program numbered": Kind(
        text(table(["Var1", *(f"Var{k}" for k in range(2, 8))])), said='layout = "real-imaginary"'
    ),
    "text: titles that come again on every page": Kind(
        text(table(rows=PARTS[:200]) + "\n".join(table(rows=PARTS[k : k + 100]).rstrip("\n") for k in (200, 300)))
    ),
    "text: a suffix of another program": Kind(
        text("* Freq(Hz) Re(1+z) Im(1+z) Re(2+z) Im(2+z) Re(3+z) Im(3+z)\n" + table((), between=" "), "a.frd")
    ),
    "UFF: called as text": Kind(
        lambda folder: (universal()(folder), (folder / "a.uff").rename(folder / "a.txt")), rtol=1e-6
    ),
    "MATLAB: circular frequencies": Kind(
        mat({"H": VALUE, "omega": 2 * np.pi * FREQUENCY}), said="axis_step = 0.5", rtol=1e-6
    ),
    "NumPy: two-sided functions": Kind(
        npz(
            {
                "H": np.vstack([np.zeros((1, 3)), VALUE, VALUE[-2::-1].conj()]),
                "freq": np.fft.fftfreq(800, 1 / 400) * np.where(np.arange(800) == 400, -1, 1),
            }
        ),
        said="is two-sided",
        zero=True,
    ),
    "NumPy: frequencies in a file beside the functions": Kind(
        lambda folder: (np.save(folder / "frf.npy", VALUE.T), np.save(folder / "freq.npy", FREQUENCY)),
        said="the frequencies are those of freq.npy",
    ),
    "HDF5: both parts along the last axis": Kind(
        hdf5({"H": np.stack([VALUE.T.real, VALUE.T.imag], axis=-1), "freq": FREQUENCY}), said='real = "H[:, :, 0]"'
    ),
    "MATLAB: names of variables that differ from file to file": Kind(
        lambda folder: [
            savemat(
                folder / f"FRF_{k}.mat",
                {f"FRF_{k}": {"y_values": {"values": v[:, None]}, "x_values": {"increment": 0.5, "start_value": 0.5}}},
            )
            for k, v in enumerate(VALUE.T, start=1)
        ],
        said='frf = "FRF_*.y_values.values"',
    ),
    "NumPy: functions from the highest frequency down": Kind(npz({"H": VALUE[::-1].T, "freq": FREQUENCY[::-1]})),
    "HDF5: a unit of the functions as an attribute": Kind(
        hdf5({"frf": COMPOUND, "f": FREQUENCY}, {"frf": "g/N"}), rtol=1e-9, said='unit = "g/N"', scale=9.80665
    ),
    "NumPy: more lines than functions, and no frequencies": Kind(
        lambda folder: np.save(folder / "a.npy", np.vstack([np.zeros(3), VALUE]).T),
        fill=(('frequency = "?"', "axis_step = 0.5"),),
        said='axes = ["output", "frequency"]',
        zero=True,
    ),
    "MATLAB: points, but no directions": Kind(
        mat({"H": VALUE, "f": FREQUENCY, "out_nodes": [1, 2, 3], "in_nodes": [1]}),
        fill=(
            ('output_direction = "?"', 'output_direction = "+z"'),
            ('input_direction = "?"', 'input_direction = "+z"'),
        ),
        said='output_point = "out_nodes"',
    ),
}
ONE_PART = table(["f [Hz]", "1+z", "2+z"], PARTS[:, [0, 1, 3]])
REFUSED: dict[str, tuple[Write, str]] = {
    "text: real parts in a file of their own": (
        text(ONE_PART, "frf_real.csv"),
        "frf_real.csv: its name says 'real': it seems to hold one part of each FRF alone",
    ),
    "text: a column for each point": (
        text(ONE_PART, "a.csv"),
        r"a.csv: its columns are called 1\+z, 2\+z, one for each channel: it seems to hold one part",
    ),
    "text: a dynamic stiffness": (
        text(table(["f [Hz]", "1+z Re [N/m]", "1+z Im [N/m]"], PARTS[:, :3])),
        "it states the unit N/m, which is no response over a force",
    ),
    "text: a transmissibility": (
        text(table(["f [Hz]", "1+z Re [g/g]", "1+z Im [g/g]"], PARTS[:, :3])),
        "it states the unit g/g, which is no response over a force",
    ),
    "UFF: an apparent mass": (
        universal(
            "N",
            **{
                "ordinate numerator specific data type": 13,
                "ordinate denominator specific data type": 12,
                "ordinate denominator units label": "m/s^2",
            },
        ),
        "a force over a response .* export FRFs, response over force",
    ),
    "UFF: a transmissibility": (
        universal(**{"ordinate denominator specific data type": 12, "ordinate denominator units label": "m/s^2"}),
        "a response over another response .* export FRFs",
    ),
    "UFF: packed": (
        lambda folder: (folder / "a.unv.gz").write_bytes(gzip.compress(b"x")),
        "a.unv.gz: a packed file of '.unv': unpack it",
    ),
    "text: accelerations alone": (
        text("t [s],a [m/s^2],b [g]\n" + "".join(f"{t:.3f},{np.sin(99 * t)},{np.cos(99 * t)}\n" for t in TIME)),
        r"all its channels are of motions \(a \[m/s\^2\], b \[g\]\), and an FRF needs a force",
    ),
    "text: functions in rows": (
        text("f," + ",".join(f"{x:g}" for x in FREQUENCY) + "\n" + "H," + ",".join(f"{x:g}" for x in FREQUENCY) + "\n"),
        "each row holds a function behind its name; write functions in columns",
    ),
    "text: numbers in brackets with their units": (
        text("".join(f"{x:g}\t(1.5dB,20°)\n" for x in FREQUENCY), "a.txt"),
        r"but such as '.*\(1.5dB,20°\)': export frequencies with real and imaginary parts",
    ),
    "text: accelerations without units": (
        text("millis,ax,ay,az\n" + "".join(f"{k},{np.sin(k)},{np.cos(k)},1\n" for k in range(400))),
        r"all its channels are of motions \(ax, ay, az\), and an FRF needs a force",
    ),
    "a file that stands beside measurements": (
        lambda folder: (folder / "frf.json").write_text("{}"),
        "frf.json: not looked into",
    ),
    "auto spectra of SDynPy": (npz({"data": SDYNPY, "function_type": 2}), "holds neither FRFs .* export FRFs"),
    "text: volts over N": (
        text(table(["f [Hz]", *(f"{t} [V/N]" for t in TITLES[1:])])),
        r'measurement.unit: the file states V/N, the volts of a sensor: .* unit = "V/N/\(100 mV/g\)"',
    ),
    "UFF: volts over N": (universal("V"), r"measurement.unit: the file states V/N, the volts of a sensor: .* unit ="),
    "text: two units": (mixed_units, r"the files state several units, g/N in 1 files, V/N in 1 files: .*correction"),
    "text: one time history alone": (history, "a.csv: holds one time history, and an FRF needs a force and a response"),
    "NumPy: one time history alone": (
        npz({"acc": np.sin(99 * TIME), "t": TIME}),
        "a.npz: holds one time history, and an FRF needs",
    ),
    "UFF: one time history alone": (
        universal(value=VALUE.real[:, :1], **{"function type": 1, "abscissa units label": "s"}),
        "a.uff: holds one time history, and an FRF needs",
    ),
    "UFF: auto spectra": (universal(**{"function type": 2}), "holds neither FRFs .* of kind other: spectra"),
    "UFF: spectra": (universal(**{"function type": 12}), "holds neither FRFs .* of kind other: spectra"),
    "text: auto spectra by the header": (
        spectra("AutoSpectrum of channel 2"),
        "tells of 'AutoSpectrum': spectra of one channel are no FRFs",
    ),
    "text: an auto spectrum with its unit": (
        spectra("Auto spectrum,m/s^2"),
        "tells of 'Auto spectrum': spectra of one channel are no FRFs",
    ),
    "text: a frequency spectrum by the header": (
        spectra("Type,FrequencySpectrum"),
        "tells of 'FrequencySpectrum': spectra of one channel are no FRFs",
    ),
    "text: spectral densities by the title": (
        text(table(["f [Hz]", "PSD Re", "PSD Im"], PARTS[:, :3])),
        "tells of 'PSD': spectra of one channel",
    ),
    "MATLAB: a frequency spectrum by the structure": (
        mat({"FrequencySpectrum": {"values": VALUE, "f": FREQUENCY}}),
        "'FrequencySpectrum.values' look like spectra; name the one that holds FRFs",
    ),
    "HDF5: auto powers by the group": (
        hdf5({"AutoPower/y": VALUE, "AutoPower/f": FREQUENCY}),
        "'AutoPower/y' look like spectra",
    ),
    "UFF: real numbers as FRFs": (
        universal(value=np.abs(VALUE)),
        "its values are real, and those of an FRF are complex: .* export complex FRFs",
    ),
    "NumPy: objects alone": (
        lambda folder: np.savez(folder / "a.npz", a=np.array(["x", None], dtype=object)),
        "a.npz: holds no arrays of numbers",
    ),
    "a workbook": (lambda folder: (folder / "a.xlsx").write_bytes(b"PK"), "a workbook: save its sheet as CSV"),
    "a file of one program": (lambda folder: (folder / "a.frf").write_bytes(b"x"), "export its FRFs as a universal"),
    "an unknown suffix": (
        lambda folder: (folder / "a.nc4").write_bytes(b"CDF"),
        "its suffix '.nc4' is none of a format",
    ),
    "a sound file": (lambda folder: (folder / "a.wav").write_bytes(b"RIFF"), "cannot be read as a WAV file"),
    "a matrix in MATLAB's file that is none": (
        lambda folder: (folder / "a.mat").write_bytes(b"no"),
        "cannot be read as a MATLAB file",
    ),
    "an empty universal file": (lambda folder: (folder / "a.uff").write_bytes(b""), r"a\.uff: "),
    "UFF: times in an unknown unit": (
        universal(**{"abscissa units label": "furlong"}),
        "'abscissa units label' is 'furlong'",
    ),
    "nothing": (lambda folder: None, "no file in it looks like a measurement; looked for"),
    "magnitudes alone in arrays": (
        mat({"f": FREQUENCY, "H_mag": np.abs(VALUE)}),
        "'H_mag' would be magnitudes or real parts, and their phases .* not in the file",
    ),
    "phases of ten to sixty, which may be rad or degrees": (
        mat({"f": FREQUENCY, "H_mag": np.abs(VALUE), "H_phase": DEGREES / 9}),
        "phase_unit: the phase reaches 20, which may be rad or degrees",
    ),
}


def fill(text, answers):
    answers = (
        *answers,
        ('unit = "?"', 'unit = "m/s2/N"'),
        ('output = ["?"]', f"output = {OUTPUTS}"),
        ('input = ["?"]', 'input = ["1+z"]'),
    )
    for before, after in answers:
        text = text.replace(before, after)
    return text


def read(folder, answers=()):
    """Return the functions that the drafted campaign file gives, and its text."""
    (folder / "points.csv").write_text("node,x,y,z\n1,0,0,0\n2,0.1,0,0\n3,0.2,0,0\n")
    text = draft_file(draft(folder)).text
    (folder / "campaign.toml").write_text(fill(text, answers), encoding="utf-8")
    return read_measurement(read_campaign(folder / "campaign.toml"), folder.name), text


@pytest.mark.parametrize("name", list(KINDS))
def test_a_file_is_read(tmp_path, name):
    kind = KINDS[name]
    kind.write(tmp_path)
    measured, text = read(tmp_path, kind.fill)
    frf = measured.frf
    assert frf.quantity == "accelerance"
    lines = slice(int(kind.zero), None)
    np.testing.assert_allclose(frf.frequency[lines], FREQUENCY, rtol=kind.rtol)
    np.testing.assert_allclose(frf.value[:, 0, lines].T, kind.scale * VALUE, rtol=kind.rtol, atol=1e-12)
    assert [frf.output.name(k) for k in range(3)] == ["1+z", "2+z", "3+z"]
    assert frf.input.name(0) == "1+z"
    assert kind.said in text


@pytest.mark.parametrize("name", list(REFUSED))
def test_a_file_is_refused_with_the_reason(tmp_path, name):
    write, reason = REFUSED[name]
    write(tmp_path)
    try:
        missing = draft_file(draft(tmp_path)).missing
    except CampaignError as error:
        missing = (str(error),)

    assert any(re.search(reason, line) for line in missing), missing


HEAD = """LabVIEW Measurement\t
Separator\tTab
Multi_Headings\tYes
X_Columns\t{columns}
Time\t14:18:17.000
***End_of_Header***

"""
SEGMENT = """Channels\t2
Samples\t{count}\t{count}
Time\t{clock}\t{clock}
Y_Unit_Label\tN\tm/s^2
X_Dimension\tTime\tTime
X0\t{start:E}\t{start:E}
Delta_X\t0.001\t0.001
***End_of_Header***
X_Value\tforce\tacc\tComment
"""
HAMMER = np.zeros(600)
HAMMER[5:9] = 1.0, 2.0, 2.0, 1.1


def labview(records, clocks, starts, *, times):
    """Return LabVIEW's text of records (force and acceleration), each a segment with its clock and its start."""
    parts = [HEAD.format(columns="One" if times else "No")]
    for record, clock, start in zip(records, clocks, starts, strict=True):
        rows = "".join(
            f"{start + k / 1000 if times else ''}\t{force:.17g}\t{acc:.17g}\t\n"
            for k, (force, acc) in enumerate(record.T)
        )
        parts.append(SEGMENT.format(count=record.shape[1], clock=clock, start=start) + rows + "\n\n")
    return "".join(parts)


def blow(scale):
    decay = np.exp(-0.02 * np.arange(600)) * np.sin(0.3 * np.arange(600))
    return scale * np.array([HAMMER, np.convolve(HAMMER, decay)[:600]])


def functions_of(folder, content):
    folder.mkdir()
    (folder / "a.lvm").write_text(content)
    answers = (('# output = ["12+z"]', 'output = ["2+z"]'), ('# input = ["12+z"]', 'input = ["1+z"]'))
    return read(folder, answers)


@pytest.mark.parametrize("times", [True, False])
def test_segments_of_labview_are_averaged(tmp_path, times):
    records = [blow(1.0), blow(1.2), blow(0.9)]
    content = labview(records, ["14:18:20.25", "14:18:25", "14:19:02"], [0.0] * 3, times=times)
    measured, drafted = functions_of(tmp_path / "three", content)
    alone, _ = functions_of(tmp_path / "one", labview(records[:1], ["14:18:20.25"], [0.0], times=times))
    assert "guessed: the 3 segments of the file are records that are averaged" in drafted
    assert any("3 segments" in note for note in measured.notes)
    np.testing.assert_allclose(measured.frf.value, alone.frf.value, rtol=1e-6)
    assert measured.frf.coherence is not None


@pytest.mark.parametrize("times", [True, False])
@pytest.mark.parametrize(
    ("clocks", "starts"), [(["14:18:20.25", "14:18:20.55"], [0.0, 0.0]), (["14:18:20.25"] * 2, [0.0, 0.3])]
)
def test_segments_of_one_record_are_joined(tmp_path, times, clocks, starts):
    record = blow(1.0)
    parts = [record[:, :300], record[:, 300:]]
    measured, _ = functions_of(tmp_path / "two", labview(parts, clocks, starts, times=times))
    whole, _ = functions_of(tmp_path / "one", labview([record], clocks[:1], [0.0], times=times))
    np.testing.assert_allclose(measured.frf.value, whole.frf.value, rtol=1e-9)


WITHOUT_POINTS = f"""
[campaign]
name = "t"
{{points}}
[measurement]
unit = "m/s2/N"
[measurement.table]
layout = "real-imaginary"
header_rows = 1
[[configuration]]
name = "A"
files = ["a.csv"]
output = {OUTPUTS}
input = "1+z"
[identification]
band_Hz = [30, 150]
order = 8
"""


def test_a_list_of_points_is_not_needed_to_identify_and_report(tmp_path, monkeypatch):
    text(table())(tmp_path)
    (tmp_path / "campaign.toml").write_text(WITHOUT_POINTS.format(points=""))
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(app, ["ema", "campaign.toml", "-o", "out"])
    assert done.exit_code == 0, done.output
    assert "no list of points" in " ".join(done.output.split())
    rows = (tmp_path / "out/A/modes.csv").read_text().splitlines()
    frequency = [float(row.split(",")[rows[0].split(",").index("frequency_Hz")]) for row in rows[1:]]
    np.testing.assert_allclose(frequency, POLES / (2 * np.pi), rtol=1e-6)
    assert not list(tmp_path.glob("out/A/shape_*.png"))
    done = CliRunner().invoke(app, ["report", "out"])
    assert done.exit_code == 0, done.output
    done = CliRunner().invoke(app, ["ema", "campaign.toml", "-o", "out"])  # what is there is used
    assert done.exit_code == 0, done.output


def test_a_fit_asks_for_the_list_of_points(tmp_path):
    text(table())(tmp_path)
    stack = '[structure]\nstack = "stack.toml"\n'
    (tmp_path / "campaign.toml").write_text(WITHOUT_POINTS.format(points=stack))
    with pytest.raises(FitError, match=r"a fit compares shapes .*file = \"points.csv\""):
        model_file(read_campaign(tmp_path / "campaign.toml"), "a fit")


def test_a_unit_of_no_points_is_refused(tmp_path):
    text(table())(tmp_path)
    (tmp_path / "campaign.toml").write_text(WITHOUT_POINTS.format(points='[points]\nunit = "mm"\n'))
    with pytest.raises(CampaignError, match="points: 'unit' and 'lines' are of the points that 'file' lists"):
        read_campaign(tmp_path / "campaign.toml")


SIGNS = [b'"', b",", b"\n", b"#", b"\x00", b"nan", b"inf", b"-", b"1e400", b"\xff\xfe", b";", b"\t", b" ", b"()", b"j"]


def damaged(rng, content):
    """Return bytes of which some are changed, taken away, repeated or put in."""
    spoiled = bytearray(content)
    for _ in range(rng.choice([1, 1, 2, 5, 20])):
        if not spoiled:
            break
        place = rng.randrange(min(len(spoiled), rng.choice([200, 2000, len(spoiled)])))
        match rng.randrange(5):
            case 0:
                spoiled[place] = rng.randrange(256)
            case 1:
                del spoiled[place : place + rng.choice([1, 3, 10, 100])]
            case 2:
                spoiled[place:place] = rng.choice([*SIGNS, b"***End_of_Header***\n"])
            case 3:
                del spoiled[place:]
            case _:
                other = rng.randrange(len(spoiled))
                spoiled[place : place + 20] = spoiled[other : other + 20]
    return bytes(spoiled)


@pytest.mark.parametrize("name", [*KINDS, *REFUSED])
def test_no_guess_crashes_on_damaged_files(tmp_path, name):
    """A first campaign file is drafted, or refused in words, whatever happened to the file."""
    write = KINDS[name].write if name in KINDS else REFUSED[name][0]
    (tmp_path / "whole").mkdir()
    write(tmp_path / "whole")
    rng = random.Random(name)
    for number in range(12):
        folder = tmp_path / str(number)
        folder.mkdir()
        for file in (tmp_path / "whole").iterdir():
            (folder / file.name).write_bytes(damaged(rng, file.read_bytes()))
        with contextlib.suppress(CampaignError, MeasurementError):
            draft_file(draft_modes(folder) or draft(folder))
