"""A first campaign file for a folder that holds modes which another program identified, and no functions."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from ema.campaign.campaign_file import format_of, natural
from ema.campaign.draft import Draft, first_points, model_file
from ema.campaign.draft_file import DraftFile, as_toml
from ema.io.found_modes import is_table_of_modes, is_table_of_shapes
from ema.io.modes_uff import holds
from ema.io.sdynpy import is_shape_array

_OTHERS = (".mat", ".h5", ".hdf5", ".tdms", ".lvm")  # which hold functions
_TEXTS = (".csv", ".txt", ".dat", ".asc", ".tsv")
_RESULT = "modal_model.json"  # in a folder of results


@dataclass(frozen=True, kw_only=True)
class ModesDraft:
    """What a folder of modes holds.

    Attributes
    ----------
    found : Draft
        Its points and stack file; without configurations of functions.
    files : dict of str to tuple of Path
        The files of each configuration.
    """

    found: Draft
    files: dict[str, tuple[Path, ...]]


def draft_modes(folder: Path) -> ModesDraft | None:
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
    every = [f for f in every if not f.name.startswith(".") and not (f.parent / _RESULT).exists()]
    if any(f.suffix.lower() in _OTHERS for f in every):
        return None
    tables = [f for f in every if f.suffix.lower() in _TEXTS]
    modes = [f for f in tables if is_table_of_modes(f)]
    shapes = [f for f in tables if is_table_of_shapes(f)]
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
    beside = Draft(folder=folder, points=listed, stack=model_file(folder), configurations={}, left_out=())
    return ModesDraft(found=beside, files=files)


def modes_draft_file(drafted: ModesDraft) -> DraftFile:
    """Return the campaign file of a folder of modes, with "?" and comments where something is to be filled in."""
    points, missing = drafted.found, list[str]()
    lines = ["[campaign]", f"name = {as_toml(points.folder.resolve().name)}", "", "[structure]"]
    if points.stack is None:
        missing.append("structure.stack: the stack file of the model, which fit and diagnose need")
        lines.append('# stack = "stack.toml"  # to be filled in for fit and diagnose: the model\'s stack file')
    else:
        lines.append(f"stack = {as_toml(points.stack.name)}")
    lines += ["", "[points]", *_points_lines(points, missing), "", "[modes]  # how sure the modes are, relative"]
    lines += [
        "# frequency_std = 0.001  # to be filled in where the files do not state it; these are usual values",
        "# damping_std = 0.1",
        "# shape_std = 0.01       # of a component, over the root mean square of the shape",
    ]
    for name, files in drafted.files.items():
        names = [file.relative_to(points.folder).as_posix() for file in files]
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
    listed = ", ".join(drafted.files)
    missing.append(f"input of {listed}: the point and direction of the force, such as 12+z, which diagnose needs")
    missing.append(f"torque_Nm or pressure_kPa of {listed}: the state of the stack, which fit and diagnose need")
    return DraftFile(text="\n".join(lines) + "\n", missing=tuple(missing))


def _points_lines(drafted: Draft, missing: list[str]) -> Iterator[str]:
    if drafted.points is None:
        missing.append("points.file: a list of the points' coordinates, node,x,y,z, and its unit as points.unit")
        yield '# file = "points.csv"    # to be filled in: columns node,x,y,z, the origin in the centre of the stack'
        yield '# unit = "mm"            # to be filled in: unit of these coordinates'
        return
    yield f"file = {as_toml(drafted.points.file.relative_to(drafted.folder).as_posix())}"
    if drafted.points.unit is not None:
        yield f'unit = "{drafted.points.unit}"  # guessed: the points span {drafted.points.span:g}'


def _beside(table: Path, modes: list[Path], shapes: list[Path]) -> tuple[Path, ...]:
    """Return the table of shapes that belongs to a table of modes: the one of its folder, or the one in its place."""
    near, others = ([f for f in every if f.parent == table.parent] for every in (shapes, modes))
    return (near[others.index(table)],) if len(near) == len(others) else ()


def _name(folder: Path, file: Path) -> str:
    """Name a configuration by its file, or by its folder where the file's name says nothing but that it holds modes."""
    inside = file.relative_to(folder).with_suffix("").parts
    return "_".join(inside[:-1] if len(inside) > 1 and inside[-1].casefold() in ("modes", "shapes") else inside)
