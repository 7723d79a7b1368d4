"""The rows that all matrices of a structure share: their labels, places, groups and units.

Where nodes are, and which sets they form, is read from the decks of other programs.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from model.matrices.labelled import DIRECTIONS, UNITS, Index, Units, key, name_of, placed
from model.matrices.readers import Target, _fields, _real, read_matrix
from model.matrices.structure_file import GroupForm, StructureForm, SupportForm
from model.matrices.text import columns_of_csv, kind_of, read_text, refuse

_Table = dict[int, tuple[float, ...]]  # places of nodes by their numbers
_Sets = dict[str, list[int]]


@dataclass(frozen=True, eq=False, kw_only=True)
class Nodes:
    """Nodes of a mesh.

    Attributes
    ----------
    number : (n,) int
        Their numbers, ascending.
    location : (n, 3) float
        Where they are, in the units of the file.
    sets : dict of str to (m,) int
        Their named sets, names in capitals.
    """

    number: Index
    location: NDArray[np.float64]
    sets: dict[str, Index]


def read_nodes(path: Path) -> Nodes:
    """Read nodes: `.inp` (CalculiX, Abaqus), `.bdf` `.dat` `.nas` (Nastran), `.cdb` (Ansys) or CSV with node,x,y,z.

    Raises
    ------
    MatricesError
        There are none, or one of them is not as it should be.
    """
    kind = kind_of(path)
    table: _Table = {}
    sets: _Sets = {}
    if kind == ".csv":
        for i, words in enumerate(zip(*columns_of_csv(path, ("node", "x", "y", "z")), strict=True), 2):
            _put(table, path, i, words)
    elif kind in (".bdf", ".dat", ".nas"):
        _grids(path, table)
    elif kind == ".cdb":
        _nblock(path, table)
    else:
        _deck(path, table, sets)
    if not table:
        refuse(f"{path}: holds no nodes; *NODE, GRID, NBLOCK or a CSV table with node,x,y,z is needed")
    number = np.array(sorted(table), dtype=np.int64)
    return Nodes(
        number=number,
        location=np.array([table[int(i)] for i in number]),
        sets={name: np.unique(np.array(nodes, dtype=np.int64)) for name, nodes in sets.items()},
    )


def _whole(path: Path, line: int, word: str) -> int:
    try:
        return int(word)
    except ValueError:
        refuse(f"{path}: line {line}: {word!r} is no node number")


def _put(table: _Table, path: Path, line: int, words: Sequence[str]) -> None:
    """Add a node to a table: its number and up to three coordinates."""
    number = _whole(path, line, words[0])
    try:
        table[number] = tuple(_real(word) if word.strip() else 0.0 for word in (*words[1:], "", "", "")[:3])
    except ValueError:
        refuse(f"{path}: line {line}: {', '.join(words[1:])} are no coordinates")


_ELSEWHERE = {
    "*INSTANCE": "moves nodes and numbers them anew",
    "*SYSTEM": "moves nodes",
    "*TRANSFORM": "turns directions of nodes",
}
"""Keywords of a deck after which places and directions of nodes are others than its lines say."""


def _deck(path: Path, table: _Table, sets: _Sets) -> None:
    """Read *NODE and *NSET of a deck of CalculiX or Abaqus without parts, and the files that it includes."""
    keyword, options = "", {}
    for i, line in enumerate(read_text(path).splitlines(), 1):
        words = [one.strip() for one in line.split(",")]
        if line.startswith("**") or not line.strip():
            continue
        if line.startswith("*"):
            keyword = words[0].upper()
            options = {k.strip().upper(): v.strip().strip('"') for k, _, v in (one.partition("=") for one in words[1:])}
            if keyword in _ELSEWHERE:
                refuse(
                    f"{path}: line {i}: {keyword} {_ELSEWHERE[keyword]}; write the deck flat and in global coordinates "
                    "(Abaqus/CAE: Model, Edit Attributes, Do not use parts and assemblies), or a CSV table node,x,y,z"
                )
            name = options.get("NSET", "").upper()
            if keyword == "*INCLUDE":
                _deck(path.parent / options["INPUT"], table, sets)
        elif keyword == "*NODE":
            _put(table, path, i, words)
            if name:
                sets.setdefault(name, []).append(int(words[0]))
        elif keyword == "*NSET":
            sets.setdefault(name, []).extend(_members(path, i, words, "GENERATE" in options, sets))


def _members(path: Path, line: int, words: list[str], generate: bool, sets: _Sets) -> list[int]:
    """Return the nodes of a line of *NSET: numbers, names of other sets, or first, last and step."""
    if generate:
        first, last, *step = (_whole(path, line, word) for word in words if word)
        return list(range(first, last + 1, *(step or [1])))
    found: list[int] = []
    for word in filter(None, words):
        found.extend(sets[word.upper()] if word.upper() in sets else [_whole(path, line, word)])
    return found


def _grids(path: Path, table: _Table) -> None:
    """Read GRID and GRID* of a Nastran deck, in basic coordinates."""
    lines = read_text(path).splitlines()
    for i, line in enumerate(lines):
        if not re.match(r"GRID[ ,*]", line.upper()):
            continue
        fields = _fields(line)
        if fields[0].upper() == "GRID*" and i + 1 < len(lines):
            fields = [*fields[:5], *_fields(lines[i + 1])[1:]]
        if fields[2] not in ("", "0") or (len(fields) > 6 and fields[6] not in ("", "0")):
            refuse(f"{path}: line {i + 1}: grid {fields[1]} has a coordinate system; only basic coordinates are read")
        _put(table, path, i + 1, [fields[1], *fields[3:6]])


def _nblock(path: Path, table: _Table) -> None:
    """Read the NBLOCK of an Ansys archive (CDWRITE)."""
    lines = iter(enumerate(read_text(path).splitlines(), 1))
    for _, line in lines:
        if not line.upper().startswith("NBLOCK"):
            continue
        form = re.match(r"\s*\((\d+)i(\d+),\d+e(\d+)", next(lines, (0, ""))[1].lower())
        if form is None:
            refuse(f"{path}: NBLOCK without its format, such as (3i9,6e21.13e3)")
        n, wide, long = (int(one) for one in form.groups())
        for i, text in lines:
            if text.lstrip().startswith(("N,", "-1")):
                break
            start = n * wide
            fields = [text[start + k * long : start + (k + 1) * long] for k in range(6)]
            if any(word.strip(" .0+-Ee") for word in fields[3:]):
                refuse(f"{path}: line {i}: node {text[:wide].strip()} has turned axes; only global directions are read")
            _put(table, path, i, [text[:wide], *fields[:3]])


@dataclass(frozen=True, eq=False, kw_only=True)
class Rows:
    """Rows of the matrices of a structure.

    Attributes
    ----------
    source : str
        The file that they come from.
    folder, labels : Path
        Where files are, and the table of the rows, if there is one.
    units : Units
        Those of the files.
    node, dof : (n,) int
        Label of each row.
    nodes : Nodes or None
        Nodes of the mesh, if a file says where they are.
    location : (n, 3) float
        Where each row is, m.
    groups : mapping of str to (m,) int
        Nodes by the name of their group.
    notes : tuple of str
        What a user should know.
    """

    source: str
    folder: Path
    labels: Path | None
    units: Units
    node: Index
    dof: Index
    nodes: Nodes | None
    location: NDArray[np.float64]
    groups: Mapping[str, Index] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def si(self, matrix: sp.csr_matrix, target: Target) -> sp.csr_matrix:
        """Return a matrix of these rows in SI units."""
        scale = sp.diags_array(np.where(self.dof > 3, self.units.length, 1.0))
        return sp.csr_matrix(self.units.factor(target) * (scale @ matrix @ scale))

    def matrix(self, file: str, target: Target) -> sp.csr_matrix:
        """Read a matrix into these rows, SI units."""
        found = read_matrix(file, self.folder, target, self.labels)
        return self.si(placed(found.rows(~found.held), self.node, self.dof, self.source), target)

    def known(self, names: Iterable[str]) -> tuple[str, ...]:
        """Return names of groups.

        Raises
        ------
        MatricesError
            There is none of a name.
        """
        found = tuple(names)
        for name in found:
            if name not in self.groups:
                refuse(f"no group {name!r}; there are {', '.join(self.groups) or 'none'}")
        return found

    def of(self, group: str, directions: Sequence[str]) -> Index:
        """Return the rows of a group's nodes in some directions."""
        self.known([group])
        wanted = np.isin(self.dof, [DIRECTIONS.index(one) + 1 for one in directions])
        return np.flatnonzero(np.isin(self.node, self.groups[group]) & wanted)

    def share(self, group: str, directions: Sequence[str]) -> NDArray[np.float64]:
        """Return the share of each row, (n,), in what acts evenly on the nodes of a group.

        Raises
        ------
        MatricesError
            The group has no such rows.
        """
        rows = self.of(group, directions)
        if not rows.size:
            refuse(f"group {group} has no rows along {', '.join(directions)}")
        found = np.zeros(self.node.size)
        found[rows] = 1.0 / np.unique(self.node[rows]).size
        return found

    def held(self, supports: Sequence[SupportForm]) -> NDArray[np.bool_]:
        """Return which rows supports hold, (n,).

        Raises
        ------
        MatricesError
            One is to be released that the matrices were written with.
        """
        found = np.zeros(self.node.size, dtype=bool)
        for one in supports:
            rows = self.of(one.group, one.directions)
            if one.state == "held":
                found[rows] = True
                continue
            nodes, dof = np.meshgrid(self.groups[one.group], [DIRECTIONS.index(name) + 1 for name in one.directions])
            missing = ~np.isin(key(nodes, dof), key(self.node[rows], self.dof[rows]))
            if missing.any():
                refuse(
                    f"support {one.group}: {name_of(nodes[missing], dof[missing], 0)} is not in the matrices, so it "
                    "cannot be released: they were written with it held. Write them without that boundary condition"
                )
        return found


