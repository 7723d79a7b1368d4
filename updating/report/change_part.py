"""What changed between states: differences of modes, and the answer of the model."""

from __future__ import annotations

import itertools
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ema.plot import palette
from ema.types.modal_model import frequency_text
from lamella_shared import Reals
from model import printed_effects
from updating.diagnosis.answer import Diagnosis, ModeError, Telling, telling
from updating.report.part import Chart, Picture, Section, axis, charted, single
from updating.report.results import Results
from updating.results.text import Table, in_percent, percent
from updating.results.what_changed import AXES, KindOfChange, WhatChanged, separation, size_text

_KINDS: dict[Telling, str] = {"frequency": "frequency error", "damping": "error of damping ratios"}

_ERRORS = {
    "error": ("modes that were fitted", palette.USED),
    "left_out": ("modes that were left out", palette.LEFT_OUT),
}


@dataclass(frozen=True, kw_only=True)
class Step:
    """A model on the way from the base model to the last.

    Attributes
    ----------
    name : str
        What was added to the one before, in words.
    error, left_out : float
        Its mean error, as eq. (2), of modes that were fitted, and of modes each predicted from all others.
    kind : {"frequency", "damping"}
        Whose errors: all steps of a way have one.
    """

    name: str
    error: float
    left_out: float
    kind: Telling = "frequency"


def steps(results: Results) -> tuple[Step, ...]:
    """Return the errors of the models, one effect after the other; nothing where no effect was added."""
    if results.diagnosis is not None and len(results.diagnosis.steps) > 1:
        return diagnosis_steps(results.diagnosis)
    if len(results.ledger) < 2:
        return ()
    first, last = results.ledger[0], results.ledger[-1]
    added = " and ".join(name.partition(" (")[0] for name in printed_effects(last.effects))
    named = (("base model", first), (added, last))
    return tuple(Step(name=name, error=entry.error, left_out=entry.mode_error) for name, entry in named)


def diagnosis_steps(diagnosis: Diagnosis) -> tuple[Step, ...]:
    """Return the errors of the models from the base model to the answer of a diagnosis."""
    kind = telling(diagnosis.steps[0], diagnosis.steps[-1])
    names = ["base model"]
    for before, after in itertools.pairwise(diagnosis.steps):
        names.append(" and ".join(diagnosis.labels.get(e, e) for e in after.effects if e not in before.effects))
    return tuple(
        Step(name=name, error=step.error(kind), left_out=step.left_out(kind), kind=kind)
        for name, step in zip(names, diagnosis.steps, strict=True)
    )


def mode_changes(results: Results) -> tuple[ModeError, ...]:
    """Return the errors of all modes before and after; of a fit without effects, those that remain."""
    if results.diagnosis is not None:
        return results.diagnosis.errors
    if results.updated is not None:
        return tuple(
            _mode_error(c.name, r, c.measured_frequency[r], c.frequency_before[r], c.frequency[r])
            for c in results.updated.fit.configuration
            for r in np.flatnonzero(c.used).tolist()
        )
    return tuple(
        _mode_error(tested.name, r, tested.measured.frequency[r], tested.fit.modes.frequency[s], np.nan)
        for tested in results.tested
        if tested.fit is not None
        for r, s in zip(tested.fit.pairing.measured, tested.fit.pairing.model, strict=True)
    )


def _mode_error(configuration: str, mode: int, measured: float, base: float, explained: float) -> ModeError:
    """Return the errors of two frequencies (Hz) of a model, of a mode by its number from 0."""
    errors = {"base": float(base / measured - 1.0), "explained": float(explained / measured - 1.0)}
    return ModeError(configuration=configuration, mode=int(mode) + 1, frequency=float(measured), std=np.nan, **errors)


def errors_with_additions(results: Results) -> dict[str, dict[int, float]]:
    """Return, by configuration and number of the mode, the relative frequency errors with what was identified."""
    errors: dict[str, dict[int, float]] = {}
    for change in mode_changes(results):
        if np.isfinite(change.explained):
            errors.setdefault(change.configuration, {})[change.mode] = change.explained
    return errors


