"""Modes as other programs export them: titles, units and layouts of tables, and what universal files leave open."""

import numpy as np
import pytest
from scipy.io import savemat

import ema
from ema.campaign.draft import draft
from ema.campaign.draft_file import draft_file, draft_modes
from ema.types.errors import CampaignError

FREQUENCY, DAMPING = np.array([101.25, 207.5, 333.0]), np.array([0.004, 0.006, 0.011])
RNG = np.random.default_rng(7)
SHAPE = RNG.standard_normal((4, 3)) + 0.1j * RNG.standard_normal((4, 3))
DOFS = ["1+z", "2+z", "3+z", "4+z"]
POINTS = "node,x,y,z\n1,0,0,0\n2,100,0,0\n3,0,100,0\n4,100,100,0\n"


def table(head, rows, separator=",", decimal="."):
    def cell(value):
        return value if isinstance(value, str) else f"{value:.8g}".replace(".", decimal)

    return "\n".join(separator.join(map(cell, row)) for row in [head, *rows]) + "\n"


def of_modes(frequency, damping, *, title="Frequency (Hz)", of_damping="Damping [%]", **form):
    rows = zip(frequency, damping, SHAPE.real.T, strict=True)
    return table(["Mode", title, of_damping, *DOFS], [["1", f, d, *s] for f, d, s in rows], **form)


def read(folder, **files):
    """Write files, draft a campaign as a user does, and read its modes."""
    (folder / "points.csv").write_text(POINTS)
    for name, text in files.items():
        (folder / (f"{name}.csv" if "," in text or ";" in text else f"{name}.uff")).write_text(text)
    (folder / "campaign.toml").write_text(draft_file(draft_modes(folder)).text)
    campaign = ema.read_campaign(folder / "campaign.toml")
    return ema.read_modes(campaign, campaign.configurations[0].name)


def right(found, shape=SHAPE):
    model = found.modal_model
    np.testing.assert_allclose(model.frequency, FREQUENCY, rtol=1e-6)
    np.testing.assert_allclose(model.damping, DAMPING, rtol=1e-4)
    assert model.node.tolist() == [1, 2, 3, 4]
    np.testing.assert_allclose(model.direction, np.tile([0.0, 0.0, 1.0], (4, 1)))
    mac = np.abs(np.sum(model.shape.conj() * shape, axis=0)) ** 2
    norm = np.sum(np.abs(model.shape) ** 2, axis=0) * np.sum(np.abs(shape) ** 2, axis=0)
    np.testing.assert_allclose(mac / norm, 1.0, rtol=1e-6)


@pytest.mark.parametrize(
    "text",
    [
        of_modes(FREQUENCY, 100 * DAMPING),
        of_modes(FREQUENCY, DAMPING, of_damping="Damping ratio", separator=";", decimal=","),
        of_modes(2 * np.pi * FREQUENCY, DAMPING, title="omega_n [rad/s]", of_damping="zeta [-]"),
        of_modes(FREQUENCY / 1e3, 2 * DAMPING, title="fn [kHz]", of_damping="Loss factor"),
        of_modes(FREQUENCY, FREQUENCY * DAMPING / np.sqrt(1 - DAMPING**2), of_damping="Damping (Hz)"),
        table(["", "Mode 1", "Mode 2", "Mode 3"], [
            ["Frequency (Hz)", *FREQUENCY], ["Damping (%)", *(100 * DAMPING)],
            *([dof, *s] for dof, s in zip(DOFS, SHAPE.real, strict=True))]),
    ],
)  # fmt: skip
def test_titles_units_and_layouts_of_one_table(tmp_path, text):
    right(read(tmp_path, modes=text), SHAPE.real)


def test_a_damping_without_a_unit_is_told(tmp_path):
    found = read(tmp_path, modes=of_modes(FREQUENCY, 100 * DAMPING, of_damping="Damp"))
    right(found, SHAPE.real)
    assert any("'damp' says no unit; its numbers are taken in per cent" in note for note in found.notes)


@pytest.mark.parametrize("layout", ["point", "parts", "polar"])
def test_shapes_in_rows_of_degrees_of_freedom(tmp_path, layout):
    modes = table(
        ["Mode", "Freq. [Hz]", "Damping [%]"], [["1", f, 100 * d] for f, d in zip(FREQUENCY, DAMPING, strict=True)]
    )
    head, rows = ["Point", "Direction", "Mode 1", "Mode 2", "Mode 3"], []
    for n, s in enumerate(SHAPE, start=1):
        parts = np.column_stack([s.real, s.imag])
        if layout == "point":
            rows.append([str(n), "Z", *s.real])
            continue
        if layout == "polar":
            parts = np.column_stack([np.abs(s), np.degrees(np.angle(s))])
        rows.append([f"{n}Z+", *parts.ravel()])
    if layout != "point":
        kinds = ("Real", "Imag") if layout == "parts" else ("Magnitude", "Phase (deg)")
        head = ["DOF", *(f"Mode {r} {kind}" for r in (1, 2, 3) for kind in kinds)]
    found = read(tmp_path, modes=modes, shapes=table(head, rows))
    right(found, SHAPE.real if layout == "point" else SHAPE)


