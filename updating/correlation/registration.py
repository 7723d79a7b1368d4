"""Measured points in the model: their places in its frame, and measured shapes expanded to all its points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
from numpy.typing import ArrayLike

from ema.types.frf import Geometry
from lamella_shared import Booleans, Complexes, Integers, Reals, arrays
from model import Modes, Observation, Stack, sample_points
from updating.errors import PairingError


@dataclass(frozen=True, eq=False, kw_only=True)
@arrays({"observation.node": "distance"})
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
    distance: Reals


def register(
    stack: Stack, geometry: Geometry, node: Integers, direction: Reals, *, tolerance: float = 0.01
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
        raise PairingError(
            f"points {unknown} were measured but have no coordinates; "
            f"the geometry has points {_span(geometry.node)}. Add them to the points file."
        )
    location = geometry.coordinate[[row[int(n)] for n in node]]
    sampled, distance = sample_points(stack, location)
    if np.any(distance > tolerance):
        far = np.flatnonzero(distance > tolerance)
        worst = far[np.argmax(distance[far])]
        raise PairingError(
            f"{far.size} of {node.size} measured points lie more than {1e3 * tolerance:.0f} mm from the stack "
            f"{stack.name!r}; the farthest is point {int(node[worst])} at "
            f"({', '.join(f'{1e3 * c:.1f}' for c in location[worst])}) mm, {1e3 * distance[worst]:.1f} mm away. "
            f"The stack spans ±{500 * stack.length:.1f} x ±{500 * stack.width:.1f} x ±{500 * stack.height:.1f} mm "
            "about its centre: check the unit and the origin of the points file."
        )
    return Registration(observation=Observation(node=node, location=sampled, direction=direction), distance=distance)


def _span(node: Integers) -> str:
    return "none" if node.size == 0 else f"{node.min()} to {node.max()}"


@dataclass(frozen=True, eq=False, kw_only=True)
@arrays({"model measured": "amplitude amplitude_std", "any measured": "coordinate", "measured": "matched"})
class Expansion:
    """Measured shapes in the modes of the model.

    Attributes
    ----------
    amplitude : (n_model, n_measured) complex
        Modal amplitude of each mode of the model in each measured shape; 0 for modes that do not move the
        measured DOFs.
    amplitude_std : (n_model, n_measured) float
        Their standard deviations from those of the measured shapes.
    coordinate : (n_basis, n_measured) complex
        The shapes in the coordinates of the reduced system.
    matched : (n_measured,) float
        MAC of each measured shape with its expansion at the measured points: what the modes cannot form is lost.
    condition : float
        Condition number of the model's shapes at the measured points, each brought to unit length: the most by
        which measurement errors grow in the amplitudes.
    """

    amplitude: Complexes
    amplitude_std: Reals
    coordinate: Complexes
    matched: Reals
    condition: float


def expand(shape: ArrayLike, shape_std: ArrayLike, modes: Modes) -> Expansion:
    """Expand measured shapes over the whole model by SEREP.

    Few modes filter noise, many can form more: a dozen elastic modes that reach somewhat above the measured band
    are a fair choice for 44 points.

    Parameters
    ----------
    shape : (n_dof, n_measured) array_like
        Measured shapes.
    shape_std : (n_dof, n_measured) array_like
        Standard deviations of their components.
    modes : Modes
        Modes of the model at the same DOFs.

    Raises
    ------
    PairingError
        The measured points cannot tell the model's modes apart: fewer DOFs than modes, or shapes that look alike.
    """
    measured = np.asarray(shape, dtype=complex)
    inverse, condition = _pseudo_inverse(modes.shape)
    if not np.isfinite(condition):
        n_dof, n_mode = modes.shape.shape
        raise PairingError(
            f"{n_dof} measured DOFs cannot tell {n_mode} modes of the model apart; take fewer modes, "
            "such as those up to the end of the measured band"
        )
    amplitude = inverse @ measured
    rebuilt = modes.shape @ amplitude
    square = np.sum(np.abs(measured) ** 2, axis=0)
    return Expansion(
        amplitude=amplitude,
        amplitude_std=np.sqrt(inverse**2 @ np.asarray(shape_std, dtype=float) ** 2),
        coordinate=modes.coordinate @ amplitude,
        matched=np.sum(np.abs(rebuilt) ** 2, axis=0) / square,
        condition=condition,
    )


def pseudo_orthogonality(measured: ArrayLike, model: ArrayLike) -> tuple[Reals, float]:
    """Cross-orthogonality of measured shapes with the model's modes in the SEREP-reduced mass.

    Parameters
    ----------
    measured : (n_dof, n_measured) array_like
        Measured shapes, of any scale.
    model : (n_dof, n_model) array_like
        Mass-normalised modes of the model at the same DOFs.

    Returns
    -------
    cross : (n_measured, n_model) float
        1 for the same mode, 0 for different ones; each row's squares sum to 1. Modes that do not move the
        measured points have 0.
    condition : float
        Condition number of the model's shapes: above about 20 the points hardly tell the modes apart, and it is
        infinite where there are fewer DOFs than modes.
    """
    inverse, condition = _pseudo_inverse(np.asarray(model, dtype=float))
    amplitude = np.abs(inverse @ np.asarray(measured))
    return (amplitude / np.linalg.norm(amplitude, axis=0)).T, condition


def visible(shape: ArrayLike) -> Booleans:
    """Tell which modes move the measured DOFs, (n_mode,): some do not, such as in-plane ones seen from above."""
    invisible = 1e-4  # of the largest motion at the measured DOFs: below it a mode is not seen there
    length = np.linalg.norm(np.asarray(shape), axis=0)
    return np.asarray(length > invisible * length.max(initial=0.0))


def _pseudo_inverse(shape: Reals) -> tuple[Reals, float]:
    """Return the pseudo-inverse of the visible shapes, 0 for others, and the condition of their directions."""
    singular = 1e6  # condition number from which rounding and the model's own error rule the amplitudes
    seen = visible(shape)
    length = np.linalg.norm(shape[:, seen], axis=0)
    inverse = np.zeros((shape.shape[1], shape.shape[0]))
    inverse[seen] = la.pinv(shape[:, seen] / length) / length[:, None]
    value = la.svdvals(shape[:, seen] / length)
    independent = length.size <= shape.shape[0] and value[-1] > value[0] / singular
    return inverse, float(value[0] / value[-1]) if independent else float("inf")
