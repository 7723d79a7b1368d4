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
from updating.published.campaign import Calibrated, Published

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


TARGET = {"C0": 0.057, "C1": 0.040, "C2": 0.057, "C3": 0.040}
"""Errors that shared effects should reach: what an independent prototype with another model reached."""


def summary_table(found: Sequence[Calibrated]) -> Table:
    """Print errors, shared parameters and the pressure law under each calibration."""
    effects = " + ".join(printed_effects(found[0].shared.effects))
    table = Table(
        title=f"18 stacks, mean relative frequency error in %; shared by all: {effects}",
        title_justify="left",
        caption=conclusion(found),
        caption_justify="left",
    )
    for name in (
        "", "base\npubl. | ours", "with\n" + " +\n".join(found[0].shared.effects), "stack\nleft out", "n of\nG ~ p^n",
        "95 %", "M1 from M2\nn = 1 | n | own",
    ):  # fmt: skip
        table.add_column(name, justify="right", no_wrap=True)
    for one in found:
        law = one.law
        published = np.mean([row.published_error for row in one.row])
        m1 = " | ".join(f"{100 * law.error(name):.1f}" for name in ("linear", "power", "refitted"))
        table.add_row(
            one.calibration, f"{100 * published:.1f} | {100 * one.error:.1f}", f"{100 * one.shared.error():.2f}",
            f"{100 * one.shared.error(one.shared.left_out):.2f}", f"{law.exponent:.2f}",
            f"{law.jackknife[0]:.2f} to {law.jackknife[1]:.2f}", m1,
        )  # fmt: skip
    return table


def conclusion(found: Sequence[Calibrated]) -> str:
    """Say which numbers hold under every calibration that was run, and which depend on it."""
    lines = []
    names = ", ".join(one.calibration for one in found)
    fall = [one.shared.error() / one.error for one in found]
    lines.append(
        f"Under {names} the shared effects leave {_range([100 * f for f in fall], '.0f')} % of the base error."
    )
    at_target = [one.calibration for one in found if one.shared.error() <= TARGET[one.calibration]]
    lines.append(f"At or below the error of the prototype: {', '.join(at_target) or 'none'}.")
    for i, p in enumerate(found[0].shared.parameter):
        values = [one.shared.parameter[i].value for one in found]
        unit = "" if p.unit == "1" else f" {p.unit}"
        lines.append(f"{p.name}: {_range(values, '.4g')}{unit}.")
    below = all(one.law.jackknife[1] < 1.0 for one in found)
    lines.append(
        "Contact stiffness grows less than in proportion to pressure."
        if below
        else "Contact stiffness may grow in proportion to pressure under some of them."
    )
    return "\n".join(lines)


def _range(values: Sequence[float], form: str) -> str:
    low, high = format(min(values), form), format(max(values), form)
    return low if low == high else f"{low} to {high}"


def table_7_csv(found: Sequence[Calibrated]) -> bytes:
    """Table 7 of the paper beside ours: measured, published, base model, with effects, left out."""
    rows = [
        [
            "calibration", "stack", "mode", "measured_Hz", "published_Hz", "base_Hz", "with_effects_Hz", "left_out_Hz",
        ]
    ]  # fmt: skip
    for one in found:
        for row, after, out in zip(one.row, one.shared.frequency, one.shared.left_out, strict=True):
            for r in range(row.measured.size):
                values = (
                    row.measured[r],
                    row.published[r],
                    row.frequency[r],
                    after[r],
                    out[r],
                )
                rows.append([one.calibration, row.stack, str(r + 1), *(f"{v:.6g}" for v in values)])
    return _csv(rows)


def table_6_csv(found: Sequence[Calibrated]) -> bytes:
    """Table 6 of the paper beside ours; the source has frequencies at M1, and damping, of Table 4's stacks only."""
    rows = [
        [
            "calibration",
            "stack",
            "torque",
            "published_G_f",
            "G_f",
            "published_d_f_s_per_Pa",
            "d_f_s_per_Pa",
            "error",
        ]
    ]
    for one in found:
        seven = {t.stack for t in one.torque}
        for t in one.torque:
            values = (t.published_G_f, t.G_f, t.published_d_f, t.d_f, t.error)
            rows.append([one.calibration, t.stack, t.torque, *(_cell(v) for v in values)])
        for row in one.row:
            if row.stack not in seven:
                values = (row.published_G_f, row.G_f, np.nan, np.nan, row.error)
                rows.append([one.calibration, row.stack, "M2", *(_cell(v) for v in values)])
    return _csv(rows)


