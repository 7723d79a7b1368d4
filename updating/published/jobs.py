"""What `lamella published` does with files: each calibration as soon as it is done, then tables and pictures."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path

from rich.console import Console

from model import catalogue
from updating.fitting.fit_plot import as_png
from updating.published.campaign import Calibrated, Published, read_published, reproduce
from updating.published.plot import (
    contact_figure,
    error_figure,
    fall_figure,
    law_figure,
    pattern_figure,
    treatment_figure,
)
from updating.published.screening import Screening, screen
from updating.published.tables import parameters_csv, screening_csv, table_6_csv, table_7_csv
from updating.results.store import kept, write_bytes
from updating.workers.workers import in_parallel


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
