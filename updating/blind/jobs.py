"""What `lamella blind` does with files: blind cases on many workers, each recorded as soon as it is done."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path

import cattrs
import numpy as np
from rich.console import Console
from rich.table import Table

from updating.blind.case import MODEL_FORM_ERROR, Case, run
from updating.blind.figures import figures, held_out_errors, mean_set_size
from updating.errors import StoreError
from updating.results.store import write_bytes
from updating.workers.workers import workers

_RECORD = "cases.jsonl"
_QUICK = {"single": 54, "null": 22, "withheld": 24, "pair": 24, MODEL_FORM_ERROR: 10}
_MORE = {"single": 506, "null": 200, "withheld": 186, "pair": 184, MODEL_FORM_ERROR: 90}


def planned(*, full: bool = False) -> tuple[tuple[int, str], ...]:
    """Return seed and kind of the cases: 134, or with `full` 1300, of which those are the first.

    Thresholds of the diagnosis were set, and its faults mended, on seeds below 99999.
    """
    return (*_mixed(100000, _QUICK), *(_mixed(101000, _MORE) if full else ()))


def _mixed(first: int, number: Mapping[str, int]) -> Iterator[tuple[int, str]]:
    """Mix the kinds, so that what is done says something of each; those of one effect have other draws each."""
    longest = max(number.values())
    apart = 100 * -(-longest // 100)
    for i in range(longest):
        for kind, n in number.items():
            if i * n // longest != (i - 1) * n // longest:
                yield first + i + apart * {"withheld": 1, MODEL_FORM_ERROR: 2}.get(kind, 0), kind


def run_blind(
    specification: Path, output: Path, console: Console, *, full: bool = False, cluster: str | None = None
) -> tuple[Case, ...]:
    """Run the planned cases that cases.jsonl in the output folder does not have, and record each there.

    Parameters
    ----------
    specification : Path
        Virtual test, such as that of data/demo_stack.
    output : Path
        Folder of the record.
    console : Console
        Where a line is printed for each case.
    full : bool
        Whether all of `planned` are run.
    cluster : str, optional
        As in `workers`.

    Raises
    ------
    StoreError
        The record cannot be written, or what is there was not written by this version.
    WorkerError
        See `workers`.
    """
    record = output / _RECORD
    done = {(case.seed, case.kind): case for case in recorded(output)}
    write_bytes(record, "".join(map(_line, done.values())).encode())  # without a line that was cut off
    asked = planned(full=full)
    left = [case for case in asked if case not in done]
    with workers(len(left), cluster) as executor, record.open("a", encoding="utf-8") as file:
        found = executor.map(partial(run, specification.absolute()), *zip(*left, strict=True))
        for i, case in enumerate(found):
            done[case.seed, case.kind] = case
            file.write(_line(case))
            file.flush()
            console.print(f"{i + 1} of {len(left)}: {_sentence(case)}", highlight=False, markup=False)
    return tuple(done[case] for case in asked)


def recorded(output: Path) -> tuple[Case, ...]:
    """Read the cases that are done; what follows the last end of a line is a case that was being written.

    Raises
    ------
    StoreError
        A line is no case of this version.
    """
    record = output / _RECORD
    if not record.exists():
        return ()
    *lines, _ = record.read_text(encoding="utf-8").split("\n")
    cases = []
    for number, line in enumerate(lines, 1):
        try:
            cases.append(cattrs.structure(json.loads(line), Case))
        except (cattrs.BaseValidationError, ValueError) as error:
            message = f"{record}, line {number}: no blind case, or one of another version; move it away"
            raise StoreError(message) from error
    return tuple(cases)


def figures_table(cases: Sequence[Case]) -> Table:
    """Print how often the diagnosis was right, with 95 % intervals, beside the targets."""
    size = mean_set_size(cases)
    said = [f"mean size of the set {size:.2f}, target 1.5"] if np.isfinite(size) else []
    base, with_named, true = held_out_errors(cases)
    if np.isfinite(base):
        said.append(
            "median error of what is held out, in standard deviations: "
            f"refit only {base:.2f}, with what is named {with_named:.2f}, with the true effect {true:.2f}"
        )
    table = Table(
        title=f"{len(cases)} blind cases",
        title_justify="left",
        caption="\n".join(said),
        caption_justify="left",
    )
    for name in ("figure", "measured", "of", "95 %", "target"):
        table.add_column(name, justify="left" if name in ("figure", "target") else "right")
    for own in figures(cases):
        low, high = own.interval
        share = f"{100 * own.hits / own.total:.1f} %" if own.total else "-"
        table.add_row(own.name, share, str(own.total), f"{100 * low:.0f} to {100 * high:.0f}", own.target)
    return table


def _line(case: Case) -> str:
    return json.dumps(asdict(case)) + "\n"


def _sentence(case: Case) -> str:
    truth = " with ".join(case.truth) or "nothing"
    said = " or ".join(" with ".join(candidate) for candidate in case.candidates)
    return f"seed {case.seed}, {case.kind}: {truth} -> {case.verdict} {said}"
