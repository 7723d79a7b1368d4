"""The panel of poles: the stabilisation chart of a configuration, and poles chosen in it."""

from __future__ import annotations

import asyncio
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit
from tomlkit.exceptions import TOMLKitError

from ema.identification.doubtful_modes import dropped_columns, stability
from ema.identification.exchange import read_poles, write_poles
from ema.identification.maximum_likelihood import linear_fit
from ema.identification.stabilization import highest_order, stabilization
from ema.modal.mac import mac
from ema.plot import palette
from ema.plot.figures import UNIT
from ema.types.errors import EmaError
from ema.types.frf import FRF
from ema.types.modal_model import ModalModel, frequency_text
from lamella_shared import Booleans, Complexes, plain_bytes
from updating.errors import StoreError, UpdatingError
from updating.fitting.plots import lone_shape
from updating.report.frf_part import stabilization_chart
from updating.report.modes_part import mac_chart, shape_numbers
from updating.report.part import Chart, axis, single
from updating.report.results import Tested
from updating.results.identified import keep_choice
from updating.results.store import write_bytes
from updating.results.text import Z95
from updating.workbench.opened import Opened, empty, figure, moving_page, moving_shapes, plot


def diagram_chart(tested: Tested, lines: FRF, order: int) -> Chart:
    """Draw the stabilisation chart of a band."""
    diagram = stabilization(lines, order=order)
    measured = tested.measured
    return stabilization_chart(diagram, stability(diagram, lines), dropped_columns(diagram, lines, measured), measured)


def toggled(pole: Complexes, hertz: float, percent: float) -> Complexes:
    """Return chosen poles (rad/s) with a further one, or without it where it is among them already."""
    new = pole_of(hertz, percent)
    near = _near(pole, new)
    return pole[~near] if near.any() else np.array(sorted([*pole, new], key=abs))


def pole_of(hertz: float, percent: float) -> complex:
    """Return the pole (rad/s) of a natural frequency (Hz) and a damping ratio (%)."""
    damping = percent / 100.0
    return complex(2.0 * np.pi * hertz * complex(-damping, np.sqrt(1.0 - damping**2)))


def _near(pole: Complexes, new: complex) -> Booleans:
    same = 2e-3  # relative distance of frequencies within which a click is on a pole that is taken already
    return np.abs(np.abs(pole) / abs(new) - 1.0) < same


def fitted_charts(lines: FRF, pole: Complexes, point: int) -> tuple[Chart, Chart]:
    """Draw the first function of a point with its fit at the poles, and the MAC of their shapes with each other.

    Residues are fitted at these poles to all functions at the first input (LSFD), as the identification begins.
    """
    value = lines.value[:, 0]
    fit = linear_fit(lines.frequency, value, pole, lines.quantity)
    o = int(np.flatnonzero(lines.output.node == point)[0]) if np.any(lines.output.node == point) else 0
    curves = (
        ("difference", np.abs(fit.residual[o]), {"color": palette.LEFT, "width": 1}),
        ("measured", np.abs(value[o]), {"color": palette.MEASURED, "width": 2.5}),
        ("from the chosen poles", np.abs(value[o] - fit.residual[o]), {"color": palette.MODES, "width": 1.5}),
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
    }
    frequency = np.abs(pole) / (2.0 * np.pi)
    likeness = mac(fit.residue, fit.residue)
    return Chart(traces=traces, layout=layout), mac_chart(likeness, frequency, frequency, "chosen", "chosen")


def shape_of(tested: Tested, lines: FRF, pole: Complexes, new: complex) -> dict[str, Any]:
    """Return the shape of a pole, fitted together with the chosen ones, in the form of the page of moving shapes."""
    others = pole[~_near(pole, new)]
    fit = linear_fit(lines.frequency, lines.value[:, 0], np.array([*others, new]), lines.quantity)
    hertz = abs(new) / (2.0 * np.pi)
    return shape_numbers(lone_shape(tested.measured.geometry, lines.output, fit.residue[:, -1], hertz))


