"""The panel of what if: sliders for every parameter, and the model at their values beside the measurement."""

from __future__ import annotations

import asyncio
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ema import read_campaign
from ema.types.frf import FRF
from model import Observed
from updating.diagnosis.candidates import CandidateModel
from updating.errors import LAMELLA_ERRORS
from updating.fitting.fit import model_file
from updating.report.results import Results, identified_effects
from updating.results.store import digest
from updating.results.text import percent, quantity
from updating.workbench.opened import Command, Opened, empty, figure, plot
from updating.workbench.what_if import (
    STEPS,
    Knob,
    Outcome,
    Tried,
    driven,
    effect_choices,
    explanation,
    kept_reduction,
    knobs,
    outcome,
    outcome_chart,
    response,
    response_chart,
    slider_rows,
    tried_model,
    values_of,
)

TITLE, ICON = "What if", "mdi-tune-variant"

_STALE = "{ stale: preparing }"  # what is shown is of another model meanwhile


@dataclass(frozen=True, eq=False, kw_only=True)
class _Shown:
    """What is being tried: the model, its sliders, the measured functions, and the base model."""

    tried: Tried
    knobs: tuple[Knob, ...]
    lines: FRF | None
    force: Observed | None
    before: Outcome
    before_force: Observed | None


def panel(server: Any, opened: Opened) -> None:
    """Set up the panel's state and what its controls call."""
    server.state.update(
        {
            "effect_list": [], "tried_effects": [], "sliders": [], "outcome": empty(), "outcome_text": "",
            "preparing": True, "what_if_text": "", "response": empty(), "channel": 0, "channels": [],
            "fitted_text": "", "fitting": False, "can_be_set": False,
        }
    )  # fmt: skip
    what_if = _WhatIf(server.state, opened)
    server.controller.move = what_if.move
    server.controller.fit_what_if = what_if.fit
    server.controller.stop_what_if = what_if.command.stop
    server.controller.set_to_answer = what_if.set_to_answer

    @server.state.change("channel")
    def choose_channel(**_: Any) -> None:
        what_if.draw_response()

    @server.state.change("panel", "configuration", "tried_effects")
    def enter(panel: str, **_: Any) -> None:
        # what the panel holds may be of another configuration until it is entered
        server.state.preparing = True
        if panel == TITLE:
            asyncio.get_running_loop().create_task(what_if.begin())


