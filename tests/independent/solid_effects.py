"""What is planted on the solid: fields of moduli over space, and things that hang on weighted sums of displacements."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from tests.independent.bench import Array, Bench, Clamp
from tests.independent.effects import CRACKED_LAMINAS, PAD, PRESSURE_REFERENCE, STRIP

ADHESIVE_SHARE = 0.1
"""Of the width, that glue covers at both long edges."""
GRIP = (0.04, 0.012)
"""Length along x and y, m, that a weld seam grips."""


LEVELS = 6
"""Levels over the height at which a clamp's mass sits."""


@dataclass(frozen=True, kw_only=True)
class Part:
    """A field over the solid that is a product of one over the plan (n_planar,) and one over the height (n_across,)."""

    planar: Array
    across: Array


@dataclass(frozen=True, kw_only=True)
class Moduli:
    """Fields of stiffness and loss, each the sum of its parts.

    Attributes
    ----------
    shear_x, shear_y : tuple of Part
        Shear moduli of x-z and y-z, Pa.
    contact_x, contact_y : tuple of Part
        What of them is friction contact and has the loss factor `eta`.
    viscous_x, viscous_y : tuple of Part
        Viscosities of x-z and y-z, Pa s.
    normal, viscous_normal : tuple of Part
        Modulus (Pa) and viscosity (Pa s) along z.
    membrane : tuple of Part
        Factor on the in-plane stiffness of the steel.
    eta : float
        Hysteretic loss factor of the contact.
    young_ratio : float
        Young's modulus of the steel along y over that along x.
    """

    shear_x: tuple[Part, ...]
    shear_y: tuple[Part, ...]
    contact_x: tuple[Part, ...]
    contact_y: tuple[Part, ...]
    viscous_x: tuple[Part, ...]
    viscous_y: tuple[Part, ...]
    normal: tuple[Part, ...]
    viscous_normal: tuple[Part, ...]
    membrane: tuple[Part, ...]
    eta: float
    young_ratio: float


@dataclass(frozen=True, kw_only=True)
class Points:
    """Where the moduli are wanted: plan (n_planar,) with weights that sum to 1, and height (n_across,), m."""

    x: Array
    y: Array
    weight: Array
    z: Array


def moduli(bench: Bench, at: Points) -> Moduli:
    """Return all fields of the bench."""
    planted = bench.planted
    pressure = _pressure(bench, at)
    fade = 1.0 + planted.get("height_gradient", {}).get("excess", 0.0) * 2.0 * at.z / bench.height
    exponent = planted.get("pressure_exponent", {}).get("exponent", 1.0)
    side = 1.0 - planted.get("soft_side", {}).get("loss", 0.0) * (at.y > 0.0)
    stiffness = bench.G_f * PRESSURE_REFERENCE * (pressure / PRESSURE_REFERENCE) ** exponent * side
    contact = Part(planar=stiffness, across=fade**exponent)
    viscous = Part(planar=bench.d_f * pressure * stiffness, across=fade ** (1.0 + exponent))
    ratio = planted.get("contact_direction", {}).get("ratio", 1.0)
    normal_modulus = bench.normal_modulus * planted.get("normal_stiffness", {}).get("ratio", 1.0)
    even, level = np.ones_like(at.x), np.ones_like(at.z)
    added = tuple(Part(planar=field, across=level) for field in _added_shear(bench, at))
    contact_y = Part(planar=ratio * contact.planar, across=contact.across)
    return Moduli(
        shear_x=(contact, *added),
        shear_y=(contact_y, *added),
        contact_x=(contact,),
        contact_y=(contact_y,),
        viscous_x=(viscous,),
        viscous_y=(Part(planar=ratio * viscous.planar, across=viscous.across),),
        normal=(Part(planar=normal_modulus * even, across=level),),
        viscous_normal=(Part(planar=bench.d_f * normal_modulus * pressure, across=fade),),
        membrane=(Part(planar=even, across=level), *_crack(bench, at), *_steel_patch(bench, at)),
        eta=planted.get("contact_loss", {}).get("eta", 0.0),
        young_ratio=planted.get("steel_orthotropy", {}).get("ratio", 1.0),
    )


