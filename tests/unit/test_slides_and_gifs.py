"""Shapes that move as GIF, and the main pages as slides."""

import io
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image
from pptx import Presentation

from updating.fitting.shape_plot import ShapePair
from updating.report import slides
from updating.report.moving import shape_gif
from updating.report.part import Opening, Picture, Section, Table


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
    table = Table(
        title="Identified modes", header=("mode", "f"), rows=tuple((str(r), "1") for r in range(16))
    )
    for name, made in (
        ("opening", lambda _: Opening(badge="identified", tone="found", sentence="It lacks a mass.")),
        ("steps", lambda _: ()),
        ("mode_changes", lambda _: ()),
        ("identified_table", lambda _: table),
        ("errors_with_additions", lambda _: {}),
        ("shape_section", lambda _: Section(title="Shapes", blocks=shapes)),
    ):
        monkeypatch.setattr(slides, name, made)
    path = slides.write_slides(
        SimpleNamespace(name="A test", folder=tmp_path, tested=[SimpleNamespace(name="M1", fit=None)])
    )
    show = Presentation(str(path))
    titles = [slide.shapes.title.text for slide in show.slides]
    assert titles == [
        "A test: identified", *2 * ["M1: Identified modes"], *2 * ["Mode shapes of M1"]
    ]  # fmt: skip
    assert "It lacks a mass." in [
        shape.text_frame.text for shape in show.slides[0].shapes if shape.has_text_frame
    ]
    rows = [len(s.table.rows) for slide in show.slides for s in slide.shapes if s.has_table]
    assert rows == [15, 3]
    for slide in show.slides:
        for shape in slide.shapes:
            assert 0 <= shape.left < shape.left + shape.width <= show.slide_width
            assert 0 <= shape.top < shape.top + shape.height <= show.slide_height