def step_picture(way: Sequence[Step]) -> Picture:
    """Draw how the error falls from step to step."""
    return charted(
        "error_steps",
        step_chart(way),
        alt=f"The mean {_KINDS[way[0].kind]} before and after each step: "
        + "; ".join(f"{step.name} {percent(step.error)}, left out {percent(step.left_out)}" for step in way),
        caption=f"Mean {_KINDS[way[0].kind]} before and after each effect. Left out: each mode predicted by "
        "a fit to all others, which an effect that only bends to the data does not lower.",
        width="half",
    )


def step_chart(way: Sequence[Step]) -> Chart:
    """Return the error before and after each step as a waterfall, of modes fitted and of modes left out."""
    wide = 16  # characters of a line below a bar
    below = ("base model", *(f"+ {step.name}" for step in way[1:]), "what is left")
    names = ["<br>".join(textwrap.wrap(name, wide)) for name in below]
    highest = max(step.error if np.isnan(step.left_out) else max(step.error, step.left_out) for step in way)
    traces = []
    for key, (label, color) in _ERRORS.items():
        value = [getattr(step, key) for step in way]
        fall = [100.0 * (after - before) for before, after in itertools.pairwise(value)]
        steps = [f"{'+' if f > 0.0 else ''}{in_percent(0.01 * f)}" for f in fall]
        marker = {"color": color}
        traces.append(
            {
                "type": "waterfall", "name": label, "offsetgroup": key, "x": names,
                "measure": ["absolute", *("relative" for _ in fall), "total"],
                "y": [100.0 * value[0], *fall, 100.0 * value[-1]],
                "text": [in_percent(value[0]), *steps, in_percent(value[-1])],
                "textposition": ["outside", *("inside" for _ in fall), "outside"], "insidetextanchor": "middle",
                "cliponaxis": False, "hoverinfo": "name+text",
                "increasing": {"marker": marker}, "decreasing": {"marker": {**marker, "line": {"width": 0}}},
                "totals": {"marker": marker}, "connector": {"line": {"width": 1, "color": color, "dash": "dot"}},
            }
        )  # fmt: skip
    return Chart(
        traces=traces,
        layout={
            "yaxis": axis(f"mean {_KINDS[way[0].kind]} [%]", range=[0.0, 112.0 * highest]),
            "xaxis": {"automargin": True, "tickangle": 0},
            "waterfallgap": 0.25,
            "margin": {"r": 8, "t": 66},
        },
    )


def mode_picture(modes: Sequence[ModeError], width: Literal["half", "full"] = "full") -> Picture:
    """Draw the frequency error of every mode, before and after, in half or all of the page's width."""
    after = any(np.isfinite(m.explained) for m in modes)
    return charted(
        "error_modes",
        mode_chart(modes),
        alt=f"Frequency errors of {len(modes)} modes{' before and after' if after else ''}",
        caption="(model - measured) / measured frequency of every mode, with the base model"
        + (" and with what was identified." if after else "."),
        width=width,
    )


def mode_chart(modes: Sequence[ModeError]) -> Chart:
    """Return the frequency errors of the modes, before and after, as bars."""
    labels = [f"{m.mode}: {frequency_text(m.frequency, 0)} Hz" for m in modes]
    series = [("base", "base model", palette.BASE)]
    if any(np.isfinite(m.explained) for m in modes):
        series.append(("explained", "with what was identified", palette.FOUND))
    traces = [
        {
            "type": "bar", "name": name, "x": [[m.configuration for m in modes], labels],
            "y": [100.0 * getattr(m, key) for m in modes], "marker": {"color": color},
            "hovertemplate": "%{x[0]}, %{x[1]}: %{y:+.3f} %<extra>" + name + "</extra>",
        }
        for key, name, color in series
    ]  # fmt: skip
    return Chart(
        traces=traces,
        layout={
            "yaxis": axis("frequency error [%]", zeroline=True),
            "xaxis": {"automargin": True},
            "margin": {"r": 8, "t": 66},
        },
    )


