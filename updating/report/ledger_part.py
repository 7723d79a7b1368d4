"""How effects change the error, their parameters, and the error that each would leave in the data."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ema.plot import palette
from lamella_shared import csv_text
from model import printed_effects
from updating.diagnosis.answer import Diagnosis, ModeError
from updating.fitting.fit import Estimate
from updating.report.part import Chart, Picture, Section, axis, charted
from updating.report.results import Results, Tested
from updating.results.ledger import Entry
from updating.results.text import Z95, Table, abscissa, ends, in_percent, interval_text, percent, uncertain

_ERRORS = {
    "frequency": ("error", "mode_error", "configuration_error"),
    "damping": ("damping_error", "mode_damping_error", "configuration_damping_error"),
}

_NAMES = ("fitted", "mode held out", "configuration held out")

APART = 3.0
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
            (model_name(e), *("" if np.isnan(x) else in_percent(x) for kind in kinds for x in _errors(e, kind)))
            for e in entries
        ),
        note="Error: mean of |measured - model| / measured, with one G_f and one d_f for all torques of a stack. "
        "Held out: each mode predicted by a fit to all others, and each configuration by a fit to the other "
        "configurations; empty where those do not determine it.",
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
                "; ".join([*(interval_text(p) for p in e.shared), *e.pulled]),
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
    return charted(
        "error_ledger",
        ledger_chart(entries),
        alt="Errors by model",
        caption=f"Mean {' and '.join(kinds)} error of each model, on the data that it was fitted to and on data held "
        "out.",
    )


def ledger_chart(entries: Sequence[Entry]) -> Chart:
    """Return the errors of each model as bars, those of damping ratios below those of frequencies."""
    line = 20  # px of each of its lines
    gap = 0.14  # of the height of a chart, between two axes for the title of the upper one
    kinds = _kinds(entries)
    names = [_short_name(entry) for entry in entries]
    entry_height = max(70, line * max(name.count("<br>") + 1 for name in names))
    traces, layout = [], {}
    for row, kind in enumerate(kinds, start=1):
        place = "" if row == 1 else str(row)
        for k, (name, shade) in enumerate(zip(_NAMES, _SHADES, strict=True)):
            value = [100.0 * _errors(e, kind)[k] for e in entries]
            traces.append(
                {
                    "type": "bar", "orientation": "h", "name": name, "legendgroup": name, "showlegend": row == 1,
                    "x": value, "y": names, "xaxis": f"x{place}", "yaxis": f"y{place}", "offsetgroup": name,
                    "text": ["" if np.isnan(v) else in_percent(0.01 * v) for v in value], "textposition": "outside",
                    "cliponaxis": False, "marker": {"color": shade},
                    "hovertemplate": "%{x:.3g} %<extra>" + name + "</extra>",
                }
            )  # fmt: skip
        low, high = 1.0 - row / len(kinds), 1.0 - (row - 1) / len(kinds)
        widest = 100.0 * float(np.nanmax([_errors(e, kind) for e in entries]))
        layout[f"xaxis{place}"] = axis(f"mean {kind} error [%]", anchor=f"y{place}", range=[0.0, 1.2 * widest])
        domain = [low + (gap if row < len(kinds) else 0.0), high]
        layout[f"yaxis{place}"] = {
            "autorange": "reversed", "automargin": True, "domain": domain, "anchor": f"x{place}", "showgrid": False,
        }  # fmt: skip
    height = 120 + len(kinds) * (entry_height * len(entries) + 40)
    return Chart(traces=traces, layout={**layout, "height": height})


def _short_name(entry: Entry) -> str:
    """Return the effects of a line by their labels, in lines that leave a phone room for the bars."""
    wide = 16  # characters of a model's name beside its bars
    names = ("base model", *(f"+ {label.partition(' (')[0]}" for label in printed_effects(entry.effects)))
    return "<br>".join(line for name in names for line in textwrap.wrap(name, wide))


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
        return f"The base model's frequencies are off by {percent(base.error)} on average."
    names = " and ".join(printed_effects(best.effects))
    apart = best.configuration_error > APART * best.mode_error
    return (
        f"With {names} the mean frequency error goes from {percent(base.error)} to {percent(best.error)} on the data "
        f"fitted, and from {percent(base.mode_error)} to {percent(best.mode_error)} on modes held out."
        + (
            f" Of a configuration held out {percent(best.configuration_error)} is left: its contact was given "
            "the stiffness that the others predict for its pressure, and reassembly, or a law of pressure other than "
            "the model's, changes that. This is how well one torque predicts the next."
            if apart
            else ""
        )
    )


def parameter_section(results: Results) -> Section:
    """Show contact stiffness and damping of all configurations, and the effects' parameters."""
    fitted = [t for t in results.tested if t.opt is not None]
    pictures = (parameter_picture(fitted),) if len(fitted) > 1 else ()
    return Section(title="Parameters", text=_law(fitted), blocks=(*pictures, interval_table(results)))


