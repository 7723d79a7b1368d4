"""What is planted on a stack of layers: stiffness and loss over plan and height, and what hangs on the layers."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from tests.independent.bench import Array, Bench, Clamp
from tests.independent.effects import CRACKED_LAMINAS, PAD, PRESSURE_REFERENCE, STRIP
from tests.independent.layered_plan import Plan

SEAM_GRIP = (0.04, 0.018)
"""Half length of the bell and depth of the wedge, m, in which a seam grips the sheets: about 40 x 12 mm."""
SEAM_LEVEL = 2.0 / (SEAM_GRIP[0] * SEAM_GRIP[1])
"""Height, 1/m2, of that bell times that wedge where their integral is 1."""
ADHESIVE = 0.1
"""Share of the width that is glued along each edge."""


@dataclass(frozen=True, kw_only=True)
class Part:
    """A modulus or viscosity as a field over the plan's grid (Pa, Pa s or ratio) times a share of each level."""

    planar: Array
    level: Array


@dataclass(frozen=True, kw_only=True)
class Laws:
    """Stiffness and loss of contact and steel.

    Attributes
    ----------
    shear, viscous, hysteretic : (list of Part, list of Part)
        Of slip along x and along y at the interfaces: modulus, viscosity, loss modulus.
    normal, normal_viscous : list of Part
        Of opening of the interfaces.
    steel : list of Part
        Shares of the sheets' in-plane stiffness in each layer.
    young_ratio : float
        Young's modulus along y over that along x.
    """

    shear: tuple[list[Part], list[Part]]
    viscous: tuple[list[Part], list[Part]]
    hysteretic: tuple[list[Part], list[Part]]
    normal: list[Part]
    normal_viscous: list[Part]
    steel: list[Part]
    young_ratio: float


@dataclass(frozen=True, kw_only=True)
class Gauge:
    """A weighted sum of a displacement (0, 1, 2) over splines along x and y and over layers.

    Attributes
    ----------
    along, across : (n_x,), (n_y,) float
        Weights of the splines.
    layer : (n_layer,) float or None
        Weights of the layers; None measures each layer by itself.
    """

    component: int
    along: Array
    across: Array
    layer: Array | None = None


@dataclass(frozen=True, kw_only=True)
class Tie:
    """What hangs on a gauge; with a gauge of every layer, spread evenly over them.

    Attributes
    ----------
    gauge : Gauge
        What moves it.
    mass, stiffness, damping : float
        Its own mass, and spring and dashpot to the ground: kg, N/m, N s/m, or kg m2 about an axis.
    rider : float
        kg; if not 0, a mass at the other end of spring and dashpot, in place of the ground.
    """

    gauge: Gauge
    mass: float = 0.0
    stiffness: float = 0.0
    damping: float = 0.0
    rider: float = 0.0


def value(bench: Bench, key: str, name: str, without: float = 0.0) -> float:
    """Return a parameter of what is planted, or what it is without."""
    return bench.planted.get(key, {}).get(name, without)


def breaks(bench: Bench) -> tuple[list[float], list[float]]:
    """Return places along x and y, m, where fields have kinks or steps."""
    length, width = bench.length, bench.width
    middle = 0.5 * value(bench, "crack", "x") * length
    along = [x + s * g for x in (-length / 4.0, 0.0, length / 4.0) for s in (-1, 0, 1) for g in SEAM_GRIP[:1]]
    along += [s * length * share for s in (-1, 1) for share in (0.1, 0.15)]
    along += [middle + s * length * share for s in (-1, 1) for share in (0.05, 0.1)]
    edge = 0.5 * width
    across = [0.0, *(s * (edge - inside) for s in (-1, 1) for inside in (ADHESIVE * width, SEAM_GRIP[1]))]
    return along, across


