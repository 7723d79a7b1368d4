"""Measurement and model side by side: modes, points and functions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ema.modal.mac import frac
from lamella_shared import Complexes, Integers, Reals, arrays
from updating.correlation.pairing import ModeSet, Pairing
from updating.errors import PairingError, UpdatingError


class MeasuredModes(ModeSet, Protocol):
    """Modes with the standard deviations that an identification gives them."""

    @property
    def frequency_std(self) -> Reals:
        """Standard deviations of the natural frequencies (n_mode,), Hz."""

    @property
    def damping_std(self) -> Reals:
        """Standard deviations of the damping ratios (n_mode,)."""

    @property
    def shape_std(self) -> Reals:
        """Standard deviations of the shape components (n_dof, n_mode)."""


@dataclass(frozen=True, eq=False, kw_only=True)
@arrays(
    {
        "n": "measured_frequency model_frequency frequency_error frequency_error_std "
        "measured_damping model_damping damping_error damping_error_std mac noise_mac"
    }
)
class Correlation:
    """Paired modes side by side, one entry a pair.

    An error of a few of its standard deviations is what the measurement's noise makes of a right model.

    Attributes
    ----------
    measured_frequency, model_frequency : (n_pair,) float
        Natural frequencies, Hz.
    frequency_error : (n_pair,) float
        (model - measured) / measured, as a ratio: positive where the model is too stiff or too light.
    frequency_error_std : (n_pair,) float
        Its standard deviation.
    measured_damping, model_damping : (n_pair,) float
        Damping ratios.
    damping_error : (n_pair,) float
        (model - measured) / measured, as a ratio.
    damping_error_std : (n_pair,) float
        Its standard deviation.
    mac : (n_pair,) float
        Modal assurance criterion.
    noise_mac : (n_pair,) float
        MAC that the measurement's noise alone would leave with a right model, on average.
    """

    measured_frequency: Reals
    model_frequency: Reals
    frequency_error: Reals
    frequency_error_std: Reals
    measured_damping: Reals
    model_damping: Reals
    damping_error: Reals
    damping_error_std: Reals
    mac: Reals
    noise_mac: Reals


def correlate(measured: MeasuredModes, model: ModeSet, pairing: Pairing) -> Correlation:
    """Put the paired modes side by side.

    Parameters
    ----------
    measured : MeasuredModes
        Identified modes.
    model : ModeSet
        Modes of the model on the same DOFs.
    pairing : Pairing
        Of the two.
    """
    r, s = pairing.measured, pairing.model
    f_exp, f_num = measured.frequency[r], model.frequency[s]
    xi_exp, xi_num = measured.damping[r], model.damping[s]
    variance = np.sum(measured.shape_std[:, r] ** 2, axis=0)
    return Correlation(
        measured_frequency=f_exp,
        model_frequency=f_num,
        frequency_error=(f_num - f_exp) / f_exp,
        frequency_error_std=measured.frequency_std[r] * f_num / f_exp**2,
        measured_damping=xi_exp,
        model_damping=xi_num,
        damping_error=(xi_num - xi_exp) / xi_exp,
        damping_error_std=measured.damping_std[r] * xi_num / xi_exp**2,
        mac=pairing.paired_mac,
        noise_mac=1.0 - np.minimum(variance / np.sum(np.abs(measured.shape[:, r]) ** 2, axis=0), 1.0),
    )


@dataclass(frozen=True, eq=False, kw_only=True)
@arrays(
    {
        "dof": "node comac s_comac e_comac",
        "dof 3": "direction",
        "pair": "scale",
        "dof pair": "difference difference_std",
    }
)
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

    node: Integers
    direction: Reals
    comac: Reals
    s_comac: Reals
    e_comac: Reals
    scale: Complexes
    difference: Complexes
    difference_std: Reals

    @property
    def error(self) -> Reals:
        """Root mean square of `difference` over all pairs, (n_dof,)."""
        return np.sqrt(np.mean(np.abs(self.difference) ** 2, axis=1))

    @property
    def error_std(self) -> Reals:
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
        raise PairingError(f"no modes are paired at a MAC of {pairing.threshold:g}, so there are no shapes to compare")
    shape = np.asarray(measured.shape[:, pairing.measured], dtype=complex)
    other = pairing.partners(measured, model)
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


def _comac(a: NDArray[np.inexact], b: NDArray[np.inexact]) -> Reals:
    """Return the correlation of two sets of shapes over the modes at each DOF; 1 where both vanish."""
    cross = np.abs(np.sum(a * b.conj(), axis=1)) ** 2
    product = np.sum(np.abs(a) ** 2, axis=1) * np.sum(np.abs(b) ** 2, axis=1)
    return np.divide(cross, product, out=np.ones_like(cross), where=product > 0.0)


@dataclass(frozen=True, eq=False, kw_only=True)
@arrays({"n": "frequency csac csf", "any any": "frac"})
class FrfCorrelation:
    """How measured and modelled functions agree.

    Attributes
    ----------
    frequency : (n_frequency,) float
        Lines, Hz.
    frac : (n_output, n_input) float
        Frequency response assurance criterion of each function over all lines: 1 for equal ones up to a factor.
    csac : (n_frequency,) float
        Cross signature assurance criterion: the MAC of the operating deflection shapes at each line, all inputs
        together. It falls where resonances do not coincide.
    csf : (n_frequency,) float
        Cross signature scale factor: 1 only where the level agrees as well.
    """

    frequency: Reals
    frac: Reals
    csac: Reals
    csf: Reals


def correlate_frf(measured: ArrayLike, model: ArrayLike, frequency: ArrayLike) -> FrfCorrelation:
    """Correlate measured functions with those of the model at the same lines.

    Parameters
    ----------
    measured, model : (n_output, n_input, n_frequency) array_like
        Functions of the same quantity, such as `ema.FRF.value` and `model.frf`.
    frequency : (n_frequency,) array_like
        Lines, Hz.

    Raises
    ------
    UpdatingError
        The arrays do not have the same functions and lines.
    """
    first, second = _functions(measured, model)
    lines = np.asarray(frequency, dtype=float)
    if lines.shape != first.shape[2:]:
        raise UpdatingError(f"{first.shape[2]} lines were given with {lines.size} frequencies")
    cross = np.abs(np.sum(first.conj() * second, axis=(0, 1)))
    square_1, square_2 = (np.sum(np.abs(h) ** 2, axis=(0, 1)) for h in (first, second))
    both = (square_1 > 0.0) & (square_2 > 0.0)
    zero = np.zeros(lines.size)
    return FrfCorrelation(
        frequency=lines,
        frac=frac(first, second),
        csac=np.divide(cross**2, square_1 * square_2, out=zero.copy(), where=both),
        csf=np.divide(2.0 * cross, square_1 + square_2, out=zero.copy(), where=both),
    )


def fdac(measured: ArrayLike, model: ArrayLike) -> Reals:
    """Frequency domain assurance criterion: deflection shapes of every two lines compared, with their sign.

    A ridge beside the diagonal shows by how much the model is too stiff or too soft at each frequency: the line of the
    model that looks like a measured one. The value is the real cosine of the two, so -1 means opposite phase; the
    first form of the criterion, its square, could not tell.

    Parameters
    ----------
    measured, model : (n_output, n_input, n_frequency) array_like
        Functions of the same DOFs; their lines may differ. Every 10th line is often enough.

    Returns
    -------
    (n_measured_line, n_model_line) float

    Raises
    ------
    UpdatingError
        The arrays do not have the same DOFs.
    """
    first, second = (np.asarray(h, dtype=complex) for h in (measured, model))
    if first.ndim != 3 or second.ndim != 3 or first.shape[:2] != second.shape[:2]:
        raise UpdatingError(
            f"FRFs to compare need the same outputs and inputs: got shapes {first.shape} and {second.shape}"
        )
    columns = [h.reshape(-1, h.shape[2]) for h in (first, second)]
    unit = [c / np.maximum(np.linalg.norm(c, axis=0), np.finfo(float).tiny) for c in columns]
    return np.asarray((unit[0].conj().T @ unit[1]).real)


def _functions(measured: ArrayLike, model: ArrayLike) -> tuple[Complexes, Complexes]:
    first, second = np.asarray(measured, dtype=complex), np.asarray(model, dtype=complex)
    if first.ndim != 3 or first.shape != second.shape:
        raise UpdatingError(
            "measured and modelled FRFs need the same shape (n_output, n_input, n_frequency): "
            f"got {first.shape} and {second.shape}"
        )
    return first, second
