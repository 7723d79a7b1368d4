"""What results say in words: values with as many digits as they support, units that read well, and tables."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import KW_ONLY, dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from lamella_shared import Reals

if TYPE_CHECKING:  # the identification begins without the model
    from rich.table import Table as Printed

    from updating.fitting.fit import Estimate, ParameterEstimate

Z95 = 1.96
"""Standard deviations to either side that hold 95 % of a normal distribution."""
MOST_LISTED = 3
"""Explanations, or whatever else there may be many of, that a sentence names."""
_PREFIXED = {"kg": (("g", 1e-3), ("kg", 1.0)), "m": (("mm", 1e-3),)}
"""Units that are read in others, with the size of these in SI."""
_PREFIXES = (("G", 1e9), ("M", 1e6), ("k", 1e3))


def parameter_text(estimate: Estimate) -> str:
    """Write one fitted parameter with its name, half of its 95 % interval and unit."""
    if estimate.lower == estimate.upper:
        return f"{estimate.name} is not fitted, for nothing depends on it"
    bound = " (at the bound of its range)" if estimate.at_bound else ""
    return f"{estimate.name} = {estimate_text(estimate)} {estimate.unit}{bound}"


def estimate_text(estimate: Estimate) -> str:
    """Write value ± half of the 95 % interval with as many digits as the latter supports, such as ``1480 ± 24``."""
    return uncertain(estimate.value, Z95 * estimate.std)


def uncertain(value: float, half: float) -> str:
    """Write value ± half an interval with two digits of the latter; four digits of a value without one."""
    if not 0.0 < half < np.inf:
        return f"{value:.4g}"
    exponent = 0 if abs(value) >= 1e-3 else int(np.floor(np.log10(max(abs(value), half))))
    digits = min(12, max(0, 1 - int(np.floor(np.log10(half))) + exponent))
    shown, half_text = (f"{x / 10.0**exponent:z.{digits}f}" for x in (value, half))
    return f"{shown} ± {half_text}" if exponent == 0 else f"({shown} ± {half_text})e{exponent}"


def ends(value: float, lower: float, upper: float) -> tuple[str, str, str]:
    """Write a value and the ends of its interval, all to the place of two digits of its smaller half."""
    half = min((side for side in (value - lower, upper - value) if 0.0 < side < np.inf), default=abs(value) or 1.0)
    place = int(np.floor(np.log10(half))) - 1
    first, second, third = (f"{round(float(x), -place):.12g}" for x in (value, lower, upper))
    return first, second, third


def interval_text(p: ParameterEstimate) -> str:
    """Write a parameter with its 95 % interval, such as ``stinger_mass = 5.02 g (95 %: 3.5 g to 6.6 g)``."""
    ends = f"{quantity(p.lower, p.unit, p.value)} to {quantity(p.upper, p.unit, p.value)}"
    remark = f", {p.remark}" if p.remark else ""
    return f"{p.name} = {quantity(p.value, p.unit)} (95 %: {ends}{remark})"


def together(names: Sequence[str]) -> str:
    """Write what acts at once: "A together with B", or of more "A, B and C together"."""
    *others, last = names or ("",)
    if len(others) > 1:
        return f"{', '.join(others)} and {last} together"
    return " together with ".join(names)


def percent(share: float) -> str:
    """Write a share as percent with two digits."""
    if not np.isfinite(share):
        return "an unknown share"
    if abs(share) >= 0.995:
        return f"{100.0 * share:.0f} %"
    return f"{100.0 * share:#.2g} %".replace(". %", " %")


def in_percent(share: float) -> str:
    """Write a share in percent, for a column of them, with two digits; a dash where it is not known."""
    return percent(share).removesuffix(" %") if np.isfinite(share) else "-"


def quantity(value: float, unit: str, beside: float | None = None) -> str:
    """Write a value with three digits and a prefixed unit, such as 35 MPa, or with the unit of a value `beside` it."""
    if unit in ("", "1"):
        return _three(value)
    like = abs(value if beside is None else beside) or abs(value)
    if unit in _PREFIXED:
        name, size = next((pair for pair in _PREFIXED[unit] if like < 1e3 * pair[1]), _PREFIXED[unit][-1])
        return f"{_three(value / size)} {name}"
    if unit[0] in "NP" and unit != "Pa/Pa":
        prefix, size = next((pair for pair in _PREFIXES if like >= pair[1]), ("", 1.0))
        return f"{_three(value / size)} {prefix}{unit}"
    return f"{_three(value)} {unit}"


def _three(value: float) -> str:
    """Write a number with three digits, without an exponent where it need not have one: 1000, not 1e+03."""
    return f"{float(f'{value:.3g}'):.6g}"


def abscissa(states: Sequence[Any]) -> tuple[Reals, str]:
    """Return what to draw states over, with its label: torque, or pressure, where it varies, else numbers.

    Parameters
    ----------
    states : sequence
        Of anything that has a `torque`, N m, and a `pressure`, Pa, which may be None.
    """
    for name, label, factor in (("torque", "torque [N m]", 1.0), ("pressure", "pressure [kPa]", 1e-3)):
        stated = [getattr(state, name) for state in states]
        if None not in stated and len(set(stated)) > 1:
            return factor * np.array(stated, dtype=float), label
    return np.arange(1.0, len(states) + 1.0), "configuration"


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
