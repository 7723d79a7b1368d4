"""What a report is made of: sections, pictures with their data, and charts, drawn by plotly and by matplotlib."""

from __future__ import annotations

import base64
import gzip
import io
import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.resources import files
from typing import TYPE_CHECKING, Any, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from ema.plot import palette
from lamella_shared import Reals, csv_text
from updating.results.text import Shown, Table

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, FigureBase
    from PIL import Image


N_COLOUR = 32  # of an embedded picture: line drawings need no more, and it is a fifth of the size


@dataclass(frozen=True, kw_only=True)
class Picture:
    """A figure as a file's content, the numbers that it shows, and its text.

    Attributes
    ----------
    name : str
        Name of its file, without suffix.
    content : bytes
        The file.
    form : {"svg", "png"}
        What it is, and the file's suffix.
    data : str
        The numbers as CSV, names and units in the first line.
    alt, caption : str
        Text in place of the picture, and below it.
    width : {"half", "full"}
        Of the page.
    chart : str
        The same for the screen, to be zoomed and read off: what `charts.js` draws, as JSON (see `Chart`); the
        picture then serves print and pages whose scripts do not run. May be empty.
    choices : tuple of str
        Names of what the chart shows one of at a time.
    model : {"", "base", "found", "both"}
        Whether it is of the base model, of the one with what was identified, or draws the one that the page shows.
    """

    name: str
    content: bytes
    form: Literal["svg", "png"]
    data: str
    alt: str
    caption: str
    width: Literal["half", "full"] = "full"
    chart: str = ""
    choices: tuple[str, ...] = ()
    model: Shown = ""
    kind: Literal["picture"] = "picture"

    @property
    def packed(self) -> str:
        """The chart as the page holds it."""
        return packed(self.chart)

    @property
    def uri(self) -> str:
        """The picture as a data URI."""
        mime = {"svg": "image/svg+xml", "png": "image/png"}[self.form]
        return f"data:{mime};base64,{base64.b64encode(self.content).decode()}"


@dataclass(frozen=True, kw_only=True)
class Gallery:
    """Pairs of mode shapes that turn and move in the page.

    Attributes
    ----------
    shapes : str
        What `shapes.js` draws, as JSON (see `shape_part.gallery`).
    title : tuple of str
        Heading of each pair.
    paired : tuple of bool
        Whether it has a modelled shape.
    still : tuple of Picture
        The same at rest, for print and for a page whose scripts do not run.
    note : str
        What stands above them.
    model : {"", "base", "found"}
        Whether its modelled shapes are of the base model or of the one with what was identified.
    """

    shapes: str
    title: tuple[str, ...]
    paired: tuple[bool, ...]
    still: tuple[Picture, ...]
    note: str
    model: Shown = ""
    kind: Literal["gallery"] = "gallery"


ByModel = TypeVar("ByModel", Table, Picture, Gallery)


@dataclass(frozen=True, kw_only=True)
class Opening:
    """What a reader sees first.

    Attributes
    ----------
    badge : str
        The verdict in a word or two.
    tone : {"good", "found", "open"}
        All is well, something was found, or a question is left.
    sentence : str
        The answer.
    command : str
        What to run next; may be empty.
    reason : str
        What that command does.
    model : str
        Empty: it is of no model alone.
    """

    badge: str
    tone: Literal["good", "found", "open"]
    sentence: str
    command: str = ""
    reason: str = ""
    model: Shown = ""
    kind: Literal["opening"] = "opening"


@dataclass(frozen=True, kw_only=True)
class Section:
    """A part of a report.

    Attributes
    ----------
    title : str
        Its heading.
    text : tuple of str
        Paragraphs below it.
    blocks : tuple of Table, Picture, Gallery or Opening
        What follows, in order.
    parts : tuple of Section
        Sections within it.
    """

    title: str
    text: tuple[str, ...] = ()
    blocks: tuple[Table | Picture | Gallery | Opening, ...] = ()
    parts: tuple[Section, ...] = ()

    @property
    def anchor(self) -> str:
        """Name for a link within the page."""
        return anchor(self.title)

    @property
    def pictures(self) -> tuple[Picture, ...]:
        """All figures, those of the sections within too."""
        drawn = [p for b in self.blocks for p in (b.still if isinstance(b, Gallery) else (b,))]
        direct = tuple(p for p in drawn if isinstance(p, Picture))
        return direct + tuple(p for part in self.parts for p in part.pictures)

    @property
    def has_charts(self) -> bool:
        """Whether anything in it, or in the sections within, is drawn by the page's renderer."""
        direct = any(isinstance(b, Gallery) or (isinstance(b, Picture) and b.chart) for b in self.blocks)
        return direct or any(part.has_charts for part in self.parts)

    @property
    def has_models(self) -> bool:
        """Whether anything in it, or in the sections within, is there for two models."""
        direct = any(b.model for b in self.blocks)
        return direct or any(part.has_models for part in self.parts)


