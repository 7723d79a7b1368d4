"""`lamella open`: results in the browser, with hands on them."""

from __future__ import annotations

from pathlib import Path

from ema.types.threads import single_threaded
from updating.commands.fit import fit_campaign
from updating.commands.terminal import OUT
from updating.results.chosen_poles import forget_choices
from updating.workbench.opened import find
from updating.workbench.server import serve

_LEAST_MAC = 0.8


@single_threaded
def open_command(path: Path, output: Path | None, port: int, *, browser: bool, identify_anew: bool) -> None:
    """Serve the workbench of a folder, a campaign or its results until Ctrl-C."""

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
