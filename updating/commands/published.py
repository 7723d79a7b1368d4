"""`lamella published`: reproduce the published campaign and go beyond it."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path

from rich.console import Console

from ema.plot.figures import as_png
from ema.types.threads import single_threaded
from model import catalogue, find_effects
from updating.commands.shipped import shipped_data
from updating.commands.terminal import OUT
from updating.published.campaign import CALIBRATIONS, Calibrated, Published, read_published, reproduce
from updating.published.plot import (
    contact_figure,
    error_figure,
    fall_figure,
    law_figure,
    pattern_figure,
    treatment_figure,
)
from updating.published.tables import (
    parameters_csv,
    summary_table,
    table_6_csv,
    table_7_csv,
)
from updating.published.treatments import treated, treatments_csv
from updating.results.store import kept, write_bytes
from updating.workers.workers import in_parallel


@single_threaded
def published_command(
    output: Path,
    calibration: Sequence[str] | None,
    effect: Sequence[str],
    data: Path | None,
    cluster: str | None,
) -> None:
    """Reproduce the published campaign, and print how far it is off."""
    find_effects(effect, catalogue())
    calibrations = calibration or list(CALIBRATIONS)
    tables = shipped_data("pirnat2013") if data is None else data
    OUT.print(
        summary_table(
            reproduce_campaign(tables, calibrations, effect or ["clamp_inertia"], output, OUT, cluster)
        )
    )
    OUT.print(f"Results in {output}")


def reproduce_campaign(
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
    changed = treated(data, found[0])
    write_bytes(output / "treatments.csv", treatments_csv(changed))
    console.print(f"What treatments change, under {found[0].calibration}, with intervals of 95 %:")
    for own in changed:
        console.print(f"  {own.sentence}", markup=False, highlight=False)
    return found


def _calibrated(data: Published, effects: tuple[str, ...], output: Path, calibration: str) -> Calibrated:
    path, options = output / f"{calibration}.json", {"effects": list(effects)}
    inputs = (*data.table.inputs, data.folder / f"stack_{calibration}.toml")
    make = partial(reproduce, data, calibration, effects)
    return kept(path, Calibrated, make, inputs=inputs, options=options)
