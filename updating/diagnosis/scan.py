"""A global search over the range of every effect, for a base model so far off that steps from it mislead."""

from __future__ import annotations

import contextlib
import itertools
import logging
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import differential_evolution, minimize

from ema.modal.mac import mac
from model import Parameter, SolveError
from updating.diagnosis.candidates import G_F_RANGE
from updating.diagnosis.coordinates import bounds_of, scaled
from updating.diagnosis.evidence import D_F_START, Evidence, pair, solved
from updating.workers.workers import distribute

Vector = NDArray[np.float64]
_LOG = logging.getLogger(__name__)

N_NEAREST = 6
"""Effects that are followed from where the look finds them."""
MESSAGES = 8
"""In which work is sent to other processes: each holds the equations, some 40 MB."""
_SHARES = (0.01, 0.03, 0.1, 0.2, 0.4, 0.7, 1.0)  # of the way from neutral to an end of the range
_PLACES, _PLACES_OF_EACH = 11, 7  # of a parameter over which modes change much, of each of several
_STIFFNESS = 3
_STEP = 0.7  # of log G_f, over which frequencies follow it by their slope
_SETTLE = 0.15  # of a range, by which a place of the scan is varied
_LINE = 61  # places over the range of a single parameter: as modes cross, valleys are narrow
_GENERATIONS, _POPULATION = 12, 12  # of a search over several parameters, the population for each of them
_MOST, _CLOSE = 60, 1e-3  # evaluations, and change of the cost that ends them
_VALLEYS, _APART = 4, 0.1  # places of an effect that are returned, and how far apart in units of its ranges
_LIKE = 0.9  # MAC of a mode that an effect brings: one that is half alike may be another
_FAR = 0.05  # a relative difference of frequency that counts as no resemblance


@dataclass(frozen=True, eq=False, kw_only=True)
class Place:
    """Where an effect comes nearest to the measurement.

    Attributes
    ----------
    effect : str
        Its name.
    cost : float
        What is far off counts at most once (Geman and McClure 1985): the sum of d**2 / (1 + d**2), where d is a mode's
        relative difference in frequency over 5 %, and of 1 - MAC.
    G_f : float
        Contact stiffness parameter there, Pa/Pa.
    coordinate : (n_parameter,) float
        The effect's parameters in units of their ranges.
    """

    effect: str
    cost: float
    G_f: float
    coordinate: Vector


def nearest(evidence: Evidence, executor: Executor | None = None) -> tuple[Place, ...]:
    """Return where the effects come nearest that come near, each with up to four places that are apart; the best first.

    All modes of the configuration with most of them are looked at, those too that the base model lacks.

    Parameters
    ----------
    evidence : Evidence
        Measurement and model.
    executor : Executor, optional
        What takes a part of the work.
    """
    _LOG.info("global search over the ranges of %d effects", len(evidence.effects))
    rough = evidence.rough
    seen = distribute(partial(_scan, rough), evidence.effects, executor, MESSAGES)
    best = sorted(seen, key=lambda found: found.cost)[:N_NEAREST]
    places = distribute(partial(_settled, rough), best, executor, MESSAGES)
    return tuple(sorted(itertools.chain.from_iterable(places), key=lambda found: found.cost))


def with_modes_of(evidence: Evidence, places: Sequence[Place]) -> tuple[NDArray[np.int64], ...]:
    """Return the measured modes of each configuration that the model has at one of some places, or had before.

    It is the place at which it has most; one where some configuration has no modes at all is passed over.
    """
    most, rough = evidence.used, evidence.rough
    for place in places:
        with contextlib.suppress(SolveError):
            used = tuple(_used_there(rough, c, place) for c in range(len(evidence.tested)))
            most = max(most, used, key=lambda modes: sum(own.size for own in modes))
    return most


def _used_there(evidence: Evidence, c: int, place: Place) -> NDArray[np.int64]:
    """Return the measured modes of a configuration that the model has at a place, or had before."""
    theta = {"G_f": place.G_f, "d_f": D_F_START, **_values(evidence, place.effect, place.coordinate)}
    modes, measured = solved(evidence, c, theta, ()), evidence.tested[c].modes
    row, column = pair(measured.shape, measured.frequency, modes.shape, modes.frequency)
    alike = mac(measured.shape, modes.shape)[row, column]
    return np.union1d(evidence.used[c], row[alike >= _LIKE])


def _scan(evidence: Evidence, name: str) -> Place:
    """Look over the range of an effect for the place of least cost."""
    grid = itertools.product(
        np.geomspace(2.0 * G_F_RANGE[0], G_F_RANGE[1] / 2.0, _STIFFNESS), _grid(evidence.parameters([name]))
    )
    return min(
        (_place(evidence, name, float(G_f), where) for G_f, where in grid), key=lambda found: found.cost
    )


