"""A specimen: one stack in the rig that all share, what was noted of it, and its identified configurations."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from model import Stack
from updating.results.pooled import LevelKind

if TYPE_CHECKING:
    from updating.diagnosis.evidence import Campaigned

UNTREATED = ("", "none", "no", "-")
"""Notes that say that there is nothing: no group."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Specimen:
    """One stack in the rig.

    Attributes
    ----------
    name : str
        Unique in its campaign.
    stack : Stack
        Its model with the rig, without effects.
    tested : tuple of (str, float, ModalModel)
        Name, pressure in Pa and identified modes of each configuration; configurations of other specimens at the same
        torque have the same name.
    notes : mapping of str to str
        What was noted of it, such as its treatment.
    classed : bool
        Whether the model's shapes of some classes stand for shapes that were not measured.
    """

    name: str
    stack: Stack
    tested: tuple[Campaigned, ...]
    notes: Mapping[str, str] = field(default_factory=dict)
    classed: bool = False


@dataclass(frozen=True, kw_only=True)
class Level:
    """Which specimens have something.

    Attributes
    ----------
    kind : "rig", "group" or "specimen"
        All of them the same; those of a group the same; one alone.
    of : str
        Which group, such as "treatment = glued", or which specimen; empty where it is all.
    members : tuple of int
        Places of the specimens.
    """

    kind: LevelKind
    of: str
    members: tuple[int, ...]


def levels_of(specimens: Sequence[Specimen]) -> tuple[Level, ...]:
    """Return all levels at which something can be: the rig, groups by each column of the notes, and specimens.

    Specimens of one note in one column are a group, if they are two or more and not all; of groups with the same
    members the first one counts.
    """
    fewest = 2  # specimens that make a group
    all_members = tuple(range(len(specimens)))
    levels = [Level(kind="rig", of="", members=all_members)]
    if len(specimens) < fewest:
        return tuple(levels)
    known = {all_members}
    for column in dict.fromkeys(name for specimen in specimens for name in specimen.notes):
        values = [specimen.notes.get(column, "") for specimen in specimens]
        for value, count in Counter(values).items():
            members = tuple(i for i in all_members if values[i] == value)
            if count >= fewest and value not in UNTREATED and members not in known:
                known.add(members)
                levels.append(Level(kind="group", of=f"{column} = {value}", members=members))
    levels += [Level(kind="specimen", of=specimen.name, members=(i,)) for i, specimen in enumerate(specimens)]
    return tuple(levels)
