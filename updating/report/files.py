"""The report as other files: PDF, slides, GIFs that move, and figures in a notebook."""

from __future__ import annotations

import io
import os
import shutil
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ema.plot.figures import as_png, within_band
from lamella_shared import figure_of, html_of, html_table
from updating.diagnosis.answer import Diagnosis
from updating.errors import StoreError
from updating.fitting.fit import Fit
from updating.fitting.plots import ShapePair, shape_pair_figure, shape_pairs
from updating.report.answer import headline, opening
from updating.report.change_part import (
    diagnosis_steps,
    errors_with_additions,
    mode_changes,
    mode_chart,
    step_chart,
    steps,
)
from updating.report.frf_part import frf_figure, model_functions
from updating.report.modes_part import (
    auto_mac_picture,
    identified_table,
    mac_chart,
    objective_chart,
    pair_tables,
    pairs_picture,
    shape_section,
)
from updating.report.part import N_COLOUR, Picture, draw, printed
from updating.report.results import Results, Tested
from updating.report.state_part import location_section
from updating.results.store import folder_name, write_bytes
from updating.results.text import Table, interval_text, parameter_text, percent

if TYPE_CHECKING:
    from matplotlib.figure import Figure


NAMES = (
    "chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome", "microsoft-edge",
    "microsoft-edge-stable", "msedge", "brave-browser",
)  # fmt: skip
"""Programs looked for on PATH."""

_PATHS = (
    "/Applications/Google Chrome.app/Contents/MacOS/Google Chrome",
    "/Applications/Chromium.app/Contents/MacOS/Chromium",
    "/Applications/Microsoft Edge.app/Contents/MacOS/Microsoft Edge",
    "/snap/bin/chromium",
    *(
        rf"{os.environ.get(root, root)}\{rest}"
        for root in ("PROGRAMFILES", "PROGRAMFILES(X86)", "LOCALAPPDATA")
        for rest in (r"Google\Chrome\Application\chrome.exe", r"Microsoft\Edge\Application\msedge.exe")
    ),
)

_FLAGS = (
    "--headless", "--disable-gpu", "--disable-extensions", "--disable-sync", "--disable-background-networking",
    "--disable-component-update", "--no-first-run", "--no-default-browser-check", "--no-pdf-header-footer",
)  # fmt: skip


def find_browser() -> Path:
    """Return a browser that can print a page without a window.

    Raises
    ------
    StoreError
        None is on PATH or at its usual place.
    """
    program = next((path for path in map(shutil.which, NAMES) if path is not None), None)
    program = program or next((path for path in _PATHS if Path(path).is_file()), None)
    if program is None:
        raise StoreError(
            "no browser to print a PDF with. Install one: `apt install chromium` on Debian, `snap install chromium` on "
            "Ubuntu, `dnf install chromium` on Fedora, else Google Chrome or Microsoft Edge, so that one of "
            f"{', '.join(NAMES[:4])} or msedge is on PATH; or open report.html in any browser and print it"
        )
    return Path(program)


def print_pdf(page: Path) -> Path:
    """Print a page to a PDF beside it and return its path.

    Raises
    ------
    StoreError
        There is no browser, it fails, or the PDF cannot be written.
    """
    seconds = 180.0
    browser = find_browser()
    with tempfile.TemporaryDirectory() as folder:
        printed = Path(folder) / "page.pdf"
        command = [str(browser), *_FLAGS, f"--user-data-dir={folder}/profile", f"--print-to-pdf={printed}"]
        if hasattr(os, "geteuid") and os.geteuid() == 0:
            command.append("--no-sandbox")  # as root, as in a container, it does not start with one
        try:
            process = subprocess.run(
                [*command, page.resolve().as_uri()], capture_output=True, text=True, timeout=seconds, check=False
            )
        except (OSError, subprocess.TimeoutExpired) as error:
            raise StoreError(f"{browser} could not print {page}: {error}") from error
        if not printed.exists():
            last = (process.stderr.strip().splitlines() or ["it said nothing"])[-1]
            raise StoreError(f"{browser} printed nothing of {page} (exit code {process.returncode}): {last}")
        content = printed.read_bytes()
    path = page.with_suffix(".pdf")
    write_bytes(path, content)
    return path


_WIDE, _HIGH, _EDGE = 13.333, 7.5, 0.5  # in

_TOP = 1.4  # in, below the title


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
    answer = opening(results)
    way, modes = steps(results), mode_changes(results)
    first = _slide(show, f"{results.name}: {answer.badge}", answer.sentence)
    if way:
        _picture(first, as_png(printed(step_chart(way), (9.0, 3.6))), 2.6, _HIGH - 3.0)
    if modes:
        content = as_png(printed(mode_chart(modes), (9.0, 2.9)))
        _picture(_slide(show, "Frequency error of every mode"), content, _TOP, _HIGH - 2.0)
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


