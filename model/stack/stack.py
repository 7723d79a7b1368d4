"""The laminated stack: its size, sheets, contact, clamps and mesh, as plain values in SI units.

Coordinates have their origin at the centre of the stack: x along the length, y along the width, z along the
height, in which the laminas are stacked.
"""

from __future__ import annotations

import dataclasses
import difflib
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, Protocol, get_args

import numpy as np
from numpy.typing import NDArray

from model.stack.arrays import readonly
from model.stack.curve import CompressionCurve
from model.stack.effect import Effect, shared_parameters
from model.stack.errors import EffectError, StackError
from model.stack.material import Material
from model.stack.outline import Outline, Triangulation

Distribution = Literal["height", "faces"]
Edge = Literal["left", "right", "front", "back", "all"]
Laminas = Literal["all", "bottom", "top", "faces"]

_MOST_ELEMENTS = 1000  # along a side; more is a slip, and would fill the memory before anything is said
_THINNEST = 1e-6  # m; a lamina that is thinner is a slip, and as many of them would fill the memory


def _require_positive(owner: str, value: object, *names: str) -> None:
    for name in names:
        if not 0 < getattr(value, name) < math.inf:
            message = f"{owner}: {name} must be positive, got {getattr(value, name)!r}"
            raise StackError(message)


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
        _require_positive("contact", self, "G_f", "pressure", "normal_modulus")
        if not self.d_f >= 0.0:
            message = f"contact: d_f must not be negative, got {self.d_f!r}"
            raise StackError(message)


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
                message = f"clamp: {name} must not be negative, got {getattr(self, name)!r}"
                raise StackError(message)
        if self.distribution not in get_args(Distribution):
            message = f"clamp: distribution must be 'height' or 'faces', got {self.distribution!r}"
            raise StackError(message)
        if min(self.footprint) < 0.0:
            message = f"clamp: footprint must not be negative, got {self.footprint!r}"
            raise StackError(message)


