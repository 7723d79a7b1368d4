"""Sections of a campaign that was given as a table of modes: all rows at a glance, and each by itself."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ema.plot import palette
from updating.fitting.modal_table import TableFit
from updating.report.part import Picture, Section, Table, anchor, as_csv, svg
from updating.report.results import Results
from updating.results.text import estimate_text, parameter_text

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_PUBLISHED, _OURS = palette.QUIET, palette.BASE


def table_overview(results: Results) -> Section:
    """List all rows, each leading to its section, over a figure of error and contact stiffness."""
    fits = results.table
    table = Table(
        title="Natural frequencies [Hz]: measured | published model | ours",
        header=(
            "stack", *results.shape_class, "error published [%]", "error ours [%]", "G_f published [Pa/Pa]",
            "G_f ours [Pa/Pa]",
        ),
        rows=tuple(
            (
                f.row.name,
                *(
                    f"{a:.0f} | {b:.0f} | {c:.0f}"
                    for a, b, c in zip(f.row.frequency, f.row.published_frequency, f.frequency, strict=True)
                ),
                f"{100 * f.published_error:.1f}",
                f"{100 * f.error:.1f}",
                "" if np.isnan(f.row.published_G_f) else f"{f.row.published_G_f:.0f}",
                estimate_text(f.G_f),
            )
            for f in fits
        ),
        note="Error: mean over the modes of the relative frequency error. ± is half of the 95 % interval and contains "
        "the scatter that the model leaves. A click on a heading sorts, one on a stack leads to it.",
        link=tuple(f"#{anchor(_title(f))}" for f in fits),
    )  # fmt: skip
    picture = Picture(
        name="all_stacks",
        content=svg(table_figure(fits)),
        form="svg",
        data=as_csv(
            (
                "stack",
                "error published [1]",
                "error ours [1]",
                "G_f published [Pa/Pa]",
                "G_f ours [Pa/Pa]",
                "its std",
            ),
            (
                (f.row.name, f.published_error, f.error, f.row.published_G_f, f.G_f.value, f.G_f.std)
                for f in fits
            ),
        ),
        alt="Error and contact stiffness by stack",
        caption="Mean relative frequency error, and contact stiffness with one standard deviation, of each stack.",
    )
    text = (
        "G_f is fitted to the measured frequencies of each stack by opt_G; modes are paired by shape class."
    )
    return Section(title="All stacks", text=(text,), blocks=(table, picture))


def row_section(fit: TableFit, shape_class: tuple[str, ...]) -> Section:
    """Show one row: its modes measured, published and ours."""
    row = fit.row
    error, published = ((f - row.frequency) / row.frequency for f in (fit.frequency, row.published_frequency))
    table = Table(
        title="",
        header=("mode", "measured [Hz]", "published [Hz]", "its error [%]", "ours [Hz]", "our error [%]"),
        rows=tuple(
            (name, f"{a:.0f}", f"{b:.0f}", f"{100 * e:+.1f}", f"{c:.1f}", f"{100 * d:+.1f}")
            for name, a, b, e, c, d in zip(
                shape_class,
                row.frequency,
                row.published_frequency,
                published,
                fit.frequency,
                error,
                strict=True,
            )
        ),
        note=f"{parameter_text(fit.G_f)}, mean error {100 * fit.error:.1f} % (published: "
        f"{100 * fit.published_error:.1f} %). Error is (model - measured) / measured.",
    )
    picture = Picture(
        name=f"stack_{row.name}",
        content=svg(row_figure(fit, shape_class)),
        form="svg",
        data=as_csv(
            ("mode", "measured [Hz]", "published [Hz]", "ours [Hz]"),
            zip(shape_class, row.frequency, row.published_frequency, fit.frequency, strict=True),
        ),
        alt=f"Errors of stack {row.name} by mode",
        caption="Frequency error by mode.",
        width="half",
    )
    return Section(title=_title(fit), blocks=(table, picture))


def table_figure(fits: tuple[TableFit, ...]) -> Figure:
    """Draw the error of eq. (2) and G_f by stack, ours beside the published."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 5.0), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True)
    at = np.arange(len(fits))
    above.bar(at - 0.2, [100 * f.published_error for f in fits], 0.38, color=_PUBLISHED, label="published")
    above.bar(at + 0.2, [100 * f.error for f in fits], 0.38, color=_OURS, label="ours")
    above.set_ylabel("mean frequency error [%]")
    below.errorbar(
        at, [f.G_f.value for f in fits], [f.G_f.std for f in fits], fmt="o", color=_OURS, capsize=3
    )
    below.plot(
        at, [f.row.published_G_f for f in fits], "s", color=_PUBLISHED, markerfacecolor="none", markersize=8
    )
    below.set_xticks(at, [f.row.name for f in fits])
    below.set(xlabel="stack", ylabel="$G_f$ [Pa/Pa]")
    figure.legend(loc="outside upper right", ncols=2, frameon=False)
    return figure


def row_figure(fit: TableFit, shape_class: tuple[str, ...]) -> Figure:
    """Draw the frequency error of every mode, ours beside the published."""
    from matplotlib.figure import Figure

    row = fit.row
    figure = Figure(figsize=(5.5, 2.4), layout="constrained")
    axes = figure.subplots()
    at = np.arange(len(shape_class))
    for shift, f, color, name in (
        (-0.2, row.published_frequency, _PUBLISHED, "published"), (0.2, fit.frequency, _OURS, "ours"),
    ):  # fmt: skip
        axes.bar(at + shift, 100.0 * (f / row.frequency - 1.0), 0.38, color=color, label=name)
    axes.axhline(0.0, color=palette.INK, linewidth=0.8)
    axes.set_xticks(at, shape_class)
    axes.set_ylabel("frequency error [%]")
    axes.spines[["top", "right"]].set_visible(False)
    figure.legend(loc="outside upper right", ncols=2, frameon=False, fontsize="small")
    return figure


def _title(fit: TableFit) -> str:
    return f"Stack {fit.row.name}"