def runs_chart(measured: ModalModel) -> Chart:
    """Draw how far the frequency of each mode is in each run from its mean over the runs, with 95 % intervals."""
    hertz = np.abs(measured.run_pole) / (2.0 * np.pi)
    mean = hertz.mean(axis=0)
    traces = [
        {
            "type": "scatter", "mode": "markers", "name": f"{r + 1}: {frequency_text(mean[r], 1)} Hz",
            "x": (measured.run + 1).tolist(), "y": single(100.0 * (hertz[:, r] / mean[r] - 1.0)), "marker": {"size": 5},
            "error_y": {
                "type": "data", "array": single(100.0 * Z95 * measured.run_frequency_std[:, r] / mean[r]),
                "thickness": 1, "width": 2,
            },
        }
        for r in range(mean.size)
    ]  # fmt: skip
    return Chart(
        traces=traces,
        layout={
            "xaxis": axis("run"),
            "yaxis": axis("frequency off the mean of the runs [%]", zeroline=True),
            "legend": {"orientation": "v"},
        },
    )


_SECTION = "identification"


def write_identification(campaign: Path, band: tuple[float, float], order: int) -> None:
    """Set `band_Hz` and `order` of a campaign file.

    Parameters
    ----------
    campaign : Path
        The file; its comments and all else stay.
    band : (float, float)
        Frequency band, Hz.
    order : int
        Highest model order.

    Raises
    ------
    StoreError
        The file cannot be read or written.
    """
    try:
        content = tomlkit.parse(plain_bytes(campaign).decode("utf-8-sig"))
    except (OSError, UnicodeDecodeError, TOMLKitError) as error:
        raise StoreError(f"{campaign}: cannot be read: {error}") from error
    section = content.setdefault(_SECTION, tomlkit.table())
    section["band_Hz"] = list(band)
    section["order"] = order
    write_bytes(campaign, tomlkit.dumps(content).encode())


TITLE, ICON = "Identification", "mdi-chart-scatter-plot"


_ORDERS = (10, 120)  # that can be asked for


