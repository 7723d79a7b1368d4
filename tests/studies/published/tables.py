"""Tables and figures of the published campaign, with ours beside them."""

from __future__ import annotations

import csv
import io
import textwrap
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from rich.table import Table

from ema.plot import palette
from model import printed_effects
from tests.studies.published.campaign import Calibrated, Published

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


TARGET = {"C0": 0.057, "C1": 0.040, "C2": 0.057, "C3": 0.040}
"""Errors that shared effects should reach: what an independent prototype with another model reached."""


def summary_table(results: Sequence[Calibrated]) -> Table:
    """Print errors, shared parameters and the pressure law under each calibration."""
    effects = " + ".join(printed_effects(results[0].shared.effects))
    table = Table(
        title=f"18 stacks, mean relative frequency error in %; shared by all: {effects}",
        title_justify="left",
        caption=conclusion(results),
        caption_justify="left",
    )
    for name in (
        "", "base\npubl. | ours", "with\n" + " +\n".join(results[0].shared.effects), "stack\nleft out", "n of\nG ~ p^n",
        "95 %", "M1 from M2\nn = 1 | n | own",
    ):  # fmt: skip
        table.add_column(name, justify="right", no_wrap=True)
    for result in results:
        law = result.law
        published = np.mean([row.published_error for row in result.row])
        m1 = " | ".join(f"{100 * law.error(name):.1f}" for name in ("linear", "power", "refitted"))
        table.add_row(
            result.calibration,
            f"{100 * published:.1f} | {100 * result.error:.1f}", f"{100 * result.shared.error():.2f}",
            f"{100 * result.shared.error(result.shared.left_out):.2f}", f"{law.exponent:.2f}",
            f"{law.jackknife[0]:.2f} to {law.jackknife[1]:.2f}", m1,
        )  # fmt: skip
    return table


def conclusion(results: Sequence[Calibrated]) -> str:
    """Say which numbers hold under every calibration that was run, and which depend on it."""
    lines = []
    names = ", ".join(result.calibration for result in results)
    fall = [result.shared.error() / result.error for result in results]
    lines.append(
        f"Under {names} the shared effects leave {_range([100 * f for f in fall], '.0f')} % of the base error."
    )
    at_target = [result.calibration for result in results if result.shared.error() <= TARGET[result.calibration]]
    lines.append(f"At or below the error of the prototype: {', '.join(at_target) or 'none'}.")
    for i, p in enumerate(results[0].shared.parameter):
        values = [result.shared.parameter[i].value for result in results]
        unit = "" if p.unit == "1" else f" {p.unit}"
        lines.append(f"{p.name}: {_range(values, '.4g')}{unit}.")
    below = all(result.law.jackknife[1] < 1.0 for result in results)
    lines.append(
        "Contact stiffness grows less than in proportion to pressure."
        if below
        else "Contact stiffness may grow in proportion to pressure under some of them."
    )
    return "\n".join(lines)


def _range(values: Sequence[float], form: str) -> str:
    low, high = format(min(values), form), format(max(values), form)
    return low if low == high else f"{low} to {high}"


def table_7_csv(results: Sequence[Calibrated]) -> bytes:
    """Table 7 of the paper beside ours: measured, published, base model, with effects, left out."""
    rows = [
        [
            "calibration", "stack", "mode", "measured_Hz", "published_Hz", "base_Hz", "with_effects_Hz", "left_out_Hz",
        ]
    ]  # fmt: skip
    for result in results:
        for row, after, out in zip(result.row, result.shared.frequency, result.shared.left_out, strict=True):
            for r in range(row.measured.size):
                values = (row.measured[r], row.published[r], row.frequency[r], after[r], out[r])
                rows.append([result.calibration, row.stack, str(r + 1), *(f"{v:.6g}" for v in values)])
    return _csv(rows)


def table_6_csv(results: Sequence[Calibrated]) -> bytes:
    """Table 6 of the paper beside ours; the source has frequencies at M1, and damping, of Table 4's stacks only."""
    rows = [
        ["calibration", "stack", "torque", "published_G_f", "G_f", "published_d_f_s_per_Pa", "d_f_s_per_Pa", "error"]
    ]
    for result in results:
        seven = {t.stack for t in result.torque}
        for t in result.torque:
            values = (t.published_G_f, t.G_f, t.published_d_f, t.d_f, t.error)
            rows.append([result.calibration, t.stack, t.torque, *(_cell(v) for v in values)])
        for row in result.row:
            if row.stack not in seven:
                values = (row.published_G_f, row.G_f, np.nan, np.nan, row.error)
                rows.append([result.calibration, row.stack, "M2", *(_cell(v) for v in values)])
    return _csv(rows)


