"""Tests in which two modes of one torque all but coincide: the pressure is moved until they do."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from tests.independent.bench import Array, Bench, SecondModel, read_bench
from tests.independent.campaign import KINDS, Configuration, Plan, deviating, nominal_points, tightened, visible

CLOSE = 5e-3
"""Largest distance of the two modes, relative to their frequency."""
_SHARES = np.geomspace(0.4, 2.5, 5)  # of the stated pressures; beyond, modes leave the band
_SCANNED = 36  # modes that are followed
_MEETS = 5e-4  # from the distance that was drawn, relative to the frequency
_STEPS = 4


@dataclass(frozen=True, kw_only=True)
class _Solved:
    """Modes at a logarithm of the pressure.

    Attributes
    ----------
    at : float
        The logarithm of the factor on the stated pressure.
    log_frequency : (n,) float
        Logarithms of frequencies over 1 Hz.
    shape : (135, n) float
        At the points, each of unit length.
    seen : (n,) bool
        Which a measurement shows.
    """

    at: float
    log_frequency: Array
    shape: Array
    seen: NDArray[np.bool_]

    def gap(self, pair: tuple[int, int]) -> float:
        """Return the logarithm of the ratio of two frequencies."""
        return float(self.log_frequency[pair[0]] - self.log_frequency[pair[1]])


@dataclass(frozen=True, kw_only=True)
class _Crossing:
    """Neighbours of a scan between which two modes cross, and which these are."""

    left: _Solved
    right: _Solved
    pair: tuple[int, int]


def near_crossing(plan: Plan, second_model: SecondModel, coarse: SecondModel) -> Plan | None:
    """Return a test at other pressures, of which one brings two modes to a distance that the seed draws.

    The pressures of all torques are multiplied by one number, so that the stack and its model stay as they are. It is
    found on the true stack: modes are followed over the pressure by their shapes, and where two of them cross, the
    pressure is sought at which their distance is the one that was drawn.

    Parameters
    ----------
    plan : Plan
        The test as drawn.
    second_model, coarse : SecondModel
        What simulates it, and the same less exact, by which crossings are looked for.

    Returns
    -------
    Plan, optional
        None where no two modes cross in the band.
    """
    rng = np.random.default_rng([plan.seed, KINDS.index(plan.kind), 3])
    wanted = rng.uniform(-CLOSE, CLOSE) * 0.9  # the sensors' mass and scatter move both by some 1e-4
    for torque in rng.permutation(len(plan.configurations)):
        scan = [_solve(plan, coarse, torque, x) for x in np.log(_SHARES)]
        crossings = list(_crossings(scan))
        for i in rng.permutation(len(crossings)):
            found = _met(plan, second_model, torque, crossings[i], wanted)
            if found is not None:
                return tightened_to(plan, float(np.exp(found)))
    return None


def tightened_to(plan: Plan, share: float) -> Plan:
    """Return a test at a multiple of the stated pressures, rounded to 10 Pa."""
    pressures = [round(share * one.pressure, -1) for one in plan.configurations]
    pairs = zip(plan.configurations, pressures, strict=True)
    return replace(
        plan,
        configurations=tuple(
            Configuration(name=one.name, torque=round(share * one.torque, 3), pressure=p) for one, p in pairs
        ),
    )


def true_bench(plan: Plan, torque: int) -> tuple[Bench, Array]:
    """Return the stack of a torque and the points as `simulate` draws them."""
    rng = np.random.default_rng([plan.seed, KINDS.index(plan.kind), 1])
    stated = read_bench(plan.stack)
    stack, point = deviating(plan, stated, nominal_points(stated, plan.shaker), rng)
    return [tightened(plan, stack, i, rng) for i in range(torque + 1)][-1], point


def _solve(plan: Plan, second_model: SecondModel, torque: int, log_share: float) -> _Solved:
    bench, point = true_bench(plan, torque)
    modes = second_model.modes(replace(bench, pressure=bench.pressure * np.exp(log_share)), _SCANNED)
    bending = modes.frequency > 0.5 * plan.band[0]
    shape = modes.shape_at(point)[:, :, bending].reshape(3 * len(point), -1)
    return _Solved(
        at=log_share,
        log_frequency=np.log(modes.frequency[bending]),
        shape=shape / np.linalg.norm(shape, axis=0),
        seen=visible(modes, point, plan.band)[bending],
    )


def _followed(before: _Solved, after: _Solved) -> _Solved:
    """Return modes in the order of those before that they resemble; those that resemble none are left out."""
    _, one = linear_sum_assignment(-np.abs(before.shape.T @ after.shape))
    return _some(after, one)


def _some(whole: _Solved, which: NDArray[np.intp]) -> _Solved:
    return replace(whole, log_frequency=whole.log_frequency[which], shape=whole.shape[:, which], seen=whole.seen[which])


def _crossings(scan: list[_Solved]) -> Iterator[_Crossing]:
    """Yield where two modes cross that a measurement shows on either side."""
    for before, after in pairwise(scan):
        left = _some(before, np.arange(min(before.log_frequency.size, after.log_frequency.size)))
        right = _followed(left, after)
        gap, then = (one.log_frequency[:, None] - one.log_frequency for one in (left, right))
        seen = left.seen & right.seen
        for a, b in np.argwhere(np.triu(gap * then < 0.0) & seen & seen[:, None]):
            yield _Crossing(left=left, right=right, pair=(int(a), int(b)))


def _met(plan: Plan, second_model: SecondModel, torque: int, crossing: _Crossing, wanted: float) -> float | None:
    """Return the logarithm of the pressure's factor at which two modes have a distance; None where they repel."""
    left, right, pair = crossing.left, crossing.right, crossing.pair
    slope = (right.gap(pair) - left.gap(pair)) / (right.at - left.at)
    at = left.at + (wanted - left.gap(pair)) / slope
    before = left if at - left.at < right.at - at else right
    for step in range(_STEPS):
        if abs(at) > 2.0 * np.log(_SHARES[-1]):
            return None
        one = _followed(before, _solve(plan, second_model, torque, at))
        off = one.gap(pair) - wanted
        if abs(off) < _MEETS:
            return at
        if step and one.at != before.at:
            slope = (one.gap(pair) - before.gap(pair)) / (one.at - before.at)
        at, before = at - off / slope, one
    return None
