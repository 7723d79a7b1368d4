"""A first campaign file for a folder: what its files hold, what is guessed, and what nobody but the user knows."""

from __future__ import annotations

import filecmp
import re
from collections import Counter, defaultdict
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from itertools import takewhile
from pathlib import Path

import numpy as np

from ema.campaign.campaign_file import NOT_READ, SUFFIXES, format_of
from ema.campaign.draft_histories import Set, is_of_force, of_motions_alone, side_by_side
from ema.io.array_histories import read_wav
from ema.io.files import UNKNOWN, Code, Contents, dof_name, natural, point_in
from ema.io.guess_table import guess_long, guess_table, not_understood
from ema.io.guess_variables import axis_keys, guess_variables, lone_axis
from ema.io.measured_function import NOT_UNDERSTOOD, MeasuredFunction, parse_unit
from ema.io.sdynpy import holds_data_arrays, read_data_arrays
from ema.io.table import point_columns, read_points, said_unit
from ema.io.uff import (
    NOT_OVER_FORCE,
    OF_DATA_TYPE,
    OF_GEOMETRY,
    REAL,
    UNSTATED,
    VOLTS,
    read_uff_functions,
    read_uff_geometry,
    read_uff_units,
)
from ema.io.uff58 import LABEL_OF_MOTION, cut
from ema.types.errors import CampaignError, MeasurementError

_TEXT_SUFFIXES = (".csv", ".txt", ".dat", ".asc", ".prn", ".tsv", ".lvm", ".gz")
_NO_DATA = (
    ".toml", ".md", ".rst", ".pdf", ".docx", ".png", ".jpg", ".jpeg", ".gif", ".svg", ".html", ".json", ".py", ".m",
    ".ipynb", ".log", ".ini",
)  # fmt: skip
"""Suffixes of what stands beside measurements; nobody takes these for some."""
_OF_A_POINT = re.compile(r"(point|pnt|node|punkt|knoten|to[cč]ka|position|dof)[ _.-]*\d+", re.IGNORECASE)
"""What a folder with the records of one point is called; p1 may be a pressure."""
_COPY = re.compile(r"\(\d+\)$|\bcopy\b|kopie|kopija|\bbackup\b", re.IGNORECASE)
RESULT = "modal_model.json"  # in a folder of results, which are no measurements


@dataclass(frozen=True, kw_only=True)
class PointsFound:
    """The file that lists the points: its path, the guessed unit of lengths (None where it states one), its points."""

    file: Path
    unit: str | None
    span: float
    node: tuple[int, ...]


@dataclass(frozen=True, kw_only=True)
class Draft:
    """What a folder seems to hold.

    Attributes
    ----------
    folder : Path
        The folder.
    points : PointsFound or None
        Its list of points.
    stack : Path or None
        Its stack file.
    configurations : mapping of str to tuple of Contents
        The files of each subfolder, in natural order, by the configuration's name.
    left_out : tuple of str
        Files that are not used, and why.
    """

    folder: Path
    points: PointsFound | None
    stack: Path | None
    configurations: dict[str, tuple[Contents, ...]]
    left_out: tuple[str, ...]
    modes: dict[str, tuple[Path, ...]] = field(default_factory=dict)

    @property
    def contents(self) -> tuple[Contents, ...]:
        """All files."""
        return tuple(c for contents in self.configurations.values() for c in contents)