def _places(show: Any, tested: Sequence[Tested]) -> None:
    """Put the pictures of where the base model fails beside each other."""
    beside = 2  # pictures beside each other
    parts = [(t.name, part) for t in tested if (part := _location(t)) is not None]
    for start in range(0, len(parts), beside):
        slide = _slide(show, "Where the base model fails")
        width = (_WIDE - 2 * _EDGE) / min(beside, len(parts))
        for k, (name, picture) in enumerate(parts[start : start + beside]):
            place = _EDGE + k * width
            _text(slide, name, _TOP, 14, left=place, width=width)
            _picture(slide, picture.content, _TOP + 0.5, _HIGH - _TOP - 1.0, left=place, width=width - 0.2)


def _location(tested: Tested) -> Picture | None:
    """Return the picture of where the base model of a configuration fails; None where there is nothing to locate."""
    fit = tested.stack_fit
    if fit is None or not fit.pairing.measured.size:
        return None
    return next(iter(location_section(tested, fit).pictures), None)


def _configuration(show: Any, tested: Tested, added: Mapping[int, float]) -> None:
    most_shapes = 3  # pictures of shapes over each other
    per_slide = 14  # rows of a table
    tables = (identified_table(tested),) if tested.fit is None else pair_tables(tested, tested.fit, added)
    table = tables[0]  # of the model with what was identified, where there is one
    for start in range(0, len(table.rows), per_slide):
        _table(_slide(show, f"{tested.name}: {table.title}"), table, table.rows[start : start + per_slide])
    _likeness(show, tested)
    if tested.has_functions:
        frf = tested.frf()
        models = model_functions(tested, within_band(frf, tested.measured))
        content = as_png(frf_figure(tested, frf, models, beside=True))
        _picture(_slide(show, f"FRFs of {tested.name}"), content, _TOP - 0.2, _HIGH - _TOP - 0.1)
    shapes = [p for p in shape_section(tested).pictures if tested.identified is None or "_found" in p.name]
    for start in range(0, len(shapes), most_shapes):
        slide = _slide(show, f"Mode shapes of {tested.name}")
        height = (_HIGH - _TOP - _EDGE) / most_shapes
        for k, shape in enumerate(shapes[start : start + most_shapes]):
            _text(slide, shape.alt, _TOP + k * height, 12)
            _picture(slide, shape.content, _TOP + k * height + 0.35, height - 0.4)


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
    for k, (name, fit) in enumerate(fits.items()):
        left = _EDGE + k * width
        text = f"{name}: mean frequency error {percent(fit.error)}, mean MAC {fit.pairing.paired_mac.mean():.3f}"
        _text(slide, text, _TOP - 0.2, 14, left=left, width=width)
        _picture(slide, pairs_picture(tested, fit).content, _TOP + 0.3, _HIGH - 2.2, left=left, width=width - 0.2)


def _slide(show: Any, title: str, sentence: str = "") -> Any:
    slide = show.slides.add_slide(show.slide_layouts[5])  # a title alone
    from pptx.util import Inches, Pt

    heading = slide.shapes.title
    heading.left, heading.top, heading.width, heading.height = map(Inches, (_EDGE, 0.3, _WIDE - 2 * _EDGE, 0.9))
    heading.text = title
    heading.text_frame.paragraphs[0].font.size = Pt(28)
    if sentence:
        _text(slide, sentence, _TOP, 18)
    return slide


def _text(
    slide: Any, text: str, top: float, points: int, *, left: float = _EDGE, width: float = _WIDE - 2 * _EDGE
) -> None:
    from pptx.util import Inches, Pt

    box = slide.shapes.add_textbox(*map(Inches, (left, top, width, 0.4)))
    box.text_frame.word_wrap = True
    box.text_frame.text = text
    box.text_frame.paragraphs[0].font.size = Pt(points)


def _picture(
    slide: Any, content: bytes, top: float, height: float, *, left: float = _EDGE, width: float = _WIDE - 2 * _EDGE
) -> None:
    """Put a picture into a place (in), as large as it fits and in its middle."""
    from PIL import Image
    from pptx.util import Inches

    wide, high = Image.open(io.BytesIO(content)).size
    drawn_width = min(width, height * wide / high)
    place = Inches(left + (width - drawn_width) / 2.0), Inches(top)
    slide.shapes.add_picture(io.BytesIO(content), *place, width=Inches(drawn_width))


