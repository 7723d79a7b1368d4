"""The form of a structure file: its tables, their keys, and what they may hold."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from lamella_shared import read_form, read_toml
from model.matrices.labelled import UNITS
from model.matrices.text import refuse
from model.stack.errors import MatricesError

Direction = Literal["x", "y", "z", "rx", "ry", "rz"]
_Positive = Annotated[float, Field(gt=0, le=1e15)]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class MatricesForm(_Table):
    """The table `[matrices]`: files in one system of units, and what the structure is known to weigh."""

    units: str
    stiffness: str | None = None
    mass: str
    damping: str | None = None
    dofs: str | None = None
    nodes: str | None = None
    total_mass_kg: _Positive | None = None
    rigid_modes: int | None = Field(default=None, ge=0, le=6)


class GroupForm(_Table):
    """A `[[group]]` of nodes: by number, by the name of a set in the deck, or by a box."""

    name: str
    nodes: list[int] | None = None
    set: str | None = None
    box_mm: list[tuple[float, float]] | None = Field(default=None, min_length=3, max_length=3)


class SupportForm(_Table):
    """A `[[support]]`: held, which takes rows out, or released, which checks that they are there."""

    group: str
    directions: list[Direction]
    state: Literal["held", "released"]


class TermForm(_Table):
    """A `[[term]]` that may vary: matrices of files, or springs and masses on a group."""

    name: str
    stiffness: str | None = None
    mass: str | None = None
    damping: str | None = None
    multiplied_by: _Positive | None = None
    contained: bool = True
    group: str | None = None
    directions: list[Direction] = ["x", "y", "z"]
    spring_N_m: _Positive | None = None
    mass_kg: _Positive | None = None
    nominal: float = 1.0
    std: _Positive = 0.3
    scale: Literal["lin", "log"] = "log"
    lower: float = 0.0
    upper: float = float("inf")


class ReductionForm(_Table):
    """The table `[reduction]`: the band, and groups where forces may act."""

    band_Hz: _Positive
    points: list[str] = []
    patches: list[str] = []


class StructureForm(_Table):
    """The whole file."""

    name: str
    matrices: MatricesForm
    group: list[GroupForm] = []
    support: list[SupportForm] = []
    term: list[TermForm] = []
    reduction: ReductionForm


def is_structure_file(path: str | Path) -> bool:
    """Tell whether a file is TOML with a table `[matrices]`."""
    try:
        return "matrices" in read_toml(Path(path))
    except (OSError, ValueError, RecursionError):
        return False


def matrices_inputs(path: Path) -> tuple[Path, ...]:
    """Return a structure file and the files that it names."""
    given = read_structure_form(path)
    stated, terms = given.matrices, given.term
    named = [stated.stiffness, stated.mass, stated.damping, stated.dofs, stated.nodes]
    named += [file for one in terms for file in (one.stiffness, one.mass, one.damping)]
    files = dict.fromkeys(file.partition("#")[0] for file in named if file)
    return (path, *(path.parent / file for file in files))


def read_structure_form(path: Path) -> StructureForm:
    """Return what a structure file holds.

    Raises
    ------
    MatricesError
        It cannot be read, or has an unknown, missing or impossible key; the message names it.
    """
    given = read_form(path, StructureForm, MatricesError)
    if given.matrices.units not in UNITS:
        refuse(f"{path}: matrices.units = {given.matrices.units!r}; known are {', '.join(UNITS)}")
    return given
