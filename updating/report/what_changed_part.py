"""What changed, and where: the answer in words, the kinds that were weighed, and the map of the location."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ema.plot import palette
from updating.report.chart_part import axis, chart, single
from updating.report.part import Picture, Section, Table, as_csv, svg
from updating.results.what_changed import KindOfChange, WhatChanged
from updating.results.what_changed_text import size_text

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MOST_KINDS = 8


def what_changed_section(found: WhatChanged) -> Section:
    """Show what changed in a state, where, and what else was weighed."""
    named = found.verdict in ("identified", "one of", "partly explained")
    blocks = (map_picture(found), kind_table(found)) if named else (kind_table(found),)
    return Section(title=f"What changed in {found.name}, and where", text=found.sentences, blocks=blocks)


def kind_table(found: WhatChanged) -> Table:
    """List the likeliest kinds of change."""
    return Table(
        title="Kinds of change",
        header=("kind", "log odds", "probability", "x [mm]", "y [mm]", "size", "explained [%]"),
        rows=tuple(
            (
                own.label,
                f"{own.log_odds:.1f}",
                f"{own.probability:.2g}",
                _place(own, 0),
                _place(own, 1),
                size_text(own),
                f"{100 * own.explained:.0f}",
            )
            for own in found.kinds[:_MOST_KINDS]
        ),
        note="Log odds: natural logarithm of the posterior odds against no change beyond the scatter of assembly. "
        "Explained: share of the misfit beyond that scatter. "
        + (
            "Cannot be: "
            + "; ".join(f"{name}, {why}" for name, why in sorted(found.impossible.items()))
            + "."
            if found.impossible
            else ""
        ),
    )


def _place(own: KindOfChange, axis_: int) -> str:
    if not own.local:
        return "all over"
    return f"{1e3 * own.place[axis_]:.0f} ± {1e3 * own.place_std[axis_]:.0f}"


def map_picture(found: WhatChanged) -> Picture:
    """Draw the probability of the location over the plan."""
    x, y = np.meshgrid(found.x, found.y, indexing="ij")
    i, j = np.unravel_index(int(np.argmax(found.map)), found.map.shape)
    return Picture(
        name=f"what_changed_{found.name}",
        content=svg(map_figure(found)),
        form="svg",
        data=as_csv(
            ("x [m]", "y [m]", "probability of the cell"),
            zip(x.ravel(), y.ravel(), found.map.ravel(), strict=True),
        ),
        alt=f"Probability of the location of the change, largest at x = {1e3 * found.x[i]:.0f} mm, "
        f"y = {1e3 * found.y[j]:.0f} mm",
        caption="Where it changed: probability of each cell of the plan, given that one of the kinds that are left is "
        "right.",
        width="half",
        chart=map_chart(found),
    )


def map_chart(found: WhatChanged) -> str:
    """Return the probability of the location as a chart."""
    traces = [
        {
            "type": "heatmap", "x": single(1e3 * found.x), "y": single(1e3 * found.y), "z": single(100.0 * found.map.T),
            "colorscale": palette.PLACE, "zmin": 0.0, "colorbar": {"title": {"text": "%"}, "thickness": 10},
            "hovertemplate": "x = %{x:.0f} mm, y = %{y:.0f} mm: %{z:.2g} %<extra></extra>",
        }
    ]  # fmt: skip
    (x0, x1), (y0, y1) = 1e3 * found.box
    return chart(
        traces,
        {
            "xaxis": axis("x [mm]", range=[x0, x1]),
            "yaxis": axis("y [mm]", range=[y0, y1], scaleanchor="x"),
            "margin": {"r": 8, "t": 20},
        },
    )


def map_figure(found: WhatChanged) -> Figure:
    """Draw the same for print."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(5.0, 3.8), layout="constrained")
    axes = figure.subplots()
    (x0, x1), (y0, y1) = 1e3 * found.box
    drawn = axes.imshow(
        100.0 * found.map.T,
        origin="lower",
        extent=(x0, x1, y0, y1),
        cmap=palette.PLACE,
        vmin=0.0,
        aspect="equal",
    )
    axes.set(xlabel="x [mm]", ylabel="y [mm]")
    figure.colorbar(drawn, ax=axes, label="probability [%]", shrink=0.7)
    return figure
