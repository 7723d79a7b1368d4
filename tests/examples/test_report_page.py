"""The report as its reader meets it: in a browser, offline, and as files."""

import csv
import json
import os
import re
import shutil
import subprocess

import numpy as np
import pytest
from PIL import Image

from updating.report import page as page_module
from updating.report.modes_part import modes_section
from updating.report.page import write_report
from updating.report.pdf import NAMES, print_pdf
from updating.report.results import read_results
from updating.view import window

BROWSER = next(filter(None, map(shutil.which, NAMES)), None)
needs_browser = pytest.mark.skipif(BROWSER is None, reason="no Chromium, Chrome or Edge on PATH")

TRIAL = """
<script>
const said = [];
for (const kind of ["error", "warn"]) console[kind] = (...words) => said.push(words.join(" "));
addEventListener("error", (e) => said.push(e.message));
addEventListener("securitypolicyviolation", (e) => said.push("blocked: " + e.blockedURI));
</script>
"""
TRIAL_END = """
<script>
addEventListener("load", async () => {
  const wait = (ms) => new Promise((done) => setTimeout(done, ms));
  const until = async (met) => { for (let i = 0; i < 100 && !met(); i++) await wait(50); };
  const gallery = document.querySelector(".gallery"), canvas = gallery.querySelector("canvas[data-what=both]");
  const press = (what) => gallery.querySelector(`[data-do=${what}]`).click();
  const empty = canvas.toDataURL();
  canvas.scrollIntoView();
  await until(() => canvas.toDataURL() !== empty);
  const out = { drawn: canvas.toDataURL() !== empty };
  const first = canvas.toDataURL();
  await until(() => canvas.toDataURL() !== first);
  out.moves = canvas.toDataURL() !== first;
  press("play");
  const still = canvas.toDataURL();
  await wait(200);
  out.pauses = canvas.toDataURL() === still;
  const drag = (type, x, buttons) => canvas.dispatchEvent(new PointerEvent(type,
    { pointerId: 1, buttons, movementX: x, movementY: 0, bubbles: true }));
  canvas.setPointerCapture = () => {};
  drag("pointerdown", 0, 1); drag("pointermove", 60, 1); drag("pointerup", 0, 0);
  const turned = canvas.toDataURL();
  out.turns = turned !== still;
  drag("pointermove", 60, 0);
  out.restsWithoutButton = canvas.toDataURL() === turned;
  press("reset");
  out.returns = canvas.toDataURL() === still;
  out.unseen = [...document.querySelectorAll("canvas")].some((c) => c.width === 300);
  const column = (table, k) => [...table.tBodies[0].rows].map((row) => row.cells[k].textContent);
  const modes = [...document.querySelectorAll("table.sortable")].find((t) => t.textContent.includes("f measured"));
  const heads = modes.tHead.rows[0].cells;
  const clicked = (k) => { heads[k].click(); return column(modes, k); };
  out.errors = [clicked(4), clicked(4)];
  out.anchors = [...document.querySelectorAll("a")].every((a) => document.querySelector(a.getAttribute("href")));
  out.requests = performance.getEntriesByType("resource").map((e) => e.name).filter((n) => !n.startsWith("data:"));
  out.said = said;
  document.documentElement.dataset.trial = JSON.stringify(out);
});
</script></body>
"""
POLICY = """<meta http-equiv="Content-Security-Policy" content="default-src 'none'; img-src data:;
  style-src 'unsafe-inline'; script-src 'unsafe-inline'">"""


@pytest.fixture(scope="module")
def page(demo):
    return write_report(demo[0])


@needs_browser
def test_in_a_browser_shapes_turn_tables_sort_and_nothing_is_asked_of_a_network(page, tmp_path):
    text = page.read_text(encoding="utf-8")
    copy = tmp_path / "page.html"
    trial = text.replace("<head>", f"<head>{POLICY}{TRIAL}", 1).replace("</body>", TRIAL_END, 1)
    copy.write_text(trial, encoding="utf-8")
    command = [BROWSER, "--headless", "--disable-gpu", "--no-first-run", "--disable-background-networking",
               "--disable-component-update", "--disable-sync", "--window-size=1200,900",
               "--virtual-time-budget=20000", f"--user-data-dir={tmp_path}/profile", "--dump-dom"]  # fmt: skip
    if os.geteuid() == 0:
        command.append("--no-sandbox")
    done = subprocess.run([*command, copy.as_uri()], capture_output=True, text=True, timeout=120, check=True)
    found = re.search(r'data-trial="([^"]*)"', done.stdout)
    assert found, "the page's scripts did not come to their end"
    out = json.loads(found[1].replace("&quot;", '"').replace("&amp;", "&"))
    assert out["said"] == []
    assert out["requests"] == []
    for what in ("drawn", "moves", "pauses", "turns", "restsWithoutButton", "returns", "anchors"):
        assert out[what], what
    assert out["unseen"]  # what is not on the screen is not drawn
    up, down = (np.array(cells, dtype=float) for cells in out["errors"])
    np.testing.assert_array_equal(up, np.sort(up))
    np.testing.assert_array_equal(down, np.sort(up)[::-1])
    assert up[0] < up[-1]


