"""What rooms are made of: figures that are state, and what a click in one says."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

CLICKED = "[$event.points[0].pointNumber, $event.points[0].curveNumber]"
"""What a click on a chart sends: the number of the point, of a matrix its row and column, and of the trace."""
_FONT = {"family": "Roboto, system-ui, sans-serif", "size": 12}


def figure(spec: str) -> dict[str, Any]:
    """Return a chart (`updating.report.chart_part`) as a figure of the page."""
    made: dict[str, Any] = json.loads(spec)
    made["layout"] |= {"autosize": True, "font": _FONT}
    return made


def plot(
    key: str,
    height: int,
    click: Callable[..., Any] | None = None,
    sends: str = CLICKED,
    hover: Callable[..., Any] | None = None,
    *,
    solid: bool = False,
) -> Any:
    """Put a figure, the state `key`, into the page; a click calls `click` with what the expression `sends` gives.

    `hover` is called likewise with what is under the cursor. What is `solid` is seen from as far as its height asks, so
    on a narrow page it is less high, or its ends are cut.
    """
    from trame.widgets import html, plotly

    high = f"min({height}px, 60vw)" if solid else f"{height}px"
    with html.Div(style=f"height: {high}; width: 100%; min-width: 0", id=key) as box:
        calls = {"click": click, "hover": hover}
        others = {name: (call, sends) for name, call in calls.items() if call is not None}
        plotly.Figure(
            state_variable_name=key, display_logo=("false",), responsive=("true",), display_mode_bar=("'hover'",),
            style="height: 100%; width: 100%", **others,
        )  # fmt: skip
    return box


def empty() -> dict[str, Any]:
    """Return a figure without anything in it."""
    return {"data": [], "layout": {}}
