"""Many specimens on one rig: what `lamella diagnose` and `lamella fit` do with a campaign file that lists them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from model import catalogue, find_effects
from updating.commands.terminal import MOST_EXPLANATIONS, print_lines, print_results, progress
from updating.diagnosis.cached_model import cached_model
from updating.diagnosis.candidates import MESSAGES
from updating.diagnosis.evidence import read_scatter
from updating.pooled.campaign_file import read_specimens, specimens_of
from updating.pooled.diagnosis import diagnose_specimens
from updating.results.identified import assignments, every_identified
from updating.results.pooled import SPECIMEN_HEADER, PooledDiagnosis, explanation_text, specimen_row
from updating.results.store import kept
from updating.results.text import Table, in_percent
from updating.workers.workers import workers


def diagnose_pooled(
    campaign_file: Path,
    output: Path,
    effect_files: Sequence[Path],
    console: Console,
    *,
    fitted: Sequence[str] | None = None,
    scatter_file: Path | None = None,
    cluster: str | None = None,
) -> PooledDiagnosis:
    """Diagnose all specimens of a campaign together, or fit effects of the rig to them, and write the answer.

    What an earlier run left in pooled_diagnosis.json, or in pooled_fit.json, is read back.

    Parameters
    ----------
    campaign_file, output : Path
        The campaign and the folder for its results.
    effect_files : sequence of Path
        Files with effects of the user.
    console : Console
        Where progress is shown.
    fitted : sequence of str, optional
        Effects to fit; without them, all are asked about.
    scatter_file : Path, optional
        What a laboratory knows of what separates a right model from a right measurement.
    cluster : str, optional
        Address of a Dask scheduler.
    """
    known, asked = catalogue(effect_files), fitted is not None
    effects = known if fitted is None else {effect.name: effect for effect in find_effects(fitted, known)}
    scatter = None if scatter_file is None else read_scatter(scatter_file)
    campaign = read_specimens(campaign_file)
    assigned = () if campaign.measured is None else assignments(campaign.measured, output)
    tests = every_identified(assigned, "identify", console, cluster) if assigned else ()
    by_name = {test.configuration.name: test.modal_model for test in tests}
    specimens = specimens_of(campaign, by_name.__getitem__)

    def make() -> PooledDiagnosis:
        with workers(MESSAGES, cluster) as executor, progress("fit" if asked else "diagnose", console):
            return diagnose_specimens(
                campaign.name, specimens, effects, asked=asked, scatter=scatter, executor=executor, reduced=cached_model
            )

    stated = () if scatter_file is None else (scatter_file,)
    inputs = (*campaign.inputs, *(test.folder / "modal_model.json" for test in tests), *effect_files, *stated)
    path = output / ("pooled_fit.json" if asked else "pooled_diagnosis.json")
    options = {"effects": list(effects)} if asked else {}
    return kept(path, PooledDiagnosis, make, inputs=inputs, options=options)


def print_pooled(diagnosis: PooledDiagnosis, output: Path, console: Console) -> None:
    """Print the answer, the explanations and the specimens."""
    print_lines(console, diagnosis.sentences, indent="")
    console.print(pooled_table(diagnosis))
    console.print(Table("Specimens", SPECIMEN_HEADER, [specimen_row(specimen) for specimen in diagnosis.specimens]))
    print_results(console, output)


def pooled_table(diagnosis: PooledDiagnosis) -> Table:
    """Return the explanations that were fitted in full, the most probable first."""
    rows = [
        (
            explanation_text(explanation),
            f"{explanation.probability:.3f}",
            in_percent(explanation.frequency_error),
            in_percent(explanation.left_out_error),
            in_percent(explanation.left_out_torque_error),
        )
        for explanation in diagnosis.ranking[:MOST_EXPLANATIONS]
    ]
    header = (
        "effects, and whose they are",
        "proba-\nbility",
        "f error\n[%]",
        "specimen\nleft out\n[%]",
        "torque\nleft out\n[%]",
    )
    return Table("Explanations", header, rows)
