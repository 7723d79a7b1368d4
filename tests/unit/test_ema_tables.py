"""The tables that `lamella ema` prints keep their names and numbers in a file or pipe, which has no width."""

import io

import numpy as np
from rich.console import Console

from ema import Comparison
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
    for name, own in zip(names, frequency, strict=True):
        mine = " ".join(row for row in rows if name in row)
        assert all(f"{f:.1f}  1.00" in mine for f in own)
