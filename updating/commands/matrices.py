"""What commands do with a structure file in place of a stack file: its modes, and fits of its stated terms."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from ema import ModalModel
from ema.types.modal_model import frequency_text
from model import MatricesError, read_matrices, reduce_matrices
from model.matrices.structure_file import matrices_inputs
from updating.commands.terminal import bar
from updating.correlation.correlation import correlate
from updating.diagnosis.matrices_answer import MatricesFit, fit_matrices, modes_at
from updating.results.identified import Assignment, Identified, identified
from updating.results.store import kept, write_result
from updating.results.text import Z95, quantity


def identify_and_fit_matrices(
    file: Path, threshold: float, assigned: Assignment
) -> tuple[Identified, MatricesFit]:
    """Identify a configuration and fit the stated terms of a structure to it; what an earlier run left is read back."""
    found = identified(assigned)
    inputs = (assigned.campaign.path, *matrices_inputs(file), found.folder / "modal_model.json")

    def make() -> MatricesFit:
        return fit_matrices(read_matrices(file), found.modal_model, threshold=threshold)

    path, options = found.folder / "fit.json", {"threshold": threshold}
    return found, kept(path, MatricesFit, make, inputs=inputs, options=options, keep=assigned.keep)


def solve_matrices(file: Path, output: Path, n_mode: int, console: Console) -> Table:
    """Solve the modes of a structure, write them, say what the file and the reduction leave out, and list them.

    Raises
    ------
    MatricesError
        It has fewer modes than are asked for.
    """
    with bar(console) as progress:
        task = progress.add_task("read, reduce and solve", total=3)
        structure = read_matrices(file)
        progress.advance(task)
        reduced = reduce_matrices(structure)
        progress.advance(task)
        frequency = reduced.solve()[0]
        elastic = frequency[frequency > 1e-3 * structure.band_Hz]
        inside = elastic[elastic <= structure.band_Hz][:n_mode]
        if not inside.size:
            message = f"{file}: no mode below reduction.band_Hz = {structure.band_Hz:g}; raise it"
            raise MatricesError(message)
        none = np.zeros((0, inside.size))
        modes = modes_at(inside, np.zeros(inside.size), none, np.zeros(0, dtype=np.int64), np.zeros((0, 3)))
        write_result(output / "modes.json", modes, inputs=matrices_inputs(file), options={"n_mode": n_mode})
        progress.advance(task)
    for note in structure.notes:
        console.print(f"  {note}", markup=False, highlight=False, soft_wrap=True)
    table = Table(
        title=f"{structure.name}: {inside.size} elastic modes up to {structure.band_Hz:g} Hz",
        title_justify="left",
        caption=f"{frequency.size - elastic.size} modes of a rigid body. {structure.node.size} degrees of freedom were "
        f"reduced to {reduced.size}; that leaves at most {100 * reduced.left.frequency['nominal']:.2g} % of a "
        f"frequency, and {100 * max(reduced.left.frequency.values()):.2g} % one prior deviation of a term away.",
        caption_justify="left",
    )
    table.add_column("mode", justify="right")
    table.add_column("f [Hz]", justify="right")
    for r, f in enumerate(inside, start=1):
        table.add_row(str(r), f"{f:.4f}")
    return table


def matrices_fit_table(measured: ModalModel, fit: MatricesFit) -> Table:
    """Put measured beside fitted modes, with the MAC before, and what was fitted below."""
    pairs = correlate(measured, fit.modes, fit.pairing)
    moved = [
        f"{own.label} {quantity(own.value, own.unit)} ± {quantity(Z95 * own.std, own.unit, own.value)}"
        f" (stated {own.stated:g})"
        for own in fit.moved
        if not own.name.startswith("gain")
    ]
    left_over = [frequency_text(f, 1) for f in measured.frequency[fit.pairing.unpaired_measured]]
    caption = (
        f"mean frequency error {100 * fit.error:.2f} % ({100 * fit.initial_error:.2f} % before), of "
        f"{fit.pairing.measured.size} of {measured.frequency.size} measured modes\n"
        + "\n".join(moved)
        + (f"\nmeasured but not paired: {', '.join(left_over)} Hz" if left_over else "")
    )
    table = Table(
        title=f"{fit.name}: measured and fitted",
        title_justify="left",
        caption=caption,
        caption_justify="left",
    )
    for name in ("mode", "measured\n[Hz]", "model\n[Hz]", "error\n[%]", "MAC\nbefore", "MAC"):
        table.add_column(name, justify="right")
    columns = (
        pairs.measured_frequency, pairs.model_frequency, pairs.frequency_error, fit.initial_mac, pairs.mac
    )  # fmt: skip
    for mode, (f_exp, f_num, error, before, mac) in zip(
        fit.pairing.measured, zip(*columns, strict=True), strict=True
    ):
        table.add_row(
            str(mode + 1),
            f"{f_exp:.2f}",
            f"{f_num:.2f}",
            f"{100 * error:+.2f}",
            f"{before:.4f}",
            f"{mac:.4f}",
        )
    return table
