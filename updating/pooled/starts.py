"""Where fits of explanations start: where screens, a global search, and explanations found before point."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from updating.diagnosis.discrepancy import KINDS, MEDIAN
from updating.diagnosis.scan import Place as Single
from updating.pooled.beside import Bench
from updating.pooled.fit import Fitted
from updating.pooled.linear import Place, Scales
from updating.pooled.screening import Screened
from updating.pooled.specimen import Level
from updating.pooled.term import Term, coordinates_of

N_EFFECT, N_LEVEL = 6, 3
"""Effects that are fitted beside what is found, and levels of the most promising of them."""
N_PLACES = 5
"""Places, of a global search over the effects, from which fits start where the base models are far off."""
SAME = 0.05
"""Of a range, within which fits of the same terms have ended at the same place."""
FIRST, MORE, GLOBAL = 6, 8, 12
"""Most steps of a first fit, of one that is followed, and of one of a global search."""
BEHIND = 12.0
"""Logarithm of odds by which a linear step is behind the best and not worth a fit."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Start:
    """Terms, where their fit starts, the largest number of its steps, and whether data are weighed by the modes there.

    They are where modes are others than those of the base models: weighed by these, a fit runs off.
    """

    terms: tuple[Term, ...]
    at: Place
    scales: Scales | None
    most: int
    weighed: bool = False


def usual_at_most(scales: Scales) -> Scales:
    """Return scales with sizes of the discrepancy that are usual at most, by which a fit begins.

    With those that a model leaves that is far off, all that is near seems right, and what all specimens have in common
    is taken for discrepancy. What each has of its own stays: without, single stacks bend the valley of all.
    """
    sizes = {kind: min(getattr(scales, kind), MEDIAN[kind]) for kind in KINDS}
    return replace(scales, **sizes)


def promising(best: Fitted, screened: Sequence[Screened]) -> list[Start]:
    """Return what is worth a fit: the effects that promise most at their best levels, the first ones at others too."""
    chosen: list[Screened] = []
    of: dict[str, int] = {}
    least = screened[0].log_gain - BEHIND if screened else 0.0
    for own in screened:
        n = of.get(own.term.effect, 0)
        is_first = not of or own.term.effect == next(iter(of))
        if (n == 0 and len(of) >= N_EFFECT) or n >= (N_LEVEL if is_first else 1):
            continue
        if own.log_gain < least and len(chosen) >= N_LEVEL:
            continue
        of[own.term.effect] = n + 1
        chosen.append(own)
    return [beside(best, own) for own in chosen]


def beside(best: Fitted, own: Screened) -> Start:
    """Return the fit of a term beside what is found, from where its changes were taken."""
    return Start(
        terms=(*best.terms, own.term),
        at=replace(best.at, coordinate=np.concatenate([best.at.coordinate, own.start])),
        scales=usual_at_most(best.scales),
        most=FIRST,
    )


def global_search(bench: Bench, best: Fitted, levels: Sequence[Level]) -> list[Start]:
    """Return fits of effects of the rig, beside what is found, from where a global search over one specimen finds them.

    The contact of all specimens is moved as that one's is, which has the most modes. What the model misses alike is
    weighed with usual sizes: with those that a model leaves that is far off, all that is near seems right.
    """
    rig = next(own for own in levels if own.kind == "rig")
    there = {term.effect for term in best.terms}
    starts = []
    for place in _near(bench):
        if place.effect not in there:
            at = _moved(bench, best, place)
            at = replace(at, coordinate=np.concatenate([at.coordinate, place.coordinate]))
            terms = (*best.terms, Term(effect=place.effect, level=rig))
            scales = usual_at_most(best.scales)
            starts.append(Start(terms=terms, at=at, scales=scales, most=GLOBAL, weighed=not best.terms))
    return starts


