"""Unit labels as test systems write them, to factors into SI and to what they measure."""

from __future__ import annotations

import re
from dataclasses import dataclass

from ema.types.errors import MeasurementError
from ema.types.frf import Quantity

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
_SPELLING = str.maketrans({"²": "2", "³": "3", "µ": "u", "μ": "u", "·": "*", "×": "*", "[": "(", "]": ")"})
_TOKEN = re.compile(r"([A-Za-z]+)(?:\^?(-?\d+))?|([*/()])|(\d+(?:\.\d+)?(?:[eE][+-]?\d+)?)")
_METRE_PER_SECOND = re.compile(r"(?<![A-Za-z])(mm|cm|um|nm|m|in|ft)s\^?\(?-([12])\)?")
"""``ms-2`` is the metre per square second; per square millisecond nothing is measured."""
_FRF: dict[tuple[int, int, int], Quantity] = {
    (1, 0, -1): "receptance",
    (1, -1, -1): "mobility",
    (1, -2, -1): "accelerance",
}
_MOTION: dict[tuple[int, int, int], Quantity] = {
    (1, 0, 0): "receptance",
    (1, -1, 0): "mobility",
    (1, -2, 0): "accelerance",
}


_OF_SI = {
    (1, 0, -1): "m/N", (1, -1, -1): "m/s/N", (1, -2, -1): "m/s2/N",
    (1, 0, 0): "m", (1, -1, 0): "m/s", (1, -2, 0): "m/s2", (0, 0, 1): "N",
}  # fmt: skip


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
        return _MOTION.get(self.dimension) if self.volt == 0 else None

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
    try:
        unit = parse_unit(label)
    except MeasurementError:
        return label
    return _OF_SI.get(unit.dimension, label) if unit.volt == 0 else label


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
