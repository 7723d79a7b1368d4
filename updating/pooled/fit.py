"""An explanation of many specimens, fitted to all of them together: linear, solved, stepped, linear again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from model import SolveError
from updating.diagnosis.calibration import WIDER
from updating.diagnosis.discrepancy import KINDS
from updating.diagnosis.explanation import TRUST
from updating.pooled.algebra import Joined, Reduced, Strengths, joined, log_evidence, reduced
from updating.pooled.beside import Bench
from updating.pooled.linear import Linear, Place, Scales, linearized, only, strengths
from updating.pooled.term import Coordinate, Term, coordinates_of

Vector = NDArray[np.float64]

SCALES = ("frequency", "own_frequency", "damping", "own_damping", "shape", "own_shape", "stiffness", "loss")
_LOOKS = (0.7, 0.35, 0.2)  # steps of the logarithm of a scale at which it is looked for
_MOST_LOOKS, _STAYS = (
    8,
    1.0,
)  # looks with the widest steps, and the rise of the evidence below which the last was one
_FARTHEST = 0.3  # of a range, or of ln G_f, that a step may go
_HALVED = 3
_SETTLED = 0.1  # fall of the misfit that ends a fit
_INEXACT = 1.0  # of a logarithm of the evidence, to first order from where the misfit is not least


@dataclass(frozen=True, eq=False, kw_only=True)
class Fitted:
    """An explanation fitted to all specimens.

    Attributes
    ----------
    terms : tuple of Term
        None for the base model.
    coordinates : tuple of Coordinate
        Of the terms.
    at : Place
        Where it stands.
    scales : Scales
        The likeliest, by which it is weighed.
    linear : Linear
        About where it stands.
    log_evidence : float
        Logarithm of the marginal likelihood with the prior of the scales, up to a constant of the data.
    """

    terms: tuple[Term, ...]
    coordinates: tuple[Coordinate, ...]
    at: Place
    scales: Scales
    linear: Linear
    log_evidence: float

    @property
    def frequency_error(self) -> float:
        """Mean relative error of frequencies over all specimens."""
        return float(np.mean([own.frequency_error for own in self.linear.found]))


class Weighing:
    """Evidence of specimens about a place at any scales; what was found at scales that were seen is kept."""

    def __init__(self, bench: Bench, linear: Linear, coordinates: Sequence[Coordinate], at: Vector) -> None:
        self._bench, self._linear, self._coordinates, self._at = bench, linear, coordinates, at
        self._places = [linear.placed(s, coordinates) for s in range(len(linear.block))]
        self._grams: dict[tuple[int, str, float], tuple[Vector, float]] = {}
        self._seen: tuple[tuple[float, ...], list[Reduced]] | None = None

    def reduced(self, scales: Scales) -> list[Reduced]:
        """Return each specimen without its own coordinates."""
        key = (
            scales.stiffness,
            scales.loss,
            *(scales.own(kind) for kind in KINDS),
        )  # all that is a specimen's own
        if self._seen is None or self._seen[0] != key:
            grams = [self._grams_of(s, scales) for s in range(len(self._linear.block))]
            self._seen = key, reduced(self._linear.block, self._strengths(scales), grams)
        return self._seen[1]

    def _strengths(self, scales: Scales) -> list[Strengths]:
        """Return what each specimen is weighed with, which those with the same coordinates have in common."""
        names = [own.evidence.nuisances for own in self._bench.own]
        of = {own: strengths(self._bench, names.index(own), scales) for own in set(names)}
        return [of[own] for own in names]

    def _grams_of(self, s: int, scales: Scales) -> list[tuple[Vector, float]]:
        grams = []
        for kind in KINDS:
            seen = (s, kind, scales.own(kind))
            if seen not in self._grams:
                self._grams[seen] = self._linear.block[s].gram(kind, seen[2])
            grams.append(self._grams[seen])
        return grams

    def joined(self, specimens: Sequence[Reduced | None], scales: Scales) -> Joined:
        """Return specimens together; those that are None are left out."""
        kept = [(s, own) for s, own in enumerate(specimens) if own is not None]
        return joined(
            [own for _, own in kept],
            strengths(self._bench, kept[0][0], scales),
            [self._places[s] for s, _ in kept],
            (self._at, np.array([own.precision for own in self._coordinates])),
        )

    def bounds(self) -> tuple[Vector, Vector]:
        """Return how far the coordinates of the terms may step."""
        low, high = (np.array([getattr(own, end) for own in self._coordinates]) for end in ("lower", "upper"))
        return np.minimum(low - self._at, 0.0), np.maximum(high - self._at, 0.0)

    def log_evidence(self, scales: Scales) -> float:
        """Return the logarithm of the marginal likelihood, with the prior of the scales."""
        found = self.joined(self.reduced(scales), scales)
        step = found.step(*self.bounds(), TRUST)
        unseen = np.zeros(found.slope.size)
        unseen[found.slope.size - len(self._coordinates) :] = [own.unseen for own in self._coordinates]
        return log_evidence(found, step, unseen) + scales.log_prior(
            self._bench.own[0].evidence.scatter.stated
        )

    def likeliest(self, scales: Scales, stated: Sequence[str] = ()) -> tuple[Scales, float]:
        """Return the scales of the largest evidence near some, and that; those that are stated stay."""
        best, top = scales, self.log_evidence(scales)
        for h in _LOOKS:
            for _ in range(_MOST_LOOKS):
                before = top
                best, top = self._nearer(best, top, h, stated)
                if h < _LOOKS[0] or top - before < _STAYS:  # far off models are many times the usual off
                    break
        return best, top

    def _nearer(self, best: Scales, top: float, h: float, stated: Sequence[str]) -> tuple[Scales, float]:
        """Return better scales near some, one after the other by a parabola through steps of a width."""
        for name in SCALES:
            if name.removeprefix("own_") in stated:
                continue
            before = best
            ends = [self._moved(before, name, step) for step in (-h, h)]
            values = [self.log_evidence(own) for own in ends]
            bend = values[0] + values[1] - 2.0 * top
            trials = list(zip(ends, values, strict=True))
            if bend < 0.0:
                vertex = float(np.clip(0.5 * h * (values[0] - values[1]) / bend, -2.0 * h, 2.0 * h))
                own = self._moved(before, name, vertex)
                trials.append((own, self.log_evidence(own)))
            best, top = max([(best, top), *trials], key=lambda trial: trial[1])
        return best, top

    @staticmethod
    def _moved(scales: Scales, name: str, step: float) -> Scales:
        return replace(scales, **{name: float(getattr(scales, name) * np.exp(step))})


def stds(bench: Bench, own: Fitted) -> Vector:
    """Return standard deviations of the coordinates of terms, all else integrated out.

    What separates model and measurement is most of them, so they are all widened as those of a single stack.
    """
    weighing = Weighing(bench, own.linear, own.coordinates, own.at.coordinate)
    joint = weighing.joined(weighing.reduced(own.scales), own.scales)
    n = joint.slope.size - len(own.coordinates)
    unseen = np.concatenate([np.zeros(n), [c.unseen for c in own.coordinates]])
    return WIDER * np.asarray(np.sqrt(np.diag(np.linalg.inv(joint.precision + np.diag(unseen)))[n:]))


def misfit_at(found: Sequence[Reduced], joint: Joined, n_coordinate: int, prior: Vector) -> float:
    """Return the misfit where own coordinates and those of terms stay, and the least by what specimens share."""
    n = joint.slope.size - n_coordinate
    held = sum(own.held[:n, :n] for own in found) + np.diag(prior[:n])
    slope = sum(own.held[:n, -1] for own in found)
    constant = sum(own.held[-1, -1] for own in found)
    return float(constant - slope @ np.linalg.solve(held, slope))


def fit(
    bench: Bench,
    terms: Sequence[Term],
    start: Place,
    scales: Scales | None,
    *,
    most: int = 8,
    settled: bool = True,
) -> Fitted:
    """Fit terms, and the own coordinates of all specimens, from a place.

    Parameters
    ----------
    bench : Bench
        The specimens.
    terms : sequence of Term
        None fits the base model.
    start : Place
        From where.
    scales : Scales, optional
        By which data are weighed at first; without, those that are likeliest where the fit starts, as is right of a
        place that other weights led to.
    most : int
        Largest number of steps.
    settled : bool
        Whether the fit goes on with the scales that are estimated when it has come to its end.

    Raises
    ------
    SolveError
        A model has no modes where the fit starts.
    """
    coordinates = tuple(own for term in terms for own in coordinates_of(bench, term))
    stated = bench.own[0].evidence.scatter.stated
    linear = only(linearized(bench, start, coordinates), coordinates)
    if scales is None:
        scales, _ = Weighing(bench, linear, coordinates, start.coordinate).likeliest(Scales(), stated)
    at, linear = _settled(bench, coordinates, start, linear, scales.weights(stated), most)
    weighing = Weighing(bench, linear, coordinates, at.coordinate)
    scales, log_evidence = weighing.likeliest(scales, stated)
    if settled:
        further = _settled(bench, coordinates, at, linear, scales.weights(stated), most // 2)
        reached = Weighing(bench, further[1], coordinates, further[0].coordinate).log_evidence(scales)
        # the largest evidence need not be where the misfit is least; but away from there it is less exact
        if reached > log_evidence - _INEXACT:
            (at, linear), log_evidence = further, reached
    return Fitted(
        terms=tuple(terms),
        coordinates=coordinates,
        at=at,
        scales=scales,
        linear=linear,
        log_evidence=log_evidence,
    )


def _settled(
    bench: Bench, coordinates: Sequence[Coordinate], at: Place, linear: Linear, scales: Scales, most: int
) -> tuple[Place, Linear]:
    """Step to where first order promises the least misfit, until it falls no more (Gauss and Newton)."""
    look = _look(bench, linear, coordinates, at, scales)
    for _ in range(most):
        if look.promised < _SETTLED:
            break
        share = 1.0
        for _ in range(_HALVED):
            trial = _stepped(at, look, share)
            try:
                further = only(linearized(bench, trial, coordinates), coordinates)
                following = _look(bench, further, coordinates, trial, scales)
            except SolveError:
                following = None
            if following is not None and following.misfit < look.misfit:
                break
            share *= 0.3
        else:
            break
        fell = look.misfit - following.misfit
        at, linear, look = trial, further, following
        if fell < _SETTLED:
            break
    return at, linear


@dataclass(frozen=True, eq=False, kw_only=True)
class _Look:
    """The misfit at a place, how far first order promises it to fall, and the step there, own and of the terms."""

    misfit: float
    promised: float
    own: list[Vector]
    coordinate: Vector


def _look(
    bench: Bench, linear: Linear, coordinates: Sequence[Coordinate], at: Place, scales: Scales
) -> _Look:
    """Look about a place for where first order promises the least misfit."""
    weighing = Weighing(bench, linear, coordinates, at.coordinate)
    found = weighing.reduced(scales)
    joint = weighing.joined(found, scales)
    weighed = strengths(bench, 0, scales)
    prior = np.array([*weighed.mean, *weighed.latent]) ** -2.0
    own_prior = sum(c.precision * z**2 for c, z in zip(coordinates, at.coordinate, strict=True))
    misfit = misfit_at(found, joint, len(coordinates), prior) + own_prior
    solution = joint.step(*weighing.bounds(), TRUST)
    return _Look(
        misfit=misfit,
        promised=misfit - joint.at(solution),
        own=own_steps(linear, found, coordinates, solution),
        coordinate=solution[solution.size - len(coordinates) :],
    )


def own_steps(
    linear: Linear, found: Sequence[Reduced], coordinates: Sequence[Coordinate], solution: Vector
) -> list[Vector]:
    """Return the steps of the own coordinates of each specimen that go with a step of all else."""
    n = solution.size - len(coordinates)
    return [
        -own.back @ np.concatenate([solution[:n], linear.placed(s, coordinates) @ solution[n:], [1.0]])
        for s, own in enumerate(found)
    ]


def _stepped(at: Place, look: _Look, share: float) -> Place:
    """Return a place a share of a step farther, none of which is longer than first order may do for."""
    longest = max([1e-9, *(abs(x[0]) for x in look.own), *np.abs(look.coordinate).tolist()])
    share = min(share, share * _FARTHEST / longest)
    return Place(
        nuisance=tuple(x + share * dx for x, dx in zip(at.nuisance, look.own, strict=True)),
        coordinate=at.coordinate + share * look.coordinate,
    )