def test_a_table_of_frfs_is_none_of_modes(tmp_path):
    rows = [[f, *np.column_stack([SHAPE[:, 0].real, SHAPE[:, 0].imag]).ravel()] for f in np.arange(1.0, 41.0)]
    head = ["Frequency (Hz)", *(f"{dof} {part}" for dof in DOFS for part in ("real", "imag"))]
    (tmp_path / "frf.csv").write_text(table(head, rows))
    assert draft_modes(tmp_path) is None


def data_set_55(mode, analysis, form, reals, shape, title="NONE"):
    values = [[0.0, 0.0, s.real] if form == 2 else [0.0, 0.0, 0.0, 0.0, s.real, s.imag] for s in shape]
    whole = (1, analysis, 2, 8, form, 3), (2, len(reals), 0, mode)
    lines = ["    -1", "    55", "ARTeMIS Modal", "NONE", title, "NONE", "NONE"]
    lines += ["".join(f"{n:10d}" for n in row) for row in whole]
    lines.append("".join(f"{real:13.5E}" for real in reals))
    for n, row in enumerate(values, start=1):
        lines += [f"{n:10d}", "".join(f"{value:13.5E}" for value in row)]
    return "".join(f"{line:<80}\r\n" for line in [*lines, "    -1"])


def test_damping_in_per_cent_in_a_universal_file_is_told(tmp_path):
    sets = [data_set_55(r + 1, 2, 2, [FREQUENCY[r], 1.0, 100 * DAMPING[r], 0.0], SHAPE[:, r].real) for r in range(3)]
    found = read(tmp_path, modes="".join(sets))
    np.testing.assert_allclose(found.modal_model.damping, DAMPING, rtol=1e-4)
    assert any("is taken in per cent" in note for note in found.notes)


def test_modes_of_negative_frequencies_alone_are_turned(tmp_path):
    pole = 2 * np.pi * FREQUENCY * (-DAMPING - 1j * np.sqrt(1 - DAMPING**2))
    sets = [data_set_55(r + 1, 3, 5, [pole[r].real, pole[r].imag, 0, 0, 0, 0], SHAPE[:, r].conj()) for r in range(3)]
    model = read(tmp_path, modes="".join(sets)).modal_model
    np.testing.assert_allclose(model.frequency, FREQUENCY, rtol=1e-4)
    np.testing.assert_allclose(model.shape / model.shape[0], SHAPE / SHAPE[0], rtol=1e-4)


@pytest.mark.parametrize("unit", [1.0, 2 * np.pi])
def test_eigenvalues_that_titles_state_in_hertz(tmp_path, unit):
    pole = unit * FREQUENCY * (-DAMPING + 1j * np.sqrt(1 - DAMPING**2))
    titles = [f"f={f:.5E}Hz z={100 * z:.5E}%" for f, z in zip(FREQUENCY, DAMPING, strict=True)]
    sets = [
        data_set_55(r + 1, 3, 5, [pole[r].real, pole[r].imag, 0, 0, 0, 0], SHAPE[:, r], titles[r]) for r in range(3)
    ]
    found = read(tmp_path, modes="".join(sets))
    np.testing.assert_allclose(found.modal_model.frequency, FREQUENCY, rtol=1e-4)
    np.testing.assert_allclose(found.modal_model.damping, DAMPING, rtol=1e-3)
    assert any("taken in Hz" in note for note in found.notes) == (unit == 1.0)


def test_damping_that_is_unusual_is_asked_about(tmp_path):
    found = read(tmp_path, modes=of_modes(FREQUENCY, [0.2, 0.2, 0.2], of_damping="Damping ratio"))
    assert any("above 20 %" in note for note in found.notes)


def test_modes_in_matlab_are_named_with_what_is_read(tmp_path):
    savemat(tmp_path / "modes.mat", {"fn": FREQUENCY, "dr": DAMPING, "ms": SHAPE})
    with pytest.raises(CampaignError, match=r"holds modes \('fn', 'ms'\), and no points: write them as a table"):
        draft(tmp_path)
