"""The main pages of the report as slides, which laboratories hand on: answer, pictures, modes and shapes."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from updating.fitting.fit_plot import as_png
from updating.report.change_part import errors_with_additions, mode_changes, mode_figure, step_figure, steps
from updating.report.modes_part import identified_table, pair_table
from updating.report.opening import opening
from updating.report.part import Picture, Table
from updating.report.results import Results, Tested
from updating.report.shape_part import shape_section
from updating.results.store import write_bytes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_WIDE, _HIGH, _EDGE = 13.333, 7.5, 0.5  # in
_TOP = 1.4  # in, below the title
_PER_SLIDE = 14  # rows of a table
_SHAPES = 3  # pictures of shapes over each other


def write_slides(results: Results) -> Path:
    """Write `report.pptx` beside the page and return its path.

    Raises
    ------
    StoreError
        The folder cannot be written to.
    """
    from pptx import Presentation
    from pptx.util import Inches

    show: Any = Presentation()
    show.slide_width, show.slide_height = Inches(_WIDE), Inches(_HIGH)
    own = opening(results)
    way, modes = steps(results), mode_changes(results)
    first = _slide(show, f"{results.name}: {own.badge}", own.sentence)
    if way:
        _picture(first, as_png(_sized(step_figure(way))), 2.6, _HIGH - 3.0)
    if modes:
        _picture(_slide(show, "Frequency error of every mode"), as_png(mode_figure(modes)), _TOP, _HIGH - 2.0)
    added = errors_with_additions(results)
    for tested in results.tested:
        _configuration(show, tested, added.get(tested.name, {}))
    buffer = io.BytesIO()
    show.save(buffer)
    path = results.folder / "report.pptx"
    write_bytes(path, buffer.getvalue())
    return path


def _sized(figure: Figure) -> Figure:
    figure.set_size_inches(9.0, 3.6)
    return figure


def _configuration(show: Any, tested: Tested, added: Mapping[int, float]) -> None:
    table = identified_table(tested) if tested.fit is None else pair_table(tested, tested.fit, added)
    for start in range(0, len(table.rows), _PER_SLIDE):
        _table(_slide(show, f"{tested.name}: {table.title}"), table, table.rows[start : start + _PER_SLIDE])
    shapes: tuple[Picture, ...] = shape_section(tested).pictures
    for start in range(0, len(shapes), _SHAPES):
        slide = _slide(show, f"Mode shapes of {tested.name}")
        height = (_HIGH - _TOP - _EDGE) / _SHAPES
        for k, own in enumerate(shapes[start : start + _SHAPES]):
            _text(slide, own.alt, _TOP + k * height, 12)
            _picture(slide, own.content, _TOP + k * height + 0.35, height - 0.4)


def _slide(show: Any, title: str, sentence: str = "") -> Any:
    slide = show.slides.add_slide(show.slide_layouts[5])  # a title alone
    from pptx.util import Inches, Pt

    heading = slide.shapes.title
    heading.left, heading.top, heading.width, heading.height = map(
        Inches, (_EDGE, 0.3, _WIDE - 2 * _EDGE, 0.9)
    )
    heading.text = title
    heading.text_frame.paragraphs[0].font.size = Pt(28)
    if sentence:
        _text(slide, sentence, _TOP, 18)
    return slide


def _text(slide: Any, words: str, top: float, points: int) -> None:
    from pptx.util import Inches, Pt

    box = slide.shapes.add_textbox(*map(Inches, (_EDGE, top, _WIDE - 2 * _EDGE, 0.4)))
    box.text_frame.word_wrap = True
    box.text_frame.text = words
    box.text_frame.paragraphs[0].font.size = Pt(points)


def _picture(slide: Any, content: bytes, top: float, height: float) -> None:
    """Put a picture between the edges, as large as it fits."""
    from PIL import Image
    from pptx.util import Inches

    wide, high = Image.open(io.BytesIO(content)).size
    width = min(_WIDE - 2 * _EDGE, height * wide / high)
    left = (_WIDE - width) / 2.0
    slide.shapes.add_picture(io.BytesIO(content), Inches(left), Inches(top), width=Inches(width))


def _table(slide: Any, table: Table, rows: Sequence[Sequence[str]]) -> None:
    from pptx.util import Inches, Pt

    place = map(Inches, (_EDGE, _TOP, _WIDE - 2 * _EDGE, 0.35 * (len(rows) + 1)))
    cells = slide.shapes.add_table(len(rows) + 1, len(table.header), *place).table
    for i, row in enumerate((table.header, *rows)):
        for k, words in enumerate(row):
            cells.cell(i, k).text = words
            cells.cell(i, k).text_frame.paragraphs[0].font.size = Pt(13)
