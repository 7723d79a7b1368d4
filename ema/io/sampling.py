"""The sampling rate of times that a file holds in few digits."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ema.types.errors import MeasurementError

_MOST_DIGITS = 9
_FEWEST = 4  # samples that tell a rate


def rate_of_rounded(time: NDArray[np.float64]) -> float | None:
    """Return the sampling rate of which times are the rounded ones, Hz; None where there is no such rate.

    Rounded times repeat, or come in steps of two sizes. A line through them tells the rate far better than its two
    ends: to the last digit over the step and over the number of samples to the power of 3/2. Of the rates within
    three such deviations the one with the fewest digits is returned.

    Parameters
    ----------
    time : (n_sample,) float
        Times as the file holds them, s.
    """
    if time.size < _FEWEST or not np.isfinite(time).all() or np.any(np.diff(time) < 0):
        return None
    sample = np.arange(time.size)
    for quantum in _last_digits(time):
        step, start = np.polyfit(sample, time, 1, w=1 / quantum)
        if step > 0 and np.all(np.abs(time - start - step * sample) <= quantum):
            doubt = 3.0 * float(np.median(quantum)) / (step * time.size**1.5)
            return _simplest((1 - doubt) / step, (1 + doubt) / step)
    return None


def _last_digits(time: NDArray[np.float64]) -> Iterator[NDArray[np.float64]]:
    """Give what one of the last digit of each time may be worth, s: the same for all, or of so many digits."""
    for decimals in range(_MOST_DIGITS):
        if np.allclose(np.round(time, decimals), time, rtol=0, atol=1e-6 * 10.0**-decimals):
            yield np.full(time.size, 10.0**-decimals)
            break
    size = np.abs(time)
    least = size[size > 0].min(initial=1.0)
    for digits in range(1, _MOST_DIGITS):
        place = 10.0 ** (np.floor(np.log10(np.maximum(size, least)) + 1e-12) + 1 - digits)
        if np.allclose(np.round(time / place) * place, time, rtol=1e-9, atol=0):
            yield place
            break


def _simplest(low: float, high: float) -> float:
    """Return the number with the fewest digits in an interval, of several of them the one nearest to its middle."""
    middle = (low + high) / 2
    for digits in range(1, 16):
        rounded = float(f"{middle:.{digits - 1}e}")
        if low <= rounded <= high:
            return rounded
    return middle


def require_ascending(where: str, what: str, first: int, time: NDArray[np.float64], section: str) -> None:
    """Refuse times of which two follow each other that do not ascend, and say which sampling rate they may be of.

    Parameters
    ----------
    where : str
        File and variable or column, for the message.
    what : str
        What one time is there, such as "row".
    first : int
        Number of the first one.
    time : (n_sample,) float
        s.
    section : str
        Where the rate is to be stated.

    Raises
    ------
    MeasurementError
        They do not ascend.
    """
    ascends = np.diff(time) > 0
    if ascends.all():
        return
    at = first + int(np.argmin(ascends)) + 1
    message = f"{where}: {what} {at}: the time does not ascend"
    raise MeasurementError(message + said_of_rounded(time, section))


def said_of_rounded(time: NDArray[np.float64], section: str) -> str:
    """Return what a message adds of times that may be rounded: the rate that they are of, and where to state it."""
    rate = rate_of_rounded(time)
    if rate is None:
        return f"; where the times are rounded, state the sampling rate as sampling_Hz under {section}"
    return (
        f"; the times are rounded: {time.size} samples in {time[-1] - time[0]:g} s are {rate:.9g} Hz. State the rate "
        f"that the recorder was set to, such as sampling_Hz = {rate:.9g}, under {section}"
    )
