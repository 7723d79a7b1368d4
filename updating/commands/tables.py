"""Results as short tables for a terminal."""

from __future__ import annotations

import textwrap
from typing import get_args

import numpy as np
from rich.table import Table

from ema import Comparison, ModalModel
from model import Effect, Modes, Parameter, Stack
from model.contact.pressure import PressureSummary
from model.modes.verified import Verification
from model.stack.effect import Family
from updating.correlation.correlation import correlate
from updating.diagnosis.diagnosis import Diagnosis
from updating.diagnosis.signature import Signature
from updating.fitting.fit import Fit
from updating.fitting.modal_table import TableFit
from updating.results.text import parameter_text

_WIDTH = 98
_SAME_SHAPE = 0.95  # cross-orthogonality of a mode with itself

_MOST_EXPLANATIONS = 8


def modes_table(measured: ModalModel) -> Table:
    """List identified frequencies and damping ratios with their standard deviations."""
    table = Table(
        title=f"{measured.name}: {measured.frequency.size} modes in {_band(measured)}", title_justify="left"
    )
    for name in ("mode", "f [Hz]", "± [Hz]", "damping [%]", "± [%]"):
        table.add_column(name, justify="right")
    columns = (measured.frequency, measured.frequency_std, measured.damping, measured.damping_std)
    for r, (f, f_std, xi, xi_std) in enumerate(zip(*columns, strict=True), start=1):
        table.add_row(str(r), f"{f:.3f}", f"{f_std:.2g}", f"{100 * xi:.4g}", f"{100 * xi_std:.2g}")
    return table


def comparison_table(comparison: Comparison) -> Table:
    """List every mode, followed by its shape, over the configurations: frequency and damping."""
    table = Table(
        title="The same modes in all configurations: frequency [Hz], damping [%]", title_justify="left"
    )
    table.add_column("")
    for f in np.nanmean(comparison.frequency, axis=0):
        table.add_column(f"{f:.0f} Hz", justify="right", no_wrap=True)
    for name, frequency, damping in zip(
        comparison.name, comparison.frequency, comparison.damping, strict=True
    ):
        cells = (
            "-" if np.isnan(f) else f"{f:.1f}  {100 * x:.2f}" for f, x in zip(frequency, damping, strict=True)
        )
        table.add_row(name, *cells)
    return table


def model_table(stack: Stack, modes: Modes, names: tuple[str, ...], verification: Verification) -> Table:
    """List natural frequencies with their estimated errors, damping ratios and shape classes of the model."""
    worst = f"{100 * verification.first_error:.2g} %"
    origin = {
        "first": "They are within the tolerance.",
        "enriched": f"The first basis was off by {worst}, so it was enriched.",
        "all laminas": f"The first basis was off by {worst} and enriching did not do, so the frequencies were iterated "
        "on the equations of all laminas.",
    }[verification.basis]
    if not verification.met:
        origin = (
            f"[bold red]The tolerance of {100 * verification.tolerance:.2g} % is not met.[/bold red] {origin}"
        )
    table = Table(
        title=f"{stack.name}: {modes.frequency.size} elastic modes",
        title_justify="left",
        caption="Errors of f are estimated from the residual of the equations of all "
        f"{stack.n_lamina} laminas. {origin}",
        caption_justify="left",
    )
    for name in ("mode", "f [Hz]", "error of f [%]", "damping [%]"):
        table.add_column(name, justify="right")
    table.add_column("shape")
    columns = (modes.frequency, verification.error, modes.damping, names)
    for r, (f, error, xi, name) in enumerate(zip(*columns, strict=True), start=1):
        table.add_row(str(r), f"{f:.2f}", f"{100 * max(error, 0.0):.5f}", f"{100 * xi:.3g}", name)
    return table


