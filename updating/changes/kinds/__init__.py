"""Kinds of change with a location that nobody knows, one a file: each ends in KIND = Kind(...)."""

from __future__ import annotations

import importlib
import pkgutil
from functools import cache

from updating.changes.candidate import Kind


@cache
def kinds() -> tuple[Kind, ...]:
    """Return all kinds of change, in the order of their names."""
    modules = (importlib.import_module(f"{__name__}.{found.name}") for found in pkgutil.iter_modules(__path__))
    return tuple(module.KIND for module in modules if hasattr(module, "KIND"))
