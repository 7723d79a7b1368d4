"""Tables of words and numbers, described once: for the terminal, the page, its PDF and slides."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import KW_ONLY, dataclass, replace
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from rich.table import Table as Printed

Shown = Literal["", "base", "found", "both"]
"""Which of two models a block of a page is of, between which it switches; empty where it is of none of them."""
_NUMBER = re.compile(r"-$|\(?[-+]?\d[^A-DF-Za-df-z]*$")


@dataclass(frozen=True)
class Table:
    """A table of text cells with a title and a note below.

    Attributes
    ----------
    title : str
        Heading; may be empty.
    header : sequence of str
        Names of the columns, with units.
    rows : sequence of sequence of str
        The cells; the page sorts them by the number that a cell starts with.
    note : str
        What stands below; may be empty.
    whole : bool
        Whether the terminal never breaks numbers into lines.
    narrowest : int
        Width that columns of words have there at least, characters.
    link : tuple of str
        For each row the address that its first cell leads to, "#anchor" within the page; may be empty.
    folded : bool
        Whether the page shows the title only until it is clicked.
    chooses : bool
        Whether first cells are numbers of points, of which a click shows the function where the link leads.
    hint : tuple of str
        For each row a sentence that the page shows under the cursor; may be empty.
    model : {"", "base", "found"}
        Whether it is of the base model or of the one with what was identified.
    """

    title: str
    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    note: str = ""
    _: KW_ONLY
    whole: bool = False
    narrowest: int = 0
    link: tuple[str, ...] = ()
    folded: bool = False
    chooses: bool = False
    hint: tuple[str, ...] = ()
    model: Shown = ""
    kind: Literal["table"] = "table"

    @property
    def column_class(self) -> tuple[str, ...]:
        """How each column is set: numbers to the right, words ("text") to the left, sentences ("long") wide."""
        columns = zip(*self.rows, strict=True) if self.rows else ((),) * len(self.header)
        return tuple(_column_class(column) for column in columns)

    def without_empty_columns(self) -> Table:
        """Return the table less the columns in which no row has anything."""
        kept = [k for k in range(len(self.header)) if any(row[k] for row in self.rows)]
        return replace(
            self,
            header=tuple(self.header[k] for k in kept),
            rows=tuple(tuple(row[k] for k in kept) for row in self.rows),
        )

    def __rich__(self) -> Printed:
        """Return the table as the terminal prints it."""
        from rich.table import Table as Printed

        made = Printed(
            title=self.title or None, title_justify="left", caption=self.note or None, caption_justify="left"
        )
        for name, words in zip(self.header, self.column_class, strict=True):
            if words:
                made.add_column(name, overflow="fold", min_width=self.narrowest or None)
            else:
                made.add_column(name, justify="right", no_wrap=self.whole)
        for row in self.rows:
            made.add_row(*row)
        return made


def _column_class(cells: Iterable[str]) -> str:
    long = 30  # characters of a cell
    texts = [cell for cell in cells if cell and not _NUMBER.match(cell)]
    return "" if not texts else "long" if max(map(len, texts)) > long else "text"
