"""What `lamella fit --effect` and `lamella published` do with files."""

from __future__ import annotations

import csv
import dataclasses
import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from ema import Identification
from updating.fit import Fit
from updating.ledger import Entry, ledger
from updating.modal_table import TableFit, read_modal_table
from updating.plot import as_png
from updating.prepared import prepare
from updating.published import SCATTER, Calibrated, read_published, reproduce
from updating.published_plot import contact_figure, error_figure, fall_figure, law_figure, pattern_figure
from updating.published_tables import parameters_csv, table_6_csv, table_7_csv
from updating.store import write_bytes, write_result
from updating.target import target_of_modes, target_of_table


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True)
class Ledger:
    """The ledger as it is written."""

    entry: tuple[Entry, ...]


def campaign_ledger(
    fits: Sequence[tuple[Identification, Fit]], effects: Sequence[str], campaign: Path, output: Path
) -> tuple[Entry, ...]:
    """Fit effects that all configurations of a campaign share, and write ledger.json and ledger.csv."""
    targets = [
        target_of_modes(fitted.stack.with_effects(*effects), found.modal_model) for found, fitted in fits
    ]
    entries = ledger(prepare(targets), effects)
    _write_ledger(entries, effects, (campaign,), output)
    return entries


def table_ledger(
    fits: Sequence[TableFit], effects: Sequence[str], campaign: Path, output: Path
) -> tuple[Entry, ...]:
    """Fit effects that all rows of a modal table share, and write ledger.json and ledger.csv."""
    table = read_modal_table(campaign)
    targets = [
        target_of_table(
            fit.row.stack.with_effects(*effects), table.shape_class, fit.row.frequency, name=fit.row.name
        )
        for fit in fits
    ]
    entries = ledger(prepare(targets), effects, damping=False, scatter=SCATTER)
    _write_ledger(entries, effects, table.inputs, output)
    return entries


def ledger_table(entries: Sequence[Entry]) -> Table:
    """Print what each effect does to the error, on data used and held out."""
    table = Table(
        title="Mean frequency error [%], eq. (2)",
        title_justify="left",
        caption="Held out: each mode predicted by a fit without it; each configuration with the effects' parameters of "
        "the others.",
        caption_justify="left",
    )
    table.add_column("model")
    for name in ("fitted", "mode\nheld out", "configuration\nheld out", "chi-square"):
        table.add_column(name, justify="right")
    table.add_column("parameters")
    for entry in entries:
        errors = (entry.error, entry.mode_error, entry.configuration_error)
        table.add_row(
            " + ".join(("base", *entry.effects)),
            *("-" if np.isnan(e) else f"{100 * e:.2f}" for e in errors),
            f"{entry.chi_square:.4g} of {entry.n_residual}",
            "\n".join(
                f"{p.name} = {p.value:.4g} ± {p.std:.2g} {p.unit}"
                + (" (at its bound)" if p.at_bound else "" if p.determined else " (not determined)")
                for p in entry.shared
            ),
        )
    return table


def published(
    folder: Path, calibrations: Sequence[str], effects: Sequence[str], output: Path, console: Console
) -> tuple[Calibrated, ...]:
    """Reproduce the published campaign, go beyond it, and write results, tables and pictures."""
    data = read_published(folder)
    found = []
    for calibration in calibrations:
        with console.status(f"calibration {calibration}"):
            one = reproduce(data, calibration, effects)
        inputs = (*data.table.inputs, folder / f"stack_{calibration}.toml")
        write_result(output / f"{calibration}.json", one, inputs=inputs, options={"effects": list(effects)})
        found.append(one)
    for name, content in (
        ("table_6.csv", table_6_csv(found)),
        ("table_7.csv", table_7_csv(found)),
        ("parameters.csv", parameters_csv(found)),
        ("figures_12_to_15.png", as_png(contact_figure(found))),
        ("figure_16.png", as_png(error_figure(found))),
        ("error_fall.png", as_png(fall_figure(found))),
        ("error_pattern.png", as_png(pattern_figure(found))),
        ("pressure_law.png", as_png(law_figure(found))),
    ):
        write_bytes(output / name, content)
    return tuple(found)


def _write_ledger(
    entries: tuple[Entry, ...], effects: Sequence[str], inputs: tuple[Path, ...], output: Path
) -> None:
    write_result(
        output / "ledger.json", Ledger(entry=entries), inputs=inputs, options={"effects": list(effects)}
    )
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(
        ["model", "error", "mode_held_out_error", "configuration_held_out_error", "chi_square", "n_residual"]
    )
    for e in entries:
        writer.writerow(
            [
                " + ".join(("base", *e.effects)),
                e.error,
                e.mode_error,
                e.configuration_error,
                e.chi_square,
                e.n_residual,
            ]
        )
    write_bytes(output / "ledger.csv", text.getvalue().encode())
