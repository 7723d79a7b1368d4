"""Stacks that show how the layers of a bench like them move together, rounded so that many benches share them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tests.independent.bench import Bench, Clamp, Planted
from tests.independent.effects import PRESSURE_REFERENCE

SNAPSHOT_ELEMENTS = (8, 2)
"""Elements of a snapshot along x and y."""
SNAPSHOT_MODES = 24
EXTRA = (4, 4)
"""Functions of in-plane and normal displacements for each kind of thing that is planted."""
USUAL = "usual"
"""The kind of snapshot that every stack needs."""
_AT = {"x": 0.1, "y": 0.3}
_SNAPSHOTS: dict[str, tuple[tuple[float, Planted], ...]] = {
    USUAL: ((0.4, {}), (1.0, {"height_gradient": {"excess": 0.8}}), (2.5, {})),
    "crack": ((0.5, {"crack": {"loss": 0.95, "x": 0.4}}), (1.0, {"crack": {"loss": 0.8, "x": 0.1}})),
    "bar": ((0.25, {"clamp_inertia_four": {"inertia": 1e-3}}), (1.0, {"clamp_inertia_four": {"inertia": 6e-3}})),
    "pad": (
        (
            0.5,
            {
                "point_mass": {"mass": 0.5},
                "cable": {"mass": 0.5, "stiffness": 1e8, "damping": 0.0, **_AT},
                "absorber": {"mass": 0.2, "frequency": 1e3, "damping": 0.0, "x": -0.4, "y": -0.9},
            },
        ),
    ),
}
"""Pressures over the usual one, and what is planted, by kind."""
_KIND = {
    "crack": "crack",
    "clamp_inertia_two": "bar",
    "clamp_inertia_four": "bar",
    "stinger_mass": "pad",
    "stinger_spring": "pad",
    "absorber": "pad",
    "cable": "pad",
    "point_mass": "pad",
}


@dataclass(frozen=True, kw_only=True)
class Usual:
    """Rounded values that all stacks nearly like a bench share, and what kinds of things are planted on it."""

    length: float
    width: float
    height: float
    n_lamina: int
    young: float
    density: float
    normal_modulus: float
    shear: float
    n_clamp: int
    kinds: tuple[str, ...]

    @classmethod
    def of(cls, bench: Bench) -> Usual:
        """Return what a bench has in common with others."""

        def near(value: float, step: float) -> float:
            return float(np.exp(step * np.round(np.log(value) / step)))

        names = ("length", "width", "height", "young", "density", "normal_modulus")
        planted = sorted({_KIND[key] for key in bench.planted if key in _KIND})
        return cls(
            n_lamina=bench.n_lamina,
            shear=near(bench.G_f * PRESSURE_REFERENCE, 1.4),
            n_clamp=len(bench.clamps),
            kinds=(USUAL, *planted),
            **{name: near(getattr(bench, name), 0.25) for name in names},
        )

    def benches(self, kind: str) -> list[Bench]:
        """Return the benches that show what a kind does."""
        return [self._bench(pressure, planted) for pressure, planted in _SNAPSHOTS[kind]]

    def _bench(self, share: float, planted: Planted) -> Bench:
        mass = 0.6 * self.density * self.length * self.width * self.height / max(1, self.n_clamp)
        places = self.length * (np.arange(self.n_clamp) + 0.5 - 0.5 * self.n_clamp) / (self.n_clamp + 2.0)
        footprint = (0.5 * self.length / (self.n_clamp + 2.0), self.width)
        return Bench(
            length=self.length,
            width=self.width,
            height=self.height,
            n_lamina=self.n_lamina,
            young=self.young,
            poisson=0.3,
            density=self.density,
            normal_modulus=self.normal_modulus,
            G_f=self.shear / PRESSURE_REFERENCE,
            d_f=0.0,
            pressure=share * PRESSURE_REFERENCE,
            clamps=tuple(Clamp(mass=mass, x=float(x), y=0.0, footprint=footprint) for x in places),
            planted=planted,
        )
