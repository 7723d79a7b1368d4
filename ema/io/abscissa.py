"""The unit of the abscissa of a universal file: what makes Hz of frequencies and s of times."""

from __future__ import annotations

import math
import re
from typing import Literal

from ema.types.errors import MeasurementError

Dimension = Literal["frequency", "time"]
_FREQUENCY = {
    "hz": 1.0, "hertz": 1.0, "1/s": 1.0, "1/sec": 1.0, "s-1": 1.0, "cps": 1.0, "cycles/s": 1.0, "cycles/sec": 1.0,
    "khz": 1e3, "rad/s": 0.5 / math.pi, "rad/sec": 0.5 / math.pi, "radian/s": 0.5 / math.pi,
    "radians/s": 0.5 / math.pi, "radians/sec": 0.5 / math.pi, "rpm": 1.0 / 60.0, "rev/min": 1.0 / 60.0,
    "1/min": 1.0 / 60.0, "cpm": 1.0 / 60.0,
}  # fmt: skip
_TIME = {
    "s": 1.0, "sec": 1.0, "secs": 1.0, "second": 1.0, "seconds": 1.0, "ms": 1e-3, "msec": 1e-3, "millisecond": 1e-3,
    "milliseconds": 1e-3, "us": 1e-6, "usec": 1e-6, "microsecond": 1e-6, "microseconds": 1e-6, "ns": 1e-9,
    "min": 60.0, "minute": 60.0, "minutes": 60.0,
}  # fmt: skip
_BY_CASE = {"MHz": 1e6, "mHz": 1e-3}  # which letters of one size cannot tell apart
_NONE = ("", "none", "unknown", "-")


def abscissa_factor(label: str, dimension: Dimension, where: str) -> float:
    """Return what makes Hz (s) of an abscissa of frequencies (times) with this unit label; 1 without a label.

    Parameters
    ----------
    label : str
        Field "abscissa units label".
    dimension : {"frequency", "time"}
        What the abscissa of such a function is.
    where : str
        File and data set, for the message.

    Raises
    ------
    MeasurementError
        The label is none of a unit of that dimension.
    """
    text = re.sub(r"[\s()\[\]^]", "", label).replace("µ", "u").replace("μ", "u")
    known = _FREQUENCY if dimension == "frequency" else _TIME
    if text.lower() in _NONE:
        return 1.0
    if dimension == "frequency" and text in _BY_CASE:
        return _BY_CASE[text]
    factor = known.get(text.lower())
    if factor is None:
        right = "Hz, kHz, rad/s or rpm" if dimension == "frequency" else "s, ms, us or min"
        message = (
            f"{where}: field 'abscissa units label' is {label!r}, which is no unit of a {dimension}; expected {right}: "
            "export the function with one of them"
        )
        raise MeasurementError(message)
    return factor


def is_frequency(code: int, label: str) -> bool:
    """Whether the data type of an abscissa (18), or its unit label where the type is 0 or 1, is a frequency."""
    text = re.sub(r"[\s()\[\]^]", "", label)
    return code == 18 or (code in (0, 1) and (text in _BY_CASE or text.lower() in _FREQUENCY))
