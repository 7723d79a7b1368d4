"""The model at the values of the sliders: its modes beside the measured ones."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ema.campaign.campaign import Configuration
from ema.modal.mac import mac, real_shape
from ema.plot import palette
from ema.plot.figures import UNIT
from ema.types.frf import DERIVATIVE, FRF
from ema.types.modal_model import ModalModel, frequency_text
from lamella_shared import Booleans, Complexes, Integers, Reals
from model import (
    Effect,
    EffectError,
    Modes,
    Observed,
    ReducedSystem,
    Stack,
    catalogue,
    find_effects,
    observe,
    read_stack,
    reduce,
    solve_modes,
)
from updating.correlation.pairing import N_MODE
from updating.correlation.registration import register
from updating.diagnosis.answer import Ranked
from updating.diagnosis.cached_model import kept_model
from updating.diagnosis.candidates import CandidateModel
from updating.diagnosis.evidence import pair as likeliest
from updating.diagnosis.experiment import aids
from updating.diagnosis.explained_model import explained_stack, finer_ratio
from updating.diagnosis.fit_settings import CONTACT
from updating.diagnosis.stack_near import RATIOS
from updating.errors import PairingError
from updating.fitting.fit import (
    D_F_BOUNDS,
    G_F_BOUNDS,
    N_SNAPSHOT_WIDE,
    frequency_error,
    modes_that_pair,
    stack_in_state,
)
from updating.report.part import Chart, axis, single
from updating.report.results import Results, Tested, identified_effects
from updating.results.text import quantity

STEPS = 1000  # of a slider


@dataclass(frozen=True, kw_only=True)
class Knob:
    """A parameter that can be moved.

    Attributes
    ----------
    name, unit : str
        Which.
    lower, upper : float
        Its range.
    start : float
        Where it stands first: that of the base model, or where an effect vanishes.
    logarithmic : bool
        Whether equal steps are equal ratios.
    """

    name: str
    unit: str
    lower: float
    upper: float
    start: float
    logarithmic: bool

    def value(self, step: float) -> float:
        """Return the value at a step of the slider."""
        share = step / STEPS
        if self.logarithmic:
            return float(self.lower * (self.upper / self.lower) ** share)
        return self.lower + share * (self.upper - self.lower)

    def step(self, value: float) -> int:
        """Return the step of the slider that is nearest to a value."""
        if self.logarithmic:
            share = np.log(value / self.lower) / np.log(self.upper / self.lower)
        else:
            share = (value - self.lower) / (self.upper - self.lower)
        return round(STEPS * float(np.clip(share, 0.0, 1.0)))

    def text(self, value: float) -> str:
        """Write a value with its unit; a ratio of units has no prefix."""
        return f"{value:.4g} {self.unit}" if "/" in self.unit else quantity(value, self.unit)


@dataclass(frozen=True, eq=False, kw_only=True)
class Outcome:
    """The model's modes for some values of its parameters, paired with the measured modes.

    Attributes
    ----------
    measured, model : (n,) float
        Frequencies, Hz.
    likeness : (n,) float
        MAC of each two.
    mode : (n,) int
        Number of each measured mode, from 0.
    error : float
        Mean relative frequency error, eq. (2).
    modes : Modes
        All modes of the model, those of the rigid body first.
    """

    measured: Reals
    model: Reals
    likeness: Reals
    mode: Integers
    error: float
    modes: Modes


@dataclass(frozen=True, eq=False, kw_only=True)
class Tried:
    """A model whose parameters can be moved.

    Attributes
    ----------
    stack : Stack
        The stack with the effects that are tried.
    measured : ModalModel
        The identified modes.
    system : ReducedSystem
        The stack, reduced.
    observed : Observed
        The measured points, tied to it.
    used : (n_mode,) bool
        Measured modes that the model has.
    moved : mapping of str to float
        Values of what no slider moves, such as the steel's.
    natural, ratio : (n,) float
        Frequencies of some modes, Hz, and what those of an ever finer mesh are over them.
    """

    stack: Stack
    measured: ModalModel
    system: ReducedSystem
    observed: Observed
    used: Booleans
    moved: Mapping[str, float]
    natural: Reals
    ratio: Reals

    def solved(self, values: Mapping[str, float]) -> Modes:
        """Return all modes, those of the rigid body first, for some values of the parameters."""
        theta = {"pressure": self.stack.contact.pressure, "d_f": 0.0, **self.moved, **values}
        return solve_modes(
            self.system,
            G_f=theta.pop("G_f"),
            d_f=theta.pop("d_f"),
            n_mode=N_MODE,
            observation=self.observed,
            parameters=theta,
            by=(),
        )


def explanation(results: Results, effects: Collection[str]) -> Ranked | None:
    """Return the explanation that a diagnosis fitted with these effects; of its answer, with measurement faults."""
    diagnosis = results.diagnosis
    if diagnosis is None:
        return None
    for names in diagnosis.set:
        if set(names) - set(diagnosis.measurement) == set(effects):
            return diagnosis.ranked(names)
    return diagnosis.ranked(list(effects)) if diagnosis.has(list(effects)) else None


def tried_model(
    results: Results,
    tested: Tested,
    configuration: Configuration,
    stack_file: Path,
    effects: Sequence[str],
    kept: CandidateModel | None = None,
) -> Tried:
    """Return the model of a configuration with some effects, reduced here where no diagnosis left one.

    Where a diagnosis fitted these, steel, sizes and places are as it has them, and frequencies those of an ever finer
    mesh; else all is as the stack file states it.

    Parameters
    ----------
    kept : CandidateModel, optional
        The model that the diagnosis of these results left, with all effects that the stack can have.

    Raises
    ------
    EffectError, FitError, PairingError, SolveError
        The stack cannot have an effect, or the measured points do not lie on it.
    """
    known, ranked = find_effects(effects, catalogue()), explanation(results, effects)
    stated = None if results.diagnosis is None else results.diagnosis.stack

    def explained(answer: Ranked, effects: Sequence[Effect]) -> Stack:
        assert stated is not None
        return explained_stack(stated, answer, effects, state=tested.name, pressure=tested.pressure)

    stack = stack_in_state(read_stack(stack_file), configuration)
    if ranked is not None and stated is not None:
        stack = explained(ranked, known)
    tried = _as_stated(replace(stack, effects=(), effect_values={}).with_effects(*known), tested.measured, kept)
    if kept is None or results.diagnosis is None:
        at_some = [{"G_f": float(g)} for g in np.geomspace(*G_F_BOUNDS, 13)]
    else:
        for reason in (kept.impossible[name] for name in effects if name in kept.impossible):
            raise EffectError(reason)
        base = results.diagnosis.ranked(())
        at_some = [{**_moved(base, kept), **explained_values(explained(base, ()))}]
    paired = modes_that_pair(tried.measured, [tried.solved(values).elastic() for values in at_some])
    tried = replace(tried, used=np.isin(np.arange(tried.used.size), paired))
    if ranked is None or stated is None:
        return tried
    tried = tried if kept is None else replace(tried, moved=_moved(ranked, kept))
    modes = tried.solved(explained_values(stack)).elastic()
    ratio = finer_ratio(modes.frequency, ranked.modelled.get(tested.name, ()))
    return replace(tried, natural=modes.frequency, ratio=ratio)


def _as_stated(stack: Stack, measured: ModalModel, kept: CandidateModel | None) -> Tried:
    """Return a stack with nothing moved, reduced where no model of it is kept."""
    system = None if kept is None else kept.system
    system = system or reduce(stack, G_f_range=G_F_BOUNDS, n_snapshot=N_SNAPSHOT_WIDE, n_mode=N_MODE)
    points = register(stack, measured.geometry, measured.node, measured.direction).observation
    return Tried(
        stack=stack,
        measured=measured,
        system=system,
        observed=observe(system, points),
        used=np.ones(measured.frequency.size, bool),
        moved={},
        natural=np.ones(1),
        ratio=np.ones(1),
    )


def kept_reduction(results: Results) -> CandidateModel | None:
    """Return the reduced model that the diagnosis of some results left, None where it is not there any more."""
    stack = None if results.diagnosis is None else results.diagnosis.stack
    if stack is None or stack.instruments is None:
        return None
    return kept_model(stack, stack.instruments, catalogue(), aids())


def _moved(ranked: Ranked, kept: CandidateModel) -> dict[str, float]:
    """Return steel, and places of the rig, as an explanation has them; sizes are in its frequencies alone."""
    ratios = {name: float(np.exp(ranked.nuisance.get(name, 0.0))) for name in RATIOS}
    return {**ratios, **{name: ranked.nuisance.get(name, 0.0) for name in kept.clamp_locations}}


def explained_values(stack: Stack) -> dict[str, float]:
    """Return the values of all parameters that can be changed in a stack."""
    return {"G_f": stack.contact.G_f, "d_f": stack.contact.d_f, **stack.effect_values}


def knobs(stack: Stack, G_f: float, d_f: float) -> tuple[Knob, ...]:
    """Return the sliders: contact stiffness and damping, pressure, and the parameters of the effects."""
    pressures = (0.25, 4.0)  # of the stated one, over which it can be tried
    contact = stack.contact
    low, high = (k * contact.pressure for k in pressures)
    first = [
        Knob(name="G_f", unit="Pa/Pa", lower=G_F_BOUNDS[0], upper=G_F_BOUNDS[1], start=G_f, logarithmic=True),
        Knob(
            name="d_f", unit="s/Pa", lower=D_F_BOUNDS[0], upper=max(D_F_BOUNDS[1] / 100.0, 4.0 * d_f), start=d_f,
            logarithmic=False,
        ),
        Knob(name="pressure", unit="Pa", lower=low, upper=high, start=contact.pressure, logarithmic=True),
    ]  # fmt: skip
    parameters = {p.name: p for effect in stack.effects for p in effect.parameters}
    return (
        *first,
        *(
            Knob(
                name=p.name, unit=p.unit, lower=p.lower, upper=p.upper, start=p.neutral,
                logarithmic=p.scale == "log" and p.lower > 0.0 and p.neutral > 0.0,
            )
            for p in parameters.values()
        ),
    )  # fmt: skip


def outcome(tried: Tried, values: Mapping[str, float]) -> Outcome:
    """Solve the reduced model for some values of its parameters."""
    solved = tried.solved(values)
    solved = replace(solved, frequency=solved.frequency * np.interp(solved.frequency, tried.natural, tried.ratio))
    modes = solved.elastic()
    shape = real_shape(tried.measured.shape)
    likeness = mac(shape, modes.shape)
    column = likeliest(shape, tried.measured.frequency, modes.shape, modes.frequency)[1]
    mode = np.flatnonzero(tried.used)
    measured, model = tried.measured.frequency[mode], modes.frequency[column[mode]]
    return Outcome(
        measured=measured,
        model=model,
        likeness=likeness[mode, column[mode]],
        mode=mode,
        error=frequency_error(measured, model),
        modes=solved,
    )


def outcome_chart(before: Outcome, now: Outcome) -> Chart:
    """Draw the frequency errors of all modes before and now, and the MAC of each."""
    names = [f"{m + 1}: {frequency_text(f, 0)} Hz" for m, f in zip(now.mode, now.measured, strict=True)]
    traces = [
        {
            "type": "bar", "x": names, "y": (100.0 * (result.model / result.measured - 1.0)).tolist(), "name": name,
            "marker": {"color": color}, "hovertemplate": "%{y:+.2f} %",
        }
        for result, name, color in ((before, "before", palette.BASE), (now, "now", palette.FOUND))
    ]  # fmt: skip
    traces += [
        {
            "type": "scatter", "mode": "markers", "x": names, "y": result.likeness.tolist(), "yaxis": "y2",
            "marker": {"color": color, "size": 8}, "showlegend": False, "hovertemplate": "MAC %{y:.3f}", "name": name,
        }
        for result, name, color in ((before, "before", palette.BASE), (now, "now", palette.FOUND))
    ]  # fmt: skip
    return Chart(
        traces=traces,
        layout={
            "yaxis": axis("frequency error [%]", domain=[0.36, 1.0], zeroline=True),
            "yaxis2": axis("MAC", domain=[0.0, 0.26], range=[0.0, 1.05]),
            "xaxis": axis("measured mode", anchor="y2"),
        },
    )


def driven(tried: Tried) -> Observed | None:
    """Observe the model where the force acts; None where the points do not say where that is."""
    measured = tried.measured
    try:
        force = register(tried.stack, measured.geometry, measured.input.node[:1], measured.input.direction[:1])
    except PairingError:
        return None
    return observe(tried.system, force.observation)


def response(modes: Modes, output: int, force: Observed, lines: FRF) -> Complexes:
    """Return the function of the model from the force to a measured output, (n_frequency,), in the lines' quantity.

    The modes that are solved are added up, those of the rigid body among them (Ewins, Modal Testing, 2nd ed., sec.
    2.8); what further modes leave between resonances is not in it.
    """
    s = 2j * np.pi * lines.frequency[:, None]
    natural = 2.0 * np.pi * modes.frequency
    strength = modes.shape[output] * (force.reduced_rows @ modes.coordinate)[0]
    terms = strength / (s**2 + 2.0 * modes.damping * natural * s + natural**2)
    return np.asarray(terms.sum(axis=1) * s[:, 0] ** DERIVATIVE[lines.quantity])


def response_chart(lines: FRF, output: int, before: Complexes, now: Complexes) -> Chart:
    """Draw a measured function with that of the model before and now."""
    traces = [
        {
            "type": "scatter", "x": single(lines.frequency), "y": single(np.abs(value)), "name": name, "line": style,
            "hovertemplate": "%{y:.3~g}",
        }
        for value, name, style in (
            (lines.value[output, 0], "measured", {"color": palette.MEASURED, "width": 2.5}),
            (before, "model before", {"color": palette.BASE, "width": 1, "dash": "dot"}),
            (now, "model now", {"color": palette.FOUND, "width": 1.5}),
        )
    ]  # fmt: skip
    size = np.abs(lines.value[output, 0])
    reach = np.add(np.log10(np.quantile(size[size > 0.0], [0.01, 1.0])), (-0.5, 1.0))
    return Chart(
        traces=traces,
        layout={
            "xaxis": axis("frequency [Hz]"),
            "yaxis": axis(
                f"{lines.output.name(output)} over {lines.input.name(0)} [{UNIT[lines.quantity]}]",
                type="log", exponentformat="power", range=reach.tolist(),
            ),
            "hovermode": "x unified",
            "uirevision": "kept",
        },
    )  # fmt: skip


FIRST = "identified by the diagnosis"

NEXT = "tried by the diagnosis"


def effect_choices(results: Results) -> list[dict[str, str]]:
    """List every effect with its label and its family: what was identified first, then the likeliest, then by family.

    The page searches titles and subtitles, so that a family's name finds all of its effects.
    """
    known = catalogue()
    addition = identified_effects(results)
    identified = () if addition is None else addition.effects
    tried = _likeliest(results)
    order = sorted(
        known.values(),
        key=lambda e: (
            e.name not in identified,
            tried.index(e.name) if e.name in tried else len(tried),
            e.family,
            e.label,
        ),
    )
    return [
        {
            "title": e.label,
            "value": e.name,
            "subtitle": ", ".join(
                [e.family, *([FIRST] if e.name in identified else [NEXT] if e.name in tried else [])]
            ),
        }
        for e in order
    ]


def _likeliest(results: Results) -> list[str]:
    """Return the effects of the explanations that a diagnosis fitted, the most probable first."""
    ranking = () if results.diagnosis is None else results.diagnosis.ranking
    return list(dict.fromkeys(name for ranked in ranking for name in ranked.effects))


def slider_rows(knobs: Sequence[Knob], effects: Sequence[str]) -> list[dict[str, Any]]:
    """Return the sliders' state in the order of the knobs; the first of each group has its heading.

    A group is what the base model has, or one effect with its family.
    """
    known = catalogue()
    group = dict.fromkeys((*CONTACT, "pressure"), "contact, of the base model")
    for effect in (known[name] for name in effects if name in known):
        for parameter in effect.parameters:
            group.setdefault(parameter.name, f"{effect.label} ({effect.family})")
    rows: list[dict[str, Any]] = []
    last = ""
    for knob in knobs:
        head = group.get(knob.name, "")
        rows.append(
            {
                "name": knob.name,
                "step": knob.step(knob.start),
                "text": knob.text(knob.start),
                "head": head if head != last else "",
            }
        )
        last = head
    return rows


def values_of(results: Results, configuration: str, effects: Sequence[str]) -> dict[str, float]:
    """Return the values of all parameters of a configuration, with effects as a diagnosis fitted them.

    Without a diagnosis, they are those of the ledger.
    """
    ranked = explanation(results, effects)
    if ranked is None or results.diagnosis is None or results.diagnosis.stack is None:
        addition = identified_effects(results)
        return {} if addition is None else dict(addition.value)
    known = find_effects(effects, catalogue())
    return explained_values(explained_stack(results.diagnosis.stack, ranked, known, state=configuration))
