"""What each effect could explain of what is left, by a linear step: the choice of what is worth a full fit."""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from model import Parameter, SolveError
from updating.diagnosis.coordinates import bounds_of
from updating.diagnosis.evidence import Evidence
from updating.diagnosis.explanation import RANGE_PRECISION, TRUST, Explanation, linearized
from updating.diagnosis.marginal import marginal
from updating.diagnosis.residual import residual

Vector = NDArray[np.float64]

_SILENT = 1e-9  # relative length of a change that is none
_SHAPES = 6  # values tried of a parameter that shapes an effect but has no strength of its own
_DECADES = 10  # values tried of a parameter that begins at an end of a logarithmic range


@dataclass(frozen=True, eq=False, kw_only=True)
class Screened:
    """What an effect does to the data, with the share of all that is fitted already taken out.

    Attributes
    ----------
    effect : str
        Its name.
    parameter : tuple of Parameter
        Its parameters.
    coordinate : (n_parameter,) float
        Where it was taken, in units of their ranges, with 0 for strengths.
    column : (n, n_strength) float
        Change of the whitened residual over the range of each strength, after projection.
    strength : (n_strength,) int
        Which parameters are strengths.
    gain : float
        Linear fall of the misfit that it can bring within its range.
    start : (n_parameter,) float
        Coordinates that bring it.
    elsewhere : tuple of (n_parameter,) float
        Coordinates of the best steps where parameters that have no strength of their own have other values.
    log_gain : float
        Rise of the logarithm of the marginal likelihood by the same step, sizes of the discrepancy integrated out.
    detectability : float
        Length of the projected change at the end of the range, in standard deviations: how well the data show it.
    """

    effect: str
    parameter: tuple[Parameter, ...]
    coordinate: Vector
    column: Vector
    strength: NDArray[np.intp]
    gain: float
    start: Vector
    elsewhere: tuple[Vector, ...]
    log_gain: float
    detectability: float


def screen(evidence: Evidence, at: Explanation) -> tuple[Screened, ...]:
    """Return what each effect of the catalogue could add to an explanation, those that leave a possible stack.

    Parameters
    ----------
    evidence : Evidence
        Measurement and model.
    at : Explanation
        What is fitted already: nuisances and the parameters of its effects are taken out by projection.
    """
    n_fitted = at.residual.jacobian.shape[1]
    projected = _projection(at)
    fitted = {p.name for p in at.parameter}
    names = [
        name for name in evidence.effects if not fitted & {p.name for p in evidence.effects[name].parameters}
    ]

    evidence = evidence.supposing(at.effects)

    def changes(own: Sequence[Parameter], values: Vector) -> tuple[Vector, Vector]:
        """Return the changes of the residual by effect parameters, not projected, whitened and rotated only."""
        both, where = (*at.parameter, *own), np.concatenate([at.coordinate, values])
        found = residual(evidence, at.nuisance, both, where)
        return found.jacobian[:, n_fitted:], found.rotated_jacobian[:, n_fitted:]

    parameters = evidence.parameters(names)
    every = changes(parameters, np.zeros(len(parameters)))
    place = {p.name: i for i, p in enumerate(parameters)}
    r = projected(at.residual.value)
    silent = _SILENT * float(np.abs(every[0]).max(initial=0.0))
    found = []
    for name in names:
        own = evidence.parameters([name])
        if any(_begins_far_off(p) for p in own):
            best, turned, most = _from_trials(evidence, at, name, r)
            elsewhere: tuple[Vector, ...] = ()
        else:
            columns = [place[p.name] for p in own]
            trials = []
            for where, slope, rotated in _slopes(
                own, (every[0][:, columns], every[1][:, columns]), changes, silent
            ):
                strong = np.flatnonzero(np.linalg.norm(slope, axis=0) > silent)
                trials.append((_screened(name, own, where, projected(slope), strong, r), rotated[:, strong]))
            if not trials:
                continue
            best, turned = max(trials, key=lambda trial: trial[0].gain)
            most = max(screened.detectability for screened, _ in trials)
            elsewhere = tuple(screened.start for screened, _ in trials if screened is not best)
        gain = _log_gain(evidence, at, best, turned)
        found.append(replace(best, elsewhere=elsewhere, log_gain=gain, detectability=most))
    return tuple(found)


