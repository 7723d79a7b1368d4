"""Mode shapes from residues, mass-normalised where a driving point allows it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ema.types.geometry import Dofs, driving_points

PHASE_TOLERANCE = np.pi / 4
"""Largest phase of a driving-point modal constant that still counts as positive."""
LEAST_STRENGTH = 3.0
"""Least driving-point modal constant that gives a scale, in standard deviations."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Shapes:
    """Shapes of all modes at the outputs.

    Attributes
    ----------
    shape : (n_output, n_mode) complex
        1/sqrt(kg) for modes that are `scaled`, else of unit largest component.
    std : (n_output, n_mode) float
        Standard deviation of each component's magnitude.
    scaled : (n_mode,) bool
        Which modes have a valid driving point.
    """

    shape: NDArray[np.complex128]
    std: NDArray[np.float64]
    scaled: NDArray[np.bool_]


def shapes_from_residues(
    pole: NDArray[np.complex128],
    residue: NDArray[np.complex128],
    variance: NDArray[np.float64],
    output: Dofs,
    inputs: Dofs,
) -> Shapes:
    """Draw shapes from residues; with a valid driving point they are mass-normalised.

    The residue of a mass-normalised real mode is ``phi_o phi_i / (2 i omega_d)``, so that the modal constant
    ``2 i omega_d A`` of a driving point is ``phi**2``, positive for a passive structure (Ewins, Modal
    Testing, 2nd ed., sec. 2.8). A driving-point constant more than 45 degrees off the positive axis means a
    wrong sign, a wrong point or no signal, and is refused for scaling. Each mode is judged by itself: a driving
    point near a nodal line of one mode leaves the others their scale.

    Parameters
    ----------
    pole : (n_mode,) complex
        Poles, rad/s.
    residue : (n_output, n_input, n_mode) complex
        Residues of the receptance, m/(N s).
    variance : (n_output, n_input, n_mode) float
        Variance of each residue's component along its own phase.
    output, inputs : Dofs
        Where responses and forces are.
    """
    n_output, _, n_mode = residue.shape
    shape = np.zeros((n_output, n_mode), dtype=complex)
    std = np.zeros((n_output, n_mode))
    scaled = np.zeros(n_mode, dtype=bool)
    pairs = driving_points(output, inputs)
    for r in range(n_mode):
        constant = 2j * pole[r].imag * residue[:, :, r]
        constant_variance = (2.0 * pole[r].imag) ** 2 * variance[:, :, r]
        left, singular, right = np.linalg.svd(constant)
        # The constants are the outer product shape x participation; the right vector weighs the inputs.
        column = left[:, 0] * singular[0]
        column_std = np.sqrt(constant_variance @ np.abs(right[0]) ** 2)
        participation = right[0]
        best, factor = 0.0, 1.0 / column[np.argmax(np.abs(column))]
        for o, i, sign in pairs:
            square = sign * column[o] * participation[i]
            strength = np.abs(square) / (column_std[o] * np.abs(participation[i]) + np.finfo(float).tiny)
            if strength > max(best, LEAST_STRENGTH) and np.abs(np.angle(square)) < PHASE_TOLERANCE:
                # shape_o = sign * shape_i at the point, hence phi_i = sqrt(sign * constant) up to a sign.
                best, factor = strength, participation[i] / np.sqrt(square)
                scaled[r] = True
        shape[:, r] = column * factor
        # The driving-point component enters twice; its relative error is halved by the square root.
        relative = 0.5 / best if scaled[r] else 0.0
        std[:, r] = np.hypot(column_std * np.abs(factor), relative * np.abs(shape[:, r]))
    return Shapes(shape=shape, std=std, scaled=scaled)
