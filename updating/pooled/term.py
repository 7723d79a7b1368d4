"""Terms of an explanation: what is tried, at which level, and its coordinates.

A term is an effect of the catalogue, something that a file states wrongly, or a contact parameter that a group or a
specimen has other than the rest.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model import Parameter
from updating.diagnosis.coordinates import bounds_of
from updating.diagnosis.explanation import RANGE_PRECISION
from updating.pooled.beside import Bench
from updating.pooled.specimen import Level

Vector = NDArray[np.float64]

CONTACT = {"G_f": "contact stiffness", "d_f": "contact damping"}
"""Contact parameters that a group or a specimen may have other than the rest, and what they are called."""
CONTACT_SPREAD = 0.5
"""Standard deviation of the logarithm of the ratio of such a parameter to that of the rest, beforehand."""
_FARTHEST = 5.0  # such standard deviations


@dataclass(frozen=True, kw_only=True)
class Term:
    """Something that some specimens have.

    Attributes
    ----------
    effect : str
        What: an effect, a hypothesis about the measurement, or a contact parameter.
    level : Level
        Which of them.
    """

    effect: str
    level: Level


@dataclass(frozen=True, kw_only=True)
class Coordinate:
    """One coordinate of a term.

    Attributes
    ----------
    name : str
        The effect parameter, or the nuisance that is shifted.
    parameter : Parameter or None
        The effect parameter, in units of whose range the coordinate is; None of a nuisance.
    members : tuple of int
        Specimens that it is of.
    lower, upper : float
        Its range.
    precision : float
        Of its prior, which is centred at 0; 0 where that is flat over the range.
    """

    name: str
    parameter: Parameter | None
    members: tuple[int, ...]
    lower: float
    upper: float
    precision: float

    @property
    def unseen(self) -> float:
        """Precision of the volume that it has beforehand, which counts in determinants alone."""
        return RANGE_PRECISION if self.precision == 0.0 else 0.0


def coordinates_of(bench: Bench, term: Term) -> tuple[Coordinate, ...]:
    """Return the coordinates of a term."""
    return tuple(own for members in term.level.shares for own in _of_members(bench, term.effect, members))


def _of_members(bench: Bench, effect: str, members: tuple[int, ...]) -> tuple[Coordinate, ...]:
    if effect in bench.effects:
        parameters = bench.effects[effect].parameters
        low, high = bounds_of(parameters)
        return tuple(
            Coordinate(
                name=p.name, parameter=p, members=members, lower=float(a), upper=float(b), precision=0.0
            )
            for p, a, b in zip(parameters, low, high, strict=True)
        )
    return tuple(
        Coordinate(
            name=name,
            parameter=None,
            members=members,
            lower=-_FARTHEST * std,
            upper=_FARTHEST * std,
            precision=std**-2.0,
        )
        for name, std in shifted(bench, effect, members).items()
    )


def shifted(bench: Bench, effect: str, members: Sequence[int]) -> Mapping[str, float]:
    """Return the nuisances that a term shifts which is no effect, with the standard deviations of the shifts."""
    if effect in CONTACT:
        return {effect: CONTACT_SPREAD}
    return bench.own[members[0]].evidence.hypotheses[effect]


def candidates(bench: Bench, levels: Sequence[Level]) -> tuple[Term, ...]:
    """Return all that is tried: effects at every level, faults and contact parameters where they are not all alike.

    What a file states wrongly is so for the whole rig or for one specimen: no treatment turns a torque wrench.
    """
    hypotheses = [
        name
        for name in bench.own[0].evidence.hypotheses
        if all(name in own.evidence.hypotheses for own in bench.own)
    ]
    terms = [Term(effect=name, level=level) for name in bench.effects for level in levels]
    terms += [
        Term(effect=name, level=level)
        for name in hypotheses
        for level in levels
        if level.kind in ("rig", "specimen")
    ]
    terms += [
        Term(effect=name, level=level)
        for name in (CONTACT if bench.own[0].evidence.touching else ())
        for level in levels
        if level.kind in ("group", "specimen")
    ]
    return tuple(terms)


def log_prior(n_effect: int, term: Term, levels: Sequence[Level]) -> float:
    """Return the logarithm of the prior probability of a term over that of its absence.

    Half of all models lack nothing, effects share alike, and so do the rig, the groups together, and the specimens
    together.
    """
    kind = {"rig": "rig", "group": "group"}.get(term.level.kind, "specimen")
    kinds = [{"rig": "rig", "group": "group"}.get(own.kind, "specimen") for own in levels]
    return float(np.log(0.5 / n_effect) - np.log(len(set(kinds))) - np.log(kinds.count(kind)))