def read_rows(given: StructureForm, folder: Path) -> tuple[Rows, dict[Target, sp.csr_matrix]]:
    """Read the matrices of the whole structure, in SI units, and the rows that all others must have.

    Where no stiffness is given, as when it is the sum of terms, the rows are those of the mass.

    Raises
    ------
    MatricesError
        A file cannot be read, or does not match another one.
    """
    stated, notes = given.matrices, []
    labels = None if stated.dofs is None else folder / stated.dofs
    mass = read_matrix(stated.mass, folder, "M", labels)
    base = read_matrix(stated.stiffness, folder, "K", labels) if stated.stiffness else mass
    if base.held.any():
        notes.append(f"{int(base.held.sum())} rows are held by an enormous stiffness and left out")
        base, mass = base.rows(~base.held), mass.rows(~np.isin(mass.key, base.key[base.held]))
    nodes = _nodes(labels, None if stated.nodes is None else folder / stated.nodes)
    units = UNITS[stated.units]
    if nodes is None:
        notes.append("no file says where nodes are, so inertia is unknown; nodes go by number alone")
    rows = Rows(
        source=base.source, folder=folder, labels=labels, units=units, node=base.node, dof=base.dof, nodes=nodes,
        location=_locations(nodes, base.node, base.source, units), notes=tuple(notes),
        groups={one.name: _group(one, nodes, np.unique(base.node), units) for one in given.group},
    )  # fmt: skip
    whole = {"M": rows.si(placed(mass, rows.node, rows.dof, rows.source), "M")}
    whole["K"] = rows.si(base.matrix, "K") if stated.stiffness else 0.0 * whole["M"]
    if stated.damping:
        whole["C"] = rows.matrix(stated.damping, "C")
    return rows, whole  # type: ignore[return-value]


