"""Takes the pictures of the gallery: figures that a script has named, which pyplot does not know."""

from __future__ import annotations

from typing import Any
from weakref import WeakSet

from matplotlib.figure import Figure
from sphinx_gallery.scrapers import figure_rst

_DRAWN: WeakSet[Figure] = WeakSet()


def figures(_block: Any, block_vars: dict[str, Any], gallery_conf: dict[str, Any]) -> str:
    """Save the figures that a block of a script has made, and return what shows them in reStructuredText."""
    paths = []
    for value in block_vars["example_globals"].values():
        if isinstance(value, Figure) and value not in _DRAWN:
            _DRAWN.add(value)
            paths.append(next(block_vars["image_path_iterator"]))
            value.savefig(paths[-1], dpi=110)
    return str(figure_rst(paths, gallery_conf["src_dir"]))
