"""One measured function as a file holds it, the common ground of all readers: its sampling rate and its units."""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ema.types.errors import MeasurementError
from ema.types.frf import Quantity
from lamella_shared import Reals, readonly

Kind = Literal["frf", "coherence", "response", "force", "other"]
"""What a function is: response and force are time histories, "other" (spectra, ...) is read but not used."""
KIND_OF_TYPE: dict[int, Kind] = {1: "response", 4: "frf", 6: "coherence"}
"""What the function types of universal files, which SDynPy has as well, are; all others are "other"."""


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
    abscissa: Reals
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


def rate_of_rounded(time: Reals, *, fewest: int = 10, longest: float = 1e9) -> float | None:
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


def _of_decimals(time: Reals) -> float | None:
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


def _of_digits(time: Reals) -> float | None:
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


def _line(time: Reals) -> tuple[float, Reals]:
    """Return the step of a line through times, s, and how far they are off it, s."""
    sample = np.arange(time.size)
    step, start = np.polyfit(sample, time, 1)
    return float(step), time - start - step * sample


def is_uneven(time: Reals, *, jitter: float = 0.2) -> bool:
    """Whether samples, (n_sample,), lie farther from even steps than the last digit of printed times lets them.

    `jitter`: share of a step; a missing or a doubled sample is more.
    """
    with np.errstate(over="ignore", invalid="ignore"):  # times that are none
        step = np.diff(time)
    if step.size == 0 or not np.isfinite(step).all():
        return True
    return bool(np.abs(step - step.mean()).max() > jitter * step.mean())


def _of_mixed_digits(time: Reals, *, most_off: float = 0.35) -> float | None:
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


def require_ascending(where: str, what: str, first: int, time: Reals, section: str) -> None:
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


def said_of_rounded(time: Reals, section: str) -> str:
    """Return what a message adds of times that may be rounded: the rate that they are of, and where to state it."""
    rate = rate_of_rounded(time)
    if rate is None:
        return f"; where the times are rounded, state the sampling rate as sampling_Hz under {section}"
    return (
        f"; the times are rounded: {time.size} samples in {time[-1] - time[0]:g} s are {rate:.9g} Hz. State the rate "
        f"that the recorder was set to, such as sampling_Hz = {rate:.9g}, under {section}"
    )


_Exponents = tuple[int, int, int, int]
_UNITS: dict[str, tuple[float, int, int, int]] = {
    # label: (factor into SI, exponents of length, time and force)
    "m": (1.0, 1, 0, 0),
    "cm": (1e-2, 1, 0, 0),
    "mm": (1e-3, 1, 0, 0),
    "um": (1e-6, 1, 0, 0),
    "nm": (1e-9, 1, 0, 0),
    "in": (0.0254, 1, 0, 0),
    "inch": (0.0254, 1, 0, 0),
    "mil": (2.54e-5, 1, 0, 0),
    "ft": (0.3048, 1, 0, 0),
    "s": (1.0, 0, 1, 0),
    "sec": (1.0, 0, 1, 0),
    "ms": (1e-3, 0, 1, 0),
    "Hz": (1.0, 0, -1, 0),
    "kHz": (1e3, 0, -1, 0),
    "g": (9.80665, 1, -2, 0),  # in vibration the standard gravity, never the gram
    "gn": (9.80665, 1, -2, 0),
    "mg": (9.80665e-3, 1, -2, 0),
    "N": (1.0, 0, 0, 1),
    "mN": (1e-3, 0, 0, 1),
    "cN": (1e-2, 0, 0, 1),
    "kN": (1e3, 0, 0, 1),
    "MN": (1e6, 0, 0, 1),
    "lbf": (4.4482216152605, 0, 0, 1),
    "lb": (4.4482216152605, 0, 0, 1),
    "kgf": (9.80665, 0, 0, 1),
    "kp": (9.80665, 0, 0, 1),
    "kg": (1.0, -1, 2, 1),
    "Pa": (1.0, -2, 0, 1),
    **dict.fromkeys(("gs", "grav"), (9.80665, 1, -2, 0)),
    **dict.fromkeys(("newton", "newtons"), (1.0, 0, 0, 1)),
    **dict.fromkeys(("pound", "pounds"), (4.4482216152605, 0, 0, 1)),
}
_FOLDED = {label.casefold(): value for label, value in reversed(_UNITS.items())}
_SPELLING = str.maketrans(
    {"⁻": "-", "¹": "1", "²": "2", "³": "3", "µ": "u", "μ": "u", "·": "*", "×": "*", "[": "(", "]": ")"}
)
_TOKEN = re.compile(r"([A-Za-z]+)(?:\^?(-?\d+))?|([*/()])|(\d+(?:\.\d+)?(?:[eE][+-]?\d+)?)")
_METRE_PER_SECOND = re.compile(r"(?<![A-Za-z])(mm|cm|um|nm|m|in|ft)s\^?\(?-([12])\)?")
"""``ms-2`` is the metre per square second; per square millisecond nothing is measured."""
_FRF: dict[tuple[int, int, int], Quantity] = {
    (1, 0, -1): "receptance",
    (1, -1, -1): "mobility",
    (1, -2, -1): "accelerance",
}


