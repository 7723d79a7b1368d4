"""The panel of the measurement: the points on the structure, their functions, and the findings about them."""

from __future__ import annotations

import itertools
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ema.plot import palette
from ema.plot.figures import UNIT, synthesized
from ema.quality.verdict import NOTES, meaning
from ema.types.frf import FRF
from lamella_shared import Integers, Reals
from updating.report.modes_part import COMPLEXITY, complexity_table, identified_table
from updating.report.part import Chart, axis, single
from updating.report.results import Tested
from updating.results.text import Table
from updating.workbench.opened import Opened, cells, empty, figure, plot, table

TITLE, ICON = "Measurement", "mdi-access-point"


def points_chart(tested: Tested, chosen: int) -> Chart:
    """Draw the measured points with their directions, the force, the lines between points and the stack.

    Points with a finding and the chosen one have another colour. The last trace holds the points, in the order of
    `point_numbers`.
    """
    long, thin = 2.4, 0.3  # of the longest side as it is drawn, and the least of any: a beam is still seen
    geometry = tested.measured.geometry
    numbers = point_numbers(tested)
    row = {int(n): 1e3 * x for n, x in zip(geometry.node, geometry.coordinate, strict=True)}
    at = np.array([row[n] for n in numbers]).reshape(-1, 3)
    ends = 1e3 * geometry.coordinate[geometry.line_rows(geometry.node)]
    doubtful = {point for verdict in tested.quality.verdicts if verdict.level != "pass" for point in verdict.point}
    measured = tested.measured
    wires = [
        (ends, palette.QUIET, "lines"),
        (_arrows(row, measured.node, measured.direction), palette.MODES, "directions"),
        (_arrows(row, measured.input.node, measured.input.direction), palette.ACCENT, "force"),
    ]
    if tested.fit is not None and tested.fit.box is not None:
        wires.append((_edges(*tested.fit.box), palette.QUIET, "stack"))
    traces: list[dict[str, Any]] = [
        {
            "type": "scatter3d", "mode": "lines", "name": name, "hoverinfo": "skip", "showlegend": False,
            **dict(
                zip("xyz", (single(x) for x in np.insert(segments, 2, np.nan, axis=1).reshape(-1, 3).T), strict=True)
            ),
            "line": {"color": color, "width": 2},
        }
        for segments, color, name in wires
    ]  # fmt: skip
    colour = [palette.MODES if n == chosen else palette.ACCENT if n in doubtful else palette.MEASURED for n in numbers]
    traces.append(
        {
            "type": "scatter3d", "mode": "markers+text", "name": "points", "showlegend": False,
            **dict(zip("xyz", (single(x) for x in at.T), strict=True)), "text": [str(n) for n in numbers],
            "textfont": {"size": 9}, "hovertemplate": "point %{text}<extra></extra>",
            "marker": {"size": [8 if n == chosen else 5 for n in numbers], "color": colour},
        }
    )  # fmt: skip
    axes = {
        f"{a}axis": {"title": {"text": f"{a} [mm]"}, "nticks": n, "showspikes": False}
        for a, n in (("x", 5), ("y", 2), ("z", 2))  # few along the short sides, where numbers would overlap
    }
    corners = np.concatenate([at, *(segments.reshape(-1, 3) for segments, _, _ in wires)])
    span = np.ptp(corners, axis=0)
    ratio = np.maximum(long * span / span.max(), thin) if span.max() > 0.0 else np.ones(3)
    scene = {
        **axes,
        "aspectmode": "manual",
        "aspectratio": dict(zip("xyz", ratio.tolist(), strict=True)),
        "camera": {"eye": {"x": -1.3, "y": -2.6, "z": 1.3}, "center": {"x": -0.15, "y": 0.0, "z": -0.1}},
        "uirevision": "kept",
    }
    return Chart(
        traces=traces, layout={"scene": scene, "margin": {"l": 0, "r": 0, "t": 0, "b": 0}, "uirevision": "kept"}
    )


