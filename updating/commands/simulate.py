"""`lamella simulate`: simulate a vibration test on a model."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ema.types.threads import single_threaded
from updating.commands.terminal import OUT
from updating.virtual.campaign import write_virtual_test
from updating.virtual.vibration_test_file import read_virtual_test


@single_threaded
def simulate_command(specification: Path, output: Path, effect_file: Sequence[Path]) -> None:
    """Simulate a vibration test, and say where its campaign file is."""
    write_virtual_test(read_virtual_test(specification, effect_file), output)
    OUT.print(f"Campaign: {output / 'campaign.toml'}")