def interval_table(results: Results) -> Table:
    """List all parameters with intervals: of each configuration alone, and of each model of the ledger."""
    rows = []
    for t in results.tested:
        for e in _estimates(t):
            half, remark = Z95 * e.std, "at its bound" if e.at_bound else ""
            interval = () if e.at_bound else (e.value - half, e.value + half)
            rows.append((f"{t.name}, opt_{e.name[0]}", *_cells(e.name, e.unit, e.value, interval), remark))
    for t in results.tested:
        if (fit := t.matrices_fit) is None:
            continue
        for moved in fit.moved:
            half, remark = Z95 * moved.std, "at its bound" if moved.name in fit.at_bound else ""
            interval = (moved.value - half, moved.value + half)
            rows.append((t.name, *_cells(moved.label, moved.unit, moved.value, interval), remark))
    for entry in results.ledger:
        for p in entry.shared:
            interval = () if p.at_bound else (p.lower, p.upper)
            rows.append((f"all, {model_name(entry)}", *_cells(p.name, p.unit, p.value, interval), p.remark))
    table = Table(
        title="Parameters with 95 % intervals",
        header=("fitted to", "parameter", "unit", "value", "lower", "upper", "remark"),
        rows=tuple(rows),
        note="opt_G and opt_d fit G_f and d_f of the base model to one configuration; an answer has its own "
        "numbers, for all configurations together. Intervals contain the scatter that the model leaves unexplained; "
        "they mean nothing at a bound.",
    )
    return table.without_empty_columns()


def _cells(name: str, unit: str, value: float, interval: Sequence[float]) -> tuple[str, ...]:
    """Return a parameter with its unit, value and the ends of its interval; these are empty where it has none."""
    shown = ends(value, interval[0], interval[1]) if interval else (f"{value:.4g}", "", "")
    return name, "" if unit == "1" else unit, *shown


def parameter_picture(fitted: Sequence[Tested]) -> Picture:
    """Draw G_f and d_f over torque or pressure with their 95 % intervals."""
    return charted(
        "parameters",
        parameter_chart(fitted),
        alt="Contact parameters by configuration",
        caption="G_f by opt_G and d_f by opt_d of each configuration alone, with 95 % intervals.",
    )


def parameter_chart(fitted: Sequence[Tested]) -> Chart:
    """Return G_f above d_f over torque, pressure or their number, with 95 % intervals, to be read off."""
    at, label = abscissa(fitted)
    traces = [
        {
            "type": "scatter", "mode": "markers", "x": at.tolist(), "y": [_estimates(t)[k].value for t in fitted],
            "error_y": {"type": "data", "array": [Z95 * _estimates(t)[k].std for t in fitted]},
            "text": [t.name for t in fitted], "yaxis": f"y{'' if k == 0 else 2}", "showlegend": False,
            "marker": {"color": palette.BASE, "size": 8}, "hovertemplate": "%{text}: %{y:.4g}<extra></extra>",
        }
        for k in (0, 1)
    ]  # fmt: skip
    layout = {
        "xaxis": axis(label, anchor="y2"),
        "yaxis": axis("G_f [Pa/Pa]", domain=[0.56, 1.0], rangemode="tozero"),
        "yaxis2": axis("d_f [s/Pa]", domain=[0.0, 0.44], rangemode="tozero", exponentformat="e"),
    }
    return Chart(traces=traces, layout=layout)


