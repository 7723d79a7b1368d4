"""The report page as a PDF, printed by a browser that is installed."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from pathlib import Path

from updating.errors import StoreError
from updating.results.store import write_bytes

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
_SECONDS = 180.0


def find_browser() -> Path:
    """Return a browser that can print a page without a window.

    Raises
    ------
    StoreError
        None is on PATH or at its usual place.
    """
    found = next((path for path in map(shutil.which, NAMES) if path is not None), None)
    found = found or next((path for path in _PATHS if Path(path).is_file()), None)
    if found is None:
        message = (
            "no browser to print a PDF with. Install one: `apt install chromium` on Debian, `snap install chromium` on "
            "Ubuntu, `dnf install chromium` on Fedora, else Google Chrome or Microsoft Edge, so that one of "
            f"{', '.join(NAMES[:4])} or msedge is on PATH; or open report.html in any browser and print it"
        )
        raise StoreError(message)
    return Path(found)


def print_pdf(page: Path) -> Path:
    """Print a page to a PDF beside it and return its path.

    Raises
    ------
    StoreError
        There is no browser, it fails, or the PDF cannot be written.
    """
    browser = find_browser()
    with tempfile.TemporaryDirectory() as folder:
        printed = Path(folder) / "page.pdf"
        command = [str(browser), *_FLAGS, f"--user-data-dir={folder}/profile", f"--print-to-pdf={printed}"]
        if hasattr(os, "geteuid") and os.geteuid() == 0:
            command.append("--no-sandbox")  # as root, as in a container, it does not start with one
        try:
            done = subprocess.run(
                [*command, page.resolve().as_uri()],
                capture_output=True,
                text=True,
                timeout=_SECONDS,
                check=False,
            )
        except (OSError, subprocess.TimeoutExpired) as error:
            message = f"{browser} could not print {page}: {error}"
            raise StoreError(message) from error
        if not printed.exists():
            last = (done.stderr.strip().splitlines() or ["it said nothing"])[-1]
            message = f"{browser} printed nothing of {page} (exit code {done.returncode}): {last}"
            raise StoreError(message)
        content = printed.read_bytes()
    path = page.with_suffix(".pdf")
    write_bytes(path, content)
    return path
