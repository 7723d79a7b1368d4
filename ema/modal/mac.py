"""Comparison and quality measures of mode shapes and FRFs, and how complex shapes are.

Shapes are columns, ``(n_dof, n_mode)``, real or complex. Formulas: Allemang, The modal assurance criterion,
Sound and Vibration 37(8), 2003 (MAC, CoMAC, scale factor, FRAC); Pappa, Elliott and Schenk, A consistent-mode
indicator for the eigensystem realization algorithm, NASA TM-107607, 1992 (MPC); Reynders, Houbrechts and De
Roeck, Mech. Syst. Signal Process. 29, 2012 (MPD); Shih, Tsuei, Allemang and Brown, Mech. Syst. Signal
Process. 2, 1988 (CMIF).

A real shape has all its components in phase or against it. Noise, a mode close by, damping that is not proportional,
and channels of wrong phase turn components out of that line.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ema.quality.verdict import Verdict
from ema.types.modal_model import ModalModel
from lamella_shared import Booleans, Complexes, Reals


def mac(a: ArrayLike, b: ArrayLike) -> Reals:
    """Modal assurance criterion ``|a_i^H b_j|**2 / (a_i^H a_i b_j^H b_j)``.

    Parameters
    ----------
    a : (n_dof, n_a) array_like
    b : (n_dof, n_b) array_like
        Shapes at the same DOFs. The AutoMAC of a set is ``mac(a, a)``.

    Returns
    -------
    (n_a, n_b) float

    Raises
    ------
    ValueError
        The shapes have different numbers of DOFs, or a shape is zero.
    """
    first, second = _shapes("a", a), _shapes("b", b)
    if first.shape[0] != second.shape[0]:
        raise ValueError(f"shapes to compare need the same DOFs: got {first.shape[0]} and {second.shape[0]}")
    cross = np.abs(first.conj().T @ second) ** 2
    return cross / np.outer(_squares("a", first), _squares("b", second))


def modal_scale_factor(a: ArrayLike, b: ArrayLike) -> Complexes:
    """Least-squares factors (MSF) that scale each shape of `a` to its partner in `b`: ``a^H b / a^H a``.

    Both are ``(n_dof, n_mode)``; the result is ``(n_mode,)`` complex.
    """
    first, second = _shapes("a", a), _shapes("b", b)
    if first.shape != second.shape:
        raise ValueError(f"MSF pairs shapes one to one: got {first.shape} and {second.shape}")
    return np.sum(first.conj() * second, axis=0) / _squares("a", first)


def comac(a: ArrayLike, b: ArrayLike) -> Reals:
    """Coordinate modal assurance criterion of paired shapes ``(n_dof, n_mode)``: one value per DOF.

    Each pair is brought to the same scale first, since the criterion compares magnitudes DOF by DOF.
    DOFs at which all shapes vanish have the value 1.
    """
    first, second = _shapes("a", a), _shapes("b", b)
    scaled = first * modal_scale_factor(first, second)
    weight = 1.0 / np.linalg.norm(second, axis=0)
    scaled, second = scaled * weight, second * weight
    cross = np.sum(np.abs(scaled * second.conj()), axis=1) ** 2
    product = np.sum(np.abs(scaled) ** 2, axis=1) * np.sum(np.abs(second) ** 2, axis=1)
    return np.divide(cross, product, out=np.ones_like(cross), where=product > 0.0)


def mpc(shape: ArrayLike) -> Reals:
    """Modal phase collinearity ``|phi^T phi|**2 / (phi^H phi)**2`` of each column: 1 for a real mode.

    This is the form about the origin, so that a rigid translation has a value too.
    """
    phi = _shapes("shape", shape)
    return np.abs(np.sum(phi**2, axis=0)) ** 2 / _squares("shape", phi) ** 2


def mcf(shape: ArrayLike) -> Reals:
    """Modal complexity factor of each column: 0 for a real mode, 1 for one of circular phase; ``1 - MPC``."""
    return 1.0 - mpc(shape)


def mpd(shape: ArrayLike) -> Reals:
    """Mean phase deviation of each column from its own line of best fit, rad, weighted by magnitude."""
    phi = _shapes("shape", shape)
    angle = line_angle(phi)
    turned = phi * np.exp(-1j * angle)
    magnitude = np.abs(phi)
    _squares("shape", phi)
    cosine = np.divide(np.abs(turned.real), magnitude, out=np.ones_like(magnitude), where=magnitude > 0.0)
    return np.sum(magnitude * np.arccos(np.clip(cosine, 0.0, 1.0)), axis=0) / np.sum(magnitude, axis=0)


def real_shape(shape: ArrayLike) -> Reals:
    """Real modes that correlate best with complex ones: each turned to its best line, real part, norm kept.

    The turning maximises the norm of the real part (Ahmadian, Gladwell and Ismail, J. Vib. Acoust. 117,
    1995). The sign is that of the complex shape's largest component along the line.
    """
    phi = _shapes("shape", shape)
    turned = (phi * np.exp(-1j * line_angle(phi))).real
    return turned * np.linalg.norm(phi, axis=0) / np.linalg.norm(turned, axis=0)


def cmif(value: ArrayLike) -> Reals:
    """Complex mode indicator function: singular values of the FRF matrix, line by line.

    Parameters
    ----------
    value : (n_output, n_input, n_frequency) array_like

    Returns
    -------
    (min(n_output, n_input), n_frequency) float
        In descending order, in the unit of `value`.
    """
    matrix = np.asarray(value)
    return np.linalg.svd(matrix.transpose(2, 0, 1), compute_uv=False).T


def frac(a: ArrayLike, b: ArrayLike) -> Reals:
    """Frequency response assurance criterion ``|sum a b*|**2 / (sum |a|**2 sum |b|**2)`` over the last axis.

    Functions that are zero on either side have the value 0.
    """
    first, second = np.asarray(a), np.asarray(b)
    cross = np.abs(np.sum(first * second.conj(), axis=-1)) ** 2
    product = np.sum(np.abs(first) ** 2, axis=-1) * np.sum(np.abs(second) ** 2, axis=-1)
    return np.divide(cross, product, out=np.zeros_like(cross), where=product > 0.0)


def _shapes(name: str, shape: ArrayLike) -> NDArray[Any]:
    array = np.asarray(shape)
    if array.ndim != 2:
        raise ValueError(f"{name}: shapes are columns of a (n_dof, n_mode) array, got {array.ndim} dimension(s)")
    return array


def _squares(name: str, shape: NDArray[Any]) -> Reals:
    square = np.sum(np.abs(shape) ** 2, axis=0)
    if not np.all(square > 0.0):
        raise ValueError(f"{name}: shape {int(np.flatnonzero(~(square > 0.0))[0])} is zero or not a number")
    return square


def line_angle(shape: NDArray[Any]) -> Reals:
    """Phase of the line through the origin that fits each column best, towards its largest component."""
    angle = 0.5 * np.angle(np.sum(np.asarray(shape, dtype=complex) ** 2, axis=0))
    largest = shape[np.argmax(np.abs(shape), axis=0), np.arange(shape.shape[1])]
    return np.where((largest * np.exp(-1j * angle)).real < 0.0, angle + np.pi, angle)


LEAST_MPC = 0.8
"""Modal phase collinearity below which a mode is too complex to be compared as real. The consistent-mode indicator,
which is the MPC times the consistency in time, speaks of high confidence from 80 % on (Pappa, Elliott and Schenk, A
consistent-mode indicator for the eigensystem realization algorithm, NASA TM-107607, 1992)."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Complexity:
    """Measures of the complexity of every mode shape, ``(n_mode,)`` each.

    Attributes
    ----------
    mpc : float
        Modal phase collinearity, 1 for a real mode.
    mpd : float
        Mean phase deviation from the line of best fit, degrees, weighted by magnitude.
    mcf : float
        Modal complexity factor, 0 for a real mode.
    phase_scatter : float
        Root mean square of that deviation, degrees, weighted by squared magnitude.
    by_noise : float
        Modal complexity factor that the stated standard deviations alone would give a real mode, in the mean.
    """

    mpc: Reals
    mpd: Reals
    mcf: Reals
    phase_scatter: Reals
    by_noise: Reals

    @property
    def is_complex(self) -> Booleans:
        """Which modes are too complex to be compared as real."""
        return self.mpc < LEAST_MPC


