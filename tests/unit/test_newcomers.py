"""Small files as newcomers bring them: each is drafted and read with the right numbers, or refused with the reason.

Each kind stands for an export that somebody has, or for a report in the trackers of other readers. All hold the same
functions of a structure with two modes, so that one check is enough: what is read after `lamella new`, with its "?"
filled in, are these functions.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np
import pytest
from scipy.io import savemat

from ema.campaign.campaign import read_campaign
from ema.campaign.draft import draft
from ema.campaign.draft_file import draft_file
from ema.campaign.measurement import read_measurement
from ema.types.errors import CampaignError

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
    for own, ends in zip(array["coordinate"], dofs, strict=True):
        for end, dof in zip(own, ends, strict=True):
            end["node"], end["direction"] = dof
    return array


SDYNPY = sdynpy_array(FREQUENCY, VALUE.T, [[(n, 3), (1, 3)] for n in (1, 2, 3)])
SPLIT = {
    f"{what}{k + 1}": part[:, k]
    for k in range(3)
    for what, part in (("mag", np.abs(VALUE)), ("phase", DEGREES))
}
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
        hdf5(
            {"f": FREQUENCY, "amp": DECIBEL, "phi": np.angle(VALUE) + 20 * np.pi}, {"amp": "dB", "phi": "rad"}
        )
    ),
    "NumPy: functions of SDynPy": Kind(npz({"data": SDYNPY, "function_type": 4})),
    "NumPy: functions of SDynPy, a matrix of them, by numpy.savez": Kind(npz({"frfs": SDYNPY.reshape(3, 1)})),
    "NumPy: functions of SDynPy, by numpy.save": Kind(lambda folder: np.save(folder / "a.npy", SDYNPY)),
}
REFUSED: dict[str, tuple[Write, str]] = {
    "auto spectra of SDynPy": (
        npz({"data": SDYNPY, "function_type": 2}),
        "holds neither FRFs .* export FRFs",
    ),
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
    np.testing.assert_allclose(frf.frequency, FREQUENCY, rtol=kind.rtol)
    np.testing.assert_allclose(frf.value[:, 0].T, VALUE, rtol=kind.rtol, atol=1e-12)
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
