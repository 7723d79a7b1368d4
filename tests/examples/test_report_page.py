"""The report as its reader meets it: in a browser, offline, and as files."""

import csv
import html.parser
import re
import shutil
from contextlib import contextmanager
from dataclasses import replace
from importlib.resources import files

import numpy as np
import pytest
from matplotlib.figure import Figure

from ema.modal.mac import frac
from tests.accessible import faults, settled, unreached
from updating.commands.report import view_command
from updating.errors import StoreError
from updating.report import page as page_module
from updating.report.files import NAMES, print_pdf
from updating.report.frf_part import frf_picture
from updating.report.modes_part import modes_section, shape_section
from updating.report.page import titles, write_report
from updating.report.part import Gallery, Picture, Section, of_model, packed, renderer
from updating.report.results import Addition, identified_model, read_results
from updating.results.text import Z95, Table, uncertain

BROWSER = next(filter(None, map(shutil.which, NAMES)), None)
needs_browser = pytest.mark.skipif(BROWSER is None, reason="no Chromium, Chrome or Edge on PATH")

HEARD = """
  window.said = [];
  for (const kind of ["error", "warn"]) console[kind] = (...words) => said.push(words.join(" "));
  addEventListener("error", (e) => said.push(e.message));
  addEventListener("securitypolicyviolation", (e) => said.push("blocked: " + e.blockedURI));
"""
TRIAL = """async (seconds) => {
  const out = { said };
  const tell = (name, value) => { out[name] = value; };
  const wait = (ms) => new Promise((done) => setTimeout(done, ms));
  const until = async (met) => {  // asks a clock, not for frames: a page that draws none is to say so
    for (const start = performance.now(); !met(); await wait(20)) {
      if (performance.now() - start > 1000 * seconds) throw new Error(`${met}, after ${JSON.stringify(out)}`);
    }
  };
  const gallery = document.querySelector(".gallery"), plot = gallery.querySelector(".plot");
  const press = (what) => gallery.querySelector(`[data-${what}]`).click();
  const body = () => plot.data?.find((t) => t.type === "mesh3d"), height = () => body()?.z.join();
  plot.scrollIntoView();
  await until(body);
  tell("drawn", true);
  const first = height();
  await until(() => height() !== first);
  tell("moves", true);
  press("do=play");
  await wait(50);
  const still = height();
  await wait(200);
  tell("pauses", height() === still);
  const side = () => plot.layout.scene.camera.eye.x, home = side();
  plot.dispatchEvent(new KeyboardEvent("keydown", { key: "ArrowLeft" }));
  await until(() => side() !== home);
  tell("turns", true);
  press("view=oblique");
  await until(() => side() === home);
  tell("returns", true);
  const colours = () => body().intensity.join(), one = colours();
  gallery.querySelectorAll(".shape button")[1].click();
  await until(() => colours() !== one);
  tell("otherMode", gallery.querySelector("[name=mode]").value === "1");
  const show = gallery.querySelector("[name=what]");
  show.value = "beside";
  show.dispatchEvent(new Event("input"));
  await until(() => plot.data.some((t) => t.scene === "scene2" && t.type === "mesh3d"));
  tell("beside", true);
  tell("unseen", [...document.querySelectorAll(".gallery .plot")].some((own) => !own.data));
  const column = (table, k) => [...table.tBodies[0].rows].map((row) => row.cells[k].textContent);
  const modes = [...document.querySelectorAll("table.sortable")].find((t) => t.textContent.includes("f measured"));
  const heads = modes.tHead.rows[0].cells;
  const clicked = (k) => { heads[k].click(); return column(modes, k); };
  tell("frequencies", [clicked(2), clicked(2)]);
  tell("anchors", [...document.querySelectorAll("a")].every((a) => document.querySelector(a.getAttribute("href"))));
  const charts = [...document.querySelectorAll(".chart")];
  for (const chart of charts) {
    chart.scrollIntoView();
    await until(() => chart.querySelector(".js-plotly-plot")?._fullData);
  }
  tell("charts", charts.length);
  const chosen = document.querySelector(".choice select"), drawn = chosen.closest(".chart").querySelector(".plot");
  const curve = () => Array.from(drawn.data.find((t) => t.name === "measured").y).slice(0, 40).join();
  const worst = curve();
  tell("functions", chosen.options.length);
  chosen.selectedIndex = 1;
  chosen.dispatchEvent(new Event("change"));
  await until(() => curve() !== worst);
  tell("chosen", true);
  const link = document.querySelector("a[data-point]");
  if (link) {
    link.click();
    tell("linked", chosen.selectedOptions[0].textContent.startsWith(`${link.dataset.point}+`));
  }
  tell("wide", document.documentElement.scrollWidth <= innerWidth);
  return out;
}"""
POLICY = """<meta http-equiv="Content-Security-Policy" content="default-src 'none'; img-src data:;
  style-src 'unsafe-inline'; script-src 'unsafe-inline'">"""
