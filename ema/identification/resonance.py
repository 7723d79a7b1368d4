"""Modes at resonance of a structure that is not linear, from functions measured with a force of constant amplitude.

At each line such a structure moves with another amplitude, so the functions are no sum of poles: where it softens, a
resonance leans to the left, and the pole that fits it best is that of no amplitude. Its motion in one mode is nearly
harmonic, so at each line the mode has the frequency and damping of the amplitude there (A. Carrella, D. J. Ewins,
Identifying and quantifying structural nonlinearities in engineering applications from measured frequency response
functions, Mech. Syst. Signal Process. 25, 2011):

    1 / h = (omega_r(a)**2 (1 + i loss(a)) - omega**2) / c

h is the mode's receptance, filtered out of all functions by its residues once the other modes are taken away, and a
its amplitude. Where the two flanks have the same amplitude they have the same omega_r, which tells the constant c.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ema.types.arrays import readonly
from ema.types.frf import DERIVATIVE, FRF
from ema.types.modal_model import ModalModel, synthesize

Vector = NDArray[np.float64]

_REACH = 1.2  # half bandwidths to either side of the largest response, over which frequency grows evenly with amplitude
_MIN_LINES = 8


@dataclass(frozen=True, eq=False, kw_only=True)
class Resonances:
    """Modes at the amplitude that they have in resonance.

    Attributes
    ----------
    frequency, damping : (n_mode,) float
        Natural frequencies, Hz, and damping ratios at that amplitude.
    frequency_std, damping_std : (n_mode,) float
        Their standard deviations.
    response : (n_output, n_input, n_mode) float
        Displacement of each output in that mode alone, over the force, m/N.
    """

    frequency: Vector
    damping: Vector
    frequency_std: Vector
    damping_std: Vector
    response: Vector

    def __post_init__(self) -> None:
        n = np.size(self.frequency)
        for name in ("frequency", "damping", "frequency_std", "damping_std"):
            object.__setattr__(self, name, readonly("Resonances", name, getattr(self, name), (n,)))
        object.__setattr__(
            self, "response", readonly("Resonances", "response", self.response, (None, None, n))
        )


def resonances(frf: FRF, modal_model: ModalModel) -> Resonances:
    """Return the modes of functions that were measured with a force of constant amplitude, at resonance.

    Parameters
    ----------
    frf : FRF
        The functions that were identified.
    modal_model : ModalModel
        What was identified: its poles say where to look, and its residues filter. Modes of which a bandwidth holds too
        few lines stay as they are there.
    """
    lines = frf.band(max(modal_model.band[0], np.finfo(float).tiny), modal_model.band[1]).convert(
        "receptance"
    )
    # residual terms stay in: beside leaning resonances a fit bends them, and the filter passes little of them
    beside = replace(modal_model, lower=0.0 * modal_model.lower, upper=0.0 * modal_model.upper)
    rest = lines.value - synthesize(beside, lines.frequency, "receptance")
    power = (2.0 * np.pi * lines.frequency) ** DERIVATIVE[modal_model.quantity]
    found = [
        _resonance(lines.frequency, rest, modal_model, r, power) for r in range(modal_model.frequency.size)
    ]
    table = np.array([own for own, _ in found]).reshape(-1, 4)
    return Resonances(
        frequency=table[:, 0],
        damping=table[:, 1],
        frequency_std=table[:, 2],
        damping_std=table[:, 3],
        response=np.stack([response for _, response in found], axis=-1),
    )


def _resonance(
    frequency: Vector, rest: NDArray[np.complex128], model: ModalModel, r: int, power: Vector
) -> tuple[tuple[float, float, float, float], Vector]:
    """Return frequency, damping and their standard deviations of a mode, and its response over the force, m/N."""
    pole, residue = model.pole[r], model.residue[..., r]
    s, scale = 2j * np.pi * frequency, 2j * pole.imag
    constant = residue * scale
    constant = np.real(constant)  # of a real mode; what is complex is noise or damping that couples modes
    own = residue[..., None] / (s - pole) + residue.conj()[..., None] / (s - pole.conj())
    size = float(np.sum(constant**2))
    h = np.tensordot(constant, rest + own, axes=2) / size
    noise = np.sqrt(np.sum((constant * model.noise) ** 2)) / size / power
    near = np.abs(frequency - frequency[np.argmax(np.where(_around(frequency, pole), np.abs(h), 0.0))])
    chosen = near <= _REACH * -pole.real / (2.0 * np.pi)
    stated = (model.frequency[r], model.damping[r], model.frequency_std[r], model.damping_std[r])
    if np.count_nonzero(chosen) < _MIN_LINES:
        return stated, np.abs(constant) / (2.0 * model.damping[r] * np.abs(pole) ** 2)
    values, peak = _over_amplitude(2.0 * np.pi * frequency[chosen], h[chosen], noise[chosen])
    # what a window and the mass of sensors do to poles is taken out of these as it is of the model's
    ratio = 2.0 * np.pi * model.frequency[r] / abs(pole)
    damping = values[1] - model.decay_rate / (2.0 * np.pi * values[0])
    return (values[0] * ratio, damping, values[2] * ratio, values[3]), np.abs(constant) * peak


def _around(frequency: Vector, pole: complex) -> NDArray[np.bool_]:
    """Tell the lines within two bandwidths of a pole, and the nearest line."""
    off = np.abs(frequency - abs(pole) / (2.0 * np.pi))
    return off <= max(4.0 * -pole.real / (2.0 * np.pi), float(off.min()))


def _over_amplitude(
    omega: Vector, h: NDArray[np.complex128], noise: Vector
) -> tuple[tuple[float, float, float, float], float]:
    """Return frequency, Hz, damping, their standard deviations and abs(h), s2, where the amplitude is largest."""
    inverse, size = 1.0 / h, np.abs(h)
    weight = size**2 / noise
    peak = _vertex(omega, size)
    less = size / peak - 1.0
    columns = np.column_stack([np.ones(omega.size), less, less**2, -inverse.real])
    (square, _, _, c), covariance = _weighted(columns, omega**2, weight)
    loss, loss_covariance = _weighted(columns[:, :3], c * inverse.imag / omega**2, weight)
    w = np.sqrt(square)
    lost = float(loss[0])
    std = (
        np.sqrt(covariance[0, 0]) / (2.0 * w),
        np.hypot(np.sqrt(loss_covariance[0, 0]), lost * np.sqrt(covariance[3, 3]) / c),
    )
    return (float(w / (2.0 * np.pi)), lost / 2.0, float(std[0] / (2.0 * np.pi)), float(std[1] / 2.0)), peak


def _weighted(columns: Vector, value: Vector, weight: Vector) -> tuple[Vector, Vector]:
    """Return the least-squares solution and its covariance, with the scatter that the rows show."""
    scale = np.linalg.norm(columns * weight[:, None], axis=0)
    q, triangle = np.linalg.qr(columns * weight[:, None] / scale)
    solution = np.linalg.solve(triangle, q.T @ (weight * value))
    left = weight * value - (columns * weight[:, None] / scale) @ solution
    inverse = np.linalg.inv(triangle) / scale[:, None]
    freedom = max(value.size - columns.shape[1], 1)
    return solution / scale, inverse @ inverse.T * float(left @ left) / freedom


def _vertex(omega: Vector, size: Vector) -> float:
    """Return the largest value of a curve, of the parabola through its five highest lines."""
    top = int(np.clip(np.argmax(size), 2, size.size - 3))
    x = omega[top - 2 : top + 3] - omega[top]
    a, b, c = np.polyfit(x, size[top - 2 : top + 3], 2)
    return float(c - b**2 / (4.0 * a)) if a < 0.0 else float(size[top])
