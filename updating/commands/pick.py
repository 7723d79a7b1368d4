"""`lamella pick`: choose the poles of one configuration by clicks."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ema import read_campaign, read_measurement, stabilization
from ema.identification.poles_file import write_poles
from ema.plot.picking import pick_poles
from updating.commands.options import CampaignFile, Folder
from updating.commands.terminal import OUT
from updating.results.chosen_poles import keep_choice
from updating.results.store import folder_name

EXAMPLE = "lamella pick data/demo_stack/campaign.toml M1 -o out/demo"


def pick(
    campaign: CampaignFile,
    configuration: Annotated[
        str,
        typer.Argument(metavar="CONFIGURATION", help="Its name in the campaign file.", show_default=False),
    ],
    output: Folder,
) -> None:
    """Choose the poles of one configuration by clicks in its stabilisation chart.

    A left click adds the nearest pole, a right click takes one away; closing the window writes poles.txt, and every
    later command on these results identifies with them. Needs a display; without one, edit poles.txt with any editor
    and run **lamella ema ... --poles DIR**.
    """
    OUT.print(f"Poles: {choose_poles(campaign, configuration, output)}")


def choose_poles(campaign_file: Path, configuration: str, output: Path) -> Path:
    """Let the user choose the poles of one configuration in its stabilisation chart and write poles.txt."""
    campaign = read_campaign(campaign_file)
    frf = read_measurement(campaign, configuration).frf
    options = campaign.identification
    lines = frf if options.band is None else frf.band(*options.band)
    diagram = stabilization(lines) if options.order is None else stabilization(lines, order=options.order)
    chosen = pick_poles(diagram)
    path = output / folder_name(configuration) / "poles.txt"
    write_poles(path, chosen)
    keep_choice(path, path.parent)
    return path
