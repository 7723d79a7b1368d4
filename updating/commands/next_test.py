"""`lamella next-test`: rank further tests by what they would resolve."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rich.table import Table

from ema import read_campaign
from ema.types.threads import single_threaded
from model import read_stack
from updating.commands.diagnose import diagnose_campaign, print_measurement_findings
from updating.commands.terminal import OUT
from updating.diagnosis.answer import Diagnosis
from updating.diagnosis.text import second_level_text
from updating.fitting.target import model_file
from updating.results.chosen_poles import forget_choices


@single_threaded
def next_test_command(
    campaign: Path,
    output: Path,
    effect_file: Sequence[Path],
    scatter: Path | None,
    *,
    identify_anew: bool,
) -> None:
    """Print further tests, those first that separate best what a diagnosis leaves open."""
    if identify_anew:
        forget_choices(output)
    read_stack(model_file(read_campaign(campaign), "a further test"))  # tests are of stacks
    found = diagnose_campaign(campaign, output, effect_file, OUT, scatter_file=scatter)
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
