"""What the data say of effects that were not named: which they exclude, and which they would not show."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from updating.diagnosis.calibration import EXCLUDED, VISIBLE
from updating.diagnosis.coordinates import coordinate_of
from updating.diagnosis.stack_model import StackModel
from updating.inference.discrepancy import joined
from updating.inference.explain import Explanation, coordinates_of, errors_at
from updating.inference.search import Search
from updating.inference.spread import information


@dataclass(frozen=True, kw_only=True)
class Visible:
    """What data say of a single parameter beside an explanation, by a linear step.

    Attributes
    ----------
    estimate, std : float
        Coordinate and its standard deviation, all that is fitted beside it.
    reach : float
        Standard deviations by which the data would change at the farther end of its range.
    """

    estimate: float
    std: float
    reach: float


def visibility(model: StackModel, found: Search, own: Explanation) -> dict[str, dict[str, Visible]]:
    """Return what the data say of the parameters of all effects that an explanation lacks, each beside it alone."""
    terms = [model.terms[n] for n in own.terms]
    further = [model.terms[n] for n in model.effects if n not in own.terms]
    coordinates = coordinates_of(model, [*terms, *further])
    have = {c.name: x for c, x in zip(own.coordinates, own.x, strict=True)}
    point = np.array([have.get(c.name, 0.0) for c in coordinates])
    local = model.about(coordinates, [point])
    seen: dict[str, dict[str, Visible]] = {}
    for shift in range(max((len(c.starts) for c in coordinates), default=1)):
        at = point.copy()
        for i, c in enumerate(coordinates):
            if c.name not in have and _shapes_only(c.starts):
                at[i] = c.starts[shift % len(c.starts)]
        problem = joined(errors_at(model, local, found.setting, at), found.setting.common)
        mean, std = information(
            problem, at, coordinates, own.evidence.sizes, [c.name in have for c in coordinates]
        )
        for term in further:
            for c in term.coordinates:
                i = [k.name for k in coordinates].index(c.name)
                reach = max(abs(c.lower), abs(c.upper)) / float(std[i])
                new = Visible(estimate=float(mean[i]), std=float(std[i]), reach=reach)
                old = seen.setdefault(term.name, {}).get(c.name)
                if old is None or new.std < old.std:
                    seen[term.name][c.name] = new
    return seen


def _shapes_only(starts: tuple[float, ...]) -> bool:
    return len(starts) > 2


def ruled_out(model: StackModel, seen: dict[str, dict[str, Visible]]) -> tuple[str, ...]:
    """Return the effects of one parameter whose nominal strength, to either side of neutral, is too far off."""
    found = []
    for name, of in seen.items():
        parameters = model.effects[name].parameters
        if len(parameters) != 1:
            continue
        (p,), (own,) = parameters, of.values()
        nominal = coordinate_of(p, p.nominal)
        sides = (nominal, -nominal) if p.lower < p.neutral < p.upper else (nominal,)
        if all(abs(side - own.estimate) > EXCLUDED * own.std for side in sides):
            found.append(name)
    return tuple(sorted(found))


def not_visible(seen: dict[str, dict[str, Visible]]) -> tuple[str, ...]:
    """Return the effects that would not show at either end of the range of any of their parameters."""
    return tuple(
        sorted(
            name for name, of in seen.items() if max((v.reach for v in of.values()), default=0.0) < VISIBLE
        )
    )
