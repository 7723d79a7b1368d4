"""Build the documentation of the Python packages from their docstrings: python -W error docs/api/build.py FOLDER."""

from __future__ import annotations

import pkgutil
import re
import sys
from pathlib import Path

import pdoc
import pdoc.render

HERE = Path(__file__).parent
PACKAGES = ("ema", "model", "updating")
# NDArray, which pdoc spells out, with the tags of its colours between the words
_BETWEEN = r"(?:<[^>]+>|\s)*"
_ARRAY = re.compile(
    _BETWEEN.join(map(re.escape, re.findall(r"\w+|\W", "numpy.ndarray[tuple[typing.Any,")))
    + _BETWEEN
    + r"\.\.\."
    + _BETWEEN
    + _BETWEEN.join(map(re.escape, re.findall(r"\w+|\W", "],numpy.dtype[")))
    + _BETWEEN
    + rf"(?:numpy{_BETWEEN}\.|typing{_BETWEEN}\.){_BETWEEN}(\w+){_BETWEEN}\]{_BETWEEN}\]"
)
# what an effect says of itself, an entry a paragraph
_ENTRY = re.compile(r"\n(Enters|Range|Does|Mistaken for):")


def modules() -> list[str]:
    """Return what pdoc is to document: the packages, then every other module once."""
    named = [*PACKAGES, r"!.+\..+"]
    for package in PACKAGES:
        path = [str(HERE.parents[1] / package)]
        named += [m.name for m in pkgutil.iter_modules(path, f"{package}.")]
    return named


def build(folder: Path) -> None:
    """Write the pages to a folder."""
    pdoc.render.configure(docformat="numpy", include_undocumented=False, template_directory=HERE)
    pdoc.pdoc(*modules(), output_directory=folder)
    for page in folder.rglob("*.html"):
        text = _ARRAY.sub(r"NDArray[\1]", page.read_text(encoding="utf-8"))
        page.write_text(_ENTRY.sub(r"</p>\n\n<p>\1:", text), encoding="utf-8")


if __name__ == "__main__":
    build(Path(sys.argv[1]))