def _estimates(tested: Tested) -> tuple[Estimate, ...]:
    return () if tested.opt is None else (tested.opt.G_f, tested.opt.d_f)


def _law(fitted: Sequence[Tested]) -> tuple[str, ...]:
    """Say how contact stiffness G_f p grows with pressure, where there are two pressures at least."""
    known = [(t.opt.G_f, t.pressure) for t in fitted if t.opt is not None and t.pressure is not None]
    pressure = np.array([p for _, p in known])
    if np.unique(pressure).size < 2:
        return ()
    x = np.log(pressure) - np.mean(np.log(pressure))
    stiffness = np.log([e.value for e, _ in known]) + np.log(pressure)
    slope = float(x @ stiffness / (x @ x))
    std = float(np.sqrt(np.sum((x * [e.std / e.value for e, _ in known]) ** 2)) / (x @ x))
    return (
        f"Contact stiffness G_f p grows with pressure p as p to the power {slope:.3f} ± {Z95 * std:.2g} (95 %); the "
        "base model takes it as proportional, a power of 1.",
    )


_MARKS = (
    (palette.SERIES[0], "circle", 12), (palette.SERIES[1], "square", 9), (palette.SERIES[2], "triangle-up", 8),
    (palette.INK, "diamond", 6),
)  # fmt: skip
"""Colour, marker and its size (px) of each effect of a chart: smaller ones later, so that none hides another."""

_MOST = len(_MARKS)
"""Effects that one figure can show and still be read."""


def signature_section(diagnosis: Diagnosis) -> Section:
    """Show what the base model lacks at every mode, and what the best effects, each alone, change there."""
    return Section(
        title="Effect signatures",
        text=(
            "The bars are what the base model's frequencies lack, the lines what an effect changes when it is fitted "
            "alone. An effect explains the measurement where its line meets the bars; lines that run together are "
            "effects that these frequencies do not resolve.",
        ),
        blocks=(*signature_pictures(diagnosis), signature_table(diagnosis)),
    )


def signature_pictures(diagnosis: Diagnosis) -> tuple[Picture, ...]:
    """Draw the configurations of a diagnosis side by side, as many in one picture as can be read."""
    groups = _groups(diagnosis.errors)
    pictures = []
    for number, group in enumerate(groups, start=1):
        errors = [diagnosis.errors[k] for k in group]
        signatures = {e: [change[k] for k in group] for e, change in _ordered(diagnosis).items()}
        pictures.append(
            charted(
                "signatures" if len(groups) == 1 else f"signatures_{number}",
                signature_chart(errors, {diagnosis.labels.get(e, e): s for e, s in signatures.items()}),
                data=csv_text(
                    ("configuration", "mode", "frequency [Hz]", "its std [Hz]", "lacking", *signatures),
                    (
                        (e.configuration, e.mode, e.frequency, e.std, -e.base, *(s[k] for s in signatures.values()))
                        for k, e in enumerate(errors)
                    ),
                ),
                alt="Frequency changes that the base model lacks and that effects make",
                caption="Bars: measured less modelled frequency over the measured one, with the 95 % interval of the "
                f"measurement. Lines: change by at most {_MOST} effects, the candidates first.",
            )
        )  # fmt: skip
    return tuple(pictures)