def panel(server: Any, opened: Opened) -> None:
    """Set up the panel's state and what its controls call."""
    server.state.update(
        {
            "stabilization": empty(), "poles": [], "synthesis": empty(), "auto_mac": empty(), "poles_text": "",
            "band": [0.0, 1.0], "lines": [0.0, 1.0], "order": _ORDERS[0], "pole_shape": "", "pole_text": "",
            "runs": empty(), "has_runs": False, "stabilizing": True,
        }
    )  # fmt: skip
    picking = _Picking(server, opened)
    controller = server.controller
    controller.toggle_pole = picking.toggle
    controller.show_pole = picking.show
    controller.write_poles = picking.write
    controller.identify_again = picking.identify

    @server.state.change("panel", "configuration")
    def enter(panel: str, **_: Any) -> None:
        # what the panel holds may be of another configuration until it is entered
        server.state.stabilizing = True
        if panel == TITLE:
            asyncio.get_running_loop().create_task(picking.enter())

    @server.state.change("point")
    def choose_point(**_: Any) -> None:
        picking.draw()

    @server.state.change("band", "order")
    async def move_handle(**_: Any) -> None:
        await picking.settle()


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

    async def enter(self) -> None:
        """Begin once the page shows that it does not yet hold the configuration."""
        sent = 0.05  # s, in which the page gets what has changed: what follows leaves it no time
        await asyncio.sleep(sent)
        with self.state as state:
            try:
                self.begin()
            finally:
                state.stabilizing = False

    def begin(self) -> None:
        """Begin with the poles that are written, or those that were identified."""
        self._tested = tested = self.opened.tested(self.state.configuration)
        if not tested.has_functions:
            self._tested = self._lines = None
            self.state.update({"stabilization": empty(), "synthesis": empty(), "auto_mac": empty(), "poles": []})
            self.state.poles_text = f"{tested.name}: {tested.no_functions}."
            return
        frf, measured = tested.frf(), tested.measured
        file = tested.folder / "poles.txt"
        self._pole = read_poles(file) if file.exists() else np.array(measured.pole)
        state, above = self.state, frf.frequency[frf.frequency > 0.0]
        state.lines = [float(above[0]), float(above[-1])]
        state.band = [max(float(measured.band[0]), state.lines[0]), min(float(measured.band[1]), state.lines[1])]
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
        order = self.opened.stated().identification.order
        return order if order is not None else highest_order(n_line)

    async def settle(self) -> None:
        """Draw the chart again once the handles of band and order no longer move."""
        rest = 0.3  # s, after which a handle that was moved rests
        self._moves += 1
        move = self._moves
        await asyncio.sleep(rest)
        if move == self._moves and self._tested is not None and self._drawn != self._handles():
            with self.state:
                self.stabilize()

    def _handles(self) -> tuple[float, float, int]:
        low, high = self.state.band
        return low, high, int(self.state.order)

    def stabilize(self) -> None:
        """Draw the stabilisation chart of the band and the order that are set."""
        least_lines = 40  # of a band
        if self._tested is None:
            return
        state, all_lines = self.state, self._tested.frf().by_reciprocity()
        lines = all_lines.band(*state.band)
        if lines.frequency.size < least_lines:
            state.poles_text = f"The band has {lines.frequency.size} lines; widen it to {least_lines} at least."
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

    def _inside(self) -> Complexes:
        hertz = np.abs(self._pole) / (2.0 * np.pi)
        return self._pole[(hertz >= self.state.band[0]) & (hertz <= self.state.band[1])]

    def draw(self) -> None:
        """Show the poles in the chart and the list, the functions fitted at them, and their MAC."""
        if self._lines is None:
            return
        state, pole = self.state, self._inside()
        state.poles = [
            {"hertz": float(abs(p) / (2.0 * np.pi)), "percent": float(-100.0 * p.real / abs(p))} for p in pole
        ]
        diagram = dict(state.stabilization)
        kept = [s for s in diagram["layout"].get("shapes", []) if s.get("name") != "chosen"]
        marks = [
            {
                "type": "line", "name": "chosen", "x0": p["hertz"], "x1": p["hertz"], "yref": "paper", "y0": 0.97,
                "y1": 1, "line": {"color": palette.ACCENT, "width": 6},
            }
            for p in state.poles
        ]  # fmt: skip
        state.stabilization = {
            **diagram,
            "layout": {**diagram["layout"], "shapes": [*kept, *marks], "uirevision": str(state.band)},
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
        arguments = ["ema", str(self.opened.campaign), "-o", folder, "--poles", folder]
        self.state.poles_text = (
            f"Written to {' and '.join(written)}. Identify with them: {shlex.join(['lamella', *arguments])}"
        )
        return arguments

    def _changed(self) -> bool:
        """Whether band or order differ from those of the identification."""
        if self._tested is None:
            return False
        return not np.allclose(self.state.band, self._tested.measured.band) or self.state.order != self._order

    def identify(self) -> None:
        """Write the poles and identify with them."""
        try:
            arguments = self.write()
        except (EmaError, UpdatingError) as error:
            self.state.poles_text = str(error)
            return
        self.server.controller.run_command(arguments)


def show(server: Any) -> None:
    """Put the panel into the page."""
    from trame.widgets import html, vuetify3

    controller = server.controller
    html.P(
        "Click a pole to take it; click a column that is taken, or close its chip, to drop it. The cursor on a pole "
        "shows its shape. The functions are those of the point of the panel Measurement.",
        classes="text-body-2",
    )
    vuetify3.VProgressLinear(indeterminate=True, v_if="stabilizing")
    html.P("Reading the functions and drawing their poles, which takes some seconds.", v_if="stabilizing")
    with html.Div(
        classes=("{ stale: stabilizing }",),
        style=("{ visibility: stabilizing && !poles.length ? 'hidden' : 'visible' }",),
    ):
        _chart(controller)


def _chart(controller: Any) -> None:
    """Show handles, stabilisation chart, chosen poles, and what they make of the functions."""
    from trame.widgets import html, vuetify3

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
            "{{ pole.hertz.toFixed(1) }} Hz, {{ pole.percent.toPrecision(3) }} %", v_for="pole in poles",
            key="pole.hertz", closable=True, size="small",
            click_close=(controller.toggle_pole, "[pole.hertz, pole.percent]"),
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
