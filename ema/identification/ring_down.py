"""Frequency and damping over amplitude from a free decay.

One decay passes all amplitudes. The motion in one mode is filtered out by its shape and a band, its envelope and phase
are those of the analytic signal (M. Feldman, Non-linear system vibration analysis using Hilbert transform, I. Free
vibration analysis method FREEVIB, Mech. Syst. Signal Process. 8, 1994), and a short time at once an exponential is
fitted to it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ema.types.arrays import readonly
from ema.types.errors import MeasurementError
from ema.types.frf import DERIVATIVE, Quantity

Vector = NDArray[np.float64]

_CYCLES = 12.0  # in one fit; over fewer the band lets too little through
_OVERLAP = 0.5
_EDGE = 1.5  # fits left out at either end, where the band is still filling
_WIDTH = 0.15  # half width of the band over the mode's frequency, less where modes are near
_GAP = 0.45  # of the distance to the next mode
_FLOOR = 5.0  # times the noise at the end of the record, below which nothing is fitted


@dataclass(frozen=True, eq=False, kw_only=True)
class RingDown:
    """A mode over its amplitude, from a free decay, in the order of time.

    Attributes
    ----------
    amplitude : (n,) float
        Displacement amplitude at the strongest channel, m, for responses in SI units.
    frequency, frequency_std : (n,) float
        Natural frequency and its standard deviation, Hz.
    damping, damping_std : (n,) float
        Damping ratio likewise.
    """

    amplitude: Vector
    frequency: Vector
    frequency_std: Vector
    damping: Vector
    damping_std: Vector

    def __post_init__(self) -> None:
        n = np.size(self.amplitude)
        for name in ("amplitude", "frequency", "frequency_std", "damping", "damping_std"):
            object.__setattr__(self, name, readonly("RingDown", name, getattr(self, name), (n,)))


def ring_down(
    response: Vector, rate: float, *, shape: Vector, frequency: Vector, mode: int, quantity: Quantity
) -> RingDown:
    """Follow one mode through a free decay.

    Parameters
    ----------
    response : (n_channel, n_sample)
        Free motion, from when the force has ended; without offset.
    rate : float
        Sampling rate, Hz.
    shape : (n_channel, n_mode)
        Real shapes of the modes in the record at these channels.
    frequency : (n_mode,)
        Their frequencies, Hz.
    mode : int
        The one to follow, from 0.
    quantity : "receptance", "mobility" or "accelerance"
        Whether the responses are displacement, velocity or acceleration.

    Raises
    ------
    MeasurementError
        The record is too short or too noisy for the mode, or channels and shapes do not fit.
    """
    record, shapes = np.atleast_2d(response), np.atleast_2d(shape)
    _require_fitting(record, shapes, np.size(frequency))
    # with fewer channels than modes, the one that is sought alone
    used = shapes if shapes.shape[0] >= shapes.shape[1] else shapes[:, [mode]]
    filtered = np.linalg.pinv(used)[mode if used is shapes else 0] @ record
    signal = _analytic(filtered, rate, np.asarray(frequency, dtype=float), mode)
    size = int(np.ceil(_CYCLES / frequency[mode] * rate))
    step, edge = max(int(size * (1.0 - _OVERLAP)), 1), int(_EDGE * size)
    noise = (
        float(np.sqrt(np.mean(np.abs(signal[-edge - size : -edge]) ** 2)))
        if signal.size > 2 * edge + size
        else 0.0
    )
    starts = range(edge, signal.size - edge - size, step)
    fits = [_exponential(signal[i : i + size], rate) for i in starts]
    largest = max((fit[0] for fit in fits), default=0.0)
    ended = noise < 0.1 * largest
    fits = [fit for fit in fits if fit[0] > _FLOOR * noise or not ended]
    if len(fits) < 2:
        message = (
            f"ring-down: {signal.size} samples at {rate:g} Hz are too short, or too noisy, for a mode at "
            f"{frequency[mode]:g} Hz: {_CYCLES:g} cycles at once are fitted, and the ends are left out"
        )
        raise MeasurementError(message)
    table = np.array(fits)
    omega = np.hypot(table[:, 1], table[:, 2])
    strongest = float(np.abs(shapes[:, mode]).max())
    return RingDown(
        amplitude=strongest * table[:, 0] / omega ** DERIVATIVE[quantity],
        frequency=omega / (2.0 * np.pi),
        frequency_std=table[:, 3] / (2.0 * np.pi),
        damping=table[:, 1] / omega,
        damping_std=table[:, 3] / omega,
    )


def _require_fitting(record: Vector, shape: Vector, n_frequency: int) -> None:
    if record.shape[0] != shape.shape[0] or shape.shape[1] != n_frequency:
        message = (
            f"ring-down: {record.shape[0]} channels, shapes of {shape.shape[0]} channels and {shape.shape[1]} modes, "
            f"and {n_frequency} frequencies do not belong together"
        )
        raise MeasurementError(message)


def _analytic(signal: Vector, rate: float, frequency: Vector, mode: int) -> NDArray[np.complex128]:
    """Return the analytic signal of a band around a mode, whose flanks are half a cosine."""
    own = frequency[mode]
    others = np.abs(np.delete(frequency, mode) - own)
    half = min(_WIDTH * own, _GAP * float(others.min(initial=np.inf)))
    padded = 2 * signal.size  # what is filtered at one end must not come back at the other
    line = np.fft.fftfreq(padded, 1.0 / rate)
    off = np.clip((np.abs(line - own) / half - 0.5) / 0.5, 0.0, 1.0)
    band = np.where(line > 0.0, 1.0 + np.cos(np.pi * off), 0.0)
    return np.asarray(np.fft.ifft(np.fft.fft(signal, padded) * band)[: signal.size])


def _exponential(signal: NDArray[np.complex128], rate: float) -> tuple[float, float, float, float]:
    """Return amplitude in the middle, decay rate, angular frequency and the standard deviation of both, 1/s."""
    time = (np.arange(signal.size) - 0.5 * (signal.size - 1)) / rate
    value = np.log(np.abs(signal)) + 1j * np.unwrap(np.angle(signal))
    slope = complex(time @ value / (time @ time))
    middle = complex(value.mean())
    left = value - middle - slope * time
    # what is left is smooth, for the band made it so: about one number a cycle is independent
    std = float(np.sqrt(np.mean(np.abs(left) ** 2) / 2.0 / (np.mean(time**2) * _CYCLES)))
    return float(np.exp(middle.real)), -slope.real, slope.imag, std
