"""Measured functions beside those of modes and model, and the stabilisation chart."""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ema.identification.doubtful_modes import DroppedColumn, Stability, dropped_columns, stability
from ema.identification.stabilization import StabilizationDiagram, stabilization
from ema.plot import palette
from ema.plot.figures import (
    UNIT,
    chosen_functions,
    overlay_figure,
    pole_groups,
    stabilization_figure,
    synthesized,
    within_band,
)
from ema.types.frf import FRF
from ema.types.modal_model import ModalModel
from lamella_shared import Complexes, Reals, csv_text
from updating.fitting.fit import Fit
from updating.report.part import Chart, Picture, Section, axis, legend_above, png, single
from updating.report.results import Tested, fracs, modelled
from updating.results.text import Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure


BASE, FOUND, FITTED_MODEL = "base model", "with what was identified", "fitted model"
"""Names of models' curves: of two, and of one alone."""

CHANGED, REFERENCE = "changed", "reference"
"""Names of the curves of two states."""

_STYLE: dict[str, dict[str, Any]] = {
    "measured": {"line": {"color": palette.MEASURED, "width": 2.5}},
    "from the modes": {"line": {"color": palette.MODES, "width": 1.5}},
    FITTED_MODEL: {"line": {"color": palette.BASE, "width": 1.5, "dash": "dot"}},
    BASE: {"line": {"color": palette.BASE, "width": 1.5, "dash": "dot"}, "of": "base"},
    CHANGED: {"line": {"color": palette.MEASURED, "width": 2.5}},
    REFERENCE: {"line": {"color": palette.BASE, "width": 1.5}},
    FOUND: {"line": {"color": palette.FOUND, "width": 1.5, "dash": "dot"}, "of": "found"},
}
"""How curves are drawn; "of" says by which model of the page's switch a curve is shown."""


