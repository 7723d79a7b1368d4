"""Measurement and model side by side: pairing, correlation, fitting, diagnosis, reports.

Names are imported when they are first used; `__init__.pyi` says from where.
"""

from importlib.util import find_spec
from pathlib import Path

from lamella_shared import drawn_by, exports


def require_own_packages() -> None:
    """Check that `ema` and `model`, names that others may have, too, are those that came with this package.

    Raises
    ------
    ImportError
        Python finds another one first; the message says where it is, and what to do.
    """
    root = Path(__file__).resolve().parents[1]
    for name in ("ema", "model"):
        found = find_spec(name)
        if found is None or found.origin is None:
            where = "nothing"
        elif Path(found.origin).resolve().parent == root / name:
            continue
        else:
            where = found.origin
        raise ImportError(
            f"Lamella needs its package {name!r}, which is in {root / name}, but Python finds {where}. Rename or move "
            "that file or folder, start from another folder, or take its folder out of PYTHONPATH; of two installed "
            "packages of one name keep Lamella in an environment of its own"
        )


require_own_packages()

__all__, __getattr__, __dir__ = exports(__name__, __file__)
drawn_by("updating.report.files")