def signature_chart(errors: Sequence[ModeError], signatures: Mapping[str, Sequence[float]]) -> Chart:
    """Return what the base model lacks at each mode as bars, and what effects change as marked lines."""
    at = [[e.configuration for e in errors], [f"{e.mode}: {e.frequency:.0f} Hz" for e in errors]]
    spread = [100.0 * Z95 * e.std / e.frequency for e in errors]
    traces: list[dict[str, Any]] = [
        {
            "type": "bar", "name": "lacking", "x": at, "y": [-100.0 * e.base for e in errors],
            "error_y": {"type": "data", "array": spread, "color": palette.LEFT, "thickness": 1},
            "marker": {"color": palette.PALE, "line": {"color": palette.LEFT, "width": 1}},
            "hovertemplate": "%{x[0]}, %{x[1]}: %{y:+.3f} %<extra>lacking</extra>",
        }
    ]  # fmt: skip
    for (name, change), (color, symbol, size) in zip(signatures.items(), _MARKS, strict=False):
        traces.append(
            {
                "type": "scatter", "mode": "lines+markers", "name": name, "x": at, "y": [100.0 * c for c in change],
                "line": {"color": color, "width": 1.5},
                "marker": {"color": color, "symbol": symbol, "size": size},
                "hovertemplate": "%{x[0]}, %{x[1]}: %{y:+.3f} %<extra>" + name + "</extra>",
            }
        )  # fmt: skip
    layout = {"yaxis": axis("change of frequency [%]", zeroline=True), "xaxis": {"automargin": True}}
    return Chart(traces=traces, layout=layout)


def signature_table(diagnosis: Diagnosis) -> Table:
    """List for every mode used what is lacking, what each effect changes, and what the first candidate leaves."""
    signatures = dict(list(_ordered(diagnosis).items())[:_MOST])
    first = " + ".join(_printed(diagnosis, name) for effects in diagnosis.set[:1] for name in effects)
    left = f"left by {first} [%]" if first else ""
    columns = [f"{_printed(diagnosis, name)} [%]" for name in signatures]
    rows = tuple(
        (
            e.configuration,
            str(e.mode),
            uncertain(e.frequency, Z95 * e.std),
            f"{-100.0 * e.base:+.3f}",
            f"{-100.0 * e.explained:+.3f}" if left else "",
            *(f"{100.0 * change[k]:+.3f}" for change in signatures.values()),
        )
        for k, e in enumerate(diagnosis.errors)
    )
    table = Table(
        title="What each effect changes, mode by mode",
        header=("configuration", "mode", "measured [Hz]", "lacking [%]", left, *columns),
        rows=rows,
        note="± is half of the 95 % interval. Each effect is fitted alone, with contact and nuisances anew. Further "
        "effects are in the CSV of the figure.",
        folded=True,
    )  # fmt: skip
    return table.without_empty_columns()


def _printed(diagnosis: Diagnosis, name: str) -> str:
    """Return an effect or hypothesis as a person reads it, the key beside the label."""
    return f"{diagnosis.labels[name]} ({name})" if name in diagnosis.labels else name


def _ordered(diagnosis: Diagnosis) -> dict[str, Sequence[float]]:
    """Return the signatures of the candidates' effects first, then the others."""
    first = [name for effects in diagnosis.set for name in effects if name in diagnosis.signatures]
    return {name: diagnosis.signatures[name] for name in dict.fromkeys([*first, *diagnosis.signatures])}


def _groups(errors: Sequence[ModeError]) -> list[list[int]]:
    """Return the numbers of the modes of each picture: whole configurations, no more than can be read."""
    together = 24  # modes of one figure whose names can still be read
    by_configuration: dict[str, list[int]] = {}
    for k, error in enumerate(errors):
        by_configuration.setdefault(error.configuration, []).append(k)
    groups: list[list[int]] = []
    for modes in by_configuration.values():
        if not groups or len(groups[-1]) + len(modes) > together:
            groups.append([])
        groups[-1] += modes
    return groups
