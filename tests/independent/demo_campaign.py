"""Campaigns that the layered model simulates, as universal files: that of the demo, and one that ends in *one of*.

python -m tests.independent.demo_campaign data/demo_diagnosis data/hidden_effect/open
"""

from __future__ import annotations

import json
import shutil
import sys
from pathlib import Path

import numpy as np
import pyuff
from numpy.typing import NDArray

from tests.independent.bench import Array
from tests.independent.campaign import SENSORS, SHAKER, Plan, Simulated, campaign_text, simulate, truth, write_points
from tests.independent.layered import Layered

PLAN = Plan(
    seed=20,
    model_key="layered",
    kind="single",
    planted={"lost_contact_middle": {"loss": 0.45}},
    band=(100.0, 1150.0),
    force_noise=5e-3,
    response_noise=5e-3,
)
"""Noise of half a per cent of the force and of each response, sensors of 2 g that rove, and all tolerances."""

OPEN = Plan(
    seed=31,
    model_key="layered",
    kind="single",
    planted={"contact_loss": {"eta": 0.0016}},
    band=(150.0, 780.0),
    force_noise=2e-3,
    response_noise=2e-3,
)
"""A loss in the contact at two torques: what stiffens with frequency does the same to these modes."""
PLANS = {"demo_diagnosis": (PLAN, "Stack with a hidden effect"), "open": (OPEN, "A loss that two torques cannot name")}


def write_demo(simulated: Simulated, folder: Path, name: str, *, compact: bool = False) -> None:
    """Write the campaign with its stack, points, FRFs (dataset 58b, without abscissae if `compact`) and truth."""
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(simulated.plan.stack, folder / "stack.toml")
    write_points(simulated, folder / "points.csv")
    for configuration, frf in zip(simulated.plan.configurations, simulated.frf, strict=True):
        (folder / configuration.name).mkdir(exist_ok=True)
        for run, functions in enumerate(frf):
            file = folder / configuration.name / f"run_{run + 1:02d}.uff"
            file.unlink(missing_ok=True)
            sets = [one | {"abscissa_spacing": int(compact)} for one in _sets(simulated.frequency, functions, run)]
            pyuff.UFF(str(file)).write_sets(sets, mode="add")
    text = campaign_text(simulated, name=name, suffix="uff")
    (folder / "campaign.toml").write_text(text, encoding="utf-8")
    (folder / "truth.json").write_text(json.dumps(truth(simulated)), encoding="utf-8")


def _sets(frequency: Array, functions: NDArray[np.complex128], run: int) -> list[dict[str, object]]:
    """Return the accelerances of a run's sensors as datasets 58 in single precision."""
    common = {
        "type": 58,
        "binary": 1,
        "func_type": 4,
        "rsp_dir": 3,
        "ref_node": SHAKER,
        "ref_dir": 3,
        "ord_data_type": 5,
        "abscissa_spec_data_type": 18,
        "ordinate_spec_data_type": 12,
        "orddenom_spec_data_type": 13,
        "x": frequency,
    }
    return [
        common
        | {
            "rsp_node": SENSORS * run + sensor + 1,
            "data": value.astype(np.complex64),
            "id1": f"run {run + 1}, sensor {sensor + 1}",
        }
        for sensor, value in enumerate(functions)
    ]


if __name__ == "__main__":
    for place in map(Path, sys.argv[1:]):
        plan, title = PLANS[place.name]
        write_demo(simulate(plan, Layered()), place, title)
