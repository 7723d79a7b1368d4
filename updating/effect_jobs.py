"""What `lamella fit --effect` and `lamella published` do with files."""

from __future__ import annotations

import csv
import dataclasses
import io
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from model import catalogue
from updating.fit import Fit
from updating.identified import Identified
from updating.joint_fit import FittedParameter
from updating.ledger import Entry, ledger
from updating.modal_table import TableFit, read_modal_table
from updating.plot import as_png
from updating.prepared import prepare
from updating.published import SCATTER, Calibrated, Published, read_published, reproduce
from updating.published_plot import (
    contact_figure,
    error_figure,
    fall_figure,
    law_figure,
    pattern_figure,
    treatment_figure,
)
from updating.published_screening import Screening, screen
from updating.published_tables import parameters_csv, screening_csv, table_6_csv, table_7_csv
from updating.sensitivity import Scatter
from updating.store import kept, write_bytes, write_result
from updating.target import specimen_name, target_of_modes, target_of_table
from updating.workers import in_parallel, workers

TORQUE_SCATTER = Scatter(pressure=0.03)
"""Of a campaign with FRFs: pressures repeat to some percent from one assembly to the next."""


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True)
class Ledger:
    """The ledger as it is written."""

    entry: tuple[Entry, ...]


def campaign_ledger(
    fits: Sequence[tuple[Identified, Fit]],
    effects: Sequence[str],
    campaign: Path,
    output: Path,
    cluster: str | None = None,
) -> tuple[Entry, ...]:
    """Fit effects that all configurations of a campaign share, and write ledger.json and ledger.csv.

    Configurations of one height are one stack, with one G_f and one d_f for all its torques.
    """
    heights = {fitted.stack.height for _, fitted in fits}
    targets = [
        target_of_modes(
            fitted.stack.with_effects(*effects),
            found.modal_model,
            specimen=specimen_name(fitted.stack.name, fitted.stack.height, heights),
        )
        for found, fitted in fits
    ]
    with workers(1 + len(effects), cluster) as executor:
        entries = ledger(prepare(targets), effects, scatter=TORQUE_SCATTER, executor=executor)
    write_ledger(entries, {"effects": list(effects)}, (campaign,), output)
    return entries


def table_ledger(
    fits: Sequence[TableFit],
    effects: Sequence[str],
    campaign: Path,
    output: Path,
    cluster: str | None = None,
) -> tuple[Entry, ...]:
    """Fit effects that all rows of a modal table share, and write ledger.json and ledger.csv."""
    table = read_modal_table(campaign)
    targets = [
        target_of_table(
            fit.row.stack.with_effects(*effects), table.shape_class, fit.row.frequency, name=fit.row.name
        )
        for fit in fits
    ]
    with workers(1 + len(effects), cluster) as executor:
        entries = ledger(prepare(targets), effects, damping=False, scatter=SCATTER, executor=executor)
    write_ledger(entries, {"effects": list(effects)}, table.inputs, output)
    return entries


