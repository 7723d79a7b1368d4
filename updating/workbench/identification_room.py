"""The room of the identification: poles taken and dropped in the stabilisation chart, and what they stand for."""

from __future__ import annotations

import shlex
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ema.identification.columns import dropped_columns, stability
from ema.identification.maximum_likelihood import linear_fit
from ema.identification.poles_file import read_poles, write_poles
from ema.identification.stabilization import stabilization
from ema.modal.mac import mac
from ema.plot.figures import UNIT
from ema.types.frf import FRF
from updating.report.chart_part import ACCENT, FITTED, LEFT, MEASURED, axis, chart, legend_above, single
from updating.report.modes_part import mac_chart
from updating.report.results import Tested
from updating.report.stabilization_part import stabilization_chart
from updating.workbench.opened import Opened
from updating.workbench.page import empty, figure, plot

TITLE, ICON = "Identification", "mdi-chart-scatter-plot"
_SAME = 2e-3  # relative distance of frequencies within which a click is on a pole that is taken already


def diagram_chart(tested: Tested, lines: FRF) -> str:
    """Draw the stabilisation chart of the identified band."""
    diagram = stabilization(lines)
    measured = tested.measured
    return stabilization_chart(
        diagram, stability(diagram, lines), dropped_columns(diagram, lines, measured), measured
    )


def toggled(pole: NDArray[np.complex128], hertz: float, percent: float) -> NDArray[np.complex128]:
    """Return chosen poles (rad/s) with one more, or without the one that is there already."""
    damping = percent / 100.0
    new = 2.0 * np.pi * hertz * complex(-damping, np.sqrt(1.0 - damping**2))
    near = np.abs(np.abs(pole) / abs(new) - 1.0) < _SAME
    return pole[~near] if near.any() else np.array(sorted([*pole, new], key=abs))


def fitted_charts(lines: FRF, pole: NDArray[np.complex128], point: int) -> tuple[str, str]:
    """Draw the first function of a point with what the poles make of it, and the MAC of their shapes with each other.

    Residues are fitted at these poles to all functions at the first input (LSFD), as the identification begins.
    """
    value = lines.value[:, 0]
    fit = linear_fit(lines.frequency, value, pole, lines.quantity)
    o = int(np.flatnonzero(lines.output.node == point)[0]) if np.any(lines.output.node == point) else 0
    curves = (
        ("difference", np.abs(fit.residual[o]), {"color": LEFT, "width": 1}),
        ("measured", np.abs(value[o]), {"color": MEASURED, "width": 2.5}),
        ("from the chosen poles", np.abs(value[o] - fit.residual[o]), {"color": FITTED, "width": 1.5}),
    )
    traces = [
        {"type": "scatter", "x": single(lines.frequency), "y": single(y), "name": name, "line": style}
        for name, y, style in curves
    ]
    layout = {
        "xaxis": axis("frequency [Hz]"),
        "yaxis": axis(
            f"{lines.output.name(o)} over {lines.input.name(0)} [{UNIT[lines.quantity]}]",
            type="log",
            exponentformat="power",
        ),
        "hovermode": "x unified",
        "legend": legend_above(),
        "margin": {"r": 8, "t": 30},
    }
    frequency = np.abs(pole) / (2.0 * np.pi)
    likeness = mac(fit.residue, fit.residue)
    return chart(traces, layout), mac_chart(likeness, frequency, frequency, "chosen", "chosen")


def room(server: Any, opened: Opened) -> None:
    """Keep the room's state right."""
    server.state.update(
        {"stabilization": empty(), "poles": [], "synthesis": empty(), "auto_mac": empty(), "poles_text": ""}
    )
    own = _Picking(server.state, opened)
    server.controller.toggle_pole = own.toggle
    server.controller.write_poles = own.write

    @server.state.change("room", "configuration")
    def enter(room: str, **_: Any) -> None:
        if room == TITLE:
            own.begin()

    @server.state.change("point")
    def choose_point(**_: Any) -> None:
        own.draw()


class _Picking:
    """The choice of poles of one configuration, as state."""

    def __init__(self, state: Any, opened: Opened) -> None:
        self.state, self.opened = state, opened
        self._pole = np.empty(0, dtype=complex)
        self._lines: FRF | None = None

    def begin(self) -> None:
        """Begin with the poles that are written, or those that were identified."""
        tested = self.opened.tested(self.state.configuration)
        self._lines = tested.frf().band(*tested.measured.band)
        file = tested.folder / "poles.txt"
        self._pole = read_poles(file) if file.exists() else np.array(tested.measured.pole)
        self.state.stabilization = figure(diagram_chart(tested, self._lines))
        self.state.poles_text = ""
        self.draw()

    def draw(self) -> None:
        """Show the poles, and what they stand for."""
        if self._lines is None:
            return
        state, pole = self.state, self._pole
        state.poles = [
            {"hertz": float(abs(p) / (2.0 * np.pi)), "percent": float(-100.0 * p.real / abs(p))} for p in pole
        ]
        own = dict(state.stabilization)
        kept = [s for s in own["layout"].get("shapes", []) if s.get("name") != "chosen"]
        marks = [
            {
                "type": "line", "name": "chosen", "x0": p["hertz"], "x1": p["hertz"], "yref": "paper", "y0": 0.97,
                "y1": 1, "line": {"color": ACCENT, "width": 6},
            }
            for p in state.poles
        ]  # fmt: skip
        state.stabilization = {
            **own,
            "layout": {**own["layout"], "shapes": [*kept, *marks], "uirevision": "kept"},
        }
        if pole.size:
            synthesis, likeness = fitted_charts(self._lines, pole, state.point)
            state.synthesis, state.auto_mac = figure(synthesis), figure(likeness)

    def toggle(self, hertz: float, percent: float | None) -> None:
        """Take a pole, or drop it; a click beside the poles says no damping ratio."""
        if percent is not None:
            self._pole = toggled(self._pole, hertz, percent)
            self.draw()

    def write(self) -> None:
        """Write poles.txt, which the identification reads."""
        path = self.opened.tested(self.state.configuration).folder / "poles.txt"
        write_poles(path, self._pole)
        folder = str(self.opened.folder)
        words = ["lamella", "ema", str(self.opened.campaign), "-o", folder, "--poles", folder]
        self.state.poles_text = f"Written to {path}. Identify with them: {shlex.join(words)}"


def show(server: Any) -> None:
    """Put the room into the page."""
    from trame.widgets import html, vuetify3

    controller = server.controller
    html.P(
        "Click a pole to take it; click a column that is taken, or close its chip, to drop it. The functions are those "
        "of the point of the room Measurement.",
        classes="text-body-2",
    )
    plot("stabilization", 440, controller.toggle_pole, "[$event.points[0].x, $event.points[0].customdata]")
    with html.Div(classes="d-flex flex-wrap ga-1 align-center", id="poles"):
        vuetify3.VChip(
            "{{ own.hertz.toFixed(1) }} Hz, {{ own.percent.toPrecision(3) }} %", v_for="own in poles",
            key="own.hertz", closable=True, size="small",
            click_close=(controller.toggle_pole, "[own.hertz, own.percent]"),
        )  # fmt: skip
        vuetify3.VBtn(
            "Write poles.txt", click=controller.write_poles, disabled=("poles.length === 0",), id="write-poles",
        )  # fmt: skip
    html.P("{{ poles_text }}", classes="text-body-2 mt-2", id="poles-text")
    with vuetify3.VRow():
        with vuetify3.VCol(cols=12, md=7):
            plot("synthesis", 420)
        with vuetify3.VCol(cols=12, md=5):
            plot("auto_mac", 420)
