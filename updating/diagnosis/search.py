"""The search for explanations: the base model, effects alone, and further ones step by step with a look back."""

from __future__ import annotations

import itertools
import logging
from collections import Counter
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from model import enriched
from model.modes.enrichment import nominal_factor
from model.reduction.through_thickness import N_RIGID
from updating.diagnosis.assembly import Assembled, scattered
from updating.diagnosis.calibration import MIXED_UP, MODEL_FORM, STEP, STRAINED, VISIBLE
from updating.diagnosis.candidates import N_MODEL
from updating.diagnosis.evidence import Evidence
from updating.diagnosis.explanation import Explanation, explain, explained, likeliest
from updating.diagnosis.global_search import global_search
from updating.diagnosis.hypotheses import STATED_PLACE
from updating.diagnosis.mixed_up import MOST, MixedUp, put_right
from updating.diagnosis.residual import covariance_of
from updating.diagnosis.scan import Place, nearest, with_modes_of
from updating.diagnosis.screening import Screened, pair_steps, release, screen
from updating.diagnosis.starts import Start, begin, finished, started_at
from updating.workers.workers import distribute

Vector = NDArray[np.float64]
_LOG = logging.getLogger(__name__)

MOST_EFFECTS = 4
"""Effects that an explanation may have."""
N_SINGLE, N_PAIR, N_BESIDE = 12, 6, 4
"""Effects that are fitted in full; pairs by their linear step; further effects beside each of the best explanations."""
N_ALWAYS = 3
"""Effects that are fitted however little their linear step promises: it may mislead."""
N_FIRST = 2
"""Explanations beside which a further effect is sought: steps from the base model mislead where one is strong."""
N_EXACT = 3
"""Explanations whose modes are taken into the basis."""
_STIFF, _LOSSY = ("frequency", "shape"), ("damping",)  # kinds of data in which a form is wrong together
_FAR_OFF = 0.02  # frequency error of the best single effect, beyond which steps from the base model mislead
_MET = 0.005  # frequency error of an explanation that meets what a far-off base model misses: steps from that are idle
_ASTRAY = 0.2  # frequency error of the base model, beyond which its shapes say nothing of single points
_BEHIND = 12.0  # logarithm of odds by which a linear step is behind the best and not worth a fit
_CLOSE = 6.0  # logarithm of odds within which an explanation may still turn out to be as good
_ELSEWHERE = (
    0.1  # difference of two coordinates, in units of a range, from which a fit may have ended elsewhere
)
_STEPS = 12  # evaluations of a fit
_REFIT = 8  # the same after basis or weights have changed, and of several effects


@dataclass(frozen=True, eq=False, kw_only=True)
class Search:
    """What was found.

    Attributes
    ----------
    evidence : Assembled
        With basis and weights of the last fits.
    base : Explanation
        The base model.
    fitted : tuple of Explanation
        All others, those of one effect first and by posterior odds within each number.
    screened : tuple of Screened
        All effects of the catalogue beside the base model.
    mixed_up : tuple of MixedUp
        Points that were mixed up in the measurement, and were put right before anything else.
    asked : tuple of Explanation
        Those of `fitted` that were asked for, whatever the search would have tried.
    """

    evidence: Assembled
    base: Explanation
    fitted: tuple[Explanation, ...]
    screened: tuple[Screened, ...]
    mixed_up: tuple[MixedUp, ...]
    asked: tuple[Explanation, ...] = ()

    @property
    def singles(self) -> tuple[Explanation, ...]:
        """Effects alone."""
        return self.of(1)

    @property
    def explanations(self) -> tuple[Explanation, ...]:
        """All that were fitted in full, the base model first."""
        return (self.base, *self.fitted)

    def of(self, number: int) -> tuple[Explanation, ...]:
        """Return the explanations of so many effects, the most probable first."""
        return tuple(x for x in self.fitted if len(x.effects) == number)

    def odds(self, own: Explanation) -> float:
        """Return the logarithm of the posterior odds of an explanation against the base model."""
        return log_odds(self.evidence, own, self.base)


def log_prior(evidence: Evidence, n: int) -> float:
    """Return the logarithm of the prior probability of an explanation of n effects, over that of the base model.

    Half of all models lack nothing, and each further effect is as much rarer; they share alike.
    """
    return n * float(np.log(0.5 / max(len(evidence.effects), 1)))


