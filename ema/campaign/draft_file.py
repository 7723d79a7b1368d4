"""The text of a first campaign file, of functions or of modes, with a comment at every guess, and what is left."""

from __future__ import annotations

import glob
import json
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from ema.campaign.campaign_file import format_of
from ema.campaign.draft import RESULT, Draft, PointsFound, first_points, force_by_exclusion, model_file, unlisted
from ema.campaign.draft_histories import Guessed, Set, averaged, averaging_of, dofs_of, in_order, side_by_side
from ema.io.files import OF_VOLTS, UNKNOWN, Code, Contents, dof_name, natural, volts_in, whole
from ema.io.found_modes import kind_of_table
from ema.io.measured_function import parse_unit
from ema.io.modes_uff import holds
from ema.io.sdynpy import is_shape_array
from ema.io.table import read_points
from ema.io.uff import read_uff_geometry
from ema.types.errors import CampaignError, MeasurementError
from lamella_shared import Integers, Reals

_GAP = 3.0  # of the usual distance of neighbours: what is farther apart has a hole between


def lines_text(points: PointsFound, *, per_row: int = 6) -> list[str]:
    """Return the rows of a campaign file with the guessed trace lines; none where the points already have lines.

    `per_row`: lines in a row of the file.
    """
    try:
        if format_of(points.file) == "uff":
            geometry, _ = read_uff_geometry(points.file)
        else:
            geometry = read_points(points.file, parse_unit("m"))
    except MeasurementError:
        return []
    if geometry.line.size:
        return []
    lines = trace_lines(geometry.node, geometry.coordinate)
    if not lines:
        return []
    rows = [", ".join(map(str, lines[k : k + per_row])) for k in range(0, len(lines), per_row)]
    return [
        "# guessed from where the points are: points that a drawing joins; change, add or take away as you like",
        "lines = [",
        *(f"    {row}," for row in rows),
        "]",
    ]


def trace_lines(node: Integers, coordinate: Reals, *, same: float = 1e-3, grid: float = 0.9) -> list[list[int]]:
    """Return lines through points that are neighbours.

    Points that form a grid are joined along the axes. Others are joined as triangles (Delaunay) on each plane face of
    the structure: on the plane that all points lie in, else on those of the least and the largest x, y and z.

    Parameters
    ----------
    node : (n_node,) int
        Numbers of the points.
    coordinate : (n_node, 3) float
        Where they are, in any unit.
    same : float
        Of the span: points whose coordinates differ by less stand in one row of a grid.
    grid : float
        Of all points have neighbours along two axes, or along one where they stand in a row: a grid.

    Returns
    -------
    list of list of int
        Point numbers along each line, two or more.
    """
    if node.size < 2:
        return []
    span = float(np.ptp(coordinate, axis=0).max())
    cell = np.round(coordinate / (same * span)).astype(np.int64) if span > 0.0 else np.zeros((node.size, 3), int)
    rows = list(_rows(cell))
    joined = np.zeros((node.size, 3), dtype=bool)
    for axis, row in rows:
        joined[row, axis] = True
    extended = int(np.count_nonzero(np.ptp(cell, axis=0) > 0))
    if np.mean(joined.sum(axis=1) >= min(2, extended)) >= grid:
        return [node[row].tolist() for _, row in rows]
    edges = sorted(set(_face_edges(coordinate, same * span)))
    return [[int(node[a]), int(node[b])] for a, b in edges]


def _rows(cell: Integers) -> Iterator[tuple[int, Integers]]:
    """Yield each row of neighbours along an axis, as axis and indices of the points, parted at holes."""
    for axis in range(3):
        others = np.delete(cell, axis, axis=1)
        rows = [
            line[np.argsort(cell[line, axis], kind="stable")]
            for line in (np.flatnonzero((others == at).all(axis=1)) for at in np.unique(others, axis=0))
            if line.size > 1
        ]
        if not rows:
            continue
        usual = float(np.median(np.concatenate([np.diff(cell[row, axis]) for row in rows])))
        for row in rows:
            holes = np.flatnonzero(np.diff(cell[row, axis]) > _GAP * usual) + 1
            yield from ((axis, part) for part in np.split(row, holes) if part.size > 1)


def _face_edges(coordinate: Reals, same: float) -> Iterator[tuple[int, int]]:
    """Yield the edges of the triangles on every face, as pairs of indices of points in rising order."""
    for face, plane in _faces(coordinate, same):
        for triangle in _triangles(plane):
            closed: Sequence[int] = [*face[triangle].tolist(), int(face[triangle[0]])]
            yield from ((min(pair), max(pair)) for pair in pairwise(closed))