@dataclass(frozen=True, kw_only=True)
class Unit:
    """A unit as a factor into SI and its exponents of length, time and force.

    Attributes
    ----------
    factor : float
        Into SI; of volts into V.
    dimension : (int, int, int)
        Exponents of length, time and force.
    volt : int
        Exponent of the volts of a sensor, whose sensitivity is not stated; 0 of all that can be used.
    """

    factor: float
    dimension: tuple[int, int, int]
    volt: int = 0

    @property
    def frf(self) -> Quantity | None:
        """The frequency-response function that this unit belongs to, None for any other unit."""
        return _FRF.get(self.dimension) if self.volt == 0 else None

    @property
    def motion(self) -> Quantity | None:
        """The frequency-response function whose response alone has this unit, None for any other."""
        length, time, force = self.dimension
        return _FRF.get((length, time, force - 1)) if self.volt == 0 else None

    @property
    def turned_frf(self) -> bool:
        """Whether this is the unit of a force over a response."""
        return self.volt == 0 and (-self.dimension[0], -self.dimension[1], -self.dimension[2]) in _FRF

    @property
    def is_force(self) -> bool:
        """Whether this is a unit of force."""
        return self.dimension == (0, 0, 1) and self.volt == 0


def parse_unit(label: str) -> Unit:
    """Return what a unit label such as ``(m/s²)/N``, ``g/N``, ``mm/s^2/lbf`` or ``(1/N)*(m/s2)`` means.

    Products, quotients (from left to right), brackets, integer exponents and numbers are understood; ``g`` is
    the standard gravity 9.80665 m/s2 and ``lb`` the pound-force. Volts are divided by the sensitivity of the sensor:
    ``V/N/(100 mV/g)``.

    Raises
    ------
    MeasurementError
        The label is not understood; the message names the part that is not.
    """
    text = label.strip().strip("\"'").translate(_SPELLING).replace("**", "^").replace("'s", "s")  # g's
    text = re.sub(r"(?<=[\w)]) +(?=[A-Za-z(])", "*", text.strip()).replace(" ", "")  # a blank between units multiplies
    text = _METRE_PER_SECOND.sub(r"\1*s^-\2", text)
    factor, dimension, position = _product(text, 0, label)
    if not text or position != len(text):
        raise _not_understood(label, text[position:])
    return Unit(factor=factor, dimension=dimension[:3], volt=dimension[3])


def si_label(label: str) -> str:
    """Return the unit of SI of what a unit label measures, such as ``m/s2/N`` of ``g/N``; itself where it is none."""
    of_si = {
        (1, 0, -1): "m/N", (1, -1, -1): "m/s/N", (1, -2, -1): "m/s2/N",
        (1, 0, 0): "m", (1, -1, 0): "m/s", (1, -2, 0): "m/s2", (0, 0, 1): "N",
    }  # fmt: skip
    try:
        unit = parse_unit(label)
    except MeasurementError:
        return label
    return of_si.get(unit.dimension, label) if unit.volt == 0 else label


def _product(text: str, position: int, label: str) -> tuple[float, _Exponents, int]:
    """Evaluate a product of units up to the end or to the bracket that closes it."""
    factor, dimension, divide = 1.0, (0, 0, 0, 0), False
    while position < len(text) and text[position] != ")":
        token = _TOKEN.match(text, position)
        if token is None:
            raise _not_understood(label, text[position:])
        name, exponent, operator, figure = token.groups()
        position = token.end()
        if operator in ("*", "/"):
            divide = operator == "/"
            continue
        if operator == "(":
            part, part_dimension, position = _product(text, position, label)
            if position >= len(text):
                raise _not_understood(label, "a bracket that is not closed")
            position += 1
        elif figure is not None:
            part, part_dimension = float(figure), (0, 0, 0, 0)
            if not 0.0 < part < float("inf"):
                raise _not_understood(label, figure)
        else:
            part, part_dimension = _power(name, exponent, label)
        sign = -1 if divide else 1
        factor *= part**sign
        dimension = (
            dimension[0] + sign * part_dimension[0],
            dimension[1] + sign * part_dimension[1],
            dimension[2] + sign * part_dimension[2],
            dimension[3] + sign * part_dimension[3],
        )
        divide = False
    return factor, dimension, position


def _power(name: str, exponent: str | None, label: str) -> tuple[float, _Exponents]:
    """Return factor and exponents of one unit to a power."""
    # What sensors give, whose sensitivity makes a motion or a force of it
    volts = {"V": 1.0, "mV": 1e-3, "uV": 1e-6, "Volt": 1.0, "Volts": 1.0, "volts": 1.0}
    power = int(exponent or 1)
    known = _UNITS.get(name, _FOLDED.get(name.casefold()))
    if known is None and name not in volts:
        raise _not_understood(label, name)
    if abs(power) > 9:
        raise _not_understood(label, f"{name}{exponent}")
    if known is None:
        return volts[name] ** power, (0, 0, 0, power)
    return known[0] ** power, (known[1] * power, known[2] * power, known[3] * power, 0)


NOT_UNDERSTOOD = re.compile(r"the unit ['\"](.+?)['\"] is not understood")
"""What a message says of a unit that is none; its group is the unit."""


def _not_understood(label: str, part: str) -> MeasurementError:
    return MeasurementError(
        f"the unit {label!r} is not understood at {part!r}; units are written like 'm/s2/N', 'g/N', 'um/N'"
    )
