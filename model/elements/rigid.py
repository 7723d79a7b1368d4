"""Rigid-body motion of a stack in the coordinates of its equations of motion."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from model.elements.equations import Assembly
from model.elements.mesh import Field
from model.stack.stack import Stack


def rigid_body_modes(
    assembly: Assembly, stack: Stack, phi: Mapping[Field, NDArray[np.float64]]
) -> NDArray[np.float64]:
    """Return three translations and three rotations, (assembly.size, 6).

    `phi` holds the through-thickness functions of the assembly's coordinates, (n_lamina, n_z) for each field: the
    identity where they are the laminas themselves.
    """
    plan, where = assembly.plan, assembly.slices()
    one = np.ones(stack.n_lamina)

    def planar(field: Field, function: str) -> NDArray[np.float64]:
        return plan.interpolate(
            field, {"1": (1.0, 0.0, 0.0), "x": (0.0, 1.0, 0.0), "y": (0.0, 0.0, 1.0)}[function]
        )

    modes = np.zeros((assembly.size, 6))

    def add(mode: int, field: Field, over_z: NDArray[np.float64], function: str, sign: float = 1.0) -> None:
        modes[where[field], mode] = sign * np.outer(phi[field].T @ over_z, planar(field, function)).ravel()

    add(0, "u", one, "1")
    add(1, "v", one, "1")
    add(2, "w", one, "1")
    add(3, "v", stack.lamina_z, "1", -1.0)
    add(3, "w", one, "y")
    add(4, "u", stack.lamina_z, "1")
    add(4, "w", one, "x", -1.0)
    add(5, "u", one, "y", -1.0)
    add(5, "v", one, "x")
    return modes
