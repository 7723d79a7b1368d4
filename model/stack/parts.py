"""The parts of a stack: material, contact, clamps, what presses it, soft layers, supports, instruments, mesh.

The compression curve is the relation of a stack's compression along z to the pressure on it, p(strain). Uneven sheets
close under load, so it is steep only once they have: most of the deformation comes at low pressure. Contact does not
pull: at negative strain the pressure is 0.
"""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal, Protocol, get_args

import numpy as np

from lamella_shared import Reals, arrays, plain_text
from model.stack.errors import StackError

if TYPE_CHECKING:
    from scipy.interpolate import CubicHermiteSpline

Distribution = Literal["height", "faces"]

Edge = Literal["left", "right", "front", "back", "all"]

Laminas = Literal["all", "bottom", "top", "faces"]

PLATE_POISSON = 0.3
"""Poisson's ratio of the plates that press a stack: of steel."""


def require_positive(owner: str, value: object, *names: str) -> None:
    """Require that attributes of a value are positive and finite.

    Parameters
    ----------
    owner : str
        What the value is called in the message.
    value : object
        The value.
    *names : str
        The attributes.

    Raises
    ------
    StackError
        One is not; the message names it.
    """
    for name in names:
        if not 0 < getattr(value, name) < math.inf:
            raise StackError(f"{owner}: {name} must be positive, got {getattr(value, name)!r}")


@dataclass(frozen=True, eq=False, kw_only=True)
class Contact:
    """Contact between neighbouring laminas at the mean pressure `pressure`.

    The shear modulus of the contact is G = G_f p and its stiffness-proportional damping coefficient is
    beta = d_f p (Pirnat et al. 2013, Fig. 10).

    Attributes
    ----------
    G_f : float
        Contact stiffness parameter, Pa of shear modulus per Pa of pressure.
    d_f : float
        Contact damping parameter, s/Pa.
    pressure : float
        Mean surface pressure p, Pa.
    normal_modulus : float
        Tangent modulus E_z of the stack under compression along z at that pressure, Pa.
    """

    G_f: float
    d_f: float
    pressure: float
    normal_modulus: float

    def __post_init__(self) -> None:
        require_positive("contact", self, "G_f", "pressure", "normal_modulus")
        if not self.d_f >= 0.0:
            raise StackError(f"contact: d_f must not be negative, got {self.d_f!r}")


