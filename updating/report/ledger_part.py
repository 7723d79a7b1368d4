"""What each physical effect does to the error, on data fitted and on data held out."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ema.plot import palette
from model import printed_effects
from updating.report.part import Picture, Section, Table, as_csv, svg
from updating.report.results import Results
from updating.results.ledger import Entry
from updating.results.text import interval_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_ERRORS = {
    "frequency": ("error", "mode_error", "configuration_error"),
    "damping": ("damping_error", "mode_damping_error", "configuration_damping_error"),
}
_NAMES = ("fitted", "mode held out", "configuration held out")
_APART = 3.0
"""Error of configurations held out, over that of modes held out, from which the page says what it is of."""
_SHADES = (palette.USED, palette.LEFT_OUT, palette.ELSEWHERE)


def ledger_section(results: Results) -> Section:
    """Show the error before and after each effect."""
    entries = results.ledger
    return Section(
        title="Error before and after each effect",
        text=(_sentence(entries),),
        blocks=(ledger_picture(entries), error_table(entries), fit_table(entries)),
    )


def error_table(entries: Sequence[Entry]) -> Table:
    """List the errors of each model, of frequencies and, where they took part, of damping ratios."""
    kinds = _kinds(entries)
    return Table(
        title="Mean error [%]",
        header=("model", *(f"{kind}, {name}" for kind in kinds for name in _NAMES)),
        rows=tuple(
            (
                model_name(e),
                *("" if np.isnan(x) else f"{100 * x:.2f}" for kind in kinds for x in _errors(e, kind)),
            )
            for e in entries
        ),
        note="Error after eq. (2), with one G_f and one d_f for all torques of a stack. Held out: each mode predicted "
        "by a fit to all others, and each configuration by a fit to the other configurations; empty where those do "
        "not determine it.",
    )


def fit_table(entries: Sequence[Entry]) -> Table:
    """List misfit and parameters of each model."""
    return Table(
        title="Fits and their parameters",
        header=("model", "chi-square", "differences", "parameters"),
        rows=tuple(
            (
                model_name(e),
                "" if np.isnan(e.chi_square) else f"{e.chi_square:.4g}",
                str(e.n_residual),
                "; ".join([*(interval_text(p) for p in e.shared), *e.strained]),
            )
            for e in entries
        ),
        note="Chi-square: sum of all squared differences over their variances, empty where these are not known; a "
        "right model's is at most about their number. What would have to be far from what is known of it says how the "
        "model could meet these data by that alone.",
    )


def ledger_picture(entries: Sequence[Entry]) -> Picture:
    """Draw the errors of each model."""
    kinds = _kinds(entries)
    return Picture(
        name="error_ledger",
        content=svg(ledger_figure(entries)),
        form="svg",
        data=as_csv(
            ("model", *(f"{kind} error, {name} [1]" for kind in kinds for name in _NAMES)),
            (
                (" + ".join(("base", *e.effects)), *(x for kind in kinds for x in _errors(e, kind)))
                for e in entries
            ),
        ),
        alt="Errors by model",
        caption=f"Mean {' and '.join(kinds)} error of each model, on the data that it was fitted to and on data held "
        "out.",
    )


def ledger_figure(entries: Sequence[Entry]) -> Figure:
    """Draw the errors of each model, on data fitted and held out, as bars."""
    from matplotlib.figure import Figure

    kinds = _kinds(entries)
    names = [
        "\n+ ".join(textwrap.fill(part, 36) for part in ("base", *printed_effects(e.effects)))
        for e in entries
    ]
    each = max(0.62, 0.1 + 0.16 * max(name.count("\n") + 1 for name in names))
    figure = Figure(figsize=(8.5, 1.1 + each * len(entries)), layout="constrained")
    panels: list[Axes] = list(figure.subplots(1, len(kinds), sharey=True, squeeze=False)[0])
    y = np.arange(len(entries))
    for axes, kind in zip(panels, kinds, strict=True):
        for k, (name, shade) in enumerate(zip(_NAMES, _SHADES, strict=True)):
            value = 100.0 * np.array([_errors(e, kind)[k] for e in entries])
            bars = axes.barh(
                y + 0.26 * (k - 1), value, 0.24, color=shade, edgecolor=palette.INK, linewidth=0.5, label=name
            )
            axes.bar_label(bars, ["" if np.isnan(v) else f"{v:.2f}" for v in value], padding=3, fontsize=8)
        axes.margins(x=0.16)
        axes.set_xlabel(f"mean {kind} error [%]")
        axes.spines[["top", "right"]].set_visible(False)
    panels[0].set_yticks(y, names)
    panels[0].invert_yaxis()
    figure.legend(
        *panels[0].get_legend_handles_labels(), loc="outside upper right", ncols=3, frameon=False, fontsize=9
    )
    return figure


def model_name(entry: Entry) -> str:
    """Return the effects of a line of the ledger as one name, each with its label."""
    return " + ".join(("base", *printed_effects(entry.effects)))


def _kinds(entries: Sequence[Entry]) -> tuple[str, ...]:
    return ("frequency", "damping") if any(np.isfinite(e.damping_error) for e in entries) else ("frequency",)


def _errors(entry: Entry, kind: str) -> tuple[float, ...]:
    return tuple(getattr(entry, name) for name in _ERRORS[kind])


def _sentence(entries: Sequence[Entry]) -> str:
    base, best = entries[0], min(entries[1:], key=lambda e: e.mode_error, default=entries[0])
    if best is base:
        return f"The base model's frequencies are off by {100 * base.error:.2f} % on average."
    names = " and ".join(printed_effects(best.effects))
    apart = best.configuration_error > _APART * best.mode_error
    return (
        f"With {names} the mean frequency error goes from {100 * base.error:.2f} % to "
        f"{100 * best.error:.2f} % on the data fitted, and from {100 * base.mode_error:.2f} % to "
        f"{100 * best.mode_error:.2f} % on modes held out."
        + (
            f" Of a configuration held out {100 * best.configuration_error:.2g} % is left: its contact was given "
            "the stiffness that the others foretell for its pressure, and reassembly, or a law of pressure that is not "
            "the model's, makes it another. So well does one torque predict the next."
            if apart
            else ""
        )
    )
