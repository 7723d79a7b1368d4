"""`lamella open`: results in the browser, with hands on them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from updating.commands.fit import fit_campaign
from updating.commands.options import IdentifyAnew
from updating.commands.terminal import OUT
from updating.results.chosen_poles import forget_choices
from updating.workbench.opened import find
from updating.workbench.server import serve

EXAMPLE = "lamella open out/demo"
_LEAST_MAC = 0.8


def open_(
    path: Annotated[
        Path,
        typer.Argument(
            metavar="PATH", help="Folder of results, campaign file, or folder with a campaign.toml."
        ),
    ] = Path(),
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="DIR",
            help="Folder for the results of a campaign; out/ and the name of its folder by default.",
            show_default=False,
        ),
    ] = None,
    port: Annotated[int, typer.Option(min=0, max=65535, help="Where to listen; 0 for any that is free.")] = 0,
    browser: Annotated[
        bool, typer.Option("--browser/--no-browser", help="Open the browser, or print the address alone.")
    ] = True,
    identify_anew: IdentifyAnew = False,
) -> None:
    """Open a workbench in the browser: points and functions, both shapes of any MAC, sliders for every parameter.

    It listens on this machine alone, at an address with a token that changes every time, and needs no network. A
    campaign without results is identified and fitted first. Ctrl-C ends it.
    """

    def make(campaign: Path, folder: Path) -> None:
        for _ in fit_campaign(campaign, folder, _LEAST_MAC, OUT):
            pass

    def ready(address: str) -> None:
        OUT.print(f"Workbench: {address}", soft_wrap=True)
        OUT.print("It shows what others must not see to whoever has this address. Ctrl-C ends it.")

    opened = find(path, output, make)
    if identify_anew:
        forget_choices(opened.folder)
        make(opened.campaign, opened.folder)
    serve(opened, port=port, ready=ready, show=browser)
