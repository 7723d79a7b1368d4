"""The search on many specimens: how it begins, what fits share, and which terms are worth a fit."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import cast

import numpy as np

from lamella_shared import Reals
from updating.errors import FitError
from updating.inference.descent import begun
from updating.inference.discrepancy import DAMPING, SPREAD, STIFFNESS, SizePrior
from updating.inference.explain import Explanation, Setting, converged, coordinates_of, errors_at, explain, setting
from updating.inference.levels import INADEQUATE, PULLED
from updating.inference.protocol import Term
from updating.inference.search import Search, search
from updating.inference.tree import Tree, TreeProblem
from updating.pooled.screening import screen
from updating.pooled.specimens_model import SCATTER, SpecimensModel

_LOG = logging.getLogger(__name__)

TREE_SHARES = (0.6, 0.2, 0.2)
"""Shares of the discrepancy common to all specimens, common to all states of a specimen, and of each state alone: what
a model misses of a structure is mostly the same in all of a kind. They are estimated from here."""
LEAST_TREE_SHARE = 0.02
"""Of each of these: no two stacks are built alike, nor two states of one."""
LOOSE = 3.0
"""Factor on the rise of the evidence at which the fit of one stack ends: still less than what separates terms."""
BEHIND = 8.0
"""Log odds by which a term may fall short of the least promise and is still fitted."""


@dataclass(frozen=True, eq=False)
class BaseFit:
    """The base model of all specimens, fitted.

    Attributes
    ----------
    model : SpecimensModel
        With the scatter from specimen to specimen that these have.
    common : Setting
        What fits share.
    base : Explanation
        The fit.
    start : (n_nuisance,) float
        From where it started.
    """

    model: SpecimensModel
    common: Setting
    base: Explanation
    start: Reals


def begin(model: SpecimensModel, priors: tuple[SizePrior, SizePrior] = (STIFFNESS, DAMPING)) -> BaseFit:
    """Fit the base model from where each specimen's frequencies are met best by its contact stiffness alone."""
    start, common = _start(model, priors)
    base = explain(model, [], common, start, rounds=1)
    model, common, _ = settled(model, common, base)
    return BaseFit(model, common, explain(model, [], common, base.x), start)


@dataclass(frozen=True, eq=False)
class PooledSearch:
    """The search on many specimens, done.

    Attributes
    ----------
    model : SpecimensModel
        With the scatter that the best explanation has.
    search : Search
        All that was fitted.
    reach : mapping of str to float
        Standard deviations by which data would change with each effect of the rig at the end of its range.
    """

    model: SpecimensModel
    search: Search
    reach: Mapping[str, float]


def searched(base_fit: BaseFit) -> PooledSearch:
    """Find what is missing, and which specimens lack it."""
    models, reach = [base_fit.model], dict[str, float]()

    def extend(
        model: SpecimensModel, common: Setting, at: Explanation, starts: Sequence[Reals] = ()
    ) -> list[Explanation]:
        ahead, seen = outlooks(model, common, at, starts)
        if not at.terms:
            reach.update({name: r for name, r in seen.items() if name in model.first.effects})
        return extended(model, common, at, ahead)

    def sharpen(model: SpecimensModel, common: Setting, best: Explanation) -> tuple[SpecimensModel, Setting, bool]:
        sharper = settled(model, common, best)
        models.append(sharper[0])
        return sharper

    results = search(
        base_fit.model,
        base_fit.common,
        base_fit.base,
        starts=[base_fit.start],
        in_full=6,
        likeliest=2,
        beside=2,
        extend_by=extend,
        sharpen=sharpen,
    )
    return PooledSearch(models[-1], results, reach)


