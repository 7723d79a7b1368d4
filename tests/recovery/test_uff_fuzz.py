"""Damaged files are read or refused with a message; no other exception, no hang, no unbounded memory."""

from pathlib import Path

import numpy as np
import pytest

from ema.errors import EmaError
from ema.frf import FRF
from ema.geometry import Dofs, Geometry
from ema.table import TableLayout, read_points, read_table
from ema.uff import read_uff_functions, read_uff_geometry, write_uff
from ema.units import parse_unit

FOLDER = Path(__file__).parents[2].parent / "shared/realdata/uff-oddities-pyuff"


def written(folder):
    """Return a small universal file of our own as bytes: units, local axes, points, lines and 58b."""
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
    write_uff(folder / "own.uff", geometry, frf)
    return (folder / "own.uff").read_bytes()


def damaged(data, rng):
    """Return the bytes with one to four of: bytes changed, a piece lost, a piece doubled, the end lost."""
    data = bytearray(data)
    for _ in range(rng.integers(1, 5)):
        kind = rng.integers(5)
        start = int(rng.integers(len(data)))
        length = int(rng.integers(1, 40))
        if kind == 0:
            data[start] = int(rng.integers(256))
        elif kind == 1:
            data[start : start + length] = b""
        elif kind == 2:
            data[start:start] = data[start : start + length]
        elif kind == 3:
            data[start : start + 1] = rng.choice([b"-1", b"9", b"0", b"nan", b"1e999", b"\n", b" "]).item()
        elif rng.random() < 0.2:
            data = data[: max(start, 10)]
        if len(data) < 10:
            break
    return bytes(data)


def survives(read, *arguments):
    try:
        read(*arguments)
    except EmaError as error:
        assert str(error)  # noqa: PT017  # any error of ours will do, but it has to say something


def sources(folder):
    files = {"own.uff": written(folder)}
    if FOLDER.exists():
        files |= {file.name: file.read_bytes() for file in FOLDER.glob("*.uff") if file.stat().st_size < 2e4}
    return files


@pytest.mark.parametrize("seed", range(3))
def test_universal_files(tmp_path, seed):
    rng = np.random.default_rng(seed)
    target = tmp_path / "damaged.uff"
    for data in sources(tmp_path).values():
        for _ in range(20):
            target.write_bytes(damaged(data, rng))
            survives(read_uff_functions, target)
            survives(read_uff_geometry, target)


def test_tables(tmp_path):
    rng = np.random.default_rng(0)
    rows = "\n".join(f"{f},{f / 3:.6g},{-f / 7:.4e}" for f in range(30)).encode()
    target = tmp_path / "damaged.csv"
    for _ in range(300):
        target.write_bytes(damaged(rows, rng))
        survives(read_table, target, TableLayout(layout="real-imaginary"), parse_unit("g/N"))
        survives(read_table, target, TableLayout(layout="complex"), parse_unit("g/N"))
        target.write_bytes(damaged(b"node,x,y,z\n1,2,3,4\n2,3,4,5\n", rng))
        survives(read_points, target, parse_unit("mm"))


def test_unit_labels():
    rng = np.random.default_rng(0)
    alphabet = list("mgNs/*()^2-1 ²µ%")
    for _ in range(3000):
        survives(parse_unit, "".join(rng.choice(alphabet, rng.integers(0, 12))))
