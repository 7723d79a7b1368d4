"""What the data say of effects that were not named: which they exclude, and which they would not show."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from updating.diagnosis.calibration import EXCLUDED, VISIBLE
from updating.diagnosis.fit_settings import coordinate_of
from updating.diagnosis.ranking import Explained
from updating.inference.discrepancy import joined
from updating.inference.explain import Explanation, coordinates_of, errors_at
from updating.inference.protocol import LocalModel, Term
from updating.inference.search import Search
from updating.inference.spread import information, rise


@dataclass(frozen=True, kw_only=True)
class Visible:
    """What data say of a single parameter beside an explanation.

    Attributes
    ----------
    estimate, std : float
        Coordinate and its standard deviation by a linear step, all that is fitted beside it.
    reach : float
        Standard deviations by which the data would change at the farther end of its range.
    excluded : bool
        Whether the data contradict the usual strength of an effect of this one parameter, to either side of neutral.
    """

    estimate: float
    std: float
    reach: float
    excluded: bool = False


def visibility(
    model: Explained, search: Search, explanation: Explanation, among: Collection[str] | None = None
) -> dict[str, dict[str, Visible]]:
    """Return what the data say of the parameters of all effects that an explanation lacks, each beside it alone.

    To first order, but what a linear step calls excluded or visible of an effect of one parameter is asked of the
    model at that strength, for many effects saturate.

    Parameters
    ----------
    model, search, explanation
        The model, the search, and the explanation.
    among : collection of str, optional
        Effects of which this is asked; by default all.
    """
    terms = [model.terms[n] for n in explanation.terms]
    further = [model.terms[n] for n in model.effects if n not in explanation.terms and (among is None or n in among)]
    if not further:
        return {}
    coordinates = coordinates_of(model, [*terms, *further])
    have = {c.name: x for c, x in zip(explanation.coordinates, explanation.x, strict=True)}
    point = np.array([have.get(c.name, 0.0) for c in coordinates])
    local = model.about(coordinates, [point])
    seen: dict[str, dict[str, Visible]] = {}
    placed = [
        t for t in further if any(len(c.starts) > 2 and c.name not in have for c in t.coordinates)
    ]  # what they do depends on where they are
    asked, near = further, local
    for shift in range(max((len(c.starts) for t in placed for c in t.coordinates), default=1)):
        if shift == 1:
            asked, coordinates = placed, coordinates_of(model, [*terms, *placed])
            near = local.of(coordinates)
        at = np.array([have.get(c.name, 0.0) for c in coordinates])
        for i, c in enumerate(coordinates):
            if c.name not in have and len(c.starts) > 2:
                at[i] = c.starts[shift % len(c.starts)]
        problem = joined(
            errors_at(model, near, replace(search.setting, apart=explanation.apart), at), search.setting.common
        )
        mean, std = information(
            problem, at, coordinates, explanation.evidence.sizes, [c.name in have for c in coordinates]
        )
        index = {c.name: i for i, c in enumerate(coordinates)}
        for term in asked:
            for c in term.coordinates:
                i = index[c.name]
                reach = max(abs(c.lower), abs(c.upper)) / float(std[i])
                new = Visible(estimate=float(mean[i]), std=float(std[i]), reach=reach)
                old = seen.setdefault(term.name, {}).get(c.name)
                if old is None or new.std < old.std:
                    seen[term.name][c.name] = new
    here = _left(model, search, explanation, local.of(explanation.coordinates))
    for term in further:
        if len(term.coordinates) == 1:
            (name,) = seen[term.name]
            seen[term.name][name] = _asked(model, search, explanation, local, term, seen[term.name][name], here)
    return seen


def _left(
    model: Explained,
    search: Search,
    explanation: Explanation,
    local: LocalModel,
    further: tuple[Term, float] | None = None,
) -> float:
    """Return the misfit with a further term at a value of its coordinate, all else fitted.

    `local` has the coordinates of the explanation, and of the further term, alone.
    """
    more = [] if further is None else [further[0]]
    coordinates = coordinates_of(model, [*(model.terms[n] for n in explanation.terms), *more])
    have = {c.name: x for c, x in zip(explanation.coordinates, explanation.x, strict=True)}
    at = {**have, **({} if further is None else {further[0].coordinates[0].name: further[1]})}
    x = np.array([at[c.name] for c in coordinates])
    try:
        problem = joined(
            errors_at(model, local, replace(search.setting, apart=explanation.apart), x), search.setting.common
        )
    except (np.linalg.LinAlgError, ValueError):  # the model has no modes there
        return np.inf
    return rise(problem, x, coordinates, explanation.evidence.sizes, [c.name in have for c in coordinates])


def _asked(
    model: Explained,
    search: Search,
    explanation: Explanation,
    local: LocalModel,
    term: Term,
    first: Visible,
    here: float,
) -> Visible:
    """Return the same by the model at the usual strength and at the ends of the range, where first order shows any.

    `here` is the misfit without the term.
    """
    (p,), (c,) = model.effects[term.name].parameters, term.coordinates
    near = cache(lambda: local.of(coordinates_of(model, [*(model.terms[n] for n in explanation.terms), term])))

    def left(value: float) -> float:
        return _left(model, search, explanation, near(), (term, value))

    nominal = coordinate_of(p, p.nominal)
    sides = (nominal, -nominal) if p.lower < p.neutral < p.upper else (nominal,)
    if all(abs(side - first.estimate) > EXCLUDED * first.std for side in sides) and all(
        left(side) - here > EXCLUDED**2 for side in sides
    ):
        return replace(first, excluded=True)
    if first.reach < VISIBLE:
        return first
    most = max(left(float(end)) - here for end in (c.lower, c.upper) if end != 0.0)
    return replace(first, reach=float(np.sqrt(np.clip(most, 0.0, first.reach**2))))


def ruled_out(seen: Mapping[str, Mapping[str, Visible]]) -> tuple[str, ...]:
    """Return the effects of one parameter whose usual strength the data contradict."""
    return tuple(sorted(name for name, of in seen.items() if any(visible.excluded for visible in of.values())))


def not_visible(seen: Mapping[str, Mapping[str, Visible]]) -> tuple[str, ...]:
    """Return the effects that would not show at either end of the range of any of their parameters."""
    return tuple(
        sorted(name for name, of in seen.items() if max((v.reach for v in of.values()), default=0.0) < VISIBLE)
    )
