"""Many specimens on one rig: what `lamella diagnose` does with a campaign file that lists them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.table import Table

from model import catalogue
from updating.commands.terminal import progress
from updating.diagnosis.cached_model import cached_model
from updating.diagnosis.scatter_file import read_scatter
from updating.pooled.beside import MESSAGES
from updating.pooled.campaign_file import read_specimens, specimens_of
from updating.pooled.diagnosis import diagnose_specimens
from updating.results.identified import assignments, every_identified
from updating.results.pooled_answer import PooledDiagnosis
from updating.results.pooled_text import SPECIMEN_HEADER, explanation_text, specimen_row
from updating.results.store import kept
from updating.workers.workers import workers

_MOST_EXPLANATIONS = 8


def diagnose_pooled(
    campaign_file: Path,
    output: Path,
    effect_files: Sequence[Path],
    console: Console,
    *,
    scatter_file: Path | None = None,
) -> PooledDiagnosis:
    """Diagnose all specimens of a campaign together, and write pooled_diagnosis.json.

    What an earlier run left is read back.
    """
    known = catalogue(effect_files)
    scatter = None if scatter_file is None else read_scatter(scatter_file)
    campaign = read_specimens(campaign_file)
    measured = campaign.measured
    tests = () if measured is None else every_identified(assignments(measured, output), "identify", console)
    of = {own.configuration.name: own.modal_model for own in tests}
    specimens = specimens_of(campaign, of.__getitem__)

    def make() -> PooledDiagnosis:
        with workers(MESSAGES) as executor, progress("diagnose", console):
            return diagnose_specimens(
                campaign.name, specimens, known, scatter=scatter, executor=executor, reduced=cached_model
            )

    stated = () if scatter_file is None else (scatter_file,)
    modal = (own.folder / "modal_model.json" for own in tests)
    inputs = (*campaign.inputs, *effect_files, *stated, *modal)
    return kept(output / "pooled_diagnosis.json", PooledDiagnosis, make, inputs=inputs, options={})


def print_pooled(found: PooledDiagnosis, output: Path, console: Console) -> None:
    """Print the answer, the explanations and the specimens."""
    for sentence in found.sentences:
        console.print(sentence, highlight=False, markup=False)
    console.print(pooled_table(found))
    console.print(specimen_table(found))
    console.print(
        f"Results in {output}; make a page of them: lamella report {output}", highlight=False, markup=False
    )


def pooled_table(found: PooledDiagnosis) -> Table:
    """Return the explanations that were fitted in full, the most probable first."""
    table = Table(title="Explanations", title_justify="left")
    table.add_column("effects, and whose they are")
    for name in ("proba-\nbility", "f error\n[%]", "specimen\nleft out\n[%]", "torque\nleft out\n[%]"):
        table.add_column(name, justify="right")
    for own in found.ranking[:_MOST_EXPLANATIONS]:
        table.add_row(
            explanation_text(own),
            f"{own.probability:.3f}",
            f"{100 * own.frequency_error:.2g}",
            f"{100 * own.left_out_error:.2g}",
            f"{100 * own.left_out_torque_error:.2g}",
        )
    return table


def specimen_table(found: PooledDiagnosis) -> Table:
    """Return all specimens with their contact parameters and errors."""
    table = Table(title="Specimens", title_justify="left")
    for name in SPECIMEN_HEADER:
        table.add_column(name)
    for own in found.specimens:
        table.add_row(*specimen_row(own))
    return table
