"""The search for what is missing: every term alone, then forward with a look back, by evidence and prediction."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from updating.inference.discrepancy import DAMPING, STIFFNESS, SizePrior
from updating.inference.explain import (
    Explanation,
    Setting,
    converged,
    coordinates_of,
    explain,
    outlook,
    setting,
    too_large,
)
from updating.inference.left_out import Kind, LeftOut, left_out
from updating.inference.levels import (
    DAMPING_MATTERS,
    FALLS,
    FREQUENCY_MATTERS,
    INADEQUATE,
    MISSING,
    NAMED,
    PREDICTS,
    PULLED,
    RELEASED,
    RISES,
)
from updating.inference.protocol import Model, Term
from updating.inference.robust_start import robust_start
from updating.inference.screen import screened

Vector = NDArray[np.float64]
_MATTERS: tuple[tuple[Kind, float], ...] = (("frequency", FREQUENCY_MATTERS), ("damping", DAMPING_MATTERS))
_LOG = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False, kw_only=True)
class Prediction:
    """How an explanation predicts what is left out, and how far it pulls what is known.

    Attributes
    ----------
    mode, state : LeftOut
        Errors where modes, and where states, are left out.
    pull : float
        Standard deviations of its prior by which the farthest nuisance was moved.
    """

    mode: LeftOut
    state: LeftOut
    pull: float

    def among(self, states: Sequence[int] | None) -> Prediction:
        """Return the same of some states alone; of all by default."""
        return replace(self, mode=self.mode.among(states), state=self.state.among(states))


@dataclass(frozen=True, eq=False)
class Search:
    """All explanations that were fitted.

    Attributes
    ----------
    setting : Setting
        What their fits share.
    priors : mapping of str to float
        Logarithms of the probabilities of the terms that could be missing, before anything was measured.
    freed : frozenset of str
        Nuisances whose prior some term widens.
    fitted : mapping of frozenset of str to Explanation
        By their terms; the base model has none.
    chosen : Explanation
        The last of the way from the base model on which every step is told apart and predicts better.
    states : mapping of str to tuple of int or None
        The states that each term changes; all where it is None or not there.
    """

    setting: Setting
    priors: Mapping[str, float]
    freed: frozenset[str]
    fitted: Mapping[frozenset[str], Explanation]
    chosen: Explanation
    states: Mapping[str, tuple[int, ...] | None] = field(default_factory=dict)
    _seen: dict[int, Prediction] = field(default_factory=dict, repr=False)

    @property
    def base(self) -> Explanation:
        """The base model."""
        return self.fitted[frozenset()]

    def odds(self, own: Explanation) -> float:
        """Return the logarithm of the posterior odds against the base model."""
        prior = sum(self.priors[name] for name in own.terms)
        return own.log_evidence - self.base.log_evidence + prior

    def helps(self, new: Explanation, old: Explanation) -> bool:
        """Tell whether an explanation predicts better than another, see `better`, the states that its terms change."""
        among = _changed(self.states, new, old)
        return better(self.prediction(new).among(among), self.prediction(old).among(among))

    def prediction(self, own: Explanation) -> Prediction:
        """Return how an explanation predicts what is left out."""
        return predicted(own, self._seen)


def _changed(
    states: Mapping[str, tuple[int, ...] | None], new: Explanation, old: Explanation
) -> tuple[int, ...] | None:
    """Return the states that terms change which one of two explanations has alone; None of all."""
    found = set[int]()
    for name in set(new.terms) ^ set(old.terms):
        own = states.get(name)
        if own is None:
            return None
        found |= set(own)
    return tuple(sorted(found)) or None


def predicted(own: Explanation, seen: dict[int, Prediction]) -> Prediction:
    """Return how an explanation predicts what is left out; `seen` keeps what was computed."""
    if id(own) not in seen:
        held = np.array([np.isfinite(c.std) for c in own.coordinates])
        held[own.n_nuisance :] = False
        seen[id(own)] = Prediction(
            mode=left_out(own),
            state=left_out(own, "state"),
            pull=float(np.max(np.abs(own.pulls[held]), initial=0.0)),
        )
    return seen[id(own)]


def better(new: Prediction, old: Prediction) -> bool:
    """Tell whether an explanation predicts better by what matters, or lets go of what is known and was pulled far.

    Errors of frequencies and of damping ratios are compared where modes, and where states, are left out. One must fall,
    and that of frequencies of left-out modes may not rise, nor be so large that nothing is predicted; that of left-out
    states is for the most part what assembly does to each. What explains a difference between two states cannot be
    predicted from one of them: there it is the pull that tells. What pulls a known quantity far, and farther than
    before, contradicts what is known: it stands in for something else.
    """
    falls = False
    for after, before in ((new.mode, old.mode), (new.state, old.state)):
        for kind, matters in _MATTERS:
            b, a = before.beside(after, kind), after.rms(kind)
            falls |= bool(a < FALLS * b and b - a > matters)
    b, a = old.mode.beside(new.mode, "frequency"), new.mode.frequency
    if a > PREDICTS or (a > RISES * b and a - b > 0.1 * FREQUENCY_MATTERS):
        return False
    if new.pull > max(PULLED, old.pull):
        return False
    return falls or (old.pull > PULLED and new.pull < RELEASED * old.pull)


def begin(
    model: Model,
    *,
    shares: Sequence[float],
    starts: Sequence[Vector],
    priors: tuple[SizePrior, SizePrior] = (STIFFNESS, DAMPING),
) -> tuple[Setting, Explanation]:
    """Fit the base model from the best of several starts, and return what all fits share and the fit.

    Where that leaves more than right models do, the fit begins at `robust_start` as well. The noise of shapes is that
    beside the model where it fits: beside one that is far off, it would be misfit.
    """
    nuisances = model.nuisances

    def first(start: Vector) -> Explanation:
        local = model.about(nuisances, [start])
        own = setting(model, local, start, shares=shares, priors=priors)
        return converged(model, [], own, start, local=local, rounds=1)

    def beside(x: Vector) -> Setting:
        return setting(model, model.about(nuisances, [x]), x, shares=shares, priors=priors)

    best = min(map(first, starts), key=lambda one: np.mean([np.mean(e.frequency**2) for e in one.errors]))
    common = beside(best.x)
    best = explain(model, [], common, best.x)
    if too_large(best, priors):
        x, strange = robust_start(model, common, starts[0])
        other = explain(model, [], replace(common, apart=strange), x)
        best = max(best, other, key=lambda one: one.log_evidence)
    common = beside(best.x)
    return common, explain(model, [], replace(common, apart=best.apart), best.x)


def search(
    model: Model,
    common: Setting,
    base: Explanation,
    *,
    starts: Sequence[Vector] = (),
    asked: Sequence[Sequence[str]] = (),
    in_full: int = 8,
    likeliest: int = 3,
    beside: int = 3,
    deepest: int = 3,
    behind: float = 12.0,
    extend_by: Callable[..., list[Explanation]] | None = None,
    sharpen: Callable[..., tuple[Any, Setting, bool]] | None = None,
    say: Callable[[str], None] = _LOG.info,
) -> Search:
    """Fit every term alone, then further ones beside the best, and look back for what is no longer needed.

    Parameters
    ----------
    model, common, base
        The model, what fits share, and the fit of the base model.
    starts : sequence of (n_nuisance,)
        From where fits of the base model started: where it is far off, what is missing drew it away from there.
    asked : sequence of sequence of str
        Terms that are fitted together in any case.
    in_full : int
        Explanations of each extension that are kept.
    likeliest : int
        Those of them that are fitted to the end in any case; the others only where they come near raising the odds.
    beside : int
        Explanations beside which a further term is looked for.
    deepest : int
        Most terms.
    behind : float
        Logarithm of the odds by which an explanation beside which a further term is looked for may be behind the best.
    extend_by : callable
        Fits each further term beside an explanation, and returns the likeliest fits; `extended` by default.
    sharpen : callable
        Returns the model, what fits share and whether they are to be made anew, from what is best after the first
        extension; by default the noise of the shapes is made that beside it.
    say : callable
        Takes progress.
    """
    terms, seen = model.terms, dict[int, Prediction]()
    fitted: dict[frozenset[str], Explanation] = {frozenset(): base}
    alike = float(np.log(MISSING / len(terms)))
    priors = {name: alike if t.log_prior is None else t.log_prior for name, t in terms.items()}
    states = {name: t.states for name, t in terms.items()}

    def odds(own: Explanation) -> float:
        return own.log_evidence - fitted[frozenset()].log_evidence + sum(priors[n] for n in own.terms)

    def helps(new: Explanation, old: Explanation) -> bool:
        among = _changed(states, new, old)
        return better(predicted(new, seen).among(among), predicted(old, seen).among(among))

    def again(one: Explanation, steps: int = 8) -> Explanation:
        of = [terms[n] for n in one.terms]
        return explain(model, of, replace(common, apart=one.apart), one.x, steps=steps)

    def extend(at: Explanation) -> None:
        further_ones = (extend_by or extended)(model, common, at, starts)
        for i, one in enumerate(further_ones[:in_full]):
            near = further_ones[0].log_evidence - one.log_evidence < behind
            if near and frozenset(one.terms) not in fitted:
                may_matter = i < likeliest or odds(one) - odds(at) > -behind / 4.0
                fitted[frozenset(one.terms)] = again(one) if may_matter else one
        best = " + ".join(max(fitted.values(), key=odds).terms) or "no effect"
        say(f"{len(fitted)} explanations fitted, most probable so far: {best}")

    extend(base)
    model, common, refit = (sharpen or _sharpened)(model, common, max(fitted.values(), key=odds))
    if refit:  # the noise was misfit of the base model: all is compared anew, that where it stands
        fitted = {names: again(f, steps=8 if names else 0) for names, f in fitted.items()}
        base = fitted[frozenset()]
    else:
        other = explain(model, [], common, max(fitted.values(), key=odds).x[: base.x.size])
        if other.log_evidence > base.log_evidence:
            base = fitted[frozenset()] = other
    chosen = base
    for depth in range(1, deepest + 1):
        pool = sorted((f for f in fitted.values() if len(f.terms) == depth), key=odds, reverse=True)
        rising = (f for f in pool[:in_full] if odds(f) - odds(chosen) > NAMED)
        top = next((f for f in rising if helps(f, chosen)), None)
        if top is None and depth > 1:
            break
        chosen = top if top is not None else chosen
        if depth == deepest or not pool:
            break
        fewer = max(odds(f) for f in fitted.values() if len(f.terms) < depth)
        for at in pool[:beside]:  # one that raises the odds, and is near the best
            if odds(at) > fewer and odds(pool[0]) - odds(at) < behind:
                extend(at)
    chosen = _needed(model, common, fitted, chosen, odds)
    for names in map(frozenset, asked):
        if names and names not in fitted:
            fitted[names] = _from_parts(model, common, fitted, [terms[n] for n in names])
    freed = frozenset(name for term in terms.values() for name in term.frees)
    return Search(common, priors, freed, fitted, chosen, states, seen)


def _sharpened(
    model: Model, common: Setting, best: Explanation, *, less: float = 0.7
) -> tuple[Model, Setting, bool]:
    """Return model and setting, the noise of shapes being that beside an explanation where less, and if it matters."""
    beside = setting(model, model.about(best.coordinates, [best.x]), best.x, shares=(1.0, 0.0, 0.0))
    noise = tuple(np.minimum(*pair) for pair in zip(common.noise, beside.noise, strict=True))
    ratio = np.concatenate(noise) / np.concatenate(common.noise)
    if np.any(ratio < less):
        return model, replace(common, noise=noise), True
    return model, common, False


def extended(
    model: Model,
    common: Setting,
    at: Explanation,
    starts: Sequence[Vector] = (),
    *,
    least: int = 6,
    last: int = 12,
    gain: float = 1.0,
    steps: int = 10,
    small: float = 0.3,
) -> list[Explanation]:
    """Fit each further term beside an explanation on one basis about it, the likeliest first.

    Terms are ordered by what one step from each of their starts is expected to reach. The `least` likeliest, and of the
    `last` likeliest those that are expected to lower the cost by `gain`, take up to `steps`, as long as each lowers it
    by more than `small`.
    """
    common = replace(common, apart=at.apart)
    present = [model.terms[n] for n in at.terms]
    further = [t for n, t in model.terms.items() if n not in at.terms]
    coordinates = coordinates_of(model, [*present, *further])
    have = {c.name: value for c, value in zip(at.coordinates, at.x, strict=True)}
    origins = [have]
    pulled = [
        c.name
        for c, x in zip(at.coordinates[: at.n_nuisance], at.x, strict=False)
        if np.isfinite(c.std) and abs(x) > PULLED * c.std
    ]
    if pulled:
        origins.append({**have, **dict.fromkeys(pulled, 0.0)})  # what is missing may have pulled them
    if at.evidence.sizes.stiffness > common.priors[0].quantile(1.0 - INADEQUATE):
        names = [c.name for c in model.nuisances]
        origins += [{**have, **dict(zip(names, start, strict=True))} for start in starts]
    local = model.about(
        coordinates, [np.array([own.get(c.name, 0.0) for c in coordinates]) for own in origins]
    )
    ahead = screened(model, common, present, further, origins, local, at.evidence.sizes)
    now = outlook(model, present, common, at.x, local.of(at.coordinates), at.evidence.sizes)[0]
    found = []
    for i, name in enumerate(sorted(ahead, key=lambda n: -ahead[n][0])[:last]):
        if i >= least and ahead[name][0] < now + gain:
            break
        terms = [*present, model.terms[name]]
        try:
            found.append(
                converged(
                    model,
                    terms,
                    common,
                    ahead[name][1],
                    local=ahead[name][2],
                    rounds=1,
                    steps=steps,
                    small=small,
                    sizes=at.evidence.sizes,
                )
            )
        except (np.linalg.LinAlgError, ValueError):
            continue
    return sorted(found, key=lambda f: -f.log_evidence)


def _needed(
    model: Model,
    common: Setting,
    fitted: dict[frozenset[str], Explanation],
    chosen: Explanation,
    odds: Callable[[Explanation], float],
) -> Explanation:
    """Drop the terms of an explanation that are no longer needed; what was not fitted without one is fitted now."""
    while len(chosen.terms) > 1:
        parts = [frozenset(chosen.terms) - {name} for name in chosen.terms]
        have = {c.name: value for c, value in zip(chosen.coordinates, chosen.x, strict=True)}
        for names in parts:
            if names not in fitted:
                terms = [model.terms[n] for n in chosen.terms if n in names]
                x = np.array([have[c.name] for c in coordinates_of(model, terms)])
                fitted[names] = explain(model, terms, replace(common, apart=chosen.apart), x)
        part = max((fitted[names] for names in parts), key=odds)
        if odds(chosen) - odds(part) > NAMED:
            break
        chosen = part
    return chosen


def _from_parts(
    model: Model, common: Setting, fitted: Mapping[frozenset[str], Explanation], together: Sequence[Term]
) -> Explanation:
    """Fit terms together from where the best explanation of a part of them has what it has."""
    names = {t.name for t in together}
    at = max((f for k, f in fitted.items() if k < names), key=lambda f: f.log_evidence)
    coordinates = coordinates_of(model, together)
    have = {c.name: value for c, value in zip(at.coordinates, at.x, strict=True)}
    x = np.array([have.get(c.name, c.starts[0]) for c in coordinates])
    return explain(model, together, replace(common, apart=at.apart), x)
