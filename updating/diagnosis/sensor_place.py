"""What it does to measured shapes that their points are some millimetres from where the files have them.

A point that is off is off for all modes and in all configurations alike: 1 mm is some per cent of a shape that changes
along the stack, and it is the same millimetre in each. So the errors of places are no noise of single components, but
few numbers that all shapes share.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from model import Modes, Observation, ReducedSystem, observe
from updating.correlation.subspace import CLOSE

Vector = NDArray[np.float64]

USUAL = 1e-3
"""Usual error of a place, m: a point marked with a ruler."""
_STEP = 1e-3  # m, over which slopes are taken
_TRIED = np.array([0.03, 0.1, 0.2, 0.4, 0.7, 1.0, 1.5, 2.5, 4.0])  # errors of places, over the usual
_SPREAD = np.log(3.0)  # standard deviation of the logarithm of the error of places
_FAR = 3.0  # of its expected square, from which a shape scatters more than all others
_ALIKE = 1e-2  # of the largest singular value of close shapes, below which they look alike at the points
_SCATTER = np.array([1e-3, 2e-3, 5e-3, 1e-2, 2e-2, 5e-2, 0.1])  # of a shape, beside it: calibration


def place_slopes(system: ReducedSystem, observation: Observation) -> Vector:
    """Return how observed displacements change as their points move along x and y, (n_dof, 2, n_basis), 1/m.

    A point at an edge moves inwards only.
    """
    half = np.array([system.stack.length, system.stack.width]) / 2.0
    found = []
    for axis in (0, 1):
        ends = []
        for step in (-_STEP, _STEP):
            moved = observation.location.copy()
            moved[:, axis] = np.clip(moved[:, axis] + step, -half[axis], half[axis])
            ends.append((moved[:, axis], observe(system, replace(observation, location=moved)).reduced_rows))
        (before, low), (after, high) = ends
        found.append((high - low) / (after - before)[:, None])
    return np.stack(found, axis=1)


def motion(modes: Modes, measured: Vector, shape: Vector, column: NDArray[np.int64]) -> Vector:
    """Return the motion in which measured shapes were measured, as coordinates of the basis, (n_basis, n_measured).

    It is that of their modes of the model, and where others are close, of the mixture of these that comes nearest: how
    a point's reading changes as it moves is a matter of what was measured, and close modes mix otherwise there.

    Parameters
    ----------
    modes : Modes
        Of the model.
    measured : (n_dof, n_measured)
        Measured shapes.
    shape : (n_dof, n_mode)
        Those of the model as the sensors see them.
    column : (n_measured,) int
        The modes of the model that they are.
    """
    found = []
    for u, m in zip(measured.T, column, strict=True):
        close = np.abs(np.log(modes.frequency / modes.frequency[m])) < CLOSE
        share = la.lstsq(shape[:, close], u, cond=_ALIKE)[0]
        found.append(modes.coordinate[:, close] @ share)
    return np.column_stack(found)


@dataclass(frozen=True, eq=False, kw_only=True)
class Seen:
    """A measured shape as it shows errors that no mode of the model explains.

    Attributes
    ----------
    shape : (n_dof,) float
        At unit length.
    slope : (n_dof, n_place) float
        Change by the errors of places, which all shapes share, 1/m.
    std : (n_dof,) float
        Standard deviations of its components.
    reached : (n_dof, n_reached) float
        Directions that modes can reach, orthonormal.
    """

    shape: Vector
    slope: Vector
    std: Vector
    reached: Vector

    @cached_property
    def free(self) -> Vector:
        """Directions that no mode reaches, (n_dof, n_free), orthonormal."""
        return np.asarray(la.null_space(self.reached.T))

    def scatter(self, place: float, common: float) -> float:
        """Return what scatters the shape, over its length, beside its noise and an error of places, m.

        That is what scatters all shapes, `common`, but where a shape shows far more: its mode was identified badly.
        """
        shown = float(np.sum((self.free.T @ self.shape) ** 2))
        noise = np.sum((self.free * self.std[:, None]) ** 2) + np.sum((place * self.free.T @ self.slope) ** 2)
        share = self.free.shape[1] / len(self.shape)
        expected = float(noise) + common**2 * share
        return common if shown < _FAR * expected else float(np.sqrt((shown - float(noise)) / share))


def error_of_places(seen: Sequence[Seen], stated: float | None = None) -> tuple[float, float]:
    """Return the error of places, m, and what else scatters shapes, over their length, as measured shapes show them.

    Of both sizes those of the largest posterior probability are taken, the prior of the first log-normal about what is
    usual.

    Parameters
    ----------
    seen : sequence of Seen
        Of all modes and configurations.
    stated : float, optional
        The error of places that a laboratory states, m.
    """
    value = np.concatenate([own.free.T @ own.shape for own in seen])
    by_place = np.vstack([own.free.T @ own.slope for own in seen])
    noise = la.block_diag(*((own.free.T * own.std**2) @ own.free for own in seen))
    alike = np.concatenate([np.full(own.free.shape[1], 1.0 / len(own.shape)) for own in seen])
    common = by_place @ by_place.T

    def log_posterior(place: float, scatter: float) -> float:
        covariance = noise + place**2 * common + np.diag(scatter**2 * alike)
        root = la.cholesky(covariance, lower=True)
        white = la.solve_triangular(root, value, lower=True)
        prior = -0.5 * (np.log(place / USUAL) / _SPREAD) ** 2
        return float(prior - 0.5 * white @ white - np.sum(np.log(np.diag(root))))

    places = (USUAL * _TRIED).tolist() if stated is None else [stated]
    place, scatter = max(itertools.product(places, _SCATTER.tolist()), key=lambda own: log_posterior(*own))
    return place, scatter