def _slopes(
    own: Sequence[Parameter],
    neutral: tuple[Vector, Vector],
    changes: Callable[[Sequence[Parameter], Vector], tuple[Vector, Vector]],
    silent: float,
) -> Iterator[tuple[Vector, Vector, Vector]]:
    """Yield where an effect is taken and how the residual changes there, whitened and rotated only.

    A parameter that changes nothing at neutral shapes the effect, and is tried over its range.
    """
    shaping = np.flatnonzero(np.linalg.norm(neutral[0], axis=0) <= silent)
    low, high = bounds_of(own)
    for values in itertools.product(*(np.linspace(low[i], high[i], _SHAPES) for i in shaping)):
        where = np.zeros(len(own))
        where[shaping] = values
        try:
            slope, rotated = changes(own, where) if shaping.size else neutral
        except SolveError:  # with what is fitted already, there is no such stack
            continue
        slope = slope.copy()
        slope[:, shaping] = 0.0
        yield where, slope, rotated


def _begins_far_off(p: Parameter) -> bool:
    """Tell whether a parameter is neutral at an end of a logarithmic range, where a step changes next to nothing."""
    return p.scale == "log" and p.neutral in (p.lower, p.upper)


def _from_trials(evidence: Evidence, at: Explanation, name: str, r: Vector) -> tuple[Screened, Vector, float]:
    """Return an effect whose changes are taken between neutral and trial values, not as slopes at neutral.

    Beside it its change before projection and whitening, and its largest detectability. Each parameter is tried alone,
    their changes are added, and a step stays near the values that it was taken at.
    """
    own, projected = evidence.parameters([name]), _projection(at)
    low, high = bounds_of(own)
    end = np.where(-low > high, low, high)
    step = np.abs(end) / _DECADES

    def changed(where: Vector) -> tuple[Vector, Vector]:
        both, coordinate = (*at.parameter, *own), np.concatenate([at.coordinate, where])
        found = residual(evidence, at.nuisance, both, coordinate)
        return found.value, found.rotated

    neutral, neutral_rotated = changed(np.zeros(len(own)))
    tried: list[list[tuple[float, Vector, Vector]]] = []
    for i, far in enumerate(end):
        tried.append([(0.0, 0.0 * r, 0.0 * neutral_rotated)])
        for z in np.linspace(0.0, far, _DECADES + 1)[1:]:
            with contextlib.suppress(SolveError):
                value, rotated = changed(z * np.eye(len(own))[i])
                tried[-1].append((z, projected((value - neutral) / z), (rotated - neutral_rotated) / z))
    all_of_it, trials = np.arange(len(own)), []
    for combination in itertools.product(*tried):
        where = np.array([z for z, _, _ in combination])
        near = (np.maximum(low, where - step), np.minimum(high, where + step))
        column = np.column_stack([c for _, c, _ in combination])
        trial = _screened(name, own, np.zeros(len(own)), column, all_of_it, r, near)
        trials.append((trial, np.column_stack([c for _, _, c in combination])))
    best, turned = max(trials, key=lambda trial: trial[0].gain)
    most = max(float(np.linalg.norm(z * c)) for own_trials in tried for z, c, _ in own_trials)
    return best, turned, most


def _log_gain(evidence: Evidence, at: Explanation, own: Screened, column: Vector) -> float:
    """Return by how much the linear step of an effect raises the logarithm of the marginal likelihood."""
    before = linearized(evidence, at.residual, np.concatenate([at.nuisance, at.coordinate]), at.at_bound)
    low, high = bounds_of(own.parameter)
    step = own.start[own.strength]
    held = (step <= low[own.strength]) | (step >= high[own.strength])
    n = step.size
    after = replace(
        before,
        value=before.value + column @ step,
        jacobian=np.hstack([before.jacobian, column]),
        prior_value=np.append(before.prior_value, np.zeros(n)),
        prior_precision=np.append(before.prior_precision, np.zeros(n)),
        trust=np.append(before.trust, np.full(n, TRUST)),
        unseen=np.append(before.unseen, np.full(n, RANGE_PRECISION)),
        free=np.append(before.free, ~held),
    )
    stated = (evidence.scatter.sizes, evidence.scatter.stated)
    return marginal(after, *stated, near=(at.mean, at.spread)).log_evidence - at.log_evidence


