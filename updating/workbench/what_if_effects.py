"""The effects that can be tried, those that matter first, and the values that sliders are set to."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from model import catalogue, find_effects
from updating.diagnosis.explained_model import explained_stack
from updating.report.identified_model import what_was_found
from updating.report.results import Results
from updating.workbench.what_if import CONTACT, Knob, explained_values, explanation

FIRST = "identified by the diagnosis"
NEXT = "tried by the diagnosis"


def effect_choices(results: Results) -> list[dict[str, str]]:
    """List every effect with its label and its family: what was identified first, then the likeliest, then by family.

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
                "head": head if head != last else "",
            }
        )
        last = head
    return rows


def values_of(results: Results, configuration: str, effects: Sequence[str]) -> dict[str, float]:
    """Return the values of everything that can be moved in a configuration, with effects as a diagnosis fitted them.

    Without a diagnosis, they are those of the ledger.
    """
    own = explanation(results, effects)
    if own is None or results.diagnosis is None or results.diagnosis.stack is None:
        found = what_was_found(results)
        return {} if found is None else dict(found.value)
    known = find_effects(effects, catalogue())
    return explained_values(explained_stack(results.diagnosis.stack, own, known, state=configuration))