def _edges(*size: float) -> Reals:
    """Return the edges (12, 2, 3) of a box of some size (m) about the origin, mm."""
    corner = 500.0 * np.array(list(itertools.product(*((-s, s) for s in size))))
    pairs = [(i, i | bit) for i in range(8) for bit in (1, 2, 4) if not i & bit]
    return np.asarray(corner[np.array(pairs)])


def _arrows(place: Mapping[int, Reals], node: Integers, direction: Reals) -> Reals:
    """Return lines (n, 2, 3) from points, mm, along directions; points without coordinates have none."""
    arrow = 0.05  # of the longest side
    at = np.array(list(place.values()))
    length = arrow * float(np.ptp(at, axis=0).max())
    known = [(place[int(n)], along) for n, along in zip(node, np.asarray(direction), strict=True) if int(n) in place]
    return np.array([(start, start + length * along) for start, along in known]).reshape(-1, 2, 3)


def point_numbers(tested: Tested) -> list[int]:
    """Return the measured points that have coordinates, ascending."""
    measured = tested.measured
    return sorted({int(n) for n in measured.node} & {int(n) for n in measured.geometry.node})


def functions_chart(tested: Tested, frf: FRF, point: int) -> Chart:
    """Draw magnitude, phase and coherence of all functions of one point, with those of the modes over them."""
    lines, fitted = synthesized(frf, tested.measured)
    pairs = [(int(o), i) for o in np.flatnonzero(lines.output.node == point) for i in range(lines.input.node.size)]
    traces: list[dict[str, Any]] = []
    for k, (o, i) in enumerate(pairs):
        name = f"{lines.output.name(o)} over {lines.input.name(i)}"
        color, of_modes = (
            (palette.MEASURED, palette.MODES)  # of several, each has a colour of its own
            if len(pairs) == 1
            else (palette.SERIES[k % len(palette.SERIES)], palette.QUIET)
        )
        for value, label, style in (
            (lines.value[o, i], name, {"color": color, "width": 2}),
            (fitted[o, i], f"{name}, from the modes", {"color": of_modes, "width": 1, "dash": "dot"}),
        ):
            x = single(lines.frequency)
            traces += [
                {"type": "scatter", "x": x, "y": single(np.abs(value)), "name": label, "line": style},
                {
                    "type": "scatter", "x": x, "y": single(np.degrees(np.angle(value))), "name": label,
                    "yaxis": "y2", "showlegend": False, "mode": "markers",
                    "marker": {"size": 2.5, "color": style["color"]},
                },
            ]  # fmt: skip
        if lines.coherence is not None:
            traces.append(
                {
                    "type": "scatter", "x": single(lines.frequency), "y": single(lines.coherence[o, i]),
                    "name": "coherence", "yaxis": "y3", "showlegend": False, "line": {"color": color, "width": 1},
                }
            )  # fmt: skip
    layout: dict[str, Any] = {
        "hovermode": "x unified",
        "xaxis": axis("frequency [Hz]", anchor="y3" if lines.coherence is not None else "y2"),
        "yaxis": axis(UNIT[lines.quantity], type="log", exponentformat="power", domain=[0.48, 1.0]),
        "yaxis2": axis("phase [°]", tickvals=[-180, 0, 180], domain=[0.22, 0.42]),
    }
    if lines.coherence is not None:
        layout["yaxis3"] = axis("coherence", range=[0, 1.05], domain=[0.0, 0.16])
    else:
        layout["yaxis2"]["domain"] = [0.0, 0.4]
    return Chart(traces=traces, layout=layout)


def findings(tested: Tested, point: int) -> tuple[list[dict[str, str]], list[dict[str, str]]]:
    """Return the findings about one point, and those about the rest, each with the meaning of its check."""
    about: list[dict[str, str]] = []
    others: list[dict[str, str]] = []
    for verdict in tested.quality.verdicts:
        if verdict.level != "pass":
            (about if point in verdict.point else others).append({"text": verdict.text, "hint": meaning(verdict.check)})
    return about, [*others, *({"text": note, "hint": NOTES} for note in tested.quality.notes)]