ALL_DRAWN = """async () => {  // charts are drawn in view; how many there are
  const charts = [...document.querySelectorAll(".chart, .gallery")];
  for (const chart of charts) {
    chart.scrollIntoView();
    while (!chart.querySelector(".js-plotly-plot")?._fullData) await new Promise(requestAnimationFrame);
  }
  return charts.length;
}"""
MAP_HEIGHT = """async () => {  // of the first picture of where the model fails, px
  const chart = document.querySelector('img[alt="Error over the stack"]').closest(".chart");
  chart.scrollIntoView();
  while (!chart.querySelector(".js-plotly-plot")?._fullLayout) await new Promise(requestAnimationFrame);
  return chart.querySelector(".js-plotly-plot")._fullLayout.height;
}"""
SECONDS = 120.0  # for each step; a few are enough, but the machine may have other work


@pytest.fixture(scope="module")
def browser():
    """Start one browser for all tests: that takes longer than most of them."""
    sync = pytest.importorskip("playwright.sync_api", reason="no playwright, of the extra dev")
    with sync.sync_playwright() as play:
        started = play.chromium.launch(executable_path=BROWSER, args=["--no-sandbox"])
        yield started
        started.close()


@pytest.fixture
def opened(browser):
    """Return a function that opens an empty page, as wide and in such colours as options of playwright say."""

    @contextmanager
    def new_page(**options):
        shown = browser.new_page(**options)
        shown.set_default_timeout(1000.0 * SECONDS)
        yield shown
        shown.close()

    return new_page


def written_page(folder, whole):
    """Write the report of a results folder that has all of one configuration, and of the others tables and shapes."""
    drawn = page_module.configuration_section

    def section(tested, name, added):
        if tested.name == whole:
            return drawn(tested, name, added)
        return Section(
            title=f"Configuration {tested.name}", parts=(modes_section(tested, added), shape_section(tested))
        )

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(page_module, "configuration_section", section)
        return write_report(folder)


@pytest.fixture(scope="module")
def page(demo):
    return written_page(demo[0], "M1")


@pytest.fixture(scope="module")
def small_page(small, tmp_path_factory):
    """The report of the small campaign, whose charts have few points, of two configurations; its pictures are white."""
    folder = shutil.copytree(small[0].parent, tmp_path_factory.mktemp("small_page") / "campaign")
    for name in ("C3", "C4"):
        shutil.rmtree(folder / "out" / name)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Figure, "draw", lambda *_: None)
        return written_page(folder / "out", "C1")


@needs_browser
def test_in_a_browser_shapes_turn_tables_sort_and_nothing_is_asked_of_a_network(page, tmp_path, opened):
    copy = tmp_path / "page.html"
    copy.write_text(page.read_text(encoding="utf-8").replace("<head>", f"<head>{POLICY}", 1), encoding="utf-8")
    asked = []
    with opened(viewport={"width": 1200, "height": 900}) as shown:
        shown.add_init_script(HEARD)
        shown.on("request", lambda request: asked.append(request.url))
        shown.goto(copy.as_uri())
        out = shown.evaluate(TRIAL, SECONDS)
    assert {url for url in asked if not url.startswith("data:")} == {copy.as_uri()}
    assert out["said"] == []
    for what in ("drawn", "moves", "pauses", "turns", "returns", "otherMode", "beside", "anchors", "chosen", "wide"):
        assert out[what], what
    assert out["charts"] >= 4  # MAC, functions and stabilisation, and the modes of both configurations
    assert out["functions"] == 44
    assert out["unseen"]  # what is not on the screen is not drawn
    up, down = (np.array(cells, dtype=float) for cells in out["frequencies"])
    np.testing.assert_array_equal(up, np.sort(up))
    np.testing.assert_array_equal(down, np.sort(up)[::-1])
    assert up[0] < up[-1]


@pytest.mark.slow
@needs_browser
def test_the_page_prints_as_a_pdf(page):
    printed = print_pdf(page).read_bytes()
    assert printed.startswith(b"%PDF")
    assert 5 < len(re.findall(rb"/Type\s*/Page\b", printed)) < 30