def pressure_table(pressure: PressureSummary) -> Table:
    """List mean, range and lost contact of the pressure at the bottom, middle and top interface and over all."""
    table = Table(
        title="Pressure between the laminas",
        title_justify="left",
        caption=f"Clamping force {pressure.force:.4g} N, mean pressure {pressure.mean / 1e3:.4g} kPa; "
        f"equilibrium to {pressure.residual:.1g}.",
        caption_justify="left",
    )
    table.add_column("interface")
    for name in (r"mean \[kPa]", r"lowest \[kPa]", r"highest \[kPa]", "lost contact [%]"):
        table.add_column(name, justify="right")
    n = pressure.lowest.size
    kilo = [x / 1e3 for x in (pressure.interface_mean, pressure.lowest, pressure.highest)]
    for name, k in {"bottom": 0, "middle": n // 2, "top": n - 1}.items():
        table.add_row(name, *(f"{x[k]:.4g}" for x in kilo), f"{100 * pressure.lost_contact[k]:.3g}")
    mean, lowest, highest = kilo
    table.add_row(
        "all", f"{mean.mean():.4g}", f"{lowest.min():.4g}", f"{highest.max():.4g}",
        f"{100 * pressure.lost_contact.mean():.3g}",
    )  # fmt: skip
    return table


def effect_tables(known: dict[str, Effect]) -> tuple[Table, ...]:
    """List effects, one table a family, with their parameters."""
    tables = []
    for family in get_args(Family):
        members = [effect for effect in known.values() if effect.family == family]
        table = Table(title=family, title_justify="left", width=_WIDTH)
        table.add_column("effect", width=20)
        table.add_column("what it is", ratio=1)
        table.add_column("parameter, range and unit", ratio=1)
        for effect in members:
            table.add_row(
                effect.name, effect.summary, "\n".join(f"{p.name} {_range(p)}" for p in effect.parameters)
            )
        if members:
            tables.append(table)
    return tuple(tables)


def effect_text(effect: Effect) -> str:
    """Write what an effect is, its paragraphs filled to the width of the terminal's tables."""
    paragraphs: list[str] = []
    for line in effect.description.strip().splitlines():
        if line.startswith((" ", "\t")) or (paragraphs and line and paragraphs[-1] and line[0].islower()):
            paragraphs[-1] += f" {line.strip()}"
        else:
            paragraphs.append(line.strip())
    filled = (textwrap.fill(text, _WIDTH, subsequent_indent="    ") for text in paragraphs)
    return f"{effect.name} ({effect.family})\n\n" + "\n".join(filled) + "\n"


def parameter_table(effect: Effect) -> Table:
    """List the parameters of an effect with unit, range and source."""
    table = Table(title="Parameters", title_justify="left", width=_WIDTH)
    for name in ("parameter", "range and unit", "nominal", "neutral"):
        table.add_column(name, no_wrap=True)
    table.add_column("source", ratio=1)
    for p in effect.parameters:
        table.add_row(p.name, _range(p), f"{p.nominal:g}", f"{p.neutral:g}", p.source)
    return table


def signature_table(found: Signature) -> Table:
    """List what an effect does to the first modes at each pressure."""
    values = ", ".join(f"{name} = {value:g}" for name, value in found.strength.items())
    turned = [
        name for name, like in zip(found.mode, found.likeness.T, strict=True) if like.min() < _SAME_SHAPE
    ]
    table = Table(
        title=f"What it does at {values}",
        title_justify="left",
        caption=f"The shape of {', '.join(turned)} changes: MAC in mass below {_SAME_SHAPE**2:.2g}."
        if turned
        else None,
        caption_justify="left",
    )
    table.add_column("pressure", justify="right")
    table.add_column("change of")
    for name, f in zip(found.mode, found.base_frequency.T, strict=True):
        table.add_column(f"{name}\n{f[0]:.0f} to {f[-1]:.0f} Hz", justify="right")
    rows = zip(found.pressure, 100.0 * found.frequency_change, 100.0 * found.damping_change, strict=True)
    for pressure, frequency, damping in rows:
        at = f"{pressure / 1e3:g} kPa"
        table.add_row(at, r"frequency \[%]", *(f"{x:+.2f}" for x in frequency))
        table.add_row("", r"damping ratio \[% points]", *(f"{x:+.3f}" for x in damping))
    return table


def _range(parameter: Parameter) -> str:
    unit = "" if parameter.unit == "1" else f" {parameter.unit}"
    return f"{parameter.lower:g} to {parameter.upper:g}{unit}"


def fit_table(measured: ModalModel, fit: Fit) -> Table:
    """Put measured beside fitted modes, with the parameters below."""
    pairs = correlate(measured, fit.modes, fit.pairing)
    caption = (
        f"{parameter_text(fit.G_f)}   {parameter_text(fit.d_f)}\nmean frequency error {100 * fit.error:.2f} %"
    )
    left_over = [f"{f:.1f}" for f in measured.frequency[fit.pairing.unpaired_measured]]
    if left_over:
        caption += f"\nmeasured but not paired: {', '.join(left_over)} Hz"
    table = Table(
        title=f"{fit.name}: measured and fitted",
        title_justify="left",
        caption=caption,
        caption_justify="left",
    )
    for name in (
        "mode", "measured\n[Hz]", "model\n[Hz]", "error\n[%]", "damping\nmeasured [%]", "damping\nmodel [%]", "MAC",
    ):  # fmt: skip
        table.add_column(name, justify="right")
    columns = (
        pairs.measured_frequency, pairs.model_frequency, pairs.frequency_error, pairs.measured_damping,
        pairs.model_damping, pairs.mac,
    )  # fmt: skip
    for mode, values in zip(fit.pairing.measured, zip(*columns, strict=True), strict=True):
        f_exp, f_num, error, xi_exp, xi_num, mac = values
        table.add_row(
            str(mode + 1), f"{f_exp:.2f}", f"{f_num:.2f}", f"{100 * error:+.2f}", f"{100 * xi_exp:.3g}",
            f"{100 * xi_num:.3g}", f"{mac:.4f}",
        )  # fmt: skip
    return table


def modal_table(fits: tuple[TableFit, ...]) -> Table:
    """Print Table 7 of the paper with our numbers beside its own."""
    published = np.array([f.row.published_G_f for f in fits])
    known = np.isfinite(published)
    ratio = np.array([f.G_f.value for f in fits])[known] / published[known]
    caption = (
        f"mean error, eq. (2): ours {100 * np.mean([f.error for f in fits]):.1f} %, "
        f"published {100 * np.mean([f.published_error for f in fits]):.1f} %\n"
        "our model fitted to the published model's frequencies: "
        f"{100 * np.mean([f.model_misfit for f in fits]):.2f} % off"
    )
    if np.any(known):
        caption += f"\nour G_f over the published: {ratio.min():.3f} to {ratio.max():.3f}"
    table = Table(
        title="Natural frequencies [Hz]: measured, published model, ours",
        title_justify="left",
        caption=caption,
        caption_justify="left",
    )
    table.add_column("stack", justify="right")
    for r in range(fits[0].row.frequency.size):
        table.add_column(f"mode {r + 1}", justify="right", no_wrap=True)
    for name in ("error [%]\npubl. ours", "G_f\npubl. ours"):
        table.add_column(name, justify="right", no_wrap=True)
    for fit in fits:
        columns = zip(fit.row.frequency, fit.row.published_frequency, fit.frequency, strict=True)
        published_G_f = "" if np.isnan(fit.row.published_G_f) else f"{fit.row.published_G_f:.0f}"
        table.add_row(
            fit.row.name,
            *(f"{a:.0f} {b:4.0f} {c:4.0f}" for a, b, c in columns),
            f"{100 * fit.published_error:.1f} {100 * fit.error:.1f}",
            f"{published_G_f} {fit.G_f.value:4.0f}",
        )
    return table


def _band(measured: ModalModel) -> str:
    return f"{measured.band[0]:g} to {measured.band[1]:g} Hz"


def diagnosis_table(diagnosis: Diagnosis) -> Table:
    """Return the explanations that were fitted in full, the most probable first; the page has their parameters."""
    table = Table(title="Explanations", title_justify="left")
    table.add_column("effects", no_wrap=True)
    for name in ("proba-\nbility", "misfit", "distance", "f error\n[%]", "held out\n[%]"):
        table.add_column(name, justify="right")
    for own in diagnosis.ranking[:_MOST_EXPLANATIONS]:
        table.add_row(
            " +\n".join(own.effects) or "none",
            f"{own.probability:.3f}",
            f"{own.misfit:.1f}",
            f"{own.distance:.1f}",
            f"{100 * own.frequency_error:.3f}",
            f"{100 * own.held_out_error:.3f}",
        )
    return table


def next_test_table(diagnosis: Diagnosis) -> Table:
    """Return the further tests, the one that separates best first."""
    table = Table(title="Further tests", title_justify="left")
    for name, justify in (("test", "left"), ("smallest distance", "right"), ("now", "right")):
        table.add_column(name, justify=justify)  # type: ignore[arg-type]
    for test in diagnosis.next_tests:
        table.add_row(test.instruction, f"{test.distance:.1f}", f"{test.now:.1f}")
    return table