NO_CONTACT = Contact(G_f=1000.0, d_f=0.0, pressure=1e5, normal_modulus=1e9)
"""What stands for the contact of one lamina, which has none: nothing depends on it."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Clamp:
    """Effective mass of one clamp, moving with the laminas in all three directions.

    Attributes
    ----------
    mass : float
        Effective mass, kg.
    x, y : float
        Its place on the plan, m.
    distribution : "height" or "faces"
        Spread evenly over all laminas, or half on the top and half on the bottom one.
    footprint : (float, float)
        Lengths along x and y of the rectangle that the clamp presses on the plan, m; the mass moves with the
        mean displacement there. (0, 0) is a point mass; what overhangs the stack does not count.
    share : float
        Its part of the clamping force relative to the other clamps'.
    """

    mass: float
    x: float
    y: float
    distribution: Distribution = "height"
    footprint: tuple[float, float] = (0.0, 0.0)
    share: float = 1.0

    def __post_init__(self) -> None:
        for name in ("mass", "share"):
            if not getattr(self, name) >= 0.0:
                raise StackError(f"clamp: {name} must not be negative, got {getattr(self, name)!r}")
        if self.distribution not in get_args(Distribution):
            raise StackError(f"clamp: distribution must be 'height' or 'faces', got {self.distribution!r}")
        if min(self.footprint) < 0.0:
            raise StackError(f"clamp: footprint must not be negative, got {self.footprint!r}")


class PressureDistribution(Protocol):
    """Pressure between the laminas over the plan: what stage 1 finds, or what a user prescribes."""

    @property
    def mean(self) -> float:
        """Mean pressure over the plan, Pa."""
        ...

    def at(self, points: Reals) -> tuple[Reals, Reals]:
        """Return pressure and normal tangent modulus, Pa, (n_interface, n) each, at points (n, 2) of the plan."""
        ...


@dataclass(frozen=True, eq=False, kw_only=True)
class Pressing:
    """How the clamps press the stack: what the static stage needs beside the clamps.

    The clamping force is the contact's mean pressure times the area of the plan, divided between the clamps
    by their shares.

    Attributes
    ----------
    curve : CompressionCurve
        Pressure over compressive strain of the sheets.
    plate_rigidity : float
        Bending stiffness E t**3 / 12 (1 - nu**2), N m, with nu = 0.3, of the pressing plates that cover both
        faces under the clamps; `inf` for rigid ones. Without plates the bare sheets beside the clamps would
        open like a fan.
    """

    curve: CompressionCurve
    plate_rigidity: float = float("inf")

    def __post_init__(self) -> None:
        if not self.plate_rigidity > 0.0:  # infinite for rigid plates
            raise StackError(f"pressing: plate_rigidity must be positive, got {self.plate_rigidity!r}")


@dataclass(frozen=True, eq=False, kw_only=True)
class Interlayer:
    """A soft layer, such as a silicon sheet, between two laminas.

    Next to steel it has no membrane stiffness worth counting; it shears, is compressed, and its mass moves with
    the mean of the laminas above and below. Contact with its neighbours is so much stiffer that it is left
    out.

    Attributes
    ----------
    below : int
        Number of laminas below it, from 1 to n_lamina - 1.
    thickness : float
        Thickness, m.
    shear_modulus : float
        Shear modulus, Pa.
    normal_modulus : float
        Pressure over strain when it is compressed between the laminas, Pa; of rubber that cannot expand
        sideways it is many times Young's modulus.
    density : float
        Mass per volume, kg/m3.
    """

    below: int
    thickness: float
    shear_modulus: float
    normal_modulus: float
    density: float

    def __post_init__(self) -> None:
        require_positive("interlayer", self, "below", "thickness", "shear_modulus", "normal_modulus", "density")


def _require_support(support: EdgeSupport | PatchSupport, choices: dict[str, object], *stiffness: str) -> None:
    for name, allowed in choices.items():
        if getattr(support, name) not in get_args(allowed):
            raise StackError(
                f"support: {name} must be one of {', '.join(get_args(allowed))}, got {getattr(support, name)!r}"
            )
    values = [getattr(support, name) for name in stiffness]
    if not (min(values) >= 0.0 and max(values) > 0.0):
        raise StackError(f"support: {', '.join(stiffness)} must not be negative and one of them positive, got {values}")


@dataclass(frozen=True, eq=False, kw_only=True)
class EdgeSupport:
    """An edge of laminas on springs to the ground; `inf` holds a motion.

    Attributes
    ----------
    edge : "left", "right", "front", "back" or "all"
        Lowest or highest x, lowest or highest y, or the whole boundary.
    along, across : float
        Stiffness per length of the edge and lamina against motion in the plan and along z, N/m2.
    rotation : float
        Stiffness per length and lamina against turning about the edge, N m/rad per m.
    laminas : "all", "bottom", "top" or "faces"
        Which laminas it holds.
    """

    edge: Edge
    along: float = 0.0
    across: float = 0.0
    rotation: float = 0.0
    laminas: Laminas = "all"

    def __post_init__(self) -> None:
        _require_support(self, {"edge": Edge, "laminas": Laminas}, "along", "across", "rotation")


@dataclass(frozen=True, eq=False, kw_only=True)
class PatchSupport:
    """A rectangle on laminas on springs to the ground; `inf` holds a motion.

    Attributes
    ----------
    x, y : float
        Its centre, m.
    size : (float, float)
        Its lengths along x and y, m.
    along, across : float
        Stiffness per area and lamina against motion in the plan and along z, N/m3.
    laminas : "all", "bottom", "top" or "faces"
        Which laminas it holds.
    """

    x: float
    y: float
    size: tuple[float, float]
    along: float = 0.0
    across: float = 0.0
    laminas: Laminas = "all"

    def __post_init__(self) -> None:
        _require_support(self, {"laminas": Laminas}, "along", "across")
        if not min(self.size) > 0.0:
            raise StackError(f"support: size must be positive, got {self.size!r}")


@dataclass(frozen=True, eq=False, kw_only=True)
@arrays({"any 3": "sensor"})
class Instruments:
    """Where the test's instruments touch the stack; what effects of their mass and stiffness need.

    Attributes
    ----------
    shaker : (x, y, z)
        Where the stinger is fixed, m.
    sensor : (n, 3) float
        Points over which the accelerometers rove, m.
    """

    shaker: tuple[float, float, float]
    sensor: Reals


@dataclass(frozen=True, eq=False, kw_only=True)
class Mesh:
    """Fineness of the mesh of one lamina: number of elements along x and y.

    Along x elements also end where clamps do, so there may be some more or fewer. Triangles of an outline are as large
    as `n_x` of them along the length; `n_y` does not count for them.
    """

    n_x: int = 24
    n_y: int = 6

    def __post_init__(self) -> None:
        # along a side; more is a slip, and would fill the memory before anything is said
        most_elements = 1000
        require_positive("mesh", self, "n_x", "n_y")
        if max(self.n_x, self.n_y) > most_elements:
            raise StackError(f"mesh: n_x and n_y must be at most {most_elements}, got {self.n_x} and {self.n_y}")


@dataclass(frozen=True, eq=False, kw_only=True)
class Material:
    """Elastic constants and density of a sheet.

    Attributes
    ----------
    young : float
        Young's modulus along x (the rolling direction), Pa.
    poisson : float
        Poisson's ratio nu_xy: contraction along y under tension along x.
    density : float
        Mass per volume of the stack as it stands (gaps between the sheets included), kg/m3.
    transverse_ratio : float
        Young's modulus along y over that along x; 1 for isotropic steel.
    shear_ratio : float
        In-plane shear modulus over ``young / 2 (1 + poisson)``; 1 for isotropic steel.

    Raises
    ------
    StackError
        A constant is not positive, or the sheet's stiffness is not positive definite.
    """

    young: float
    poisson: float
    density: float
    transverse_ratio: float = 1.0
    shear_ratio: float = 1.0

    def __post_init__(self) -> None:
        for name in ("young", "density", "transverse_ratio", "shear_ratio"):
            if not 0.0 < getattr(self, name) < math.inf:
                raise StackError(f"material: {name} must be positive, got {getattr(self, name):g}")
        if not (-1.0 < self.poisson < 1.0 and self.poisson**2 * self.transverse_ratio < 1.0):
            raise StackError(
                f"material: poisson = {self.poisson:g} with transverse_ratio = {self.transverse_ratio:g} is "
                "not stable; poisson must lie between -1 and 1 and poisson**2 * transverse_ratio below 1"
            )

    def plane_stress(self) -> tuple[float, float, float, float]:
        """Return the plane-stress stiffnesses (Q11, Q12, Q22, Q66), Pa (Reddy 2004, eq. 2.4.8)."""
        q11 = self.young / (1.0 - self.poisson**2 * self.transverse_ratio)
        q22 = q11 * self.transverse_ratio
        shear = self.shear_ratio * self.young / (2.0 * (1.0 + self.poisson))
        return q11, self.poisson * q22, q22, shear


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

    strain: Reals
    pressure: Reals

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

    def evaluate(self, strain: Reals) -> tuple[Reals, Reals]:
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
