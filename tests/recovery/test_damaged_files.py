"""Damaged files are read or refused with a message; no other exception, no hang, no unbounded memory.

    pytest tests/recovery/test_damaged_files.py -m benchmark -s

reads far more of them and says how many were refused and how long the slowest took.
"""

import contextlib
import os
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from ema.io.measured_function import parse_unit
from ema.types.errors import EmaError
from tests.recovery.damaged_readers import READERS, UNIVERSAL, write_files

REAL = Path(__file__).parents[2].parent / "shared/realdata"
COUNTS = [10, pytest.param(600, marks=pytest.mark.benchmark)]
SLOW = {"run of a campaign", "modes of a specimen", "shapes of a specimen"}


@pytest.fixture
def data(tmp_path):
    """All files that are read, the shipped ones by links."""
    write_files(tmp_path, os.symlink)
    return tmp_path


@pytest.mark.parametrize("count", COUNTS)
@pytest.mark.parametrize("reader", list(READERS))
def test_every_reader(data, survives, damage, reader, count, copied):
    read, name, errors = READERS[reader]
    file = data / name
    read(file)  # whole it is no error
    many = count // 5 if reader in SLOW else count if file.is_symlink() else 3 * count
    survives(read, copied(file) if file.is_symlink() else file, errors, damage(file, many))


EXTREMES = [b"0", b"-1", b"1000000", b"2147483648", b"1e300", b"1e-300", b"nan", b"inf", b"9" * 25]


@pytest.mark.parametrize(
    "reader",
    ["campaign", "stack", "stack with a curve and an outline", "update file", "virtual test", "modal table's campaign"],
)
def test_every_number_of_a_file(data, survives, reader, copied):
    """Each in turn is made as small, large or odd as it can be."""
    read, name, errors = READERS[reader]
    file = copied(data / name)
    content = file.read_bytes()
    if reader == "campaign":  # point numbers of trace lines: too many of one kind
        content = re.sub(rb"lines = .*", b"lines = [[1, 5]]", content)
    numbers = [m.span() for m in re.finditer(rb"(?<![\w\".])[-+]?\d[\d.eE+-]*", content)]
    inputs = [content[:start] + odd + content[stop:] for start, stop in numbers for odd in EXTREMES]
    survives(read, file, errors, inputs)


@pytest.mark.parametrize("count", COUNTS)
@pytest.mark.parametrize("file", sorted(REAL.glob("uff-oddities-pyuff/*.uff")), ids=lambda file: file.stem)
def test_universal_files_of_other_programs(tmp_path, survives, damage, file, count):
    if file.stat().st_size > 1e5:
        pytest.skip("large")
    other = Path(shutil.copy(file, tmp_path / "other.uff"))
    survives(UNIVERSAL, other, EmaError, damage(other, count))


def test_unit_labels():
    rng = np.random.default_rng(0)
    alphabet = list("mgNs/*()^2-1 ²µ%")
    for _ in range(3000):
        with contextlib.suppress(EmaError):
            parse_unit("".join(rng.choice(alphabet, rng.integers(0, 12))))