def _settled(evidence: Evidence, start: Place) -> tuple[Place, ...]:
    """Go from a place of the scan, which is coarse, to one of less cost (Nelder and Mead 1965).

    Where an effect has several parameters the valleys are narrow and crooked, and a population looks for them over the
    whole range first (Storn and Price 1997); a single one is looked over at close places. The cost is that of one
    configuration, so others of them may fit better.
    """
    low, high = bounds_of(evidence.parameters([start.effect]))
    seen = [start]

    def cost(G_f: float, where: Vector) -> float:
        seen.append(_place(evidence, start.effect, G_f, where.copy()))
        return seen[-1].cost

    if start.coordinate.size == 1:
        for x in np.linspace(low[0], high[0], _LINE):
            cost(start.G_f, np.array([x]))
    else:
        differential_evolution(
            lambda x: cost(start.G_f, x),
            list(zip(low, high, strict=True)),
            maxiter=_GENERATIONS,
            popsize=_POPULATION,
            init="sobol",
            polish=False,
            rng=0,
        )
    best = min(seen, key=lambda found: found.cost)
    lowest, highest = np.concatenate([np.log([G_F_RANGE]).T, [low, high]], axis=1)
    first = np.clip(np.concatenate([[np.log(best.G_f)], best.coordinate]), lowest, highest)
    step = np.concatenate([[_STEP], (high - low) * _SETTLE])
    inside = np.where(first[1:] + step[1:] < high, 1.0, -1.0)
    corners = first + np.vstack([np.zeros(first.size), np.diag(step * np.concatenate([[1.0], inside]))])
    minimize(
        lambda x: cost(float(np.exp(x[0])), x[1:]),
        first,
        method="Nelder-Mead",
        bounds=list(zip(lowest, highest, strict=True)),
        options={"initial_simplex": corners, "maxfev": _MOST, "fatol": _CLOSE, "xatol": _CLOSE},
    )
    valleys: list[Place] = []
    for place in sorted(seen, key=lambda found: found.cost):
        if len(valleys) < _VALLEYS and all(
            np.max(np.abs(place.coordinate - other.coordinate) / (high - low)) > _APART for other in valleys
        ):
            valleys.append(place)
    return tuple(valleys)


def _values(evidence: Evidence, name: str, where: Vector) -> dict[str, float]:
    """Return an effect's parameters at coordinates."""
    own = evidence.parameters([name])
    return {p.name: scaled(p, float(x))[0] for p, x in zip(own, where, strict=True)}


def _place(evidence: Evidence, name: str, G_f: float, where: Vector) -> Place:
    """Return the cost at coordinates of an effect, with the G_f near the given one that makes it small."""
    c = int(np.argmax([own.modes.frequency.size for own in evidence.tested]))
    shape, frequency = evidence.tested[c].modes.shape, evidence.tested[c].modes.frequency
    theta = {"G_f": G_f, "d_f": D_F_START, **_values(evidence, name, where)}
    try:
        modes = solved(evidence, c, theta, ("G_f",))
    except SolveError:  # so strong that the contact turns negative
        return Place(effect=name, cost=np.inf, G_f=G_f, coordinate=where)
    row, column = pair(shape, frequency, modes.shape, modes.frequency)
    alike = mac(shape, modes.shape)[row, column]
    far = np.log(frequency[row] / modes.frequency[column])
    slope = G_f * modes.frequency_gradient[column, 0] / modes.frequency[column]
    follows = slope > 0.0  # none does of one lamina
    ratio = float(np.median(far[follows] / slope[follows])) if np.any(follows) else 0.0
    ratio = float(np.clip(ratio, -_STEP, _STEP))  # of log G_f, for most modes at once
    far = (far - ratio * slope) / _FAR
    cost = float(np.sum(far**2 / (1.0 + far**2) + 1.0 - alike))
    return Place(effect=name, cost=cost, G_f=float(G_f * np.exp(ratio)), coordinate=where)


def _grid(own: tuple[Parameter, ...]) -> Iterator[Vector]:
    low, high = bounds_of(own)
    places = _PLACES if sum(p.sampled for p in own) < 2 else _PLACES_OF_EACH
    axes = []
    for i, p in enumerate(own):
        if p.sampled:
            axes.append(np.linspace(low[i], high[i], places))
        else:
            axes.append(np.array([s * end for end in (low[i], high[i]) if end for s in _SHARES]))
    for values in itertools.product(*axes):
        yield np.array(values)