def ledger_table(entries: Sequence[Entry]) -> Table:
    """Print what each effect does to the error, on data used and held out."""
    damping = any(np.isfinite(e.damping_error) for e in entries)
    unknown = any(np.isnan(e.configuration_error) and np.isfinite(e.error) for e in entries)
    table = Table(
        title="Mean error [%], eq. (2), of frequencies" + (" | of damping ratios" if damping else ""),
        title_justify="left",
        caption="Held out: each mode predicted by a fit to all other modes; each configuration by a fit to the others."
        + (" -: those do not determine it." if unknown else ""),
        caption_justify="left",
    )
    table.add_column("model", overflow="fold")
    for name in ("fitted", "mode\nheld out", "config.\nheld out"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("parameters", overflow="fold")
    for e in entries:
        pairs = (
            (e.error, e.damping_error),
            (e.mode_error, e.mode_damping_error),
            (e.configuration_error, e.configuration_damping_error),
        )
        table.add_row(
            "\n+ ".join(("base", *e.effects)),
            *(" | ".join(_percent(v) for v in pair[: 1 + damping]) for pair in pairs),
            "\n".join([*(_estimate(p) for p in e.shared), *(_pressure(p) for p in e.pressure)]),
        )
    return table


def _estimate(p: FittedParameter) -> str:
    unit = "" if p.unit == "1" else f" {p.unit}"
    doubt = " (at its bound)" if p.at_bound else "" if p.determined else " (not determined)"
    return f"{p.name} = {p.value:.4g} ± {p.std:.2g}{unit}{doubt}"


def _pressure(p: FittedParameter) -> str:
    nominal = np.sqrt(p.lower * p.upper)
    return f"{p.group}: {p.value / 1e3:.0f} kPa for {nominal / 1e3:.0f}"


def _percent(value: float) -> str:
    return "-" if np.isnan(value) else f"{100 * value:.2f}"


def published(
    folder: Path,
    calibrations: Sequence[str],
    effects: Sequence[str],
    output: Path,
    console: Console,
    cluster: str | None = None,
) -> tuple[Calibrated, ...]:
    """Reproduce the published campaign, go beyond it, and write results, tables and pictures.

    Calibrations that an earlier run left are read back.
    """
    data = read_published(folder.absolute())
    task = partial(_calibrated, data, tuple(effects), output.absolute())
    found = tuple(in_parallel(task, calibrations, "calibrations", console, cluster))
    for name, content in (
        ("table_6.csv", table_6_csv(found)),
        ("table_7.csv", table_7_csv(found)),
        ("parameters.csv", parameters_csv(found)),
        ("figure_12.png", as_png(contact_figure(found, data))),
        ("figures_13_to_15.png", as_png(treatment_figure(found, data))),
        ("figure_16.png", as_png(error_figure(found))),
        ("error_fall.png", as_png(fall_figure(found))),
        ("error_pattern.png", as_png(pattern_figure(found))),
        ("pressure_law.png", as_png(law_figure(found))),
    ):
        write_bytes(output / name, content)
    return found


def _calibrated(data: Published, effects: tuple[str, ...], output: Path, calibration: str) -> Calibrated:
    path, options = output / f"{calibration}.json", {"effects": list(effects)}
    inputs = (*data.table.inputs, data.folder / f"stack_{calibration}.toml")
    make = partial(reproduce, data, calibration, effects)
    return kept(path, Calibrated, make, inputs=inputs, options=options)


def screen_published(
    folder: Path,
    calibrations: Sequence[str],
    minutes: float,
    output: Path,
    console: Console,
    cluster: str | None = None,
) -> tuple[Screening, ...]:
    """Try all effects of the catalogue, and the most promising pairs, on the published campaign.

    Calibrations that an earlier run left are read back.
    """
    task = partial(_screened, read_published(folder.absolute()), minutes, output.absolute())
    found = tuple(in_parallel(task, calibrations, "effects one by one, then pairs", console, cluster))
    write_bytes(output / "screening.csv", screening_csv(found))
    return found


def _screened(data: Published, minutes: float, output: Path, calibration: str) -> Screening:
    path, options = output / f"screening_{calibration}.json", {"minutes": minutes}
    inputs = (*data.table.inputs, data.folder / f"stack_{calibration}.toml")
    make = partial(screen, data, calibration, list(catalogue()), seconds=60.0 * minutes)
    return kept(path, Screening, make, inputs=inputs, options=options)


def write_ledger(
    entries: tuple[Entry, ...], options: Mapping[str, object], inputs: tuple[Path, ...], output: Path
) -> None:
    """Write ledger.json and ledger.csv."""
    write_result(output / "ledger.json", Ledger(entry=entries), inputs=inputs, options=options)
    columns = [
        "error", "mode_error", "configuration_error", "damping_error", "mode_damping_error",
        "configuration_damping_error", "chi_square", "n_residual",
    ]  # fmt: skip
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["model", *columns])
    writer.writerows([" + ".join(("base", *e.effects)), *(getattr(e, c) for c in columns)] for e in entries)
    write_bytes(output / "ledger.csv", text.getvalue().encode())
