"""`lamella demo`: the whole path on the shipped campaign."""

from __future__ import annotations

from pathlib import Path

from updating.commands.fit import fit
from updating.commands.options import Folder

EXAMPLE = "lamella demo"


def demo(output: Folder = Path("out/demo")) -> None:
    """Run the whole path on the shipped campaign data/demo_stack: identify, fit, report.

    Run it in the folder of the source checkout, where data/ is.
    """
    fit(Path("data/demo_stack/campaign.toml"), output)
