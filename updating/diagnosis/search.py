"""The search for explanations: the base model, effects alone and in pairs, the promising ones fitted in full."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from model import SolveError, enriched
from model.modes.enrichment import nominal_factor
from model.reduction.through_thickness import N_RIGID
from updating.diagnosis.adequacy import P_ADEQUATE, p_value
from updating.diagnosis.candidates import N_MODEL
from updating.diagnosis.evidence import Evidence
from updating.diagnosis.explanation import Explanation, best_of, explain
from updating.diagnosis.gathering import Gathered
from updating.diagnosis.residual import residual
from updating.diagnosis.scan import MESSAGES, Place, nearest, with_modes_of
from updating.diagnosis.screening import Screened, pair_steps, screen
from updating.workers.workers import distribute

Vector = NDArray[np.float64]
_LOG = logging.getLogger(__name__)

N_SINGLE, N_PAIR, N_BESIDE = 12, 8, 4
"""Effects that are fitted in full; pairs by their linear step; second effects beside each of the best first ones."""
N_FIRST = 3
"""First effects beside which a second is sought anew: where an effect is strong, steps from the base model mislead."""
N_EXACT = 3
"""Explanations whose modes are taken into the basis."""
N_FIRST_STEPS, N_AFAR, N_AFAR_STEPS = 6, 5, 20
"""Evaluations of all fits from afar, how many are then followed, and their evaluations."""
VISIBLE = 3.0
"""Change of the data, in standard deviations, that an effect must be able to bring to be seen."""
_PROMISING = 10.0  # linear fall of the misfit by a second effect from which pairs are fitted
_ASTRAY = 30.0  # squared misfit of a value, in the mean, beyond which a model is astray
_NEAR = 2.0  # misfit over the best beyond which an explanation has lost
_LOST = 30.0  # misfit over the best beyond which other weights cannot bring an explanation back
_CLOSE = 30.0  # misfit above the best within which an explanation may still turn out to be as good
_STEPS = 12  # evaluations of a fit
_REFIT = 8  # the same after the basis or weights have changed, and of pairs


@dataclass(frozen=True, eq=False)
class Start:
    """Effects, and where their fit starts.

    Attributes
    ----------
    effects : sequence of str
        Which.
    nuisance : (n_nuisance,) float
        Nuisance coordinates.
    coordinate : (n_parameter,) float
        Effect parameters in units of their ranges.
    most : int
        Largest number of evaluations.
    """

    effects: Sequence[str]
    nuisance: Vector
    coordinate: Vector
    most: int


@dataclass(frozen=True, eq=False, kw_only=True)
class Search:
    """What was found.

    Attributes
    ----------
    evidence : Gathered
        With the basis of the last fits.
    base : Explanation
        The base model.
    singles, pairs : tuple of Explanation
        Effects alone and two at a time, the best first.
    screened : tuple of Screened
        All effects of the catalogue beside the base model.
    """

    evidence: Gathered
    base: Explanation
    singles: tuple[Explanation, ...]
    pairs: tuple[Explanation, ...]
    screened: tuple[Screened, ...]

    @property
    def explanations(self) -> tuple[Explanation, ...]:
        """All that were fitted in full, the base model first."""
        return (self.base, *self.singles, *self.pairs)


def search(evidence: Gathered, worth: float, executor: Executor | None = None) -> Search:
    """Fit the base model and the effects and pairs that could explain what it leaves.

    Pairs are tried where the best single effect leaves more than chance does, or where a second one promises much.

    Parameters
    ----------
    evidence : Gathered
        Measurement and model.
    worth : float
        Fall of the misfit below which an effect is not worth a fit.
    executor : Executor, optional
        Where fits that do not need each other run; in this process by default.
    """
    places: tuple[Place, ...] = ()
    if evidence.lacking:  # an effect may bring these modes, and the base model meets the others all too well
        places = nearest(evidence.alone, executor)
        evidence = replace(evidence, used=with_modes_of(evidence, places))
    base = explain(evidence)
    evidence = _weighed(evidence, base)
    base = explain(evidence, nuisance=base.nuisance)
    screened = screen(evidence, base)
    promising = sorted((s for s in screened if s.gain > worth), key=lambda s: -s.gain)[:N_SINGLE]
    _LOG.info("fit %d effects, each alone", len(promising))
    alone = _begun(evidence, [Start([s.effect], base.nuisance, s.start, _STEPS) for s in promising], executor)
    if promising:
        nominal_factor(evidence.system.assembly)  # while those are fitted, for `enriched`
    singles = _done(alone)
    afar = _astray(best_of(singles, base))  # even the best effect is: pairs with it would be in vain
    if afar:
        evidence, singles = _from_afar(evidence, places, singles, executor)
    else:
        evidence, singles = _exact(evidence, singles, executor)
    found = _with_pairs(evidence, base, singles, screened, worth, executor)
    if not afar and _astray(base) and p_value(best_of(found.explanations, base)) < P_ADEQUATE:
        evidence, singles = _from_afar(evidence, places, singles, executor)
        found = _with_pairs(evidence, base, singles, screened, worth, executor)
    return found


def _astray(own: Explanation) -> bool:
    """Return whether a model is so far off that steps from it mislead."""
    return own.misfit > _ASTRAY * own.residual.value.size


def _with_pairs(
    evidence: Gathered,
    base: Explanation,
    singles: list[Explanation],
    screened: tuple[Screened, ...],
    worth: float,
    executor: Executor | None,
) -> Search:
    """Weigh the data by what the best single effect changes, fit anew, and fit pairs where they are called for."""
    best = best_of(singles, base)
    if base.misfit - best.misfit > worth:
        evidence = _weighed(evidence, base, best)
        base, singles = _reweighed(evidence, base, singles, executor)
    pairs: list[Explanation] = []
    best = best_of(singles, base)
    if base.misfit - best.misfit > worth:
        others = distribute(partial(screen, evidence.alone), singles[1:N_FIRST], executor)  # begins at once
        beside = screen(evidence, best)
        # shapes are many, and what a second effect changes in few frequencies is little beside their scatter
        if p_value(best) < P_ADEQUATE or max((s.gain for s in beside), default=0.0) > _PROMISING:
            starts = _pair_starts(base, screened, singles, [beside, *others])
            _LOG.info("fit %d pairs", len(starts))
            pairs = _fitted(evidence, starts, executor)
            evidence = _richer(evidence, pairs)
            singles, pairs = _all_again(evidence, singles, pairs, executor)
    return Search(evidence=evidence, base=base, singles=tuple(singles), pairs=tuple(pairs), screened=screened)


def _weighed(evidence: Gathered, base: Explanation, best: Explanation | None = None) -> Gathered:
    """Return evidence that counts less where an effect changes much, and its form decides, see `DiagnosisScatter.form`.

    What it changes is what the base model leaves, or more where nuisances hide it: the difference that the best effect
    makes while all else stays as it is.
    """
    plain = replace(evidence, weight=None)
    left = residual(plain, base.nuisance)
    data = left.kind != "prior"
    change = np.abs(left.value[data])
    if best is not None:
        with_it = residual(plain, best.nuisance, best.parameter, best.coordinate).value[data]
        change = np.maximum(change, np.abs(with_it - residual(plain, best.nuisance).value[data]))
    return replace(evidence, weight=1.0 / np.hypot(1.0, evidence.scatter.form * change))


def _pair_starts(
    base: Explanation,
    screened: Sequence[Screened],
    singles: Sequence[Explanation],
    beside: Sequence[Sequence[Screened]],
) -> list[Start]:
    """Return pairs worth a fit, and from where; `beside` is what was screened beside each of the best effects."""
    # where a pair has several starts, that from the best first effect stands
    start_of: dict[frozenset[str], Start] = {}
    worthy: list[frozenset[str]] = []
    for first, others in zip(singles, beside, strict=False):
        for i, second in enumerate(sorted(others, key=lambda s: -s.gain)):
            names = (first.effects[0], second.effect)
            start = np.concatenate([first.coordinate, second.start])
            start_of.setdefault(frozenset(names), Start(names, first.nuisance, start, _REFIT))
            worthy += [frozenset(names)] * (i < N_BESIDE)
    visible = [s for s in screened if s.reach >= VISIBLE]
    for _, names, coordinate in pair_steps(base, visible)[:N_PAIR]:
        start = np.concatenate(coordinate)
        start_of.setdefault(frozenset(names), Start(names, base.nuisance, start, _REFIT))
        worthy.append(frozenset(names))
    return [start_of[names] for names in dict.fromkeys(worthy)]


def _members(evidence: Evidence, pairs: Sequence[Explanation]) -> list[Start]:
    """Return each effect of pairs alone, from where it stands there: a pair may find what a step missed."""
    starts = []
    for own in pairs:
        coordinate = dict(zip((p.name for p in own.parameter), own.coordinate.tolist(), strict=True))
        for name in own.effects:
            alone = np.array([coordinate[p.name] for p in evidence.parameters((name,))])
            starts.append(Start((name,), own.nuisance, alone, _STEPS))
    return starts


def _from_afar(
    evidence: Gathered, places: Sequence[Place], singles: Sequence[Explanation], executor: Executor | None
) -> tuple[Gathered, list[Explanation]]:
    """Fit effects from where they come nearest over their whole ranges, beside those that are fitted already."""
    starts: list[Start] = []
    for place in places or nearest(evidence.alone, executor):
        nuisance = evidence.start.copy()
        nuisance[0] = np.log(place.G_f / evidence.stack.contact.G_f)
        starts.append(Start([place.effect], nuisance, place.coordinate, N_FIRST_STEPS))
    first = _fitted(evidence, starts, executor)
    afar = _again(evidence, first, executor, N_AFAR, N_AFAR_STEPS)
    return _exact(evidence, _best_of_each([*afar, *singles]), executor)


def _state(evidence: Gathered, own: Explanation) -> dict[str, float]:
    """Return the model's parameters at an explanation, at a pressure amid those that were tested."""
    pressure = float(np.exp(np.mean([np.log(t.pressure) for t in evidence.tested])))
    return {**evidence.theta(own.nuisance, 0), "pressure": pressure, **own.effect_values}


