"""The published campaign as tables: for the terminal and as CSV."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence

import numpy as np
from rich.table import Table

from model import printed_effects
from updating.published.campaign import Calibrated

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