def _pressure(bench: Bench, at: Points) -> Array:
    """Return the pressure over the plan, Pa."""
    planted, shape = bench.planted, np.ones_like(at.x)
    if "lost_contact_middle" in planted:
        bell = np.exp(-0.5 * (at.x / (bench.length / 6.0)) ** 2)
        shape *= 1.0 - planted["lost_contact_middle"]["loss"] * bell
    if "lost_contact_patch" in planted:
        patch = _plateau(at.x, bench.length / 10.0, bench.length / 20.0)
        shape *= 1.0 - planted["lost_contact_patch"]["loss"] * patch
    if "lost_contact_ends" in planted:
        shape *= 1.0 - planted["lost_contact_ends"]["loss"] * (2.0 * at.x / bench.length) ** 2
    shape /= at.weight @ shape
    if "loose_bolt" in planted:
        clamp, spread = bench.clamps[loose_clamp(bench)], bench.length / 10.0
        bell = np.exp(-0.5 * ((at.x - clamp.x) ** 2 + (at.y - clamp.y) ** 2) / spread**2)
        shape *= 1.0 - planted["loose_bolt"]["loss"] * bell
    for number, more in planted.get("clamp_forces", {}).items():
        clamp, spread = bench.clamps[int(number)], bench.length / 10.0
        shape *= 1.0 + more * np.exp(-0.5 * ((at.x - clamp.x) ** 2 + (at.y - clamp.y) ** 2) / spread**2)
    if "contact_patch" in planted:
        shape *= 1.0 + (planted["contact_patch"]["ratio"] - 1.0) * _disc(bench, at, planted["contact_patch"])
    return bench.pressure * shape


def _added_shear(bench: Bench, at: Points) -> list[Array]:
    """Return shear moduli over the plan beside the contact's, Pa."""
    planted, found = bench.planted, []
    if "contact_offset" in planted:
        found.append(np.full_like(at.x, planted["contact_offset"]["modulus"]))
    if "adhesive_edges" in planted:
        inside = np.abs(at.y) > bench.width * (0.5 - ADHESIVE_SHARE)
        found.append(planted["adhesive_edges"]["modulus"] * inside)
    if "glue_patch" in planted:
        one = planted["glue_patch"]
        inside = np.abs(at.x - one["x"] * bench.length / 2.0) < one["half"] * bench.length
        side = at.y > bench.width * (0.5 - ADHESIVE_SHARE)
        found.append(one["modulus"] * (inside & side))
    side = 0.5 * (bench.width - GRIP[1])
    seams = {
        "weld_seam": ((0.0, side), (0.0, -side)),
        "weld_seam_three": tuple((share * bench.length, side) for share in (-0.25, 0.0, 0.25)),
    }
    for key in seams.keys() & planted.keys():
        for x, y in seams[key]:
            inside = (np.abs(at.x - x) < GRIP[0] / 2.0) & (np.abs(at.y - y) < GRIP[1] / 2.0)
            area = bench.length * bench.width * float(at.weight @ inside)  # as the points see it
            found.append(planted[key]["shear"] / area * inside)
    return found


def _crack(bench: Bench, at: Points) -> list[Part]:
    """Return what the membrane stiffness loses."""
    if "crack" not in bench.planted:
        return []
    crack = bench.planted["crack"]
    x = at.x - crack["x"] * bench.length / 2.0
    planar = -crack["loss"] * _plateau(x, bench.length / 20.0, bench.length / 20.0)
    depth = bench.height * CRACKED_LAMINAS / bench.n_lamina
    return [Part(planar=planar, across=1.0 * (at.z > bench.height / 2.0 - depth))]


def _steel_patch(bench: Bench, at: Points) -> list[Part]:
    """Return what the membrane stiffness gains or loses in a disc through the upper half of the height."""
    if "steel_patch" not in bench.planted:
        return []
    one = bench.planted["steel_patch"]
    planar = (one["ratio"] - 1.0) * _disc(bench, at, one)
    return [Part(planar=planar, across=1.0 * (at.z > 0.0))]