def modes_table(tested: Tested) -> Table:
    """List the modes: frequency, damping, how complex each shape is, and whether it is too complex."""
    first, second = identified_table(tested), complexity_table(tested)
    k = second.header.index("MPC")
    rows = [(*a, *b[k:]) for a, b in zip(first.rows, second.rows, strict=True)]
    return Table("", (*first.header, *second.header[k:]), rows)


def sources(frf: FRF, point: int, folder: Path) -> list[str]:
    """Return which file each function of a point comes from, those in the campaign's folder as seen from there."""
    outputs = np.flatnonzero(frf.output.node == point)
    start = f"{folder.resolve()}{os.sep}"
    return [f"{frf.output.name(int(o))}: run {frf.run[o] + 1}, {frf.source[o].removeprefix(start)}" for o in outputs]


def panel(server: Any, opened: Opened) -> None:
    """Set up the panel's state and what its controls call."""
    state = server.state
    state.update(
        {
            "points": empty(), "functions": empty(), "point": 0, "point_list": [], "about": [], "others": [],
            "files": [], "modes": {"header": [], "rows": []},
        }
    )  # fmt: skip

    @state.change("configuration")
    def choose_configuration(configuration: str, **_: Any) -> None:
        tested = opened.tested(configuration)
        numbers = point_numbers(tested)
        state.modes = cells(modes_table(tested))
        state.point_list = numbers
        if state.point not in numbers:
            state.point = numbers[0] if numbers else 0
        draw(configuration, state.point)

    @state.change("point")
    def choose_point(configuration: str, point: int, **_: Any) -> None:
        if configuration and point in state.point_list:
            draw(configuration, point)

    def draw(configuration: str, point: int) -> None:
        tested = opened.tested(configuration)
        if not state.point_list:
            return
        state.points = figure(points_chart(tested, point))
        if tested.has_functions:
            frf = tested.frf()
            state.functions = figure(functions_chart(tested, frf, point))
            state.files = sources(frf.by_reciprocity(), point, opened.campaign.parent)
        else:
            state.functions, state.files = empty(), [f"None: {tested.no_functions}"]
        state.about, state.others = findings(tested, point)


def show(server: Any) -> None:
    """Put the panel into the page."""
    from trame.widgets import html, vuetify3

    state = server.state

    def clicked(number: int, trace: int) -> None:
        if trace == len(state.points["data"]) - 1 and 0 <= number < len(state.point_list):
            state.point = state.point_list[number]

    with vuetify3.VRow():
        with vuetify3.VCol(cols=12, md=6):
            vuetify3.VSelect(
                v_model=("point",), items=("point_list",), label="Point (or click one below)", density="compact",
                hide_details=True, id="point",
            )  # fmt: skip
            plot("points", 430, clicked, solid=True)
            html.P(
                "Lines from points: the measured directions in blue, that of the force in red. Red points have a "
                "finding, the large blue one is chosen. Grey: the stack and the lines between points.",
                classes="text-caption",
            )
        with vuetify3.VCol(cols=12, md=6):
            plot("functions", 480)
    _list("Files of this point", "files", "Its functions are not stored.")
    _list("About this point", "about", "Nothing was found about this point.")
    _list("About the measurement", "others", "Nothing was found about the rest.")
    html.H2("Modes", classes="text-subtitle-1 mt-2")
    table("modes", "modes")
    html.P(f"± is half the 95 % interval. {COMPLEXITY}", classes="text-caption")


def _list(title: str, key: str, none: str) -> Sequence[Any]:
    from trame.widgets import html

    return (
        html.H2(title, classes="text-subtitle-1 mt-2"),
        html.Ul(
            f'<li v-for="line in {key}" :key="line.text ?? line" :title="line.hint">{{{{ line.text ?? line }}}}</li>',
            classes="ml-5 text-body-2",
            id=key,
        ),
        html.P(none, v_if=f"{key}.length === 0", classes="text-body-2"),
    )
