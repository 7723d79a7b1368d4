"""What a report is made of: tables, figures with their data, charts that zoom, turnable shapes, sections."""

from __future__ import annotations

import base64
import csv
import gzip
import io
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from importlib.resources import files
from typing import TYPE_CHECKING, Any, Literal, TypeVar

import numpy as np

from updating.results.text import Shown, Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure
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


def as_csv(header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Write numbers as CSV with a line of names and units above."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(header)
    writer.writerows(rows)
    return text.getvalue()


def renderer() -> str:
    """Return plotly.js, which draws the charts, from the installed package; a page holds it once."""
    return (files("plotly") / "package_data" / "plotly.min.js").read_text(encoding="utf-8")