def _faces(coordinate: Reals, same: float) -> Iterator[tuple[Integers, Reals]]:
    """Yield the points of each plane face, and where they are in its plane."""
    centred = coordinate - coordinate.mean(axis=0)
    _, _, direction = np.linalg.svd(centred, full_matrices=False)
    every = np.arange(len(coordinate))
    if len(direction) < 3 or np.ptp(centred @ direction[2]) <= same:
        yield every, centred @ direction[:2].T
        return
    for axis in range(3):
        for end in (coordinate[:, axis].min(), coordinate[:, axis].max()):
            face = np.flatnonzero(np.abs(coordinate[:, axis] - end) <= same)
            yield face, np.delete(coordinate[face], axis, axis=1)


def _triangles(plane: Reals) -> Integers:
    """Return triangles (n, 3) of points in a plane, without those that span a hole; none where all are in a row."""
    import scipy.spatial as spatial

    if len(plane) < 3 or np.linalg.matrix_rank(plane - plane.mean(axis=0), tol=1e-9 * np.ptp(plane)) < 2:
        return np.empty((0, 3), dtype=np.int64)
    triangle = spatial.Delaunay(plane).simplices.astype(np.int64)
    corner = plane[triangle]
    longest = np.linalg.norm(corner - np.roll(corner, 1, axis=1), axis=2).max(axis=1)
    return triangle[longest <= _GAP * np.median(longest)]


NAME = "campaign.toml"


@dataclass(frozen=True, kw_only=True)
class DraftFile:
    """A campaign file that is to be written.

    Attributes
    ----------
    text : str
        The file.
    missing : tuple of str
        Key and what is to be filled in there, without which the campaign cannot be read or fitted.
    """

    text: str
    missing: tuple[str, ...]


def draft_file(drafted: Draft) -> DraftFile:
    """Return the campaign file of what a folder seems to hold.

    What nothing in the files tells stands as "?" where reading the campaign cannot do without it, and as a comment
    where an identification can.
    """
    missing: list[str] = []
    lines = ["[campaign]", f"name = {as_toml(drafted.folder.resolve().name)}", "", "[structure]"]
    if drafted.stack is None:
        missing.append("structure.stack: the stack file of the model, which fit and diagnose need")
        lines.append('# stack = "stack.toml"  # to be filled in for fit and diagnose: the model\'s stack file')
    else:
        lines.append(f"stack = {as_toml(drafted.stack.name)}")
    lines += ["", "[points]", *_points(drafted, missing)]
    lines += _modes(drafted, missing) if drafted.modes else _measurement(drafted, missing)
    for name, contents in drafted.configurations.items():
        lines += ["", *_configuration(drafted, name, contents, missing)]
    names = ", ".join(drafted.modes or drafted.configurations)
    missing.append(f"torque_Nm or pressure_kPa of {names}: the state of the stack, which fit and diagnose need")
    return DraftFile(text="\n".join(lines) + "\n", missing=tuple(missing))


def write_draft(drafted: Draft, file: DraftFile) -> Path:
    """Write a campaign file into its folder and return its path.

    Raises
    ------
    CampaignError
        There is one already, or it cannot be written.
    """
    path = drafted.folder / NAME
    if path.exists():
        raise CampaignError(f"{path}: is there already and is not overwritten; move it away to have a new one")
    with whole(path, CampaignError) as part:
        part.write_text(file.text, encoding="utf-8")
    return path


def _points(drafted: Draft, missing: list[str]) -> list[str]:
    if drafted.points is None:
        missing.append(
            "points.file: a list of the points' coordinates, node,x,y,z, and its unit as points.unit, to draw shapes "
            "and to compare them with a model"
        )
        return [
            '# file = "points.csv"  # to be filled in: columns node,x,y,z with the origin in the centre of the stack',
            '# unit = "mm"          # to be filled in: unit of these coordinates',
        ]
    lines = [f"file = {as_toml(drafted.points.file.relative_to(drafted.folder).as_posix())}"]
    if drafted.points.unit is not None:
        lines.append(f'unit = "{drafted.points.unit}"  # guessed: the points span {drafted.points.span:g}')
    absent = unlisted(drafted)
    if absent:
        missing.append(f"points {absent}: measured, but not in {drafted.points.file.name}; add them there")
        lines.append(f"# without_coordinates = {absent}  # to be filled in where nobody knows where they are")
    return [*lines, *lines_text(drafted.points)]


