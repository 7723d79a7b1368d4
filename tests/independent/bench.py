"""What stands on the bench, as plain numbers, and what a second model of it must answer.

Nothing here or beside it imports `model`, `ema` or `updating`: the second models exist to disagree with them.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Planted = Mapping[str, Mapping[str, float]]
"""Effects by their key, with the values of their parameters in SI units."""


@dataclass(frozen=True, kw_only=True)
class Clamp:
    """Mass (kg) that moves with the mean displacement of the rectangle it presses, spread over the whole height."""

    mass: float
    x: float
    y: float
    footprint: tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class Bench:
    """A stack and its rig in SI units, origin in the centre, z along the height in which the sheets are stacked.

    Between two sheets the shear modulus of the contact is G_f p, its damping is stiffness-proportional with
    d_f p, and the modulus along z is `normal_modulus` (Pirnat, Cepon and Boltezar 2013).
    """

    length: float
    width: float
    height: float
    n_lamina: int
    young: float
    poisson: float
    density: float
    normal_modulus: float
    G_f: float
    d_f: float
    pressure: float
    clamps: tuple[Clamp, ...]
    shaker: tuple[float, float, float] = (0.0, 0.0, 0.0)
    planted: Planted = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class BenchModes:
    """Modes of unit modal mass, rigid-body ones (frequency 0) first.

    Attributes
    ----------
    frequency : (n_mode,) float
        Hz.
    damping : (n_mode,) float
        Ratio.
    shape_at : callable
        Places (k, 3) in m to displacement (k, 3, n_mode) in 1/sqrt(kg).
    """

    frequency: Array
    damping: Array
    shape_at: Callable[[Array], Array]


class SecondModel(Protocol):
    """A model of the bench that shares no theory, no discretisation and no code with `model`."""

    def modes(self, bench: Bench, n_mode: int) -> BenchModes:
        """Return the lowest modes of the bench with what is planted on it."""
        ...


def read_bench(stack_file: Path) -> Bench:
    """Return the bench of a stack file with clamps spread over the height, in its own way of reading it."""
    given = tomllib.loads(stack_file.read_text(encoding="utf-8"))
    contact, material = given["contact"], given["material"]
    return Bench(
        length=1e-3 * given["length_mm"],
        width=1e-3 * given["width_mm"],
        height=1e-3 * given["height_mm"],
        n_lamina=given["n_lamina"],
        young=1e9 * material["young_GPa"],
        poisson=material["poisson"],
        density=material["density_kg_m3"],
        normal_modulus=1e9 * contact["normal_modulus_GPa"],
        G_f=contact["G_f"],
        d_f=contact["d_f_s_per_Pa"],
        pressure=1e3 * contact["pressure_kPa"],
        clamps=tuple(
            Clamp(
                mass=one["mass_kg"],
                x=1e-3 * one.get("x_mm", 0.0),
                y=1e-3 * one.get("y_mm", 0.0),
                footprint=(1e-3 * one["footprint_mm"][0], 1e-3 * one["footprint_mm"][1]),
            )
            for one in given.get("clamps", ())
        ),
    )