def complexity(modal_model: ModalModel) -> Complexity:
    """Measure how complex the shapes of a modal model are.

    Parameters
    ----------
    modal_model : ModalModel
        Its shapes, and their standard deviations for `Complexity.by_noise`: of a real shape with independent errors of
        variance v across its line the MPC is 1 - 4 sum(v) / sum(abs(shape)**2) to first order.
    """
    shape = modal_model.shape
    power = np.sum(np.abs(shape) ** 2, axis=0)
    turned = shape * np.exp(-1j * line_angle(shape))
    off = np.arctan2(np.abs(turned.imag), np.abs(turned.real))
    scatter = np.sqrt(np.sum(np.abs(shape) ** 2 * off**2, axis=0) / power)
    return Complexity(
        mpc=mpc(shape),
        mpd=np.degrees(mpd(shape)),
        mcf=mcf(shape),
        phase_scatter=np.degrees(scatter),
        by_noise=np.minimum(4.0 * np.sum(modal_model.shape_std**2, axis=0) / power, 1.0),
    )


def check_complexity(modal_model: ModalModel) -> tuple[Verdict, ...]:
    """Say which modes are too complex to be compared as real, and whether noise explains it.

    Returns
    -------
    tuple of Verdict
        A warning for each such mode, or that all pass.
    """
    shapes = complexity(modal_model)
    warned = tuple(_warnings(modal_model, shapes))
    if warned:
        return warned
    text = f"the shapes are nearly real: the lowest MPC is {shapes.mpc.min():.3f}" if shapes.mpc.size else "no mode"
    return (Verdict(check="complexity", level="pass", message=text),)


def _warnings(modal_model: ModalModel, shapes: Complexity, *, most_listed: int = 8) -> Iterator[Verdict]:
    complex_ones = np.flatnonzero(shapes.is_complex)
    for r in complex_ones[:most_listed]:
        f = float(modal_model.frequency[r])
        most = 0.5 * (1.0 + np.sqrt(shapes.mpc[r]))  # of a real shape along the longer axis of the components
        why = (
            "its noise alone explains that: measure it better, or leave it out"
            if shapes.by_noise[r] > 0.5 * shapes.mcf[r]
            else "a mode close by, damping at a joint, a sensor's mass that moves, or the phase of a channel does that"
        )
        text = (
            f"the mode at {f:.5g} Hz is too complex to be compared as real: MPC {shapes.mpc[r]:.2f} (of a real mode "
            f"1), phases {shapes.mpd[r]:.0f} degrees off their line in the mean; no real shape has a MAC above "
            f"{most:.2f} with it; {why}"
        )
        yield Verdict(check="complexity", level="warn", band=(f, f), message=text)
    if complex_ones.size > most_listed:
        f = float(modal_model.frequency[complex_ones[most_listed]])
        number = complex_ones.size - most_listed
        text = f"{number} further modes from {f:.5g} Hz on are too complex to be compared as real"
        yield Verdict(check="complexity", level="warn", band=(f, f), message=text)