@needs_browser
def test_the_page_prints_as_a_pdf(page):
    printed = print_pdf(page).read_bytes()
    assert printed.startswith(b"%PDF")
    assert 5 < len(re.findall(rb"/Type\s*/Page\b", printed)) < 30


def test_every_figure_is_a_file_with_its_numbers(page):
    folder = page.parent / "figures"
    pictures = [file for file in folder.iterdir() if file.suffix != ".csv"]
    names = {file.stem for file in pictures}
    for tested in read_results(page.parent).tested:
        for kind in ("mac", "comac", "frf", "stabilization", "objective"):
            assert f"{kind}_{tested.name}" in names
        for r in range(tested.measured.frequency.size):
            assert f"shape_{tested.name}_{r + 1:02d}" in names
    assert len({file.suffix for file in folder.iterdir()}) == 3
    for picture in pictures:
        content = picture.read_bytes()
        assert content.startswith(b"\x89PNG" if picture.suffix == ".png" else b"<?xml")
        with picture.with_suffix(".csv").open(encoding="utf-8", newline="") as numbers:
            rows = list(csv.reader(numbers))
        assert len(rows) > 1
        assert {len(row) for row in rows} == {len(rows[0])}


def test_the_numbers_of_a_figure_are_those_of_the_result(page):
    tested = read_results(page.parent).tested[0]
    with (page.parent / "figures/shape_M1_01.csv").open(encoding="utf-8", newline="") as file:
        rows = np.array([list(row.values()) for row in csv.DictReader(file)], float)
    np.testing.assert_allclose(rows[:, :3], tested.measured.geometry.coordinate[: len(rows)])
    assert np.max(np.linalg.norm(rows[:, 3:6], axis=1)) == pytest.approx(1.0)
    np.testing.assert_allclose(rows[:, 3:6], rows[:, 9:], atol=0.02)  # measured and model agree
    assert np.all(rows[:, [3, 4, 9, 10]] == 0.0)  # only z was measured


def test_the_page_is_small_and_says_what_the_results_say(page):
    text = page.read_text(encoding="utf-8")
    assert len(text) < 830_000  # so that 36 configurations stay below 15 MB
    order = ["Answer", "All configurations", "Modes of M1", "MAC and CoMAC of M1", "FRFs of M1", "Mode shapes of M1",
             "Where the model of M1 fails", "Modes of M2", "Parameters", "Provenance"]  # fmt: skip
    headings = re.findall(r"<h[23]>(.*?)</h[23]>", text)
    assert [h for h in headings if h in order] == order
    power = float(re.search(r"as p to the power ([\d.]+)", text)[1])
    assert power == pytest.approx(1.0 + np.log(1479.6 / 2399.4) / np.log(2.0), abs=2e-3)
    assert "Nothing to locate" in text


def test_the_window_shows_a_chosen_mode_that_moves(demo, tmp_path):
    tested = read_results(demo[0]).tested[0]
    plotter = window(tested, off_screen=True)
    try:
        plotter.screenshot(tmp_path / "first.png")
        slider = getattr(plotter, "widgets", plotter).slider_widgets[0]
        slider.GetRepresentation().SetValue(3.0)
        slider.InvokeEvent("EndInteractionEvent")
        plotter.screenshot(tmp_path / "third.png")
    finally:
        plotter.close()
    first, third = (
        np.asarray(Image.open(tmp_path / f"{n}.png").convert("L"), float) for n in ("first", "third")
    )
    above = first.shape[0] // 2
    assert np.mean(first[:above] < 200) > 0.005  # something is drawn
    assert np.mean(np.abs(first - third)[:above] > 50) > 0.005
    assert np.mean(np.abs(first - third)[above:] > 50) < 0.001  # the chart stays


def test_many_configurations_have_a_page_each_to_which_their_list_leads(demo, tmp_path, monkeypatch):
    shutil.copytree(demo[0], tmp_path / "many", ignore=shutil.ignore_patterns("figures", "report.*"))
    monkeypatch.setattr(page_module, "MOST_TOGETHER", 1)
    # without the figures, to be quick
    monkeypatch.setattr(page_module, "configuration_section", modes_section)
    front = write_report(tmp_path / "many")
    text = front.read_text(encoding="utf-8")
    assert "Modes of M1" not in text
    pages = re.findall(r'<a href="(\w+/report.html)">', text)
    assert pages == ["M1/report.html", "M2/report.html"]
    for name in pages:
        own = (front.parent / name).read_text(encoding="utf-8")
        assert f"Modes of {name[:2]}" in own
        assert '<a href="../report.html">' in own
