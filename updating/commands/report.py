"""The commands that show results: the report, shapes of one configuration, the workbench.

What draws and serves is imported once there is something to show: it takes most of a second to load.
"""

from __future__ import annotations

import webbrowser
from collections.abc import Sequence
from pathlib import Path

from ema.types.arrays import single_threaded
from updating.commands.terminal import OUT, Run
from updating.errors import StoreError
from updating.report.results import read_results
from updating.results.identified import forget_choices
from updating.results.store import write_bytes


@single_threaded
def report_command(folder: Path, *, pdf: bool, pptx: bool, gif: bool, only: Sequence[str], keep: bool) -> None:
    """Make the report of a folder in the forms that are asked for, and say where they are."""
    with OUT.status("drawing"):
        from updating.report.files import find_browser, print_pdf, write_gifs, write_slides
        from updating.report.results import with_models

        page = make_report(folder, keep=keep, only=only)
    results = with_models(read_results(folder, keep=keep))
    for sentence in results.remarks:
        OUT.print(sentence)
    OUT.print(f"Report: {page}")
    if pdf:
        OUT.print(f"PDF: {print_pdf(page)}, printed by {find_browser()}", soft_wrap=True)
    if pptx:
        OUT.print(f"Slides: {write_slides(results)}")
    if gif:
        OUT.print(f"{len(write_gifs(results))} moving shapes: {folder / 'figures'}")


def make_report(folder: Path, *, keep: bool = False, only: Sequence[str] = ()) -> Path:
    """Make the page of a results folder, its configurations in parallel; the rest as in `write_report`."""
    from updating.report.page import write_report
    from updating.workers.workers import workers

    with workers(len(list(folder.glob("*/modal_model.json")))) as executor:
        return write_report(folder, executor, keep=keep, only=only)


@single_threaded
def view_command(folder: Path, configuration: str | None) -> None:
    """Show mode shapes and stabilisation chart of a configuration, by default the first, as a page in the browser."""
    from updating.report.frf_part import frf_section
    from updating.report.modes_part import shape_section
    from updating.report.page import render

    results = read_results(folder)
    names = [t.name for t in results.tested]
    if not names:
        raise StoreError(
            f"{folder}: a table of modes has no shapes to view; make its page with: lamella report {folder}"
        )
    if configuration is not None and configuration not in names:
        raise StoreError(f"{folder}: no configuration {configuration!r}; there are {', '.join(names)}")
    tested = results.tested[0 if configuration is None else names.index(configuration)]
    page = folder / "view.html"
    parts = (shape_section(tested), frf_section(tested))
    write_bytes(page, render(f"{results.name}: {tested.name}", parts).encode())
    webbrowser.open(page.resolve().as_uri())
    OUT.print(f"Page: {page}")


@single_threaded
def open_command(path: Path, output: Path | None, port: int, *, browser: bool, identify_anew: bool) -> None:
    """Serve the workbench of a folder, a campaign or its results until Ctrl-C."""

    def make(campaign: Path, folder: Path) -> None:
        from updating.commands.fit import fit_campaign

        for _ in fit_campaign(Run(campaign=campaign, output=folder)):
            pass

    def ready(address: str) -> None:
        OUT.print(f"Workbench: {address}", soft_wrap=True)
        OUT.print("It shows what others must not see to whoever has this address. Ctrl-C ends it.")

    from updating.workbench.opened import find

    opened = find(path, output, make)
    from updating.workbench.server import serve  # with all of its panels, once there is something to show

    if identify_anew:
        forget_choices(opened.folder)
        make(opened.campaign, opened.folder)
    serve(opened, port=port, ready=ready, show=browser)