def of_model(blocks: Iterable[ByModel], model: Literal["base", "found"]) -> list[ByModel]:
    """Return blocks as those of one of two models; files of the identified model have names of their own."""
    suffix = "_found" if model == "found" else ""
    out: list[ByModel] = []
    for block in blocks:
        if isinstance(block, Gallery):
            still = tuple(replace(picture, name=f"{picture.name}{suffix}") for picture in block.still)
            out.append(replace(block, model=model, still=still))
        elif isinstance(block, Picture):
            out.append(replace(block, model=model, name=f"{block.name}{suffix}"))
        else:
            out.append(replace(block, model=model))
    return out


def anchor(title: str) -> str:
    """Return a heading as the name of a link within the page."""
    return re.sub(r"[^a-z0-9]+", "-", title.lower()).strip("-")


def unbroken(text: str) -> str:
    """Return a text in which no percent sign stands alone on a line."""
    return text.replace(" %", "\u00a0%")


def in_css(text: str) -> str:
    """Return a text as a string of a style sheet, every sign that could end it as its number."""
    return "".join(c if c.isalnum() or c in " .,-" else f"\\{ord(c):x} " for c in text)


def packed(text: str) -> str:
    """Return a text compressed (gzip) as base64, the same every time; `charts.js` unpacks it."""
    return base64.b64encode(gzip.compress(text.encode(), mtime=0)).decode()


def svg(figure: Figure) -> bytes:
    """Return a matplotlib figure as SVG, the same bytes every time."""
    import matplotlib as mpl

    buffer = io.BytesIO()
    with mpl.rc_context({"svg.hashsalt": "lamella"}):
        figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    return buffer.getvalue()


