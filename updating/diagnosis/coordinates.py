"""Parameters of effects in units of their plausible ranges: coordinates in which fits step and priors are flat."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from model import Parameter
from updating.inference.protocol import Coordinate

Vector = NDArray[np.float64]


def scaled(parameter: Parameter, coordinate: float) -> tuple[float, float]:
    """Return a parameter's value at a coordinate in units of its range, 0 at neutral, and its derivative."""
    if parameter.scale == "log":
        span = np.log(parameter.upper / parameter.lower)
        value = parameter.neutral * np.exp(span * coordinate)
        return float(value), float(span * value)
    span = parameter.upper - parameter.lower
    return parameter.neutral + span * coordinate, span


def coordinate_of(parameter: Parameter, value: float) -> float:
    """Return the coordinate, in units of its range, of a parameter's value."""
    if parameter.scale == "log":
        return float(np.log(value / parameter.neutral) / np.log(parameter.upper / parameter.lower))
    return (value - parameter.neutral) / (parameter.upper - parameter.lower)


def bounds_of(parameters: Sequence[Parameter]) -> tuple[Vector, Vector]:
    """Return lower and upper bounds of the coordinates of parameters."""
    return (
        np.array([coordinate_of(p, p.lower) for p in parameters]),
        np.array([coordinate_of(p, p.upper) for p in parameters]),
    )


def free_coordinate(p: Parameter) -> Coordinate:
    """Return the coordinate of an effect's parameter: in units of its range, 0 at neutral, with a wide prior."""
    (low,), (high,) = bounds_of([p])
    if p.n_start:
        starts = tuple(float(low + (i + 0.5) / p.n_start * (high - low)) for i in range(p.n_start))
    else:
        nominal = coordinate_of(p, p.nominal)
        starts = tuple(float(np.clip(share * nominal, low, high)) for share in (0.2, 1.0))
    return Coordinate(
        name=p.name, std=1.0, lower=float(low), upper=float(high), starts=starts, step=0.1, longest=0.4
    )