def draft(folder: Path) -> Draft:
    """Look at the files in a folder; each subfolder with measurements becomes one configuration.

    Raises
    ------
    CampaignError
        It is no folder, or holds no file that looks like a measurement; the message says what was looked for.
    """
    if not folder.is_dir():
        raise CampaignError(f"{folder}: is not a folder")
    left_out: list[str] = []
    configurations: dict[str, tuple[Contents, ...]] = {}
    places = [folder, *sorted((p for p in folder.rglob("*") if p.is_dir()), key=natural)]
    for place in places:
        inside = place.relative_to(folder)
        if any(part.startswith(".") for part in inside.parts) or (place / RESULT).exists():
            continue
        files = _without_copies(sorted((f for f in place.iterdir() if f.is_file()), key=natural), left_out)
        contents = _at_points(tuple(c for c in (_contents(file, left_out) for file in files) if c is not None))
        contents = _measurements(_beside_frequencies(_beside_forces(contents)), left_out)
        if contents:
            configurations["_".join(inside.parts) or folder.resolve().name] = contents
    configurations = _with_forces(_of_one_layout(_over_points(folder, configurations), left_out), left_out)
    if not configurations:
        beside = [file.name for place in places for file in sorted(place.iterdir()) if _is_beside(file)]
        left_out += [f"{', '.join(beside[:4])}: not looked into"] if beside else []
        if not left_out and (points := _points(folder, {})) is not None:
            left_out.append(f"{points.file.name}: lists points alone; put the files of the functions beside it")
        said = f" ({'; '.join(_shortened(left_out))})" if left_out else ""
        raise CampaignError(
            f"{folder}: no file in it looks like a measurement{said}; looked for universal files, MATLAB, HDF5, "
            f"NumPy and text files ({', '.join((*SUFFIXES, *_TEXT_SUFFIXES))})"
        )
    return Draft(
        folder=folder,
        points=_points(folder, configurations),
        stack=model_file(folder),
        configurations=configurations,
        left_out=tuple(left_out),
    )


def _over_points(folder: Path, configurations: dict[str, tuple[Contents, ...]]) -> dict[str, tuple[Contents, ...]]:
    """Return subfolders that are called by points, such as point_1 and point_2, as one configuration: no states."""
    of_place: dict[Path, list[str]] = defaultdict(list)
    for name, contents in configurations.items():
        place = contents[0].file.parent
        if place != folder and _OF_A_POINT.fullmatch(place.name):
            of_place[place.parent].append(name)
    merged = dict(configurations)
    for place, names in of_place.items():
        parts = place.relative_to(folder).parts
        together = "_".join(parts) or folder.resolve().name
        if len(names) > 1 and together not in configurations:
            merged[together] = tuple(c for name in names for c in merged.pop(name))
    return merged


def _without_copies(files: list[Path], left_out: list[str]) -> list[Path]:
    """Return files without those that are called copies and hold the same bytes as another."""
    kept = [f for f in files if not _COPY.search(f.stem)]
    for copy in (f for f in files if _COPY.search(f.stem)):
        first = next((f for f in kept if f.suffix == copy.suffix and filecmp.cmp(f, copy, shallow=False)), None)
        if first is None:
            kept.append(copy)
        else:
            left_out.append(f"{copy}: is a copy of {first.name}")
    return sorted(kept, key=natural)


def model_file(folder: Path) -> Path | None:
    """Return the file of the model in a folder, of a stack or of matrices; None without one."""
    files = (folder / name for name in ("stack.toml", "structure.toml"))
    return next((file for file in files if file.exists()), None)


def _is_beside(file: Path) -> bool:
    """Whether a file is one of those that stand beside measurements."""
    return file.is_file() and file.suffix.lower() in _NO_DATA and not file.name.startswith(".")


def _shortened(left_out: list[str]) -> list[str]:
    """Return why files are not used, for files with the same reason once."""
    files: dict[str, list[str]] = {}
    for line in left_out:
        file, _, reason = line.partition(": ")
        files.setdefault(reason, []).append(file)
    return [
        f"{unread[0]}{f' and {len(unread) - 1} more' if len(unread) > 1 else ''}: {reason}"
        for reason, unread in files.items()
    ]


def _contents(file: Path, left_out: list[str]) -> Contents | None:
    """Return what a file holds, None where it is no measurement."""
    suffix = file.suffix.lower()
    if suffix in NOT_READ:
        left_out.append(f"{file}: is {NOT_READ[suffix]}")
    if file.name.startswith("."):
        return None
    known = suffix in (*SUFFIXES, *_TEXT_SUFFIXES)
    if not known and suffix in (*NOT_READ, *_NO_DATA):
        return None
    try:
        kind = format_of(file)
        if not known and kind == "csv":
            return _called_otherwise(file, left_out)
        if kind == "uff":
            return _universal(file)
        if kind == "wav":
            return Contents(file=file, is_time=True, titles=("",) * len(read_wav(file, (1.0,))))
        if kind == "numpy" and holds_data_arrays(file):
            return _of_functions(file, read_data_arrays(file, None))
        packed = Path(file.stem).suffix.lower() if suffix == ".gz" else ""
        if packed in SUFFIXES and packed not in _TEXT_SUFFIXES:
            left_out.append(f"{file}: a packed file of {packed!r}: unpack it")
            return None
        if kind != "csv":
            return _at_point(guess_variables(file, matlab=kind == "mat"))
        if _lists_points(file):
            return None
        contents = guess_long(file) or _at_point(guess_table(file))
    except MeasurementError as error:
        left_out.append(str(error))
        return None
    if contents is None:
        left_out.append(f"{file}: {not_understood(file)}")
    return contents


