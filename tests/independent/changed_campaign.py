"""Two campaigns with a change between a state and its reference, which the solid second model simulates.

python -m tests.independent.changed_campaign data/hidden_effect
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path

from tests.independent.bench import Planted
from tests.independent.campaign import Configuration, Plan
from tests.independent.changes import States, Workshop
from tests.independent.demo_campaign import write_demo
from tests.independent.solid import Solid

BEFORE, CONTROL, AFTER = ("before", "before_again"), "control", "after"
"""States by name, each assembled anew: reference and its repeat, one that has not changed, and the changed one."""
CHANGES: Mapping[str, tuple[int, str, Planted]] = {
    "change_a": (66_101, "What did the transport do?", {"loose_bolt": {"loss": 0.25, "stiffness": 3e8, "clamp": 0.9}}),
    "change_b": (66_102, "What did the repair do?", {"glue_patch": {"x": 0.45, "half": 0.1, "modulus": 3e8}}),
}


def plan_of(seed: int) -> Plan:
    """Return how a campaign is measured."""
    return Plan(
        seed=seed,
        model_key="solid",
        kind="lacking",
        configurations=(Configuration(name=BEFORE[0], torque=3.0, pressure=320e3),),
        band=(330.0, 1250.0),
        step=1.0,
        force_noise=1e-3,
        response_noise=1e-3,
    )


def with_references(text: str) -> str:
    """Return a campaign file in which states name what they are compared with and what they repeat."""
    for name, line in (
        (BEFORE[1], f'repeat_of = "{BEFORE[0]}"'),
        (CONTROL, f'compare_to = "{BEFORE[0]}"'),
        (AFTER, f'compare_to = "{BEFORE[0]}"'),
    ):
        text = text.replace(f'name = "{name}"\n', f'name = "{name}"\n{line}\n')
    return text


def main(folder: Path) -> None:
    """Write both campaigns."""
    names = (*BEFORE, CONTROL, AFTER)
    for key, (seed, title, planted) in CHANGES.items():
        states = States(plan=plan_of(seed), model=Solid(), shop=Workshop(torque=0.003, clamp=0.005, contact=0.003))
        write_demo(states.simulated(names, {AFTER: planted}), folder / key, title, compact=True)
        file = folder / key / "campaign.toml"
        file.write_text(with_references(file.read_text(encoding="utf-8")), encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