class PressureDistribution(Protocol):
    """Pressure between the laminas over the plan: what stage 1 finds, or what a user prescribes."""

    @property
    def mean(self) -> float:
        """Mean pressure over the plan, Pa."""
        ...

    def at(self, points: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
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
            message = f"pressing: plate_rigidity must be positive, got {self.plate_rigidity!r}"
            raise StackError(message)


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
        _require_positive(
            "interlayer", self, "below", "thickness", "shear_modulus", "normal_modulus", "density"
        )


def _require_support(
    support: EdgeSupport | PatchSupport, choices: dict[str, object], *stiffness: str
) -> None:
    for name, allowed in choices.items():
        if getattr(support, name) not in get_args(allowed):
            message = f"support: {name} must be one of {', '.join(get_args(allowed))}, got {getattr(support, name)!r}"
            raise StackError(message)
    values = [getattr(support, name) for name in stiffness]
    if not (min(values) >= 0.0 and max(values) > 0.0):
        message = (
            f"support: {', '.join(stiffness)} must not be negative and one of them positive, got {values}"
        )
        raise StackError(message)


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
            message = f"support: size must be positive, got {self.size!r}"
            raise StackError(message)


@dataclass(frozen=True, eq=False, kw_only=True)
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
    sensor: NDArray[np.float64]

    def __post_init__(self) -> None:
        object.__setattr__(self, "sensor", readonly("Instruments", "sensor", self.sensor, (None, 3)))


@dataclass(frozen=True, eq=False, kw_only=True)
class Mesh:
    """Fineness of the mesh of one lamina: number of elements along x and y.

    Along x elements also end where clamps do, so there may be some more or fewer. Triangles of an outline are as large
    as `n_x` of them along the length; `n_y` does not count for them.
    """

    n_x: int = 24
    n_y: int = 6

    def __post_init__(self) -> None:
        _require_positive("mesh", self, "n_x", "n_y")
        if max(self.n_x, self.n_y) > _MOST_ELEMENTS:
            message = f"mesh: n_x and n_y must be at most {_MOST_ELEMENTS}, got {self.n_x} and {self.n_y}"
            raise StackError(message)


@dataclass(frozen=True, eq=False, kw_only=True)
class Stack:
    """A laminated stack.

    Attributes
    ----------
    name : str
        What the stack is called in tables and reports.
    length, width, height : float
        Outer size along x, y and z, m.
    n_lamina : int
        Number of laminas.
    outline : Outline, Triangulation or None
        Shape of the laminas in a bounding box of `length` by `width` around the origin; None is a rectangle.
    material : Material
        The sheets.
    contact : Contact
        What joins them.
    clamps : tuple of Clamp
        Masses that ride on the stack.
    mesh : Mesh
        Mesh of one lamina.
    interlayers : tuple of Interlayer
        Soft layers between laminas; `height` includes them.
    pressing : Pressing, PressureDistribution or None
        What makes the pressure uneven: how the clamps press, or the field itself. None is uniform pressure.
    supports : tuple of EdgeSupport or PatchSupport
        What holds it to the ground; without any it floats.
    effects : tuple of Effect
        Physical effects beyond the base model; `with_effects` adds them.
    effect_values : mapping of str to float
        Values of the effects' parameters.
    instruments : Instruments or None
        Where the test's instruments touch it; None where no test is known.
    """

    name: str
    length: float
    width: float
    height: float
    n_lamina: int
    material: Material
    contact: Contact
    clamps: tuple[Clamp, ...] = ()
    mesh: Mesh = dataclasses.field(default_factory=Mesh)
    interlayers: tuple[Interlayer, ...] = ()
    pressing: Pressing | PressureDistribution | None = None
    supports: tuple[EdgeSupport | PatchSupport, ...] = ()
    outline: Outline | Triangulation | None = None
    effects: tuple[Effect, ...] = ()
    effect_values: Mapping[str, float] = dataclasses.field(default_factory=dict)
    instruments: Instruments | None = None

    def __post_init__(self) -> None:
        _require_positive("stack", self, "length", "width", "height", "n_lamina")
        if self.outline is not None:
            box = np.array([self.length, self.width])[:, None] * [-0.5, 0.5]
            if np.abs(self.outline.bounds - box).max() > 1e-6 * self.length:
                (x0, x1), (y0, y1) = self.outline.bounds
                message = (
                    f"stack: its outline reaches from {x0:g} to {x1:g} m along x and {y0:g} to {y1:g} m along y; "
                    f"it must fill a box of {self.length:g} by {self.width:g} m around the origin"
                )
                raise StackError(message)
        places = [layer.below for layer in self.interlayers]
        for i, below in enumerate(places):
            if not below < self.n_lamina or below in places[:i]:
                message = (
                    f"interlayers[{i}]: below = {below}; each place between two laminas, from 1 to "
                    f"{self.n_lamina - 1}, can hold one layer"
                )
                raise StackError(message)
        if not (self.pressing is None or isinstance(self.pressing, Pressing)):
            mean = self.pressing.mean
            if abs(mean - self.contact.pressure) > 1e-6 * mean:
                message = (
                    f"stack: its pressure field has a mean of {mean / 1e3:.6g} kPa, its contact a pressure of "
                    f"{self.contact.pressure / 1e3:.6g} kPa; press the stack anew at that pressure"
                )
                raise StackError(message)
        if self.pitch <= 0.0:
            message = f"stack: height {self.height:g} m leaves no room for laminas between the interlayers"
            raise StackError(message)
        if self.pitch < _THINNEST:
            message = (
                f"stack: n_lamina = {self.n_lamina} in a height of {self.height:g} m makes laminas {self.pitch:.2g} m "
                "thick; electrical steel has 1e-4 to 1e-3 m"
            )
            raise StackError(message)
        for i, clamp in enumerate(self.clamps):
            for axis, position, size in (("x", clamp.x, self.length), ("y", clamp.y, self.width)):
                if abs(position) > size / 2.0:
                    message = (
                        f"clamps[{i}]: {axis} = {position:g} m lies outside the stack, which reaches from "
                        f"{-size / 2:g} to {size / 2:g} m"
                    )
                    raise StackError(message)

    @property
    def pitch(self) -> float:
        """Distance of the mid-planes of laminas that touch, m: the height that the laminas share."""
        return (self.height - sum(layer.thickness for layer in self.interlayers)) / self.n_lamina

    @property
    def spacing(self) -> NDArray[np.float64]:
        """Distance of neighbouring lamina mid-planes, (n_lamina - 1,) m, the lowest one first."""
        spacing = np.full(self.n_lamina - 1, self.pitch)
        for layer in self.interlayers:
            spacing[layer.below - 1] += layer.thickness
        return spacing

    @property
    def touching(self) -> NDArray[np.float64]:
        """1 where neighbouring laminas touch, 0 where a soft layer parts them, (n_lamina - 1,)."""
        parted = np.isin(np.arange(1, self.n_lamina), [layer.below for layer in self.interlayers])
        return np.where(parted, 0.0, 1.0)

    @property
    def lamina_z(self) -> NDArray[np.float64]:
        """Heights of the lamina mid-planes, (n_lamina,) m, the bottom one first."""
        bottom = (self.pitch - self.height) / 2.0
        return np.asarray(bottom + np.concatenate([[0.0], np.cumsum(self.spacing)]), dtype=np.float64)

    @property
    def area(self) -> float:
        """Area of the plan, m2."""
        return self.length * self.width if self.outline is None else self.outline.area

    @property
    def mass(self) -> float:
        """Mass of sheets, layers and clamps together, kg."""
        per_area = self.material.density * self.pitch * self.n_lamina
        per_area += sum(layer.density * layer.thickness for layer in self.interlayers)
        return self.area * per_area + sum(clamp.mass for clamp in self.clamps)

    def with_contact(self, **values: float) -> Stack:
        """Return the stack with some of `G_f`, `d_f`, `pressure`, `normal_modulus` replaced."""
        return dataclasses.replace(self, contact=dataclasses.replace(self.contact, **values))

    def with_effects(self, *effects: Effect, **values: float) -> Stack:
        """Return the stack with further effects, and with values of effects' parameters.

        Parameters
        ----------
        *effects : Effect
            Such as those of `model.find_effects`. One that the stack has already stays once.
        **values : float
            Values by parameter name. Those of a new effect that are not given are neutral: it changes
            nothing until it is fitted or given a strength.

        Raises
        ------
        EffectError
            An effect or parameter is unknown, or effects disagree about a shared parameter.
        """
        for effect in effects:
            if not isinstance(effect, Effect):
                message = f"with_effects: {effect!r} is no effect; give *model.find_effects([{effect!r}])"
                raise EffectError(message)
        chosen = {effect.name: effect for effect in (*self.effects, *effects)}
        parameters = shared_parameters(chosen.values())
        for name in values:
            if name not in parameters:
                close = difflib.get_close_matches(name, parameters, n=1)
                there = ", ".join(parameters) or "none"
                hint = f"did you mean {close[0]}?" if close else f"there are {there}"
                message = f"no effect of the stack has a parameter {name!r}; {hint}"
                raise EffectError(message)
        neutral = {name: parameter.neutral for name, parameter in parameters.items()}
        return dataclasses.replace(
            self, effects=tuple(chosen.values()), effect_values={**neutral, **self.effect_values, **values}
        )
