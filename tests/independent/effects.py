"""What can be planted on a bench: a table of descriptions and strengths, without any physics.

Every second model realises every key in its own way. Places are shares of the half length (`x`) and half width (`y`),
so -1 and 1 are the edges; "top" is the face at z = +height / 2. Strengths are such that frequencies move by about 0.5
to 10 % or damping by 10 to 100 %; one draw in twenty is ten times weaker.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

Kind = Literal["same", "other form", "lacking"]
Scale = Literal["log", "ratio", "lin"]

SMALL_SHARE = 0.05
"""Share of the draws that are too weak to matter."""
SMALL_FACTOR = 0.1
"""What a strength is multiplied by in these."""
PRESSURE_REFERENCE = 320e3
"""Pressure, Pa, at which `pressure_exponent` changes nothing."""
PAD = (0.024, 0.016)
"""Side of the square and depth, m, over which a thing at a point holds the sheets; less would give way by itself."""
STRIP = 0.04
"""Length along x, m, of the strip that a bar of a clamp covers, over the whole width."""
CRACKED_LAMINAS = 20
"""Sheets that `crack` goes through, counted from the top."""


@dataclass(frozen=True, kw_only=True)
class Range:
    """Values that a parameter is drawn from.

    Attributes
    ----------
    lower, upper : float
        SI unit of the parameter. Of a ratio: the values farthest from 1.
    scale : "log", "ratio" or "lin"
        Log-uniform; a factor about 1, the size of whose logarithm is log-uniform from `least` on, to either side; or
        uniform, for places and the like, which small draws do not shrink.
    least : float
        Smallest size of the logarithm of a ratio.
    """

    lower: float
    upper: float
    scale: Scale = "log"
    least: float = 0.05

    def draw(self, rng: np.random.Generator, factor: float = 1.0) -> float:
        """Return a value whose strength is `factor` times one of the range."""
        if self.scale == "lin":
            return float(rng.uniform(self.lower, self.upper))
        if self.scale == "log":
            return float(factor * np.exp(rng.uniform(np.log(self.lower), np.log(self.upper))))
        ends = [end for end in (np.log(self.lower), np.log(self.upper)) if abs(end) > self.least]
        end = float(rng.choice(ends))
        size = np.exp(rng.uniform(np.log(self.least), np.log(abs(end))))
        return float(np.exp(factor * np.sign(end) * size))


@dataclass(frozen=True, kw_only=True)
class Plantable:
    """An effect that second models can have.

    Attributes
    ----------
    catalogue : str or None
        The effect of Lamella's catalogue that it is, or that is meant to stand for it.
    kind : "same", "other form" or "lacking"
        Whether the catalogue has it, has it in another form, or has nothing of the kind.
    parameters : dict of Range
        By name.
    description : str
        One line of physics, all that the second models have in common.
    """

    catalogue: str | None
    kind: Kind
    parameters: dict[str, Range]
    description: str


_PLACE = {"x": Range(lower=-0.9, upper=0.9, scale="lin"), "y": Range(lower=-0.9, upper=0.9, scale="lin")}

SAME = {
    "clamp_mass": Plantable(
        catalogue="clamp_mass",
        kind="same",
        parameters={"mass": Range(lower=0.08, upper=1.2)},
        description="each clamp is heavier by `mass` (kg), which moves as the clamp's own mass does",
    ),
    "clamp_inertia_two": Plantable(
        catalogue="clamp_inertia",
        kind="same",
        parameters={"inertia": Range(lower=3e-4, upper=6e-3), "station": Range(lower=0.1, upper=0.9, scale="lin")},
        description="rotary inertia (kg m2, each) about x at x = +-0.4 `station` length: bars on both faces over STRIP "
        "by the width turn as rigid bodies with the slope dw/dy of the faces under them",
    ),
    "contact_direction": Plantable(
        catalogue="contact_direction",
        kind="same",
        parameters={"ratio": Range(lower=0.4, upper=2.5, scale="ratio", least=0.1)},
        description="contact shear modulus G_yz = `ratio` G_xz, with G_xz as it was; damping follows",
    ),
    "pressure_exponent": Plantable(
        catalogue="pressure_exponent",
        kind="same",
        parameters={"exponent": Range(lower=0.2, upper=1.3, scale="ratio", least=0.06)},
        description="contact shear modulus G_f p_ref (p / p_ref)**`exponent`, p_ref = PRESSURE_REFERENCE",
    ),
    "contact_offset": Plantable(
        catalogue="contact_offset",
        kind="same",
        parameters={"modulus": Range(lower=5e6, upper=6e7)},
        description="contact shear modulus G_f p + `modulus` (Pa), which has no viscous loss of its own",
    ),
    "lost_contact_middle": Plantable(
        catalogue="lost_contact_middle",
        kind="same",
        parameters={"loss": Range(lower=0.08, upper=0.75)},
        description="pressure times 1 - `loss` exp(-(x / (length / 6))**2 / 2), scaled back to its mean",
    ),
    "lost_contact_ends": Plantable(
        catalogue="lost_contact_ends",
        kind="same",
        parameters={"loss": Range(lower=0.15, upper=0.9)},
        description="pressure times 1 - `loss` (2 x / length)**2, scaled back to its mean",
    ),
    "normal_stiffness": Plantable(
        catalogue="normal_stiffness",
        kind="same",
        parameters={"ratio": Range(lower=0.2, upper=5.0, scale="ratio", least=0.4)},
        description="modulus along z times `ratio`, its loss too",
    ),
    "stinger_mass": Plantable(
        catalogue="stinger_mass",
        kind="same",
        parameters={"mass": Range(lower=0.02, upper=0.15)},
        description="mass (kg) of the force cell on a PAD at the shaker's point, which moves with it in all directions",
    ),
    "stinger_spring": Plantable(
        catalogue="stinger_stiffness",
        kind="same",
        parameters={"stiffness": Range(lower=3e4, upper=5e5)},
        description="springs (N/m) to the ground along x and y on a PAD at the shaker's point; the axial one is "
        "decoupled",
    ),
    "contact_loss": Plantable(
        catalogue="contact_loss",
        kind="same",
        parameters={"eta": Range(lower=2.5e-4, upper=2.5e-3)},
        description="hysteretic loss factor `eta` of the shear contact, beside the viscous one",
    ),
    "steel_orthotropy": Plantable(
        catalogue="steel_orthotropy",
        kind="same",
        parameters={"ratio": Range(lower=0.75, upper=1.5, scale="ratio", least=0.1)},
        description="Young's modulus of the sheets along y over that along x, which stays",
    ),
    "height_gradient": Plantable(
        catalogue="height_gradient",
        kind="same",
        parameters={"excess": Range(lower=0.2, upper=0.9)},
        description="pressure times 1 + `excess` 2 z / height",
    ),
    "weld_seam": Plantable(
        catalogue="weld_seam",
        kind="same",
        parameters={"shear": Range(lower=3e4, upper=6e5)},
        description="a seam down both long side faces at x = 0 that resists the contact's shear strains, G A = `shear` "
        "(N) each, and grips about 40 x 12 mm of the sheets",
    ),
}
OTHER_FORM = {
    "clamp_inertia_four": Plantable(
        catalogue="clamp_inertia",
        kind="other form",
        parameters={"inertia": Range(lower=1.5e-4, upper=3e-3)},
        description="as clamp_inertia_two, but at each clamp of the bench",
    ),
    "lost_contact_patch": Plantable(
        catalogue="lost_contact_middle",
        kind="other form",
        parameters={"loss": Range(lower=0.08, upper=0.5)},
        description="pressure times 1 - `loss` on |x| < length / 10 with a cosine edge of length / 20 beyond, "
        "scaled back to its mean",
    ),
    "weld_seam_three": Plantable(
        catalogue="weld_seam",
        kind="other form",
        parameters={"shear": Range(lower=3e4, upper=6e5)},
        description="as weld_seam, but three seams down the face y = +width / 2, at x = 0 and +-length / 4",
    ),
    "adhesive_edges": Plantable(
        catalogue="adhesive_edges",
        kind="other form",
        parameters={"modulus": Range(lower=5e6, upper=1.2e8)},
        description="glue adds `modulus` (Pa) to the shear modulus within a tenth of the width of both long edges; "
        "the catalogue lets it fade exponentially",
    ),
}
# What the catalogue lacked when cases of that kind were first drawn; it has three of them, in another form, since.
LACKING = {
    "absorber": Plantable(
        catalogue=None,
        kind="lacking",
        parameters={
            "mass": Range(lower=0.1, upper=0.5),
            "frequency": Range(lower=200.0, upper=900.0, scale="lin"),
            "damping": Range(lower=0.005, upper=0.05, scale="lin"),
            **_PLACE,
        },
        description="mass (kg) on a spring and dashpot along z on a PAD of the top face, tuned to `frequency` (Hz) on "
        "a held base",
    ),
    "crack": Plantable(
        catalogue=None,
        kind="lacking",
        parameters={"loss": Range(lower=0.5, upper=0.97), "x": Range(lower=-0.6, upper=0.6, scale="lin")},
        description="the in-plane stiffness of the CRACKED_LAMINAS top sheets falls by `loss` over length / 10 about "
        "x, with cosine edges of length / 20 beyond",
    ),
    "loose_bolt": Plantable(
        catalogue="loose_clamp",
        kind="other form",
        parameters={
            "loss": Range(lower=0.1, upper=0.6),
            "stiffness": Range(lower=3e7, upper=3e8, scale="lin"),
            "clamp": Range(lower=0.0, upper=1.0, scale="lin"),
        },
        description="one clamp (share of their number, rounded down) presses less: pressure times 1 - `loss` times a "
        "bell of standard deviation length / 10 about it, not scaled back, and its mass rides on springs "
        "(N/m along each axis) on its footprint",
    ),
    "cable": Plantable(
        catalogue=None,
        kind="lacking",
        parameters={
            "mass": Range(lower=0.05, upper=0.15),
            "stiffness": Range(lower=3e4, upper=1e6),
            "damping": Range(lower=5.0, upper=60.0),
            **_PLACE,
        },
        description="mass (kg, all directions) of a cable on a PAD of the top face, held to the ground along z by a "
        "spring (N/m) and a dashpot (N s/m)",
    ),
    "soft_side": Plantable(
        catalogue="pressure_across",
        kind="other form",
        parameters={"loss": Range(lower=0.08, upper=0.5)},
        description="contact shear modulus softer by `loss` where y > 0",
    ),
    "point_mass": Plantable(
        catalogue="added_mass",
        kind="other form",
        parameters={"mass": Range(lower=0.05, upper=0.3)},
        description="mass (kg) glued to a PAD in the top corner at x = +length / 2, y = +width / 2; moves in all "
        "directions",
    ),
}
TABLE: dict[str, Plantable] = {**SAME, **OTHER_FORM, **LACKING}
"""All that can be planted, by key."""


def draw_strength(rng: np.random.Generator, key: str) -> dict[str, float]:
    """Return values of the parameters of an effect; one draw in twenty is weak."""
    factor = SMALL_FACTOR if rng.random() < SMALL_SHARE else 1.0
    return {name: one.draw(rng, factor) for name, one in TABLE[key].parameters.items()}
