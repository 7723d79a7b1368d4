"""The modal model: what identification hands to the rest of the program."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ema.arrays import readonly
from ema.geometry import Dofs, Geometry


@dataclass(frozen=True, eq=False, kw_only=True)
class ModalModel:
    """Poles, residues and shapes of one configuration, ascending in frequency.

    The receptance it stands for is, with ``s = i omega``,

        H(s) = sum_r [ A_r / (s - pole_r) + conj(A_r) / (s - conj(pole_r)) ] + lower / s**2 + upper

    Attributes
    ----------
    name : str
        The configuration.
    frequency, damping : (n_mode,) float
        Undamped natural frequency abs(pole) / 2 pi, Hz, and damping ratio -Re(pole) / abs(pole).
    frequency_std, damping_std : (n_mode,) float
        Their standard deviations.
    pole : (n_mode,) complex
        Upper half-plane poles, rad/s.
    residue : (n_output, n_input, n_mode) complex
        Residues of the receptance, m/(N s).
    lower, upper : (n_output, n_input) complex
        Residual terms of the modes below (1/kg) and above (m/N) the band.
    shape : (n_dof, n_mode) complex
        Shapes at the outputs. Mass-normalised (1/sqrt(kg)) where `scaled`, else of unit largest component.
    shape_std : (n_dof, n_mode) float
        Standard deviation of each component's magnitude.
    scaled : bool
        Whether a valid driving point gave the shapes their mass-normalised scale.
    node : (n_dof,) int
        Point number of each shape component.
    direction : (n_dof, 3) float
        Measured direction of each shape component.
    input : Dofs
        Force DOFs.
    band : (float, float)
        Frequency band that was identified, Hz.
    geometry : Geometry
        The measured points.
    """

    name: str
    frequency: NDArray[np.float64]
    damping: NDArray[np.float64]
    frequency_std: NDArray[np.float64]
    damping_std: NDArray[np.float64]
    pole: NDArray[np.complex128]
    residue: NDArray[np.complex128]
    lower: NDArray[np.complex128]
    upper: NDArray[np.complex128]
    shape: NDArray[np.complex128]
    shape_std: NDArray[np.float64]
    scaled: bool
    node: NDArray[np.int64]
    direction: NDArray[np.float64]
    input: Dofs
    band: tuple[float, float]
    geometry: Geometry

    def __post_init__(self) -> None:
        n_mode, n_dof = np.size(self.frequency), np.size(self.node)
        n_input = self.input.node.size
        expected: dict[str, tuple[tuple[int, ...], type]] = {
            "frequency": ((n_mode,), float),
            "damping": ((n_mode,), float),
            "frequency_std": ((n_mode,), float),
            "damping_std": ((n_mode,), float),
            "pole": ((n_mode,), complex),
            "residue": ((n_dof, n_input, n_mode), complex),
            "lower": ((n_dof, n_input), complex),
            "upper": ((n_dof, n_input), complex),
            "shape": ((n_dof, n_mode), complex),
            "shape_std": ((n_dof, n_mode), float),
            "node": ((n_dof,), int),
            "direction": ((n_dof, 3), float),
        }
        for name, (shape, dtype) in expected.items():
            object.__setattr__(self, name, readonly("ModalModel", name, getattr(self, name), shape, dtype))