def parameters_csv(results: Sequence[Calibrated]) -> bytes:
    """Fitted parameters of the 18 stacks with shared effects."""
    rows = [["calibration", "parameter", "stack", "unit", "value", "std", "at_bound", "determined"]]
    for result in results:
        rows.extend(
            [
                result.calibration,
                p.name,
                "all",
                p.unit,
                f"{p.value:.6g}",
                f"{s:.3g}",
                str(p.at_bound),
                str(p.determined),
            ]
            for p, s in zip(result.shared.parameter, result.shared.std, strict=True)
        )
        rows.extend(
            [result.calibration, "G_f", stack, "Pa/Pa", f"{value:.6g}", "", "", ""]
            for stack, value in result.shared.G_f.items()
        )
    return _csv(rows)


def _cell(value: float) -> str:
    return f"{value:.6g}" if np.isfinite(value) else ""


def _csv(rows: Sequence[Sequence[str]]) -> bytes:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue().encode()


TREATED = {
    "silicon layers (figure 13)": {"2": "plain", "12": "two layers", "13": "four layers"},
    "adhesive (figure 14)": {"5": "plain", "14": "adhesive", "4": "plain", "15": "adhesive"},
    "lubricant (figure 15)": {
        "8": "plain", "16": "lubricated", "3": "plain", "17": "lubricated", "1": "plain", "18": "lubricated",
    },
}  # fmt: skip
"""Stacks of figures 13 to 15: without and with the treatment of Table 1, from the same sheets."""


def contact_figure(results: Sequence[Calibrated], published: Published) -> Figure:
    """Draw contact stiffness and contact damping of all stacks, figure 12, published and ours."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 7.0), layout="constrained")
    ticks = {row.stack: "" for row in results[0].row}
    for axes, damping in zip(figure.subplots(2, 1), (False, True), strict=True):
        _contact(axes, results, published, ticks, damping=damping)
    figure.axes[0].set_title("Contact parameters of the base model (figure 12)", fontsize=10)
    _legend_above(figure)
    return figure


def treatment_figure(results: Sequence[Calibrated], published: Published) -> Figure:
    """Draw what silicon layers, adhesive and lubricant do to contact stiffness and damping, figures 13 to 15."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(13.0, 7.0), layout="constrained")
    panels = figure.subplots(2, 3, width_ratios=[3, 4, 6], sharey="row")
    for column, (title, ticks) in zip(panels.T, TREATED.items(), strict=True):
        for axes, damping in zip(column, (False, True), strict=True):
            _contact(axes, results, published, ticks, damping=damping)
        column[0].set_title(title, fontsize=10)
        for axes in column:
            axes.label_outer()
    _legend_above(figure)
    return figure


def _legend_above(figure: Figure) -> None:
    figure.legend(*figure.axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=5, fontsize=8)


def _contact(
    axes: Axes, results: Sequence[Calibrated], published: Published, ticks: Mapping[str, str], *, damping: bool
) -> None:
    """Draw G_f at 320 kPa, or d_f as the mean of both torques, as bars and the published ones as diamonds."""
    x = np.arange(len(ticks))
    for k, result in enumerate(results):
        value = _damping(result) if damping else {row.stack: row.G_f for row in result.row}
        centre = x + 0.8 * (k + 0.5) / len(results) - 0.4
        height = [value.get(stack, np.nan) for stack in ticks]
        axes.bar(
            centre, height, 0.8 / len(results), label=result.calibration, color=palette.SERIES[k % len(palette.SERIES)]
        )
    key, factor = ("df_avg", 1e12) if damping else ("Gf_M2", 1.0)
    diamonds = [factor * published.contact.get(stack, {}).get(key, np.nan) for stack in ticks]
    axes.plot(x, diamonds, "kD", markerfacecolor="white", label="published")
    axes.set_xticks(x, [f"{stack}\n{text}".strip() for stack, text in ticks.items()], fontsize=8)
    axes.set_xlim(-0.6, len(ticks) - 0.4)
    axes.set_xlabel("stack (no bar: damping not in Table 4)" if damping else "stack")
    axes.set_ylabel("$d_f$, mean of M1 and M2 [ps/Pa]" if damping else "$G_f$ at M2 [Pa/Pa]")


def _damping(result: Calibrated) -> dict[str, float]:
    """Return the mean of d_f at both torques by stack, ps/Pa."""
    stacks = dict.fromkeys(t.stack for t in result.torque)
    return {s: 1e12 * float(np.mean([t.d_f for t in result.torque if t.stack == s])) for s in stacks}