def elsewhere(bench: Bench, best: Fitted) -> list[Start]:
    """Return fits of what is found with a term of the rig at another place of the global search.

    Of two places of one effect the better may be the one that is worse while a further effect is missing.
    """
    starts = []
    for place in _near(bench):
        first = 0
        for term in best.terms:
            own = slice(first, first + len(coordinates_of(bench, term)))
            first = own.stop
            here = best.at.coordinate[own]
            if term.effect != place.effect or term.level.kind != "rig":
                continue
            if np.max(np.abs(here - place.coordinate)) > SAME:
                at = _moved(bench, best, place)
                at.coordinate[own] = place.coordinate
                scales = usual_at_most(best.scales)
                starts.append(Start(terms=best.terms, at=at, scales=scales, most=GLOBAL, weighed=True))
    return starts


def _near(bench: Bench) -> list[Single]:
    return [place for place in bench.places if place.effect in bench.effects][:N_PLACES]


def _moved(bench: Bench, best: Fitted, place: Single) -> Place:
    """Return where an explanation is, with the contact of all specimens moved as a place of the global search asks."""
    looked_at = max(bench.own, key=lambda own: max(used.size for used in own.evidence.used))
    before = best.at.nuisance[bench.own.index(looked_at)][0]
    away = np.log(place.G_f / looked_at.evidence.stack.contact.G_f) - before
    nuisance = tuple(np.append(x[0] + away, x[1:]) for x in best.at.nuisance)
    return Place(nuisance=nuisance, coordinate=best.at.coordinate.copy())


def in_common(bench: Bench, levels: Sequence[Level], fitted: Sequence[Fitted]) -> list[Start]:
    """Return fits of an effect of the rig from what specimens have that have each its own.

    Beside models that are far off, a fit from a small effect that all share may end elsewhere.
    """
    rig = next(own for own in levels if own.kind == "rig")
    starts = []
    for own in fitted:
        term = own.terms[-1]
        if term.level.kind != "each":
            continue
        before = len(own.coordinates) - len(coordinates_of(bench, term))
        each = own.at.coordinate[before:].reshape(len(term.level.members), -1)
        common = np.concatenate([own.at.coordinate[:before], np.median(each, axis=0)])
        starts.append(
            Start(
                terms=(*own.terms[:-1], replace(term, level=rig)),
                at=replace(own.at, coordinate=common),
                scales=usual_at_most(own.scales),
                most=MORE,
            )
        )
    return starts


def looked_back(
    bench: Bench, best: Fitted, screened: Sequence[Screened], known: Collection[frozenset[Term]]
) -> list[Start]:
    """Return the best explanation with each of its terms left out, and with each at the other kinds of levels."""
    starts: list[Start] = []
    at = 0
    for i, term in enumerate(best.terms):
        n = len(coordinates_of(bench, term))
        here = best.at.coordinate[at : at + n]
        before, after = best.at.coordinate[:at], best.at.coordinate[at + n :]
        at += n
        rest = (*best.terms[:i], *best.terms[i + 1 :])
        starts.append(
            Start(
                terms=rest,
                at=replace(best.at, coordinate=np.concatenate([before, after])),
                scales=usual_at_most(best.scales),
                most=FIRST,
            )
        )
        for level in _other_levels(screened, term):
            once = here[: n // len(term.level.shares)]
            own = np.tile(once, len(level.shares))
            starts.append(
                Start(
                    terms=(*best.terms[:i], replace(term, level=level), *best.terms[i + 1 :]),
                    at=replace(best.at, coordinate=np.concatenate([before, own, after])),
                    scales=usual_at_most(best.scales),
                    most=FIRST,
                )
            )
    return [own for own in starts if frozenset(own.terms) not in known and own.terms]


def _other_levels(screened: Sequence[Screened], term: Term) -> list[Level]:
    """Return of each other kind of levels the one at which an effect promised most beside the base model."""
    best: dict[str, Level] = {}
    for own in screened:
        if own.term.effect == term.effect and own.term.level.kind != term.level.kind:
            best.setdefault(own.term.level.kind, own.term.level)
    return list(best.values())
