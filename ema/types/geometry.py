"""Measured points, the trace lines between them, and the degrees of freedom (DOFs) at them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lamella_shared import arrays, readonly


@dataclass(frozen=True, eq=False, kw_only=True)
class Geometry:
    """Points of a test structure in the global coordinate system.

    Attributes
    ----------
    node : (n_node,) int
        Point numbers, unique.
    coordinate : (n_node, 3) float
        Position of each point, m.
    line : (n_line, 2) int
        Point numbers joined by trace lines for drawing; may be empty.
    axes : (n_node, 3, 3) float
        Rows: the local x, y and z axis of each point in global coordinates, in which its directions
        were measured. Given empty, every point has the global axes.
    """

    node: NDArray[np.int64]
    coordinate: NDArray[np.float64]
    line: NDArray[np.int64]
    axes: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 3, 3)))

    def __post_init__(self) -> None:
        node = readonly("Geometry", "node", self.node, (None,), np.int64)
        object.__setattr__(self, "node", node)
        object.__setattr__(self, "coordinate", readonly("Geometry", "coordinate", self.coordinate, (node.size, 3)))
        object.__setattr__(self, "line", readonly("Geometry", "line", self.line, (None, 2), np.int64))
        axes = self.axes if np.size(self.axes) else np.broadcast_to(np.eye(3), (node.size, 3, 3))
        object.__setattr__(self, "axes", readonly("Geometry", "axes", axes, (node.size, 3, 3)))
        if np.unique(node).size != node.size:
            repeated = sorted({int(n) for n in node if np.count_nonzero(node == n) > 1})
            raise ValueError(f"Geometry.node: point numbers must be unique, repeated: {repeated}")

    def direction(self, node: int, code: int) -> tuple[float, float, float]:
        """Return the global unit vector of a signed local direction: 1, 2, 3 for +x, +y, +z, negative for -.

        A point that the geometry does not hold (a reference often is not there) has the global axes.
        """
        known = np.flatnonzero(self.node == node)
        axes = self.axes[known[0]] if known.size else np.eye(3)
        x, y, z = np.sign(code) * axes[abs(code) - 1]
        return float(x), float(y), float(z)


class Dof(NamedTuple):
    """One degree of freedom: a point number and a unit vector in global coordinates, sign included."""

    node: int
    direction: tuple[float, float, float]


@dataclass(frozen=True, eq=False, kw_only=True)
@arrays({"any": "node", "node 3": "direction"})
class Dofs:
    """Degrees of freedom: a point number and a signed direction each.

    Attributes
    ----------
    node : (n_dof,) int
        Point number of each DOF; it may be absent from the geometry (a reference often is).
    direction : (n_dof, 3) float
        Unit vector of the measured direction in global coordinates, sign included.
    """

    node: NDArray[np.int64]
    direction: NDArray[np.float64]

    def name(self, index: int) -> str:
        """Return a DOF as a campaign file writes it, ``12+z``, or its point and direction off the axes."""
        direction = self.direction[index]
        axis = int(np.argmax(np.abs(direction)))
        if abs(direction[axis]) < 0.999:
            return f"{self.node[index]} along {np.round(direction, 3).tolist()}"
        return f"{self.node[index]}{'+' if direction[axis] > 0 else '-'}{'xyz'[axis]}"


def driving_points(output: Dofs, inputs: Dofs) -> list[tuple[int, int, float]]:
    """Find outputs and inputs at one point along one line, with the product of their directions' signs."""
    pairs: list[tuple[int, int, float]] = []
    for i, (node, direction) in enumerate(zip(inputs.node, inputs.direction, strict=True)):
        for o in np.flatnonzero(output.node == node):
            cosine = float(output.direction[o] @ direction)
            if abs(cosine) > 0.999:
                pairs.append((int(o), i, float(np.sign(cosine))))
    return pairs