def error_figure(results: Sequence[Calibrated]) -> Figure:
    """Draw the error of the base model at both pressures, figure 16, by stack."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 3.2 * len(results)), layout="constrained")
    for axes, result in zip(np.atleast_1d(figure.subplots(len(results), 1)), results, strict=True):
        stacks = [row.stack for row in result.row]
        x = np.arange(len(stacks))
        low = {t.stack: 100 * t.error for t in result.torque if t.torque == "M1"}
        axes.bar(
            x - 0.2, [low.get(s, np.nan) for s in stacks], 0.4, label="ours, M1 (Table 4)", color=palette.SERIES[0]
        )
        axes.bar(x + 0.2, [100 * row.error for row in result.row], 0.4, label="ours, M2 (Table 7)", color=palette.BASE)
        axes.plot(x + 0.2, [100 * row.published_error for row in result.row], "kD", label="published, M2")
        _finish(axes, stacks, f"{result.calibration}: base model")
    return figure


def fall_figure(results: Sequence[Calibrated]) -> Figure:
    """Draw the error by stack with the base model, with the shared effects, and with each stack left out."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 3.2 * len(results)), layout="constrained")
    for axes, result in zip(np.atleast_1d(figure.subplots(len(results), 1)), results, strict=True):
        x = np.arange(len(result.row))
        with_effects, left_out = (
            [100 * np.nanmean(np.abs(f / m - 1.0)) for f, m in zip(of, result.shared.measured, strict=True)]
            for of in (result.shared.frequency, result.shared.left_out)
        )
        axes.bar(x - 0.27, [100 * row.error for row in result.row], 0.27, label="base model", color=palette.BASE)
        axes.bar(x, with_effects, 0.27, label=" + ".join(printed_effects(result.shared.effects)), color=palette.FOUND)
        axes.bar(x + 0.27, left_out, 0.27, label="the same, parameters from the other stacks", color=palette.ELSEWHERE)
        title = (
            f"{result.calibration}: {100 * result.error:.1f} % → {100 * result.shared.error():.1f} %, "
            f"left out {100 * result.shared.error(result.shared.left_out):.1f} %"
        )
        _finish(axes, [row.stack for row in result.row], title)
    return figure


def pattern_figure(results: Sequence[Calibrated]) -> Figure:
    """Draw model over measured frequency by mode, one line a stack: one pattern means one missing effect."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(3.0 * len(results), 5.6), layout="constrained")
    panels = figure.subplots(2, len(results), sharey=True, squeeze=False)
    for column, result in zip(panels.T, results, strict=True):
        base = np.array([100 * (row.frequency / row.measured - 1.0) for row in result.row])
        after = 100 * (np.array(result.shared.frequency) / np.array(result.shared.measured) - 1.0)
        with_effects = " + ".join(printed_effects(result.shared.effects))
        for axes, error, name in zip(column, (base, after), ("base", with_effects), strict=True):
            axes.axhline(0.0, color=palette.QUIET)
            axes.plot(error.T, color=palette.QUIET, linewidth=0.8)
            axes.plot(error.mean(axis=0), "o-", color=palette.ACCENT, linewidth=2)
            axes.set_xticks(range(error.shape[1]), ["T1", "B1", "B2", "T2"][: error.shape[1]])
            axes.set_title(textwrap.fill(f"{result.calibration}, {name}", 36), fontsize=9)
    for axes in panels[:, 0]:
        axes.set_ylabel("frequency error [%]")
    return figure


def law_figure(results: Sequence[Calibrated]) -> Figure:
    """Draw the exponent of G ~ p^n by stack and for all, and the error at M1 predicted from M2."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.0, 3.8), layout="constrained")
    left, right = figure.subplots(1, 2)
    for k, result in enumerate(results):
        law, shift = result.law, 0.15 * (k - (len(results) - 1) / 2)
        x = np.arange(len(law.stack) + 1) + shift
        (line,) = left.plot(x[:-1], law.own, "o", markersize=4, label=result.calibration)
        around = np.abs(np.array(law.jackknife) - law.exponent)[:, None]
        left.errorbar(x[-1:], [law.exponent], around, fmt="D", markersize=4, color=line.get_color(), capsize=3)
        errors = [100 * law.error(name) for name in ("linear", "power", "refitted")]
        right.bar(np.arange(3) + 0.2 * (k - (len(results) - 1) / 2), errors, 0.2, label=result.calibration)
    left.axhline(1.0, color=palette.INK, linewidth=0.8, linestyle="--")
    left.set_xticks(range(len(results[0].law.stack) + 1), [*results[0].law.stack, "all"])
    left.set_xlabel("stack; bars: 95 % from leaving stacks out")
    left.set_ylabel("exponent n of $G \\sim p^n$")
    right.set_xticks(range(3), ["from M2, n = 1", "from M2, n of\nthe other stacks", "$G_f$ fitted\nat M1"])
    right.set_ylabel("mean error at M1 [%]")
    left.legend(fontsize=8)
    return figure


def _finish(axes: Axes, stacks: Sequence[str], title: str) -> None:
    axes.set_xticks(range(len(stacks)), stacks)
    axes.set_xlabel("stack")
    axes.set_ylabel("mean frequency error [%]")
    axes.set_title(title, fontsize=10)
    axes.legend(fontsize=8, ncols=3, loc="upper right")
    axes.margins(y=0.2)