def _called_otherwise(file: Path, left_out: list[str]) -> Contents | None:
    """Return what a file of an unknown suffix holds whose titles tell that it is a table of FRFs or histories."""
    contents = None if _lists_points(file) else guess_long(file) or _at_point(guess_table(file))
    if contents is None or contents.by_numbers:
        left_out.append(f"{file}: its suffix {file.suffix.lower()!r} is none of a format that is read")
        return None
    return contents


def _at_point(contents: Contents | None) -> Contents | None:
    """Return a file of one FRF whose DOF nothing tells with the point of its name, as of a response along +z."""
    if contents is None or contents.is_time or contents.dofs != ((None, None),):
        return contents
    point = point_in(contents.file.stem)
    if point is None:
        return contents
    guess = "points are taken from the file names; that they are of the response and along +z is a guess"
    return replace(contents, dofs=(((point, 3), None),), guesses=(*contents.guesses, guess))


def _at_points(contents: tuple[Contents, ...]) -> tuple[Contents, ...]:
    """Return files of one FRF each with the points that their headers state, where these differ from file to file."""
    single = [c for c in contents if not c.is_time and c.dofs == ((None, None),)]
    points = {c.file: c.point for c in single if c.point is not None}
    if not len(set(points.values())) == len(single) > 1:
        return contents
    guess = "points are taken from the headers; that they are of the response and along +z is a guess"
    return tuple(
        replace(c, dofs=(((points[c.file], 3), None),), guesses=(*c.guesses, guess)) if c.file in points else c
        for c in contents
    )


def _beside_forces(contents: tuple[Contents, ...]) -> tuple[Contents, ...]:
    """Return arrays in which nothing tells what they are as responses beside a force that a hammer's pulse tells."""
    lengths = next((c.lengths for c in contents if c.is_time and len(c.titles) == 1), {})
    if not lengths:
        return contents
    return tuple(
        guess_variables(c.file, matlab=format_of(c.file) == "mat", beside=lengths)
        if c.section == "variables" and c.keys.get("frf") == UNKNOWN
        else c
        for c in contents
    )


def _beside_frequencies(contents: tuple[Contents, ...]) -> tuple[Contents, ...]:
    """Return FRFs whose frequencies a file beside them holds, such as ``freq.npy``, with these, without that file."""
    alone = {
        c.file: axis
        for c in contents
        if c.keys.get("frf") == UNKNOWN and (axis := lone_axis(c.file, matlab=format_of(c.file) == "mat")) is not None
    }
    given: list[Contents] = []
    used: set[Path] = set()
    for c in contents:
        fits = [file for file, axis in alone.items() if axis.size == c.lengths.get("frequency")]
        if c.keys.get("frequency") != UNKNOWN or len(fits) != 1:
            given.append(c)
            continue
        used.add(fits[0])
        keys = {key: value for key, value in c.keys.items() if key != "frequency"} | axis_keys(alone[fits[0]])
        guess = f"the frequencies are those of {fits[0].name}"
        given.append(replace(c, keys=keys, guesses=(*c.guesses, guess)))
    return tuple(c for c in given if c.file not in used)


