"""`lamella next-test`: rank further tests by what they would resolve."""

from __future__ import annotations

from rich.table import Table

from ema import read_campaign
from model import read_stack
from updating.commands.diagnose import diagnose_campaign, print_measurement_findings
from updating.commands.options import CampaignFile, EffectFiles, Folder, IdentifyAnew, ScatterFile
from updating.commands.terminal import OUT
from updating.diagnosis.answer import Diagnosis
from updating.diagnosis.text import second_level_text
from updating.fitting.target import model_file
from updating.results.chosen_poles import forget_choices

EXAMPLE = "lamella next-test data/hidden_effect/open/campaign.toml -o out/open"


def next_test(
    campaign: CampaignFile,
    output: Folder,
    effect_file: EffectFiles = None,
    scatter: ScatterFile = None,
    identify_anew: IdentifyAnew = False,
) -> None:
    """Rank further tests by how well they would resolve the explanations that a diagnosis leaves open.

    The diagnosis is made where the folder has none of this campaign.
    """
    if identify_anew:
        forget_choices(output)
    read_stack(model_file(read_campaign(campaign), "a further test"))  # tests are of stacks
    found = diagnose_campaign(campaign, output, effect_file or [], OUT, scatter_file=scatter)
    if not found.next_tests:
        OUT.print(f"Nothing to separate: the verdict is {found.verdict!r}.", highlight=False)
    else:
        OUT.print(next_test_table(found))
    further = second_level_text(found)
    if further is not None:
        OUT.print(further, highlight=False, markup=False)
    print_measurement_findings(campaign, output)


def next_test_table(diagnosis: Diagnosis) -> Table:
    """Return the further tests, the one that separates best first."""
    table = Table(title="Further tests", title_justify="left")
    for name, justify in (("test", "left"), ("smallest distance", "right"), ("now", "right")):
        table.add_column(name, justify=justify)  # type: ignore[arg-type]
    for test in diagnosis.next_tests:
        table.add_row(test.instruction, f"{test.distance:.1f}", f"{test.now:.1f}")
    return table