def test_only_the_sections_that_are_asked_for_are_on_the_page(demo, tmp_path, monkeypatch, undrawn):
    folder = shutil.copytree(demo[0], tmp_path / "some", ignore=shutil.ignore_patterns("figures", "report.*"))
    monkeypatch.setattr(page_module, "configuration_section", lambda tested, _, added: modes_section(tested, added))
    text = write_report(folder, only=("answer", "Provenance")).read_text(encoding="utf-8")
    assert re.findall(r"<h2>(.*?)</h2>", text) == ["Answer", "Provenance"]
    with pytest.raises(StoreError, match="no section of the report begins with 'shapes'; there are: Answer, In full"):
        write_report(folder, only=("shapes",))


def test_every_figure_is_a_file_with_its_numbers(page):
    folder = page.parent / "figures"
    pictures = [file for file in folder.iterdir() if file.suffix != ".csv"]
    names = {file.stem for file in pictures}
    tested = read_results(page.parent).tested[0]
    for kind in ("mac", "comac", "frf", "stabilization", "objective"):
        assert f"{kind}_M1" in names
    for r in range(tested.measured.frequency.size):
        assert f"shape_M1_{r + 1:02d}" in names
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


def test_the_fitted_model_is_drawn_over_the_functions_and_its_numbers_stand_beside_them(page):
    with (page.parent / "figures/frf_M1.csv").open(encoding="utf-8", newline="") as file:
        names, *rows = csv.reader(file)
    column = dict(zip(names, np.array(rows, float).T, strict=True))
    functions = {name.split(" ")[0] for name in names if "/" in name}
    assert len(functions) == 3
    for function in functions:
        measured, modes, model = (
            column[f"{function} {what} real [SI accelerance]"]
            + 1j * column[f"{function} {what} imaginary [SI accelerance]"]
            for what in ("measured", "from the modes", "fitted model")
        )
        assert frac(measured, modes) > 0.9998
        assert frac(measured, model) > 0.999
        assert np.linalg.norm(model - measured) < 0.03 * np.linalg.norm(measured)  # in size and sign too


def test_all_of_a_configuration_is_shown_with_both_models(small, undrawn):
    tested = read_results(small[1]).tested[0]
    addition = Addition(
        effects=("lost_contact_middle",), value={"middle_loss": 0.4}, source=small[1] / "diagnosis.json"
    )
    one = replace(tested, identified=identified_model(None, addition, tested))
    section = page_module.configuration_section(one, None, {})
    shown = [block for part in section.parts for block in part.blocks]
    for kind in (Table, Picture, Gallery):
        models = [block.model for block in shown if isinstance(block, kind)]
        assert models.count("found") == models.count("base") > 0, kind
    (functions,) = (block for block in shown if block.model == "both")
    names, *rows = csv.reader(functions.data.splitlines())
    column = dict(zip(names, np.array(rows, float).T, strict=True))
    base = [name for name in names if "base model" in name]
    assert len(base) == 6  # three functions are printed, each with real and imaginary parts
    for name in base:
        found = column[name.replace("base model", "with what was identified")]
        assert 1e-3 < np.linalg.norm(found - column[name]) / np.linalg.norm(found) < 1.0
    text = page_module.render("title", (section,))
    assert text.count('<div data-model="found">') == text.count('<div data-model="base">') > 3


def test_a_model_without_the_place_of_the_force_is_not_drawn(page, undrawn):
    tested = read_results(page.parent).tested[0]
    geometry = tested.measured.geometry
    known = ~np.isin(geometry.node, tested.measured.input.node)
    modes = replace(
        tested.measured,
        geometry=replace(
            geometry, node=geometry.node[known], coordinate=geometry.coordinate[known], axes=geometry.axes[known]
        ),
    )
    picture = frf_picture(replace(tested, measured=modes), tested.frf(), {})
    assert "fitted model" not in picture.data
    assert "Dotted" not in picture.caption


