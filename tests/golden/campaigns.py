"""What the command line says of the campaigns that ship."""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from tests.golden.engine import said
from tests.golden.record import Record, line, read
from tests.independent.effects import TABLE
from updating.diagnosis.answer import Diagnosis
from updating.results.store import read_result

ROOT = Path(__file__).parents[2]
RECORD = Path(__file__).parent / "before_campaigns.jsonl"
"""What the engine said that pairs modes by MAC."""
CAMPAIGNS = ("demo_diagnosis", "demo_stack", *(f"hidden_effect/{name}" for name in (*"abcdefgh", "open", "slip")))
"""Folders of `data` of one stack each, so that one verdict is given."""


def answer_campaigns(output: Path, say: Callable[[str], None] = print) -> None:
    """Add what `lamella diagnose` says of each campaign to a file; those that it holds are not asked again."""
    done = {one.setup for one in read(output)}
    with output.open("a", encoding="utf-8") as file:
        for name in CAMPAIGNS:
            if name not in done:
                one = answer_campaign(name)
                file.write(line(one))
                file.flush()
                say(f"{name} ({' + '.join(one.truth) or 'nothing'}): {one.outcome}, {one.verdict} {one.names}")


def answer_campaign(name: str) -> Record:
    """Return what `lamella diagnose` says of one; the seconds hold all of it, from the FRFs to the answer.

    The reduced model of the stack is that of the user's cache folder, where an earlier diagnosis left one.

    Raises
    ------
    subprocess.CalledProcessError
        The command failed.
    """
    planted, truth = planted_in(ROOT / "data" / name)
    program = "from updating.commands.command_line import main; main()"
    with tempfile.TemporaryDirectory() as folder:
        words = ["diagnose", str(ROOT / "data" / name / "campaign.toml"), "-o", folder]
        before = _children()
        subprocess.run(
            [sys.executable, "-c", program, *words],
            env={**os.environ, "PYTHONPATH": str(ROOT)},
            cwd=folder,
            check=True,
            stdout=subprocess.DEVNULL,
        )
        seconds = _children() - before
        found = read_result(Path(folder) / "diagnosis.json", Diagnosis)
    return Record(
        seed=0,
        world="campaign",
        kind="pair" if len(truth) > 1 else "single" if truth else "null",
        setup=name,
        distance=None,
        planted=planted,
        truth=truth,
        **said(found, truth),
        seconds=seconds,
    )


def planted_in(campaign: Path) -> tuple[Mapping[str, Mapping[str, float]], tuple[str, ...]]:
    """Return what was planted in a campaign, and which effects of the catalogue that are."""
    file = campaign / "truth.json"
    given: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
    if "plan" in given:
        planted = given["plan"]["planted"]
        names = [TABLE[key].catalogue for key in planted]
        return planted, tuple(name for name in names if name is not None)
    result = given["result"]
    return {"values": result["effect_values"]} if result["effects"] else {}, tuple(result["effects"])


def _children() -> float:
    one = resource.getrusage(resource.RUSAGE_CHILDREN)
    return one.ru_utime + one.ru_stime
