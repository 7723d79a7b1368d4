"""Measured points placed on the model: where each is sampled, and how far that is from where it was measured."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ema.types.arrays import readonly
from ema.types.geometry import Geometry
from model import Observation, Stack, sample_points
from updating.errors import PairingError


@dataclass(frozen=True, eq=False, kw_only=True)
class Registration:
    """Measured DOFs on the model.

    Attributes
    ----------
    observation : Observation
        The DOFs, in the order in which they were asked for, at the places where the model is sampled.
    distance : (n_dof,) float
        Distance from each measured point to the place where the model is sampled, m.
    """

    observation: Observation
    distance: NDArray[np.float64]

    def __post_init__(self) -> None:
        distance = readonly("Registration", "distance", self.distance, (self.observation.node.size,))
        object.__setattr__(self, "distance", distance)


def register(
    stack: Stack,
    geometry: Geometry,
    node: NDArray[np.int64],
    direction: NDArray[np.float64],
    *,
    tolerance: float = 0.01,
) -> Registration:
    """Place measured DOFs on the stack.

    The points and the stack share one coordinate system: origin in the centre of the stack, x along its
    length, y along its width, z in stacking direction. Each point goes to the nearest place of the nearest lamina.

    Parameters
    ----------
    stack : Stack
        The model's stack.
    geometry : Geometry
        Measured points.
    node, direction : (n_dof,), (n_dof, 3)
        Measured DOFs.
    tolerance : float
        Largest accepted distance, m. An accelerometer's base is some millimetres above the sheet edge.

    Raises
    ------
    PairingError
        A DOF's point has no coordinates, or lies farther from the stack than `tolerance`.
    """
    row = {int(n): i for i, n in enumerate(geometry.node)}
    unknown = sorted({int(n) for n in node} - set(row))
    if unknown:
        message = (
            f"points {unknown} were measured but have no coordinates; "
            f"the geometry has points {_span(geometry.node)}. Add them to the points file."
        )
        raise PairingError(message)
    location = geometry.coordinate[[row[int(n)] for n in node]]
    sampled, distance = sample_points(stack, location)
    if np.any(distance > tolerance):
        far = np.flatnonzero(distance > tolerance)
        worst = far[np.argmax(distance[far])]
        message = (
            f"{far.size} of {node.size} measured points lie more than {1e3 * tolerance:.0f} mm from the stack "
            f"{stack.name!r}; the farthest is point {int(node[worst])} at "
            f"({', '.join(f'{1e3 * c:.1f}' for c in location[worst])}) mm, {1e3 * distance[worst]:.1f} mm away. "
            f"The stack spans ±{500 * stack.length:.1f} x ±{500 * stack.width:.1f} x ±{500 * stack.height:.1f} mm "
            "about its centre: check the unit and the origin of the points file."
        )
        raise PairingError(message)
    return Registration(
        observation=Observation(node=node, location=sampled, direction=direction), distance=distance
    )


def _span(node: NDArray[np.int64]) -> str:
    return "none" if node.size == 0 else f"{node.min()} to {node.max()}"
