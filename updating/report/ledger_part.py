"""What each physical effect does to the error, on data fitted and on data held out."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from updating.ledger import Entry
from updating.report.part import Picture, Section, Table, as_csv, svg
from updating.report.results import Results

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_KINDS = ("error", "mode_error", "configuration_error")
_NAMES = ("fitted", "mode held out", "configuration held out")
_SHADES = ("#1f5f8b", "#7fa8c4", "#cfdde8")  # dark to light: they differ in grey as well


def ledger_section(results: Results) -> Section:
    """Show the error before and after each effect."""
    entries = results.ledger
    table = Table(
        title="Mean frequency error [%]",
        header=("model", *_NAMES, "chi-square", "differences", "parameters"),
        rows=tuple(
            (
                model_name(e),
                *("" if np.isnan(x) else f"{100 * x:.2f}" for x in _errors(e)),
                f"{e.chi_square:.4g}",
                str(e.n_residual),
                "; ".join(
                    f"{p.name} = {p.value:.4g} ± {p.std:.2g}{'' if p.unit == '1' else ' ' + p.unit}"
                    + (" (at its bound)" if p.at_bound else "" if p.determined else " (not determined)")
                    for p in e.shared
                ),
            )
            for e in entries
        ),
        note="Error after eq. (2). Held out: each mode predicted by a fit without it, and each configuration with the "
        "effects' parameters fitted to the others. Chi-square: sum of all squared differences over their variances; a "
        "right model's is about their number. ± is one standard deviation.",
    )
    picture = Picture(
        name="error_ledger",
        content=svg(ledger_figure(entries)),
        form="svg",
        data=as_csv(
            ("model", *(f"{n} error [1]" for n in _NAMES)),
            ((model_name(e), *_errors(e)) for e in entries),
        ),
        alt="Frequency error by model",
        caption="Mean frequency error of each model, on the data that it was fitted to and on data held out.",
    )
    return Section(
        title="Error before and after each effect", text=(_sentence(entries),), blocks=(picture, table)
    )


def ledger_figure(entries: Sequence[Entry]) -> Figure:
    """Draw the errors of each model, on data fitted and held out, as bars."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.5, 1.1 + 0.62 * len(entries)), layout="constrained")
    axes = figure.subplots()
    y = np.arange(len(entries))
    for k, (name, shade) in enumerate(zip(_NAMES, _SHADES, strict=True)):
        value = 100.0 * np.array([_errors(e)[k] for e in entries])
        bars = axes.barh(
            y + 0.26 * (k - 1), value, 0.24, color=shade, edgecolor="#33414f", linewidth=0.5, label=name
        )
        axes.bar_label(bars, ["" if np.isnan(v) else f"{v:.2f}" for v in value], padding=3, fontsize=8)
    axes.set_yticks(y, [model_name(e) for e in entries])
    axes.invert_yaxis()
    axes.margins(x=0.1)
    axes.set_xlabel("mean frequency error, eq. (2) [%]")
    axes.spines[["top", "right"]].set_visible(False)
    figure.legend(loc="outside upper right", ncols=3, frameon=False, fontsize=9)
    return figure


def model_name(entry: Entry) -> str:
    """Return the effects of a line of the ledger as one name."""
    return " + ".join(("base", *entry.effects))


def _errors(entry: Entry) -> tuple[float, ...]:
    return tuple(getattr(entry, name) for name in _KINDS)


def _sentence(entries: Sequence[Entry]) -> str:
    base, best = entries[0], min(entries[1:], key=lambda e: e.mode_error, default=entries[0])
    if best is base:
        return f"The base model's frequencies are off by {100 * base.error:.2f} % on average."
    return (
        f"With {' and '.join(best.effects)} the mean frequency error goes from {100 * base.error:.2f} % to "
        f"{100 * best.error:.2f} % on the data fitted, and from {100 * base.mode_error:.2f} % to "
        f"{100 * best.mode_error:.2f} % on modes held out."
    )