@pytest.mark.slow
@needs_browser
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_on_a_phone_nothing_is_cut_and_the_dark_is_dark(page, scheme, opened):
    with opened(viewport={"width": 400, "height": 900}, color_scheme=scheme) as shown:
        shown.goto(page.as_uri())
        assert shown.evaluate("document.documentElement.scrollWidth") <= 400
        cut = """[...document.querySelectorAll("td, .opening, .command")].filter((e) => e.getClientRects().length
          && e.getBoundingClientRect().right > innerWidth).map((e) => e.textContent)"""
        assert shown.evaluate(cut) == []
        shown.get_by_role("button", name="Open all parts").click()
        assert shown.evaluate("document.documentElement.scrollWidth") <= 400
        assert shown.evaluate(cut) == []
        still = """[...document.querySelectorAll("figure.full:not(.chart), figure.full .still")]
          .filter((e) => !e.closest(".chart")).map((e) => e.textContent)"""
        assert shown.evaluate(still) == []  # every wide figure is a chart that takes the width there is
        ink, ground = (
            sum(map(int, re.findall(r"\d+", shown.evaluate(f"getComputedStyle(document.body).{name}"))[:3]))
            for name in ("color", "backgroundColor")
        )
        assert (ink > ground) == (scheme == "dark")
        rest = shown.locator("button.rest:visible")
        rows = "(table) => [...table.rows].filter((r) => r.getClientRects().length).length"
        if rest.count():
            table = rest.first.locator("xpath=preceding-sibling::table[1]").element_handle()
            assert table.evaluate(rows) == 4  # long tables of cards show the first ones
            more = int(re.search(r"\d+", rest.first.text_content())[0])
            rest.first.click()
            assert table.evaluate(rows) == 4 + more


@needs_browser
def test_a_page_that_nobody_touches_rests_and_goes_on_when_it_is_touched(opened):
    """What asks for the next frame for ever, as charts in 3-D do, gets few of them then."""
    script = (files("updating.report") / "rest.js").read_text(encoding="utf-8")
    assert "REST = 20_000" in script
    count = """async (stir) => {  // frames of a second, once it may rest
        let n = 0;
        const loop = () => { n += 1; requestAnimationFrame(loop); };
        loop();
        await new Promise((done) => setTimeout(done, 300));
        n = 0;
        for (let i = 0; i < 20; i++) {
            if (stir) dispatchEvent(new Event("pointermove"));
            await new Promise((done) => setTimeout(done, 50));
        }
        return n;
    }"""
    for rest, stir, goes_on in ((200, False, False), (200, True, True), (20_000, False, True)):
        with opened() as shown:
            shown.set_content(f"<script>{script.replace('20_000', str(rest))}</script>")
            assert (shown.evaluate(count, stir) > 5) == goes_on  # of some 60, or one a second


@needs_browser
def test_on_a_phone_parts_are_folded_and_open_by_tap_link_and_all_at_once(small_page, opened):
    hidden = """[...document.querySelectorAll("main section:not(#answer)")].filter((e) =>
      [...e.children].slice(1).every((c) => !c.getClientRects().length)).map((e) => e.id)"""
    with opened(viewport={"width": 400, "height": 900}) as shown:
        shown.goto(small_page.as_uri())
        every = shown.evaluate("[...document.querySelectorAll('main section:not(#answer)')].map((e) => e.id)")
        assert shown.evaluate(hidden) == every
        folded = shown.evaluate("document.documentElement.scrollHeight")
        assert shown.evaluate(MAP_HEIGHT) <= 240  # which shows both ends of the stack
        part = shown.get_by_role("button", name="Provenance")
        assert part.get_attribute("aria-expanded") == "false"
        part.press("Enter")
        assert part.get_attribute("aria-expanded") == "true"
        assert "provenance" not in shown.evaluate(hidden)
        shown.evaluate("location.hash = 'frfs-of-c1'")  # a part within one that is folded, too
        shown.wait_for_function("document.querySelector('#frfs-of-c1 p').getClientRects().length")
        shown.get_by_role("button", name="Open all parts").click()
        assert shown.evaluate(hidden) == []
        assert folded < 0.3 * shown.evaluate("document.documentElement.scrollHeight")
        shown.get_by_role("button", name="Close all parts").click()
        assert shown.evaluate(hidden) == every
        shown.emulate_media(media="print")
        assert shown.evaluate(hidden) == []  # paper has everything
        shown.emulate_media(media="screen")
        shown.set_viewport_size({"width": 1200, "height": 900})
        shown.wait_for_function("!document.querySelector('main h2 button')")
        assert shown.evaluate(hidden) == []