def is_form(base: Explanation, before: Explanation, after: Explanation) -> bool:
    """Tell whether what a further effect brings may be no more than the error of the form of what is there before it.

    An effect that acts in another form than the catalogue's leaves a share of what it changes, and further effects
    that happen to fit it are no more than that. What it changes in frequencies and shapes says nothing of damping,
    nor the other way round: a loss beside an added mass is no error of that mass. And it acts in that form at all
    torques alike: what relieves the differences between them, which assembly and torque do not explain, is none. Where
    clamps are supposed to sit elsewhere than stated, though, the model follows them only nearly, and what that leaves
    strains what is known of the steel.
    """
    relieved = before.strain - after.strain > STRAINED**2 and STATED_PLACE not in before.effects
    if not before.effects or relieved:
        return False
    share = explained(base, before)
    if explained(base, after) - share >= MODEL_FORM**2 * share:
        return False
    first, last, further = base.residual, before.residual, after.residual
    for kinds in _STIFF, _LOSSY:
        of = np.isin(last.kind, kinds)
        changed = np.sum((last.value[of] - first.value[of]) ** 2)
        brought = np.sum(last.value[of] ** 2) - np.sum(further.value[of] ** 2)
        if brought > max(MODEL_FORM**2 * changed, VISIBLE**2):
            return False
    return True


def log_odds(evidence: Evidence, own: Explanation, base: Explanation) -> float:
    """Return the logarithm of the posterior odds of an explanation against the base model."""
    return own.log_evidence - base.log_evidence + log_prior(evidence, len(own.effects))


def search(
    evidence: Assembled, executor: Executor | None = None, asked: Sequence[Sequence[str]] = ()
) -> Search:
    """Fit the base model and the effects, alone and together, that could explain what it leaves.

    Forward selection by posterior odds: beside the best explanations of n effects, further ones are sought until the
    next does not raise the odds; then what each of several effects brings is seen by leaving it out (Occam's window,
    Madigan and Raftery, J. Am. Stat. Assoc. 89, 1994).

    Parameters
    ----------
    evidence : Assembled
        Measurement and model.
    executor : Executor, optional
        Where fits that do not need each other run; in this process by default.
    asked : sequence of sequence of str
        Explanations that are fitted in any case.
    """
    places: tuple[Place, ...] = ()
    if evidence.lacking:  # an effect may bring these modes, and the base model meets the others all too well
        places = nearest(evidence.alone, executor)
        evidence = _weighed(replace(evidence, used=with_modes_of(evidence, places)))
    base = explain(evidence)
    for _ in range(2):
        evidence = _weighed(evidence, base)
        base = explain(evidence, nuisance=base.nuisance)
    evidence, base, mixed_up = _in_order(evidence, base)
    screened = screen(evidence, base)
    chosen = _promising(screened, N_SINGLE)
    _LOG.info("fit %d effects, each alone", len(chosen))
    astray = base.residual.frequency_error > _FAR_OFF  # a step's own place of an effect may mislead
    starts = [
        Start([s.effect], base.nuisance, where, _STEPS)
        for s in chosen
        for where in (s.start, *(s.elsewhere if astray else ()))
    ]
    starts += [Start([name], base.nuisance, np.zeros(0), _STEPS) for name in _supposed(evidence, base)]
    fits = begin(evidence, starts, executor)
    nominal_factor(evidence.system.assembly)  # while those are fitted, for `enriched`
    singles = finished(fits)
    if places or likeliest([base, *singles]).residual.frequency_error > _FAR_OFF:
        singles += global_search(evidence, places, executor)
    best = likeliest([base, *singles])
    evidence = _weighed(_richer(evidence, [best, *singles]), best)
    base, *singles = _again(evidence, [base, *_best_of_each_place(singles)], executor)
    singles = _best_of_each(singles)
    fitted = _with_further(evidence, base, singles, screened, executor)
    fitted = _with_asked(evidence, base, fitted, screened, asked, executor)
    return Search(
        evidence=evidence,
        base=base,
        fitted=_ordered(evidence, base, fitted),
        screened=screened,
        mixed_up=mixed_up,
        asked=tuple(x for x in fitted if frozenset(x.effects) in set(map(frozenset, asked))),
    )


def _with_asked(
    evidence: Assembled,
    base: Explanation,
    fitted: Sequence[Explanation],
    screened: Sequence[Screened],
    asked: Sequence[Sequence[str]],
    executor: Executor | None,
) -> list[Explanation]:
    """Return what was fitted with what was asked for beside it, each from its effects' own linear steps."""
    known = {frozenset(x.effects) for x in fitted}
    places = {p.name: float(z) for s in screened for p, z in zip(s.parameter, s.start, strict=True)}
    starts = [
        Start(names, base.nuisance, np.array([places[p.name] for p in evidence.parameters(names)]), _STEPS)
        for names in asked
        if frozenset(names) not in known
    ]
    return _best_of_each([*fitted, *finished(begin(evidence, starts, executor))])


