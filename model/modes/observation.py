"""Where the model is observed: places and directions, sampled on the nearest lamina."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from model.elements.mesh import FIELDS
from model.reduction.reduced_equations import ReducedEquations
from model.reduction.reduction import ReducedSystem
from model.stack.arrays import readonly
from model.stack.stack import Stack


@dataclass(frozen=True, eq=False, kw_only=True)
class Observation:
    """Degrees of freedom at given places.

    Attributes
    ----------
    node : (n,) int
        Point number of each degree of freedom.
    location : (n, 3) float
        Its place, m, in coordinates with their origin at the centre of the stack: x along the length, y along
        the width, z along the height.
    direction : (n, 3) float
        Its direction, of unit length.

    Raises
    ------
    ValueError
        The shapes differ, or a direction is not of unit length.
    """

    node: NDArray[np.int64]
    location: NDArray[np.float64]
    direction: NDArray[np.float64]

    def __post_init__(self) -> None:
        n = np.size(self.node)
        object.__setattr__(self, "node", readonly("Observation", "node", self.node, (n,), int))
        for name in ("location", "direction"):
            object.__setattr__(self, name, readonly("Observation", name, getattr(self, name), (n, 3)))
        length = np.linalg.norm(self.direction, axis=1)
        if np.any(np.abs(length - 1.0) > 1e-6):
            worst = int(np.argmax(np.abs(length - 1.0)))
            message = (
                f"Observation.direction: expected unit vectors, got length {length[worst]:.6g} "
                f"at index {worst} (node {self.node[worst]})"
            )
            raise ValueError(message)


def sample_points(
    stack: Stack, location: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return where the model is sampled for given places: the nearest point of the nearest lamina mid-plane.

    Parameters
    ----------
    stack : Stack
        The stack.
    location : (n, 3)
        Places, m.

    Returns
    -------
    sampled : (n, 3)
        Points of lamina mid-planes, m.
    distance : (n,)
        Their distances from `location`, m.
    """
    given = readonly("sample_points", "location", location, (None, 3))
    half = np.array([stack.length, stack.width]) / 2.0
    plan = np.clip(given[:, :2], -half, half)
    sampled = np.column_stack([plan, stack.lamina_z[nearest_lamina(stack, given[:, 2])]])
    return sampled, np.linalg.norm(sampled - given, axis=1)


def nearest_lamina(stack: Stack, z: NDArray[np.float64]) -> NDArray[np.intp]:
    """Return the index of the lamina whose mid-plane is nearest to each height z, (n,) m."""
    return np.abs(np.asarray(z)[:, None] - stack.lamina_z).argmin(axis=1)


@dataclass(frozen=True, eq=False, kw_only=True)
class Observed:
    """An observation tied to a system: what repeated solves of that system need of it.

    Attributes
    ----------
    node : (n,) int
        Point numbers.
    direction : (n, 3) float
        Directions.
    rows : (n, assembly.size) sparse
        From z-reduced coordinates to the observed displacements.
    reduced_rows : (n, system.size) float
        From reduced coordinates to the observed displacements.
    """

    node: NDArray[np.int64]
    direction: NDArray[np.float64]
    rows: sp.csr_matrix
    reduced_rows: NDArray[np.float64]


def observe(system: ReducedEquations, observation: Observation | Observed) -> Observed:
    """Tie an observation to a system, so that each further solve costs about a millisecond.

    What is tied already comes back as it is.

    Raises
    ------
    TypeError
        An observation that is not tied needs a `ReducedSystem`, which knows what it was reduced from.
    """
    if isinstance(observation, Observed):
        return observation
    if not isinstance(system, ReducedSystem):
        message = "observe: these equations alone know no points; tie the observation to their ReducedSystem"
        raise TypeError(message)
    sampled, _ = sample_points(system.stack, observation.location)
    lamina = nearest_lamina(system.stack, sampled[:, 2])
    parts = [
        sp.diags_array(observation.direction[:, i]) @ system.field_rows(field, lamina, sampled[:, :2])
        for i, field in enumerate(FIELDS)
    ]
    rows = (parts[0] + parts[1] + parts[2]).tocsr()
    return Observed(
        node=observation.node,
        direction=observation.direction,
        rows=rows,
        reduced_rows=np.asarray(rows @ system.basis),
    )
