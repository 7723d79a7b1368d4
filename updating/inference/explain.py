"""An explanation: the model with some terms, fitted to all states together."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, cast

import numpy as np
import scipy
import scipy.linalg as la
from numpy.typing import NDArray

from updating.inference.algebra import bounded_step, scaled_inverse
from updating.inference.discrepancy import (
    DAMPING,
    STIFFNESS,
    USUAL,
    Evidence,
    Problem,
    SizePrior,
    Sizes,
    Spectrum,
    Weighed,
    evidence,
    joined,
    shared_levels,
    spectrum,
)
from updating.inference.equation_error import Errors, apart_from, equation_errors, may_be_unseen, shape_noise
from updating.inference.levels import INADEQUATE, STRANGE
from updating.inference.protocol import Coordinate, LocalModel, Model, Term
from updating.inference.tree import Tree, TreeProblem, tree_problem
from updating.inference.tree_evidence import tree_evidence

Vector = NDArray[np.float64]

DAMP = 1e-6  # of steps at first: below what priors add to data
FORM = 0.05
"""Relative standard deviation of the strength of a term by its form: what a real joint, or a second model of it, does
is that of the term with a strength that is right to some per cent (definitional uncertainty; VIM 2.27)."""
_STUCK = 300.0  # of the damping, relative to the curvature, from which steps are too short to matter


@dataclass(frozen=True, eq=False, kw_only=True)
class Setting:
    """What all fits of a campaign share, so that they can be compared.

    Attributes
    ----------
    noise : tuple of (n,) float
        Standard deviation of a component of each measured shape, by state.
    common : (n_state, n_state) float
        Share of the discrepancy that two states have in common.
    priors : (SizePrior, SizePrior)
        Of its sizes: of equation errors, and of logarithms of damping ratios.
    apart : frozenset of (int, int)
        Measured modes, by state and number, with which a fit begins as none of the model's.
    unseen : frozenset of (int, int)
        Measured modes that may be modes of the model that the sensors do not see: it is as likely as not that their
        shapes are none of the model's.
    tree : Tree, optional
        The same shares as a tree, by which many states are solved.
    loose : float
        What the rise of the evidence and the fall of the cost that end a fit are multiplied by.
    """

    noise: tuple[Vector, ...]
    common: Vector
    priors: tuple[SizePrior, SizePrior] = (STIFFNESS, DAMPING)
    apart: frozenset[tuple[int, int]] = frozenset()
    unseen: frozenset[tuple[int, int]] = frozenset()
    tree: Tree | None = None
    loose: float = 1.0

    @property
    def log_prior_apart(self) -> float:
        """Logarithm of the prior probability that the modes that are set apart are none of the model's."""
        return sum(math.log(0.5 if mode in self.unseen else STRANGE) for mode in self.apart)

    def join(self, errors: Sequence[Errors], n_coordinate: int) -> Problem | TreeProblem:
        """Join the errors of all states."""
        if self.tree is None:
            return joined(errors, self.common)
        return tree_problem(errors, self.tree, n_coordinate)


@dataclass(frozen=True, eq=False, kw_only=True)
class Explanation:
    """The model with some terms, fitted to all states together.

    Attributes
    ----------
    terms : tuple of str
        Which; none is the base model.
    coordinates : tuple of Coordinate
        All coordinates, those of the base model first, with the priors that they have here.
    x, std : (n_coordinate,) float
        Estimates and standard deviations, discrepancy integrated out; of terms, what their form leaves open included.
    at_bound : (n_coordinate,) bool
        Which lie on a bound.
    evidence : Evidence
        Marginal likelihood, and the sizes of the discrepancy.
    errors : tuple of Errors
        By state, at the estimate.
    problem : Problem
        The same joined.
    apart : frozenset of (int, int)
        Measured modes, by state and number, that are taken for none of the model's.
    course : tuple of float
        Cost after each step of the fit; the sizes of the discrepancy change from round to round.
    """

    terms: tuple[str, ...]
    coordinates: tuple[Coordinate, ...]
    n_nuisance: int
    x: Vector
    std: Vector
    at_bound: NDArray[np.bool_]
    evidence: Evidence
    errors: tuple[Errors, ...]
    problem: Problem
    apart: frozenset[tuple[int, int]] = frozenset()
    course: tuple[float, ...] = ()

    @property
    def log_evidence(self) -> float:
        """Logarithm of the marginal likelihood."""
        return self.evidence.log

    @property
    def pulls(self) -> Vector:
        """Distance of each coordinate from its prior, in standard deviations of the prior, (n_coordinate,)."""
        return np.array([value / c.std for value, c in zip(self.x, self.coordinates, strict=True)])

    @property
    def bounds(self) -> tuple[Vector, Vector]:
        """Least and greatest values of the coordinates, (n_coordinate,) each."""
        return np.array([c.lower for c in self.coordinates]), np.array([c.upper for c in self.coordinates])

    def value(self, name: str) -> float:
        """Return the estimate of a coordinate."""
        return float(self.x[[c.name for c in self.coordinates].index(name)])


