"""`python -m tests.golden`: draw cases, answer them with the engine, set two files of answers side by side."""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterable, Iterator
from pathlib import Path

from tests.golden.campaigns import answer_campaigns
from tests.golden.cases import FOLDER, Case, Key, all_planned, kept
from tests.golden.comparison import compared, table
from tests.golden.engine import answer
from tests.golden.published import published
from tests.golden.record import by_key, line, read


def main() -> None:
    """Run one of the commands."""
    given = _arguments()
    if given.command == "draw":
        for case in _cases(_planned(given), given.folder):
            _say(f"{case.world} {case.kind} {case.seed}: {' + '.join(case.planted) or 'nothing'}")
    elif given.command == "answer":
        done = by_key(read(given.output))
        todo = _cases([key for key in _planned(given) if key not in done], given.folder)
        _answer_all(todo, given.output, time.monotonic() + 3600.0 * given.hours)
    elif given.command == "campaigns":
        answer_campaigns(given.output, _say)
    elif given.command == "published":
        given.output.write_text("".join(map(line, published())), encoding="utf-8")
    elif given.command == "show":
        _say("\n".join(table(read(given.file))))
    else:
        _say("\n".join(compared(given.before, given.after)))


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tests.golden", description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)

    def command(name: str, what: str) -> argparse.ArgumentParser:
        return commands.add_parser(name, help=what, description=what)

    drawn = command("draw", "draw the cases into a folder")
    answered = command("answer", "answer the cases that a file lacks; those that are not drawn yet are drawn")
    shipped = command("campaigns", "ask `lamella diagnose` about the campaigns that ship")
    known = command("published", "write what the engine of the published figures said of their cases")
    for one in (answered, shipped, known):
        one.add_argument("-o", "--output", type=Path, required=True)
    answered.add_argument("--hours", type=float, default=24.0, help="begin no case later than this")
    for one in (drawn, answered):
        one.add_argument("--folder", type=Path, default=FOLDER, help="where drawn cases are kept")
        one.add_argument("--setup", action="append", help="cases of this stack alone")
        one.add_argument("--published", action="store_true", help="the cases of the published figures instead")
    command("show", "print the table of a file").add_argument("file", type=Path)
    both = command("compare", "print two files side by side")
    both.add_argument("before", type=Path)
    both.add_argument("after", type=Path)
    return parser.parse_args()


def _planned(given: argparse.Namespace) -> list[Key]:
    keys = [one.key for one in published()] if given.published else all_planned()
    return [key for key in keys if given.setup is None or key[3] in given.setup]


def _cases(planned: Iterable[Key], folder: Path) -> Iterator[Case]:
    for key in planned:
        try:
            yield kept(folder, *key)
        except ValueError as error:
            _say(str(error))


def _answer_all(todo: Iterable[Case], output: Path, end: float) -> None:
    """Add the engine's answers to a file, each as soon as it is there."""
    with output.open("a", encoding="utf-8") as file:
        for case in todo:
            if time.monotonic() > end:
                break
            one = answer(case)
            file.write(line(one))
            file.flush()
            true = " + ".join(case.planted) or "nothing"
            _say(f"{one.world} {one.kind} {one.seed} ({true}): {one.outcome}, {one.verdict} {one.names}")


def _say(text: str) -> None:
    print(text, flush=True)


if __name__ == "__main__":
    main()
