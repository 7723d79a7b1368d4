"""The packages of Lamella beside each other: `ema` and `model` are names that others may have, too."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

_OTHERS = ("ema", "model")


def require_own_packages() -> None:
    """Check that `ema` and `model` are those that came with this package.

    Raises
    ------
    ImportError
        Python finds another one first; the message says where it is, and what to do.
    """
    own = Path(__file__).resolve().parents[1]
    for name in _OTHERS:
        found = find_spec(name)
        if found is None or found.origin is None:
            place = "nothing"
        elif Path(found.origin).resolve().parent == own / name:
            continue
        else:
            place = found.origin
        message = (
            f"Lamella needs its package {name!r}, which is in {own / name}, but Python finds {place}. Rename or move "
            "that file or folder, start from another folder, or take its folder out of PYTHONPATH; of two installed "
            "packages of one name keep Lamella in an environment of its own"
        )
        raise ImportError(message)