def release(evidence: Evidence, at: Explanation, hypothesis: str) -> float:
    """Return by how much supposing something about the measurement raises the logarithm of the marginal likelihood."""
    before = linearized(
        evidence.supposing(at.effects), at.residual, np.concatenate([at.nuisance, at.coordinate]), at.at_bound
    )
    std = evidence.supposing((*at.effects, hypothesis)).prior_std
    precision = before.prior_precision.copy()
    precision[: std.size] = std**-2.0
    stated = (evidence.scatter.sizes, evidence.scatter.stated)
    found = marginal(replace(before, prior_precision=precision), *stated, near=(at.mean, at.spread))
    return found.log_evidence - at.log_evidence


def stepped(at: Explanation, own: Screened) -> Explanation:
    """Return an explanation with the residual that the linear step of an effect beside it leaves."""
    value = _projection(at)(at.residual.value) + own.column @ own.start[own.strength]
    jacobian = np.hstack([at.residual.jacobian, own.column])
    return replace(at, residual=replace(at.residual, value=value, jacobian=jacobian))


def pair_steps(
    at: Explanation, screened: Sequence[Screened]
) -> list[tuple[float, tuple[str, str], tuple[Vector, Vector]]]:
    """Return the misfit after a linear step, the names and where each starts, for all pairs; the best first."""
    projected = _projection(at)
    r, steps = projected(at.residual.value), []
    for a, b in itertools.combinations(screened, 2):
        if {p.name for p in a.parameter} & {p.name for p in b.parameter}:
            continue
        (low_a, high_a), (low_b, high_b) = bounds_of(a.parameter), bounds_of(b.parameter)
        column = np.hstack([a.column, b.column])
        low = np.concatenate([low_a[a.strength], low_b[b.strength]])
        high = np.concatenate([high_a[a.strength], high_b[b.strength]])
        step = _bounded(column, r, low, high)
        first, second = a.coordinate.copy(), b.coordinate.copy()
        first[a.strength], second[b.strength] = step[: a.strength.size], step[a.strength.size :]
        steps.append((float(np.sum((r + column @ step) ** 2)), (a.effect, b.effect), (first, second)))
    return sorted(steps, key=lambda item: item[0])


def _projection(at: Explanation) -> Callable[[Vector], Vector]:
    """Return the function that takes out of columns what parameters that are fitted already could do."""
    q = np.linalg.qr(at.residual.jacobian)[0]

    def projected(columns: Vector) -> Vector:
        return np.asarray(columns - q @ (q.T @ columns))

    return projected


def _screened(
    name: str,
    own: tuple[Parameter, ...],
    at: Vector,
    columns: Vector,
    strength: NDArray[np.intp],
    r: Vector,
    near: tuple[Vector, Vector] | None = None,
) -> Screened:
    low, high = bounds_of(own) if near is None else near
    c = columns[:, strength]
    step = _bounded(c, r, low[strength], high[strength])
    start = at.copy()
    start[strength] = step
    detectability = max(
        (float(np.linalg.norm(c[:, i]) * max(abs(low[s]), abs(high[s]))) for i, s in enumerate(strength)),
        default=0.0,
    )
    return Screened(
        effect=name,
        parameter=own,
        coordinate=at,
        column=c,
        strength=strength,
        gain=float(r @ r - np.sum((r + c @ step) ** 2)),
        start=start,
        elsewhere=(),
        log_gain=-np.inf,
        detectability=detectability,
    )


def _bounded(c: Vector, r: Vector, low: Vector, high: Vector) -> Vector:
    """Return the step within bounds that makes r + c step smallest."""
    gram = c.T @ c
    scale = np.sqrt(np.maximum(np.diag(gram), 1e-30))
    if not scale.size or scale.max() < 1e-12:
        return np.zeros(scale.size)
    small = gram / np.outer(scale, scale) + 1e-10 * np.eye(scale.size)
    root = np.linalg.cholesky(small)
    target = np.linalg.solve(root, -(c.T @ r) / scale)
    solution = lsq_linear(root.T, target, bounds=(low * scale - 1e-12, high * scale + 1e-12), method="bvls")
    return np.asarray(solution.x / scale)
