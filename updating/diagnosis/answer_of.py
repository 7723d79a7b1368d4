"""The answer for any model: the explanations that remain after a search, ranked, and the modes they rest on."""

from __future__ import annotations

import logging
from collections.abc import Sequence

import numpy as np

from updating.diagnosis.answer import Diagnosis, ModeError, confounded_in, overstated_in
from updating.diagnosis.ranking import Explained, log_ratios, pulled, rank, sensor_gains, sizes_of
from updating.diagnosis.visibility import not_visible, ruled_out, visibility
from updating.inference.decide import Decision
from updating.inference.discrepancy import STIFFNESS
from updating.inference.explain import Explanation
from updating.inference.search import Search

_LOG = logging.getLogger(__name__)


def answer_of(model: Explained, search: Search, decision: Decision, asked: Sequence[Sequence[str]] = ()) -> Diagnosis:
    """Return what is said of any model; what is of a stack alone, and the sentences, are left out.

    Parameters
    ----------
    model : Explained
        The model.
    search : Search
        All that was fitted.
    decision : Decision
        The verdict on that.
    asked : sequence of sequence of str
        Explanations that are predicted in full in any case.
    """
    most_shown = 8  # single effects whose changes are listed mode by mode
    _LOG.info("weigh %d explanations", len(search.fitted))
    base, left = search.base, decision.left
    first = left[0] if left else base
    asked_for = [x for x in search.fitted.values() if set(x.terms) in [set(names) for names in asked]]
    ranking = rank(model, search, first, (*decision.steps, *left, *asked_for))
    of = {ranked.effects: ranked for ranked in ranking}
    seen = visibility(model, search, first)
    excluded = list(ruled_out(seen))
    for x in left[1:]:
        excluded = list(ruled_out(visibility(model, search, x, excluded)))
    if decision.verdict == "unlike anything":
        excluded = []
    shown = {*excluded, *(name for x in left for name in x.terms)}  # perhaps only beside what was identified
    far = pulled(first)
    overstated = overstated_in(of[first.terms], model.effects)
    middle, spread = sizes_of(search, first)
    singles = sorted((x for x in search.fitted.values() if len(x.terms) == 1), key=search.odds, reverse=True)
    return Diagnosis(
        stack=None,
        verdict=decision.verdict,
        set=tuple(x.terms for x in left),
        labels={**model.labels, **overstated},
        measurement=(*model.hypotheses, *overstated),
        confounded=confounded_in(set(first.terms) - set(overstated), model.effects),
        explained=of[first.terms].explained,
        steps=tuple(of[x.terms] for x in decision.steps),
        discrepancy=middle,
        discrepancy_spread=spread,
        too_large=decision.too_large,
        unlisted=decision.unlisted,
        mixed_up=(),
        strained=far,
        moved=model.moved(first),
        relieved=tuple(nuisance for nuisance in pulled(base) if nuisance.name not in {s.name for s in far}),
        point_change=None,
        ranking=ranking,
        errors=_errors(model, base, left),
        n_used={state.name: (state.frequency.size, state.frequency.size) for state in model.states},
        signatures={x.terms[0]: tuple((log_ratios(base)[0] - log_ratios(x)[0]).tolist()) for x in singles[:most_shown]},
        ruled_out=tuple(excluded),
        not_visible=tuple(name for name in not_visible(seen) if name not in shown),
        lacking=_lacking(model, first),
        impossible={},
        sensor_gains=sensor_gains(first),
        next_tests=(),
        second_level=None,
        contact=(),
        rig=(),
        sentences=(),
    )


def _lacking(model: Explained, explanation: Explanation) -> tuple[str, ...]:
    """Return the measured modes that are none of the model's, or farther off than any model leaves them."""
    return tuple(
        f"{state.name}, mode {r + 1} at {state.frequency[r]:.1f} Hz"
        for c, (state, e) in enumerate(zip(model.states, explanation.errors, strict=True))
        for r in range(state.frequency.size)
        if (c, r) in explanation.apart or abs(e.frequency[r]) > STIFFNESS.highest
    )


def _errors(model: Explained, base: Explanation, left: Sequence[Explanation]) -> tuple[ModeError, ...]:
    """List the modes with the frequency errors of the base model and of the first explanation that is left."""
    before = np.expm1(-log_ratios(base)[0])
    after = np.expm1(-log_ratios(left[0])[0]) if left else np.full(before.size, np.nan)
    numbered = [(state, r) for state in model.states for r in range(state.frequency.size)]
    return tuple(
        ModeError(
            configuration=state.name,
            mode=r + 1,
            frequency=float(state.frequency[r]),
            std=float(state.frequency_std[r]),
            base=float(b),
            explained=float(a),
        )
        for (state, r), b, a in zip(numbered, before, after, strict=True)
    )