def _fitted(evidence: Gathered, starts: Sequence[Start], executor: Executor | None) -> list[Explanation]:
    """Fit explanations from where they start; one that starts where the model has no modes is left out."""
    return _done(_begun(evidence, starts, executor))


def _begun(
    evidence: Gathered, starts: Sequence[Start], executor: Executor | None
) -> Iterator[Explanation | None]:
    """Begin to fit explanations, where there is an executor at once."""
    return distribute(partial(_explained, evidence.alone), starts, executor, MESSAGES)


def _done(begun: Iterator[Explanation | None]) -> list[Explanation]:
    """Wait for the fits that were begun."""
    return [own for own in begun if own is not None]


def _explained(evidence: Evidence, start: Start) -> Explanation | None:
    try:
        return explain(
            evidence, start.effects, nuisance=start.nuisance, coordinate=start.coordinate, most=start.most
        )
    except SolveError:
        return None


def _best_of_each(fitted: Sequence[Explanation]) -> list[Explanation]:
    """Return the best fit of each explanation."""
    best: dict[tuple[str, ...], Explanation] = {}
    for own in fitted:
        if own.effects not in best or own.misfit < best[own.effects].misfit:
            best[own.effects] = own
    return list(best.values())


def _exact(
    evidence: Gathered, fitted: Sequence[Explanation], executor: Executor | None
) -> tuple[Gathered, list[Explanation]]:
    """Take the modes at the best explanations into the basis and fit these again; return all, the best first."""
    richer = _richer(evidence, fitted)
    return richer, _again(richer, fitted, executor, len(_near(fitted)), _REFIT)