def _measurement(drafted: Draft, missing: list[str]) -> list[str]:
    lines = ["", "[measurement]"]
    is_time = any(c.is_time for c in drafted.contents)
    units = {c.unit for c in drafted.contents if "unit" not in c.states}
    if units and not is_time:
        unit = next(iter(units)) if len(units) == 1 else None
        comment = "as the header says"
        if unit is None:
            comment = "to be filled in: such as (m/s2)/N, g/N or mm/N"
            missing.append(f"measurement.unit: {_asked_unit(drafted.contents)}")
        lines.append(f"unit = {as_toml(unit or UNKNOWN)}  # {comment}")
    if any(format_of(c.file) == "wav" for c in drafted.contents):
        n = sum(len(c.titles) for c in side_by_side(next(iter(drafted.configurations.values())))[0])
        missing.append(
            f"measurement.full_scale: what full scale of the sound files means, a number for each of {n} channels"
        )
        lines.append('full_scale = "?"  # to be filled in: such as [5000, 500] for 5000 N and 500 m/s2 at full scale')
    for section in ("table", "variables"):
        described = [c for c in drafted.contents if c.section == section]
        if described:
            lines += ["", f"[measurement.{section}]", *_section(section, described, missing)]
    if is_time:
        contents = next(iter(drafted.configurations.values()))
        lines += ["", "[measurement.time]", *_averaging(averaging_of(side_by_side(contents)), missing)]
    return lines


def _asked_unit(contents: tuple[Contents, ...]) -> str:
    """Say which unit is asked for, and why the headers do not tell it."""
    labels = Counter(c.unit or c.odd_unit for c in contents if "unit" not in c.states)
    label, count = labels.most_common(1)[0]
    if len(labels) > 1:
        said = ", ".join(f"{name or 'none'} in {n} files" for name, n in labels.most_common())
        return (
            f"the files state several units, {said}: give that of most of them, and scale the others by a "
            "[[correction]]"
        )
    said = f"the {'file states' if count == 1 else 'files state'} {label}"
    if OF_VOLTS.fullmatch(label):
        return (
            f"{said}, the volts of two sensors: divide by the sensitivity of the response and multiply by that of the "
            f'force, such as unit = "{label}/(100 mV/g)*(2.25 mV/N)"'
        )
    if volts_in(label):
        return (
            f"{said}, the volts of a sensor: divide by its sensitivity, such as "
            f'unit = "{label}/(100 mV/g)" for a sensor of 100 mV/g'
        )
    if label:
        return f"{said}, which is not understood: write it as (m/s2)/N, g/N, mm/N or the like"
    return "the unit of the FRFs, such as (m/s2)/N or g/N"


def _averaging(keys: dict[str, Guessed], missing: list[str]) -> Iterable[str]:
    for key, guessed in keys.items():
        yield f"{key} = {as_toml(guessed.value)}  # {guessed.comment}"
        if guessed.value == UNKNOWN:
            meant = '"hann" for random excitation, "boxcar" for impacts or whole periods'
            missing.append(
                f"measurement.time.{key}: {meant if key == 'window' else 'such as N and m/s2, of volts V/(100 mV/g)'}"
            )


def _section(section: str, described: list[Contents], missing: list[str]) -> Iterable[str]:
    for guess in dict.fromkeys(guess for c in described for guess in c.guesses):
        yield f"# guessed: {guess}"
    for key, value in described[0].keys.items():
        unknown = value == UNKNOWN
        if unknown:
            said = f"nothing in {described[0].file.name} looks like it"
            if key == "frf" and described[0].guesses:
                said = f"{described[0].guesses[0]}; name the one that holds FRFs"
            elif key == "frequency":
                said += ": of lines in even steps, give axis_step in Hz in its place"
            elif key == "phase_unit":
                said = f"{next(g for g in described[0].guesses if g.startswith('the phase'))}; say deg or rad"
            missing.append(f"measurement.{section}.{key}: {said}")
        yield f"{key} = {as_toml(value)}{'  # to be filled in' if unknown else ''}"