def _in_order(evidence: Assembled, base: Explanation) -> tuple[Assembled, Explanation, tuple[MixedUp, ...]]:
    """Put points right that were mixed up, and fit the base model again."""
    found: list[MixedUp] = []
    while len(found) < MOST and base.residual.frequency_error < _ASTRAY:
        right, mixed_up = put_right(evidence, base.residual)
        if mixed_up is None:
            break
        right = _weighed(scattered(right), base)
        refitted = explain(right, nuisance=base.nuisance)
        rise = refitted.log_evidence - base.log_evidence
        rise -= 0.5 * (right.covariance.log_noise - evidence.covariance.log_noise)
        if rise < MIXED_UP:  # it does not bear out what first order promised
            break
        evidence, base = right, refitted
        found.append(mixed_up)
    return evidence, base, tuple(found)


def _with_further(
    evidence: Assembled,
    base: Explanation,
    singles: Sequence[Explanation],
    screened: Sequence[Screened],
    executor: Executor | None,
) -> list[Explanation]:
    """Return single effects with what further effects beside the best bring, step by step."""
    fitted = list(singles)
    level, best = list(_ordered(evidence, base, singles)), base
    for n in range(2, MOST_EFFECTS + 1):
        least = log_odds(evidence, best, base) + STEP
        rising = [x for x in level if log_odds(evidence, x, base) >= least]
        beyond = [x for x in rising if not is_form(base, best, x)]
        if not beyond:  # what else is there cannot be told from the error of a form
            break
        best = beyond[0]
        # where the base model is far off, odds are large, and so are their differences
        astray = base.residual.frequency_error > _FAR_OFF and not _is_met(base, fitted)
        near = np.inf if astray else 3.0 * _CLOSE
        first = [x for x in beyond[:N_FIRST] if best.log_evidence - x.log_evidence < near]
        beside = list(distribute(partial(screen, evidence.alone), first, executor))
        pairs = screened if n == 2 and not _is_met(base, fitted) else ()
        starts = _further_starts(evidence, base, pairs, first, beside)
        starts += _from_alone(starts, singles) if astray else []
        _LOG.info("fit %d explanations of %d effects", len(starts), n)
        level = _best_of_each(finished(begin(evidence, starts, executor)))
        fitted += level
        level = list(_ordered(evidence, base, level))
    best = max([base, *fitted], key=lambda x: log_odds(evidence, x, base))
    return _best_of_each(
        [*fitted, *finished(begin(evidence, _parts(evidence, best, base, fitted), executor))]
    )


def _further_starts(
    evidence: Evidence,
    base: Explanation,
    screened: Sequence[Screened],
    first: Sequence[Explanation],
    beside: Sequence[Sequence[Screened]],
) -> list[Start]:
    """Return explanations of one effect more that are worth a fit, and from where.

    `beside` is what was screened beside each of the `first`; `screened`, beside the base model, gives pairs, if any.
    """
    start_of: dict[frozenset[str], Start] = {}
    for own, others in zip(first, beside, strict=True):
        for further in _promising(others, N_BESIDE):
            names = (*own.effects, further.effect)
            start = np.concatenate([own.coordinate, further.start])
            start_of.setdefault(frozenset(names), Start(names, own.nuisance, start, _REFIT))
        for name in _supposed(evidence, own):
            if name not in own.effects:
                names = (*own.effects, name)
                start_of.setdefault(frozenset(names), Start(names, own.nuisance, own.coordinate, _REFIT))
    visible = [s for s in screened if s.detectability >= VISIBLE]
    for _, names, coordinate in pair_steps(base, visible)[:N_PAIR]:
        start = np.concatenate(coordinate)
        start_of.setdefault(frozenset(names), Start(names, base.nuisance, start, _REFIT))
    return list(start_of.values())


def _from_alone(starts: Sequence[Start], singles: Sequence[Explanation]) -> list[Start]:
    """Return the same starts with the further effect where it ended alone, if it has a place beside its strength."""
    alone = {own.effects[0]: own.coordinate for own in singles if own.coordinate.size > 1}
    found = []
    for start in starts:
        where = alone.get(start.effects[-1])
        if where is not None:
            begin = np.concatenate([start.coordinate[: -where.size], where])
            found.append(replace(start, coordinate=begin))
    return found


def _promising(screened: Sequence[Screened], most: int) -> list[Screened]:
    """Return the effects whose linear step promises most, without those that promise nothing or are far behind."""
    ordered = sorted(screened, key=lambda s: -s.log_gain)
    least = max(0.0, ordered[0].log_gain - _BEHIND) if ordered else 0.0
    return [s for i, s in enumerate(ordered[:most]) if i < N_ALWAYS or s.log_gain > least]


def _supposed(evidence: Evidence, own: Explanation) -> list[str]:
    """Return the hypotheses about the measurement that promise something beside an explanation."""
    return [
        name for name in evidence.hypotheses if name not in own.effects and release(evidence, own, name) > 0.0
    ]