def _table(slide: Any, table: Table, rows: Sequence[Sequence[str]]) -> None:
    from pptx.util import Inches, Pt

    place = map(Inches, (_EDGE, _TOP, _WIDE - 2 * _EDGE, 0.35 * (len(rows) + 1)))
    cells = slide.shapes.add_table(len(rows) + 1, len(table.header), *place).table
    for i, row in enumerate((table.header, *rows)):
        for k, text in enumerate(row):
            cells.cell(i, k).text = text
            cells.cell(i, k).text_frame.paragraphs[0].font.size = Pt(13)


def write_gifs(results: Results) -> tuple[Path, ...]:
    """Write one period of every mode shape, measured, modelled and both, to `figures` and return the files.

    Raises
    ------
    StoreError
        The folder cannot be written to.
    """
    paths = []
    for tested in results.tested:
        for number, pair in enumerate(shape_pairs(tested.measured, tested.shown), start=1):
            name = folder_name(f"shape_{tested.name}_{number:02d}")
            paths.append(results.folder / "figures" / f"{name}.gif")
            write_bytes(paths[-1], shape_gif(pair))
    return tuple(paths)


def shape_gif(pair: ShapePair) -> bytes:
    """Draw one period of a shape as a GIF that goes round for ever."""
    n_picture = 16  # of one period
    dpi = 140
    pause = 60  # ms between them
    from PIL import Image

    pictures = []
    for phase in 2.0 * np.pi * np.arange(n_picture) / n_picture:
        moved = replace(
            pair, measured=(pair.measured * np.exp(1j * phase)).real.astype(complex), model=pair.model * np.cos(phase)
        )
        drawn = io.BytesIO()
        shape_pair_figure(moved).savefig(drawn, format="png", dpi=dpi)
        pictures.append(Image.open(drawn).convert("RGB").quantize(N_COLOUR, dither=Image.Dither.NONE))
    out = io.BytesIO()
    pictures[0].save(out, format="gif", save_all=True, append_images=pictures[1:], duration=pause, loop=0, disposal=1)
    return out.getvalue()


@html_of.register(Fit)
def fit_html(fit: Fit) -> str:
    """Write G_f, d_f, the error and the findings, and list the pairs."""
    pairing = fit.pairing
    rows = [
        (str(r + 1), f"{fit.modes.frequency[s]:.2f}", f"{100.0 * fit.modes.damping[s]:.3g}", f"{a:.3f}")
        for r, s, a in zip(pairing.measured, pairing.model, pairing.paired_mac, strict=True)
    ]
    fitted = f"{parameter_text(fit.G_f)}; {parameter_text(fit.d_f)}"
    return html_table(
        f"{fit.name}: mean frequency error {percent(fit.error)}; {fitted}",
        ("measured mode", "model [Hz]", "damping of the model [%]", "MAC"),
        rows,
        " ".join(fit.findings) or "± is half of the 95 % interval.",
    )


@figure_of.register(Fit)
def fit_figure(fit: Fit) -> Figure:
    """Draw the objectives over what was tried of G_f and d_f, beside the MAC of measured and modelled modes."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 5.2), layout="constrained")
    left, right = figure.subfigures(1, 2, squeeze=False)[0]
    draw(objective_chart(fit), left)
    last = int(fit.pairing.model.max(initial=0)) + 2
    draw(mac_chart(fit.pairing.mac[:, :last], None, fit.modes.frequency[:last], "model", "measured"), right)
    return figure


@html_of.register(Diagnosis)
def diagnosis_html(diagnosis: Diagnosis) -> str:
    """Say the answer in one sentence, and list the most probable explanations."""
    most = 6  # explanations of a ranking that are listed
    rows = [
        (
            " and ".join(diagnosis.labels.get(e, e) for e in ranked.effects) or "base model",
            percent(ranked.probability),
            percent(ranked.frequency_error),
            percent(ranked.left_out_error) if np.isfinite(ranked.left_out_error) else "",
            "; ".join(interval_text(p) for p in ranked.parameter),
        )
        for ranked in diagnosis.shown(most)
    ]
    header = ("explanation", "probability", "frequency error", "of modes left out", "parameters")
    return f"<p><em>{escape(diagnosis.verdict)}</em></p>" + html_table(headline(diagnosis), header, rows)


@figure_of.register(Diagnosis)
def diagnosis_figure(diagnosis: Diagnosis) -> Figure:
    """Draw the error before and after each step over the errors of the modes before and after."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 6.4), layout="constrained")
    above, below = figure.subfigures(2, 1, squeeze=False)[:, 0]
    draw(step_chart(diagnosis_steps(diagnosis)), above)
    draw(mode_chart(diagnosis.errors), below)
    return figure
