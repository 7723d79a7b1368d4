"""The effects that can be tried, those that matter first, and the values that sliders are set to."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from model import catalogue
from updating.fitting.joint_fit import FittedParameter
from updating.report.identified_model import what_was_found, with_identified_models
from updating.report.results import Results
from updating.workbench.what_if import CONTACT, Knob

FIRST = "found by the diagnosis"
NEXT = "tried by the diagnosis"


def effect_choices(results: Results) -> list[dict[str, str]]:
    """List every effect with its label and its family: what was found first, then the likeliest, then by family.

    The page searches titles and subtitles, so that a family's name finds all of its effects.
    """
    known = catalogue()
    found = what_was_found(results)
    own = () if found is None else found.effects
    tried = _likeliest(results)
    order = sorted(
        known.values(),
        key=lambda e: (
            e.name not in own,
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
                [e.family, *([FIRST] if e.name in own else [NEXT] if e.name in tried else [])]
            ),
        }
        for e in order
    ]


def _likeliest(results: Results) -> list[str]:
    """Return the effects of the explanations that a diagnosis fitted, the most probable first."""
    ranking = () if results.diagnosis is None else results.diagnosis.ranking
    return list(dict.fromkeys(name for own in ranking for name in own.effects))


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
    for own in knobs:
        head = group.get(own.name, "")
        rows.append(
            {
                "name": own.name,
                "step": own.step(own.start),
                "text": own.text(own.start),
                "free": own.name != "pressure",
                "can": own.name != "pressure",
                "head": head if head != last else "",
            }
        )
        last = head
    return rows


def found_values(results: Results, configuration: str) -> tuple[tuple[str, ...], dict[str, float]]:
    """Return the effects that were found and the values of all parameters of one configuration with them.

    G_f and d_f are fitted again with the effects, which takes some seconds where no report did it before.
    """
    found = what_was_found(results)
    if found is None:
        return (), {}
    values = dict(found.value)
    for tested in with_identified_models(results).tested:
        if tested.name == configuration and tested.identified is not None:
            own = tested.identified.fit
            values |= {"G_f": own.G_f.value, "d_f": own.d_f.value}
    return found.effects, values


def fitted_values(
    parameters: Sequence[FittedParameter], configuration: str, configurations: Sequence[str]
) -> Mapping[str, float]:
    """Return the values of a fit that hold for one configuration: its own, and those that are shared."""
    return {p.name: p.value for p in parameters if p.group == configuration or p.group not in configurations}