def fit_terms(base_fit: BaseFit, names: Sequence[str]) -> PooledSearch:
    """Fit terms, one after the other beside those before.

    Raises
    ------
    FitError
        The model has no modes with all of them.
    """
    model, common, best = base_fit.model, base_fit.common, base_fit.base
    for name in names:
        terms = [model.terms[n] for n in (*best.terms, name)]
        have = {c.name: float(x) for c, x in zip(best.coordinates, best.x, strict=True)}
        x = np.array([have.get(c.name, c.starts[-1]) for c in coordinates_of(model, terms)])
        x = outlooks(model, common, best, [base_fit.start], only=name)[0].get(name, (0.0, x))[1]
        try:
            best = explain(model, terms, common, x)
        except (np.linalg.LinAlgError, ValueError) as error:
            raise FitError(f"the stacks have no modes with {', '.join(term.name for term in terms)}") from error
    model, common, _ = settled(model, common, best)
    if best.terms:
        best = explain(model, [model.terms[n] for n in best.terms], common, best.x)
    base = explain(model, [], common, base_fit.base.x)
    priors = {name: term.log_prior or 0.0 for name, term in model.terms.items()}
    fitted = {frozenset[str](): base} | ({frozenset(best.terms): best} if best.terms else {})
    return PooledSearch(
        model, Search(common, model.states, priors, frozenset(), fitted, best if best.terms else base), {}
    )


def _start(model: SpecimensModel, priors: tuple[SizePrior, SizePrior]) -> tuple[Reals, Setting]:
    """Return the coordinates of the base model from which its fit starts, and what fits share there."""
    ladder = np.linspace(-1.2, 1.2, 9)  # of ln G_f, on which each specimen starts
    names = [c.name for c in model.nuisances]
    x = np.zeros(len(names))
    tree = Tree(paths=tuple(state.path for state in model.states), shares=TREE_SHARES)
    if model.first.touching:
        G_f, d_f = np.mean([group.start for group in model.groups], axis=0)
        x[names.index("G_f")], x[names.index("d_f")] = G_f, d_f
        ends = [x + shift * (np.arange(x.size) == names.index("G_f")) for shift in (0.0, -1.0, 1.0)]
        local = model.about(model.nuisances, ends)
        common = replace(setting(model, local, x, shares=TREE_SHARES, priors=priors), tree=tree, loose=LOOSE)
        cost = np.zeros((len(ladder), len(model.specimens)))
        for i, shift in enumerate(ladder):
            errors = errors_at(model, local, common, x + shift * (np.arange(x.size) == names.index("G_f")))
            for s, states in enumerate(model.states_of):
                cost[i, s] = float(np.mean(np.concatenate([np.minimum(errors[c].frequency ** 2, 0.1) for c in states])))
        best = ladder[np.argmin(cost, axis=0)]
        x[names.index("G_f")] += best.mean()
        for s, specimen in enumerate(model.specimens):
            x[names.index(f"G_f[{specimen.name}]")] = best[s] - best.mean()
    local = model.about(model.nuisances, [x])
    return x, replace(setting(model, local, x, shares=TREE_SHARES, priors=priors), tree=tree, loose=LOOSE)


def settled(model: SpecimensModel, common: Setting, best: Explanation) -> tuple[SpecimensModel, Setting, bool]:
    """Return model and setting with what scatters as an explanation has it, and whether that matters.

    These are the scatter of contact from specimen to specimen, the shares of the discrepancy, and the noise of shapes.
    """
    least_moved = 0.1  # of the logarithm of a scale
    assert common.tree is not None
    scatter = scatter_of(model, best)
    shares = shares_of(best)
    beside = setting(model, model.about(best.coordinates, [best.x]), best.x, shares=(1.0, 0.0, 0.0))
    noise = tuple(np.minimum(*pair) for pair in zip(common.noise, beside.noise, strict=True))
    moved = [np.log(scatter[n] / model.scatter[n]) for n in scatter]
    moved += np.log(np.array(shares) / common.tree.shares).tolist()
    moved += [float(np.log(np.concatenate(noise) / np.concatenate(common.noise)).min())]
    tree = replace(common.tree, shares=shares)
    return (
        model.with_scatter(scatter),
        replace(common, noise=noise, tree=tree),
        bool(np.max(np.abs(moved)) > least_moved),
    )


def scatter_of(model: SpecimensModel, fit: Explanation) -> dict[str, float]:
    """Return the scatter of ln G_f and ln d_f from specimen to specimen, by what they are in a fit.

    A step of the algorithm of expectation and maximisation (Dempster, Laird and Rubin 1977) towards the likeliest, with
    an inverse gamma prior that weighs as two specimens of the usual scatter do.
    """
    scatter = {}
    for name, usual in SCATTER.items():
        at = [i for i, c in enumerate(fit.coordinates) if c.name.startswith(f"{name}[")]
        at = [i for i in at if model.scope(fit.coordinates[i].name).local == name]
        if not at:
            scatter[name] = usual
            continue
        x, std = fit.x[at], np.minimum(fit.std[at], model.scatter[name])
        within = std**2 - np.mean(std) ** 2 / len(at)  # what all have in common is no scatter
        square = float(np.sum((x - x.mean()) ** 2 + np.maximum(within, 0.0)))
        scatter[name] = float(np.sqrt((square + 2.0 * usual**2) / (len(at) + 2.0)))
    return scatter


