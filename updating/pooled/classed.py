"""Modes that are known by the classes of their shapes, as an identification gives them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ema.types.geometry import Dof, Dofs, Geometry
from ema.types.modal_model import ModalModel
from model import ReducedSystem, Stack, observe, reduce
from updating.correlation.criteria import N_ROW, N_STATION, class_grid, solve_by_class
from updating.diagnosis.candidates import G_F_RANGE, N_SNAPSHOT
from updating.errors import FitError
from updating.pooled.groups import ALIKE
from updating.pooled.modal_files import assembled
from updating.results.store import digest

Vector = NDArray[np.float64]

CLASS_STD = 0.1
"""Standard deviation of each modal coordinate of a shape that stands for a class: a mode of a class resembles the
model's, MAC 0.9 with some ten modes that it may be mixed with, and what it is mixed with is not known."""
_UP = Dof(0, (0.0, 0.0, 1.0))


class Classes:
    """Models of stacks that show what modes of a class look like: one for all that are nearly as high."""

    def __init__(self) -> None:
        self._known: dict[str, ReducedSystem] = {}

    def _of(self, stack: Stack) -> ReducedSystem:
        """Return the model of a stack, or of one that is nearly as high and otherwise the same."""
        step = round(np.log(stack.height / stack.width) / np.log1p(ALIKE))
        key = digest({"stack": replace(stack, name="", height=stack.width), "step": step})
        if key not in self._known:
            self._known[key] = reduce(stack, G_f_range=G_F_RANGE, n_snapshot=N_SNAPSHOT)
        return self._known[key]

    def modes(self, name: str, stack: Stack, wanted: tuple[str, ...], poles: Vector) -> ModalModel:
        """Return modes that are named by class: the model's shapes of these classes stand for theirs.

        Parameters
        ----------
        name : str
            The configuration.
        stack : Stack
            What was tested.
        wanted : tuple of str
            Class of each mode, such as "torsion 1".
        poles : (4, n_mode)
            Frequencies, their standard deviations, Hz, damping ratios and theirs.

        Raises
        ------
        FitError
            The model has no mode of a class.
        """
        station_step = 4  # One in so many stations along the length, enough to distinguish classes.
        grid = class_grid(stack)
        system = self._of(stack)
        modes, column = solve_by_class(system, observe(system, grid), wanted, G_f=stack.contact.G_f)
        if np.any(column < 0):
            absent = ", ".join(c for c, k in zip(wanted, column, strict=True) if k < 0)
            raise FitError(f"{name}: the model of {stack.name} has no mode of class {absent}")
        upwards = np.arange(N_STATION * N_ROW).reshape(N_STATION, N_ROW)[::station_step].ravel()
        node, n = grid.node[upwards], upwards.size
        shape = modes.shape[np.ix_(upwards, column)]
        shape = shape / np.abs(shape).max(axis=0)
        geometry = Geometry(node=node, coordinate=grid.location[upwards], line=np.empty((0, 2), dtype=int))
        return assembled(
            name,
            poles,
            (shape, CLASS_STD * np.linalg.norm(shape, axis=0) * np.ones_like(shape)),
            geometry=geometry,
            dofs=Dofs(node=node, direction=grid.direction[upwards]),
            sensor=np.zeros(n, dtype=np.int64),
            force=_UP,
        )