def _of_one_name(every: list[Contents]) -> list[Contents]:
    """Return files of arrays whose names differ from file to file, such as ``FRF_1`` in FRF_1.mat, with * there."""
    arrays = [c for c in every if c.section == "variables"]
    keys = [c.keys for c in arrays]
    if len(arrays) < 2 or any(k.keys() != keys[0].keys() for k in keys):
        return every
    common = dict(keys[0])
    for key in common:
        values = [k[key] for k in keys]
        if all(value == values[0] for value in values):
            continue
        if not all(isinstance(value, str) and UNKNOWN not in value for value in values):
            return every
        start = _shared_start(values).rstrip("0123456789")
        end = _shared_start([value[len(start) :][::-1] for value in values])[::-1].lstrip("0123456789")
        common[key] = f"{start}*{end}"
    if common == keys[0]:
        return every
    said = "where the names of variables differ from file to file stands *"
    return [replace(c, keys=common, guesses=(*c.guesses, said)) if c.section == "variables" else c for c in every]


def _of_one_header(every: list[Contents]) -> list[Contents]:
    """Return tables that differ in the length of their headers, or in how these are encoded, with what fits all.

    Reading sees further rows of a header, and latin-1 reads any text; UTF-16 is known by its first bytes.
    """
    alike: dict[str, list[Contents]] = defaultdict(list)
    for c in every:
        if c.section == "table":
            alike[repr({key: v for key, v in c.keys.items() if key not in ("header_rows", "encoding")})].append(c)
    common = {
        of_set: {
            "header_rows": min(c.keys.get("header_rows", 0) for c in tables),
            "encoding": encodings.pop() if len(encodings := {c.keys.get("encoding", "utf-8") for c in tables}) == 1
            else "latin-1",
        }
        for of_set, tables in alike.items()
    }  # fmt: skip
    usual = {"header_rows": 0, "encoding": "utf-8"}
    with_common = {
        c.file: {key: v for key, v in {**c.keys, **common[of_set]}.items() if v != usual.get(key)}
        for of_set, tables in alike.items()
        for c in tables
    }
    return [replace(c, keys=with_common[c.file]) if c.section == "table" else c for c in every]


def _shared_start(names: list[str]) -> str:
    """Return the characters with which all names begin."""
    alike = takewhile(lambda letters: len(set(letters)) == 1, zip(*names, strict=False))
    return "".join(letters[0] for letters in alike)


def _measurements(contents: tuple[Contents, ...], left_out: list[str]) -> tuple[Contents, ...]:
    """Return the files in which something tells that they are a measurement; say of the others that nothing does.

    What LabVIEW writes as TDMS was acquired, whatever its channels are called.
    """
    unsure = (c for c in contents if c.keys.get("frf") == UNKNOWN and not c.guesses)
    nothing = [c for c in unsure if format_of(c.file) != "tdms"]
    left_out += [
        f"{c.file}: no array in it is complex, is called as FRFs or parts of them are, or looks like time histories"
        for c in nothing
    ]
    return tuple(c for c in contents if c not in nothing)


def _universal(file: Path) -> Contents | None:
    try:
        read_uff_geometry(file)
        holds_points = True
    except MeasurementError:
        holds_points = False
    if holds_points and {s.kind for s in cut(file, heads=True)} <= OF_GEOMETRY:
        return None  # a list of points
    functions, notes = read_uff_functions(file, heads=True)
    volts = [note.rpartition(f"{VOLTS} ")[2] for note in notes if VOLTS in note]
    if not any(f.kind in ("frf", "response") for f in functions):
        for said, wanted in ((REAL, "complex FRFs"), (NOT_OVER_FORCE, "FRFs, response over force")):
            note = next((note for note in notes if said in note), None)
            if note is not None:
                raise MeasurementError(f"{file}: {said}{note.rpartition(said)[2]}; export {wanted}")
    contents = _of_functions(
        file, functions, unstated=any(said in note for note in notes for said in (UNSTATED, OF_DATA_TYPE))
    )
    volts = [label if "/" in label else f"{label}/N" for label in volts]
    odd = volts or [match[1] for note in notes if (match := NOT_UNDERSTOOD.search(note))]
    return replace(contents, odd_unit=odd[0]) if odd else contents


