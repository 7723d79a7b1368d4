"""The search for what is missing: every term alone, then forward with a look back, by evidence and prediction."""

from __future__ import annotations

import contextlib
import logging
import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from updating.inference.descent import begun
from updating.inference.discrepancy import DAMPING, STIFFNESS, SizePrior
from updating.inference.explain import Explanation, Setting, converged, coordinates_of, explain, setting, too_large
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
    SEPARATE,
)
from updating.inference.protocol import Model, State, Term
from updating.inference.robust_start import robust_start
from updating.inference.screen import screened
from updating.inference.unlisted import unlisted_gain

Vector = NDArray[np.float64]
_MATTERS: tuple[tuple[Kind, float], ...] = (("frequency", FREQUENCY_MATTERS), ("damping", DAMPING_MATTERS))
_LOG = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False, kw_only=True)
class Prediction:
    """How well an explanation predicts what is left out, and how far it pulls nuisances from their priors.

    Attributes
    ----------
    mode, state : LeftOut
        Errors where modes, and where states, are left out.
    pull : float
        Distance of the farthest nuisance from its prior, in standard deviations of the prior.
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
        What all fits share.
    measured : sequence of State
        The measured states.
    priors : mapping of str to float
        Logarithms of the prior probabilities of the terms.
    freed : frozenset of str
        Nuisances whose prior some term widens.
    fitted : mapping of frozenset of str to Explanation
        By their terms; the base model has none.
    chosen : Explanation
        The last of the steps from the base model, each of which is clearly more probable and predicts better.
    states : mapping of str to tuple of int or None
        The states that each term changes; all where it is None or absent.
    refused : bool
        Whether terms that raise odds and predict better were not chosen, as something unlisted is likelier.
    """

    setting: Setting
    measured: Sequence[State]
    priors: Mapping[str, float]
    freed: frozenset[str]
    fitted: Mapping[frozenset[str], Explanation]
    chosen: Explanation
    states: Mapping[str, tuple[int, ...] | None] = field(default_factory=dict)
    refused: bool = False
    _seen: dict[Explanation, Prediction] = field(default_factory=dict, repr=False)
    _gains: dict[tuple[Explanation, tuple[int, ...] | None], float] = field(default_factory=dict, repr=False)

    @property
    def base(self) -> Explanation:
        """The base model."""
        return self.fitted[frozenset()]

    def odds(self, explanation: Explanation) -> float:
        """Return the logarithm of the posterior odds against the base model."""
        prior = sum(self.priors[name] for name in explanation.terms)
        return explanation.log_evidence - self.base.log_evidence + prior

    def odds_unlisted(self, explanation: Explanation, changed: Collection[str] = ()) -> float:
        """Return the log odds of an explanation with something beside it that no term describes (see `unlisted_gain`).

        It is as probable beforehand as all terms together, and acts in the states that the terms `changed` change.
        """
        key = explanation, self._changed(changed)
        if key not in self._gains:
            self._gains[key] = unlisted_gain(explanation, self.setting, self.measured, key[1])
        return self.odds(explanation) + self._gains[key] + math.log(MISSING)

    def helps(self, new: Explanation, old: Explanation) -> bool:
        """Tell whether an explanation predicts the states that its terms change better than another (see `better`)."""
        among = self._changed(set(new.terms) ^ set(old.terms))
        return better(self.prediction(new).among(among), self.prediction(old).among(among))

    def prediction(self, explanation: Explanation) -> Prediction:
        """Return how well an explanation predicts what is left out."""
        if explanation not in self._seen:
            held = np.array([np.isfinite(c.std) for c in explanation.coordinates])
            held[explanation.n_nuisance :] = False
            self._seen[explanation] = Prediction(
                mode=left_out(explanation),
                state=left_out(explanation, "state"),
                pull=float(np.max(np.abs(explanation.pulls[held]), initial=0.0)),
            )
        return self._seen[explanation]

    def _changed(self, terms: Collection[str]) -> tuple[int, ...] | None:
        """Return the states that some terms change; None for all states."""
        changed = set[int]()
        for name in terms:
            of_term = self.states.get(name)
            if of_term is None:
                return None
            changed |= set(of_term)
        return tuple(sorted(changed)) or None


