"""The laminated stack: its size, sheets, contact, clamps and mesh, as plain values in SI units.

Coordinates have their origin at the centre of the stack: x along the length, y along the width, z along the
height, in which the laminas are stacked.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from model.errors import StackError
from model.material import Material

Distribution = Literal["height", "faces"]


def _require_positive(owner: str, value: object, *names: str) -> None:
    for name in names:
        if not getattr(value, name) > 0:
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
    """

    mass: float
    x: float
    y: float
    distribution: Distribution = "height"
    footprint: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        if not self.mass >= 0.0:
            message = f"clamp: mass must not be negative, got {self.mass!r}"
            raise StackError(message)
        if self.distribution not in get_args(Distribution):
            message = f"clamp: distribution must be 'height' or 'faces', got {self.distribution!r}"
            raise StackError(message)
        if min(self.footprint) < 0.0:
            message = f"clamp: footprint must not be negative, got {self.footprint!r}"
            raise StackError(message)


@dataclass(frozen=True, eq=False, kw_only=True)
class Mesh:
    """Fineness of the mesh of one lamina: number of elements along x and y."""

    n_x: int = 24
    n_y: int = 6

    def __post_init__(self) -> None:
        _require_positive("mesh", self, "n_x", "n_y")


@dataclass(frozen=True, eq=False, kw_only=True)
class Stack:
    """A rectangular laminated stack.

    Attributes
    ----------
    name : str
        What the stack is called in tables and reports.
    length, width, height : float
        Outer size along x, y and z, m.
    n_lamina : int
        Number of laminas; the pitch is ``height / n_lamina``.
    material : Material
        The sheets.
    contact : Contact
        What joins them.
    clamps : tuple of Clamp
        Masses that ride on the stack.
    mesh : Mesh
        Mesh of one lamina.
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

    def __post_init__(self) -> None:
        _require_positive("stack", self, "length", "width", "height", "n_lamina")
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
        """Distance of neighbouring lamina mid-planes, m."""
        return self.height / self.n_lamina

    @property
    def lamina_z(self) -> NDArray[np.float64]:
        """Heights of the lamina mid-planes, (n_lamina,) m, the bottom one first."""
        middle = (self.n_lamina - 1) / 2.0
        return np.asarray((np.arange(self.n_lamina) - middle) * self.pitch, dtype=np.float64)

    @property
    def mass(self) -> float:
        """Mass of sheets and clamps together, kg."""
        sheets = self.material.density * self.length * self.width * self.height
        return sheets + sum(clamp.mass for clamp in self.clamps)

    def with_contact(self, **values: float) -> Stack:
        """Return the stack with some of `G_f`, `d_f`, `pressure`, `normal_modulus` replaced."""
        return dataclasses.replace(self, contact=dataclasses.replace(self.contact, **values))
