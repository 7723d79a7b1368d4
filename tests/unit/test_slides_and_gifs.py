"""Shapes that move as GIF, and the main pages as slides."""

import io
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image
from pptx import Presentation
from pptx.enum.shapes import MSO_SHAPE_TYPE

from updating.fitting.plots import ShapePair
from updating.report import files
from updating.report.files import shape_gif
from updating.report.part import Opening, Picture, Section
from updating.results.text import Table


@pytest.fixture
def alone():
    """A shape without a partner, which is one picture."""
    x = np.linspace(-0.2, 0.2, 4)
    moved = np.outer(x / 0.2, [0.0, 0.0, 1.0])
    return ShapePair(
        measured_frequency=100.0, model_frequency=np.nan, mac=np.nan, node=[1, 2, 3, 4],
        coordinate=np.outer(x, [1.0, 0.0, 0.0]), line=[[0, 1], [1, 2], [2, 3]], measured=moved, model=0.0 * moved,
    )  # fmt: skip


def test_a_gif_holds_one_period_in_which_the_shape_comes_back(alone):
    gif = Image.open(io.BytesIO(shape_gif(alone)))
    assert gif.n_frames == 16
    assert gif.info["loop"] == 0
    frames = []
    for k in (0, 1, 4, 8, 15):
        gif.seek(k)
        frames.append(np.asarray(gif.convert("L"), dtype=float))
    first, second, quarter, half, last = frames
    changed = [float(np.abs(first - other).mean()) for other in (second, quarter, half, last)]
    assert 0 < changed[0] < changed[1] < changed[2]
    assert changed[3] == pytest.approx(changed[0], rel=0.05)


def test_slides_hold_the_answer_the_modes_and_the_shapes(tmp_path, monkeypatch):
    drawn = io.BytesIO()
    Image.new("RGB", (40, 10)).save(drawn, format="png")
    shapes = tuple(
        Picture(name=f"s{k}", content=drawn.getvalue(), form="png", data="", alt=f"Mode {k}", caption="")
        for k in range(4)
    )
    table = Table(title="Identified modes", header=("mode", "f"), rows=tuple((str(r), "1") for r in range(16)))
    for name, made in (
        ("opening", lambda _: Opening(badge="identified", tone="found", sentence="It lacks a mass.")),
        ("steps", lambda _: ()),
        ("mode_changes", lambda _: ()),
        ("identified_table", lambda _: table),
        ("errors_with_additions", lambda _: {}),
        ("shape_section", lambda _: Section(title="Shapes", blocks=shapes)),
        ("auto_mac_picture", lambda _: shapes[0]),
        ("frf_figure", lambda *_, beside: Figure(figsize=(12, 6) if beside else (6, 12))),
        ("model_functions", lambda *_: {}),
        ("within_band", lambda *_: None),
    ):
        monkeypatch.setattr(files, name, made)
    path = files.write_slides(
        SimpleNamespace(
            name="A test",
            folder=tmp_path,
            tested=[
                SimpleNamespace(
                    name="M1", fit=None, identified=None, has_functions=True, measured=None, frf=lambda: None
                )
            ],
        )
    )
    show = Presentation(str(path))
    titles = [slide.shapes.title.text for slide in show.slides]
    assert titles == [
        "A test: identified", *2 * ["M1: Identified modes"], "MAC of M1", "FRFs of M1", *2 * ["Mode shapes of M1"]
    ]  # fmt: skip
    assert "It lacks a mass." in [shape.text_frame.text for shape in show.slides[0].shapes if shape.has_text_frame]
    rows = [len(s.table.rows) for slide in show.slides for s in slide.shapes if s.has_table]
    assert rows == [15, 3]
    functions = next(
        s for s in show.slides[titles.index("FRFs of M1")].shapes if s.shape_type == MSO_SHAPE_TYPE.PICTURE
    )
    assert functions.width > 0.8 * show.slide_width  # beside each other: one under the other they fill a third of it
    for slide in show.slides:
        for shape in slide.shapes:
            assert 0 <= shape.left < shape.left + shape.width <= show.slide_width
            assert 0 <= shape.top < shape.top + shape.height <= show.slide_height


def fitted(error, mac):
    return SimpleNamespace(
        error=error, pairing=SimpleNamespace(paired_mac=np.array([mac]), measured=np.array([0])), name="M1"
    )


def test_slides_show_the_mac_of_both_models_and_all_places_of_error_beside_each_other(tmp_path, monkeypatch):
    drawn = io.BytesIO()
    Image.new("RGB", (40, 30)).save(drawn, format="png")
    picture = Picture(name="p", content=drawn.getvalue(), form="png", data="", alt="Mode 1", caption="")
    found = replace(picture, name="shape_found", alt="Mode 1 found")
    for name, made in (
        ("opening", lambda _: Opening(badge="identified", tone="found", sentence="It lacks a mass.")),
        ("steps", lambda _: ()),
        ("mode_changes", lambda _: ()),
        ("pair_tables", lambda *_: (Table(title="Both", header=("mode",), rows=(("1",),)),)),
        ("errors_with_additions", lambda _: {}),
        ("shape_section", lambda _: Section(title="Shapes", blocks=(found, picture))),
        ("pairs_picture", lambda *_: picture),
        ("location_section", lambda *_: Section(title="Where", blocks=(picture,))),
    ):
        monkeypatch.setattr(files, name, made)
    tested = [
        SimpleNamespace(
            name=name, fit=fitted(0.03, 0.9), stack_fit=fitted(0.03, 0.9),
            identified=SimpleNamespace(fit=fitted(0.002, 0.99)), has_functions=False,
        )
        for name in ("M1", "M2")
    ]  # fmt: skip
    path = files.write_slides(SimpleNamespace(name="A test", folder=tmp_path, tested=tested))
    show = {slide.shapes.title.text: slide for slide in Presentation(str(path)).slides}
    assert list(show) == [
        "A test: identified", "Where the base model fails",
        *(f"{name}" for one in ("M1", "M2") for name in (f"{one}: Both", f"MAC of {one}", f"Mode shapes of {one}")),
    ]  # fmt: skip

    def pictures(title):
        return [s for s in show[title].shapes if s.shape_type == MSO_SHAPE_TYPE.PICTURE]

    def words(title):
        return [s.text_frame.text for s in show[title].shapes if s.has_text_frame]

    assert len(pictures("MAC of M1")) == len(pictures("Where the base model fails")) == 2
    left, right = sorted(pictures("MAC of M1"), key=lambda s: s.left)
    assert left.left + left.width <= right.left
    assert "with what was identified: mean frequency error 0.20 %, mean MAC 0.990" in words("MAC of M1")
    assert "Mode 1 found" in words("Mode shapes of M1")
    assert "Mode 1" not in words("Mode shapes of M1")  # of the base model
