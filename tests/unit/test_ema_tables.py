"""The tables that `lamella ema` prints keep their names and numbers in a file or pipe, which has no width."""

import io

import numpy as np
from rich.console import Console

from ema import Comparison
from ema.types.modal_model import frequency_text
from updating.commands.ema import comparison_tables


def test_ten_configurations_of_many_modes_keep_their_names_and_cells():
    names = tuple(f"M{k} at {2.5 * k} N m" for k in range(1, 11))
    frequency = 100.0 * np.arange(1, 15) + np.arange(10)[:, None]
    one = np.ones_like(frequency)
    comparison = Comparison(
        name=names, frequency=frequency, frequency_std=one, damping=0.01 * one, damping_std=one, mac=one
    )
    console = Console(file=io.StringIO(), width=100)
    for table in comparison_tables(comparison, console.width):
        console.print(table)
    text = console.file.getvalue()
    assert "…" not in text
    rows = [line for line in text.splitlines() if any(name in line for name in names)]
    assert len(rows) == 3 * len(names)
    for name, each in zip(names, frequency, strict=True):
        mine = " ".join(row for row in rows if name in row)
        assert all(f"{f:.1f}  1.00" in mine for f in each)


def test_modes_below_one_hertz_are_told_apart():
    """Towers and long bridges have several modes within 0.01 Hz; those of small parts keep their digits."""
    assert frequency_text(1452.36, 1) == "1452.4"
    assert frequency_text(12.345, 0) == "12"
    assert frequency_text(0.10287, 0) == "0.10"
    assert frequency_text(0.10287, 3) == "0.10287"
    assert frequency_text(3.14159, 1) == "3.14"
    assert [frequency_text(f, 1) for f in (0.0, np.nan)] == ["0.0", "nan"]
    one = np.ones((2, 2))
    comparison = Comparison(
        name=("A", "B"), frequency=one * [0.1029, 0.1062], frequency_std=1e-6 * one, damping=0.01 * one,
        damping_std=one, mac=one,
    )  # fmt: skip
    console = Console(file=io.StringIO(), width=100)
    console.print(*comparison_tables(comparison, console.width))
    assert {"0.103", "0.106"} <= set(console.file.getvalue().split())