def pressure_field(bench: Bench, plan: Plan) -> Array:
    """Return the mean pressure over the height at the points of the plan, Pa."""
    share = np.ones_like(plan.weight)
    middle = value(bench, "lost_contact_middle", "loss")
    share *= 1.0 - middle * np.exp(-18.0 * (plan.x / bench.length) ** 2)
    share *= 1.0 - value(bench, "lost_contact_ends", "loss") * (2.0 * plan.x / bench.length) ** 2
    patch = plateau(plan.x, bench.length / 10.0, bench.length / 20.0)
    share *= 1.0 - value(bench, "lost_contact_patch", "loss") * patch
    share /= plan.mean(share)
    if "loose_bolt" in bench.planted:
        clamp = bench.clamps[loose_clamp(bench)]
        distance = ((plan.x - clamp.x) ** 2 + (plan.y - clamp.y) ** 2) / (bench.length / 10.0) ** 2
        share *= 1.0 - value(bench, "loose_bolt", "loss") * np.exp(-0.5 * distance)
    return bench.pressure * share


def plateau(x: Array, half: float, edge: float) -> Array:
    """Return 1 up to a distance `half` from 0, then a cosine that ends at 0 after another `edge`."""
    outside = np.clip((np.abs(x) - half) / edge, 0.0, 1.0)
    return np.cos(0.5 * np.pi * outside) ** 2


def loose_clamp(bench: Bench) -> int:
    """Return the index of the clamp whose bolt is loose."""
    last = len(bench.clamps) - 1
    return int(np.clip(np.floor(value(bench, "loose_bolt", "clamp") * (last + 1)), 0, last))


def laws(bench: Bench, plan: Plan, n_layer: int, sheet_shear: bool) -> Laws:
    """Return stiffness and loss of the bench in layers, sheets shearing in series with the contact if asked."""
    pressure = pressure_field(bench, plan)
    at = np.arange(1, n_layer) / n_layer - 0.5
    tightness = 1.0 + 2.0 * value(bench, "height_gradient", "excess") * at
    power = value(bench, "pressure_exponent", "exponent", 1.0)
    modulus = bench.G_f * PRESSURE_REFERENCE * (pressure / PRESSURE_REFERENCE) ** power
    modulus = modulus * np.where(plan.y > 0.0, 1.0 - value(bench, "soft_side", "loss"), 1.0)
    steel_shear = bench.young / (2.0 * (1.0 + bench.poisson))
    give = 1.0 / steel_shear if sheet_shear else 0.0
    beta, eta = bench.d_f * pressure, value(bench, "contact_loss", "eta")
    found: list[list[list[Part]]] = [[], [], []]
    for ratio in (1.0, value(bench, "contact_direction", "ratio", 1.0)):
        contact, level = ratio * modulus, tightness**power
        # a series of springs, to first order in contact over steel; the loss is that of the contact's share
        found[0].append(_series(contact, level, contact * give))
        found[1].append(_series(beta * contact, level * tightness, 2.0 * contact * give, level))
        found[2].append(_series(eta * contact, level, 2.0 * contact * give))
    added = _added_shear(bench, plan)
    even = np.ones(n_layer - 1)
    for parts in found[0]:
        parts.append(Part(planar=added, level=even))
    normal = np.full_like(plan.weight, bench.normal_modulus * value(bench, "normal_stiffness", "ratio", 1.0))
    return Laws(
        shear=(found[0][0], found[0][1]),
        viscous=(found[1][0], found[1][1]),
        hysteretic=(found[2][0], found[2][1]),
        normal=[Part(planar=normal, level=even)],
        normal_viscous=[Part(planar=beta * normal, level=tightness)],
        steel=_steel(bench, plan, n_layer),
        young_ratio=value(bench, "steel_orthotropy", "ratio", 1.0),
    )


def _series(planar: Array, level: Array, softer: Array, also: Array | None = None) -> list[Part]:
    """Return a field and what it loses, to first order, as something in series gives way too."""
    also = level if also is None else also
    return [Part(planar=planar, level=level), Part(planar=-planar * softer, level=level * also)]


