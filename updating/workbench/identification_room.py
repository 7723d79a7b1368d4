"""The room of the identification: poles taken and dropped in the stabilisation chart, and what they stand for."""

from __future__ import annotations

import asyncio
import shlex
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ema.identification.exchange import read_poles, write_poles
from ema.identification.stabilization import highest_order
from ema.plot import palette
from ema.types.errors import EmaError
from ema.types.frf import FRF
from ema.types.modal_model import frequency_text
from updating.errors import UpdatingError
from updating.fitting.shape_plot import lone_shape
from updating.report.results import Tested
from updating.results.chosen_poles import keep_choice
from updating.workbench.campaign_edit import write_identification
from updating.workbench.identification_charts import (
    diagram_chart,
    fitted_charts,
    pole_of,
    runs_chart,
    shape_of,
    toggled,
)
from updating.workbench.opened import Opened
from updating.workbench.page import empty, figure, plot
from updating.workbench.shapes import moving_page, moving_shapes

TITLE, ICON = "Identification", "mdi-chart-scatter-plot"
_LEAST_LINES = 40  # of a band
_REST = 0.3  # s, after which a handle that was moved rests
_ORDERS = (10, 120)  # that can be asked for


def room(server: Any, opened: Opened) -> None:
    """Keep the room's state right."""
    server.state.update(
        {
            "stabilization": empty(), "poles": [], "synthesis": empty(), "auto_mac": empty(), "poles_text": "",
            "band": [0.0, 1.0], "lines": [0.0, 1.0], "order": _ORDERS[0], "pole_shape": "", "pole_text": "",
            "runs": empty(), "has_runs": False,
        }
    )  # fmt: skip
    own = _Picking(server, opened)
    controller = server.controller
    controller.toggle_pole = own.toggle
    controller.show_pole = own.show
    controller.write_poles = own.write
    controller.identify_again = own.identify

    @server.state.change("room", "configuration")
    def enter(room: str, **_: Any) -> None:
        if room == TITLE:
            own.begin()

    @server.state.change("point")
    def choose_point(**_: Any) -> None:
        own.draw()

    @server.state.change("band", "order")
    async def move_handle(**_: Any) -> None:
        await own.settle()


