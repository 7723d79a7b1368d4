"""Reproduce the published campaign of 18 stacks and go beyond it: `python -m tests.studies.published -o DIR`.

Written for each calibration of planform and clamps: what is fitted, Tables 6 and 7 and figures 12 to 16 beside ours,
the error with effects that all stacks share, also with each stack left out in turn, how contact stiffness grows with
pressure, and what treatments change. A calibration takes some minutes.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from ema.types.arrays import single_threaded
from tests.studies.published.campaign import CALIBRATIONS
from tests.studies.published.results import reproduce_campaign
from tests.studies.published.tables import summary_table
from updating.commands.terminal import OUT

TABLES = Path(__file__).parents[3] / "data/pirnat2013"


@single_threaded
def main() -> None:
    """Reproduce what the arguments ask for, and print how far it is off."""
    parser = argparse.ArgumentParser(prog="python -m tests.studies.published", description=__doc__)
    parser.add_argument("-o", "--output", type=Path, required=True, help="folder of the results")
    parser.add_argument("--calibration", action="append", choices=CALIBRATIONS, help="by default each in turn")
    parser.add_argument("--effect", action="append", help="effects that all stacks share; by default clamp_inertia")
    asked = parser.parse_args()
    effects = asked.effect or ["clamp_inertia"]
    results = reproduce_campaign(TABLES, asked.calibration or CALIBRATIONS, effects, asked.output, OUT)
    OUT.print(summary_table(results))
    OUT.print(f"Results in {asked.output}")


if __name__ == "__main__":
    main()
