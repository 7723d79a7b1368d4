"""Parameters of effects in units of their plausible ranges: coordinates in which fits step and priors are flat."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from model import Parameter

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
