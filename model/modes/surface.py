"""Displacement of chosen laminas at the corners of their mesh, for pictures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.elements.mesh import FIELDS
from model.modes.modes import Modes
from model.reduction.reduction import ReducedSystem
from model.stack.arrays import readonly
from model.stack.errors import SolveError


@dataclass(frozen=True, eq=False, kw_only=True)
class Surface:
    """A mode's displacement at the corners of the mesh of some laminas.

    Attributes
    ----------
    location : (n_lamina, n_point, 3) float
        The points at rest, m.
    displacement : (n_lamina, n_point, 3) float
        Their mass-normalised displacement along x, y and z, 1/sqrt(kg).
    element : (n_element, 3 or 4) int
        Points of each element, in order around it.
    edge : (n_edge, 2) int
        Points of the element sides that lie on the outline or on a hole.
    """

    location: NDArray[np.float64]
    displacement: NDArray[np.float64]
    element: NDArray[np.int64]
    edge: NDArray[np.int64]

    def __post_init__(self) -> None:
        for name in ("location", "displacement"):
            array = readonly("Surface", name, getattr(self, name), (None, None, 3))
            object.__setattr__(self, name, array)
        for name, width in (("element", None), ("edge", 2)):
            array = readonly("Surface", name, getattr(self, name), (None, width), int)
            object.__setattr__(self, name, array)


def mode_surface(system: ReducedSystem, modes: Modes, mode: int, *, lamina: Sequence[int]) -> Surface:
    """Sample a mode at the corners of the mesh of some laminas.

    Parameters
    ----------
    system : ReducedSystem
        The reduced stack.
    modes : Modes
        Modes of that system.
    mode : int
        Column of `modes.shape`, from 0.
    lamina : sequence of int
        Laminas to sample, 0 the bottom one; negative ones count from the top.

    Raises
    ------
    SolveError
        There is no such mode or lamina.
    """
    stack, assembly = system.stack, system.assembly
    if not 0 <= mode < modes.frequency.size:
        message = f"mode = {mode}: the modes are numbered from 0 to {modes.frequency.size - 1}"
        raise SolveError(message)
    chosen = np.asarray(lamina, dtype=np.intp)
    if chosen.size == 0 or chosen.min() < -stack.n_lamina or chosen.max() >= stack.n_lamina:
        message = f"lamina = {list(lamina)}: the laminas are numbered from 0 to {stack.n_lamina - 1}"
        raise SolveError(message)
    chosen = chosen % stack.n_lamina
    mesh = assembly.plan.membrane.mesh
    point = mesh.p.T
    coordinate = system.basis @ modes.coordinate[:, mode]
    displacement = np.empty((chosen.size, len(point), 3))
    for axis, field in enumerate(FIELDS):
        over = coordinate[assembly.slices()[field]].reshape(assembly.n_z[field], -1)
        displacement[:, :, axis] = (
            system.phi[field][chosen] @ (assembly.plan.point_rows(field, point) @ over.T).T
        )
    location = np.empty_like(displacement)
    location[:, :, :2] = point
    location[:, :, 2] = stack.lamina_z[chosen, None]
    return Surface(
        location=location,
        displacement=displacement,
        element=mesh.t.T,
        edge=mesh.facets[:, mesh.boundary_facets()].T,
    )
