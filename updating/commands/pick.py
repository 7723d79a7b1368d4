"""`lamella pick`: choose the poles of one configuration by clicks."""

from __future__ import annotations

from pathlib import Path

from ema import read_campaign, read_measurement, stabilization
from ema.identification.exchange import write_poles
from ema.plot.figures import pick_poles
from ema.types.threads import single_threaded
from updating.commands.terminal import OUT
from updating.results.chosen_poles import keep_choice
from updating.results.store import folder_name


@single_threaded
def pick_command(campaign: Path, configuration: str, output: Path) -> None:
    """Let the user choose the poles of one configuration, and say where they are."""
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
