"""Parts of a report by themselves: how tables are set, what stands where, what is said when something is missing."""

import io
import stat

import numpy as np
import pytest
from PIL import Image

from ema import Dofs, Geometry
from lamella_shared import csv_text
from updating import StoreError
from updating.report import files
from updating.report.page import render
from updating.report.part import Picture, Section, fewer_colours
from updating.results.text import Table


def table(*columns, **others):
    return Table(title="T", header=("h",) * len(columns), rows=tuple(zip(*columns, strict=True)), **others)


@pytest.mark.parametrize(
    ("cells", "expected"),
    [
        (("1", "-2.5", "+0.01"), ""),
        (("1479.64 ± 0.11", "(1.19982 ± 0.00020)e-11", "1.2e-05"), ""),
        (("364 | 394 | 407",), ""),
        (("", "12"), ""),
        (("M1", "2"), "text"),
        (("a sentence that is longer than thirty characters",), "long"),
    ],
)
def test_numbers_are_set_to_the_right_and_words_to_the_left(cells, expected):
    assert table(cells).column_class == (expected,)


def test_columns_without_a_word_are_left_out():
    short = table(("M1", "M2"), ("", ""), ("", "3")).without_empty_columns()
    assert short.rows == (("M1", ""), ("M2", "3"))
    assert len(short.header) == 2


def test_a_page_escapes_what_it_is_given_and_links_rows_to_sections():
    parts = (
        Section(
            title="All <stacks>",
            text=("a < b",),
            blocks=(table(("<x>",), ("1",), link=("#stack-x",)), table(("hidden",), folded=True)),
        ),
        Section(title="Stack x"),
    )
    page = render("Title & more", parts)
    assert "Title &amp; more" in page
    assert "a &lt; b" in page
    assert '<a href="#stack-x">&lt;x&gt;</a>' in page
    assert 'id="stack-x"' in page
    assert page.count("<details>") == 1


def test_sections_hand_out_the_pictures_within_them():
    picture = Picture(name="p", content=b"x", form="svg", data="", alt="", caption="")
    inner = Section(title="inner", blocks=(picture,))
    assert Section(title="outer", blocks=(picture, table(("1",))), parts=(inner,)).pictures == (picture, picture)


def test_numbers_of_a_figure_keep_full_precision():
    value = 0.1 + 0.2
    text = csv_text(("a [m]", "b"), [(value, 1)])
    assert text.splitlines()[0] == "a [m],b"
    assert float(text.splitlines()[1].split(",")[0]) == value


def test_a_picture_of_few_colours_keeps_its_lines():
    image = Image.new("RGB", (40, 40), "white")
    image.paste((31, 95, 139), (0, 10, 40, 12))
    buffer = io.BytesIO()
    image.save(buffer, format="png")
    small = Image.open(io.BytesIO(fewer_colours(buffer.getvalue()))).convert("RGB")
    assert np.abs(np.asarray(small, int) - np.asarray(image, int)).max() <= 2


def test_points_measured_in_skew_directions_move_as_they_were_measured():
    geometry = Geometry(node=np.array([1, 2, 3]), coordinate=np.eye(3), line=np.empty((0, 2), int))
    skew = np.array([0.6, 0.0, 0.8])
    direction = np.array([[1.0, 0.0, 0.0], skew, [0.0, 0.0, -1.0]])
    moved = geometry.displacement(Dofs(node=[1, 1, 2], direction=direction), np.array([2.0, 3.0, 4.0j]))
    assert moved[0] @ skew == pytest.approx(3.0)
    assert moved[0, 0] == pytest.approx(2.0)
    np.testing.assert_allclose(moved[1], [0.0, 0.0, -4.0j])
    np.testing.assert_array_equal(moved[2], 0.0)


def test_without_a_browser_it_is_said_what_to_install(monkeypatch, tmp_path):
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr(files, "_PATHS", (str(tmp_path / "nowhere"),))
    with pytest.raises(StoreError, match=r"apt install chromium.*Google Chrome or Microsoft Edge"):
        files.print_pdf(tmp_path / "report.html")


def browser(folder, script):
    file = folder / "chromium"
    file.write_text(f"#!/bin/sh\n{script}\n", encoding="utf-8")
    file.chmod(file.stat().st_mode | stat.S_IXUSR)
    return file


def test_a_browser_that_fails_leaves_the_earlier_pdf_and_says_why(monkeypatch, tmp_path):
    (tmp_path / "report.pdf").write_bytes(b"earlier")
    one = browser(tmp_path, "echo 'cannot open display' >&2; exit 3")
    monkeypatch.setattr(files, "find_browser", lambda: one)
    with pytest.raises(StoreError, match=r"exit code 3.*cannot open display"):
        files.print_pdf(tmp_path / "report.html")
    assert (tmp_path / "report.pdf").read_bytes() == b"earlier"


def test_the_first_browser_on_the_path_prints(monkeypatch, tmp_path):
    script = 'for a in "$@"; do case $a in --print-to-pdf=*) printf %%PDF > "${a#*=}";; esac; done'
    one = browser(tmp_path, script)
    monkeypatch.setenv("PATH", str(tmp_path))
    assert files.find_browser() == one
    assert files.print_pdf(tmp_path / "report.html").read_bytes() == b"%PDF"
