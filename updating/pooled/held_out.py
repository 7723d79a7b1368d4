"""How well an explanation predicts a specimen that it has not seen: what specimens share is taken from the others."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from updating.diagnosis.explanation import TRUST
from updating.pooled.algebra import Joined, Reduced, grams, log_evidence, reduced
from updating.pooled.beside import Bench
from updating.pooled.fit import Fitted, Weighing, own_steps
from updating.pooled.linear import strengths

Vector = NDArray[np.float64]


@dataclass(frozen=True, eq=False, kw_only=True)
class SpecimensLeftOut:
    """Predictions of each specimen from all others.

    Attributes
    ----------
    error : (n_specimen,) float
        Mean relative errors of its frequencies, its own contact fitted and what it shares with others taken from them.
    score : (n_specimen,) float
        Logarithm of the probability density of its data given those of all others, up to a constant of the data.
    """

    error: Vector
    score: Vector


def specimens_left_out(bench: Bench, own: Fitted) -> SpecimensLeftOut:
    """Predict each specimen from all others.

    To first order nothing is fitted again: a specimen is a summand of what is solved. What a specimen alone has cannot
    be told by others, so it is predicted without.

    Parameters
    ----------
    bench : Bench
        The specimens.
    own : Fitted
        The explanation.
    """
    weighing = Weighing(bench, own.linear, own.coordinates, own.at.coordinate)
    every = weighing.reduced(own.scales)
    low, high = weighing.bounds()
    whole = _log_density(own, weighing.joined(every, own.scales), low, high)
    error, score = np.empty(len(every)), np.empty(len(every))
    for s in range(len(every)):
        joint = weighing.joined([x if i != s else None for i, x in enumerate(every)], own.scales)
        lone = np.array([c.members == (s,) for c in own.coordinates], dtype=bool)
        down = np.where(lone, -own.at.coordinate, low)
        up = np.where(lone, -own.at.coordinate, high)
        error[s] = _error(own, s, every, joint.step(down, up, TRUST), bench)
        score[s] = whole - _log_density(own, joint, low, high)
    return SpecimensLeftOut(error=error, score=score)


def _log_density(own: Fitted, joint: Joined, low: Vector, high: Vector) -> float:
    n = joint.slope.size - len(own.coordinates)
    unseen = np.concatenate([np.zeros(n), [c.unseen for c in own.coordinates]])
    return log_evidence(joint, joint.step(low, high, TRUST), unseen)


def torques_left_out(bench: Bench, own: Fitted) -> Vector:
    """Predict the frequencies of each specimen at each torque, those and the damping ratios there being left out.

    Returns
    -------
    (n,) float
        Mean relative errors, of each configuration of specimens that have several.
    """
    weighing = Weighing(bench, own.linear, own.coordinates, own.at.coordinate)
    every = weighing.reduced(own.scales)
    low, high = weighing.bounds()
    found = []
    for s, beside in enumerate(bench.own):
        rows, block = beside.evidence.rows, own.linear.block[s]
        for c in range(len(beside.evidence.tested)) if len(beside.evidence.tested) > 1 else ():
            away = (rows.configuration == c) & (rows.kind != "shape")
            kept = replace(
                block,
                value=block.value[~away],
                own=block.own[~away],
                shared=block.shared[~away],
                effect=block.effect[~away],
                kind=block.kind[~away],
                growth=block.growth[~away],
            )
            weighed = strengths(bench, s, own.scales)
            (left,) = reduced([kept], [weighed], [grams(kept, weighed.size)])
            without = [*every[:s], left, *every[s + 1 :]]
            solution = weighing.joined(without, own.scales).step(low, high, TRUST)
            found.append(_error(own, s, without, solution, bench, c))
    return np.array(found)


def _error(
    own: Fitted,
    s: int,
    every: list[Reduced],
    solution: Vector,
    bench: Bench,
    configuration: int | None = None,
) -> float:
    """Return the mean relative error of a specimen's frequencies, in one configuration or all, after a step."""
    block, n = own.linear.block[s], solution.size - len(own.coordinates)
    effects = own.linear.placed(s, own.coordinates) @ solution[n:]
    step = own_steps(own.linear, every, own.coordinates, solution)[s]
    rotated = block.value + block.own @ step + block.effect @ effects
    rows = bench.own[s].evidence.rows
    logs = [
        la.solve(part.rotation, rotated[part.row])
        for part in bench.own[s].evidence.covariance.blocks
        if block.kind[part.row[0]] == "frequency"
        and configuration in (None, int(rows.configuration[part.row[0]]))
    ]
    return float(np.mean(np.abs(np.expm1(-np.concatenate(logs)))))
