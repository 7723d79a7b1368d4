"""What is told of the terms of an explanation: what each is worth, and whose it is."""

from __future__ import annotations

import numpy as np
from scipy.special import stdtrit

from updating.diagnosis.coordinates import scaled
from updating.diagnosis.explanation import Z95
from updating.diagnosis.hypotheses import LABELS
from updating.fitting.estimate import ParameterEstimate
from updating.pooled.beside import Bench
from updating.pooled.fit import Fitted, stds
from updating.pooled.search import Found
from updating.pooled.term import CONTACT, Coordinate, Term, coordinates_of
from updating.results.pooled_answer import Part

ALIKE = 0.25
"""Scatter from specimen to specimen, over the mean, up to which what each has of its own is the rig's: a clamp's mass
acts a little differently where the clamp sits elsewhere."""
_FEWEST = 3  # specimens of which that can be said
_ENDS = 1e-4  # of a range, within which a coordinate lies on an end


def parts_of(found: Found, own: Fitted) -> tuple[Part, ...]:
    """Return the terms of an explanation with their 95 % intervals and what each brings.

    An effect of which every specimen has its own value, and all much the same, is told as the rig's.
    """
    beside = found.bench
    std, at, parts = stds(beside, own), 0, []
    for term in own.terms:
        every = coordinates_of(beside, term)
        each = zip(every, own.at.coordinate[at:], std[at:], strict=False)
        estimates = tuple(_estimate(beside, term, c, float(z), float(s)) for c, z, s in each)
        at += len(every)
        scatter = _scatter(beside, term, estimates)
        without = [found.odds(other) for other in found.fitted if set(other.terms) == set(own.terms) - {term}]
        parts.append(
            Part(
                effect=term.effect,
                label=label_of(beside, term.effect),
                level=term.level.kind if np.isnan(scatter) else "rig",
                of=term.level.of,
                specimens=tuple(beside.own[s].specimen.name for s in term.level.members),
                parameter=estimates if np.isnan(scatter) else _means(estimates, len(term.level.members)),
                scatter=0.0 if np.isnan(scatter) else scatter,
                log_odds=found.odds(own) - max(without) if without else float("nan"),
            )
        )
    return tuple(parts)


def label_of(beside: Bench, effect: str) -> str:
    """Return what a person calls an effect, a hypothesis or a contact parameter."""
    return beside.effects[effect].label if effect in beside.effects else {**LABELS, **CONTACT}[effect]


def _scatter(beside: Bench, term: Term, each: tuple[ParameterEstimate, ...]) -> float:
    """Return the scatter of what specimens have of an effect each, over its mean; NaN where it is not the rig's.

    The first parameter of an effect is its strength.
    """
    n = len(term.level.members)
    if term.level.kind != "each" or n < _FEWEST or term.effect not in beside.effects:
        return float("nan")
    strength = np.array([own.value for own in each[:: len(each) // n]])
    scatter = float(np.std(strength, ddof=1) / max(np.abs(np.mean(strength)), np.finfo(float).tiny))
    return scatter if scatter <= ALIKE else float("nan")


def _means(each: tuple[ParameterEstimate, ...], n: int) -> tuple[ParameterEstimate, ...]:
    """Return the means of parameters over specimens, with the 95 % intervals that their scatter gives."""
    k, found = len(each) // n, []
    for own in (each[i::k] for i in range(k)):
        value = np.array([estimate.value for estimate in own])
        reach = float(stdtrit(n - 1, 0.975) * np.std(value, ddof=1) / np.sqrt(n))
        mean = float(np.mean(value))
        found.append(
            ParameterEstimate(
                name=own[0].name.partition("[")[0],
                unit=own[0].unit,
                value=mean,
                lower=mean - reach,
                upper=mean + reach,
                at_bound=all(estimate.at_bound for estimate in own),
            )
        )
    return tuple(found)


def _estimate(beside: Bench, term: Term, c: Coordinate, z: float, std: float) -> ParameterEstimate:
    """Return a coordinate with its 95 % interval as the parameter that it is of."""
    ends = np.clip(z + Z95 * std * np.array([0.0, -1.0, 1.0]), c.lower, c.upper)
    name, unit = c.name, "1"
    if c.parameter is not None:
        values, unit = [scaled(c.parameter, float(x))[0] for x in ends], c.parameter.unit
    elif beside.own[c.members[0]].evidence.unit(c.name) == "1":
        values = np.exp(ends).tolist()
    else:
        values, unit = ends.tolist(), beside.own[c.members[0]].evidence.unit(c.name)
    if term.level.kind == "each":
        name = f"{name}[{beside.own[c.members[0]].specimen.name}]"
    return ParameterEstimate(
        name=name,
        unit=unit,
        value=float(values[0]),
        lower=float(min(values[1:])),
        upper=float(max(values[1:])),
        at_bound=c.parameter is not None and not c.lower + _ENDS < z < c.upper - _ENDS,
    )
