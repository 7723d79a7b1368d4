"""The measured curve of a stack's compression.

It is the relation of a stack's compression along z to the pressure on it, p(strain). Uneven sheets close under
load, so it is steep only once they have: most of the deformation comes at low pressure. Contact does not pull: at
negative strain the pressure is 0.
"""

from __future__ import annotations

import csv
import errno
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lamella_shared import arrays
from model.stack.errors import StackError

if TYPE_CHECKING:
    from scipy.interpolate import CubicHermiteSpline


def plain_text(path: Path) -> str:
    """Return the text of a file, without the mark of its byte order that some editors set.

    Raises
    ------
    OSError
        It cannot be read, or is a pipe or a device, which would keep the reader waiting or never end.
    ValueError
        It is not text.
    """
    if path.exists() and not (path.is_file() or path.is_dir()):
        raise OSError(errno.EINVAL, "is a pipe or a device; give a plain file", str(path))
    return path.read_text(encoding="utf-8-sig")


_COLUMNS = ("strain", "pressure_kPa")


@dataclass(frozen=True, eq=False, kw_only=True)
@arrays({"n": "strain pressure"})
class CompressionCurve:
    """Pressure over compressive strain, interpolated by monotone cubics (Fritsch and Carlson 1980).

    Beyond its last point the curve goes on straight, so that an iteration may pass through there.

    Attributes
    ----------
    strain : (n,) float
        Compressive strain, from 0 up.
    pressure : (n,) float
        Pressure, Pa, from 0 up.

    Raises
    ------
    StackError
        Fewer than three points, the first is not (0, 0), or strain or pressure is not finite or does not rise from
        one point to the next.
    """

    strain: NDArray[np.float64]
    pressure: NDArray[np.float64]

    def __post_init__(self) -> None:
        least_rise = 1e-12  # from point to point, of the largest value: less is rounding, and divided by
        n = self.strain.size
        if n < 3:
            raise StackError(f"compression curve: {n} points; at least 3 are needed")
        if self.strain[0] != 0.0 or self.pressure[0] != 0.0:
            raise StackError(
                f"compression curve: the first point is ({self.strain[0]:g}, {self.pressure[0]:g} Pa); it must "
                "be (0, 0), where the sheets begin to touch. Shift the strain or add that point."
            )
        for name in ("strain", "pressure"):
            endless = np.flatnonzero(~np.isfinite(getattr(self, name)))
            if endless.size:
                raise StackError(f"compression curve: {name} must be finite, but that of point {endless[0] + 1} is not")
            values = getattr(self, name)
            falls = np.flatnonzero(~(np.diff(values) > least_rise * np.abs(values).max()))
            if falls.size:
                row = int(falls[0]) + 1
                raise StackError(
                    f"compression curve: {name} must rise from point to point, by {least_rise:g} of the largest or "
                    f"more, but point {row + 1} has {values[row]:g} after {values[row - 1]:g}"
                )

    def _spline(self) -> CubicHermiteSpline:
        from scipy.interpolate import CubicHermiteSpline, PchipInterpolator  # here: few stacks have such a curve

        slope = PchipInterpolator(self.strain, self.pressure).derivative()(self.strain)
        # the end formula may give 0 where a curve bends; contact that has closed is never without stiffness
        secant = np.diff(self.pressure) / np.diff(self.strain)
        slope[0], slope[-1] = max(slope[0], 0.5 * secant[0]), max(slope[-1], 0.5 * secant[-1])
        return CubicHermiteSpline(self.strain, self.pressure, slope)

    def evaluate(self, strain: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the pressure and the tangent modulus, Pa, at compressive strains of any shape.

        Both are 0 at negative strain. At 0 the tangent is the one of contact that closes.
        """
        spline = self._spline()
        slope = spline.derivative()
        end = self.strain[-1]
        inside = np.clip(strain, 0.0, end)
        pressure = spline(inside) + slope(end) * (np.maximum(strain, end) - end)
        closed = np.asarray(strain) >= 0.0
        return np.where(closed, pressure, 0.0), np.where(closed, slope(inside), 0.0)

    def strain_at(self, pressure: float) -> float:
        """Return the compressive strain at a pressure, Pa.

        Raises
        ------
        StackError
            The pressure lies outside the curve.
        """
        if not 0.0 <= pressure <= self.pressure[-1]:
            raise StackError(
                f"the compression curve ends at {self.pressure[-1] / 1e3:g} kPa and says nothing about "
                f"{pressure / 1e3:g} kPa"
            )
        return float(self._spline().solve(pressure, extrapolate=False)[0])


def read_curve(path: str | Path) -> CompressionCurve:
    """Read a compression curve from a CSV file with the columns `strain` and `pressure_kPa`.

    Lines that begin with ``#`` are comments.

    Raises
    ------
    StackError
        The file cannot be read, lacks a column, or holds no rising curve; the message names file and line.
    """
    path = Path(path)
    try:
        lines = plain_text(path).splitlines()
    except (OSError, ValueError) as error:
        raise StackError(f"{path}: cannot be read ({getattr(error, 'strerror', error)})") from error
    rows = csv.DictReader(line for line in lines if not line.lstrip().startswith("#"))
    try:
        values = _values(path, rows)
    except csv.Error as error:
        raise StackError(f"{path}: row {rows.line_num}: {error}") from error
    table = np.array(values).reshape(-1, 2)
    try:
        return CompressionCurve(strain=table[:, 0], pressure=table[:, 1] * 1e3)
    except StackError as error:
        raise StackError(f"{path}: {error}") from error


def _values(path: Path, rows: csv.DictReader[str]) -> list[list[float]]:
    most_shown = 100  # characters of a row in a message
    missing = [name for name in _COLUMNS if name not in (rows.fieldnames or ())]
    if missing:
        raise StackError(f"{path}: column {missing[0]} is missing; the columns are {', '.join(_COLUMNS)}")
    values = list[list[float]]()
    for i, row in enumerate(rows):
        try:
            values.append([float(row[name]) for name in _COLUMNS])
        except (TypeError, ValueError) as error:
            raise StackError(
                f"{path}: row {i + 1}: {', '.join(_COLUMNS)} must be numbers, got {str(row)[:most_shown]}"
            ) from error
    return values
