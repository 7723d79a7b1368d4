"""The panel of the comparison: the MAC of every two modes, and both shapes of any cell in motion.

Of a configuration that has a reference, what differs from it stands above.
"""

from __future__ import annotations

import asyncio
from typing import Any

import numpy as np

from ema import change_sentence
from ema.plot import palette
from ema.types.modal_model import frequency_text
from updating.correlation.correlation import correlate
from updating.correlation.localization import ErrorMap
from updating.fitting.fit import Fit, ModelFit
from updating.fitting.plots import any_pair
from updating.report.frf_part import BASE, FOUND
from updating.report.modes_part import mac_chart, shape_numbers
from updating.report.part import Chart, axis
from updating.report.results import Tested
from updating.report.state_part import (
    common_lines,
    error_map,
    location_text,
    map_chart,
    mean_chart,
    most_likely_kind,
    shift_chart,
)
from updating.results.campaign import change_table
from updating.results.text import Z95
from updating.workbench.opened import Opened, cells, empty, figure, moving_page, moving_shapes, plot, table

TITLE, ICON = "Comparison", "mdi-compare"


def frequencies_chart(tested: Tested, fit: ModelFit) -> Chart:
    """Draw frequency errors with the measurement's 95 % intervals over damping ratios, of all pairs."""
    c, used = correlate(tested.measured, fit.modes, fit.pairing), fit.pairing.measured
    names = [f"{m + 1}: {frequency_text(f, 0)} Hz" for m, f in zip(used, c.measured_frequency, strict=True)]

    def bars(value: Any, color: str, name: str, place: str) -> dict[str, Any]:
        return {
            "type": "bar", "x": names, "y": (100.0 * value).tolist(), "name": name, "marker": {"color": color},
            "yaxis": place, "offsetgroup": name,
        }  # fmt: skip

    frequency = bars(c.frequency_error, palette.LEFT, "frequency error", "y")
    frequency["error_y"] = {"type": "data", "array": (100.0 * Z95 * c.frequency_error_std).tolist()}
    damping = bars(c.measured_damping, palette.MEASURED, "damping measured", "y2")
    damping["error_y"] = {"type": "data", "array": (100.0 * Z95 * tested.measured.damping_std[used]).tolist()}
    return Chart(
        traces=[frequency, damping, bars(c.model_damping, palette.BASE, "damping of the model", "y2")],
        layout={
            "yaxis": axis("frequency error [%]", domain=[0.56, 1.0], zeroline=True),
            "yaxis2": axis("damping ratio [%]", domain=[0.0, 0.44]),
            "xaxis": axis("mode", anchor="y2"),
        },
    )


def panel(server: Any, opened: Opened) -> None:
    """Set up the panel's state and what its controls call."""
    server.state.update(
        {
            "mac": empty(), "frequencies": empty(), "shapes": "", "pair_text": "", "has_fit": False,
            "place": empty(), "place_text": "", "locating": False, "comparing": True, "compared": FOUND,
            "compared_models": [], "compared_text": "",
            "change_text": "", "shifts": empty(), "change_mac": empty(), "change_table": {"header": [], "rows": []},
            "change_functions": empty(), "has_functions_beside": False, "what_changed": [],
        }
    )  # fmt: skip
    comparison = _Comparison(server, opened)
    server.controller.show_pair = comparison.show_pair
    server.controller.locate = comparison.locate

    @server.state.change("panel", "configuration")
    def enter(panel: str, **_: Any) -> None:
        # what the panel holds may be of another configuration until it is entered
        server.state.comparing = True
        if panel == TITLE:
            asyncio.get_running_loop().create_task(comparison.begin())

    @server.state.change("compared")
    def choose_model(**_: Any) -> None:
        comparison.draw()