class _Picking:
    """The choice of poles of one configuration, as state."""

    def __init__(self, server: Any, opened: Opened) -> None:
        self.server, self.state, self.opened = server, server.state, opened
        self._pole = np.empty(0, dtype=complex)
        self._tested: Tested | None = None
        self._lines: FRF | None = None
        self._order = 0  # that the identification had
        self._moves = 0  # of the handles
        self._drawn: tuple[float, float, int] | None = None  # band and order of the chart

    def begin(self) -> None:
        """Begin with the poles that are written, or those that were identified."""
        self._tested = tested = self.opened.tested(self.state.configuration)
        if not tested.has_functions:
            self._tested = self._lines = None
            self.state.update(
                {"stabilization": empty(), "synthesis": empty(), "auto_mac": empty(), "poles": []}
            )
            self.state.poles_text = f"{tested.name}: {tested.no_functions}."
            return
        frf, measured = tested.frf(), tested.measured
        file = tested.folder / "poles.txt"
        self._pole = read_poles(file) if file.exists() else np.array(measured.pole)
        state, above = self.state, frf.frequency[frf.frequency > 0.0]
        state.lines = [float(above[0]), float(above[-1])]
        state.band = [
            max(float(measured.band[0]), state.lines[0]),
            min(float(measured.band[1]), state.lines[1]),
        ]
        state.order = self._order = self._asked_order(frf.band(*measured.band).frequency.size)
        state.has_runs = measured.run.size > 1
        if state.has_runs:
            state.runs = figure(runs_chart(measured))
        state.poles_text = ""
        if measured.frequency.size:
            dofs = frf.by_reciprocity().output
            first = lone_shape(measured.geometry, dofs, measured.shape[:, 0], float(measured.frequency[0]))
            state.pole_shape = moving_page(first, None)
            state.pole_text = f"Shape of the mode at {frequency_text(measured.frequency[0], 1)} Hz"
        self.stabilize()

    def _asked_order(self, n_line: int) -> int:
        """Return the highest model order that the identification had."""
        asked = self.opened.stated().identification.order
        return asked if asked is not None else highest_order(n_line)

    async def settle(self) -> None:
        """Draw the chart anew once the handles of band and order rest."""
        self._moves += 1
        mine = self._moves
        await asyncio.sleep(_REST)
        if mine == self._moves and self._tested is not None and self._drawn != self._handles():
            with self.state:
                self.stabilize()

    def _handles(self) -> tuple[float, float, int]:
        low, high = self.state.band
        return low, high, int(self.state.order)

    def stabilize(self) -> None:
        """Draw the stabilisation chart of the band and the order that are set."""
        if self._tested is None:
            return
        state, all_lines = self.state, self._tested.frf().by_reciprocity()
        lines = all_lines.band(*state.band)
        if lines.frequency.size < _LEAST_LINES:
            state.poles_text = (
                f"The band has {lines.frequency.size} lines; widen it to {_LEAST_LINES} at least."
            )
            return
        state.order = min(int(state.order), lines.frequency.size // 3)
        try:
            drawn = diagram_chart(self._tested, lines, state.order)
        except EmaError as error:
            state.poles_text = str(error)
            return
        self._lines, self._drawn, state.poles_text = lines, self._handles(), ""
        state.stabilization = figure(drawn)
        self.draw()

    def _inside(self) -> NDArray[np.complex128]:
        hertz = np.abs(self._pole) / (2.0 * np.pi)
        return self._pole[(hertz >= self.state.band[0]) & (hertz <= self.state.band[1])]

    def draw(self) -> None:
        """Show the poles, and what they stand for."""
        if self._lines is None:
            return
        state, pole = self.state, self._inside()
        state.poles = [
            {"hertz": float(abs(p) / (2.0 * np.pi)), "percent": float(-100.0 * p.real / abs(p))} for p in pole
        ]
        own = dict(state.stabilization)
        kept = [s for s in own["layout"].get("shapes", []) if s.get("name") != "chosen"]
        marks = [
            {
                "type": "line", "name": "chosen", "x0": p["hertz"], "x1": p["hertz"], "yref": "paper", "y0": 0.97,
                "y1": 1, "line": {"color": palette.ACCENT, "width": 6},
            }
            for p in state.poles
        ]  # fmt: skip
        state.stabilization = {
            **own,
            "layout": {**own["layout"], "shapes": [*kept, *marks], "uirevision": str(state.band)},
        }
        if pole.size:
            synthesis, likeness = fitted_charts(self._lines, pole, state.point)
            state.synthesis, state.auto_mac = figure(synthesis), figure(likeness)

    def toggle(self, hertz: float, percent: float | None) -> None:
        """Take a pole, or drop it; a click beside the poles says no damping ratio."""
        if percent is not None:
            self._pole = toggled(self._pole, hertz, percent)
            self.draw()

    def show(self, hertz: float, percent: float | None) -> None:
        """Show the shape of the pole under the cursor."""
        if percent is None or self._tested is None or self._lines is None:
            return
        numbers = shape_of(self._tested, self._lines, self._inside(), pole_of(hertz, percent))
        self.server.controller.send_pole_shape({"pair": numbers})
        self.state.pole_text = f"Shape of the pole at {frequency_text(hertz, 2)} Hz, {percent:.3g} %"

    def write(self) -> Sequence[str]:
        """Write poles.txt, and band and order into the campaign file; return the command that reads them."""
        path = self.opened.tested(self.state.configuration).folder / "poles.txt"
        write_poles(path, self._inside())
        keep_choice(path, path.parent)
        written = [str(path)]
        if self._changed():
            write_identification(self.opened.campaign, tuple(self.state.band), int(self.state.order))
            written.append(f"{self.opened.campaign}, in it band and order")
        folder = str(self.opened.folder)
        words = ["ema", str(self.opened.campaign), "-o", folder, "--poles", folder]
        self.state.poles_text = (
            f"Written to {' and '.join(written)}. Identify with them: {shlex.join(['lamella', *words])}"
        )
        return words

    def _changed(self) -> bool:
        """Whether band or order are others than those that the identification had."""
        if self._tested is None:
            return False
        return not np.allclose(self.state.band, self._tested.measured.band) or self.state.order != self._order

    def identify(self) -> None:
        """Write the poles and identify with them."""
        try:
            words = self.write()
        except (EmaError, UpdatingError) as error:
            self.state.poles_text = str(error)
            return
        self.server.controller.run_command(words)


def show(server: Any) -> None:
    """Put the room into the page."""
    from trame.widgets import html, vuetify3

    controller = server.controller
    html.P(
        "Click a pole to take it; click a column that is taken, or close its chip, to drop it. The cursor on a pole "
        "shows its shape. The functions are those of the point of the room Measurement.",
        classes="text-body-2",
    )
    with html.Div(classes="d-flex flex-wrap ga-6 mt-2", id="handles"):
        vuetify3.VRangeSlider(
            v_model=("band",), min=("lines[0]",), max=("lines[1]",), step=("(lines[1] - lines[0]) / 1000",),
            label="Band", hide_details=True, density="compact",
            style="min-width: 280px; flex: 3",
        )  # fmt: skip
        html.Span("{{ band[0].toFixed(1) }} to {{ band[1].toFixed(1) }} Hz", classes="align-self-center")
        vuetify3.VSlider(
            v_model=("order",), min=_ORDERS[0], max=_ORDERS[1], step=2, label="Order",
            hide_details=True, density="compact", style="min-width: 180px; flex: 1",
        )  # fmt: skip
        html.Span("{{ order }}", classes="align-self-center")
    with vuetify3.VRow():
        with vuetify3.VCol(cols=12, md=8):
            plot(
                "stabilization",
                440,
                controller.toggle_pole,
                "[$event.points[0].x, $event.points[0].customdata]",
                controller.show_pole,
            )
        with vuetify3.VCol(cols=12, md=4):
            html.P("{{ pole_text }}", classes="text-subtitle-1", id="pole-text")
            controller.send_pole_shape = moving_shapes("pole_shape", 445)
    with html.Div(classes="d-flex flex-wrap ga-1 align-center", id="poles"):
        vuetify3.VChip(
            "{{ own.hertz.toFixed(1) }} Hz, {{ own.percent.toPrecision(3) }} %", v_for="own in poles",
            key="own.hertz", closable=True, size="small",
            click_close=(controller.toggle_pole, "[own.hertz, own.percent]"),
        )  # fmt: skip
        vuetify3.VBtn(
            "Write poles.txt", click=controller.write_poles, disabled=("poles.length === 0",), id="write-poles",
        )  # fmt: skip
        vuetify3.VBtn(
            "Identify with these", click=controller.identify_again, disabled=("poles.length === 0 || !!running",),
            color="primary", id="identify",
        )  # fmt: skip
    html.P("{{ poles_text }}", classes="text-body-2 mt-2", id="poles-text")
    with vuetify3.VRow():
        with vuetify3.VCol(cols=12, md=7):
            plot("synthesis", 420)
        with vuetify3.VCol(cols=12, md=5):
            plot("auto_mac", 420)
        with vuetify3.VCol(cols=12, v_show="has_runs"):
            html.P("Frequencies of each run alone", classes="text-subtitle-1")
            plot("runs", 380)