def png(figure: Figure, n_colour: int = N_COLOUR) -> bytes:
    """Return a matplotlib figure as a small PNG: one with thousands of points is smaller so than as SVG."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from PIL import Image

    dpi = 125
    figure.set_dpi(dpi)
    canvas: Any = FigureCanvasAgg(figure)
    canvas.draw()
    return _paletted(Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB"), n_colour)


def fewer_colours(picture: bytes) -> bytes:
    """Reduce a PNG to the 256 colours that fit it best."""
    from PIL import Image

    return _paletted(Image.open(io.BytesIO(picture)).convert("RGB"), 256)


def _paletted(image: Image.Image, n_colour: int) -> bytes:
    from PIL import Image

    buffer = io.BytesIO()
    image.quantize(n_colour, dither=Image.Dither.NONE).save(buffer, format="png", optimize=True)
    return buffer.getvalue()


def renderer() -> str:
    """Return plotly.js, which draws the charts, from the installed package; a page holds it once."""
    return (files("plotly") / "package_data" / "plotly.min.js").read_text(encoding="utf-8")


_HEIGHT = 360  # px, where a layout states none


_MARKERS = {"circle": "o", "square": "s", "diamond": "D", "triangle-up": "^"}

_DASHES = {"dot": ":", "dash": "--"}


@dataclass(frozen=True, kw_only=True)
class Chart:
    """A figure in plotly's terms.

    Attributes
    ----------
    traces : sequence of mapping
        What is drawn: "scatter", "bar", "waterfall" and "heatmap" in print, too, all others on the screen alone.
    layout : mapping
        Axes, legend and height; the page adds its own colours and letters.
    """

    traces: Sequence[Mapping[str, Any]]
    layout: Mapping[str, Any]

    @property
    def plain(self) -> dict[str, Any]:
        """The chart as plotly.js takes it; arrays are binary numbers of single precision.

        Raises
        ------
        ValueError
            Plotly does not know a property.
        """
        margin = {"r": 8, "t": 34}  # px, with room for the tools and a line of a legend above the axes
        import plotly.graph_objects as go

        layout = {"height": _HEIGHT, "legend": legend_above(), "margin": margin, **self.layout, "template": "none"}
        drawn = json.loads(go.Figure(data=[dict(t) for t in self.traces], layout=layout).to_json())
        return {"data": drawn["data"], "layout": drawn["layout"]}

    @property
    def json(self) -> str:
        """The same as the page holds it, drawn by `charts.js`."""
        return json.dumps(self.plain, separators=(",", ":"))

    @property
    def csv(self) -> str:
        """The numbers that are drawn: a heat map as a matrix, all else as a row for each point.

        What an axis shows heads its column where all points share it, and stands in the rows where panels differ.
        """
        first = self.traces[0]
        if first["type"] == "heatmap":
            return csv_text(("", *first["x"]), ((y, *row) for y, row in zip(first["y"], first["z"], strict=True)))
        rows: list[tuple[object, ...]] = []
        for trace in self.traces:
            sides = [self.layout.get(f"{k}axis{trace.get(f'{k}axis', k)[1:]}", {}) for k in "xy"]
            titles = [side.get("title", {}).get("text", "") for side in sides]
            error = trace.get("error_y")
            for i, (x, y) in enumerate(zip(*(_named(trace[k]) or trace[k] for k in "xy"), strict=True)):
                ends: tuple[object, ...] = ("", "")
                if error is not None:
                    ends = (_cell(y - error.get("arrayminus", error["array"])[i]), _cell(y + error["array"][i]))
                rows.append((trace.get("name", ""), titles[0], _cell(x), titles[1], _cell(y), *ends))
        header, kept = ["series", "x axis", "x", "y axis", "y", "lower", "upper"], list(range(7))
        if len({(row[1], row[3]) for row in rows}) == 1:
            header[2], header[4], kept = str(rows[0][1]) or "at", str(rows[0][3]) or "at", [0, 2, 4, 5, 6]
        kept = [k for k in kept if any(row[k] != "" for row in rows)]
        return csv_text([header[k] for k in kept], ([row[k] for k in kept] for row in rows))


def _cell(value: object) -> str:
    """Return a number to the digits of single precision, a name in one line, or a pair of names."""
    if isinstance(value, tuple):
        return " ".join(map(str, value))
    return value.replace("<br>", " ") if isinstance(value, str) else f"{value:.8g}"


def charted(
    name: str,
    chart: Chart,
    *,
    alt: str,
    caption: str,
    data: str = "",
    width: Literal["half", "full"] = "full",
    size: tuple[float, float] | None = None,
    form: Literal["svg", "png"] = "svg",
    n_colour: int = N_COLOUR,
) -> Picture:
    """Return a chart as a picture of a report.

    Parameters
    ----------
    name, alt, caption, width, form
        As in `Picture`.
    data : str
        Its numbers as CSV, by default those that are drawn.
    chart : Chart
        What it shows.
    size, n_colour
        Width and height (in) and colours of what is printed, as in `printed` and `png`.
    """
    inches = {"full": 9.0, "half": 6.4}  # width of a figure in print
    figure = printed(chart, size or (inches[width], chart.layout.get("height", _HEIGHT) / 100.0))
    return Picture(
        name=name,
        content=svg(figure) if form == "svg" else png(figure, n_colour),
        form=form,
        data=data or chart.csv,
        alt=alt,
        caption=caption,
        width=width,
        chart=chart.json,
    )


def printed(chart: Chart, size: tuple[float, float]) -> Figure:
    """Return a chart as a matplotlib figure of some width and height, in."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, layout="constrained")
    draw(chart, figure)
    return figure


def draw(chart: Chart, figure: FigureBase) -> None:
    """Draw a chart into a figure or a part of one: a panel for each axis upwards, one above the other."""
    layout = chart.layout
    names = {trace.get("yaxis", "y"): trace.get("xaxis", "x") for trace in chart.traces}
    domain = {up: layout.get(f"yaxis{up[1:]}", {}).get("domain", (0.0, 1.0)) for up in names}
    order = sorted(names, key=lambda up: -domain[up][0])
    heights = [np.ptp(domain[up]) for up in order]
    panels = dict(zip(order, figure.subplots(len(order), 1, squeeze=False, height_ratios=heights)[:, 0], strict=True))
    for up, axes in panels.items():
        across = names[up]
        traces = [trace for trace in chart.traces if trace.get("yaxis", "y") == up]
        beside = [trace for trace in chart.traces if trace.get("xaxis", "x") == across]
        x, y = layout.get(f"xaxis{across[1:]}", {}), layout.get(f"yaxis{up[1:]}", {})
        _draw_traces(axes, traces, _categories(beside, "x", x), _categories(traces, "y", y))
        _set_axis(axes, "x", x, _categories(beside, "x", x))
        _set_axis(axes, "y", y, _categories(traces, "y", y))
        if "scaleanchor" in y:
            axes.set_aspect("equal")
        lowest = next(u for u in reversed(order) if names[u] == across)
        if up != lowest:
            axes.sharex(panels[lowest])
            axes.tick_params(labelbottom=False)
            axes.set_xlabel("")
    handles = [axes.get_legend_handles_labels() for axes in panels.values()]
    labelled = {label: handle for pair in handles for handle, label in zip(*pair, strict=True)}
    if len(labelled) > 1 or "legendgroup" in chart.traces[0]:
        figure.legend(labelled.values(), labelled.keys(), loc="outside upper left", ncols=4, frameon=False, fontsize=8)