def frf_chart(measured: ModalModel, lines: FRF, curves: Mapping[str, Complexes], order: Sequence[int]) -> str:
    """Return all functions at the first input as the JSON that `charts.js` shows one of.

    Parameters
    ----------
    measured : ModalModel
        Whose frequencies are marked.
    lines : FRF
        The functions within the band.
    curves : mapping of str to (n_output, n_frequency) complex
        By name: measured, from the modes and, where there are any, those of models.
    order : sequence of int
        Outputs in the order of the list to choose from.
    """
    # Functions times lines of a chart, about 1.5 MB of a page; of more, every second, third ... line is shown.
    most_numbers = 150_000
    stride = -(-len(order) * lines.frequency.size // most_numbers)
    at = slice(None, None, stride)
    frequency = lines.frequency[at]
    functions = [
        {
            "curves": [{"size": _size(c[o, at]), "phase": _phase(c[o, at])} for c in curves.values()],
            **({} if lines.coherence is None else {"coherence": _steps(lines.coherence[o, 0, at], 0.005, "u1")}),
        }
        for o in order
    ]
    return json.dumps(
        {
            "lines": {
                "first": float(frequency[0]), "step": float(np.diff(frequency[:2])[0]), "n": int(frequency.size),
            },
            "functions": functions,
            "curves": [{"name": name, **_STYLE[name]} for name in curves],
            "left": {"name": "difference", "line": {"color": palette.LEFT, "width": 1}},
            "layout": _layout(measured, lines),
        },
        separators=(",", ":"),
    )  # fmt: skip


def _layout(measured: ModalModel, lines: FRF) -> dict[str, Any]:
    """Return the axes: magnitude, phase and, where it was stored, coherence."""
    domains = [(0.36, 1.0), (0.0, 0.3)] if lines.coherence is None else [(0.46, 1.0), (0.2, 0.42), (0.0, 0.15)]
    ends = [float(lines.frequency[0]), float(lines.frequency[-1])]
    mark = {
        "type": "line",
        "yref": "paper",
        "y0": 0,
        "y1": 1,
        "line": {"color": palette.ACCENT, "width": 1, "dash": "dash"},
    }
    layout = {
        "height": 460,
        "hovermode": "x unified",
        "xaxis": axis("frequency [Hz]", range=ends, anchor=f"y{len(domains)}"),
        "yaxis": axis(UNIT[lines.quantity], type="log", exponentformat="power", domain=domains[0]),
        "yaxis2": axis("phase [°]", range=[-190, 190], tickvals=[-180, 0, 180], domain=domains[1]),
        "legend": legend_above(),
        "margin": {"r": 12, "t": 66},
        "shapes": [{**mark, "x0": float(f), "x1": float(f)} for f in measured.frequency],
    }
    if lines.coherence is not None:
        layout["yaxis3"] = axis("coh. [1]", range=[0, 1.05], tickvals=[0, 1], domain=domains[-1])
    return layout


def _size(value: Complexes) -> dict[str, Any]:
    """Pack magnitudes: their decimal logarithms in thousandths, a quarter of a percent."""
    size = np.abs(value)
    return _steps(np.log10(np.maximum(size, 1e-6 * size.max(initial=1e-30))), 1e-3, "i2")


def _phase(value: Complexes) -> dict[str, Any]:
    return _steps(np.degrees(np.angle(value)), 0.1, "i2")


def _steps(value: Reals, step: float, dtype: str) -> dict[str, Any]:
    """Pack numbers as multiples of a step, in little-endian integers."""
    whole = np.round(value / step).astype(f"<{dtype}")
    return {"dtype": dtype, "step": step, "bdata": base64.b64encode(whole.tobytes()).decode()}


_SYMBOLS = (
    {"symbol": "circle", "size": 2.5, "color": palette.QUIET},
    {"symbol": "x-thin", "size": 5, "color": palette.MEASURED, "line": {"width": 1.2, "color": palette.MEASURED}},
    {"symbol": "triangle-up", "size": 6, "color": palette.LEFT},
    {"symbol": "circle", "size": 5.5, "color": palette.MODES},
)


def stabilization_blocks(tested: Tested, frf: FRF) -> tuple[Picture | Table, ...]:
    """Show the stabilisation chart of the identified band, and list the columns that became no mode."""
    lines = frf.band(*tested.measured.band)
    diagram = stabilization(lines)
    stable, dropped = stability(diagram, lines), dropped_columns(diagram, lines, tested.measured)
    picture = stabilization_picture(tested, diagram, stable, dropped)
    return (picture, dropped_table(dropped)) if dropped else (picture,)


def stabilization_picture(
    tested: Tested, diagram: StabilizationDiagram, stable: Stability, dropped: Sequence[DroppedColumn]
) -> Picture:
    """Draw the poles of all orders with what is stable of each."""
    poles = zip(
        diagram.order, np.abs(diagram.pole) / (2.0 * np.pi), -diagram.pole.real / np.abs(diagram.pole),
        diagram.cluster, *(flag.astype(int) for flag in (stable.frequency, stable.damping, stable.shape)), strict=True,
    )  # fmt: skip
    return Picture(
        name=f"stabilization_{tested.name}",
        content=png(stabilization_figure(diagram, stability=stable)),
        form="png",
        data=csv_text(
            (
                "order", "frequency [Hz]", "damping ratio [1]", "cluster (-1: none)", "stable frequency",
                "stable damping", "stable shape",
            ),
            poles,
        ),
        alt="Stabilisation chart",
        caption="Poles of all model orders on the mode indicator function. Stable: within 1 % of the frequency, 5 % of "
        "the damping ratio and a MAC of 0.98 with the order below. A physical pole comes back at every order and "
        "makes a column; dashed lines are the modes that were identified"
        + (", dotted ones columns that are none, see below." if dropped else "; every column is one."),
        chart=stabilization_chart(diagram, stable, dropped, tested.measured).json,
    )  # fmt: skip


def stabilization_chart(
    diagram: StabilizationDiagram, stable: Stability, dropped: Sequence[DroppedColumn], modal_model: ModalModel
) -> Chart:
    """Return the stabilisation chart to be zoomed."""
    hertz, damping = np.abs(diagram.pole) / (2.0 * np.pi), -diagram.pole.real / np.abs(diagram.pole)
    traces: list[dict[str, object]] = [
        {
            "type": "scatter", "mode": "lines", "x": single(diagram.frequency), "y": single(diagram.indicator[0]),
            "yaxis": "y2", "name": "mode indicator", "line": {"color": palette.QUIET, "width": 1}, "opacity": 0.6,
            "hoverinfo": "skip",
        }
    ]  # fmt: skip
    for (name, which, _), symbol in zip(pole_groups(diagram, stable), _SYMBOLS, strict=True):
        traces.append(
            {
                "type": "scatter", "mode": "markers", "name": name, "x": single(hertz[which]),
                "y": diagram.order[which], "customdata": single(100.0 * damping[which]), "marker": symbol,
                "hovertemplate": "order %{y}: %{x:.2f} Hz, %{customdata:.3f} %<extra>" + name + "</extra>",
            }
        )  # fmt: skip
    marks = [(float(f), "dash", palette.ACCENT) for f in modal_model.frequency]
    marks += [(column.frequency, "dot", palette.QUIET) for column in dropped]
    layout = {
        "height": 420,
        "xaxis": axis("frequency [Hz]", range=[float(diagram.frequency[0]), float(diagram.frequency[-1])]),
        "yaxis": axis("model order", rangemode="tozero"),
        "yaxis2": {"overlaying": "y", "side": "right", "type": "log", "visible": False},
        "legend": {**legend_above(), "itemsizing": "constant"},
        "margin": {"r": 12, "t": 66},
        "shapes": [
            {
                "type": "line", "x0": f, "x1": f, "yref": "paper", "y0": 0, "y1": 1, "layer": "below",
                "line": {"color": color, "width": 1, "dash": dash},
            }
            for f, dash, color in marks
        ],
        "annotations": [
            {
                "x": column.frequency, "y": 1, "yref": "paper", "text": "✕", "showarrow": False, "yanchor": "bottom",
                "hovertext": column.reason, "font": {"color": palette.ACCENT},
            }
            for column in dropped
        ],
    }  # fmt: skip
    return Chart(traces=traces, layout=layout)


def dropped_table(dropped: Sequence[DroppedColumn]) -> Table:
    """List the columns that are no mode."""
    return Table(
        title="Columns that are no mode",
        header=("column [Hz]", "why it was not taken"),
        rows=tuple((f"{column.frequency:.1f}", column.reason) for column in dropped),
    )


_WITH = {BASE: "with the base model", FOUND: "with what was identified"}


def frf_section(tested: Tested) -> Section:
    """Show functions with the synthesised ones over them and the stabilisation chart."""
    if not tested.has_functions:
        return Section(title=frf_title(tested), text=(f"None: {tested.no_functions}.",))
    m, frf = tested.measured, tested.frf()
    lines = within_band(frf, m)
    models = model_functions(tested, lines)
    n_function = m.node.size * m.input.node.size
    text = (
        f"{m.frequency.size} modes between {m.band[0]:g} and {m.band[1]:g} Hz from {n_function} FRFs, without a "
        f"frequency guess. Measured functions and those of the modes correlate (FRAC) by {m.correlation.min():.5f} "
        f"to {m.correlation.max():.5f}, {np.median(m.correlation):.5f} in the middle.",
        *_frac_text({name: float(np.mean(fracs(lines, value))) for name, value in models.items()}),
    )
    return Section(
        title=frf_title(tested),
        text=text,
        blocks=(frf_picture(tested, frf, models), *stabilization_blocks(tested, frf)),
    )


def _frac_text(frac: Mapping[str, float]) -> tuple[str, ...]:
    """Say how well the functions of the models meet the measured ones, in the mean."""
    if not frac:
        return ()
    mean = " and ".join(f"{value:.3f} {_WITH[name]}" for name, value in frac.items())
    return (
        f"The model's functions, which know of the measured ones only what their modes say, correlate with them by "
        f"{mean} in the mean over all (FRAC: 1 where two functions are equal, 0 where they share nothing).",
    )


def frf_picture(tested: Tested, frf: FRF, models: Mapping[str, Complexes]) -> Picture:
    """Draw the functions that the identified modes meet worst, in the middle and best; the chart shows any of them.

    `models` holds the functions of each model within the band, see `model_functions`.
    """
    lines, fitted = synthesized(frf, tested.measured)
    chosen = chosen_functions(tested.measured)
    functions = frf_functions(tested.measured, lines)
    curves = {"measured": lines.value[:, 0], "from the modes": fitted[:, 0], **models}
    if len(models) == 1:
        curves = {FITTED_MODEL if name in models else name: value for name, value in curves.items()}
    return Picture(
        name=f"frf_{tested.name}",
        content=png(frf_figure(tested, frf, models)),
        form="png",
        data=_numbers(lines, curves, chosen),
        alt="Measured and synthesised FRFs",
        caption="Every function; the first ones are those that the identified modes meet worst, in the middle and best "
        "(a print shows these). Dashed: natural frequencies. The difference is what the modes leave; where it is as "
        "large as the function, noise governs."
        + ("" if not models else f" Dotted: the model{' with what was identified' if FOUND in models else ''}.")
        + ("" if lines.coherence is not None else " The test system stored no coherence."),
        chart=frf_chart(tested.measured, lines, curves, [o for o, _ in functions]),
        choices=tuple(name for _, name in functions),
        model="both" if len(models) > 1 else "",
    )


def frf_figure(tested: Tested, frf: FRF, models: Mapping[str, Complexes], *, beside: bool = False) -> Figure:
    """Draw the chosen functions with those of the model with what was identified, else of the base model."""
    shown = models.get(FOUND, models.get(BASE))
    drawn = None if shown is None else shown[list(chosen_functions(tested.measured))]
    return overlay_figure(frf, tested.measured, drawn, found=FOUND in models, beside=beside)


def model_functions(tested: Tested, lines: FRF) -> dict[str, Complexes]:
    """Return functions of the base and of the identified model, (n_output, n_frequency), as they are."""
    fits = {BASE: tested.fit, FOUND: None if tested.identified is None else tested.identified.fit}
    values = {name: modelled(tested, fit, lines) for name, fit in fits.items() if isinstance(fit, Fit)}
    return {name: value for name, value in values.items() if value is not None}


def _numbers(lines: FRF, curves: Mapping[str, Complexes], chosen: Sequence[int]) -> str:
    """Write the functions that a print shows as CSV."""
    columns, names = [lines.frequency], ["frequency [Hz]"]
    for o in chosen:
        name = f"{lines.output.name(o)}/{lines.input.name(0)}"
        for what, value in curves.items():
            columns += [value[o].real, value[o].imag]
            names += [f"{name} {what} {part} [SI {lines.quantity}]" for part in ("real", "imaginary")]
        if lines.coherence is not None:
            columns.append(lines.coherence[o, 0])
            names.append(f"{name} coherence")
    return csv_text(names, zip(*columns, strict=True))


def frf_title(tested: Tested) -> str:
    """Return the heading above the functions of a configuration."""
    return f"FRFs of {tested.name}"


def frf_functions(measured: ModalModel, lines: FRF) -> list[tuple[int, str]]:
    """Return outputs and their names in the order of the list to choose from: the worst, middle and best first."""
    first = dict(zip(chosen_functions(measured), ("worst", "middle", "best"), strict=False))
    order = [*first, *(o for o in range(lines.output.node.size) if o not in first)]
    return [
        (
            o,
            f"{lines.output.name(o)} over {lines.input.name(0)}, FRAC {measured.correlation[o, 0]:.4f}"
            + (f" ({first[o]})" if o in first else ""),
        )
        for o in order
    ]