class _WhatIf:
    """What is tried with one configuration, as state."""

    def __init__(self, state: Any, opened: Opened) -> None:
        self.state, self.opened = state, opened
        self._tried: _Shown | None = None
        self._values: dict[str, float] = {}
        self._now: Outcome | None = None
        self._awaited = False
        self._kept: tuple[str, CandidateModel] | None = None  # the model that a diagnosis left, by its stack
        self._wanted: dict[str, float] = {}  # values that the sliders take once the model is there
        self._of: tuple[str, list[str]] | None = None  # configuration and effects that the sliders are of
        self.command = Command(self._show_lines)

    async def begin(self) -> None:
        """Reduce the model in the background and show its sliders."""
        wanted = self.state.configuration, list(self.state.tried_effects)
        with self.state as state:
            state.preparing, state.what_if_text = (True, "Reading or reducing the model, which takes some seconds.")
            results = self.opened.results()
            state.effect_list, state.can_be_set = (effect_choices(results), identified_effects(results) is not None)
        try:
            tried = await asyncio.get_running_loop().run_in_executor(None, self._try, *wanted)
        except LAMELLA_ERRORS as error:
            with self.state as state:
                state.preparing, state.what_if_text, state.sliders = False, str(error), []
            return
        if wanted != (self.state.configuration, list(self.state.tried_effects)):
            return  # something else was chosen meanwhile
        self._tried = tried
        values = self._wanted or (self._values if wanted == self._of else {})  # who comes back finds it as it was
        self._values = {knob.name: knob.start for knob in tried.knobs}
        with self.state as state:
            state.preparing, state.what_if_text = False, ""
            state.sliders = slider_rows(tried.knobs, wanted[1])
            self._place(values)
            self._wanted, self._of = {}, wanted
            lines = tried.lines
            names = (
                []
                if lines is None
                else [f"{lines.output.name(o)} over {lines.input.name(0)}" for o in range(lines.output.node.size)]
            )
            at_point = np.flatnonzero(lines.output.node == state.point) if lines is not None else np.empty(0, int)
            state.channels = [{"title": name, "value": o} for o, name in enumerate(names)]
            state.channel = int(at_point[0]) if at_point.size else 0
            self._draw(tried)

    def _try(self, name: str, effects: list[str]) -> _Shown:
        campaign, results = read_campaign(self.opened.campaign), self.opened.results()
        tested = next(tested for tested in results.tested if tested.name == name)
        state, file = campaign.configuration(name), model_file(campaign, "what if")
        stack = None if results.diagnosis is None else results.diagnosis.stack
        if self._kept is None or self._kept[0] != digest(stack):
            kept = kept_reduction(results)
            self._kept = None if kept is None else (digest(stack), kept)
        model = None if self._kept is None else self._kept[1]
        base = tried = tried_model(results, tested, state, file, (), model)
        if effects:
            tried = tried_model(results, tested, state, file, effects, model)
        contact = base.stack.contact
        start = {"G_f": contact.G_f, "d_f": contact.d_f}
        if results.diagnosis is None and tested.opt is not None:
            start = {"G_f": tested.opt.G_f.value, "d_f": tested.opt.d_f.value}
        return _Shown(
            tried=tried,
            knobs=knobs(tried.stack, **start),
            lines=tested.frf().band(*tested.measured.band) if tested.has_functions else None,
            force=driven(tried),
            before=outcome(base, start),
            before_force=driven(base),
        )

    def _place(self, values: Mapping[str, float]) -> None:
        """Put sliders at values, by the names of their parameters; the others stay."""
        if self._tried is None:
            return
        sliders = [dict(slider) for slider in self.state.sliders]
        for knob, slider in zip(self._tried.knobs, sliders, strict=True):
            if knob.name in values:
                value = self._values[knob.name] = values[knob.name]
                slider |= {"step": knob.step(value), "text": knob.text(value)}
        self.state.sliders = sliders

    async def set_to_answer(self) -> None:
        """Try the effects that were identified, with every slider at the value of the answer."""
        results = self.opened.results()
        addition = identified_effects(results)
        if addition is not None:
            await self._set(results, addition.effects)

    async def _set(self, results: Results, effects: Sequence[str]) -> None:
        """Try effects, with every slider at the value that a diagnosis, or the ledger, has."""
        self._wanted = values_of(results, self.state.configuration, effects)
        if list(effects) == list(self.state.tried_effects):
            await self.begin()
            return
        with self.state as state:
            state.tried_effects = list(effects)  # which begins anew

    def move(self, index: int, step: float) -> None:
        """Take the new place of a slider; several moves before the next drawing are drawn once."""
        if self._tried is None or not 0 <= index < len(self._tried.knobs):
            return
        knob = self._tried.knobs[index]
        value = knob.value(step)
        self._values[knob.name] = value
        sliders = [dict(slider) for slider in self.state.sliders]
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

    def _draw(self, tried: _Shown) -> None:
        now = self._now = outcome(tried.tried, self._values)
        self.state.outcome = figure(outcome_chart(tried.before, now))
        self.draw_response()
        self.state.outcome_text = (
            f"Mean frequency error {percent(now.error)} (before: {percent(tried.before.error)}), lowest MAC "
            f"{now.likeness.min():.3f}"
        )

    def draw_response(self) -> None:
        """Draw the chosen function, measured and of the model before and now."""
        tried, now, output = self._tried, self._now, self.state.channel
        if (
            tried is None
            or now is None
            or tried.force is None
            or tried.before_force is None
            or tried.lines is None
            or not 0 <= output < tried.lines.output.node.size
        ):
            return
        before, after = (
            response(result.modes, output, force, tried.lines)
            for result, force in ((tried.before, tried.before_force), (now, tried.force))
        )
        self.state.response = figure(response_chart(tried.lines, output, before, after))

    def fit(self) -> None:
        """Fit the effects that are tried to all configurations, as the command does it and with the same numbers."""
        state = self.state
        if self._tried is None or self.command.running:
            return
        effects = [word for name in state.tried_effects for word in ("--effect", name)]
        arguments = [
            "fit" if effects else "diagnose",
            str(self.opened.campaign),
            "-o",
            str(self.opened.folder),
            *effects,
        ]
        state.what_if_text, state.fitting = f"This is: {shlex.join(['lamella', *arguments])}", True
        self._task = asyncio.get_running_loop().create_task(self.command.run(arguments, self._fitted))

    def _show_lines(self, lines: list[str]) -> None:
        with self.state as state:
            state.fitted_text = lines[-1] if lines else ""

    async def _fitted(self, code: int) -> None:
        with self.state as state:
            state.fitting = False
            if code != 0:
                state.fitted_text = f"The fit ended with exit code {code}: {state.fitted_text}"
                return
            results, effects = self.opened.results(), list(state.tried_effects)
            state.fitted_text = fitted_sentence(results, effects)
        await self._set(results, effects)