def coordinates_of(model: Model, terms: Sequence[Term]) -> tuple[Coordinate, ...]:
    """Return the coordinates of a model with some terms: nuisances, some with wider priors, then those of the terms."""
    freed: dict[str, float] = {}
    for term in terms:
        for name, std in term.frees.items():
            freed[name] = max(std, freed.get(name, 0.0))
    base = [_freed(c, freed[c.name]) if c.name in freed else c for c in model.nuisances]
    further = {c.name: c for term in terms for c in term.coordinates}
    return (*base, *further.values())


def _freed(coordinate: Coordinate, std: float) -> Coordinate:
    """Return a coordinate with a wider prior; its bounds widen as much."""
    wider = max(std / coordinate.std, 1.0)
    return replace(
        coordinate, std=coordinate.std * wider, lower=coordinate.lower * wider, upper=coordinate.upper * wider
    )


def setting(
    model: Model,
    local: LocalModel,
    x: Vector,
    *,
    shares: Sequence[float],
    priors: tuple[SizePrior, SizePrior] = (STIFFNESS, DAMPING),
) -> Setting:
    """Return what all fits of a campaign share: noise of the shapes, from a model near them, and shares of states."""
    modal = [local.modal(x, c) for c in range(len(model.states))]
    unseen = [np.flatnonzero(may_be_unseen(*pair)).tolist() for pair in zip(model.states, modal, strict=True)]
    return Setting(
        noise=tuple(shape_noise(*pair) for pair in zip(model.states, modal, strict=True)),
        common=shared_levels([state.path for state in model.states], shares),
        priors=priors,
        unseen=frozenset((c, r) for c, of_state in enumerate(unseen) for r in of_state),
    )


def errors_at(model: Model, local: LocalModel, setting: Setting, x: Vector) -> tuple[Errors, ...]:
    """Return the errors of all states at coordinates."""
    return tuple(
        equation_errors(state, local.modal(x, c), setting.noise[c], x.size, [r for d, r in setting.apart if d == c])
        for c, state in enumerate(model.states)
    )


@dataclass(frozen=True, eq=False)
class Cost:
    """The cost of a step: minus the logarithm of the posterior density at given sizes of the discrepancy."""

    precision: Vector
    sizes: Sizes

    def total(self, problem: Problem | TreeProblem, weighed: Weighed, x: Vector) -> float:
        """Return the cost at coordinates of a problem that is weighed with its sizes."""
        prior = float(np.sum(self.precision * x**2))
        return 0.5 * (weighed.misfit + prior) + weighed.log - problem.log_map


def explain(
    model: Model,
    terms: Sequence[Term],
    setting: Setting,
    start: Vector,
    *,
    local: LocalModel | None = None,
    sizes: Sizes = USUAL,
    rounds: int = 6,
    steps: int = 8,
    most_apart: float = 0.2,
) -> Explanation:
    """Fit the model with some terms to all states, and set apart measured modes that are none of the model's.

    A measured mode that the model lacks, of the rig or of what is missing, draws a fit away from all other modes. Its
    prior probability is `STRANGE`, and its equation errors may be anything. Where the discrepancy is larger than that
    of a right model, or some may be modes that the sensors do not see, such modes are set apart one by one, as long as
    the evidence rises.

    Parameters
    ----------
    model, terms, setting, start, local, sizes, rounds, steps
        As `converged` takes them.
    most_apart : float
        Largest share of the measured modes that may be set apart, beside those that sensors may not see.

    Raises
    ------
    numpy.linalg.LinAlgError
        The model has no modes at the start.
    """

    def fit(apart: frozenset[tuple[int, int]], x: Vector, sizes: Sizes) -> Explanation:
        return converged(
            model, terms, replace(setting, apart=apart), x, local=local, sizes=sizes, rounds=rounds, steps=steps
        )

    best = fit(setting.apart, start, sizes)
    most = int(most_apart * sum(state.frequency.size for state in model.states)) + len(setting.unseen)
    for _ in range(2 * most):
        if not (best.apart or setting.unseen or too_large(best, setting.priors)):
            break
        modes_apart = _likelier_apart(best, setting, most)
        if modes_apart is None:
            break
        trial = fit(modes_apart, best.x, best.evidence.sizes)
        if trial.log_evidence < best.log_evidence + math.log(2.0):
            break
        best = trial
    return best


