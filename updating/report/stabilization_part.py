"""The stabilisation chart: what of each pole is stable, which columns became modes, and why the others did not."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ema.identification.doubtful_modes import DroppedColumn, Stability, dropped_columns, stability
from ema.identification.stabilization import StabilizationDiagram, stabilization
from ema.plot import palette
from ema.plot.figures import pole_groups, stabilization_figure
from ema.types.frf import FRF
from ema.types.modal_model import ModalModel
from updating.report.chart_part import axis, chart, legend_above, single
from updating.report.part import Picture, Table, as_csv, png
from updating.report.results import Tested

_SYMBOLS = (
    {"symbol": "circle", "size": 2.5, "color": palette.QUIET},
    {
        "symbol": "x-thin",
        "size": 5,
        "color": palette.MEASURED,
        "line": {"width": 1.2, "color": palette.MEASURED},
    },
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
        diagram.cluster, *(own.astype(int) for own in (stable.frequency, stable.damping, stable.shape)), strict=True,
    )  # fmt: skip
    return Picture(
        name=f"stabilization_{tested.name}",
        content=png(stabilization_figure(diagram, stability=stable)),
        form="png",
        data=as_csv(
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
        chart=stabilization_chart(diagram, stable, dropped, tested.measured),
    )  # fmt: skip


def stabilization_chart(
    diagram: StabilizationDiagram,
    stable: Stability,
    dropped: Sequence[DroppedColumn],
    modal_model: ModalModel,
) -> str:
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
    marks += [(own.frequency, "dot", palette.QUIET) for own in dropped]
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
                "x": own.frequency, "y": 1, "yref": "paper", "text": "✕", "showarrow": False, "yanchor": "bottom",
                "hovertext": own.reason, "font": {"color": palette.ACCENT},
            }
            for own in dropped
        ],
    }  # fmt: skip
    return chart(traces, layout)


def dropped_table(dropped: Sequence[DroppedColumn]) -> Table:
    """List the columns that are no mode."""
    return Table(
        title="Columns that are no mode",
        header=("column [Hz]", "why it was not taken"),
        rows=tuple((f"{own.frequency:.1f}", own.reason) for own in dropped),
    )
