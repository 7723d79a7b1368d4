"""Moving shapes in the page: the report's own, in a frame to which other shapes can be sent."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from updating.fitting.shape_plot import ShapePair
from updating.report.page import render
from updating.report.part import Section
from updating.report.shape_part import gallery_of


def moving_page(pair: ShapePair, box: list[float] | None) -> str:
    """Return a page on which a pair of shapes moves."""
    return render("Shapes", (Section(title="Shapes", blocks=(gallery_of("pair", (pair,), box),)),), bare=True)


def moving_shapes(key: str, height: int) -> Callable[[dict[str, Any]], None]:
    """Put the page that is the state `key` into a frame; return what sends it another pair (`shape_numbers`)."""
    from trame.widgets import client, html

    html.Iframe(
        srcdoc=(key,), style=f"width: 100%; height: {height}px; border: 0", id=key, title="Shapes that move"
    )
    return client.JSEval(
        exec=f"window.document.getElementById('{key}').contentWindow.postMessage($event, '*')"
    ).exec