def shares_of(fit: Explanation) -> tuple[float, ...]:
    """Return the likeliest shares of the discrepancy, those of a fit being where they are looked for."""
    problem, size = cast(TreeProblem, fit.problem), fit.evidence.sizes.stiffness
    known = np.diag(np.array([c.std**-2.0 for c in fit.coordinates]) + 1e-12) + problem.curvature
    usual = np.log(np.array(TREE_SHARES))

    def log(z: Reals) -> float:
        """Return the logarithm of the evidence at logarithms of the variances of the levels."""
        variance = np.exp(z)
        tree = Tree(paths=problem.tree.paths, shares=tuple((variance / variance.sum()).tolist()))
        weighed = replace(problem, tree=tree).of_stiffness(float(np.sqrt(variance.sum())))
        step = weighed.misfit + 2.0 * weighed.log + float(np.linalg.slogdet(weighed.hessian + known)[1])
        away = (z - z.mean() - usual + usual.mean()) / SPREAD
        return -0.5 * (step + float(away @ away))

    z = np.log(size**2 * np.array(problem.tree.shares))
    for h in (1.0, 0.4):
        for i in range(z.size):
            direction = h * (np.arange(z.size) == i)
            low, here, high = log(z - direction), log(z), log(z + direction)
            bend = low + high - 2.0 * here
            step = 0.5 * (low - high) / bend if bend < 0.0 else np.sign(high - low)
            z = z + float(np.clip(step, -2.0, 2.0)) * direction
    share = np.maximum(np.exp(z - np.log(np.sum(np.exp(z)))), LEAST_TREE_SHARE)
    return tuple((share / share.sum()).tolist())


def outlooks(
    model: SpecimensModel,
    common: Setting,
    at: Explanation,
    starts: Sequence[Reals] = (),
    *,
    only: str | None = None,
    n_evaluated: int = 10,
) -> tuple[dict[str, tuple[float, Reals]], dict[str, float]]:
    """Return what further terms are expected to reach beside a fit, and where from, and what terms reach in the data.

    Linear steps from all origins rank the terms. For strong effects the gain of such a step is inaccurate, so the
    model is evaluated where the best steps lead.

    Parameters
    ----------
    model, common, at, starts
        As `updating.inference.search.extended` takes them.
    only : str, optional
        The one term whose step the model evaluates; by default the best ones.
    n_evaluated : int
        Terms whose steps the model evaluates, for each origin.

    Returns
    -------
    dict of str to (float, (n_coordinate,) float)
        Minus the cost that a step from there is expected to reach, prior probability included, and where it leads.
    dict of str to float
        Standard deviations by which data change at the farthest end of a term's range.
    """
    expected, reach = dict[str, tuple[float, Reals]](), dict[str, float]()
    present = [model.terms[n] for n in at.terms]
    now = _now(model, common, at)
    for origin in _origins(model, common, at, starts):
        screened = screen(model, common, at, origin)
        for name, candidate in screened.items():
            reach[name] = max(candidate.reach, reach.get(name, 0.0))
        order = sorted(screened.values(), key=lambda candidate: -candidate.level)
        for candidate in [candidate for candidate in order if only in (None, candidate.name)][:n_evaluated]:
            ahead = _after_step(model, common, at, [*present, model.terms[candidate.name]], candidate.at, now)
            if ahead is not None and (candidate.name not in expected or ahead[0] > expected[candidate.name][0]):
                expected[candidate.name] = ahead
    return expected, reach


def _now(model: SpecimensModel, common: Setting, at: Explanation) -> float:
    """Return what a fit itself is expected to reach, minus the cost."""
    terms = [model.terms[n] for n in at.terms]
    local = model.about(at.coordinates, [at.x])
    now = begun(model, terms, common, at.x, local, at.evidence.sizes)
    return now.fall - now.cost