def what_changed_section(what_changed: WhatChanged) -> Section:
    """Show what changed in a state, where, and what else was weighed."""
    named = what_changed.verdict in ("identified", "one of", "partly explained")
    drawn = named and what_changed.map.size > 0
    blocks = (map_picture(what_changed), kind_table(what_changed)) if drawn else (kind_table(what_changed),)
    return Section(title=f"What changed in {what_changed.name}, and where", text=what_changed.sentences, blocks=blocks)


def kind_table(what_changed: WhatChanged) -> Table:
    """List the likeliest kinds of change."""
    most_kinds = 8
    apart = separation(what_changed)
    return Table(
        title="Kinds of change",
        header=("kind", "log odds", "probability", *(f"{a} [mm]" for a in what_changed.axes), "size", "explained [%]"),
        rows=tuple(
            (
                kind.label,
                f"{kind.log_odds:.1f}",
                f"{kind.probability:.2g}",
                *(_place(kind, AXES.index(a), apart) for a in what_changed.axes),
                size_text(kind),
                "" if what_changed.verdict == "unchanged" else f"{100 * kind.explained:.0f}",
            )
            for kind in what_changed.kinds[:most_kinds]
        ),
        note="Log odds: natural logarithm of the posterior odds against no change beyond the scatter of assembly. "
        "Explained: share of the misfit beyond that scatter. "
        + (f"Cannot be: {_impossible(what_changed)}." if what_changed.impossible else ""),
    )


def _place(kind: KindOfChange, axis_: int, apart: Reals) -> str:
    if not kind.local:
        return kind.part or "all over"
    std = np.hypot(kind.place_std[axis_], apart[axis_])
    return f"{1e3 * kind.place[axis_]:z.0f}\N{NO-BREAK SPACE}±\N{NO-BREAK SPACE}{1e3 * std:.0f}"  # in one line


def _impossible(what_changed: WhatChanged) -> str:
    """Say which kinds cannot be, by the reason that they share."""
    by_reason: dict[str, list[str]] = {}
    for name, reason in sorted(what_changed.impossible.items()):
        by_reason.setdefault(reason, []).append(name.replace("_", " "))
    return "; ".join(f"{', '.join(names)} ({reason})" for reason, names in by_reason.items())


def map_picture(what_changed: WhatChanged) -> Picture:
    """Draw the probability of the location over the axes of the map."""
    across, up = what_changed.axes[:2]
    i, j = np.unravel_index(int(np.argmax(what_changed.map)), what_changed.map.shape)
    return charted(
        f"what_changed_{what_changed.name}",
        map_chart(what_changed),
        alt=f"Probability of the location of the change, largest at {across} = {1e3 * what_changed.x[i]:.0f} mm, "
        f"{up} = {1e3 * what_changed.y[j]:.0f} mm",
        caption="Where it changed: probability of each cell of the plan, given that one of the kinds that are left is "
        "right.",
        width="half",
    )


def map_chart(what_changed: WhatChanged) -> Chart:
    """Return the probability of the location as a chart."""
    across, up = what_changed.axes[:2]
    traces = [
        {
            "type": "heatmap", "x": single(1e3 * what_changed.x), "y": single(1e3 * what_changed.y),
            "z": single(100.0 * what_changed.map.T),
            "colorscale": palette.PLACE, "zmin": 0.0,
            "colorbar": {"title": {"text": "probability [%]"}, "thickness": 10},
            "hovertemplate": f"{across} = %{{x:.0f}} mm, {up} = %{{y:.0f}} mm: %{{z:.2g}} %<extra></extra>",
        }
    ]  # fmt: skip
    (x0, x1), (y0, y1) = 1e3 * what_changed.box
    return Chart(
        traces=traces,
        layout={
            "xaxis": axis(f"{across} [mm]", range=[x0, x1]),
            "yaxis": axis(f"{up} [mm]", range=[y0, y1], scaleanchor="x"),
        },
    )
