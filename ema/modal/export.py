"""A modal model for other programs: universal file with modes and synthesised FRFs, and tables as CSV."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ema.io.files import whole
from ema.io.uff import write_uff
from ema.modal.complexity import complexity
from ema.types.arrays import frozen
from ema.types.errors import MeasurementError
from ema.types.frf import FRF, Quantity
from ema.types.geometry import Dofs
from ema.types.modal_model import ModalModel, synthesize


def synthesized_frf(modal_model: ModalModel, step: float, quantity: Quantity) -> FRF:
    """Synthesise the FRFs of a modal model over its band.

    Parameters
    ----------
    modal_model : ModalModel
    step : float
        Line spacing, Hz.
    quantity : {"receptance", "mobility", "accelerance"}
    """
    lower, upper = modal_model.band
    n_line = int(np.floor((upper - lower) / step + 1e-9)) + 1
    frequency = np.linspace(lower, lower + step * (n_line - 1), n_line)
    n_output = modal_model.node.size
    return FRF(
        frequency=frequency,
        value=frozen(synthesize(modal_model, frequency, quantity)),  # large
        quantity=quantity,
        output=Dofs(node=modal_model.node, direction=modal_model.direction),
        input=modal_model.input,
        run=np.zeros(n_output, dtype=np.int64),
        source=("synthesised",) * n_output,
    )


def write_modes_uff(path: Path, modal_model: ModalModel, step: float) -> None:
    """Write points, modes (55) and FRFs synthesised in steps of `step` Hz (58b) to a universal file.

    Raises
    ------
    MeasurementError
        A direction is not along an axis of its point, so that the format cannot hold it.
    """
    write_uff(
        path, modal_model.geometry, synthesized_frf(modal_model, step, modal_model.quantity), modal_model
    )


def write_modes_csv(path: Path, modal_model: ModalModel) -> None:
    """Write a row for each mode: frequency, damping, their standard deviations, scale, and how complex its shape is."""
    rows = zip(
        modal_model.frequency,
        modal_model.frequency_std,
        modal_model.damping,
        modal_model.damping_std,
        strict=True,
    )
    header = (
        "mode", "frequency_Hz", "frequency_std_Hz", "damping", "damping_std", "mass_normalised", "MPC", "MPD_deg",
        "MCF", "phase_scatter_deg", "too_complex",
    )  # fmt: skip
    scaled = ["yes" if s else "no" for s in modal_model.scaled]
    own = complexity(modal_model)
    measures = zip(own.mpc, own.mpd, own.mcf, own.phase_scatter, strict=True)
    words = ["yes" if c else "no" for c in own.is_complex]
    table = [
        (r + 1, *map(repr, map(float, row)), scaled[r], *(f"{value:.6g}" for value in measure), words[r])
        for r, (row, measure) in enumerate(zip(rows, measures, strict=True))
    ]
    _write_rows(path, header, table)


def write_shapes_csv(path: Path, modal_model: ModalModel) -> None:
    """Write a row for each DOF: point, direction, then real and imaginary part of each mode's shape there."""
    header = ["node", "x", "y", "z"]
    for r in range(1, modal_model.frequency.size + 1):
        header += [f"mode_{r}_real", f"mode_{r}_imag"]
    rows = [
        (
            int(node),
            *map(float, direction),
            *(part for value in shape for part in (float(value.real), float(value.imag))),
        )
        for node, direction, shape in zip(
            modal_model.node, modal_model.direction, modal_model.shape, strict=True
        )
    ]
    _write_rows(path, header, rows)


def _write_rows(path: Path, header: list[str] | tuple[str, ...], rows: Sequence[tuple[object, ...]]) -> None:
    with whole(path, MeasurementError) as part, part.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(header)
        writer.writerows(rows)