def _configuration(drafted: Draft, name: str, contents: tuple[Contents, ...], missing: list[str]) -> Iterable[str]:
    yield "[[configuration]]"
    yield f"name = {as_toml(name)}"
    yield '# compare_to = "NAME"   # of a changed state: the configuration before the change, or a list of its repeats'
    yield "# torque_Nm =           # to be filled in for fit and diagnose: bolt torque, or"
    yield "# pressure_kPa =        # the mean pressure between the sheets"
    if any(c.is_time for c in contents):
        yield from _histories(drafted, name, contents, missing)
        return
    files = as_toml(_patterns(drafted.folder, [c.file for c in contents]))
    if _hammer_roves(contents):
        yield "[[configuration.run]]"
        yield f"files = {files}  # one run: the sensors stay while the hammer roves, nothing on the structure changes"
    else:
        yield f"files = {files}  # each file is one run"
    for end, which in (("output", 0), ("input", 1)):
        if all(end in c.states for c in contents):
            continue
        dofs = [pair[which] for c in contents for pair in c.dofs]
        comment = ""
        by_exclusion = force_by_exclusion(drafted, contents) if end == "input" and set(dofs) == {None} else None
        if by_exclusion is not None:
            dofs = [by_exclusion]
            comment = "  # guessed: the only listed point that is no output"
        if None in dofs:
            missing.append(
                f"{end} of configuration {name}: a DOF such as 12+z for each of {len(dofs)} FRFs, or one for all"
            )
            comment = f"  # to be filled in: one for each of {len(dofs)} FRFs in the order of the files, or one for all"
        yield f"{end} = {as_toml(_names(dofs))}{comment}"


def _hammer_roves(contents: tuple[Contents, ...]) -> bool:
    """Whether all files have the same responses and each has forces of its own: fixed sensors, a roving hammer."""
    responses = {frozenset(output for output, _ in c.dofs) for c in contents}
    forces = [frozenset(force for _, force in c.dofs) for c in contents]
    stated = all(None not in pair for c in contents for pair in c.dofs)
    return stated and len(contents) > 1 and len(responses) == 1 and len(set(forces)) == len(forces)


def _histories(drafted: Draft, name: str, contents: tuple[Contents, ...], missing: list[str]) -> Iterable[str]:
    """Give the files of a configuration of time histories, as runs where their names tell which are averaged."""
    sets = side_by_side(contents)
    runs = averaged(sets)
    force = averaging_of(sets).get("force")
    position = 0 if force is None else force.value - 1
    ends = [("output", 0), ("input", 1)]
    if all({"output", "input"} <= c.states for c in contents):
        ends = []
    pairs = [pair for files in sets for pair in dofs_of(files, position)]
    unknown = [end for end, which in ends if not pairs or None in [pair[which] for pair in pairs]]
    if unknown:
        missing.append(f"{' and '.join(unknown)} of configuration {name}: the DOFs of its time histories")
    beside = "; files in inner brackets hold channels of the same records" if len(sets[0]) > 1 else ""
    together = any(len(run) > 1 for run in runs)
    for run in runs if together else [sets]:
        if together:
            yield "[[configuration.run]]"
            files_text = as_toml(_of_sets(drafted, run))
            yield f"files = {files_text}  # guessed: blows that are averaged, by their names{beside}"
        else:
            yield f"files = {as_toml(_of_sets(drafted, run))}  # each is one run{beside}"
            yield "# blows or blocks of one force and its sensors that are averaged are one [[configuration.run]]"
        pairs = [pair for files in (run[:1] if together else run) for pair in dofs_of(files, position)]
        for end, which in ends:
            if end in unknown:
                yield f'# {end} = ["12+z"]  # to be filled in: one for all, or one for each of {len(pairs)} functions'
            else:
                yield f"{end} = {as_toml(_names([pair[which] for pair in pairs]))}  # guessed: by titles and file names"


def _of_sets(drafted: Draft, sets: list[Set]) -> list[Any]:
    """Return the names of the files of records, of files side by side as lists."""
    if len(sets[0]) == 1:
        return _patterns(drafted.folder, [c.file for files in sets for c in files])
    patterns = [_patterns(drafted.folder, [c.file for c in column]) for column in zip(*sets, strict=True)]
    if in_order(sets) and all(len(names) == 1 for names in patterns):
        return [[names[0] for names in patterns]]
    return [[_patterns(drafted.folder, [c.file])[0] for c in files] for files in sets]


def _names(dofs: list[Code | None]) -> list[str]:
    once = list(dict.fromkeys(dofs))
    return [dof_name(code) for code in (once if len(once) == 1 else dofs)]


