"""`lamella simulate`: simulate a vibration test on a model."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from updating.commands.options import EffectFiles, Folder
from updating.commands.terminal import OUT
from updating.virtual.campaign import write_virtual_test
from updating.virtual.vibration_test_file import read_virtual_test

EXAMPLE = "lamella simulate data/demo_stack/virtual_test.toml -o data/demo_stack"


def simulate(
    specification: Annotated[
        Path, typer.Argument(metavar="SPEC", help="Virtual test (TOML).", show_default=False)
    ],
    output: Folder,
    effect_file: EffectFiles = None,
) -> None:
    """Simulate a vibration test on a model and write its FRFs as a test system would.

    The truth goes to truth.json, which no other command reads. The same file and seed give the same bytes.
    """
    write_virtual_test(read_virtual_test(specification, effect_file or ()), output)
    OUT.print(f"Campaign: {output / 'campaign.toml'}")
