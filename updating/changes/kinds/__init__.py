"""Kinds of change with a location that nobody knows."""

from __future__ import annotations

from updating.changes.candidate import Kind
from updating.changes.kinds import contact, edges, laminas, masses

KINDS = tuple(
    sorted(
        (
            value
            for module in (contact, edges, laminas, masses)
            for value in vars(module).values()
            if isinstance(value, Kind)
        ),
        key=lambda kind: kind.name,
    )
)
"""All kinds, in the order of their names."""
