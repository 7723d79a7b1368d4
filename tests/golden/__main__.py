"""`python -m tests.golden`: draw cases, answer them with the engine, compare two files of answers."""

from __future__ import annotations

import argparse
import time
from collections.abc import Container, Iterable, Iterator, Sequence
from pathlib import Path

from tests.golden.cases import FOLDER, STACKS, WORLDS, Case, kept, planned
from tests.golden.comparison import compared, table
from tests.golden.record import Record, by_key, line, read

RECORD = Path(__file__).parent / "before.jsonl"


def main() -> None:
    """Run one of the commands."""
    parser = argparse.ArgumentParser(prog="python -m tests.golden", description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    drawn = commands.add_parser("draw", help="draw the cases into a folder")
    answered = commands.add_parser(
        "answer", help="answer the cases that a file lacks; draw those that are not yet"
    )
    answered.add_argument("-o", "--output", type=Path, required=True)
    answered.add_argument("--hours", type=float, default=24.0, help="begin no case later than this")
    shipped = commands.add_parser("campaigns", help="ask the command line about the shipped campaigns")
    shipped.add_argument("-o", "--output", type=Path, required=True)
    answered.add_argument("--setup", choices=sorted({*STACKS}), action="append", help="of these stacks alone")
    for command in (drawn, answered):
        command.add_argument("--folder", type=Path, default=FOLDER)
        command.add_argument("--world", choices=WORLDS, action="append")
    shown = commands.add_parser("show", help="print the table of a file")
    shown.add_argument("file", type=Path, nargs="?", default=RECORD)
    commands.add_parser("published", help="print the table of the published figures' cases")
    both = commands.add_parser("compare", help="print two files side by side")
    both.add_argument("before", type=Path)
    both.add_argument("after", type=Path)
    given = parser.parse_args()
    if given.command == "draw":
        for case in cases(given.folder, given.world or WORLDS, STACKS):
            _say(f"{case.world} {case.kind} {case.seed}: {' + '.join(case.planted) or 'nothing'}")
    elif given.command == "answer":
        todo = cases(given.folder, given.world or WORLDS, given.setup or STACKS, by_key(read(given.output)))
        answer_all(given.output, todo, time.monotonic() + 3600.0 * given.hours)
    elif given.command == "campaigns":
        from tests.golden.campaigns import answer_campaigns

        answer_campaigns(given.output, _say)
    elif given.command == "published":
        from tests.golden.published import published

        _say("\n".join(table(list(published()))))
    else:
        lines = table(read(given.file)) if given.command == "show" else compared(given.before, given.after)
        _say("\n".join(lines))


def cases(
    folder: Path,
    worlds: Sequence[str],
    setups: Sequence[str],
    done: Container[tuple[str, str, int, str]] = (),
) -> Iterator[Case]:
    """Yield the cases that are not done, worlds in turn, so that any first part is a fair sample."""
    for each in zip(*(planned(world) for world in worlds), strict=True):
        for world, (seed, kind, setup) in zip(worlds, each, strict=True):
            if setup not in setups or (world, kind, seed, setup) in done:
                continue
            try:
                yield kept(folder, seed, kind, world, setup)
            except ValueError as error:
                _say(str(error))


def answer_all(output: Path, todo: Iterable[Case], end: float) -> None:
    """Add the engine's answers to a file, each as soon as it is there."""
    from tests.golden.engine import answer

    with output.open("a", encoding="utf-8") as file:
        for case in todo:
            if time.monotonic() > end:
                break
            own: Record = answer(case)
            file.write(line(own))
            file.flush()
            true = " + ".join(case.planted) or "nothing"
            _say(f"{own.world} {own.kind} {own.seed} ({true}): {own.outcome}, {own.verdict} {own.names}")


def _say(text: str) -> None:
    print(text, flush=True)


if __name__ == "__main__":
    main()
