"""Change of observed displacements with the locations of their points, some millimetres from those of the files."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from model import Observation, ReducedSystem, observe

Vector = NDArray[np.float64]

_STEP = 1e-3  # m, over which slopes are taken


def location_slopes(system: ReducedSystem, observation: Observation) -> Vector:
    """Return how observed displacements change as their points move along x and y, (n_dof, 2, n_basis), 1/m.

    A point at an edge moves inwards only.
    """
    half = np.array([system.stack.length, system.stack.width]) / 2.0
    slopes = []
    for axis in (0, 1):
        ends = []
        for step in (-_STEP, _STEP):
            moved = observation.location.copy()
            moved[:, axis] = np.clip(moved[:, axis] + step, -half[axis], half[axis])
            ends.append((moved[:, axis], observe(system, replace(observation, location=moved)).reduced_rows))
        (before, low), (after, high) = ends
        slopes.append((high - low) / (after - before)[:, None])
    return np.stack(slopes, axis=1)