class _Comparison:
    """One configuration beside its models, as state."""

    def __init__(self, server: Any, opened: Opened) -> None:
        self.server, self.state, self.opened = server, server.state, opened
        self._tested: Tested | None = None

    async def begin(self) -> None:
        """Solve the models of the configuration in the background, and show it beside them."""
        name = self.state.configuration
        tested, remarks = await asyncio.to_thread(self.opened.modelled, name)
        if name != self.state.configuration:
            return  # another was chosen meanwhile
        self._tested = tested
        with self.state as state:
            state.comparing, state.place_text = False, ""
            state.compared_models = [] if tested.identified is None else [FOUND, BASE]
            state.compared_text = " ".join(remarks)
            self._show_change(tested)
            self.draw()

    def _model(self) -> ModelFit | None:
        """Return the model that is compared: with what was identified, or the base model."""
        if self._tested is None:
            return None
        return self._tested.fit if self.state.compared == BASE else self._tested.shown

    def draw(self) -> None:
        """Draw the configuration beside the model that was chosen."""
        beyond = 3  # model modes above the last that is paired
        state, tested, fit = self.state, self._tested, self._model()
        state.has_fit = fit is not None and fit.pairing.measured.size > 0
        if tested is None or fit is None or not state.has_fit:
            return
        last = int(fit.pairing.model.max()) + beyond
        value = fit.pairing.mac[:, :last]
        columns = fit.modes.frequency[:last]
        state.mac = figure(mac_chart(value, tested.measured.frequency, columns, "model", "measured"))
        state.frequencies = figure(frequencies_chart(tested, fit))
        first = int(fit.pairing.measured[0]), int(fit.pairing.model[0])
        state.shapes = moving_page(any_pair(tested.measured, fit, *first), fit.box)
        self._say_pair(tested, fit, *first)

    def _show_change(self, tested: Tested) -> None:
        """Show what differs from the reference, where the configuration has one."""
        state, change = self.state, tested.change
        state.change_text = "" if change is None else f"{change_sentence(change)}."
        state.what_changed = [] if tested.what_changed is None else list(tested.what_changed.sentences)
        state.has_functions_beside = False
        if change is None:
            return
        state.change_table = cells(change_table(change))
        if tested.reference is not None and (common := common_lines(tested, tested.reference)) is not None:
            state.has_functions_beside = True
            state.change_functions = figure(mean_chart(tested, tested.reference, common))
        state.shifts = figure(shift_chart(change))
        state.change_mac = figure(
            mac_chart(change.mac_matrix, change.matrix_row, change.matrix_column, change.name, change.reference[0])
        )

    def show_pair(self, r: int, s: int) -> None:
        """Move a measured mode and one of the model."""
        tested, fit = self._tested, self._model()
        if tested is None or fit is None:
            return
        if 0 <= r < fit.pairing.mac.shape[0] and 0 <= s < fit.pairing.mac.shape[1]:
            self.server.controller.send_pair({"pair": shape_numbers(any_pair(tested.measured, fit, r, s))})
            self._say_pair(tested, fit, r, s)

    def _say_pair(self, tested: Tested, fit: ModelFit, r: int, s: int) -> None:
        self.state.pair_text = (
            f"Measured mode {r + 1} at {frequency_text(tested.measured.frequency[r], 1)} Hz and model mode {s + 1} at "
            f"{frequency_text(fit.modes.frequency[s], 1)} Hz: MAC {np.round(fit.pairing.mac[r, s], 3):g}"
        )

    async def locate(self) -> None:
        """Say where the model that is compared fails."""
        tested, fit, state = self._tested, self._model(), self.state
        if tested is None or not isinstance(fit, Fit):
            state.place_text = "This is asked of the model of a stack only."
            return
        with state:
            state.locating = True
        kind, sentence, errors = await asyncio.to_thread(_located, tested, fit)
        with state:
            state.locating, state.place_text = False, sentence
            state.place = figure(map_chart(tested, fit, errors, kind))


def _located(tested: Tested, fit: Fit) -> tuple[str, str, ErrorMap]:
    """Return the kind of stiffness in which a fit most likely fails, its description, and the map of the error."""
    errors = error_map(tested, fit)
    return most_likely_kind(errors), location_text(errors), errors


def show(server: Any) -> None:
    """Put the panel into the page."""
    from trame.widgets import html, vuetify3

    def clicked(cell: list[int], _: int) -> None:
        if isinstance(cell, list) and len(cell) == 2:
            server.controller.show_pair(*cell)

    with html.Div(v_show="change_text"):
        html.P("{{ change_text }}", classes="text-subtitle-1", id="change-text")
        html.P("{{ line }}", v_for="line in what_changed", classes="text-body-2", key="line")
        table("change_table", "change-table")
        with html.Div(v_show="has_functions_beside"):
            plot("change_functions", 320)
        with vuetify3.VRow():
            with vuetify3.VCol(cols=12, md=6):
                plot("shifts", 360)
            with vuetify3.VCol(cols=12, md=6):
                plot("change_mac", 420)
    vuetify3.VProgressLinear(indeterminate=True, v_if="comparing")
    html.P("{{ compared_text }}", v_if="compared_text", classes="text-body-2")
    html.P("No model is fitted yet: run a fit in the panel Diagnosis.", v_if="!(has_fit || comparing || change_text)")
    with vuetify3.VRow(v_show="has_fit", classes=("{ stale: comparing }",)):
        with vuetify3.VCol(cols=12, md=6):
            vuetify3.VSelect(
                v_model=("compared",), items=("compared_models",), label="Model", density="compact", hide_details=True,
                v_if="compared_models.length", id="compared", style="max-width: 320px",
            )  # fmt: skip
            html.P("Click a cell to see both shapes move.", classes="text-body-2")
            plot("mac", 420, clicked)
            plot("frequencies", 380)
        with vuetify3.VCol(cols=12, md=6):
            html.P("{{ pair_text }}", classes="text-subtitle-1", id="pair")
            server.controller.send_pair = moving_shapes("shapes", 500)
            vuetify3.VBtn(
                "Where the model fails", click=server.controller.locate, loading=("locating",), id="locate",
            )  # fmt: skip
            html.P("{{ place_text }}", classes="text-body-2 mt-2", id="place-text")
            with html.Div(v_show="place_text"):
                plot("place", 380, solid=True)