def _is_met(base: Explanation, fitted: Sequence[Explanation]) -> bool:
    """Tell whether the best explanation meets what the base model misses by far: steps from there lead nowhere."""
    best = likeliest([base, *fitted])
    return base.residual.frequency_error > _FAR_OFF and best.residual.frequency_error < _MET


def _parts(
    evidence: Evidence, own: Explanation, base: Explanation, fitted: Sequence[Explanation]
) -> list[Start]:
    """Return what an explanation is without some of its effects, from where it stands.

    Each was perhaps fitted alone already, but a strong effect may then have ended elsewhere. It is weighed with what it
    left then, or else with what the base model leaves, as a part may.
    """
    there = dict(zip((p.name for p in own.parameter), own.coordinate.tolist(), strict=True))
    sizes = {frozenset(x.effects): x.likeliest for x in fitted}
    starts = []
    for n in range(1, len(own.effects)):
        for kept in itertools.combinations(own.effects, n):
            where = np.array([there[p.name] for p in evidence.parameters(kept)])
            begins = sizes.get(frozenset(kept), base.likeliest)
            starts.append(Start(kept, own.nuisance, where, _STEPS, begins))
    return starts


def _weighed(evidence: Assembled, own: Explanation | None = None) -> Assembled:
    """Return evidence that is weighed with the discrepancy that an explanation leaves, by its modes."""
    if own is None:
        return replace(evidence, covariance=covariance_of(evidence, evidence.start))
    return replace(
        evidence,
        covariance=covariance_of(evidence, own.nuisance, own.parameter, own.coordinate),
        sizes=own.likeliest,
    )


def _state(evidence: Assembled, own: Explanation) -> dict[str, float]:
    """Return the model's parameters at an explanation, at a pressure amid those that were tested."""
    pressure = float(np.exp(np.mean([np.log(t.pressure) for t in evidence.tested])))
    return {**evidence.theta(own.nuisance, 0), "pressure": pressure, **own.effect_values}


def _best_of_each(fitted: Sequence[Explanation]) -> list[Explanation]:
    """Return the best fit of each explanation."""
    best: dict[frozenset[str], Explanation] = {}
    for own in fitted:
        key = frozenset(own.effects)
        if key not in best or own.log_evidence > best[key].log_evidence:
            best[key] = own
    return list(best.values())


def _best_of_each_place(fitted: Sequence[Explanation]) -> list[Explanation]:
    """Return the best fits of each explanation that ended apart from each other: other weights may prefer another."""
    best: dict[frozenset[str], list[Explanation]] = {}
    for own in sorted(fitted, key=lambda x: -x.log_evidence):
        places = best.setdefault(frozenset(own.effects), [])
        if all(np.max(np.abs(own.coordinate - x.coordinate), initial=0.0) > _ELSEWHERE for x in places):
            places.append(own)
    return list(itertools.chain.from_iterable(best.values()))


def _richer(evidence: Assembled, fitted: Sequence[Explanation]) -> Assembled:
    """Take the modes at the best explanations into the basis."""
    ordered = sorted(fitted, key=lambda x: -x.log_evidence)
    near = [x for x in ordered[:N_EXACT] if ordered[0].log_evidence - x.log_evidence < 3.0 * _CLOSE]
    places: list[Mapping[str, float]] = [_state(evidence, own) for own in near]
    last = max((int(x.residual.partner.max()) for x in near), default=0)  # elastic mode that has a partner
    return evidence.with_system(enriched(evidence.system, places, max(N_MODEL, N_RIGID + last + 1)))


def _again(
    evidence: Assembled, fitted: Sequence[Explanation], executor: Executor | None
) -> list[Explanation]:
    """Fit explanations again with another basis and other weights, those that have lost by one evaluation alone.

    Which of several places of an explanation is the best is open under other weights, unless one meets the data. Each
    is weighed with what it left itself: by what the best leaves, one that is far off would run off.
    """
    base, *others = fitted
    top = max(x.log_evidence for x in fitted)
    places = Counter(frozenset(x.effects) for x in fitted)
    met = _is_met(base, others)

    def is_open(own: Explanation) -> bool:
        near = top - own.log_evidence < 3.0 * _CLOSE
        return not own.effects or near or (places[frozenset(own.effects)] > 1 and not met)

    starts = [replace(started_at(x, _REFIT if is_open(x) else 1), sizes=x.likeliest) for x in fitted]
    return finished(begin(evidence, starts, executor))


def _ordered(evidence: Evidence, base: Explanation, fitted: Sequence[Explanation]) -> tuple[Explanation, ...]:
    """Return explanations by their number of effects, within each the most probable first."""
    return tuple(sorted(fitted, key=lambda x: (len(x.effects), -log_odds(evidence, x, base))))
