"""Charts for the screen, which zoom and can be read off: plotly figures as JSON."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from importlib.resources import files
from typing import Any

import numpy as np
from numpy.typing import NDArray

HEIGHT = 360  # px


def chart(traces: Sequence[Mapping[str, Any]], layout: Mapping[str, Any]) -> str:
    """Return a figure as the JSON that `charts.js` draws.

    Parameters
    ----------
    traces : sequence of mapping
        What is drawn, in plotly's terms; arrays are written as binary numbers of single precision.
    layout : mapping
        Axes, legend and height likewise; the page adds its own colours and letters.

    Raises
    ------
    ValueError
        Plotly does not know a property.
    """
    import plotly.graph_objects as go

    figure = go.Figure(
        data=[dict(t) for t in traces], layout={"height": HEIGHT, **layout, "template": "none"}
    )
    plain = json.loads(figure.to_json())
    return json.dumps({"data": plain["data"], "layout": plain["layout"]}, separators=(",", ":"))


def single(value: NDArray[np.floating[Any]]) -> NDArray[np.float32]:
    """Return numbers in the precision that a chart needs."""
    return np.asarray(value, dtype=np.float32)


def axis(title: str, **others: Any) -> dict[str, Any]:
    """Return an axis with a title that never overlaps its numbers."""
    return {"title": {"text": title, "standoff": 8}, "automargin": True, **others}


def legend_above() -> dict[str, Any]:
    """Return a legend in a line above the axes."""
    return {"orientation": "h", "x": 0.0, "y": 1.02, "yanchor": "bottom"}


def renderer() -> str:
    """Return plotly.js, which draws the charts, from the installed package; a page holds it once."""
    return (files("plotly") / "package_data" / "plotly.min.js").read_text(encoding="utf-8")
