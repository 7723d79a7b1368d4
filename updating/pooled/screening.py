"""What each effect could explain at each level, by a linear step of all specimens at once: what is worth a full fit.

Once the specimens' own coordinates and what they share are eliminated, an effect at a level is a border of one or a few
coordinates, so hundreds of them cost less than the signatures that they are made of.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from model import Parameter, SolveError
from updating.diagnosis.coordinates import bounds_of
from updating.diagnosis.explanation import TRUST
from updating.pooled.algebra import Joined, Reduced, bounded, spread
from updating.pooled.beside import MESSAGES, Bench
from updating.pooled.fit import Fitted, Weighing
from updating.pooled.linear import Linear, linearized
from updating.pooled.specimen import Level
from updating.pooled.term import Coordinate, Term, candidates, coordinates_of, log_prior
from updating.workers.workers import distribute

Vector = NDArray[np.float64]

_SHAPES = 6  # values tried of a parameter that shapes an effect but has no strength of its own
_SILENT = 1e-9  # relative length of a change that is none
_SEEN = 1e-12  # share of a coordinate's precision that is its own, below which others do all that it does


@dataclass(frozen=True, eq=False, kw_only=True)
class Screened:
    """What a term could add.

    Attributes
    ----------
    term : Term
        What, and which specimens.
    start : (n_coordinate,) float
        Coordinates where its changes were taken. A fit starts there, so that own coordinates go along with its first
        step: without them modes would be taken for others.
    log_gain : float
        Rise of the logarithm of the evidence by the linear step, that of the prior probability included.
    detectability : float
        Change of the data at the end of the range, beside all else, in standard deviations.
    """

    term: Term
    start: Vector
    log_gain: float
    detectability: float


def screen(
    bench: Bench, at: Fitted, levels: Sequence[Level], executor: Executor | None = None
) -> tuple[Screened, ...]:
    """Return what every effect at every level could add to a fit, the most promising first.

    Parameters
    ----------
    bench : Bench
        The specimens.
    at : Fitted
        What is fitted already.
    levels : sequence of Level
        At which effects are tried.
    executor : Executor, optional
        Where a part of the work may run.
    """
    fitted = {own.parameter.name for own in at.coordinates if own.parameter is not None}
    parameters = list(
        {p.name: p for e in bench.effects.values() for p in e.parameters if p.name not in fitted}.values()
    )
    every = [*candidates(bench, levels)]
    n_effect = len({own.effect for own in every})
    neutral = _Bordered(bench, at, linearized(bench, at.at, at.coordinates, parameters))
    shaping = {p.name for p in parameters if neutral.is_silent(p)}
    shaped = {
        name
        for name, e in bench.effects.items()
        if {p.name for p in e.parameters} & shaping and len(e.parameters) > 1
    }
    new = [term for term in every if _is_new(term, at, fitted, bench)]
    prior = {term: log_prior(n_effect, term, levels) for term in new}
    best = {term: neutral.screened(term, {}, prior[term]) for term in new if term.effect not in shaped}
    tried = partial(_tried, bench, at, {term: own for term, own in prior.items() if term.effect in shaped})
    for further in distribute(
        tried,
        list(_shapes(bench, sorted(shaped & {term.effect for term in new}), shaping)),
        executor,
        MESSAGES,
    ):
        for own in further:
            if own.term not in best or own.log_gain > best[own.term].log_gain:
                best[own.term] = own
    return tuple(sorted(best.values(), key=lambda own: -own.log_gain))


def _is_new(term: Term, at: Fitted, fitted: set[str], bench: Bench) -> bool:
    """Tell whether a term is not fitted already, nor can be told from what is."""
    if term in at.terms:
        return False
    return term.effect not in bench.effects or all(
        p.name not in fitted for p in bench.effects[term.effect].parameters
    )


def _shapes(bench: Bench, names: Sequence[str], shaping: set[str]) -> Iterator[tuple[str, dict[str, float]]]:
    """Yield where effects are taken that a parameter shapes, over the range of that."""
    for name in names:
        turned = [p for p in bench.effects[name].parameters if p.name in shaping]
        low, high = bounds_of(turned)
        axes = [np.linspace(a, b, _SHAPES) for a, b in zip(low, high, strict=True)]
        for values in itertools.product(*axes):
            yield name, dict(zip((p.name for p in turned), map(float, values), strict=True))


def _tried(
    bench: Bench, at: Fitted, prior: Mapping[Term, float], shape: tuple[str, dict[str, float]]
) -> list[Screened]:
    """Return what an effect could add at each level where it is taken, none where there is no such stack."""
    name, where = shape
    own = bench.effects[name].parameters
    start = np.array([where.get(p.name, 0.0) for p in own])
    try:
        bordered = _Bordered(bench, at, linearized(bench, at.at, at.coordinates, own, start))
    except SolveError:  # with what is fitted already
        return []
    return [bordered.screened(term, where, log) for term, log in prior.items() if term.effect == name]


class _Bordered:
    """A fit with columns beside it, all that is fitted eliminated."""

    def __init__(self, bench: Bench, at: Fitted, linear: Linear) -> None:
        self._bench, self._linear = bench, linear
        weighing = Weighing(bench, linear, at.coordinates, at.at.coordinate)
        self._found: list[Reduced] = weighing.reduced(at.scales)
        joint: Joined = weighing.joined(self._found, at.scales)
        k = len(at.coordinates)
        self._n = joint.slope.size - k
        held = joint.precision.copy()
        at_end = np.arange(self._n, self._n + k)
        held[at_end, at_end] += [TRUST if c.precision == 0.0 else 0.0 for c in at.coordinates]
        root = la.cho_factor(held)
        self._places = [linear.placed(s, at.coordinates) for s in range(len(linear.block))]
        # of each specimen: how its effect columns go with what is fitted, with each other, and with the value
        self._beside, self._own, self._slope = [], [], []
        stays = -la.cho_solve(root, joint.slope)
        for own, where in zip(self._found, self._places, strict=True):
            n_column = where.shape[0]
            both = spread(own.gram, self._n, np.hstack([where, np.eye(n_column)]))
            base, column = self._n + k, slice(self._n + k, self._n + k + n_column)
            self._beside.append(both[:base, column])
            self._own.append(both[column, column])
            self._slope.append(both[column, -1] + both[:base, column].T @ stays)
        self._solved = [la.cho_solve(root, own) for own in self._beside]

    def is_silent(self, parameter: Parameter) -> bool:
        """Tell whether a parameter changes nothing where it is taken."""
        k = self._linear.column.index(parameter.name)
        longest = max(float(np.diag(own).max()) for own in self._own)
        return max(float(own[k, k]) for own in self._own) <= _SILENT**2 * longest

    def screened(self, term: Term, where: dict[str, float], prior: float) -> Screened:
        """Return what a term could add by a step from where its columns were taken."""
        every = coordinates_of(self._bench, term)
        own = [c for c in every if c.name not in where]
        precision, slope = self._border(own)
        known = np.array([c.precision for c in own])
        unseen = np.array([c.unseen for c in own])
        low, high = (np.array([getattr(c, end) for c in own]) for end in ("lower", "upper"))
        step = bounded(precision + np.diag(known), slope, low, high)
        fall = -float(step @ (precision + np.diag(known)) @ step + 2.0 * slope @ step)
        volume = np.linalg.slogdet(precision + np.diag(known + unseen))[1] - np.sum(np.log(known + unseen))
        visible = np.sqrt(np.maximum(np.diag(precision), 0.0)) * np.maximum(np.abs(low), np.abs(high))
        return Screened(
            term=term,
            start=np.array([where.get(c.name, 0.0) for c in every]),
            log_gain=0.5 * (fall - float(volume)) + prior,
            detectability=float(visible.max(initial=0.0)),
        )

    def free(self, own: Coordinate) -> tuple[float, float]:
        """Return the value of one coordinate of which nothing is known beforehand, and its standard deviation."""
        precision, slope = self._border([own])
        return float(-slope[0] / precision[0, 0]), float(precision[0, 0] ** -0.5)

    def _border(self, own: Sequence[Coordinate]) -> tuple[Vector, Vector]:
        """Return precision and slope of coordinates when all that is fitted goes with them."""
        column = [self._linear.column.index(c.name) for c in own]
        beside = [sum(self._beside[s][:, k] for s in c.members) for c, k in zip(own, column, strict=True)]
        solved = [sum(self._solved[s][:, k] for s in c.members) for c, k in zip(own, column, strict=True)]
        precision = -np.array([[a @ b for b in solved] for a in beside])
        for i, (one, k) in enumerate(zip(own, column, strict=True)):
            for j, (other, m) in enumerate(zip(own, column, strict=True)):
                both = set(one.members) & set(other.members)
                precision[i, j] += sum(self._own[s][k, m] for s in both)
        least = [_SEEN * sum(self._own[s][k, k] for s in c.members) for c, k in zip(own, column, strict=True)]
        slope = np.array(
            [sum(self._slope[s][k] for s in c.members) for c, k in zip(own, column, strict=True)]
        )
        return 0.5 * (precision + precision.T) + np.diag(least), slope


def contrasts(
    bench: Bench, at: Fitted, asked: Sequence[tuple[str, Level]]
) -> tuple[tuple[float, float], ...]:
    """Return logarithms of contact parameters of groups over those of the others, with their standard deviations.

    Nothing is known of them beforehand. Where a group has a term of its own for a parameter, that gives way to what is
    returned.

    Parameters
    ----------
    bench : Bench
        The specimens.
    at : Fitted
        The explanation.
    asked : sequence of (str, Level)
        The contact parameter, and the group.
    """
    bordered = _Bordered(bench, at, linearized(bench, at.at, at.coordinates))
    return tuple(
        bordered.free(
            Coordinate(
                name=parameter,
                parameter=None,
                members=level.members,
                lower=-np.inf,
                upper=np.inf,
                precision=0.0,
            )
        )
        for parameter, level in asked
    )