def _categories(traces: Sequence[Mapping[str, Any]], key: str, axis: Mapping[str, Any]) -> dict[object, int]:
    """Return the place of each name on an axis, of pairs of names where they are grouped; none where it has numbers."""
    names: list[object] = list(axis.get("categoryarray", ()))
    for trace in traces:
        names += _named(trace[key])
    return {name: place for place, name in enumerate(dict.fromkeys(names))}


def _named(values: Sequence[Any]) -> list[object]:
    if len(values) and isinstance(values[0], list):
        return list(zip(*values, strict=True))
    return list(values) if len(values) and isinstance(values[0], str) else []


def _at(values: Sequence[Any], places: Mapping[object, int]) -> Reals:
    return np.array([places[name] for name in _named(values)] if places else values, dtype=float)


def _draw_traces(
    axes: Axes, traces: Sequence[Mapping[str, Any]], across: Mapping[object, int], up: Mapping[object, int]
) -> None:
    bar_share = 0.8  # of the distance between two categories
    bars = [trace for trace in traces if trace["type"] in ("bar", "waterfall")]
    group = {id(trace): trace.get("offsetgroup", str(k)) for k, trace in enumerate(bars)}
    groups = list(dict.fromkeys(group.values()))
    for trace in traces:
        if trace["type"] == "heatmap":
            _draw_matrix(axes, trace, across, up)
        elif trace["type"] == "scatter":
            _draw_line(axes, trace, _at(trace["x"], across), _at(trace["y"], up))
        else:
            k, width = groups.index(group[id(trace)]), bar_share / len(groups)
            places = up if trace.get("orientation") == "h" else across
            _draw_bars(axes, trace, places, (k - 0.5 * (len(groups) - 1)) * width, 0.95 * width)


def _draw_bars(axes: Axes, trace: Mapping[str, Any], places: Mapping[object, int], shift: float, width: float) -> None:
    flat = trace.get("orientation") == "h"
    at = _at(trace["y" if flat else "x"], places) + shift
    value = np.array(trace["x" if flat else "y"], dtype=float)
    low = np.zeros_like(value)
    marker = trace.get("marker", {})
    if trace["type"] == "waterfall":  # a first bar, steps up and down, and what they come to
        height = np.cumsum(value[:-1])
        low[1:-1] = np.minimum(height[1:], height[:-1])
        value = np.append(np.maximum(height, np.append(0.0, height[:-1])), height[-1]) - low
        marker = trace["totals"]["marker"]
    style = {"color": marker.get("color"), "label": _label(trace)}
    if "line" in marker:
        style |= {"edgecolor": marker["line"]["color"], "linewidth": marker["line"]["width"]}
    drawn = axes.barh(at, value, width, low, **style) if flat else axes.bar(at, value, width, low, **style)
    if "text" in trace:
        axes.bar_label(drawn, trace["text"], padding=2, fontsize=8)
    if "error_y" in trace:
        color = trace["error_y"].get("color", palette.INK)
        axes.errorbar(at, value, trace["error_y"]["array"], fmt="none", ecolor=color, capsize=3, linewidth=1.0)


def _draw_line(axes: Axes, trace: Mapping[str, Any], x: Reals, y: Reals) -> None:
    points = 0.75  # of a marker in print over its px on the screen
    mode, line, marker = trace.get("mode", "lines"), trace.get("line", {}), trace.get("marker", {})
    style: dict[str, Any] = {
        "color": line.get("color") or marker.get("color"),
        "linestyle": _DASHES.get(line.get("dash"), "-") if "lines" in mode else "none",
        "linewidth": line.get("width", 1.5),
        "label": _label(trace),
    }
    if "markers" in mode:
        style["marker"] = _MARKERS[marker.get("symbol", "circle")]
        style["markersize"] = points * marker.get("size", 6)
    error = trace.get("error_y")
    if error is None:
        axes.plot(x, y, **style)
        return
    sides = (error.get("arrayminus", error["array"]), error["array"])
    axes.errorbar(x, y, np.array(sides, dtype=float), capsize=error.get("width", 4), **style)


