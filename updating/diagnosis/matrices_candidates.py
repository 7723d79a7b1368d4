"""What a structure of matrices may lack: local masses and springs, instruments, and terms that are nothing yet."""

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
_USUAL = 0.05
"""Usual strength of a mass or a spring, over its largest."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Candidate:
    """An effect of one parameter, and what it adds to reduced matrices for each unit of that."""

    effect: Effect
    parts: Callable[[ReducedMatrices], Parts]


def candidates_of(
    structure: MatrixStructure, sensors: Callable[[ReducedMatrices], Vectors], n_sensor: int, lowest_Hz: float
) -> dict[str, Candidate]:
    """Return what a structure may lack, by name.

    Parameters
    ----------
    structure : MatrixStructure
        Its points and patches are locations; its terms that are nominally 0 may be missing, too.
    sensors : callable
        Returns the rows of all measured points along x, y and z, (n, size).
    n_sensor : int
        Number of these points.
    lowest_Hz : float
        Lowest measured frequency: of springs those are usual that move it.
    """
    most_sensors = 0.1  # largest mass of all sensors together, of the structure's
    mass = 0.3  # largest mass at one location, of the structure's: more is another structure
    every = structure.matrix("M", structure.theta)
    weight = [float(every[rows][:, rows].sum()) for rows in (structure.dof == i for i in (1, 2, 3))]
    total = max(weight)
    soft, stiff = (total * (2.0 * np.pi * f) ** 2 for f in (lowest_Hz, structure.band_Hz))
    nodes_at: dict[str, tuple[str, Index]] = {}
    for name in structure.points:
        for node in structure.groups[name]:
            nodes_at[f"node_{node}"] = f"node {node}", np.array([node])
    for name in structure.patches:
        nodes_at[name] = "the point of the force" if name == DRIVE else name, structure.groups[name]
    found: dict[str, Candidate] = {}
    for name, (label, node) in nodes_at.items():
        known = np.intersect1d(node, structure.node)
        if not known.size:
            continue
        found[f"mass_at_{name}"] = Candidate(
            effect=_effect(f"mass_at_{name}", f"a mass at {label}", "inertia", _mass(f"mass_at_{name}", mass * total)),
            parts=_acting("M", known, (0, 1, 2)),
        )
        for axis in range(3):
            if not np.any((structure.dof == axis + 1) & np.isin(structure.node, known)):
                continue
            key, along = f"spring_at_{name}_{DIRECTIONS[axis]}", f"along {DIRECTIONS[axis]}"
            what = f"a spring from {label} to the ground {along}"
            effect = _effect(key, what, "boundary", _spring(key, soft, stiff))
            found[key] = Candidate(effect=effect, parts=_acting("K", known, (axis,)))

    def loaded(reduced: ReducedMatrices) -> Parts:
        rows = sensors(reduced)
        return {"M": rows.T @ rows}

    what = "the mass of sensors, the same at every measured point"
    found["sensor_mass"] = Candidate(
        effect=_effect("sensor_mass", what, "inertia", _mass("sensor_mass", most_sensors * total / n_sensor)),
        parts=loaded,
    )
    for one in structure.factors:
        if one.nominal == 0.0:
            largest = one.upper if np.isfinite(one.upper) else one.lower + 5.0 * one.std
            parameter = Parameter(
                name=one.name,
                unit="1",
                nominal=min(one.std, largest),
                lower=0.0,
                upper=largest,
                source="the structure file",
            )
            effect = _effect(one.name, one.name.replace("_", " "), "boundary", parameter)
            found[one.name] = Candidate(effect=effect, parts=_stated(one.name))
    return found


def _effect(name: str, label: str, family: Family, parameter: Parameter) -> Effect:
    """Return an effect of one parameter; what it adds to a stack is nothing."""
    return Effect(
        name=name,
        label=label,
        family=family,
        summary=label,
        description=label,
        parameters=(parameter,),
        terms=lambda _: (),
    )


def _mass(name: str, largest: float) -> Parameter:
    return Parameter(
        name=name, unit="kg", nominal=_USUAL * largest, lower=0.0, upper=largest, source="the mass of the structure"
    )


def _spring(name: str, soft: float, stiff: float) -> Parameter:
    """Return the stiffness of a spring, whose order of magnitude nobody knows: from nothing to what holds a point."""
    # Stiffness that moves no frequency, over that which holds the structure's mass at the lowest measured one.
    nothing = 1e-5
    return Parameter(
        name=name,
        unit="N/m",
        nominal=_USUAL * soft,
        lower=nothing * soft,
        upper=stiff,
        neutral=nothing * soft,
        scale="log",
        sampled=True,
        source="what holds the mass of the structure at the lowest and at the highest frequency",
    )


def _acting(target: Target, node: Index, axes: tuple[int, ...]) -> Callable[[ReducedMatrices], Parts]:
    """Return what a unit, shared out evenly over nodes, adds as these move along some axes."""

    def parts(reduced: ReducedMatrices) -> Parts:
        rows = reduced.moves(node)[:, list(axes)].reshape(-1, reduced.size)
        return {target: rows.T @ rows / node.size}

    return parts


def _stated(name: str) -> Callable[[ReducedMatrices], Parts]:
    """Return what a term of the structure file adds for each unit of its factor."""

    def parts(reduced: ReducedMatrices) -> Parts:
        changes: dict[Target, Vectors] = {}
        for target in ("K", "M", "C"):
            change = reduced.derivative(target, reduced.theta, name)
            if np.any(change):
                changes[target] = change
        return changes

    return parts
