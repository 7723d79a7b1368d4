"""Campaigns of six specimens on one rig that the layered model simulates, as tables of modes with shapes.

python -m tests.independent.pooled_campaign data/hidden_effect
"""

from __future__ import annotations

import csv
import dataclasses
import json
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from tests.independent.bench import Planted, SecondModel
from tests.independent.campaign import (
    SENSORS,
    SHAKER,
    STACK,
    ModalTable,
    Plan,
    Simulated,
    modal_tables,
    simulate,
    truth,
    write_points,
)
from tests.independent.layered import Layered

BAND = (100.0, 1150.0)
N_SPECIMEN = 6
_STEP = 25.0
"""Hz, of FRFs that nobody reads: modes are written as they are identified."""
_HEIGHTS = (-0.13, 0.05, 0.18, -0.04, 0.1, -0.19)
"""Heights of the specimens over that of the stack file, mm."""


@dataclass(frozen=True, kw_only=True)
class PooledPlan:
    """A campaign to be simulated.

    Attributes
    ----------
    seed : int
        Of the first specimen; the others follow.
    name : str
        Of the campaign.
    rig : dict
        Effects that all specimens have.
    own : dict of int to dict
        Effects of single specimens.
    treated : tuple of int
        Specimens that have a treatment.
    treatment : dict
        Effects that these have.
    stack : Path
        Stack file of the rig.
    tolerances : dict
        Standard deviations that differ from those of `campaign.Tolerances`.
    """

    seed: int
    name: str
    rig: Planted = field(default_factory=dict)
    own: Mapping[int, Planted] = field(default_factory=dict)
    treated: tuple[int, ...] = ()
    treatment: Planted = field(default_factory=dict)
    stack: Path = STACK


CAMPAIGNS = {
    "pooled_a": PooledPlan(
        seed=8100,
        name="Six stacks on one rig",
        rig={"clamp_mass": {"mass": 0.5}},
        own={4: {"adhesive_edges": {"modulus": 4.5e7}}},
        treated=(1, 2, 5),
    ),
    "pooled_b": PooledPlan(
        seed=8200,
        name="Six stacks, three of them lacquered",
        treated=(0, 3, 4),
        treatment={"pressure_exponent": {"exponent": 0.55}},
    ),
}


def planted(plan: PooledPlan, specimen: int) -> dict[str, Mapping[str, float]]:
    """Return all that a specimen has."""
    treatment = plan.treatment if specimen in plan.treated else {}
    return {**plan.rig, **treatment, **plan.own.get(specimen, {})}


def simulate_specimen(plan: PooledPlan, specimen: int, second_model: SecondModel) -> Simulated:
    """Return one specimen as simulated; its stack file has its own height."""
    text = plan.stack.read_text(encoding="utf-8")
    line = next(one for one in text.splitlines() if one.startswith("height_mm"))
    height = float(line.partition("=")[2].partition("#")[0]) + _HEIGHTS[specimen]
    with tempfile.TemporaryDirectory() as folder:
        stack = Path(folder) / "stack.toml"
        stack.write_text(text.replace(line, f"height_mm = {height:.2f}"), encoding="utf-8")
        one = Plan(
            seed=plan.seed + specimen,
            model_key="layered",
            kind="single",
            planted=planted(plan, specimen),
            stack=stack,
            band=BAND,
            step=_STEP,
        )
        return simulate(one, second_model)


def write_pooled(plan: PooledPlan, folder: Path, second_model: SecondModel) -> None:
    """Write the campaign with its stack, points, tables of modes and shapes, and truth."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "stack.toml").write_text(plan.stack.read_text(encoding="utf-8"), encoding="utf-8")
    true, text = [], [_head(plan)]
    for specimen in range(N_SPECIMEN):
        made = simulate_specimen(plan, specimen, second_model)
        name = f"S{specimen + 1}"
        if specimen == 0:
            write_points(made, folder / "points.csv")
        text.append(_specimen_text(plan, specimen, made))
        (folder / name).mkdir(exist_ok=True)
        for table in modal_tables(made):
            _write_table(folder / name / table.configuration.name, table)
        one = truth(made)
        for configuration in one["configurations"]:  # type: ignore[attr-defined]  # a list, as `truth` makes it
            del configuration["shape"]
        true.append({"name": name, **one})
    (folder / "campaign.toml").write_text("\n".join(text), encoding="utf-8")
    given = {name: value for name, value in dataclasses.asdict(plan).items() if name != "stack"}
    (folder / "truth.json").write_text(json.dumps({"plan": given, "specimens": true}), encoding="utf-8")


def _head(plan: PooledPlan) -> str:
    return f"""# Six specimens on one rig at two bolt torques; their modes were identified before.
[campaign]
name = "{plan.name}"

[structure]
stack = "stack.toml"            # the rig, and what specimens do not state themselves

[points]
file = "points.csv"
unit = "mm"
"""


def _specimen_text(plan: PooledPlan, specimen: int, made: Simulated) -> str:
    name, height = f"S{specimen + 1}", 2e3 * made.nominal[1, 2]
    treatment = "lacquered" if specimen in plan.treated else "none"
    maker = "AB"[specimen % 2]
    text = f"""[[specimen]]
name = "{name}"
height_mm = {abs(height):.2f}
notes = {{treatment = "{treatment}", manufacturer = "{maker}", date = "2026-03-{10 + specimen:02d}"}}
"""
    for one in made.plan.configurations:
        text += f"""
[[specimen.configuration]]
name = "{one.name}"
torque_Nm = {one.torque:g}
pressure_kPa = {1e-3 * one.pressure:g}
modes = "{name}/{one.name}_modes.csv"
shapes = "{name}/{one.name}_shapes.csv"
force = "{SHAKER}+z"
"""
    return text


def _write_table(stem: Path, table: ModalTable) -> None:
    """Write modes and shapes, six digits each."""
    largest = np.abs(table.shape).max(axis=0)
    shape = table.shape / largest
    rms = np.sqrt(np.mean(table.shape**2, axis=0))
    relative = table.shape_std[0] / rms
    modes = zip(table.frequency, table.frequency_std, table.damping, table.damping_std, relative, strict=True)
    header = ["mode", "frequency_Hz", "frequency_std_Hz", "damping", "damping_std", "shape_std"]
    _write(stem.with_name(f"{stem.name}_modes.csv"), header, ([r, *one] for r, one in enumerate(modes, 1)))
    names = [f"mode_{r}_{part}" for r in range(1, shape.shape[1] + 1) for part in ("real", "imag")]
    rows = (
        [node + 1, node % SENSORS, 0, 0, 1, *(part for value in one for part in (float(value), 0))]
        for node, one in enumerate(shape)
    )
    _write(stem.with_name(f"{stem.name}_shapes.csv"), ["node", "sensor", "x", "y", "z", *names], rows)


def _write(path: Path, header: list[str], rows: object) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(header)
        for row in rows:  # type: ignore[attr-defined]  # an iterable of rows
            writer.writerow([f"{cell:.7g}" if isinstance(cell, float) else cell for cell in row])


if __name__ == "__main__":
    for key, plan in CAMPAIGNS.items():
        write_pooled(plan, Path(sys.argv[1]) / key, Layered())
