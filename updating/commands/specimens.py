"""Many specimens on one rig: what `lamella diagnose` and `lamella fit` do with a campaign file that lists them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.table import Table

from model import catalogue, find_effects
from updating.commands.terminal import MOST_EXPLANATIONS, print_lines, print_results, progress, table_of
from updating.diagnosis.cached_model import cached_model
from updating.diagnosis.candidates import MESSAGES
from updating.diagnosis.evidence import read_scatter
from updating.pooled.campaign_file import SpecimenCampaign, read_specimens, specimens_of
from updating.pooled.diagnosis import diagnose_specimens, fit_specimens
from updating.pooled.specimen import Specimen
from updating.results.identified import assignments, every_identified
from updating.results.pooled import SPECIMEN_HEADER, PooledDiagnosis, explanation_text, specimen_row
from updating.results.store import kept
from updating.results.text import in_percent
from updating.workers.workers import workers


def diagnose_pooled(
    campaign_file: Path,
    output: Path,
    effect_files: Sequence[Path],
    console: Console,
    *,
    scatter_file: Path | None = None,
    cluster: str | None = None,
) -> PooledDiagnosis:
    """Diagnose all specimens of a campaign together, and write pooled_diagnosis.json.

    What an earlier run left is read back.
    """
    known = catalogue(effect_files)
    scatter = None if scatter_file is None else read_scatter(scatter_file)
    campaign, specimens, inputs = _specimens(campaign_file, output, console, cluster)

    def make() -> PooledDiagnosis:
        with workers(MESSAGES, cluster) as executor, progress("diagnose", console):
            return diagnose_specimens(
                campaign.name, specimens, known, scatter=scatter, executor=executor, reduced=cached_model
            )

    stated = () if scatter_file is None else (scatter_file,)
    inputs = (*inputs, *effect_files, *stated)
    return kept(output / "pooled_diagnosis.json", PooledDiagnosis, make, inputs=inputs, options={})


def fit_pooled(
    campaign_file: Path,
    output: Path,
    effects: Sequence[str],
    effect_files: Sequence[Path],
    console: Console,
    *,
    cluster: str | None = None,
) -> PooledDiagnosis:
    """Fit effects of the rig to all specimens of a campaign together, and write pooled_fit.json.

    What an earlier run left is read back.
    """
    known = {effect.name: effect for effect in find_effects(effects, catalogue(effect_files))}
    campaign, specimens, inputs = _specimens(campaign_file, output, console, cluster)

    def make() -> PooledDiagnosis:
        with workers(MESSAGES, cluster) as executor, progress("fit", console):
            return fit_specimens(campaign.name, specimens, known, executor=executor, reduced=cached_model)

    inputs, options = (*inputs, *effect_files), {"effects": list(known)}
    return kept(output / "pooled_fit.json", PooledDiagnosis, make, inputs=inputs, options=options)


def _specimens(
    campaign_file: Path, output: Path, console: Console, cluster: str | None
) -> tuple[SpecimenCampaign, tuple[Specimen, ...], tuple[Path, ...]]:
    """Return a campaign, its specimens with the modes of all their configurations, and the files they come from."""
    campaign = read_specimens(campaign_file)
    measured = campaign.measured
    tests = (
        ()
        if measured is None
        else every_identified(assignments(measured, output), "identify", console, cluster)
    )
    by_name = {test.configuration.name: test.modal_model for test in tests}
    modal = (test.folder / "modal_model.json" for test in tests)
    return campaign, specimens_of(campaign, by_name.__getitem__), (*campaign.inputs, *modal)


def print_pooled(diagnosis: PooledDiagnosis, output: Path, console: Console) -> None:
    """Print the answer, the explanations and the specimens."""
    print_lines(console, diagnosis.sentences, indent="")
    console.print(pooled_table(diagnosis))
    console.print(specimen_table(diagnosis))
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
    return table_of("Explanations", header, rows, words=(0,))


def specimen_table(diagnosis: PooledDiagnosis) -> Table:
    """Return all specimens with their contact parameters and errors."""
    rows = map(specimen_row, diagnosis.specimens)
    return table_of("Specimens", SPECIMEN_HEADER, rows, words=range(len(SPECIMEN_HEADER)))
