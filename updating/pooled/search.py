"""The search for what specimens and rig lack: terms one by one, each where it helps most, and a look back."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from model import SolveError
from updating.diagnosis.calibration import HALVES, MODEL_FORM, STEP, WIDER
from updating.diagnosis.explanation import Z95
from updating.errors import FitError
from updating.pooled.beside import FAR_OFF, MESSAGES, Bench
from updating.pooled.fit import Fitted, fit, stds
from updating.pooled.linear import Place, Scales, roughly, shapes_that_meet, weighed_at
from updating.pooled.matter import matters
from updating.pooled.screening import Screened, screen
from updating.pooled.specimen import Level
from updating.pooled.starts import (
    BEHIND,
    FIRST,
    MORE,
    SAME,
    Start,
    beside,
    elsewhere,
    global_search,
    in_common,
    looked_back,
    promising,
)
from updating.pooled.term import Term, candidates, coordinates_of, log_prior
from updating.workers.workers import distribute

_LOG = logging.getLogger(__name__)
Vector = NDArray[np.float64]

MOST_TERMS = 4
"""Terms that an explanation may have."""
_CLOSE = 8.0  # within which a fit is followed to its end
_ROUGH = 0.5  # the same as a share of what the best has risen, which a rough model has with such an error
_NEUTRAL = (
    0.5 * (Z95 * WIDER) ** 2
)  # odds that one coordinate of a term may bring that is not told from neutral
_AS_NEAR = 1.2  # ratio to the least error by which one is where no model is nearly right, whatever its odds


@dataclass(frozen=True, eq=False, kw_only=True)
class Found:
    """What was found.

    Attributes
    ----------
    bench : Bench
        The specimens, weighed by the modes at the best of the first terms.
    levels : tuple of Level
        At which effects were tried.
    base : Fitted
        Without terms.
    fitted : tuple of Fitted
        All that were fitted to their end, the most probable first.
    screened : tuple of Screened
        All terms beside the base model.
    n_effect : int
        Effects and hypotheses that were tried.
    """

    bench: Bench
    levels: tuple[Level, ...]
    base: Fitted
    fitted: tuple[Fitted, ...]
    screened: tuple[Screened, ...]
    n_effect: int

    def odds(self, own: Fitted) -> float:
        """Return the logarithm of the posterior odds of an explanation against the base model."""
        prior = sum(log_prior(self.n_effect, term, self.levels) for term in own.terms)
        return own.log_evidence - self.base.log_evidence + prior


def search(bench: Bench, levels: Sequence[Level], executor: Executor | None = None) -> Found:
    """Find the terms that explain what specimens beside their models have in common, and what sets some apart.

    Forward selection by posterior odds, at most `MOST_TERMS`; then each term is left out, and tried at other levels,
    to see whether it is needed as it is.

    Parameters
    ----------
    bench : Bench
        The specimens.
    levels : sequence of Level
        Where something can be.
    executor : Executor, optional
        Where fits that do not need each other run; in this process by default.
    """
    start = Place(nuisance=tuple(own.alone.nuisance for own in bench.own), coordinate=np.zeros(0))
    base = fit(bench, (), start, Scales(), most=MORE)
    first = screen(bench, base, levels, executor)
    n_effect = len({term.effect for term in candidates(bench, levels)})
    found = Found(
        bench=bench, levels=tuple(levels), base=base, fitted=(base,), screened=first, n_effect=n_effect
    )
    best, screened = base, first
    for n in range(MOST_TERMS):
        _LOG.info("term %d of an explanation", n + 1)
        starts = promising(best, screened)
        if not best.terms or best.frequency_error > FAR_OFF:
            starts += global_search(bench, best, levels)
        least = found.odds(best) + STEP if n > 0 else -np.inf
        if not best.terms:
            found = _on_shapes_in_common(found, starts, executor)
            base = best = found.base
        followed = _followed(found, starts, executor, least)
        followed += _followed(found, in_common(found.bench, levels, followed), executor, least)
        top = max(followed, key=found.odds, default=None)
        if n == 0 and top is not None and (found.odds(top) >= STEP or not base.scales.adequate):
            found = _weighed(_with(found, followed), top, executor)
            best, followed = found.base, [own for own in found.fitted if own.terms]
            found = replace(found, fitted=(best,))
        fitted = [
            own for own in followed if not is_form(found.base, best, own) and matters(found.bench, best, own)
        ]
        found = _with(found, fitted)
        top = max(fitted, key=found.odds, default=None)
        if top is None:
            break
        if found.odds(top) < found.odds(best) + STEP and (n > 0 or base.scales.adequate):
            # of a model that is far off, two may show that none alone does, and odds count little what all lack alike
            nearest = min(fitted, key=lambda own: own.frequency_error)
            if best.scales.adequate or nearest.frequency_error > HALVES * best.frequency_error:
                break
            top = nearest
        best = top
        screened = screen(found.bench, best, levels, executor)
    _LOG.info("a look back at each term")
    found, best = _at_better_place(found, best, executor)
    known = {frozenset(own.terms) for own in found.fitted}
    back = _followed(found, looked_back(found.bench, best, first, known), executor)
    found = _with(found, [own for own in back if _is_beyond_form(found, own)])
    return _without_neutral(found, executor)


def asked(
    bench: Bench, levels: Sequence[Level], effects: Sequence[str], executor: Executor | None = None
) -> Found:
    """Fit effects of the rig, one after the other beside those before, each from all places where it promises most.

    Those that a global search found places of come last, whatever the order in which they are asked for: which of its
    places is best, an effect tells beside all others.

    Raises
    ------
    FitError
        The model has no modes with all of them.
    """
    rig = next(own for own in levels if own.kind == "rig")
    start = Place(nuisance=tuple(own.alone.nuisance for own in bench.own), coordinate=np.zeros(0))
    base = best = fit(bench, (), start, Scales(), most=MORE)
    found = Found(
        bench=bench, levels=tuple(levels), base=base, fitted=(base,), screened=(), n_effect=len(effects)
    )
    found_at = {place.effect for place in bench.places}
    for name in sorted(effects, key=lambda name: name in found_at):
        _LOG.info("fit %s", name)
        (own,) = (x for x in screen(found.bench, best, [rig], executor) if x.term.effect == name)
        starts = [beside(best, own)]
        starts += [x for x in global_search(found.bench, best, levels) if x.terms[-1].effect == name]
        if not best.terms:
            found = _on_shapes_in_common(found, starts, executor)
        fitted = _followed(found, starts, executor)
        if not fitted:
            message = f"the stacks have no modes with {', '.join(own.effect for own in starts[0].terms)}"
            raise FitError(message)
        best = max(fitted, key=lambda own: own.log_evidence)
        if len(best.terms) == 1:
            found = _weighed(_with(found, [best]), best, executor)
            best = next((own for own in found.fitted if own.terms == best.terms), best)
    rest = () if best is found.base else (found.base,)
    found, best = _at_better_place(replace(found, fitted=(best, *rest)), best, executor)
    return replace(found, fitted=(best, *(own for own in found.fitted if own is not best)))


def _on_shapes_in_common(found: Found, starts: Sequence[Start], executor: Executor | None) -> Found:
    """Return the base model fitted to the shapes that take part wherever fits start that are weighed by modes there.

    Modes that are close at one place are not at another, so weighed there alone, evidences would be of other data.
    """
    there = [own for own in starts if own.weighed]
    if not there:
        return found
    base = found.base
    bench = _with_shapes_in_common(found.bench, [*there, _from_here(base)], executor)
    bench = weighed_at(bench, base.at, ())
    base = fit(bench, (), base.at, None, most=MORE)
    return replace(found, bench=bench, base=base, fitted=(base,))


def _at_better_place(found: Found, best: Fitted, executor: Executor | None) -> tuple[Found, Fitted]:
    """Move an explanation to where another place of a global search over one of its effects leads, if better.

    Of two places the better one may be the one that is worse as long as a further effect is missing.
    """
    starts = elsewhere(found.bench, best) if len(best.terms) > 1 else []
    if not starts:
        return found, best
    bench = _with_shapes_in_common(found.bench, [_from_here(best), *starts], executor)
    rough = roughly(bench, best.at, best.coordinates)
    here, *others = _done(rough, [_from_here(best), *starts], executor, settled=False)
    better = [own for own in others if here and own and own.log_evidence > here.log_evidence]
    if not better:
        return found, best
    top = max(better, key=lambda own: own.log_evidence)
    followed = [
        _from_here(best),
        Start(terms=top.terms, at=top.at, scales=top.scales, most=MORE, weighed=True),
    ]
    here, there = _done(bench, followed, executor, settled=True)
    if not here or not there or there.log_evidence <= here.log_evidence:
        return found, best
    _LOG.info("another place of %s is better", ", ".join(term.effect for term in top.terms))
    moved = replace(there, log_evidence=best.log_evidence + there.log_evidence - here.log_evidence)
    found = _weighed(_with(found, [moved]), moved, executor)
    return found, next(own for own in found.fitted if own.terms == moved.terms)


def _from_here(own: Fitted) -> Start:
    return Start(terms=own.terms, at=own.at, scales=None, most=FIRST, weighed=True)


def _with_shapes_in_common(bench: Bench, starts: Sequence[Start], executor: Executor | None) -> Bench:
    """Return the specimens of which shapes take no part whose modes are close where any of some fits starts."""
    every = [
        own for own in distribute(partial(_close_at, bench), starts, executor, MESSAGES) if own is not None
    ]
    return replace(bench, apart=tuple(frozenset().union(*own) for own in zip(*every, strict=True)))


def _close_at(bench: Bench, start: Start) -> tuple[frozenset[int], ...] | None:
    coordinates = [own for term in start.terms for own in coordinates_of(bench, term)]
    try:
        return shapes_that_meet(bench, start.at, coordinates)
    except (SolveError, np.linalg.LinAlgError):
        return None  # nor does the fit start


def _without_neutral(found: Found, executor: Executor | None) -> Found:
    """Pass over explanations with a term that may as well be neutral, and fit each without it from where it stands.

    Such a term led the fit to a better place, and brings nothing of its own there. The most neutral one goes first, for
    of two terms that do the same each may be neutral beside the other; and none goes without which the odds fall by
    more than a term so near to neutral can bring.
    """
    while (best := found.fitted[0]).terms and (start := _without_most_neutral(found, best)) is not None:
        further = [own for own in _done(found.bench, [start], executor, settled=True) if own is not None]
        if not further or found.odds(best) - found.odds(further[0]) > _NEUTRAL:
            break
        others = tuple(own for own in found.fitted if own is not best)
        found = _with(replace(found, fitted=others), further)
        if not start.terms:
            found = replace(found, base=next(own for own in found.fitted if not own.terms))
    return found


def _without_most_neutral(found: Found, best: Fitted) -> Start | None:
    """Return the fit without the term that is nearest to neutral, if one may be: None where none is."""
    std, at, farthest = stds(found.bench, best), 0, []
    for term in best.terms:
        own = slice(at, at + len(coordinates_of(found.bench, term)))
        farthest.append((float(np.max(np.abs(best.at.coordinate[own]) / std[own])), term, own))
        at = own.stop
    away, neutral, own = min(farthest, key=lambda each: each[0])
    if away > Z95:
        return None
    return Start(
        terms=tuple(term for term in best.terms if term is not neutral),
        at=replace(best.at, coordinate=np.delete(best.at.coordinate, own)),
        scales=best.scales,
        most=MORE,
    )


def is_form(base: Fitted, before: Fitted, after: Fitted) -> bool:
    """Tell whether what a further term brings may be no more than the error of the form of one that is there already.

    An effect that acts in another form than the catalogue's leaves a share of what it changes, alike in all specimens
    that have it. So this is asked of a term that the same specimens have; what fewer have is no error of form.
    """
    (term,) = set(after.terms) - set(before.terms)
    members = term.level.members
    if not any(own.level.members == members for own in before.terms):
        return False
    left = [_misfit(own, members) for own in (base, before, after)]
    return left[1] - left[2] < MODEL_FORM**2 * (left[0] - left[1])


def _is_beyond_form(found: Found, own: Fitted) -> bool:
    """Tell whether an explanation brings more than the form of what it has but for one term, the best of these."""
    less = [x for x in found.fitted if x.terms and set(x.terms) < set(own.terms)]
    before = next((x for x in less if len(x.terms) == len(own.terms) - 1), None)
    return before is None or (not is_form(found.base, before, own) and matters(found.bench, before, own))


def _misfit(own: Fitted, members: Sequence[int]) -> float:
    """Return the squared residuals of some specimens at usual sizes of the discrepancy."""
    found = [own.linear.found[s] for s in members]
    return float(sum(np.sum(each.value[each.kind != "prior"] ** 2) for each in found))


def _weighed(found: Found, best: Fitted, executor: Executor | None) -> Found:
    """Weigh all data by the modes at an explanation, and fit anew what was fitted: what is far off by a few steps.

    What is neither nearly as probable, nor near the least errors where even the best is not adequate, is passed over.
    """
    bench = weighed_at(found.bench, best.at, best.coordinates)
    error = 0.0 if best.scales.adequate else _AS_NEAR * min(own.frequency_error for own in found.fitted)
    starts = [
        Start(terms=own.terms, at=own.at, scales=None, most=FIRST)
        for own in found.fitted
        if not own.terms or found.odds(own) > found.odds(best) - BEHIND or own.frequency_error < error
    ]
    fitted = [own for own in _done(bench, starts, executor, settled=True) if own is not None]
    base = next(own for own in fitted if not own.terms)
    return _with(replace(found, bench=bench, base=base, fitted=()), fitted)


def _followed(
    found: Found, starts: Sequence[Start], executor: Executor | None, least: float = -np.inf
) -> list[Fitted]:
    """Fit explanations, and those that are near the best of them to their end.

    Near are those whose odds are, and that may still come to the least that is asked. Where the best comes to it and
    leaves more than a nearly right model does, those are too that come nearest to the smallest errors: see
    `updating.pooled.verdict.not_told_apart`. What is near is told beside rough models.
    """
    best = found.fitted[0]
    is_near = best.frequency_error < FAR_OFF
    bench = roughly(found.bench, best.at, best.coordinates) if is_near else roughly(found.bench)
    first = [own for own in _done(bench, starts, executor, settled=False) if own is not None]
    if not first:
        return []
    top = max(first, key=found.odds)
    weighed = {start.terms: start.weighed for start in starts}
    told_apart = top.scales.adequate or found.odds(top) < least
    error = 0.0 if told_apart else _AS_NEAR * min(own.frequency_error for own in first)
    odds = max(found.odds(top), least) - max(_CLOSE, _ROUGH * (found.odds(top) - found.odds(best)))
    near = [
        Start(terms=own.terms, at=own.at, scales=own.scales, most=MORE, weighed=weighed[own.terms])
        for own in _apart(first)
        if found.odds(own) > odds or own.frequency_error < error
    ]
    return [own for own in _done(found.bench, near, executor, settled=True) if own is not None]


def _apart(fitted: Iterable[Fitted]) -> list[Fitted]:
    """Return the fits of each explanation that ended apart from those that are more probable."""
    found: list[Fitted] = []
    for own in sorted(fitted, key=lambda own: -own.log_evidence):
        same = (other for other in found if other.terms == own.terms)
        if all(np.max(np.abs(own.at.coordinate - other.at.coordinate)) > SAME for other in same):
            found.append(own)
    return found


def _done(
    bench: Bench, starts: Sequence[Start], executor: Executor | None, *, settled: bool
) -> Iterator[Fitted | None]:
    return distribute(partial(_fitted, bench, settled), starts, executor, MESSAGES)


def _fitted(bench: Bench, settled: bool, start: Start) -> Fitted | None:
    """Fit an explanation from a start; its evidence is one over the noise of the bench, however it is weighed."""
    coordinates = [own for term in start.terms for own in coordinates_of(bench, term)]
    try:
        here = weighed_at(bench, start.at, coordinates) if start.weighed else bench
        own = fit(here, start.terms, start.at, start.scales, most=start.most, settled=settled)
    except (SolveError, np.linalg.LinAlgError):
        return None
    noise = [sum(x.evidence.covariance.log_noise for x in every.own) for every in (here, bench)]
    return replace(own, log_evidence=own.log_evidence - 0.5 * (noise[0] - noise[1]))


def _with(found: Found, further: Iterable[Fitted]) -> Found:
    """Return what was found with further fits; of fits of the same terms the best stays."""
    best: dict[frozenset[Term], Fitted] = {}
    for own in (*found.fitted, *further):
        key = frozenset(own.terms)
        if key not in best or own.log_evidence > best[key].log_evidence:
            best[key] = own
    return replace(found, fitted=tuple(sorted(best.values(), key=lambda own: -found.odds(own))))
