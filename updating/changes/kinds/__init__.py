"""Kinds of change with a location that nobody knows: each file ends in KINDS, which differ in sign or in extent."""

from __future__ import annotations

import importlib
import pkgutil
from functools import cache

from updating.changes.candidate import Kind


@cache
def kinds() -> tuple[Kind, ...]:
    """Return all kinds of change, in the order of their names."""
    modules = (importlib.import_module(f"{__name__}.{found.name}") for found in pkgutil.iter_modules(__path__))
    return tuple(sorted((kind for module in modules for kind in module.KINDS), key=lambda kind: kind.name))
