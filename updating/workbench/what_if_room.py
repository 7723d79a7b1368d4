"""The room of what if: sliders for every parameter, and what the model then does beside the measurement."""

from __future__ import annotations

import asyncio
import shlex
from dataclasses import dataclass
from typing import Any

from ema import read_campaign
from model import catalogue
from updating.errors import LAMELLA_ERRORS
from updating.fitting.prepared import Prepared
from updating.fitting.target import model_file
from updating.results.text import percent
from updating.workbench.opened import Opened
from updating.workbench.page import empty, figure, plot
from updating.workbench.what_if import (
    STEPS,
    Knob,
    Outcome,
    knobs,
    outcome,
    outcome_chart,
    prepared_model,
    write_specification,
)

TITLE, ICON = "What if", "mdi-tune-variant"
_FILE = "what_if.toml"


@dataclass(frozen=True, eq=False, kw_only=True)
class _Tried:
    """What is being tried: the model, what can be moved, and what it did first."""

    prepared: Prepared
    knobs: tuple[Knob, ...]
    before: Outcome


def room(server: Any, opened: Opened) -> None:
    """Keep the room's state right."""
    labels = [{"title": e.label, "value": name} for name, e in sorted(catalogue().items())]
    server.state.update(
        {
            "effect_list": labels, "tried_effects": [], "sliders": [], "outcome": empty(), "outcome_text": "",
            "preparing": False, "what_if_text": "",
        }
    )  # fmt: skip
    own = _WhatIf(server.state, opened)
    server.controller.move = own.move
    server.controller.write_what_if = own.write

    @server.state.change("room", "configuration", "tried_effects")
    def enter(room: str, **_: Any) -> None:
        if room == TITLE:
            asyncio.get_running_loop().create_task(own.begin())


class _WhatIf:
    """What is tried with one configuration, as state."""

    def __init__(self, state: Any, opened: Opened) -> None:
        self.state, self.opened = state, opened
        self._tried: _Tried | None = None
        self._values: dict[str, float] = {}
        self._awaited = False

    async def begin(self) -> None:
        """Reduce the model in the background and put the sliders up."""
        wanted = self.state.configuration, list(self.state.tried_effects)
        with self.state as state:
            state.preparing, state.what_if_text = True, "Reducing the model, which takes some seconds."
        try:
            tried = await asyncio.get_running_loop().run_in_executor(None, self._try, *wanted)
        except LAMELLA_ERRORS as error:
            with self.state as state:
                state.preparing, state.what_if_text, state.sliders = False, str(error), []
            return
        if wanted != (self.state.configuration, list(self.state.tried_effects)):
            return  # something else was chosen meanwhile
        self._tried = tried
        self._values = {knob.name: knob.start for knob in tried.knobs}
        with self.state as state:
            state.preparing, state.what_if_text = False, ""
            state.sliders = [
                {"name": own.name, "step": own.step(own.start), "text": own.text(own.start)}
                for own in tried.knobs
            ]
            self._draw(tried)

    def _try(self, name: str, effects: list[str]) -> _Tried:
        campaign = read_campaign(self.opened.campaign)
        tested = self.opened.tested(name)
        file = model_file(campaign, "what if")
        made = prepared_model(tested, campaign.configuration(name), file, effects)
        own = knobs(tested, made)
        return _Tried(prepared=made, knobs=own, before=outcome(made, {knob.name: knob.start for knob in own}))

    def move(self, index: int, step: float) -> None:
        """Take a slider's place; what came before the picture was drawn is drawn once."""
        if self._tried is None or not 0 <= index < len(self._tried.knobs):
            return
        knob = self._tried.knobs[index]
        value = knob.value(step)
        self._values[knob.name] = value
        sliders = [dict(own) for own in self.state.sliders]
        sliders[index] |= {"step": step, "text": knob.text(value)}
        self.state.sliders = sliders
        if not self._awaited:
            self._awaited = True
            asyncio.get_running_loop().call_soon(self._drawn)

    def _drawn(self) -> None:
        self._awaited = False
        with self.state as state:
            try:
                if self._tried is not None:
                    self._draw(self._tried)
            except LAMELLA_ERRORS as error:
                state.what_if_text = str(error)

    def _draw(self, tried: _Tried) -> None:
        now = outcome(tried.prepared, self._values)
        self.state.outcome = figure(outcome_chart(tried.before, now))
        self.state.outcome_text = (
            f"Mean frequency error {percent(now.error)} (before: {percent(tried.before.error)}), lowest MAC "
            f"{now.likeness.min():.3f}"
        )

    def write(self) -> None:
        """Write an updating file that begins where the sliders are."""
        if self._tried is None:
            return
        path = self.opened.folder / _FILE
        effects = self.state.tried_effects
        write_specification(path, self.opened.campaign, effects, self._tried.knobs, self._values)
        words = ["lamella", "update", str(path), "-o", str(self.opened.folder / "what_if")]
        self.state.what_if_text = f"Written. Fit these: {shlex.join(words)}"


def show(server: Any) -> None:
    """Put the room into the page."""
    from trame.widgets import html, vuetify3

    controller = server.controller
    with vuetify3.VRow():
        with vuetify3.VCol(cols=12, md=5):
            vuetify3.VAutocomplete(
                v_model=("tried_effects",), items=("effect_list",), label="Effects to try", multiple=True, chips=True,
                closable_chips=True, density="compact", hide_details=True, id="effects",
            )  # fmt: skip
            vuetify3.VProgressLinear(indeterminate=True, v_if="preparing")
            with html.Div(v_for="(own, i) in sliders", key="own.name", classes="mt-2 slider"):
                html.Div("{{ own.name }} = <b>{{ own.text }}</b>", classes="text-body-2")
                vuetify3.VSlider(
                    model_value=("own.step",), min=0, max=STEPS, step=1, hide_details=True, density="compact",
                    update_modelValue=(controller.move, "[i, $event]"), aria_label=("own.name",),
                )  # fmt: skip
            vuetify3.VBtn(
                "Write these as an updating file",
                click=controller.write_what_if,
                classes="mt-2",
                id="fit-these",
            )
            html.P("{{ what_if_text }}", classes="text-body-2 mt-2", id="what-if-text")
        with vuetify3.VCol(cols=12, md=7, v_show="outcome_text"):
            html.P("{{ outcome_text }}", classes="text-subtitle-1", id="outcome-text")
            plot("outcome", 520)
