"""The report page of a campaign that was given as a table of modes."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from updating.modal_table import TableFit
from updating.report.section import ReportTable, Section, vector
from updating.store import folder_name, read_document, read_result

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def read_table_fits(folder: Path) -> tuple[TableFit, ...]:
    """Read the fitted rows of a results folder in the order of the table, leaving out those not done yet."""
    names = [row["name"] for row in read_document(folder / "modal_table.json")["result"]["rows"]]
    files = [folder / f"stack_{folder_name(name)}" / "fit.json" for name in names]
    return tuple(read_result(file, TableFit) for file in files if file.exists())


def table_summary(fits: tuple[TableFit, ...]) -> str:
    """Say in two sentences how the fits stand beside the published ones."""
    error, published = (
        100 * np.mean([getattr(f, name) for f in fits]) for name in ("error", "published_error")
    )
    misfit = 100 * np.mean([f.model_misfit for f in fits])
    return (
        f"{len(fits)} configurations fitted. The model's natural frequencies differ from the measured ones by "
        f"{error:.1f} % on average (published: {published:.1f} %). Fitted to the published model's frequencies "
        f"instead, it meets them to {misfit:.1f} %."
    )


def table_section(fits: tuple[TableFit, ...], shape_class: tuple[str, ...]) -> Section:
    """Show measured, published and our frequencies, errors and contact stiffness, row by row."""
    rows = tuple(
        (
            f.row.name,
            *(
                f"{a:.0f} | {b:.0f} | {c:.0f}"
                for a, b, c in zip(f.row.frequency, f.row.published_frequency, f.frequency, strict=True)
            ),
            f"{100 * f.published_error:.1f}",
            f"{100 * f.error:.1f}",
            "" if np.isnan(f.row.published_G_f) else f"{f.row.published_G_f:.0f}",
            f"{f.G_f.value:.0f} ± {f.G_f.std:.0f}",
        )
        for f in fits
    )
    table = ReportTable(
        title="Natural frequencies [Hz]: measured | published model | ours",
        header=(
            "stack",
            *shape_class,
            "error published [%]",
            "error ours [%]",
            "G_f published [Pa/Pa]",
            "G_f ours [Pa/Pa]",
        ),
        rows=rows,
        note="Error after eq. (2). ± is one standard deviation and contains the scatter that the model leaves.",
    )
    return Section(
        name="All stacks",
        summary="G_f is fitted to the measured frequencies of each stack by opt_G; modes are paired by shape class.",
        tables=(table,),
        figures=(
            vector(
                table_figure(fits),
                alt="Error and contact stiffness by stack",
                caption="Mean relative frequency error and contact stiffness of each stack, ours and published.",
                width="full",
            ),
        ),
    )


def table_figure(fits: tuple[TableFit, ...]) -> Figure:
    """Draw the error of eq. (2) and G_f by stack, ours beside the published."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 5.0), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True)
    at = np.arange(len(fits))
    above.bar(at - 0.2, [100 * f.published_error for f in fits], 0.38, color="0.7", label="published")
    above.bar(at + 0.2, [100 * f.error for f in fits], 0.38, color="#1f5f8b", label="ours")
    above.set_ylabel("error, eq. (2) [%]")
    above.legend(loc="upper right", ncols=2, frameon=False)
    above.margins(y=0.2)
    below.errorbar(
        at, [f.G_f.value for f in fits], [f.G_f.std for f in fits], fmt="o", color="#1f5f8b", capsize=3
    )
    below.plot(
        at, [f.row.published_G_f for f in fits], "s", color="0.5", markerfacecolor="none", markersize=8
    )
    below.set_xticks(at, [f.row.name for f in fits])
    below.set(xlabel="stack", ylabel="$G_f$ [Pa/Pa]")
    return figure