def _added_shear(bench: Bench, plan: Plan) -> Array:
    """Return the shear modulus that glue, seams and the like add, Pa."""
    distance = 0.5 * bench.width - np.abs(plan.y)
    added = value(bench, "contact_offset", "modulus") * np.ones_like(plan.weight)
    added = added + value(bench, "adhesive_edges", "modulus") * (distance < ADHESIVE * bench.width)
    wedge = np.clip(1.0 - distance / SEAM_GRIP[1], 0.0, 1.0)
    both, quarter = value(bench, "weld_seam", "shear"), 0.25 * bench.length
    added = added + both * SEAM_LEVEL * wedge * plateau(plan.x, 0.0, SEAM_GRIP[0])
    for x in (-quarter, 0.0, quarter):
        one = value(bench, "weld_seam_three", "shear") * SEAM_LEVEL
        added = added + one * wedge * (plan.y > 0.0) * plateau(plan.x - x, 0.0, SEAM_GRIP[0])
    return added


def _steel(bench: Bench, plan: Plan, n_layer: int) -> list[Part]:
    """Return the shares of steel: all of it, less what a crack takes from the layers that it goes through."""
    whole = Part(planar=np.ones_like(plan.weight), level=np.ones(n_layer))
    if "crack" not in bench.planted:
        return [whole]
    x = plan.x - 0.5 * value(bench, "crack", "x") * bench.length
    lost = value(bench, "crack", "loss") * plateau(x, bench.length / 20.0, bench.length / 20.0)
    depth = CRACKED_LAMINAS / bench.n_lamina
    return [whole, Part(planar=-lost * np.ones_like(plan.y), level=_share_of_layers(n_layer, 1.0 - depth, 1.0))]


def _share_of_layers(n_layer: int, low: float, high: float) -> Array:
    """Return how much of each layer lies between two heights, as shares of the height from the bottom."""
    ends = np.arange(n_layer + 1) / n_layer
    return np.clip(np.minimum(ends[1:], high) - np.maximum(ends[:-1], low), 0.0, None) * n_layer


