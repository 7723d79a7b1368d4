"""What the studies share: cases that are run once each, a line of a record each, and shares of them."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor, as_completed
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import cattrs
from scipy.stats import beta

from updating.errors import StoreError

T = TypeVar("T")
DATA = Path(__file__).parents[2] / "data"
BLIND = DATA / "blind"
"""Folder of the records that the documents print."""


@dataclass(frozen=True, kw_only=True)
class Share:
    """A share of cases with its 95 % binomial interval (Clopper and Pearson 1934)."""

    name: str
    target: str
    hits: int
    total: int

    @property
    def interval(self) -> tuple[float, float]:
        """Lower and upper end; (0, 1) without cases."""
        if not self.total:
            return 0.0, 1.0
        low = beta.ppf(0.025, self.hits, self.total - self.hits + 1) if self.hits else 0.0
        high = beta.ppf(0.975, self.hits + 1, self.total - self.hits) if self.hits < self.total else 1.0
        return float(low), float(high)

    @property
    def row(self) -> str:
        """The line of the published table."""
        name = self.name.strip()
        if not self.total:
            return f"| {name} | no case | {self.target} |"
        low, high = self.interval
        share = f"{100 * self.hits / self.total:.0f} % ({100 * low:.0f} to {100 * high:.0f})"
        return f"| {name} | {self.hits} of {self.total} = {share} | {self.target} |"


def share(name: str, target: str, hits: Sequence[bool]) -> Share:
    """Count in how many of the cases something is so."""
    return Share(name=name, target=target, hits=int(sum(hits)), total=len(hits))


def recorded(record: Path, form: type[T]) -> list[T]:
    """Read the cases of a record; what follows the last end of a line is a case that was being written.

    Raises
    ------
    StoreError
        A line is no case of this form.
    """
    *lines, _ = record.read_text(encoding="utf-8").split("\n") if record.exists() else [""]
    cases = []
    for number, line in enumerate(lines, 1):
        try:
            cases.append(cattrs.structure(json.loads(line), form))
        except (cattrs.BaseValidationError, ValueError) as error:
            message = f"{record}, line {number}: no {form.__name__}, or one of another version; move it away"
            raise StoreError(message) from error
    return cases


def study(
    planned: Iterable[tuple[Any, ...]],
    run: Callable[..., T],
    record: Path,
    form: type[T],
    key: Callable[[T], tuple[Any, ...]],
    executor: Executor | None = None,
    say: Callable[[T], None] = lambda _: None,
) -> list[T]:
    """Run the planned cases that a record does not have, each written as soon as it is done, and return all.

    Parameters
    ----------
    planned : iterable of tuple
        Arguments of `run`, case by case.
    run : callable
        It makes one case.
    record : Path
        A line of JSON for each case; a study that was stopped goes on after the last whole line.
    form : type
        Data class of a case.
    key : callable
        What of a case its arguments were.
    executor : Executor, optional
        Where cases are run side by side; by default they are run here, one after the other.
    say : callable
        What is done with each new case, such as printing it.
    """
    asked = list(planned)
    done = {key(case): case for case in recorded(record, form)}
    record.parent.mkdir(parents=True, exist_ok=True)
    record.write_text("".join(map(line, done.values())), encoding="utf-8")  # without one that was cut off
    left = [arguments for arguments in asked if arguments not in done]
    made: Iterable[Callable[[], T]]
    if executor is None:
        made = (partial(run, *arguments) for arguments in left)
    else:
        made = (future.result for future in as_completed([executor.submit(run, *one) for one in left]))
    with record.open("a", encoding="utf-8") as file:
        for make in made:
            case = make()
            done[key(case)] = case
            file.write(line(case))
            file.flush()
            say(case)
    return [done[arguments] for arguments in asked]


def line(case: Any) -> str:
    """Return a case as a line of a record."""
    return json.dumps(asdict(case)) + "\n"