def parameters_csv(found: Sequence[Calibrated]) -> bytes:
    """Fitted parameters of the 18 stacks with shared effects."""
    rows = [["calibration", "parameter", "stack", "unit", "value", "std", "at_bound", "determined"]]
    for one in found:
        rows.extend(
            [
                one.calibration,
                p.name,
                "all",
                p.unit,
                f"{p.value:.6g}",
                f"{s:.3g}",
                str(p.at_bound),
                str(p.determined),
            ]
            for p, s in zip(one.shared.parameter, one.shared.std, strict=True)
        )
        rows.extend(
            [one.calibration, "G_f", stack, "Pa/Pa", f"{value:.6g}", "", "", ""]
            for stack, value in one.shared.G_f.items()
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


def contact_figure(found: Sequence[Calibrated], published: Published) -> Figure:
    """Draw contact stiffness and contact damping of all stacks, figure 12, published and ours."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 7.0), layout="constrained")
    ticks = {row.stack: "" for row in found[0].row}
    for axes, damping in zip(figure.subplots(2, 1), (False, True), strict=True):
        _contact(axes, found, published, ticks, damping=damping)
    figure.axes[0].set_title("Contact parameters of the base model (figure 12)", fontsize=10)
    _legend_above(figure)
    return figure


def treatment_figure(found: Sequence[Calibrated], published: Published) -> Figure:
    """Draw what silicon layers, adhesive and lubricant do to contact stiffness and damping, figures 13 to 15."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(13.0, 7.0), layout="constrained")
    panels = figure.subplots(2, 3, width_ratios=[3, 4, 6], sharey="row")
    for column, (title, ticks) in zip(panels.T, TREATED.items(), strict=True):
        for axes, damping in zip(column, (False, True), strict=True):
            _contact(axes, found, published, ticks, damping=damping)
        column[0].set_title(title, fontsize=10)
        for axes in column:
            axes.label_outer()
    _legend_above(figure)
    return figure


def _legend_above(figure: Figure) -> None:
    figure.legend(
        *figure.axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=5, fontsize=8
    )


def _contact(
    axes: Axes, found: Sequence[Calibrated], published: Published, ticks: Mapping[str, str], *, damping: bool
) -> None:
    """Draw G_f at 320 kPa, or d_f as the mean of both torques, as bars and the published ones as diamonds."""
    x = np.arange(len(ticks))
    for k, one in enumerate(found):
        value = _damping(one) if damping else {row.stack: row.G_f for row in one.row}
        centre = x + 0.8 * (k + 0.5) / len(found) - 0.4
        height = [value.get(stack, np.nan) for stack in ticks]
        axes.bar(
            centre,
            height,
            0.8 / len(found),
            label=one.calibration,
            color=palette.SERIES[k % len(palette.SERIES)],
        )
    key, factor = ("df_avg", 1e12) if damping else ("Gf_M2", 1.0)
    diamonds = [factor * published.contact.get(stack, {}).get(key, np.nan) for stack in ticks]
    axes.plot(x, diamonds, "kD", markerfacecolor="white", label="published")
    axes.set_xticks(x, [f"{stack}\n{text}".strip() for stack, text in ticks.items()], fontsize=8)
    axes.set_xlim(-0.6, len(ticks) - 0.4)
    axes.set_xlabel("stack (no bar: damping not in Table 4)" if damping else "stack")
    axes.set_ylabel("$d_f$, mean of M1 and M2 [ps/Pa]" if damping else "$G_f$ at M2 [Pa/Pa]")


def _damping(one: Calibrated) -> dict[str, float]:
    """Return the mean of d_f at both torques by stack, ps/Pa."""
    stacks = dict.fromkeys(t.stack for t in one.torque)
    return {s: 1e12 * float(np.mean([t.d_f for t in one.torque if t.stack == s])) for s in stacks}


def error_figure(found: Sequence[Calibrated]) -> Figure:
    """Draw the error of the base model at both pressures, figure 16, by stack."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 3.2 * len(found)), layout="constrained")
    for axes, one in zip(np.atleast_1d(figure.subplots(len(found), 1)), found, strict=True):
        stacks = [row.stack for row in one.row]
        x = np.arange(len(stacks))
        low = {t.stack: 100 * t.error for t in one.torque if t.torque == "M1"}
        axes.bar(
            x - 0.2,
            [low.get(s, np.nan) for s in stacks],
            0.4,
            label="ours, M1 (Table 4)",
            color=palette.SERIES[0],
        )
        axes.bar(
            x + 0.2, [100 * row.error for row in one.row], 0.4, label="ours, M2 (Table 7)", color=palette.BASE
        )
        axes.plot(x + 0.2, [100 * row.published_error for row in one.row], "kD", label="published, M2")
        _finish(axes, stacks, f"{one.calibration}: base model")
    return figure


def fall_figure(found: Sequence[Calibrated]) -> Figure:
    """Draw the error by stack with the base model, with the shared effects, and with each stack left out."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 3.2 * len(found)), layout="constrained")
    for axes, one in zip(np.atleast_1d(figure.subplots(len(found), 1)), found, strict=True):
        x = np.arange(len(one.row))
        with_effects, left_out = (
            [100 * np.nanmean(np.abs(f / m - 1.0)) for f, m in zip(of, one.shared.measured, strict=True)]
            for of in (one.shared.frequency, one.shared.left_out)
        )
        axes.bar(x - 0.27, [100 * row.error for row in one.row], 0.27, label="base model", color=palette.BASE)
        axes.bar(
            x, with_effects, 0.27, label=" + ".join(printed_effects(one.shared.effects)), color=palette.FOUND
        )
        axes.bar(
            x + 0.27,
            left_out,
            0.27,
            label="the same, parameters from the other stacks",
            color=palette.ELSEWHERE,
        )
        title = (
            f"{one.calibration}: {100 * one.error:.1f} % → {100 * one.shared.error():.1f} %, "
            f"left out {100 * one.shared.error(one.shared.left_out):.1f} %"
        )
        _finish(axes, [row.stack for row in one.row], title)
    return figure


def pattern_figure(found: Sequence[Calibrated]) -> Figure:
    """Draw model over measured frequency by mode, one line a stack: one pattern means one missing effect."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(3.0 * len(found), 5.6), layout="constrained")
    panels = figure.subplots(2, len(found), sharey=True, squeeze=False)
    for column, one in zip(panels.T, found, strict=True):
        base = np.array([100 * (row.frequency / row.measured - 1.0) for row in one.row])
        after = 100 * (np.array(one.shared.frequency) / np.array(one.shared.measured) - 1.0)
        with_effects = " + ".join(printed_effects(one.shared.effects))
        for axes, error, name in zip(column, (base, after), ("base", with_effects), strict=True):
            axes.axhline(0.0, color=palette.QUIET)
            axes.plot(error.T, color=palette.QUIET, linewidth=0.8)
            axes.plot(error.mean(axis=0), "o-", color=palette.ACCENT, linewidth=2)
            axes.set_xticks(range(error.shape[1]), ["T1", "B1", "B2", "T2"][: error.shape[1]])
            axes.set_title(textwrap.fill(f"{one.calibration}, {name}", 36), fontsize=9)
    for axes in panels[:, 0]:
        axes.set_ylabel("frequency error [%]")
    return figure


def law_figure(found: Sequence[Calibrated]) -> Figure:
    """Draw the exponent of G ~ p^n by stack and for all, and the error at M1 predicted from M2."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.0, 3.8), layout="constrained")
    left, right = figure.subplots(1, 2)
    for k, one in enumerate(found):
        law, shift = one.law, 0.15 * (k - (len(found) - 1) / 2)
        x = np.arange(len(law.stack) + 1) + shift
        (line,) = left.plot(x[:-1], law.own, "o", markersize=4, label=one.calibration)
        around = np.abs(np.array(law.jackknife) - law.exponent)[:, None]
        left.errorbar(
            x[-1:], [law.exponent], around, fmt="D", markersize=4, color=line.get_color(), capsize=3
        )
        errors = [100 * law.error(name) for name in ("linear", "power", "refitted")]
        right.bar(np.arange(3) + 0.2 * (k - (len(found) - 1) / 2), errors, 0.2, label=one.calibration)
    left.axhline(1.0, color=palette.INK, linewidth=0.8, linestyle="--")
    left.set_xticks(range(len(found[0].law.stack) + 1), [*found[0].law.stack, "all"])
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
