"""`lamella blind`: diagnose virtual tests with sealed effects and score the answers."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from updating.blind.jobs import figures_table, recorded, run_blind
from updating.commands.options import Cluster, Folder
from updating.commands.terminal import OUT

EXAMPLE = "lamella blind data/demo_stack/virtual_test.toml -o out/blind"


def blind(
    specification: Annotated[
        Path, typer.Argument(metavar="SPEC", help="Virtual test (TOML).", show_default=False)
    ],
    output: Folder,
    full: Annotated[bool, typer.Option("--full", help="1300 cases instead of 134.")] = False,
    cluster: Cluster = None,
) -> None:
    """Diagnose virtual tests with sealed effects and print how often the answer was right.

    Each case is recorded in cases.jsonl as soon as it is done and is not run again; delete the file to begin anew.
    Kinds of cases are mixed, and a run that is interrupted prints the figures of those that it has.
    """
    try:
        cases = run_blind(specification, output, OUT, full=full, cluster=cluster)
    except KeyboardInterrupt:
        OUT.print(figures_table(recorded(output)))
        raise
    OUT.print(figures_table(cases))
