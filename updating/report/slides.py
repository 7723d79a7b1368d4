"""The main pages of the report as slides, which laboratories hand on: answer, pictures, modes, MAC, FRFs, shapes."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ema.plot.figures import as_png
from updating.correlation.frf_plot import within_band
from updating.report.change_part import errors_with_additions, mode_changes, mode_figure, step_figure, steps
from updating.report.frf_part import frf_figure, model_functions
from updating.report.location_part import location_section
from updating.report.modes_part import auto_mac_picture, identified_table, mac_picture, pair_tables
from updating.report.opening import opening
from updating.report.part import Picture, Table
from updating.report.results import Results, Tested
from updating.report.shape_part import shape_section
from updating.results.store import write_bytes
from updating.results.text import percent

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_WIDE, _HIGH, _EDGE = 13.333, 7.5, 0.5  # in
_TOP = 1.4  # in, below the title
_PER_SLIDE = 14  # rows of a table
_SHAPES = 3  # pictures of shapes over each other
_BESIDE = 2  # pictures beside each other


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
    if any(t.fit is not None for t in results.tested):
        _places(show, results.tested)
    added = errors_with_additions(results)
    for tested in results.tested:
        _configuration(show, tested, added.get(tested.name, {}))
    buffer = io.BytesIO()
    show.save(buffer)
    path = results.folder / "report.pptx"
    write_bytes(path, buffer.getvalue())
    return path


def _places(show: Any, every: Sequence[Tested]) -> None:
    """Put the pictures of where the base model fails beside each other."""
    parts = [(t.name, part) for t in every if (part := _location(t)) is not None]
    for start in range(0, len(parts), _BESIDE):
        slide = _slide(show, "Where the base model fails")
        width = (_WIDE - 2 * _EDGE) / min(_BESIDE, len(parts))
        for k, (name, own) in enumerate(parts[start : start + _BESIDE]):
            place = _EDGE + k * width
            _text(slide, name, _TOP, 14, left=place, width=width)
            _picture(slide, own.content, _TOP + 0.5, _HIGH - _TOP - 1.0, left=place, width=width - 0.2)


def _location(tested: Tested) -> Picture | None:
    """Return the picture of where the base model of a configuration fails; None where there is nothing to locate."""
    fit = tested.stack_fit
    if fit is None or not fit.pairing.measured.size:
        return None
    return next(iter(location_section(tested, fit).pictures), None)


def _sized(figure: Figure) -> Figure:
    figure.set_size_inches(9.0, 3.6)
    return figure


def _configuration(show: Any, tested: Tested, added: Mapping[int, float]) -> None:
    tables = (identified_table(tested),) if tested.fit is None else pair_tables(tested, tested.fit, added)
    table = tables[0]  # of the model with what was identified, where there is one
    for start in range(0, len(table.rows), _PER_SLIDE):
        _table(_slide(show, f"{tested.name}: {table.title}"), table, table.rows[start : start + _PER_SLIDE])
    _likeness(show, tested)
    if tested.has_functions:
        frf = tested.frf()
        models = model_functions(tested, within_band(frf, tested.measured))
        content = as_png(frf_figure(tested, frf, models, beside=True))
        _picture(_slide(show, f"FRFs of {tested.name}"), content, _TOP - 0.2, _HIGH - _TOP - 0.1)
    shapes = [p for p in shape_section(tested).pictures if tested.identified is None or "_found" in p.name]
    for start in range(0, len(shapes), _SHAPES):
        slide = _slide(show, f"Mode shapes of {tested.name}")
        height = (_HIGH - _TOP - _EDGE) / _SHAPES
        for k, own in enumerate(shapes[start : start + _SHAPES]):
            _text(slide, own.alt, _TOP + k * height, 12)
            _picture(slide, own.content, _TOP + k * height + 0.35, height - 0.4)


def _likeness(show: Any, tested: Tested) -> None:
    """Put the MAC on a slide, of the base model and of the model with what was identified beside each other."""
    slide = _slide(show, f"MAC of {tested.name}")
    if tested.fit is None:
        _picture(slide, auto_mac_picture(tested).content, _TOP, _HIGH - 2.0)
        return
    fits = {"base model": tested.fit}
    if tested.identified is not None:
        fits["with what was identified"] = tested.identified.fit
    width = (_WIDE - 2 * _EDGE) / len(fits)
    for k, (name, own) in enumerate(fits.items()):
        left = _EDGE + k * width
        text = (
            f"{name}: mean frequency error {percent(own.error)}, mean MAC {own.pairing.paired_mac.mean():.3f}"
        )
        _text(slide, text, _TOP - 0.2, 14, left=left, width=width)
        _picture(
            slide, mac_picture(tested, own).content, _TOP + 0.3, _HIGH - 2.2, left=left, width=width - 0.2
        )


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


def _text(
    slide: Any,
    words: str,
    top: float,
    points: int,
    *,
    left: float = _EDGE,
    width: float = _WIDE - 2 * _EDGE,
) -> None:
    from pptx.util import Inches, Pt

    box = slide.shapes.add_textbox(*map(Inches, (left, top, width, 0.4)))
    box.text_frame.word_wrap = True
    box.text_frame.text = words
    box.text_frame.paragraphs[0].font.size = Pt(points)


def _picture(
    slide: Any,
    content: bytes,
    top: float,
    height: float,
    *,
    left: float = _EDGE,
    width: float = _WIDE - 2 * _EDGE,
) -> None:
    """Put a picture into a place (in), as large as it fits and in its middle."""
    from PIL import Image
    from pptx.util import Inches

    wide, high = Image.open(io.BytesIO(content)).size
    own = min(width, height * wide / high)
    place = Inches(left + (width - own) / 2.0), Inches(top)
    slide.shapes.add_picture(io.BytesIO(content), *place, width=Inches(own))


def _table(slide: Any, table: Table, rows: Sequence[Sequence[str]]) -> None:
    from pptx.util import Inches, Pt

    place = map(Inches, (_EDGE, _TOP, _WIDE - 2 * _EDGE, 0.35 * (len(rows) + 1)))
    cells = slide.shapes.add_table(len(rows) + 1, len(table.header), *place).table
    for i, row in enumerate((table.header, *rows)):
        for k, words in enumerate(row):
            cells.cell(i, k).text = words
            cells.cell(i, k).text_frame.paragraphs[0].font.size = Pt(13)