def _disc(bench: Bench, at: Points, given: Mapping[str, float]) -> Array:
    """Return 1 within a radius, a share of the length, about a place (shares of half the sides); 0 beyond an edge."""
    x, y = given["x"] * bench.length / 2.0, given["y"] * bench.width / 2.0
    return _plateau(np.hypot(at.x - x, at.y - y), given["radius"] * bench.length, bench.length / 40.0)


def _plateau(x: Array, half: float, edge: float) -> Array:
    """Return 1 within +-half, 0 beyond half + edge, a cosine between."""
    beyond = np.clip((np.abs(x) - half) / edge, 0.0, 1.0)
    return 0.5 * (1.0 + np.cos(np.pi * beyond))


def loose_clamp(bench: Bench) -> int:
    """Return the number of the clamp whose bolt is loose."""
    return min(int(bench.planted["loose_bolt"]["clamp"] * len(bench.clamps)), len(bench.clamps) - 1)


@dataclass(frozen=True, kw_only=True)
class Gauge:
    """A weighted sum of one displacement component (0, 1, 2) over places (k, 3), m, with weights (k,)."""

    component: int
    place: Array
    weight: Array


@dataclass(frozen=True, kw_only=True)
class Attached:
    """What hangs on a gauge.

    Attributes
    ----------
    gauge : Gauge
        What it moves with.
    mass, stiffness, damping : float
        Of itself and to the ground: kg, N/m, N s/m, or kg m2 and so on about an axis.
    rider : float
        Mass (kg) that rides on the stiffness and damping, which then do not go to the ground; 0 without one.
    """

    gauge: Gauge
    mass: float = 0.0
    stiffness: float = 0.0
    damping: float = 0.0
    rider: float = 0.0


def attachments(bench: Bench) -> list[Attached]:
    """Return the clamps and all that is planted on them or at points."""
    planted, found = bench.planted, _clamps(bench)
    top, half = bench.height / 2.0, np.array([bench.length / 2.0, bench.width / 2.0])
    if "clamp_inertia_two" in planted:
        inertia, x = planted["clamp_inertia_two"]["inertia"], 0.4 * bench.length
        x *= planted["clamp_inertia_two"]["station"]
        found += [Attached(gauge=_roll(bench, at), mass=inertia) for at in (-x, x)]
    if "clamp_inertia_four" in planted:
        inertia = planted["clamp_inertia_four"]["inertia"]
        found += [Attached(gauge=_roll(bench, clamp.x), mass=inertia) for clamp in bench.clamps]
    if "stinger_mass" in planted:
        found += _pad_mass(bench, bench.shaker, planted["stinger_mass"]["mass"])
    if "stinger_spring" in planted:
        stiffness = planted["stinger_spring"]["stiffness"]
        found += [Attached(gauge=_pad(bench, axis, bench.shaker), stiffness=stiffness) for axis in (0, 1)]
    if "point_mass" in planted:
        one = planted["point_mass"]
        place = one.get("x", 1.0) * half[0], one.get("y", 1.0) * half[1], top
        found += _pad_mass(bench, place, one["mass"])
    if "absorber" in planted:
        one = planted["absorber"]
        omega = 2.0 * np.pi * one["frequency"]
        tuned = Attached(
            gauge=_pad(bench, 2, (one["x"] * half[0], one["y"] * half[1], top)),
            stiffness=one["mass"] * omega**2,
            damping=2.0 * one["damping"] * one["mass"] * omega,
            rider=one["mass"],
        )
        found.append(tuned)
    if "cable" in planted:
        one = planted["cable"]
        place = (one["x"] * half[0], one["y"] * half[1], top)
        found += _pad_mass(bench, place, one["mass"])
        found.append(Attached(gauge=_pad(bench, 2, place), stiffness=one["stiffness"], damping=one["damping"]))
    return found


