"""What the package shows of itself: names that are imported when first used, and results as tables and figures.

A package that imports all of its modules takes seconds to start, also where one of them is needed. Its stub,
`__init__.pyi`, is what type checkers read; here it says at run time, too, which module has which name.

A type is defined before anything that draws it. So what it shows is registered by the folder that draws, which knows
the type; the type knows only that something may be registered. A module that draws is imported when a result is first
shown.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Callable, Iterable, Sequence
from functools import singledispatch
from html import escape
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure


_DRAWERS: list[str] = []
"""Modules that are still to be imported before anything is shown."""


def drawn_by(module: str) -> None:
    """Name a module that registers how types show themselves; it is imported when a result is first shown."""
    _DRAWERS.append(module)


def _load_drawers() -> bool:
    """Import the modules that draw; tell whether there were any left to import."""
    waiting = bool(_DRAWERS)
    while _DRAWERS:
        import_module(_DRAWERS.pop())
    return waiting


@singledispatch
def html_of(result: object) -> str:
    """Return a result as HTML; each type registers how."""
    if _load_drawers():
        return html_of(result)
    return f"<pre>{escape(repr(result))}</pre>"


@singledispatch
def figure_of(result: object) -> Figure:
    """Return a result as a figure; each type registers how."""
    if _load_drawers():
        return figure_of(result)
    message = f"nothing draws a {type(result).__name__}"
    raise TypeError(message)


class Shown:
    """A result that shows itself: its table where a notebook ends with it, its figure where that is asked for."""

    def _repr_html_(self) -> str:
        return html_of(self)

    def plot(self) -> Figure:
        """Return the result as a matplotlib figure, tied to no window; save it with `savefig`."""
        return figure_of(self)


def html_table(title: str, header: Sequence[str], rows: Iterable[Sequence[str]], note: str = "") -> str:
    """Return text cells as an HTML table with a title above it and a note below."""

    def line(tag: str, cells: Sequence[str]) -> str:
        return "<tr>" + "".join(f"<{tag}>{escape(cell)}</{tag}>" for cell in cells) + "</tr>"

    head = f"<thead>{line('th', header)}</thead>" if any(header) else ""
    body = "".join(line("td", row) for row in rows)
    below = f"<p>{escape(note)}</p>" if note else ""
    return f"<p><strong>{escape(title)}</strong></p><table>{head}<tbody>{body}</tbody></table>{below}"


def exports(package: str, file: str) -> tuple[list[str], Callable[[str], Any], Callable[[], list[str]]]:
    """Return `__all__`, `__getattr__` and `__dir__` of a package whose stub lists what it has.

    Parameters
    ----------
    package : str
        Its `__name__`.
    file : str
        Its `__file__`; the stub lies beside it and holds lines `from module import name`.
    """
    stub = ast.parse(Path(file).with_name("__init__.pyi").read_text(encoding="utf-8"))
    home = {
        alias.name: node.module
        for node in stub.body
        if isinstance(node, ast.ImportFrom) and node.module is not None
        for alias in node.names
    }

    def __getattr__(name: str) -> Any:
        if name not in home:
            message = f"module {package!r} has no attribute {name!r}"
            raise AttributeError(message)
        value = getattr(import_module(home[name]), name)
        setattr(sys.modules[package], name, value)  # the next time it is there
        return value

    def __dir__() -> list[str]:
        return sorted({*vars(sys.modules[package]), *home})

    return sorted(home), __getattr__, __dir__