def better(new: Prediction, old: Prediction) -> bool:
    """Tell whether an explanation predicts better by what matters, or releases a nuisance that was pulled far.

    Errors of frequencies and of damping ratios are compared where modes, and where states, are left out. One must fall.
    The error of the frequencies of left-out modes may not rise, nor be so large that nothing is predicted; that of
    left-out states is mostly the scatter of assembly. A difference between two states cannot be predicted from one of
    them: there the pull decides. A pull that grows decides nothing: evidence counts it, and with the right term the
    discrepancy is small, so that a true deviation shows more.
    """
    falls = False
    for after, before in ((new.mode, old.mode), (new.state, old.state)):
        for kind, matters in _MATTERS:
            b, a = before.beside(after, kind), after.rms(kind)
            falls |= bool(a < FALLS * b and b - a > matters)
    b, a = old.mode.beside(new.mode, "frequency"), new.mode.frequency
    if a > PREDICTS or (a > RISES * b and a - b > 0.1 * FREQUENCY_MATTERS):
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

    Where the discrepancy is larger than that of a right model, a fit begins at `robust_start` as well. The noise of
    shapes is estimated where the model fits: with a model far off it would be misfit.
    """
    nuisances = model.nuisances

    def first(start: Vector) -> Explanation:
        local = model.about(nuisances, [start])
        first_setting = setting(model, local, start, shares=shares, priors=priors)
        return converged(model, [], first_setting, start, local=local, rounds=1)

    def beside(x: Vector) -> Setting:
        return setting(model, model.about(nuisances, [x]), x, shares=shares, priors=priors)

    best = min(map(first, starts), key=lambda f: np.mean([np.mean(e.frequency**2) for e in f.errors]))
    common = beside(best.x)
    best = explain(model, [], common, best.x)
    if too_large(best, priors):
        x, strange = robust_start(model, common, starts[0])
        robust = explain(model, [], replace(common, apart=strange), x)
        best = max(best, robust, key=lambda f: f.log_evidence)
    common = beside(best.x)
    best = explain(model, [], replace(common, apart=best.apart), best.x)
    return _scattered(model, common, best)


def _scattered(
    model: Model, common: Setting, best: Explanation, *, factor: float = 3.0, most: int = 3
) -> tuple[Setting, Explanation]:
    """Return setting and base model with the likeliest scatter of shapes, where sensors are too few to show any.

    With no more sensors than equations, modes reach all of a shape and nothing says how rough it is. What the campaign
    states, or what is usual, is then known to a `factor` (standard deviation of its logarithm), and the evidence
    decides: without that, shapes that scatter more would pass for a model that is wrong in frequencies as well.
    """
    reached = [len(s.shape) <= e.value.shape[1] for s, e in zip(model.states, best.errors, strict=True)]
    spread = sum(s.shape.size for s in model.states) * math.log(factor)  # of the density of shapes that scatter more
    for k in range(1, most + 1) if all(reached) else ():
        wider = replace(common, noise=tuple(factor * noise for noise in common.noise))
        trial = explain(model, [], replace(wider, apart=best.apart), best.x)
        if trial.log_evidence - spread - best.log_evidence < 0.5 * (k**2 - (k - 1) ** 2):  # which the prior takes
            break
        common, best = wider, trial
    return common, best


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
        Starts of the base model: where its fit is far off, what is missing drew it away from there.
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
        A further term is looked for beside an explanation whose log odds are at most this far below the best.
    extend_by : callable
        Fits each further term beside an explanation, and returns the likeliest fits; `extended` by default.
    sharpen : callable
        Returns the model, what fits share and whether fits are to be repeated, from the best explanation after the
        first extension; by default the noise of the shapes is estimated anew beside that.
    say : callable
        Receives lines on progress.
    """
    terms = model.terms
    alike = float(np.log(MISSING / len(terms)))
    fitted: dict[frozenset[str], Explanation] = {frozenset(): base}
    among = Search(
        setting=common,
        measured=model.states,
        priors={name: alike if t.log_prior is None else t.log_prior for name, t in terms.items()},
        freed=frozenset(name for term in terms.values() for name in term.frees),
        fitted=fitted,
        chosen=base,
        states={name: t.states for name, t in terms.items()},
    )
    odds = among.odds

    def extend(at: Explanation) -> None:
        fits = (extend_by or extended)(model, common, at, starts)
        for i, fit in enumerate(fits[:in_full]):
            if fits[0].log_evidence - fit.log_evidence < behind and frozenset(fit.terms) not in fitted:
                may_matter = i < likeliest or odds(fit) - odds(at) > -behind / 4.0
                fitted[frozenset(fit.terms)] = _refitted(model, common, fit) if may_matter else fit
        best = " + ".join(max(fitted.values(), key=odds).terms) or "no effect"
        say(f"{len(fitted)} explanations fitted, most probable so far: {best}")

    extend(base)
    model, common, refit = (sharpen or _sharpened)(model, common, max(fitted.values(), key=odds))
    if refit:  # the noise was misfit of the base model: all are fitted again, the base model without a step
        fitted.update({names: _refitted(model, common, f, 8 if names else 0) for names, f in fitted.items()})
    else:
        base_again = explain(model, [], common, max(fitted.values(), key=odds).x[: base.x.size])
        if base_again.log_evidence > base.log_evidence:
            fitted[frozenset()] = base_again
    chosen, refused = among.base, False
    for depth in range(1, deepest + 1):
        pool = sorted((f for f in fitted.values() if len(f.terms) == depth), key=odds, reverse=True)
        rising = (f for f in pool[:in_full] if odds(f) - odds(chosen) > NAMED)
        top = next((f for f in rising if among.helps(f, chosen)), None)
        if top is not None and not _listed(among, top, chosen):
            top, refused = None, True
        if top is None and depth > 1:
            break
        chosen = top if top is not None else chosen
        if depth == deepest or not pool:
            break
        fewer = max(odds(f) for f in fitted.values() if len(f.terms) < depth)
        for at in pool[:beside]:  # one that raises the odds, and is near the best
            if odds(at) > fewer and odds(pool[0]) - odds(at) < behind:
                extend(at)
    chosen = _needed(model, common, among, fitted, chosen)
    helps = among.helps(chosen, among.base)  # what it was chosen with may not be needed
    if chosen.terms and not (helps and _listed(among, chosen, among.base)):
        chosen, refused = among.base, refused or helps
    for names in map(frozenset, asked):
        if names and names not in fitted:
            fitted[names] = _from_parts(model, common, fitted, [terms[n] for n in names])
    return replace(among, setting=common, chosen=chosen, refused=refused)