def _after_step(
    model: SpecimensModel,
    common: Setting,
    at: Explanation,
    terms: Sequence[Term],
    led: Mapping[str, float],
    now: float,
    *,
    shares: Sequence[float] = (1.0, 0.5, 0.2),
) -> tuple[float, Reals] | None:
    """Return what a linear step is expected to lead to, and where; of a step that leads too far, a share of it.

    Parameters
    ----------
    model, common, at
        As `outlooks` takes them.
    terms : sequence of Term
        Of the fit, and the further one.
    led : mapping of str to float
        Where the linear step leads.
    now : float
        What the fit itself reaches: less than that is too far.
    shares : sequence of float
        Shares of the step that are tried, until one promises anything.
    """
    coordinates = coordinates_of(model, terms)
    have = {c.name: float(x) for c, x in zip(at.coordinates, at.x, strict=True)}
    here, there = (np.array([of.get(c.name, 0.0) for c in coordinates]) for of in (have, led))
    ends = [np.array([getattr(c, end) for c in coordinates]) for end in ("lower", "upper")]
    best: tuple[float, Reals] | None = None
    for share in shares:
        x = np.clip(here + share * (there - here), *ends)
        try:
            local = model.about(coordinates, [x])
            ahead = begun(model, terms, common, x, local, at.evidence.sizes)
        except (np.linalg.LinAlgError, ValueError):  # no modes there
            continue
        level = ahead.fall - ahead.cost + (terms[-1].log_prior or 0.0)
        if best is None or level > best[0]:
            best = level, ahead.to
        if level > now:
            break
    return best


def extended(
    model: SpecimensModel,
    common: Setting,
    at: Explanation,
    ahead: Mapping[str, tuple[float, Reals]],
    *,
    fits: int = 6,
    promising: float = 0.5,
) -> list[Explanation]:
    """Fit the further terms beside an explanation that promise most, the likeliest first.

    Parameters
    ----------
    model, common, at
        As `updating.inference.search.extended` takes them.
    ahead : mapping of str to (float, (n_coordinate,) float)
        What each term promises, and from where.
    fits : int
        Most of them.
    promising : float
        Share of what the best promises that others must: steps of strong effects miss it by as much.
    """
    levels = 3  # of one effect at once that are worth a fit
    fitted, seen = list[Explanation](), Counter[str]()
    if not ahead:
        return fitted
    present = [model.terms[n] for n in at.terms]
    now = _now(model, common, at)
    order = sorted(ahead, key=lambda name: -ahead[name][0])
    least = now + promising * max(ahead[order[0]][0] - now, 0.0) - BEHIND
    for name in order:
        level, x = ahead[name]
        if len(fitted) == fits or level < least:
            break
        effect = model.meant[name].effect
        seen[effect] += 1
        if seen[effect] > levels:
            continue
        terms = [*present, model.terms[name]]
        try:
            fitted.append(converged(model, terms, common, x, sizes=at.evidence.sizes, rounds=2, small=0.3, settled=1.0))
        except (np.linalg.LinAlgError, ValueError):
            continue
        _LOG.info("%s: %.1f promised, %.1f", name, level - now, fitted[-1].log_evidence - at.log_evidence)
    return sorted(fitted, key=lambda f: -f.log_evidence)


def _origins(
    model: SpecimensModel, common: Setting, at: Explanation, starts: Sequence[Reals]
) -> list[dict[str, float]]:
    """Return from where linear steps are taken: the fit, and where nothing is pulled by what is missing."""
    have = {c.name: float(x) for c, x in zip(at.coordinates, at.x, strict=True)}
    origins = [have]
    shared = [c for c in model.nuisances if "[" not in c.name and np.isfinite(c.std)]
    if any(abs(have[c.name]) > PULLED * c.std for c in shared):
        origins.append(
            {
                **have,
                **{
                    c.name: 0.0 for c in model.nuisances if np.isfinite(c.std) and not c.name.startswith(("G_f", "d_f"))
                },
            }
        )
    if at.evidence.sizes.stiffness > common.priors[0].quantile(1.0 - INADEQUATE):
        names = [c.name for c in model.nuisances]
        origins += [{**have, **dict(zip(names, start.tolist(), strict=True))} for start in starts]
    return origins