def too_large(
    explanation: Explanation, priors: tuple[SizePrior, SizePrior]
) -> tuple[Literal["frequency", "damping"], ...]:
    """Return the kinds of data whose discrepancy is larger than that of a right model."""
    sizes, kinds = explanation.evidence.moments(priors)[0], list[Literal["frequency", "damping"]]()
    if p_value(sizes.stiffness, priors[0]) < INADEQUATE:
        kinds.append("frequency")
    if explanation.problem.damping.size and p_value(sizes.damping, priors[1]) < INADEQUATE:
        kinds.append("damping")
    return tuple(kinds)


def p_value(size: float, prior: SizePrior) -> float:
    """Return the probability, by its prior, of a discrepancy as large; 1 where a laboratory states its size."""
    if prior.n == 1:
        return 1.0
    return float(scipy.special.ndtr(-np.log(size / prior.median) / prior.spread))


def _likelier_apart(
    fit: Explanation, setting: Setting, most: int, *, suspicious: float = 3.0
) -> frozenset[tuple[int, int]] | None:
    """Return the modes apart with one more or one fewer, if that raises the evidence of the fit as it is; else None.

    A mode is added, up to `most`, if the square of its error, predicted from the others, is the largest and more than
    `suspicious` times what is expected.
    """
    if isinstance(fit.problem, TreeProblem):  # with many states, no mode is set apart yet
        return None
    m = fit.errors[0].value.shape[1]
    numbered = [(c, r) for c, e in enumerate(fit.errors) for r in range(len(e.value))]
    covariance = fit.evidence.sizes.stiffness**2 * fit.problem.discrepancy + fit.problem.noise
    inverse = np.linalg.inv(covariance)
    pulled = inverse @ fit.problem.value
    square = [
        float(pulled[b] @ la.solve(inverse[b, b], pulled[b], assume_a="pos")) / m
        for b in (slice(m * i, m * (i + 1)) for i in range(len(numbered)))
    ]
    worst = max((s, mode) for s, mode in zip(square, numbered, strict=True) if mode not in fit.apart)
    trials = [fit.apart - {mode} for mode in fit.apart]
    if worst[0] > suspicious and len(fit.apart) < most:
        trials.append(fit.apart | {worst[1]})
    best, likelier = fit.log_evidence, None
    for apart in trials:
        errors = tuple(
            apart_from(e, old=[r for d, r in fit.apart if d == c], new=[r for d, r in apart if d == c])
            for c, e in enumerate(fit.errors)
        )
        problem = joined(errors, setting.common)
        of_trial = replace(setting, apart=apart)
        log = evidence_of(problem, fit.x, fit.coordinates, of_trial, fit.evidence.sizes)[0].log
        if log > best:
            best, likelier = log, apart
    return likelier


