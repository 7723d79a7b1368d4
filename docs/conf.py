"""How Sphinx builds the site: the pages in this folder, the gallery from its scripts, the API from the docstrings."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from importlib.metadata import version as version_of
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sphinx.application import Sphinx

sys.path.insert(0, str(Path(__file__).parent))  # for the scraper
# what an effect says of itself, an entry a paragraph
_ENTRIES = ("Enters:", "Range:", "Does:", "Mistaken for:")


def _readable(lines: list[str]) -> Iterator[str]:
    """Set formulas, which docstrings indent, as they stand, and each entry of an effect as a paragraph."""
    literal = False
    for k, line in enumerate(lines):
        if re.fullmatch(r"-{3,}", line.strip()):  # below the title of a section: napoleon reads on
            yield from lines[k:]
            return
        begins = line.startswith("    ") and k > 0 and not lines[k - 1].strip()
        if begins and not literal and not lines[max(k - 2, 0)].endswith("::"):
            yield from ("::", "")
        literal = line.startswith("    ") or (literal and not line.strip())
        if line.startswith(_ENTRIES):
            yield ""
        yield line


def process_docstring(app: Any, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:  # noqa: ARG001
    """Make a docstring's text readable before its sections are read."""
    lines[:] = list(_readable(lines))


def link_outside(app: Any, docname: str, content: list[str]) -> None:  # noqa: ARG001
    """Point links to Markdown files outside the pages to these files, which a page can offer as they are."""
    content[0] = re.sub(r"\]\((\.\./[^)#]*\.md)\)", r"](<path:\1>)", content[0])


def setup(app: Sphinx) -> None:
    """Connect what pages and docstrings go through."""
    app.connect("source-read", link_outside)
    app.connect("autodoc-process-docstring", process_docstring, priority=400)  # napoleon comes at 500


project, author = "Lamella", "the authors of Lamella"
release = version = version_of("lamella")
extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
    "sphinx_gallery.gen_gallery",
]
exclude_patterns = ["gallery", "auto_examples/*.ipynb", "auto_examples/*.py", "pictures"]
templates_path = ["_templates"]
default_role = "code"
suppress_warnings = ["ref.python"]  # of "(n_mode,) float" each word is tried as a name, and several things have it
myst_heading_anchors = 4

autosummary_generate = True
autodoc_typehints = "signature"
autodoc_member_order = "bysource"
autodoc_default_options = {"members": True}
python_use_unqualified_type_names = True
python_maximum_signature_line_length = 88
napoleon_google_docstring = False
napoleon_use_ivar = False
napoleon_use_rtype = False

html_theme = "pydata_sphinx_theme"
html_title = "Lamella"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_show_sourcelink = False
html_theme_options = {
    "show_prev_next": False,
    "navigation_with_keys": True,
    "secondary_sidebar_items": ["page-toc"],
    "footer_start": ["copyright"],
    "footer_end": [],
}
html_sidebars: dict[str, list[str]] = {"index": []}

sphinx_gallery_conf = {
    "examples_dirs": "gallery",
    "gallery_dirs": "auto_examples",
    "filename_pattern": r"\.py$",
    "within_subsection_order": "FileNameSortKey",
    "image_scrapers": ("pictures.scraper.figures",),
    "capture_repr": ("_repr_html_",),
    "reset_modules": (),
    "abort_on_example_error": True,
    "download_all_examples": False,
    "remove_config_comments": True,
    "show_memory": False,
    "plot_gallery": True,
}
