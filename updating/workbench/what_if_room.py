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


@dataclass(eq=False)
class _Tried:
    """What is being tried: the model, what can be moved, what it did first, and where the sliders are."""

    prepared: Prepared
    knobs: tuple[Knob, ...]
    before: Outcome
    values: dict[str, float]


def room(server: Any, opened: Opened) -> None:
    """Keep the room's state right."""
    state, controller = server.state, server.controller
    labels = [{"title": e.label, "value": name} for name, e in sorted(catalogue().items())]
    state.update(
        {
            "effect_list": labels, "tried_effects": [], "sliders": [], "outcome": empty(), "outcome_text": "",
            "preparing": False, "what_if_text": "",
        }
    )  # fmt: skip
    tried: list[_Tried] = []
    pending: list[bool] = []

    async def begin() -> None:
        """Reduce the model in the background and put the sliders up."""
        name, effects = state.configuration, list(state.tried_effects)
        with state:
            state.preparing, state.what_if_text = True, "Reducing the model, which takes some seconds."
        loop = asyncio.get_running_loop()
        try:
            campaign = read_campaign(opened.campaign)
            tested, file = opened.tested(name), model_file(campaign, "what if")
            one = campaign.configuration(name)
            made = await loop.run_in_executor(None, prepared_model, tested, one, file, effects)
            own = knobs(tested, made)
            values = {knob.name: knob.start for knob in own}
            before = await loop.run_in_executor(None, outcome, made, values)
        except LAMELLA_ERRORS as error:
            with state:
                state.preparing, state.what_if_text, state.sliders = False, str(error), []
            return
        if (name, effects) != (state.configuration, list(state.tried_effects)):
            return  # something else was chosen meanwhile
        tried[:] = [_Tried(prepared=made, knobs=own, before=before, values=values)]
        with state:
            state.preparing, state.what_if_text = False, ""
            state.sliders = [
                {
                    "name": knob.name,
                    "step": knob.step(values[knob.name]),
                    "text": knob.text(values[knob.name]),
                }
                for knob in own
            ]
            draw()

    def draw() -> None:
        own = tried[0]
        now = outcome(own.prepared, own.values)
        state.outcome = figure(outcome_chart(own.before, now))
        state.outcome_text = (
            f"Mean frequency error {percent(now.error)} (before: {percent(own.before.error)}), "
            f"lowest MAC {now.likeness.min():.3f}"
        )

    @controller.set("try_effects")
    def choose_effects(**_: Any) -> None:
        asyncio.get_running_loop().create_task(begin())

    @controller.set("move")
    def move(index: int, step: float) -> None:
        """Take a slider's place; what came before the picture was drawn is drawn once."""
        if not tried or not 0 <= index < len(tried[0].knobs):
            return
        knob = tried[0].knobs[index]
        value = knob.value(step)
        tried[0].values[knob.name] = value
        sliders = [dict(own) for own in state.sliders]
        sliders[index] |= {"step": step, "text": knob.text(value)}
        state.sliders = sliders
        if not pending:
            pending.append(True)
            asyncio.get_running_loop().call_soon(drawn_later)

    def drawn_later() -> None:
        pending.clear()
        try:
            with state:
                draw()
        except LAMELLA_ERRORS as error:
            with state:
                state.what_if_text = str(error)

    @controller.set("write_what_if")
    def write() -> None:
        if not tried:
            return
        path = opened.folder / _FILE
        write_specification(path, opened.campaign, state.tried_effects, tried[0].knobs, tried[0].values)
        words = ["lamella", "update", str(path), "-o", str(opened.folder / "what_if")]
        state.what_if_text = f"Written. Fit these: {shlex.join(words)}"

    @state.change("room", "configuration", "tried_effects")
    def enter(room: str, **_: Any) -> None:
        if room == TITLE and state.configuration:
            asyncio.get_running_loop().create_task(begin())


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
