"""Draw the pictures of the page `tutorial` from results: python docs/pictures/tutorial.py RESULTS_FOLDER PICTURES.

The folder holds a campaign that was fitted and diagnosed, such as `lamella demo` leaves; a Chromium must be installed.
"""

from __future__ import annotations

import io
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from PIL import Image
from playwright.sync_api import sync_playwright

from updating.report.files import find_browser

SIZE = {"width": 1200, "height": 860}
SETTLED = 2500  # ms until what moves has come to rest
READ = "[...document.querySelectorAll('.v-progress-linear')].every(bar => !bar.offsetParent || !bar.offsetHeight)"
CODE = "from updating.commands.command_line import main; main()"
OPEN = [sys.executable, "-u", "-c", CODE, "open"]


@contextmanager
def workbench(folder: Path) -> Iterator[str]:
    """Serve the workbench of some results and yield its address."""
    command = [*OPEN, str(folder), "--no-browser"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=dict(os.environ)) as process:
        assert process.stdout is not None
        found = (re.search(r"Workbench: (http://\S+)", line) for line in process.stdout)
        yield next(one[1] for one in found if one)
        process.terminate()


def take(page: Any, path: Path) -> None:
    """Write what the page shows when all is read, with few colours, rare ones among them."""
    page.wait_for_function(READ)
    page.wait_for_timeout(SETTLED)
    image = Image.open(io.BytesIO(page.screenshot())).convert("RGB")
    image.quantize(method=Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE).save(path, optimize=True)


def panels(page: Any, address: str, folder: Path) -> None:
    """Go through the panels of the workbench and take a picture of each that the tutorial shows."""
    page.goto(address)
    page.wait_for_selector("#points .js-plotly-plot")
    take(page, folder / "tutorial_measurement.png")
    page.get_by_role("tab", name="Identification").click()
    page.frame_locator("iframe").get_by_role("button", name="Pause").wait_for()  # the shape moves
    take(page, folder / "tutorial_identification.png")
    page.get_by_role("tab", name="Comparison").click()
    take(page, folder / "tutorial_comparison.png")
    page.get_by_role("tab", name="Diagnosis").click()
    take(page, folder / "tutorial_diagnosis.png")
    page.get_by_role("tab", name="What if").click()
    page.wait_for_selector(".slider input", state="attached")
    page.locator("#set-to-answer").click()
    page.wait_for_function("document.querySelectorAll('.slider').length > 3")
    take(page, folder / "tutorial_what_if.png")


def main(results: Path, pictures: Path) -> None:
    """Take all pictures."""
    with sync_playwright() as play:
        browser = play.chromium.launch(
            executable_path=str(find_browser()), args=["--no-sandbox", "--enable-unsafe-swiftshader"]
        )
        page = browser.new_page(viewport=SIZE)
        page.set_default_timeout(180_000)
        with workbench(results) as address:
            panels(page, address, pictures)
        page.goto((results / "report.html").absolute().as_uri())
        take(page, pictures / "tutorial_report.png")
        browser.close()


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
