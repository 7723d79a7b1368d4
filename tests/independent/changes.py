"""States of one stack that a second model simulates: assembled anew each time, sensors put back, one perhaps changed.

What is assembled anew differs by the torques of all clamps, by that of each, and by the contact between sheets; sensors
that are put back are off in place and gain. A change is drawn such that it moves a mode by so many scatters.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tests.independent.bench import Array, Bench, BenchModes, Planted, SecondModel, read_bench
from tests.independent.campaign import (
    SENSORS,
    SHAKER,
    Configuration,
    Plan,
    Simulated,
    _damped,
    _measured,
    deviating,
    nominal_points,
    visible,
)
from tests.independent.effects import Range

FEWEST_SCATTERS = 3.0
"""By which a change moves the mode that it moves most."""
_SHARE = Range(lower=-0.9, upper=0.9, scale="lin")
_PLACE = {"x": _SHARE, "y": _SHARE}
_WIDE = Range(lower=0.08, upper=0.2, scale="lin")
_CLAMP = Range(lower=0.0, upper=1.0, scale="lin")


@dataclass(frozen=True, kw_only=True)
class Draw:
    """How a kind of change is drawn.

    Attributes
    ----------
    key : str
        What is planted.
    parameters : dict of Range
        By name; `size` is the one that is drawn anew, larger, until the change shows.
    size : str
        The parameter that says how large it is.
    right : tuple of str
        Kinds of `updating.changes` that are right.
    """

    key: str
    parameters: dict[str, Range]
    size: str
    right: tuple[str, ...]


DRAWS: dict[str, Draw] = {
    "added mass": Draw(
        key="point_mass",
        parameters={"mass": Range(lower=0.05, upper=0.5), **_PLACE},
        size="mass",
        right=("added_mass",),
    ),
    "removed mass": Draw(
        key="clamp_masses",
        parameters={"mass": Range(lower=0.15, upper=1.5), "clamp": _CLAMP},
        size="mass",
        right=("removed_mass",),
    ),
    "absorber": Draw(
        key="absorber",
        parameters={
            "mass": Range(lower=0.1, upper=0.5),
            "frequency": Range(lower=300.0, upper=1100.0, scale="lin"),
            "damping": Range(lower=0.005, upper=0.05, scale="lin"),
            **_PLACE,
        },
        size="mass",
        right=("absorber",),
    ),
    "spring": Draw(
        key="cable",
        parameters={
            "mass": Range(lower=1e-3, upper=2e-3),
            "stiffness": Range(lower=2e5, upper=4e6),
            "damping": Range(lower=1.0, upper=60.0),
            **_PLACE,
        },
        size="stiffness",
        right=("spring_to_ground",),
    ),
    "lost contact": Draw(
        key="contact_patch",
        parameters={"ratio": Range(lower=0.09, upper=0.9), "radius": _WIDE, **_PLACE},
        size="ratio",
        right=("lost_contact",),
    ),
    "glue": Draw(
        key="contact_patch",
        parameters={"ratio": Range(lower=0.3, upper=3.0), "radius": _WIDE, **_PLACE},
        size="ratio",
        right=("glued_patch",),
    ),
    "glue on a side": Draw(
        key="glue_patch",
        parameters={
            "modulus": Range(lower=5e7, upper=1e9),
            "half": Range(lower=0.06, upper=0.15, scale="lin"),
            "x": _SHARE,
        },
        size="modulus",
        right=("glued_patch",),
    ),
    "loose bolt": Draw(
        key="loose_bolt",
        parameters={
            "loss": Range(lower=0.07, upper=0.7),
            "stiffness": Range(lower=3e7, upper=3e8, scale="lin"),
            "clamp": _CLAMP,
        },
        size="loss",
        right=("loose_clamp",),
    ),
    "tight bolt": Draw(
        key="clamp_forces",
        parameters={"more": Range(lower=0.1, upper=1.0), "clamp": _CLAMP},
        size="more",
        right=("tight_clamp",),
    ),
    "crack": Draw(
        key="crack",
        parameters={"loss": Range(lower=0.5, upper=0.97), "x": Range(lower=-0.6, upper=0.6, scale="lin")},
        size="loss",
        right=("crack", "softer_patch"),
    ),
    "softer patch": Draw(
        key="steel_patch",
        parameters={"ratio": Range(lower=0.09, upper=0.9), "radius": _WIDE, **_PLACE},
        size="ratio",
        right=("softer_patch",),
    ),
    "stiffer patch": Draw(
        key="steel_patch",
        parameters={"ratio": Range(lower=0.2, upper=2.0), "radius": _WIDE, **_PLACE},
        size="ratio",
        right=("stiffer_patch",),
    ),
    "less pressure": Draw(
        key="pressure", parameters={"ratio": Range(lower=0.04, upper=0.4)}, size="ratio", right=("softer_contact",)
    ),
    "soft side": Draw(
        key="soft_side", parameters={"loss": Range(lower=0.08, upper=0.6)}, size="loss", right=("lost_contact",)
    ),
}
"""Kinds of change of a stack; shares `ratio` are of what is lost of `lost contact` and `softer patch`, else gained."""


@dataclass(frozen=True, kw_only=True)
class Workshop:
    """How a laboratory assembles and puts its sensors back: standard deviations, relative or in m."""

    torque: float = 0.005
    clamp: float = 0.01
    contact: float = 0.005
    place: float = 5e-4
    gain: float = 0.003


def workshop(rng: np.random.Generator) -> Workshop:
    """Draw a laboratory whose frequencies scatter by 0.1 to 0.5 % between assemblies."""
    factor = float(np.exp(rng.uniform(np.log(0.2), np.log(1.0))))
    return Workshop(
        torque=0.005 * factor,
        clamp=0.01 * factor,
        contact=0.005 * factor,
        place=float(rng.uniform(1e-4, 1e-3)),
        gain=float(rng.uniform(1e-3, 1e-2)),
    )


@dataclass(frozen=True, kw_only=True)
class States:
    """One stack on the bench of one laboratory.

    Attributes
    ----------
    plan : Plan
        Stack, band, noise, tolerances; its seed draws all.
    model : SecondModel
        What simulates it.
    shop : Workshop
        How it is assembled.
    """

    plan: Plan
    model: SecondModel
    shop: Workshop = field(default_factory=Workshop)

    @cached_property
    def stack(self) -> tuple[Bench, Array, Array]:
        """True stack, true places of the points, and those that the files state."""
        stated = read_bench(self.plan.stack)
        nominal = nominal_points(stated, self.plan.shaker)
        bench, point = deviating(self.plan, stated, nominal, np.random.default_rng([self.plan.seed, 66]))
        return bench, point, nominal

    @cached_property
    def frequency(self) -> Array:
        """Lines of the FRFs, Hz."""
        low, high = self.plan.band
        return np.arange(low, high + self.plan.step / 2.0, self.plan.step)

    def assembled(self, number: int, planted: Planted | None = None) -> Bench:
        """Return the stack as it is assembled for the state of a number, with something planted."""
        bench, _, _ = self.stack
        rng = np.random.default_rng([self.plan.seed, 67, number])
        stated = self.plan.configurations[0].pressure
        torque, contact = np.exp([self.shop.torque, self.shop.contact] * rng.standard_normal(2))
        forces = dict(enumerate(self.shop.clamp * rng.standard_normal(len(bench.clamps))))
        planted = dict(planted or {})
        for clamp, more in planted.pop("clamp_forces", {}).items():
            forces[int(clamp)] += more
        torque *= planted.pop("pressure", {}).get("ratio", 1.0)
        planted["clamp_forces"] = {str(k): float(v) for k, v in forces.items()}
        return dataclasses.replace(bench, pressure=stated * torque, G_f=bench.G_f * contact, planted=planted)

    def modes(self, bench: Bench) -> BenchModes:
        """Return its modes."""
        return _damped(self.model.modes(bench, self.plan.n_mode))

    def seen(self, modes: BenchModes) -> Array:
        """Return natural frequencies of elastic modes up to the band's end, Hz."""
        f = modes.frequency
        return f[(f > 1.0) & (f < self.plan.band[1])]

    def measured(
        self, number: int, modes: BenchModes, *, step: float | None = None
    ) -> tuple[NDArray[np.complex128], Array]:
        """Return the FRFs of all runs of a state, (n_run, 2, n_line), and their noise."""
        _, point, _ = self.stack
        rng = np.random.default_rng([self.plan.seed, 68, number])
        moved = self.shop.place * rng.standard_normal(point.shape) * [1.0, 1.0, 0.0]
        moved[SHAKER - 1] *= 0.2  # the stinger screws onto what is glued on
        half = np.array([getattr(self.stack[0], side) for side in ("length", "width", "height")]) / 2.0
        gain = 1.0 + self.shop.gain * rng.standard_normal(SENSORS)
        plan = self.plan if step is None else dataclasses.replace(self.plan, step=step)
        return _measured(plan, modes, np.clip(point + moved, -half, half), self.frequency, gain, rng)

    def simulated(self, names: Sequence[str], planted: Mapping[str, Planted]) -> Simulated:
        """Return states as a campaign of configurations that are measured one after the other."""
        _, point, nominal = self.stack
        first = self.plan.configurations[0]
        plan = dataclasses.replace(
            self.plan,
            configurations=tuple(
                Configuration(name=name, torque=first.torque, pressure=first.pressure) for name in names
            ),
        )
        benches = [self.assembled(i, planted.get(name)) for i, name in enumerate(names)]
        modes = [self.modes(bench) for bench in benches]
        frf = [self.measured(i, one) for i, one in enumerate(modes)]
        n = SHAKER - 1
        return Simulated(
            plan=plan,
            frequency=self.frequency,
            frf=[one for one, _ in frf],
            noise=[noise for _, noise in frf],
            bench=benches,
            modes=modes,
            point=point,
            nominal=nominal,
            factor=np.ones(n),
            row=np.arange(n),
        )

    def scatter(self, modes: Sequence[BenchModes]) -> float:
        """Return the relative scatter of a frequency between two assemblies, from the true modes of some."""
        logs = np.log([one.frequency[6:16] for one in modes])
        return float(np.sqrt(2.0 * np.mean(np.var(logs, axis=0, ddof=1))))

    def moved(self, before: BenchModes, after: BenchModes) -> float:
        """Return by how much the mode that is moved most moves, relative."""
        _, point, _ = self.stack
        shape = [one.shape_at(point)[:, 2] for one in (before, after)]
        keep = [visible(one, point, self.plan.band) for one in (before, after)]
        frequency = [one.frequency[k] for one, k in zip((before, after), keep, strict=True)]
        a, b = (one[:, k] / np.linalg.norm(one[:, k], axis=0) for one, k in zip(shape, keep, strict=True))
        alike = np.abs(a.T @ b)
        best = alike.argmax(axis=1)
        shift = np.abs(np.log(frequency[1][best] / frequency[0]))
        return float(shift[alike.max(axis=1) > 0.8].max(initial=0.0))


def drawn(rng: np.random.Generator, name: str, n_clamp: int, more: float) -> dict[str, dict[str, float]]:
    """Return what is planted of a kind, its size being `more` times one of the range."""
    draw = DRAWS[name]
    values = {key: one.draw(rng) for key, one in draw.parameters.items()}
    values[draw.size] = min(more * values[draw.size], draw.parameters[draw.size].upper)
    clamp = str(min(int(values.pop("clamp") * n_clamp), n_clamp - 1)) if draw.key.startswith("clamp") else ""
    if draw.key == "clamp_masses":
        return {draw.key: {clamp: -values["mass"]}}
    if draw.key == "clamp_forces":
        return {draw.key: {clamp: values["more"]}}
    if "ratio" in values:
        lost = name in ("lost contact", "softer patch", "less pressure")
        values["ratio"] = 1.0 - values["ratio"] if lost else 1.0 + values["ratio"]
    return {draw.key: values}
