"""Where a few steps from some coordinates lead, at given sizes of the discrepancy: cheap, to choose starts of a fit."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from updating.inference.discrepancy import Sizes
from updating.inference.explain import DAMP, Cost, Setting, coordinates_of, step_within, weighed_at
from updating.inference.protocol import LocalModel, Model, Term

Vector = NDArray[np.float64]


def outlook(
    model: Model, terms: Sequence[Term], setting: Setting, x: Vector, local: LocalModel, sizes: Sizes
) -> tuple[float, Vector]:
    """Return the expected negative cost after one step from some coordinates, and the coordinates there.

    Parameters
    ----------
    model, terms, setting, local, sizes
        As `explain` takes them.
    x : (n_coordinate,)
        Coordinates.

    Raises
    ------
    numpy.linalg.LinAlgError
        The model has no modes there.
    """
    total, slope, hessian = _looked(model, terms, setting, x, local, sizes)
    to = step_within(slope, hessian, x, coordinates_of(model, terms))
    step = to - x
    return -total - float(slope @ step + 0.5 * step @ hessian @ step), to


def descended(
    model: Model,
    terms: Sequence[Term],
    setting: Setting,
    x: Vector,
    local: LocalModel,
    sizes: Sizes,
    *,
    steps: int,
    small: float = 1.0,
) -> tuple[float, Vector]:
    """Return the negative cost to which some damped steps lead, and the coordinates there.

    Parameters
    ----------
    model, terms, setting, x, local, sizes
        As `outlook` takes them.
    steps : int
        Most steps that are tried; one that raises the cost is not taken.
    small : float
        Fall of the cost that ends them.

    Raises
    ------
    numpy.linalg.LinAlgError
        The model has no modes at `x`.
    """
    coordinates = coordinates_of(model, terms)
    (at, slope, hessian), damp = _looked(model, terms, setting, x, local, sizes), DAMP
    for _ in range(steps):
        trial, after = step_within(slope, hessian, x, coordinates, damp=damp), np.inf
        with contextlib.suppress(np.linalg.LinAlgError, ValueError):  # no modes there: step less far
            after, *there = _looked(model, terms, setting, trial, local, sizes)
        if not after < at:
            damp = max(8.0 * damp, 1e-2)
            continue
        fall, at, x, (slope, hessian), damp = at - after, after, trial, there, damp / 5.0
        if fall < small:
            break
    return -at, x


def _looked(
    model: Model, terms: Sequence[Term], setting: Setting, x: Vector, local: LocalModel, sizes: Sizes
) -> tuple[float, Vector, Vector]:
    """Return the cost at some coordinates, its slope and its curvature.

    Far off, the terms by the noise of shapes are as large as the misfit and curved: errors alone are nearly linear.
    """
    precision = np.array([c.std**-2.0 for c in coordinates_of(model, terms)])
    _, problem, white = weighed_at(model, local, setting, x, sizes)
    hessian = white.hessian + np.diag(precision) + problem.curvature
    return Cost(precision, sizes).total(problem, white, x), white.slope + precision * x, hessian