def _patterns(folder: Path, files: list[Path]) -> list[str]:
    """Return one name with a wildcard where it is that of these files and no others, else all names."""
    names = [glob.escape(file.relative_to(folder).as_posix()) for file in files]
    start = names[0]
    while not all(name.startswith(start) for name in names):
        start = start[:-1]
    place = "".join(names[0].rpartition("/")[:2])
    start = start.rstrip("0123456789") if len(start) > len(place) else place
    end = names[0][len(start) :]
    while not all(name[len(start) :].endswith(end) for name in names):
        end = end[1:]
    end = end.lstrip("0123456789")
    for pattern in (f"{start}*{files[0].suffix}", f"{start}*{end}"):
        if len(files) > 1 and sorted(folder.glob(pattern), key=natural) == files:
            return [pattern]
    return names


def as_toml(value: Any) -> str:
    """Return a text, number or list as TOML writes it, which is what JSON does, too."""
    return json.dumps(value, ensure_ascii=False)


_OTHERS = (".mat", ".h5", ".hdf5", ".tdms", ".lvm")  # which hold functions
_TEXTS = (".csv", ".txt", ".dat", ".asc", ".tsv")


def draft_modes(folder: Path) -> Draft | None:
    """Look for files of modes in a folder; None where it holds none, or functions beside them.

    Each universal file, each array of SDynPy and each table of modes is one configuration; a table has the shapes of
    the table of shapes beside it.

    Parameters
    ----------
    folder : Path
        The folder.
    """
    if not folder.is_dir():
        return None
    every = sorted((f for f in folder.rglob("*") if f.is_file()), key=natural)
    every = [f for f in every if not f.name.startswith(".") and not (f.parent / RESULT).exists()]
    if any(f.suffix.lower() in _OTHERS for f in every):
        return None
    tables = [f for f in every if f.suffix.lower() in _TEXTS]
    modes, shapes = ([f for f in tables if kind_of_table(f) == kind] for kind in ("modes", "shapes"))
    points = [f for f in tables if f not in (*modes, *shapes)]
    universal = [f for f in every if format_of(f) == "uff"]
    arrays = [f for f in every if format_of(f) == "numpy"]
    held = {f: holds(f) for f in universal}
    if any(functions for _, functions in held.values()):
        return None
    of_modes = [f for f, (shapes_there, _) in held.items() if shapes_there]
    whole = [*of_modes, *(f for f in arrays if is_shape_array(f))]
    if not (whole or modes) or len(whole) < len(arrays) + len(of_modes):
        return None
    listed = first_points([*points, *(f for f in universal if f not in of_modes), *of_modes])
    if [f for f in points if listed is None or f != listed.file]:
        return None  # other tables, which may hold functions
    files: dict[str, tuple[Path, ...]] = {_name(folder, f): (f,) for f in whole}
    files |= {_name(folder, f): (f, *_beside(f, modes, shapes)) for f in modes}
    return Draft(folder=folder, points=listed, stack=model_file(folder), configurations={}, left_out=(), modes=files)


def _modes(drafted: Draft, missing: list[str]) -> list[str]:
    """Return how sure modes are, to be filled in, and their configurations."""
    lines = [
        "",
        "[modes]  # how sure the modes are, relative",
        "# frequency_std = 0.001  # to be filled in where the files do not state it; these are usual values",
        "# damping_std = 0.1",
        "# shape_std = 0.01       # of a component, over the root mean square of the shape",
    ]
    for name, files in drafted.modes.items():
        names = [file.relative_to(drafted.folder).as_posix() for file in files]
        lines += [
            "",
            "[[configuration]]",
            f"name = {as_toml(name)}",
            'modes = "file"           # these files hold modes that another program identified',
            f"files = {as_toml(names)}",
            '# input = "12+z"         # to be filled in for diagnose: where the force acted',
            "# torque_Nm =            # to be filled in for fit and diagnose: bolt torque, or",
            "# pressure_kPa =         # the mean pressure between the sheets",
        ]
    listed = ", ".join(drafted.modes)
    missing.append(f"input of {listed}: the point and direction of the force, such as 12+z, which diagnose needs")
    return lines


def _beside(table: Path, modes: list[Path], shapes: list[Path]) -> tuple[Path, ...]:
    """Return the table of shapes that belongs to a table of modes: the one of its folder, or the one in its place."""
    near, others = ([f for f in every if f.parent == table.parent] for every in (shapes, modes))
    return (near[others.index(table)],) if len(near) == len(others) else ()


def _name(folder: Path, file: Path) -> str:
    """Name a configuration by its file, or by its folder where the file's name says nothing but that it holds modes."""
    inside = file.relative_to(folder).with_suffix("").parts
    return "_".join(inside[:-1] if len(inside) > 1 and inside[-1].casefold() in ("modes", "shapes") else inside)
