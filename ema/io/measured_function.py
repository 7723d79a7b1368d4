"""One measured function as a file holds it, the common ground of all readers, and the sampling rate of its times."""

from __future__ import annotations

from collections import Counter, defaultdict
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ema.types.errors import MeasurementError
from ema.types.frf import Quantity
from lamella_shared import readonly

Kind = Literal["frf", "coherence", "response", "force", "other"]
"""What a function is: response and force are time histories, "other" (spectra, ...) is read but not used."""


@dataclass(frozen=True, eq=False, kw_only=True)
class MeasuredFunction:
    """A function of frequency or time with the degrees of freedom that its file states.

    Attributes
    ----------
    kind : {"frf", "coherence", "response", "force", "other"}
        What the function is.
    abscissa : (n_value,) float
        Hz, or s for a time history.
    value : (n_value,) complex or float
        SI units.
    quantity : {"receptance", "mobility", "accelerance"} or None
        For an FRF what it is, for the time history of a response the FRF that it gives; None for the
        other kinds, and where the file does not say.
    output, input : (int, int) or None
        Point number and signed local direction (1, 2, 3 for +x, +y, +z) of response and force; None
        where the file does not state one.
    source : str
        File and data set, for messages.
    component : str
        Name of the part of the structure whose point the response is; empty where the file states none.
    """

    kind: Kind
    abscissa: NDArray[np.float64]
    value: NDArray[Any] = field(repr=False)
    quantity: Quantity | None
    output: tuple[int, int] | None
    input: tuple[int, int] | None
    source: str
    component: str = ""

    def __post_init__(self) -> None:
        abscissa = readonly("MeasuredFunction", "abscissa", self.abscissa, (None,))
        dtype = complex if np.iscomplexobj(self.value) else float
        object.__setattr__(self, "abscissa", abscissa)
        object.__setattr__(self, "value", readonly("MeasuredFunction", "value", self.value, abscissa.shape, dtype))


_MOST_DIGITS = 9


Channels = tuple[MeasuredFunction, ...]
"""Channels of one record of time histories."""


def records_in(functions: Channels) -> tuple[tuple[Channels, ...], ...]:
    """Return the records of time histories that a file holds one after the other: for each run those that are averaged.

    A degree of freedom is in a record once. Where all come again equally often, they are blows or blocks of one run.
    Where a force or a response moves, channels that follow each other in the same kinds are a record, and those with
    the same degrees of freedom one run. Without degrees of freedom nothing tells records apart: there is one.
    """
    channels = tuple(f for f in functions if f.kind in ("force", "response"))
    ends = [(f.kind, f.output) for f in channels]
    counts = Counter(end for end in ends if end[1] is not None)
    if max(counts.values(), default=1) == 1 or any(f.output is None for f in channels):
        return ((functions,),)
    if len(set(counts.values())) == 1:
        n_record = counts[ends[0]]
        places = {end: [f for f, at in zip(channels, ends, strict=True) if at == end] for end in counts}
        return (tuple(tuple(of_end[k] for of_end in places.values()) for k in range(n_record)),)
    kinds = [kind for kind, _ in ends]
    for n in (n for n in range(2, len(kinds)) if len(kinds) % n == 0 and kinds == kinds[:n] * (len(kinds) // n)):
        of_run: dict[frozenset[Any], list[Channels]] = defaultdict(list)
        for k in range(0, len(kinds), n):
            of_run[frozenset(ends[k : k + n])].append(channels[k : k + n])
        if len(set(kinds[:n])) == 2 and all(len(run) == n for run in of_run):
            return tuple(map(tuple, of_run.values()))
    return ((functions,),)


def rate_of_rounded(time: NDArray[np.float64], *, fewest: int = 10, longest: float = 1e9) -> float | None:
    """Return the sampling rate of which times are the rounded ones, Hz; None where there is no such rate.

    Rounded times repeat, or come in steps of two sizes. A line through them tells the rate far better than its two
    ends: to the last digit over the step and over the number of samples to the power of 3/2. Of the rates within
    three such deviations the one with the fewest digits is returned.

    Parameters
    ----------
    time : (n_sample,) float
        Times as the file holds them, s.
    fewest : int
        Samples that tell a rate.
    longest : float
        S.
    """
    if time.size < fewest or not np.all(np.abs(time) < longest) or np.any(np.diff(time) < 0):
        return None
    return _of_decimals(time) or _of_digits(time) or _of_mixed_digits(time)


def _of_decimals(time: NDArray[np.float64]) -> float | None:
    """Return the rate of times with so many decimals: a line through them, whichever way they are rounded."""
    for decimals in range(_MOST_DIGITS):
        quantum = 10.0**-decimals
        if np.allclose(np.round(time, decimals), time, rtol=0, atol=1e-6 * quantum):
            step, off = _line(time)
            if step <= 0 or np.abs(off).max() > quantum:
                return None
            doubt = 3.0 * quantum / (step * time.size**1.5)
            return _simplest((1 - doubt) / step, (1 + doubt) / step)
    return None


def _of_digits(time: NDArray[np.float64]) -> float | None:
    """Return the rate of times with so many digits, such as 9.85E-02: each sample bounds it, late ones by less."""
    size = np.abs(time)
    least = size[size > 0].min(initial=1.0)
    for digits in range(1, _MOST_DIGITS):
        quantum = 10.0 ** (np.floor(np.log10(np.maximum(size, least)) + 1e-12) + 1 - digits)
        if np.allclose(np.round(time / quantum) * quantum, time, rtol=1e-9, atol=0):
            sample, passed = np.arange(1, time.size), time[1:] - time[0]
            for share in (0.5001, 1.0):  # rounded, or cut
                shortest = float(np.max((passed - share * quantum[1:]) / sample))
                longest = float(np.min((passed + share * quantum[1:]) / sample))
                if 0 < shortest <= longest:
                    return _simplest(1 / longest, 1 / shortest)
            return None
    return None


def _line(time: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
    """Return the step of a line through times, s, and how far they are off it, s."""
    sample = np.arange(time.size)
    step, start = np.polyfit(sample, time, 1)
    return float(step), time - start - step * sample


def is_uneven(time: NDArray[np.float64], *, jitter: float = 0.2) -> bool:
    """Whether samples, (n_sample,), lie farther from even steps than the last digit of printed times lets them.

    `jitter`: share of a step; a missing or a doubled sample is more.
    """
    with np.errstate(over="ignore", invalid="ignore"):  # times that are none
        step = np.diff(time)
    if step.size == 0 or not np.isfinite(step).all():
        return True
    return bool(np.abs(step - step.mean()).max() > jitter * step.mean())


def _of_mixed_digits(time: NDArray[np.float64], *, most_off: float = 0.35) -> float | None:
    """Return the rate of times with more digits in some rows than in others, which lie about a line without a break.

    `most_off`: share of a step by which times of mixed digits lie off the line.
    """
    step, off = _line(time)
    if step <= 0 or np.abs(off).max() > most_off * step:
        return None
    if any(abs(part.mean()) > most_off / 5 * step for part in np.array_split(off, 10)):
        return None  # a missing sample moves all that follow
    doubt = 3.0 * float(np.abs(off).max()) / (step * time.size)
    return _simplest((1 - doubt) / step, (1 + doubt) / step)


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
