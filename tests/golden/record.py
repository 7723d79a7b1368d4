"""What an engine said of a case, one JSON line each."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal

Outcome = Literal["right", "with another", "wrong", "nothing"]


@dataclass(frozen=True, kw_only=True)
class Errors:
    """Mean relative errors over the modes that were used, as fitted and where each mode is predicted from the others.

    None where they are not known, or cannot be predicted.
    """

    frequency: float | None
    damping: float | None
    left_out_frequency: float | None
    left_out_damping: float | None


@dataclass(frozen=True, kw_only=True)
class Value:
    """An estimated parameter with its 95 % interval, in its unit."""

    unit: str
    value: float
    lower: float
    upper: float


@dataclass(frozen=True, kw_only=True)
class Record:
    """One case and what an engine said of it.

    Attributes
    ----------
    seed, world, kind, setup, distance, planted, truth
        As `cases.Case` has them; of a shipped campaign the seed is 0, and `setup` is its folder.
    verdict : str
        Of the engine.
    names : tuple of tuple of str
        What cannot be told apart, the first one first; none where nothing is named.
    values : dict of Value
        Parameters of the first of them.
    base, answer, true : Errors
        Of the base model, of the first that is named (or the base model), and of the true effects together; the last
        is None where they were not fitted or nothing of the catalogue is planted.
    seconds : float, optional
        Of processor time, with the reduced model of the stack at hand.
    """

    seed: int
    world: str
    kind: str
    setup: str
    distance: float | None
    planted: Mapping[str, Mapping[str, float]]
    truth: tuple[str, ...]
    verdict: str
    names: tuple[tuple[str, ...], ...]
    values: Mapping[str, Value]
    base: Errors
    answer: Errors
    true: Errors | None
    seconds: float | None

    @property
    def key(self) -> tuple[str, str, int, str]:
        """What tells it from all other cases."""
        return self.world, self.kind, self.seed, self.setup

    @property
    def outcome(self) -> Outcome:
        """Who is right by the truth.

        "right" where all that is named first is true, or nothing is named where nothing of the catalogue is missing;
        "with another" where the first has a true effect beside one that is not; "wrong" where it has none; "nothing"
        where nothing is named though an effect of the catalogue is planted.
        """
        if not self.names:
            silent = "nothing" if self.truth else "right"
            return "wrong" if self.kind.endswith("null") and self.verdict != "nothing missing" else silent
        first, true = set(self.names[0]), set(self.truth)
        if not first & true:
            return "wrong"
        return "right" if first <= true else "with another"

    @property
    def shows(self) -> bool | None:
        """Whether the true effects halve a left-out error; None where the engine did not fit them."""
        if self.true is None:
            return None
        pairs = [
            (self.base.left_out_frequency, self.true.left_out_frequency),
            (self.base.left_out_damping, self.true.left_out_damping),
        ]
        return any(a is not None and b is not None and b < 0.5 * a for a, b in pairs)

    @property
    def raises(self) -> bool:
        """Whether something is named that raises the left-out error of frequencies."""
        before, after = self.base.left_out_frequency, self.answer.left_out_frequency
        return bool(self.names) and before is not None and after is not None and after > before

    @property
    def raises_in_vain(self) -> bool:
        """Whether it does so without lowering that of damping by a tenth."""
        before, after = self.base.left_out_damping, self.answer.left_out_damping
        falls = before is not None and after is not None and after < 0.9 * before
        return self.raises and not falls


def line(record: Record) -> str:
    """Return a record as a line of a file, numbers to five digits."""
    return json.dumps(_rounded(asdict(record)), allow_nan=False) + "\n"


def _rounded(one: object) -> object:
    if isinstance(one, dict):
        return {key: _rounded(value) for key, value in one.items()}
    if isinstance(one, list | tuple):
        return [_rounded(value) for value in one]
    return float(f"{one:.5g}") if isinstance(one, float) else one


def read(file: Path) -> list[Record]:
    """Read the records of a file; a line that was cut off is none."""
    text = file.read_text(encoding="utf-8") if file.exists() else ""
    return [_record(json.loads(one)) for one in text.splitlines(keepends=True) if one.endswith("\n")]


def _record(given: dict) -> Record:
    true = given.pop("true")
    given["truth"], given["names"] = tuple(given["truth"]), tuple(map(tuple, given["names"]))
    given["values"] = {name: Value(**one) for name, one in given["values"].items()}
    given["base"], given["answer"] = Errors(**given["base"]), Errors(**given["answer"])
    return Record(**given, true=None if true is None else Errors(**true))


def by_key(records: Iterable[Record]) -> dict[tuple[str, str, int, str], Record]:
    """Return records by what tells them apart."""
    return {one.key: one for one in records}
