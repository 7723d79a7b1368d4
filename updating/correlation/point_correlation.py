"""Measured against modelled shapes, point by point: which sensors, or which places, disagree.

Sources: Lieven and Ewins, Spatial correlation of mode shapes: the coordinate modal assurance criterion (COMAC),
Proc. IMAC VI, 1988; Hunt, Application of an enhanced coordinate modal assurance criterion, Proc. IMAC X, 1992
(eCoMAC); Balmès, Structural Dynamics Toolbox, ii_mac (S-CoMAC).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ema.types.arrays import readonly
from updating.correlation.correlation import MeasuredModes
from updating.correlation.pairing import ModeSet, Pairing
from updating.correlation.subspace import rotate_onto
from updating.errors import PairingError


@dataclass(frozen=True, eq=False, kw_only=True)
class PointCorrelation:
    """Shapes of paired modes compared at each DOF.

    Attributes
    ----------
    node : (n_dof,) int
        Point number of each DOF.
    direction : (n_dof, 3) float
        Its direction.
    comac : (n_dof,) float
        Coordinate MAC over all pairs, with magnitudes of shapes of unit length: 1 where they agree. It cannot see
        signs, nor the scale of a sensor.
    s_comac : (n_dof,) float
        Scale CoMAC: as `comac`, with the model's shapes brought to the scale and phase of the measured ones by the
        modal scale factor, and with the sign of each mode. It sees signs that differ from mode to mode.
    e_comac : (n_dof,) float
        Enhanced CoMAC: half the mean absolute difference of shapes of unit length, so 0 where they agree. It
        sees a sensor of wrong sign or scale, and tells most where modes move most.
    scale : (n_pair,) complex
        Modal scale factor from each model shape to its measured one. Where both are mass-normalised, its
        magnitude is 1 if the modal masses agree.
    difference : (n_dof, n_pair) complex
        Measured less scaled model shape, over the measured shape's root mean square.
    difference_std : (n_dof, n_pair) float
        Standard deviation of `difference` that the measurement's noise causes.
    """

    node: NDArray[np.int64]
    direction: NDArray[np.float64]
    comac: NDArray[np.float64]
    s_comac: NDArray[np.float64]
    e_comac: NDArray[np.float64]
    scale: NDArray[np.complex128]
    difference: NDArray[np.complex128]
    difference_std: NDArray[np.float64]

    def __post_init__(self) -> None:
        n_dof, n_pair = np.shape(self.difference)
        expected: dict[str, tuple[tuple[int, ...], type]] = {
            "node": ((n_dof,), int),
            "direction": ((n_dof, 3), float),
            "comac": ((n_dof,), float),
            "s_comac": ((n_dof,), float),
            "e_comac": ((n_dof,), float),
            "scale": ((n_pair,), complex),
            "difference": ((n_dof, n_pair), complex),
            "difference_std": ((n_dof, n_pair), float),
        }
        for name, (shape, dtype) in expected.items():
            array = readonly("PointCorrelation", name, getattr(self, name), shape, dtype)
            object.__setattr__(self, name, array)

    @property
    def error(self) -> NDArray[np.float64]:
        """Root mean square of `difference` over all pairs, (n_dof,)."""
        return np.sqrt(np.mean(np.abs(self.difference) ** 2, axis=1))

    @property
    def error_std(self) -> NDArray[np.float64]:
        """What `error` would be from the measurement's noise alone, (n_dof,)."""
        return np.sqrt(np.mean(self.difference_std**2, axis=1))


def correlate_points(measured: MeasuredModes, model: ModeSet, pairing: Pairing) -> PointCorrelation:
    """Compare the shapes of paired modes DOF by DOF.

    Pairs that belong together only as a subspace are compared after turning the model's shapes within it.

    Parameters
    ----------
    measured : MeasuredModes
        Identified modes.
    model : ModeSet
        Modes of the model on the same DOFs.
    pairing : Pairing
        Of the two.

    Raises
    ------
    PairingError
        No modes are paired.
    """
    if pairing.measured.size == 0:
        message = f"no modes are paired at a MAC of {pairing.threshold:g}, so there are no shapes to compare"
        raise PairingError(message)
    shape = np.asarray(measured.shape[:, pairing.measured], dtype=complex)
    other = np.array(model.shape[:, pairing.model], dtype=complex)
    for number in np.unique(pairing.subspace):
        inside = pairing.subspace == number
        if np.count_nonzero(inside) > 1:
            other[:, inside] = rotate_onto(other[:, inside], shape[:, inside])
    scale = np.sum(other.conj() * shape, axis=0) / np.sum(np.abs(other) ** 2, axis=0)
    length = np.linalg.norm(shape, axis=0)
    scaled = other * scale
    phase = scale / np.abs(scale)
    unit, unit_other = shape / length, other * phase / np.linalg.norm(other, axis=0)
    rms = length / np.sqrt(shape.shape[0])
    return PointCorrelation(
        node=measured.node,
        direction=measured.direction,
        comac=_comac(np.abs(unit), np.abs(unit_other)),
        s_comac=_comac(unit, scaled / length),
        e_comac=np.sum(np.abs(unit - unit_other), axis=1) / (2.0 * length.size),
        scale=scale,
        difference=(shape - scaled) / rms,
        difference_std=measured.shape_std[:, pairing.measured] / rms,
    )


def _comac(a: NDArray[np.inexact], b: NDArray[np.inexact]) -> NDArray[np.float64]:
    """Return the correlation of two sets of shapes over the modes at each DOF; 1 where both vanish."""
    cross = np.abs(np.sum(a * b.conj(), axis=1)) ** 2
    product = np.sum(np.abs(a) ** 2, axis=1) * np.sum(np.abs(b) ** 2, axis=1)
    return np.divide(cross, product, out=np.ones_like(cross), where=product > 0.0)