def _draw_matrix(axes: Axes, trace: Mapping[str, Any], across: Mapping[object, int], up: Mapping[object, int]) -> None:
    dark = 0.6  # of a scale of colours, from which numbers are white
    x, y, z = _at(trace["x"], across), _at(trace["y"], up), np.asarray(trace["z"], dtype=float)
    low, high = trace.get("zmin", z.min()), trace.get("zmax", z.max())
    drawn = axes.pcolormesh(x, y, z, cmap=trace["colorscale"], vmin=low, vmax=high, shading="nearest")
    if "texttemplate" in trace:
        for (i, j), value in np.ndenumerate(z):
            color = "white" if value > low + dark * (high - low) else "black"
            at = float(x[j]), float(y[i])
            axes.text(*at, f"{value:.2f}", ha="center", va="center", fontsize="x-small", color=color)
        axes.set_aspect("equal")
    axes.figure.colorbar(drawn, ax=axes, label=trace["colorbar"]["title"]["text"], shrink=0.8)


def _label(trace: Mapping[str, Any]) -> str:
    """Return the name of a trace in the legend; that of its group, once, where it has one with a title."""
    if trace.get("showlegend") is False:
        return "_nolegend_"
    name = trace["legendgrouptitle"].get("text") if "legendgrouptitle" in trace else trace.get("name")
    return name or "_nolegend_"


def _set_axis(axes: Axes, key: Literal["x", "y"], stated: Mapping[str, Any], places: Mapping[object, int]) -> None:
    """Set title, scale, range and names of an axis."""
    room = 1.05  # above the largest value of an axis that begins at 0
    title = stated.get("title", {}).get("text", "")
    axes.set(**{f"{key}label": re.sub(r"\b(\w+)_(\w)\b", r"$\1_\2$", title)})
    axis = axes.xaxis if key == "x" else axes.yaxis
    if places:
        _name_places(axes, key, list(places))
    if stated.get("type") == "log":
        axes.set(**{f"{key}scale": "log"})
    if "range" in stated:
        axes.set(**{f"{key}lim": stated["range"]})
    elif stated.get("rangemode") == "tozero":
        axes.set(**{f"{key}lim": (0.0, room * axis.get_view_interval()[1])})
    if stated.get("zeroline"):
        axes.axhline(0.0, color=palette.INK, linewidth=0.8)
    if stated.get("autorange") == "reversed":
        axis.set_inverted(True)
    axes.spines[["top", "right"]].set_visible(False)


def _name_places(axes: Axes, key: Literal["x", "y"], names: list[Any]) -> None:
    shortest = 4  # characters of such a number
    beside = 60  # characters of all names that need not be turned
    most_numbers = 24  # that can be read there as they are
    most_names = 60  # that can be read below a figure, where they are turned
    if names and isinstance(names[0], tuple):  # the group's name where there are several
        together = len({group for group, _ in names}) > 1
        names = [", ".join(pair) if together else pair[1] for pair in names]
    texts = [name.replace("<br>", "\n") for name in names]
    length = [max(map(len, text.split("\n"))) for text in texts]
    short = max(length) <= shortest
    step = -(-len(texts) // (most_numbers if short else most_names))
    close = sum(length) > beside or axes.get_aspect() != "auto"  # a matrix is as narrow as its squares
    turned = key == "x" and close and not short
    style: dict[str, Any] = {"rotation": 60, "ha": "right", "rotation_mode": "anchor"} if turned else {}
    setter = axes.set_xticks if key == "x" else axes.set_yticks
    setter(range(0, len(texts), step), texts[::step], fontsize=8, **style)


def single(value: NDArray[np.floating[Any]]) -> NDArray[np.float32]:
    """Return numbers in the precision that a chart needs."""
    return np.asarray(value, dtype=np.float32)


def axis(title: str, **others: Any) -> dict[str, Any]:
    """Return an axis with a title that never overlaps its numbers."""
    return {"title": {"text": title, "standoff": 8}, "automargin": True, **others}


def legend_above() -> dict[str, Any]:
    """Return a legend in a line above the axes."""
    return {"orientation": "h", "x": 0.0, "y": 1.02, "yanchor": "bottom"}