def _of_functions(file: Path, functions: tuple[MeasuredFunction, ...], *, unstated: bool = False) -> Contents:
    """Return what a file holds that describes its functions itself.

    Raises
    ------
    MeasurementError
        It holds neither FRFs nor time histories.
    """
    frfs = [f for f in functions if f.kind == "frf"]
    used = frfs or [f for f in functions if f.kind == "response"]
    if not used:
        kinds = ", ".join(sorted({f.kind for f in functions}))
        raise MeasurementError(
            f"{file}: holds neither FRFs (function type 4) nor time histories (type 1), only functions of kind "
            f"{kinds}: spectra or other types; export FRFs"
        )
    stated = {
        "output": all(f.output is not None for f in used),
        "input": all(f.input is not None for f in frfs),  # of time histories it is the DOF of the force
        "unit": all(f.quantity is not None for f in used) and not unstated,
    }
    channels = [] if frfs else [f for f in functions if f.kind in ("force", "response")]
    return Contents(
        file=file,
        titles=tuple(_title(f) for f in channels),
        dofs=tuple((f.output, f.input) for f in used),
        states=frozenset(key for key, there in stated.items() if there),
        is_time=not frfs,
    )


def _title(channel: MeasuredFunction) -> str:
    """Return the point and the unit of a channel of time histories, as titles of tables write them."""
    unit = "N" if channel.kind == "force" else channel.quantity and LABEL_OF_MOTION[channel.quantity]
    return dof_name(channel.output) + (f" [{unit}]" if unit else "")


def _of_one_layout(
    configurations: dict[str, tuple[Contents, ...]], left_out: list[str]
) -> dict[str, tuple[Contents, ...]]:
    """Keep the files that one campaign file can describe: FRFs where there are any, and those of the usual layout."""
    every = [c for contents in configurations.values() for c in contents]
    every = _of_one_header(_of_one_name([_with_channels(c, every) for c in every]))
    of_file = {c.file: c for c in every}
    of_frfs = [c for c in every if not c.is_time]
    only_time = not of_frfs or (len(every) > 2 * len(of_frfs) and all(c.by_numbers for c in of_frfs))
    used = [c for c in every if c.is_time == only_time]
    usual: dict[str, Contents] = {}
    for section in ("table", "variables"):
        layouts = {repr(c.keys): c for c in used if c.section == section}
        understood = [c for c in used if c.section == section and UNKNOWN not in c.keys.values()]
        understood = understood or [c for c in used if c.section == section]  # what is understood outvotes what is not
        counts = Counter(repr(c.keys) for c in understood)
        if counts:
            usual[section] = layouts[counts.most_common(1)[0][0]]
    kept: dict[str, tuple[Contents, ...]] = {}
    for name, contents in configurations.items():
        for c in (of_file[c.file] for c in contents):
            if c.is_time and not only_time:
                left_out.append(f"{c.file}: holds time histories, and other files FRFs")
            elif only_time and not c.is_time:
                left_out.append(f"{c.file}: its columns might be FRFs, and most files hold time histories")
            elif c.section is not None and c.keys != usual[c.section].keys:
                differing = _differing(c, usual[c.section])
                left_out.append(f"{c.file}: laid out otherwise than most of the files ({differing})")
            else:
                kept[name] = (*kept.get(name, ()), c)
    return kept


def _with_forces(
    configurations: dict[str, tuple[Contents, ...]], left_out: list[str]
) -> dict[str, tuple[Contents, ...]]:
    """Leave out time histories without a force: of motions alone, or of one channel that no force stands beside.

    So are those of fewer or more channels than most, among which the force would be another one.
    """
    kept = {}
    for name, every in configurations.items():
        sets = _of_usual_channels(side_by_side(every), left_out)
        contents = tuple(c for of_set in sets for c in of_set)
        if all(of_set[0].is_time and of_motions_alone(of_set) for of_set in sets):
            left_out.extend(
                f"{c.file}: all its channels are of motions ({', '.join(c.titles[:4])}), and an FRF needs a force"
                for c in contents
            )
            continue
        alone = [of_set[0] for of_set in sets if of_set[0].is_time and sum(len(c.titles) for c in of_set) == 1]
        if len(alone) < len(sets) or any(map(is_of_force, contents)):  # which may be put beside each other by hand
            kept[name] = contents
            continue
        left_out.extend(
            f"{c.file}: holds one time history, and an FRF needs a force and a response: put both into one file, or "
            "into two whose names differ in a word alone, such as hit1_force and hit1_acc"
            for c in alone
        )
    return kept