def converged(
    model: Model,
    terms: Sequence[Term],
    setting: Setting,
    start: Vector,
    *,
    local: LocalModel | None = None,
    sizes: Sizes = USUAL,
    rounds: int = 6,
    steps: int = 8,
    settled: float = 0.1,
    small: float = 0.03,
) -> Explanation:
    """Fit the model with some terms to all states by Levenberg and Marquardt's method.

    Steps are taken at given sizes of the discrepancy on a local model. Where they end, both are made anew, the model
    only if a coordinate has left its range, until the evidence stays.

    Parameters
    ----------
    model : Model
        The model.
    terms : sequence of Term
        What is added to the base model.
    setting : Setting
        What all fits share.
    start : (n_coordinate,)
        Coordinates, the model's nuisances first, then those of the terms.
    local : LocalModel, optional
        A model that holds for the whole fit; by default one is made about the point in each round.
    sizes : Sizes, optional
        Of the discrepancy in the first round; later the likeliest at the end of the round before. The likeliest far
        from the solution are so large that any point near the solution would seem right.
    rounds, steps : int
        Most rounds, and steps in each.
    settled, small : float
        Rise of the logarithm of the evidence, and fall of the cost, that end the fit.

    Raises
    ------
    numpy.linalg.LinAlgError
        The model has no modes at the start.
    """
    coordinates = coordinates_of(model, terms)
    lower, upper = (np.array([getattr(c, end) for c in coordinates]) for end in ("lower", "upper"))
    precision = np.array([c.std**-2.0 for c in coordinates])
    x = np.clip(np.array(start, float), lower, upper)
    best: Explanation | None = None
    course: list[float] = []
    at_end: LocalModel | None = None
    here, made, near = local, x, np.array([c.step for c in coordinates])
    for _ in range(rounds):
        if here is None or (local is None and np.any(np.abs(x - made) > near)):
            here, made = model.about(coordinates, [x]), x
        errors, problem, white = weighed_at(model, here, setting, x, sizes)
        if best is not None and here is not at_end:  # the model is another
            sizes = evidence_of(problem, x, coordinates, setting, sizes)[0].sizes
            white = problem.weighed(sizes)
        cost = Cost(precision, sizes)
        at, damp = cost.total(problem, white, x), DAMP
        course.append(at)
        for _ in range(steps):
            after = np.inf
            slope, hessian = _newton(white, problem, x, cost)
            while not after < at and damp < _STUCK:  # it may be no number
                trial, after = step_within(slope, hessian, x, coordinates, damp=damp), np.inf
                with contextlib.suppress(np.linalg.LinAlgError, ValueError):  # no modes there: step less far
                    tried = weighed_at(model, here, setting, trial, sizes)
                    after = cost.total(tried[1], tried[2], trial)
                damp = damp if after < at else max(8.0 * damp, 1e-2)
            if not after < at:
                break
            x, (errors, problem, white) = trial, tried
            at, damp = after, damp / 5.0
            course.append(at)
            if course[-2] - at < small * setting.loose:
                break
        problem = _curved(model, here, setting, problem, white, x, coordinates, cost)
        marginal, std = evidence_of(problem, x, coordinates, setting, sizes)
        std = np.hypot(std, np.where(np.arange(x.size) < len(model.nuisances), 0.0, FORM * x))
        gain = np.inf if best is None else abs(marginal.log - best.log_evidence)
        best = Explanation(
            terms=tuple(term.name for term in terms),
            coordinates=coordinates,
            n_nuisance=len(model.nuisances),
            x=x,
            std=std,
            at_bound=(x <= lower + 1e-9) | (x >= upper - 1e-9),
            evidence=marginal,
            errors=errors,
            problem=cast(Problem, problem),  # a TreeProblem has all that many states need
            apart=setting.apart,
            course=tuple(course),
        )
        at_end, sizes = here, marginal.sizes
        if gain < settled * setting.loose:
            break
    assert best is not None
    return best


def _curved(
    model: Model,
    local: LocalModel,
    setting: Setting,
    problem: Problem | TreeProblem,
    white: Weighed,
    x: Vector,
    coordinates: Sequence[Coordinate],
    cost: Cost,
) -> Problem | TreeProblem:
    """Return a problem with the curvature of the cost along coordinates of terms in which errors hardly change.

    Such is the number of a clamp at its clamp: its derivative is 0 there, and Gauss and Newton's Hessian knows nothing.
    Where that allows more than a step, the model is asked at a step.
    """
    added, here = np.zeros(x.size), cost.total(problem, white, x)
    for i in range(len(model.nuisances), x.size):
        c, known = coordinates[i], white.hessian[i, i] + problem.curvature[i, i]
        if c.lower == c.upper or known > c.step**-2.0:
            continue
        rises = list[float]()
        for step in (-c.step, c.step):
            to = x.copy()
            to[i] = np.clip(x[i] + step, c.lower, c.upper)
            if abs(to[i] - x[i]) > 0.5 * c.step:
                with contextlib.suppress(np.linalg.LinAlgError, ValueError):  # no modes there
                    there = cost.total(*weighed_at(model, local, setting, to, cost.sizes)[1:], to)
                    rises.append(2.0 * (there - here) / (to[i] - x[i]) ** 2)
        if rises:
            added[i] = max(float(np.mean(rises)) - known - float(cost.precision[i]), 0.0)
    return replace(problem, curvature=problem.curvature + np.diag(added)) if added.any() else problem