def _clamps(bench: Bench) -> list[Attached]:
    """Return the clamps' masses in all directions, level by level; those of a loose bolt ride on springs."""
    more = bench.planted.get("clamp_mass", {}).get("mass", 0.0)
    found = []
    for number, clamp in enumerate(bench.clamps):
        loose = "loose_bolt" in bench.planted and number == loose_clamp(bench)
        for z, share in zip(*_rule(-bench.height / 2.0, bench.height / 2.0, LEVELS), strict=True):
            mass = share * (clamp.mass + more + planted_mass(bench, number))
            for gauge in (_mean(bench, clamp, z, axis) for axis in range(3)):
                if loose:
                    spring = share * bench.planted["loose_bolt"]["stiffness"]
                    found.append(Attached(gauge=gauge, stiffness=spring, rider=mass))
                else:
                    found.append(Attached(gauge=gauge, mass=mass))
    return found


def planted_mass(bench: Bench, number: int) -> float:
    """Return the mass, kg, that one clamp has beside its own: less than 0 where a part of it was taken away."""
    return bench.planted.get("clamp_masses", {}).get(str(number), 0.0)


def _pad(bench: Bench, component: int, place: tuple[float, float, float]) -> Gauge:
    """Return the mean displacement of the sheets that a thing at a point of either face holds."""
    side = PAD[0] / 2.0
    x, y = (
        _rule(float(middle) - side, float(middle) + side, 3)
        for middle in np.clip(place[:2], *np.array([[-0.5], [0.5]]) * [bench.length - PAD[0], bench.width - PAD[0]])
    )
    face = np.copysign(bench.height / 2.0, place[2])
    at, weight = _grid(x, y, _rule(face, face - np.copysign(PAD[1], face), 3))
    return Gauge(component=component, place=at, weight=weight)


def _pad_mass(bench: Bench, place: tuple[float, float, float], mass: float) -> list[Attached]:
    return [Attached(gauge=_pad(bench, axis, place), mass=mass) for axis in range(3)]


def _grid(*axes: tuple[Array, Array]) -> tuple[Array, Array]:
    """Return places (k, 3) and weights (k,) of a product of rules."""
    places = np.stack([g.ravel() for g in np.meshgrid(*(rule[0] for rule in axes), indexing="ij")], axis=1)
    weight = axes[0][1]
    for rule in axes[1:]:
        weight = np.multiply.outer(weight, rule[1])
    return places, weight.ravel()


def _rule(low: float, high: float, n: int) -> tuple[Array, Array]:
    """Return Gauss points between two places with weights that sum to 1."""
    at, weight = np.polynomial.legendre.leggauss(n)
    return 0.5 * (low + high) + 0.5 * (high - low) * at, weight / 2.0


def _mean(bench: Bench, clamp: Clamp, z: float, component: int) -> Gauge:
    """Return the mean displacement of a footprint at a level."""
    sides = zip((clamp.x, clamp.y), clamp.footprint, (bench.length / 2.0, bench.width / 2.0), strict=True)
    x, y = (_rule(max(middle - size / 2.0, -edge), min(middle + size / 2.0, edge), 6) for middle, size, edge in sides)
    place, weight = _grid(x, y, (np.array([z]), np.ones(1)))
    return Gauge(component=component, place=place, weight=weight)


def _roll(bench: Bench, x: float) -> Gauge:
    """Return the turn about x of a strip of both faces: the slope of the line over y that lies closest to w."""
    reach = bench.length / 2.0 - STRIP / 2.0
    middle = float(np.clip(x, -reach, reach))
    faces = (np.array([-0.5, 0.5]) * bench.height, np.array([0.5, 0.5]))
    strip = _rule(middle - STRIP / 2.0, middle + STRIP / 2.0, 6)
    place, weight = _grid(strip, _rule(-bench.width / 2.0, bench.width / 2.0, 6), faces)
    weight = weight * place[:, 1]
    return Gauge(component=2, place=place, weight=weight / (weight @ place[:, 1]))