def _nodes(labels: Path | None, file: Path | None) -> Nodes | None:
    """Return the nodes, of their file or of the table of the rows; None where neither says where they are."""
    if file is not None:
        return read_nodes(file)
    if labels is not None and kind_of(labels) == ".csv":
        names = {one.strip() for one in re.split("[,;\t]", read_text(labels).lower().partition("\n")[0])}
        return read_nodes(labels) if {"x", "y", "z"} <= names else None
    return None


def _locations(nodes: Nodes | None, node: Index, source: str, units: Units) -> NDArray[np.float64]:
    """Return where rows are, (n, 3) m; the numbers of their nodes where no file says it."""
    if nodes is None:
        return np.column_stack([node, np.zeros((node.size, 2))]).astype(float)
    missing = node[~np.isin(node, nodes.number)]
    if missing.size:
        refuse(f"{source}: the file of the nodes does not say where node {missing[0]} is; is it of the same model?")
    return np.asarray(nodes.location[np.searchsorted(nodes.number, node)] * units.length)


def _group(given: GroupForm, nodes: Nodes | None, used: Index, units: Units) -> Index:
    """Return the nodes of a group.

    Raises
    ------
    MatricesError
        It is stated in no way or in two, or holds no node, or one that there is not.
    """
    rounding = 1e-9  # m, by which a node may lie outside a box
    if sum(one is not None for one in (given.nodes, given.set, given.box_mm)) != 1:
        refuse(f"group {given.name}: give one of nodes, set and box_mm")
    if given.nodes is not None:
        found = np.array(given.nodes, dtype=np.int64)
    elif nodes is None:
        refuse(f"group {given.name}: set and box_mm need a file of nodes; name it by matrices.nodes")
    elif given.set is not None:
        if given.set.upper() not in nodes.sets:
            refuse(f"group {given.name}: no set {given.set}; the nodes' file has {', '.join(nodes.sets) or 'none'}")
        found = nodes.sets[given.set.upper()]
    else:
        low, high = np.array(given.box_mm).T * 1e-3
        place = nodes.location * units.length
        found = nodes.number[np.all((place >= low - rounding) & (place <= high + rounding), axis=1)]
    known = used if nodes is None else nodes.number
    missing = found[~np.isin(found, known)]
    if missing.size:
        refuse(f"group {given.name}: there is no node {missing[0]}")
    if not found.size:
        places = np.zeros((1, 3)) if nodes is None else nodes.location * units.length * 1e3
        span = ", ".join(f"{a:.4g} to {b:.4g}" for a, b in zip(places.min(axis=0), places.max(axis=0), strict=True))
        refuse(f"group {given.name}: holds no node; nodes span {span} mm. A box is [[x0, x1], [y0, y1], [z0, z1]]")
    return np.unique(found)
