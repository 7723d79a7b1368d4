"""The published campaign reproduced: results, tables and pictures in a folder."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path

from rich.console import Console

from ema.plot.figures import as_png
from tests.studies.published.campaign import Calibrated, Published, read_published, reproduce
from tests.studies.published.tables import (
    contact_figure,
    error_figure,
    fall_figure,
    law_figure,
    parameters_csv,
    pattern_figure,
    table_6_csv,
    table_7_csv,
    treatment_figure,
)
from tests.studies.published.treatments import treated, treatments_csv
from updating.results.store import kept, write_bytes
from updating.workers.workers import in_parallel


def reproduce_campaign(
    folder: Path, calibrations: Sequence[str], effects: Sequence[str], output: Path, console: Console
) -> tuple[Calibrated, ...]:
    """Reproduce the published campaign, go beyond it, and write results, tables and pictures.

    Calibrations that an earlier run left are read back.
    """
    data = read_published(folder.absolute())
    task = partial(_calibrated, data, tuple(effects), output.absolute())
    results = tuple(in_parallel(task, calibrations, "calibrations", console))
    for name, content in (
        ("table_6.csv", table_6_csv(results)),
        ("table_7.csv", table_7_csv(results)),
        ("parameters.csv", parameters_csv(results)),
        ("figure_12.png", as_png(contact_figure(results, data))),
        ("figures_13_to_15.png", as_png(treatment_figure(results, data))),
        ("figure_16.png", as_png(error_figure(results))),
        ("error_fall.png", as_png(fall_figure(results))),
        ("error_pattern.png", as_png(pattern_figure(results))),
        ("pressure_law.png", as_png(law_figure(results))),
    ):
        write_bytes(output / name, content)
    changed = treated(data, results[0])
    write_bytes(output / "treatments.csv", treatments_csv(changed))
    console.print(f"What treatments change, under {results[0].calibration}, with intervals of 95 %:")
    for treatment in changed:
        console.print(f"  {treatment.sentence}", markup=False, highlight=False)
    return results


def _calibrated(data: Published, effects: tuple[str, ...], output: Path, calibration: str) -> Calibrated:
    path, options = output / f"{calibration}.json", {"effects": list(effects)}
    inputs = (*data.table.inputs, data.folder / f"stack_{calibration}.toml")
    make = partial(reproduce, data, calibration, effects)
    return kept(path, Calibrated, make, inputs=inputs, options=options)