def weighed_at(
    model: Model, local: LocalModel, setting: Setting, x: Vector, sizes: Sizes
) -> tuple[tuple[Errors, ...], Problem | TreeProblem, Weighed]:
    """Return the errors of all states at coordinates, joined, and over their covariance."""
    errors = errors_at(model, local, setting, x)
    problem = setting.join(errors, x.size)
    return errors, problem, problem.weighed(sizes)


def evidence_of(
    problem: Problem | TreeProblem, x: Vector, coordinates: Sequence[Coordinate], setting: Setting, sizes: Sizes
) -> tuple[Evidence, Vector]:
    """Return the evidence, and the standard deviations of the coordinates; `sizes` are near the likeliest."""
    precision = np.array([c.std**-2.0 for c in coordinates])
    log_prior = 0.5 * float(np.sum(np.log(precision[precision > 0.0]))) + setting.log_prior_apart
    if isinstance(problem, TreeProblem):
        return tree_evidence(problem, x, precision, log_prior, setting.priors, sizes)
    stiffness = spectrum(problem.value, problem.jacobian, problem.noise, problem.discrepancy)
    damping = spectrum(problem.damping, problem.damping_jacobian, problem.damping_noise, problem.damping_discrepancy)
    marginal = evidence(stiffness, damping, problem, x, precision, log_prior, setting.priors)
    return marginal, _std((stiffness, damping), marginal, problem, x, precision, setting.priors)


def step_within(
    slope: Vector, hessian: Vector, x: Vector, coordinates: Sequence[Coordinate], *, damp: float = DAMP
) -> Vector:
    """Return the coordinates after a damped step within bounds and longest steps.

    Parameters
    ----------
    slope, hessian : (n_coordinate,) and (n_coordinate, n_coordinate)
        Gradient of the cost at `x` and approximation of its Hessian.
    x : (n_coordinate,)
        Where the step starts.
    coordinates : sequence of Coordinate
        Bounds and longest steps.
    damp : float
        Added to the scaled diagonal of the Hessian (Levenberg and Marquardt). By default it is below what priors add to
        data: with more, steps are tiny along a valley in which only priors determine the minimum.
    """
    lower, upper, longest = (
        np.array([getattr(c, what) for c in coordinates]) for what in ("lower", "upper", "longest")
    )
    step = bounded_step(slope, hessian, lower - x, upper - x, damp=damp + 1e-9)
    step *= min(1.0, 1.0 / max(float(np.max(np.abs(step) / longest)), 1e-12))
    return np.clip(x + step, lower, upper)


def _newton(white: Weighed, problem: Problem | TreeProblem, x: Vector, cost: Cost) -> tuple[Vector, Vector]:
    """Return the gradient of the cost and Gauss and Newton's approximation of its Hessian."""
    hessian = white.hessian + np.diag(cost.precision) + problem.curvature
    return white.slope + problem.beside(cost.sizes).sum(axis=0) + cost.precision * x, hessian


def _std(
    spectra: tuple[Spectrum, Spectrum],
    marginal: Evidence,
    problem: Problem,
    x: Vector,
    precision: Vector,
    priors: tuple[SizePrior, SizePrior],
    *,
    likely: float = 1e-3,
) -> Vector:
    """Return standard deviations of the coordinates over all likely sizes of the discrepancy.

    The variance is the mean of the variances at each pair of sizes plus the variance of the estimates there (law of
    total variance).
    """
    known = np.diag(precision + 1e-12) + problem.curvature
    pull = precision * x + problem.beside(marginal.sizes).sum(axis=0)
    total, middle, square, chance = np.zeros(x.size), np.zeros(x.size), np.zeros(x.size), 0.0
    for i, j in np.argwhere(marginal.probability > likely):
        share, hessian, slope = marginal.probability[i, j], known, pull
        for errors, size in zip(spectra, (priors[0].grid[i], priors[1].grid[j]), strict=True):
            value, jacobian, _ = errors.at(float(size))
            hessian = hessian + jacobian.T @ jacobian
            slope = slope + jacobian.T @ value
        covariance = scaled_inverse(hessian)
        step = -covariance @ slope
        total += share * np.maximum(np.diag(covariance), 0.0)
        middle += share * step
        square += share * step**2
        chance += share
    return np.asarray(np.sqrt(total / chance + np.maximum(square / chance - (middle / chance) ** 2, 0.0)))