@dataclass(frozen=True, kw_only=True)
class Rig:
    """Makes what hangs on the layers of a bench.

    Attributes
    ----------
    bench : Bench
        With what is planted.
    plan : Plan
        Splines over its plan.
    n_layer : int
        Layers.
    """

    bench: Bench
    plan: Plan
    n_layer: int

    def ties(self) -> list[Tie]:
        """Return all ties, those of clamps over every layer first."""
        bench, top = self.bench, 0.5 * self.bench.height
        place = np.array([0.5 * bench.length, 0.5 * bench.width])
        ties = [tie for i, clamp in enumerate(bench.clamps) for tie in self._clamp(i, clamp)]
        ties += self._bars()
        mass = value(bench, "stinger_mass", "mass")
        if mass:
            ties += [Tie(gauge=self._pad(axis, bench.shaker), mass=mass) for axis in range(3)]
        stiffness = value(bench, "stinger_spring", "stiffness")
        if stiffness:
            ties += [Tie(gauge=self._pad(axis, bench.shaker), stiffness=stiffness) for axis in range(2)]
        if "point_mass" in bench.planted:
            corner = (place[0], place[1], top)
            mass = value(bench, "point_mass", "mass")
            ties += [Tie(gauge=self._pad(axis, corner), mass=mass) for axis in range(3)]
        if "cable" in bench.planted:
            ties += self._cable(bench.planted["cable"], place, top)
        if "absorber" in bench.planted and value(bench, "absorber", "mass"):
            given = bench.planted["absorber"]
            omega, mass = 2.0 * np.pi * given["frequency"], given["mass"]
            held = {"stiffness": mass * omega**2, "damping": 2.0 * given["damping"] * mass * omega}
            at = (given["x"] * place[0], given["y"] * place[1], top)
            ties.append(Tie(gauge=self._pad(2, at), rider=mass, **held))
        return ties

    def _cable(self, given: dict[str, float], place: Array, top: float) -> list[Tie]:
        """Return a cable: mass in all directions, spring and dashpot along z."""
        at = (given["x"] * place[0], given["y"] * place[1], top)
        held = [{}, {}, {"stiffness": given["stiffness"], "damping": given["damping"]}]
        return [Tie(gauge=self._pad(axis, at), mass=given["mass"], **held[axis]) for axis in range(3)]

    def _clamp(self, index: int, clamp: Clamp) -> list[Tie]:
        """Return a clamp, whose mass moves with its footprint in every layer, on springs if its bolt is loose."""
        half_x, half_y = 0.5 * clamp.footprint[0], 0.5 * clamp.footprint[1]
        along = self.plan.lines[0].mean(clamp.x - half_x, clamp.x + half_x)
        across = self.plan.lines[1].mean(clamp.y - half_y, clamp.y + half_y)
        gauges = [Gauge(component=axis, along=along, across=across) for axis in range(3)]
        mass = clamp.mass + value(self.bench, "clamp_mass", "mass")
        if "loose_bolt" in self.bench.planted and index == loose_clamp(self.bench):
            return self._loose(gauges, mass, value(self.bench, "loose_bolt", "stiffness"))
        return [Tie(gauge=gauge, mass=mass) for gauge in gauges]

    def _loose(self, gauges: list[Gauge], mass: float, stiffness: float) -> list[Tie]:
        """Return a clamp that rides on springs as a rigid body: its shifts and its turns about y and x."""
        even = np.full(self.n_layer, 1.0 / self.n_layer)
        level = np.linspace(-0.5, 0.5, self.n_layer)
        turn, spread = (level / (level @ level), float(np.mean(level**2)))  # slope over z, and its share of a shift's
        shifts = [Tie(gauge=dataclasses.replace(one, layer=even), stiffness=stiffness, rider=mass) for one in gauges]
        turns = [
            Tie(gauge=dataclasses.replace(one, layer=turn), stiffness=spread * stiffness, rider=spread * mass)
            for one in gauges[:2]
        ]
        return shifts + turns

    def _bars(self) -> list[Tie]:
        """Return bars, one on each face with half the inertia, that turn about x as the sheets under them do.

        A rigid bar on an even bed turns with the mean of the slope dw/dy, weighted by a parabola over the width.
        """
        bench, across = self.bench, self.plan.lines[1]
        two, four = (value(bench, f"clamp_inertia_{name}", "inertia") for name in ("two", "four"))
        x = 0.4 * bench.length * value(bench, "clamp_inertia_two", "station")
        stations = [(two, -x), (two, x), *((four, clamp.x) for clamp in bench.clamps)]
        y, weight = across.rule(-0.5 * bench.width, 0.5 * bench.width)
        bed = 1.5 * weight / bench.width * (1.0 - (2.0 * y / bench.width) ** 2)
        slope, reach = bed @ across.at(y, 1), 0.5 * (bench.length - STRIP)
        found = []
        for inertia, at in stations:
            low = float(np.clip(at, -reach, reach)) - 0.5 * STRIP
            along = self.plan.lines[0].mean(low, low + STRIP)
            for face in np.eye(self.n_layer)[[0, -1]] if inertia else ():
                gauge = Gauge(component=2, along=along, across=slope, layer=face)
                found.append(Tie(gauge=gauge, mass=0.5 * inertia))
        return found

    def _pad(self, component: int, at: tuple[float, float, float]) -> Gauge:
        """Return the mean displacement of the sheets under a pad, which is moved so that none of it overhangs."""
        side, share = PAD[0], PAD[1] / self.bench.height
        low = [
            float(np.clip(place, -0.5 * (size - side), 0.5 * (size - side))) - 0.5 * side
            for place, size in zip(at[:2], (self.bench.length, self.bench.width), strict=True)
        ]
        along, across = (line.mean(a, a + side) for line, a in zip(self.plan.lines, low, strict=True))
        layer = _share_of_layers(self.n_layer, *((1.0 - share, 1.0) if at[2] > 0.0 else (0.0, share)))
        return Gauge(component=component, along=along, across=across, layer=layer / layer.sum())