def _richer(evidence: Gathered, fitted: Sequence[Explanation]) -> Gathered:
    """Take the modes at the best explanations into the basis."""
    near = _near(fitted)
    places = [_state(evidence, own) for own in near]
    last = max((int(x.residual.partner.max()) for x in near), default=0)  # elastic mode that has a partner
    return evidence.with_system(enriched(evidence.system, places, max(N_MODEL, N_RIGID + last + 1)))


def _near(fitted: Sequence[Explanation]) -> list[Explanation]:
    """Return the best explanations, those that are not far behind the first."""
    ordered = sorted(fitted, key=lambda x: x.misfit)
    return [x for x in ordered[:N_EXACT] if x.misfit < _NEAR * ordered[0].misfit]


def _reweighed(
    evidence: Gathered, base: Explanation, fitted: Sequence[Explanation], executor: Executor | None
) -> tuple[Explanation, list[Explanation]]:
    """Fit the base model and all others again with other weights; return these with the best first.

    Those that have lost by far are compared only.
    """
    best = min(own.misfit for own in fitted)
    starts = [
        _from(base, _STEPS),
        *(_from(own, _REFIT if own.misfit < _LOST * best else 1) for own in fitted),
    ]
    base, *again = _fitted(evidence, starts, executor)
    return base, sorted(again, key=lambda x: x.misfit)


def _again(
    evidence: Gathered,
    fitted: Sequence[Explanation],
    executor: Executor | None,
    least: int,
    most: int,
) -> list[Explanation]:
    """Fit the best again, with another basis or more steps, and those that are close to them; the best first."""
    first, rest = _parted(fitted, least)
    again = _fitted(evidence, [_from(own, most) for own in first], executor)
    return sorted([*again, *rest], key=lambda x: x.misfit)


def _all_again(
    evidence: Gathered,
    singles: Sequence[Explanation],
    pairs: Sequence[Explanation],
    executor: Executor | None,
) -> tuple[list[Explanation], list[Explanation]]:
    """Fit the best singles and pairs again, with another basis, and the effects of the best pair each alone."""
    (first, rest), (first_pairs, rest_pairs) = (_parted(own, len(_near(own))) for own in (singles, pairs))
    starts = [
        *_members(evidence, first_pairs[:1]),  # first, for they take most steps
        *(_from(own, _REFIT) for own in (*first_pairs, *first)),
    ]
    found = sorted(
        _best_of_each([*_fitted(evidence, starts, executor), *rest, *rest_pairs]), key=lambda x: x.misfit
    )
    return [x for x in found if len(x.effects) == 1], [x for x in found if len(x.effects) > 1]


def _parted(fitted: Sequence[Explanation], least: int) -> tuple[list[Explanation], list[Explanation]]:
    """Part fits into the best with those that are close to them, and the rest."""
    ordered = sorted(fitted, key=lambda x: x.misfit)
    close = max(least, sum(x.misfit < ordered[0].misfit + _CLOSE for x in ordered))
    return ordered[:close], ordered[close:]


def _from(own: Explanation, most: int) -> Start:
    """Return a start where an explanation stands."""
    return Start(own.effects, own.nuisance, own.coordinate, most)