def fitted_sentence(results: Results, effects: Sequence[str]) -> str:
    """Say what effects change, as a diagnosis fitted them: errors before and after, and parameters with intervals."""
    ranked = explanation(results, effects)
    if ranked is None or results.diagnosis is None:
        return ""
    base = results.diagnosis.ranked(())
    values = [
        f"{p.name} = {quantity(p.value, p.unit)} ({quantity(p.lower, p.unit)} to {quantity(p.upper, p.unit)})"
        for p in ranked.parameter
    ]
    fall = (
        f"Mean frequency error {percent(base.frequency_error)} before and {percent(ranked.frequency_error)} after the "
        f"fit, of modes left out {percent(base.left_out_error)} and {percent(ranked.left_out_error)}"
    )
    return f"{'; '.join([fall, *values])}."


def show(server: Any) -> None:
    """Put the panel into the page."""
    from trame.widgets import html, vuetify3

    controller = server.controller
    with vuetify3.VRow():
        with vuetify3.VCol(cols=12, md=5):
            vuetify3.VAutocomplete(
                v_model=("tried_effects",), items=("effect_list",), label="Effects to try", multiple=True, chips=True,
                closable_chips=True, density="compact", hide_details=True, id="effects", item_props=True,
                filter_keys=("['title', 'raw.subtitle', 'raw.value']",),
            )  # fmt: skip
            html.P(
                "Those that matter come first; type a word of a name or of a family, such as boundary, to search.",
                classes="text-caption",
            )
            vuetify3.VBtn(
                "Set to what was identified", click=controller.set_to_answer, id="set-to-answer", classes="mt-1",
                disabled=("preparing || fitting",), v_if="can_be_set", size="small", variant="tonal",
            )  # fmt: skip
            vuetify3.VProgressLinear(indeterminate=True, v_if="preparing")
            with (
                html.Div(v_for="(slider, i) in sliders", key="slider.name", classes=(_STALE,)),
                html.Div(classes="mt-2 slider d-flex align-center flex-wrap"),
            ):
                html.H2("{{ slider.head }}", v_if="slider.head", classes="text-subtitle-2 w-100 slider-head")
                with html.Div(style="flex: 1 1 auto; min-width: 0"):
                    html.Div("{{ slider.name }} = <b>{{ slider.text }}</b>", classes="text-body-2")
                    vuetify3.VSlider(
                        model_value=("slider.step",), min=0, max=STEPS, step=1, hide_details=True, density="compact",
                        update_modelValue=(controller.move, "[i, $event]"), aria_label=("slider.name",),
                    )  # fmt: skip
            with html.Div(classes="d-flex ga-2 mt-2"):
                vuetify3.VBtn(
                    "Fit these", click=controller.fit_what_if, color="primary", id="fit-these",
                    disabled=("fitting || preparing || !sliders.length",),
                )  # fmt: skip
                vuetify3.VBtn("Stop", click=controller.stop_what_if, color="error", v_if="fitting")
            html.P(
                "Fits the effects that are tried to all configurations together, as lamella fit --effect does, "
                "and puts the sliders where the fit ends.",
                classes="text-caption",
            )
            html.P("{{ what_if_text }}", classes="text-body-2 mt-2", id="what-if-text")
        with vuetify3.VCol(cols=12, md=7, v_show="outcome_text", classes=(_STALE,)):
            html.P("Of what was tried before, until the model is there.", v_if="preparing", classes="text-caption")
            html.P("{{ outcome_text }}", classes="text-subtitle-1", id="outcome-text")
            plot("outcome", 380)
            vuetify3.VSelect(
                v_model=("channel",), items=("channels",), label="Function", density="compact", hide_details=True,
                id="channel", style="max-width: 320px",
            )  # fmt: skip
            plot("response", 320)
    vuetify3.VProgressLinear(indeterminate=True, v_if="fitting")
    html.P("{{ fitted_text }}", classes="text-subtitle-1 mt-2", id="fitted-text")
