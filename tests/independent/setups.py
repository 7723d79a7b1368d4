"""Stacks of other dimensions, clamps and pressures than the shipped one, each with the way in which it is measured."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from tests.independent.campaign import SHAKER_PLACE, STACK, Configuration, Kind, Plan, draw

_OTHERS = Path(__file__).parent / "stacks"


@dataclass(frozen=True, kw_only=True)
class Setup:
    """A stack and how it is measured.

    Attributes
    ----------
    stack : Path
        Its file.
    shaker : (float, float)
        Place of the shaker along x and y, m.
    band : (float, float)
        Of the modes that are identified, Hz.
    configurations : tuple of Configuration
        Torques and pressures.
    """

    stack: Path
    shaker: tuple[float, float]
    band: tuple[float, float]
    configurations: tuple[Configuration, ...]

    def draw(self, seed: int, kind: Kind, model_key: str) -> Plan:
        """Return a test of this stack with all that is planted or disturbed drawn from the seed."""
        return replace(
            draw(seed, kind, model_key),
            stack=self.stack,
            shaker=self.shaker,
            band=self.band,
            configurations=self.configurations,
        )


def _torques(*kPa_and_Nm: tuple[float, float]) -> tuple[Configuration, ...]:
    return tuple(
        Configuration(name=f"M{i}", torque=torque, pressure=1e3 * pressure)
        for i, (pressure, torque) in enumerate(kPa_and_Nm, 1)
    )


SETUPS = {
    "shipped": Setup(
        stack=STACK, shaker=SHAKER_PLACE, band=(100.0, 1150.0), configurations=_torques((160.0, 1.5), (320.0, 3.0))
    ),
    "wide": Setup(
        stack=_OTHERS / "wide.toml",
        shaker=(-0.144, 0.0304),
        band=(100.0, 2600.0),
        configurations=_torques((200.0, 1.5), (400.0, 3.0)),
    ),
    "long": Setup(
        stack=_OTHERS / "long.toml",
        shaker=(-0.288, 0.0176),
        band=(60.0, 1000.0),
        configurations=_torques((120.0, 1.0), (250.0, 2.0), (400.0, 3.0)),
    ),
}
"""By name: eight to fourteen modes of the shipped stack; two clamps on a wide one, three torques of a long one."""
