"""`lamella report`: make one page of the results in a folder."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ema.types.threads import single_threaded
from updating.commands.terminal import OUT
from updating.report.identified_model import with_models
from updating.report.moving import write_gifs
from updating.report.page import write_report
from updating.report.pdf import find_browser, print_pdf
from updating.report.results import read_results
from updating.report.slides import write_slides
from updating.workers.workers import workers


@single_threaded
def report_command(
    folder: Path, *, pdf: bool, pptx: bool, gif: bool, only: Sequence[str], keep: bool
) -> None:
    """Make the report of a folder in the forms that are asked for, and say where they are."""
    with OUT.status("drawing"):
        page = make_report(folder, keep=keep, only=only)
    results = with_models(read_results(folder, keep=keep))
    for sentence in results.remarks:
        OUT.print(sentence, highlight=False)
    OUT.print(f"Report: {page}")
    if pdf:
        OUT.print(f"PDF: {print_pdf(page)}, printed by {find_browser()}", soft_wrap=True)
    if pptx:
        OUT.print(f"Slides: {write_slides(results)}")
    if gif:
        OUT.print(f"{len(write_gifs(results))} moving shapes: {folder / 'figures'}")


def make_report(folder: Path, *, keep: bool = False, only: Sequence[str] = ()) -> Path:
    """Make the page of a results folder, its configurations in parallel; the rest as in `write_report`."""
    with workers(len(list(folder.glob("*/modal_model.json")))) as executor:
        return write_report(folder, executor, keep=keep, only=only)