def _listed(among: Search, new: Explanation, old: Explanation) -> bool:
    """Tell whether something unlisted does not make the further terms of an explanation needless.

    It does where it is clearly more probable in their place, unless they are clearly needed beside it as well: then
    they have the right form in the main.
    """
    further = [name for name in new.terms if name not in old.terms]
    instead = among.odds_unlisted(old, further)
    return among.odds(new) > instead - SEPARATE or among.odds_unlisted(new, further) > instead + SEPARATE


def _refitted(model: Model, common: Setting, fit: Explanation, steps: int = 8) -> Explanation:
    """Fit an explanation to the end on models about where it stands."""
    try:
        common = replace(common, apart=fit.apart)
        return explain(model, [model.terms[name] for name in fit.terms], common, fit.x, steps=steps)
    except np.linalg.LinAlgError:  # at the edge of what is possible, where the small basis still has modes
        return fit


def _sharpened(model: Model, common: Setting, best: Explanation, *, less: float = 0.7) -> tuple[Model, Setting, bool]:
    """Return model and setting with the noise of shapes beside an explanation, where less, and whether that matters."""
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
    behind: float = 12.0,
) -> list[Explanation]:
    """Fit each further term beside an explanation on a basis about where it starts, the likeliest first.

    Terms are ordered as `screened` has them. The `least` likeliest, and of the `last` likeliest those that lower the
    cost by `gain`, take up to `steps`, as long as each lowers it by more than `small`; those that would end `behind`
    the best take none. Modes that the explanation sets apart may be those of what is missing, so that all is tried with
    these as well.
    """
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
    local = [model.about(coordinates, [np.array([o.get(c.name, 0.0) for c in coordinates])]) for o in origins]
    fits = list[Explanation]()
    sizes, none = at.evidence.sizes, frozenset[tuple[int, int]]()
    settings = [replace(common, apart=apart) for apart in dict.fromkeys((at.apart, none))]
    reached = screened(model, settings, present, further, origins, local, sizes, later=steps, behind=behind)
    now = begun(model, present, settings[0], at.x, local[0].of(at.coordinates), sizes)
    for i, end in enumerate(list(reached.values())[:last]):
        if i >= least and now.cost - now.fall - end.cost < gain:
            break
        with contextlib.suppress(np.linalg.LinAlgError, ValueError):  # no modes there
            fit = converged(
                model, end.terms, end.setting, end.x, local=end.local, rounds=1, steps=steps, small=small, sizes=sizes
            )
            fits.append(fit)
    return sorted(fits, key=lambda f: -f.log_evidence)


def _needed(
    model: Model, common: Setting, among: Search, fitted: dict[frozenset[str], Explanation], chosen: Explanation
) -> Explanation:
    """Drop terms that are no longer needed, or less probable than something unlisted; fit what is missing for that."""
    while len(chosen.terms) > 1:
        parts = [frozenset(chosen.terms) - {name} for name in chosen.terms]
        have = {c.name: value for c, value in zip(chosen.coordinates, chosen.x, strict=True)}
        for names in parts:
            if names not in fitted:
                terms = [model.terms[n] for n in chosen.terms if n in names]
                x = np.array([have[c.name] for c in coordinates_of(model, terms)])
                fitted[names] = explain(model, terms, replace(common, apart=chosen.apart), x)
        part = max((fitted[names] for names in parts), key=among.odds)
        if among.odds(chosen) - among.odds(part) > NAMED and _listed(among, chosen, part):
            break
        chosen = part
    return chosen


def _from_parts(
    model: Model, common: Setting, fitted: Mapping[frozenset[str], Explanation], together: Sequence[Term]
) -> Explanation:
    """Fit terms together, from the estimates of the best explanation that has a part of them."""
    names = {t.name for t in together}
    at = max((f for k, f in fitted.items() if k < names), key=lambda f: f.log_evidence)
    coordinates = coordinates_of(model, together)
    have = {c.name: value for c, value in zip(at.coordinates, at.x, strict=True)}
    x = np.array([have.get(c.name, c.starts[0]) for c in coordinates])
    return explain(model, together, replace(common, apart=at.apart), x)
