"""Two files of records side by side: who is right by the truth, and whose answers raise errors."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from statistics import median

from tests.golden.record import Record, by_key, read

_COLUMNS = ("cases", "right", "with another", "wrong", "nothing named", "raise left-out f", "in vain", "median s")
HEAD = f"| kind | {' | '.join(_COLUMNS)} |"
_RULE = "| --- " * 9 + "|"


def table(records: Sequence[Record]) -> Iterator[str]:
    """Yield the lines of a table of outcomes by world and kind."""
    yield HEAD
    yield _RULE
    kinds = sorted({(one.world, one.kind) for one in records})
    for world, kind in kinds:
        yield _row(f"{world}, {kind}", [one for one in records if (one.world, one.kind) == (world, kind)])
    yield _row("single that show", [one for one in records if one.kind.endswith("single") and one.shows])
    yield _row("all", records)


def _row(name: str, records: Sequence[Record]) -> str:
    def count(holds: Callable[[Record], bool]) -> int:
        return sum(holds(one) for one in records)

    outcomes = ("right", "with another", "wrong", "nothing")
    numbers = [len(records), *(count(lambda one, o=o: one.outcome == o) for o in outcomes)]
    numbers += [count(lambda one: one.raises), count(lambda one: one.raises_in_vain)]
    taken = [one.seconds for one in records if one.seconds is not None]
    seconds = f"{median(taken):.1f}" if taken else "-"
    return f"| {name} | {' | '.join(map(str, numbers))} | {seconds} |"


def differences(before: Sequence[Record], after: Sequence[Record]) -> Iterator[str]:
    """Yield the cases on which two engines differ in the outcome, the verdict or the first name."""
    first, second = by_key(before), by_key(after)
    for key in sorted(first.keys() & second.keys()):
        one, other = first[key], second[key]
        if (one.outcome, one.verdict, one.names[:1]) != (other.outcome, other.verdict, other.names[:1]):
            true = " + ".join(one.truth) or " + ".join(one.planted) or "nothing"
            yield f"{one.world} {one.kind} {one.seed} ({true}): {_said(one)} -> {_said(other)}"


def _said(one: Record) -> str:
    named = " or ".join("+".join(effects) for effects in one.names) or "no name"
    before, after = one.base.left_out_frequency, one.answer.left_out_frequency
    errors = "" if before is None or after is None else f", left out {100 * before:.2g} -> {100 * after:.2g} %"
    return f"{one.outcome} [{one.verdict}: {named}{errors}]"


def compared(before: Path, after: Path) -> Iterator[str]:
    """Yield the comparison of two files: tables over the cases that both have, then where they differ."""
    one, other = read(before), read(after)
    both = by_key(one).keys() & by_key(other).keys()
    for file, records in ((before, one), (after, other)):
        yield f"{file.name}: {len(both)} cases that both have, of {len(records)}"
        yield from table([each for each in records if each.key in both])
        yield ""
    yield from differences(one, other)