@needs_browser
@pytest.mark.parametrize("dark_and_small", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_who_cannot_see_or_point_reads_the_report_too(small_page, dark_and_small, opened):
    """On a screen; in dark colours and on a phone in more time."""
    with opened(viewport={"width": 1400, "height": 900}, reduced_motion="reduce") as shown:
        shown.goto(small_page.as_uri())
        assert shown.evaluate(ALL_DRAWN) >= 4
        if not dark_and_small:
            assert faults(shown) == []
            assert unreached(shown) == []
            return
        shown.emulate_media(color_scheme="dark", reduced_motion="reduce")
        settled(shown)
        assert faults(shown, "color-contrast") == []
        shown.set_viewport_size({"width": 400, "height": 900})
        shown.wait_for_selector("main h2 button")
        settled(shown)
        assert faults(shown) == []


class Links(html.parser.HTMLParser):
    """Everything that a page would load."""

    def __init__(self):
        super().__init__()
        self.found = []

    def handle_starttag(self, tag, attrs):
        wanted = {"src", "href", "data", "srcset"}
        self.found += [value for name, value in attrs if name in wanted]


def test_the_page_holds_everything_that_it_shows(demo, page):
    text = page.read_text(encoding="utf-8")
    links = Links()
    links.feed(text)
    assert len(links.found) > 10
    assert all(link.startswith(("data:image/", "#")) for link in links.found)
    assert "@import" not in text
    for found, fitted in demo[1]:
        measured = found.modal_model
        assert uncertain(measured.frequency[0], Z95 * measured.frequency_std[0]) in text
        assert f"{fitted.modes.frequency[fitted.pairing.model[0]]:.2f}" in text


def test_the_titles_that_can_be_chosen_are_those_of_the_page(demo, page):
    text = page.read_text(encoding="utf-8")
    assert list(titles(read_results(demo[0]))) == re.findall(r"<h2>(.*?)</h2>", text)


def test_the_page_is_small_and_says_what_the_results_say(page):
    text = page.read_text(encoding="utf-8")
    script = len(packed(renderer()))
    assert script + (len(text) - script) * page_module.MOST_TOGETHER / 2 < 15_000_000
    assert text.count('id="plotly"') == 1
    order = ["Answer", "In full", "All configurations", "Modes of M1", "MAC and CoMAC of M1", "FRFs of M1",
             "Mode shapes of M1", "Where the base model of M1 fails", "Modes of M2", "Parameters",
             "Provenance"]  # fmt: skip
    headings = re.findall(r"<h[23]>(.*?)</h[23]>", text)
    assert [h for h in headings if h in order] == order
    power = float(re.search(r"as p to the power ([\d.]+)", text)[1])
    assert power == pytest.approx(1.0 + np.log(1479.6 / 2399.4) / np.log(2.0), abs=2e-3)
    assert "Nothing to locate" in text


def test_the_shapes_of_one_configuration_open_in_the_browser(small, tmp_path, monkeypatch, undrawn):
    folder = shutil.copytree(small[1], tmp_path / "out", ignore=shutil.ignore_patterns("figures", "report.*"))
    opened = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    view_command(folder, "C2")
    assert opened == [(folder / "view.html").as_uri()]
    headings = re.findall(r"<h2>(.*?)</h2>", (folder / "view.html").read_text(encoding="utf-8"))
    assert headings == ["Mode shapes of C2", "FRFs of C2"]
    with pytest.raises(StoreError, match="no configuration 'C9'; there are C1, C2, C3, C4"):
        view_command(folder, "C9")


def test_many_configurations_have_a_page_each_to_which_their_list_leads(demo, tmp_path, monkeypatch, undrawn):
    shutil.copytree(demo[0], tmp_path / "many", ignore=shutil.ignore_patterns("figures", "report.*"))
    monkeypatch.setattr(page_module, "MOST_TOGETHER", 1)
    # without the figures, to be quick
    monkeypatch.setattr(page_module, "configuration_section", lambda tested, _, added: modes_section(tested, added))
    front = write_report(tmp_path / "many")
    text = front.read_text(encoding="utf-8")
    assert "Modes of M1" not in text
    pages = re.findall(r'<a href="(\w+/report.html)">', text)
    assert pages == ["M1/report.html", "M2/report.html"]
    for name in pages:
        one = (front.parent / name).read_text(encoding="utf-8")
        assert f"Modes of {name[:2]}" in one
        assert '<a href="../report.html">' in one


@needs_browser
def test_the_switch_shows_one_of_two_models_and_the_found_one_first(tmp_path, opened):
    tables = [Table(title=name, header=("h",), rows=((name,),)) for name in ("with it", "base")]
    blocks = (*of_model(tables[:1], "found"), *of_model(tables[1:], "base"))
    (tmp_path / "page.html").write_text(
        page_module.render("title", (Section(title="both", blocks=blocks),)), encoding="utf-8"
    )
    with opened() as shown:
        shown.goto((tmp_path / "page.html").as_uri())

        def seen():
            return [cell.text_content() for cell in shown.locator("td").all() if cell.is_visible()]

        assert seen() == ["with it"]
        shown.get_by_label("base model").check()
        assert seen() == ["base"]
        shown.emulate_media(media="print")
        assert not shown.locator(".models").is_visible()