def _of_usual_channels(sets: list[Set], left_out: list[str]) -> list[Set]:
    """Return the records that have as many channels as most, where the force is known by its place among them."""
    described = [of_set for of_set in sets if all(c.is_time and c.section is not None for c in of_set)]
    counts = Counter(sum(len(c.titles) for c in of_set) for of_set in described)
    usual, n_usual = counts.most_common(1)[0] if counts else (0, 0)
    if n_usual == len(described) or 2 * n_usual <= len(described):
        return sets
    odd = [of_set for of_set in described if sum(len(c.titles) for c in of_set) != usual]
    left_out += [
        f"{c.file}: holds {sum(len(c.titles) for c in of_set)} channels, and most files {usual}"
        for of_set in odd
        for c in of_set
    ]
    return [of_set for of_set in sets if of_set not in odd]


def _with_channels(contents: Contents, every: list[Contents]) -> Contents:
    """Return arrays of one channel described as those of several in other files, which have an axis more."""
    axes = contents.keys.get("axes", ())
    for other in every if contents.is_time and "channel" not in axes else ():
        others = other.keys.get("axes", ())
        if "channel" in others and [a for a in others if a != "channel"] == list(axes):
            return replace(contents, keys={**contents.keys, "axes": others})
    return contents


def _differing(contents: Contents, usual: Contents) -> str:
    """Say in words which keys of a file, and perhaps which unit, are others than the usual ones."""
    here, there = ({**one.keys, "unit": one.unit or one.odd_unit or "unknown"} for one in (contents, usual))
    names = [name for name in {**here, **there} if here.get(name) != there.get(name)]
    return "; ".join(f"{name} {here.get(name, 'not needed')} instead of {there.get(name, 'none')}" for name in names)


def _lists_points(file: Path) -> bool:
    try:
        with file.open(encoding="utf-8-sig") as text:
            head = text.readline(1000)
    except (OSError, UnicodeDecodeError):
        return False
    return {"node", "x", "y", "z"} <= set(point_columns(head)[1])


def first_points(files: Iterable[Path], *, longest: float = 10.0) -> PointsFound | None:
    """Return the first of files that lists points, with the unit of lengths where it states none.

    `longest`: m; points that span more than this number of their unit are in mm.
    """
    for file in files:
        stated, said = False, None
        try:
            if format_of(file) == "uff":
                geometry, _ = read_uff_geometry(file)
                stated = read_uff_units(file) is not None
            else:
                geometry = read_points(file, parse_unit("m"))
                said = said_unit(file)
        except MeasurementError:
            continue
        span = float(np.ptp(geometry.coordinate, axis=0).max())
        unit = None if stated else said or ("mm" if span > longest else "m")
        return PointsFound(file=file, unit=unit, span=span, node=tuple(geometry.node.tolist()))
    return None


def _points(folder: Path, configurations: dict[str, tuple[Contents, ...]]) -> PointsFound | None:
    """Return the list of points: a table of the folder, else the first universal file that holds some."""
    every = [f for f in sorted(folder.rglob("*"), key=natural) if f.is_file() and not (f.parent / RESULT).exists()]
    tables = [f for f in every if f.suffix.lower() in _TEXT_SUFFIXES and _lists_points(f)]
    measured = [c.file for contents in configurations.values() for c in contents]
    beside = [f for f in sorted(folder.iterdir(), key=natural) if f.is_file()]
    return first_points((*tables, *(f for f in (*beside, *measured) if format_of(f) == "uff")))


def unlisted(drafted: Draft) -> list[int]:
    """Return the points that are measured, as far as the files tell, but not in the list of points."""
    if drafted.points is None:
        return []
    measured = {dof[0] for c in drafted.contents for pair in c.dofs for dof in pair if dof is not None}
    return sorted(measured - set(drafted.points.node))


def force_by_exclusion(drafted: Draft, contents: tuple[Contents, ...]) -> Code | None:
    """Return the only listed point that is no response, in the direction of all responses: where a shaker can be."""
    outputs = {output for c in contents for output, _ in c.dofs}
    if drafted.points is None or None in outputs:
        return None
    codes = [output for output in outputs if output is not None]
    rest = set(drafted.points.node) - {node for node, _ in codes}
    directions = {code for _, code in codes}
    return (rest.pop(), directions.pop()) if len(rest) == len(directions) == 1 else None
