"""What a structure of matrices may lack: masses and springs at places, instruments, and terms that are nothing yet."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model import Effect, MatrixStructure, Parameter, ReducedMatrices
from model.matrices.labelled import DIRECTIONS, Index
from model.matrices.readers import Target
from model.stack.effect import Family

Vectors = NDArray[np.float64]
Parts = Mapping[Target, Vectors]

DRIVE = "drive_point"
"""Group of the nodes where the force acts."""
_MASS = 0.3
"""Largest mass at a place, of the structure's: more is another structure."""
_USUAL = 0.05
"""Usual strength of a mass or a spring, over its largest."""
_SENSORS = 0.1  # largest mass of all sensors together, of the structure's


@dataclass(frozen=True, eq=False, kw_only=True)
class Candidate:
    """An effect of one parameter, and what it adds to reduced matrices for each unit of that."""

    effect: Effect
    parts: Callable[[ReducedMatrices], Parts]


def candidates_of(
    structure: MatrixStructure, sensors: Callable[[ReducedMatrices], Vectors], n_sensor: int
) -> dict[str, Candidate]:
    """Return what a structure may lack, by name.

    Parameters
    ----------
    structure : MatrixStructure
        Its points and patches are places; its terms that are nominally 0 may be missing, too.
    sensors : callable
        Returns the rows of all measured points along x, y and z, (n, size).
    n_sensor : int
        Number of these points.
    """
    every = structure.matrix("M", structure.theta)
    weight = [float(every[rows][:, rows].sum()) for rows in (structure.dof == i for i in (1, 2, 3))]
    total = max(weight)
    stiffest = total * (2.0 * np.pi * structure.band_Hz) ** 2
    places: dict[str, tuple[str, Index]] = {}
    for name in structure.points:
        for node in structure.groups[name]:
            places[f"node_{node}"] = f"node {node}", np.array([node])
    for name in structure.patches:
        places[name] = "the point of the force" if name == DRIVE else name, structure.groups[name]
    found: dict[str, Candidate] = {}
    for name, (label, node) in places.items():
        own = np.intersect1d(node, structure.node)
        if not own.size:
            continue
        found[f"mass_at_{name}"] = Candidate(
            effect=_effect(f"mass_at_{name}", f"a mass at {label}", "inertia", "kg", _MASS * total),
            parts=_acting("M", own, (0, 1, 2)),
        )
        for axis in range(3):
            if not np.any((structure.dof == axis + 1) & np.isin(structure.node, own)):
                continue
            key, along = f"spring_at_{name}_{DIRECTIONS[axis]}", f"along {DIRECTIONS[axis]}"
            what = f"a spring from {label} to the ground {along}"
            found[key] = Candidate(
                effect=_effect(key, what, "boundary", "N/m", stiffest), parts=_acting("K", own, (axis,))
            )

    def loaded(reduced: ReducedMatrices) -> Parts:
        rows = sensors(reduced)
        return {"M": rows.T @ rows}

    what = "the mass of sensors, the same at every measured point"
    found["sensor_mass"] = Candidate(
        effect=_effect("sensor_mass", what, "inertia", "kg", _SENSORS * total / n_sensor), parts=loaded
    )
    for one in structure.factors:
        if one.nominal == 0.0:
            largest = one.upper if np.isfinite(one.upper) else one.lower + 5.0 * one.std
            found[one.name] = Candidate(
                effect=_effect(one.name, one.name.replace("_", " "), "boundary", "1", largest, one.std),
                parts=_stated(one.name),
            )
    return found


def _effect(
    name: str, label: str, family: Family, unit: str, largest: float, usual: float | None = None
) -> Effect:
    """Return an effect of one parameter from 0 to a largest strength; what it adds to a stack is nothing."""
    parameter = Parameter(
        name=name,
        unit=unit,
        nominal=_USUAL * largest if usual is None else min(usual, largest),
        lower=0.0,
        upper=largest,
        source="mass and stiffness of the structure" if usual is None else "the structure file",
    )
    return Effect(
        name=name, label=label, family=family, summary=label, description=label, parameters=(parameter,),
        terms=lambda _: (),
    )  # fmt: skip


def _acting(target: Target, node: Index, axes: tuple[int, ...]) -> Callable[[ReducedMatrices], Parts]:
    """Return what a unit, shared out evenly over nodes, adds as these move along some axes."""

    def parts(reduced: ReducedMatrices) -> Parts:
        rows = reduced.moves(node)[:, list(axes)].reshape(-1, reduced.size)
        return {target: rows.T @ rows / node.size}

    return parts


def _stated(name: str) -> Callable[[ReducedMatrices], Parts]:
    """Return what a term of the structure file adds for each unit of its factor."""

    def parts(reduced: ReducedMatrices) -> Parts:
        own: dict[Target, Vectors] = {}
        for target in ("K", "M", "C"):
            change = reduced.derivative(target, reduced.theta, name)
            if np.any(change):
                own[target] = change
        return own

    return parts
