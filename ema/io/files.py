"""Files written whole or not at all, the form of files in TOML, and what a measurement file seems to hold."""

from __future__ import annotations

import os
import re
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel, ConfigDict

from ema.io.measured_function import Unit, parse_unit
from ema.types.errors import MeasurementError
from lamella_shared import Complexes, Reals


@contextmanager
def whole(path: Path, error: type[Exception]) -> Iterator[Path]:
    """Give a new file beside `path` to write to, and put it there when all went well; make its folder if need be.

    Parameters
    ----------
    path : Path
        The file to write. Whatever goes wrong, what was there before is left as it was.
    error : type of Exception
        What is raised when it cannot be written or the disk is full.
    """
    part = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
        os.close(handle)
        part = Path(name)
        yield part
        part.chmod(0o644)
        part.replace(path)
    except OSError as cause:
        raise error(f"cannot write {path}: {cause.strerror}. Choose another folder with -o, or make room.") from cause
    finally:  # whatever stopped it, Ctrl-C too
        if part is not None:
            part.unlink(missing_ok=True)


class Section(BaseModel):
    """Any table of such a file: unknown keys are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True)


Code = tuple[int, int]
"""A point number and a signed direction, 1, 2, 3 for +x, +y, +z."""
UNKNOWN = "?"
"""What stands in a campaign file for what nobody can guess; reading it names the key that is to be filled in."""

FORCE = re.compile(
    r"forc|hammer|impact|kraft|\bsil[ae]\b|kladiv|load.?cell|excit|^f\d*(_|$)|[\[(](m|k)?N[\])]|[\[(]lbf?[\])]",
    re.IGNORECASE,
)
"""What a channel or a file of a force may be called, in English, German or Slovene, or its unit."""
OF_VOLTS = re.compile(r"\(?m?V(?:olts?)?/m?V(?:olts?)?\)?", re.IGNORECASE)
"""A ratio of volts: of an analyser that knows no sensors."""
_DOF = re.compile(r"(?<![A-Za-z0-9.])H?(\d{1,9}):?([+-]?)([xyz])([+-]?)(?![A-Za-z0-9])", re.IGNORECASE)
_CALLED = r"(?<![A-Za-z0-9])(?:p|pt|pnt|point|node|punkt|knoten|to[cč]ka)[ .:]*(\d{1,9})"
_POINT = re.compile(_CALLED + r"[ :]*([+-]?[xyz][+-]?)(?![A-Za-z0-9])", re.IGNORECASE)
_PARTED = re.compile(r"(?<![A-Za-z0-9.])(\d{1,9}) +(?=[+-][xyz](?![A-Za-z0-9]))", re.IGNORECASE)
_SIGN = re.compile(r"(?<=\d[xyz])(?:plus|minus)(?![A-Za-z])", re.IGNORECASE)  # in names of variables, which have no +
_OF_POWERS = re.compile(r"(?<![\w-])\w{1,2}(?: s\^?[-⁻][12¹²])? [kmu]?(?:N|lbf)\^?[-⁻][1¹](?![\w-])")
_POINT_ALONE = re.compile(_CALLED + r"(?![A-Za-z0-9])", re.IGNORECASE)


@dataclass(frozen=True, kw_only=True)
class Contents:
    """What a file seems to hold.

    Attributes
    ----------
    file : Path
        The file.
    section : str or None
        Which section of the campaign file describes it, "table" or "variables"; None where it describes itself.
    keys : mapping
        Keys of that section; `UNKNOWN` stands for what is not known.
    unit : str or None
        Unit of the FRFs as the file writes it; None where it does not.
    dofs : tuple of (Code or None, Code or None)
        Output and input of each FRF in reading order.
    states : frozenset of {"output", "input", "unit"}
        What reading the file gives without the campaign file.
    is_time : bool
        Whether it holds time histories.
    titles : tuple of str
        Of time histories what each channel is called; empty where it has no name.
    n_run : int
        Runs of time histories that it holds.
    lengths : mapping of str to int
        Of time histories in arrays how long each axis is.
    by_numbers : bool
        Whether nothing but its numbers tells that it holds FRFs.
    point : int or None
        Point that the header of a file of one FRF seems to state, without a direction.
    odd_unit : str
        Unit of the FRFs where the file writes one of volts, such as V/N, or one that is not understood; else empty.
    guesses : tuple of str
        What was taken for granted, and why.
    """

    file: Path
    section: str | None = None
    keys: Mapping[str, Any] = field(default_factory=dict)
    unit: str | None = None
    dofs: tuple[tuple[Code | None, Code | None], ...] = ()
    states: frozenset[str] = frozenset()
    is_time: bool = False
    titles: tuple[str, ...] = ()
    n_run: int = 1
    lengths: Mapping[str, int] = field(default_factory=dict)
    by_numbers: bool = False
    point: int | None = None
    odd_unit: str = ""
    guesses: tuple[str, ...] = ()


def natural(file: Path | str) -> list[tuple[int, str]]:
    """Return what sorts names as people count them, run 2 before run 10."""
    return [(int(p), "") if p.isdigit() else (0, p) for p in re.split(r"(\d+)", str(file))]


def field_of(name: str) -> str:
    """Return the name of a field or data set without those of the structures and groups that it is in."""
    return re.split(r"[./@]", name)[-1]


def dofs_in(text: str) -> list[Code]:
    """Return the DOFs that a header or a file name holds, such as ``12+z``, ``12:+Z``, ``H12Z-`` or ``P12_Z``."""
    dofs = []
    for node, before, axis, after in _DOF.findall(_plain(text)):
        sign = -1 if "-" in (before, after) else 1
        dofs.append((int(node), sign * ("xyz".index(axis.lower()) + 1)))
    return [(node, code) for node, code in dofs if node > 0]


def dof_of_cells(cells: Sequence[str], direction: str = "") -> Code | None:
    """Return the DOF that cells of a row state: ``12+z``, or a point and a direction (z, +Z, -3); None without one.

    `direction`: of a point that stands alone.
    """
    words = [re.sub(r"^(\d+)\.0+$", r"\1", cell.strip().strip("\"'")) for cell in cells]
    if len(words) > 1 and (code := re.fullmatch(r"([+-]?)([123])", words[1])) is not None:
        words[1] = f"{code[1]}{'xyz'[int(code[2]) - 1]}"
    joined = "".join(words[:2]) + (direction if len(words) == 1 else "")
    dofs = dofs_in(joined) or dofs_in("".join(words))
    return dofs[0] if len(dofs) == 1 else None


def lacks_sign(text: str) -> bool:
    """Whether a header or a file name holds a DOF without a sign, which is then taken as +."""
    return any(not before + after for _, before, _, after in _DOF.findall(_plain(text)))


def _plain(text: str) -> str:
    """Return a text in which a DOF such as ``P12_Z`` or ``12 +Z`` stands as ``12Z``, and ``12Zplus`` as ``12Z+``."""
    signs = _SIGN.sub(lambda word: "+" if word[0].lower() == "plus" else "-", text.replace("_", " "))
    return _PARTED.sub(r"\1", _POINT.sub(r"\1\2", signs))


def dof_name(code: Code | None) -> str:
    """Return a DOF as campaign files write it, or `UNKNOWN`."""
    if code is None:
        return UNKNOWN
    return f"{code[0]}{'+' if code[1] > 0 else '-'}{'xyz'[abs(code[1]) - 1]}"


def unit_in(text: str) -> str | None:
    """Return the first unit of a response over a force in a header; None where there is none."""
    return next((label for label, unit in ratios_in(text) if unit.frf is not None), None)


def volts_in(text: str) -> str:
    """Return the first unit of volts over something, or over volts, in a header; empty where there is none."""
    return next((label for label, unit in ratios_in(text) if unit.volt != 0 or OF_VOLTS.fullmatch(label)), "")


def is_other_ratio(label: str) -> bool:
    """Whether a unit is one of a ratio that is no FRF: a force over a response, or a response over another."""
    if label.strip() == "/":  # Testlab's unit of a transmissibility
        return True
    try:
        unit = parse_unit(label)
    except MeasurementError:
        return False
    is_none = unit.dimension == (0, 0, 0) and unit.volt == 0 and "/" in label and not OF_VOLTS.fullmatch(label)
    return unit.turned_frf or is_none


def ratios_in(text: str) -> Iterator[tuple[str, Unit]]:
    """Give the units in a header that are ratios, with what they mean."""
    in_brackets = re.findall(r"[\[(]([^\[\]\s,;]*/[^\[\]\s,;]*)[\])](?=[\s,;]|$)", text)
    in_brackets += [re.sub(r"\s", "", label) for label in re.findall(r"\[([^\[\],;]*/[^\[\],;]*)\]", text)]
    in_brackets += re.findall(r"\bre\.? *1? *([^\s,;]*/[^\s,;]*)[\])](?=[\s,;]|$)", text)  # of decibels
    for word in (*re.split(r"[\s,;]+", text), *in_brackets, *_OF_POWERS.findall(text)):
        label = word.strip("[]\"'")
        try:
            if re.search("/|-1|⁻¹", label) and re.search("[A-Za-z]", label):  # else it is a date
                yield label, parse_unit(label)
        except MeasurementError:
            continue


def point_in(text: str) -> int | None:
    """Return the one point that a file name holds without a direction, such as ``point_3``; None otherwise."""
    points = [int(node) for node in _POINT_ALONE.findall(text.replace("_", " "))]
    return points[0] if len(points) == 1 and points[0] > 0 else None


def with_names(file: Path, header: list[list[Code]]) -> tuple[tuple[tuple[Code | None, Code | None], ...], list[str]]:
    """Return output and input of each FRF of a file from its header and its name, and what was guessed.

    Parameters
    ----------
    file : Path
        The file; where the name holds two DOFs, the first is the response.
    header : list of list of Code
        For each FRF the DOFs that its header holds.
    """
    named = dofs_in(file.name)
    dofs: list[tuple[Code | None, Code | None]] = [
        (read_dofs[0] if read_dofs else None, read_dofs[1] if len(read_dofs) > 1 else None) for read_dofs in header
    ]
    outputs = [output for output, _ in dofs]
    if not named:
        return tuple(dofs), []
    if outputs == [None]:
        dofs = [(named[0], named[1] if len(named) > 1 else None)]
        sign = ", without a sign as +" if lacks_sign(file.name) else ""
        return tuple(dofs), [f"DOFs are taken from the file names, the response first{sign}"]
    if None in outputs or all(force is not None for _, force in dofs) or named[-1] in outputs:
        return tuple(dofs), []
    return tuple((o, i or named[-1]) for o, i in dofs), ["the force's DOF is taken from the file names"]


def from_polar(magnitude: Reals, phase: Reals, *, decibel: bool, degrees: bool) -> Complexes:
    """Return complex numbers from magnitudes, plain or 20 log10 of them, and phases in degrees or rad."""
    with np.errstate(over="ignore", invalid="ignore"):  # what is not finite is for the quality check to say
        size = 10.0 ** (magnitude / 20.0) if decibel else magnitude
        return np.asarray(size * np.exp(1j * (np.deg2rad(phase) if degrees else phase)))


def polar_units(
    titles: tuple[str, str], magnitude: Reals, phase: Reals, guesses: list[str], *, least_of_degrees: float = 60.0
) -> dict[str, str]:
    """Return `magnitude_unit` and `phase_unit` as a campaign file has them, where they are not the usual ones.

    Parameters
    ----------
    titles : (str, str)
        What titles or names say of the magnitudes and of the phases.
    magnitude, phase : array
        The numbers, of any shape.
    guesses : list of str
        What only the numbers tell is added to it.
    least_of_degrees : float
        Largest phase from which on numbers without a unit are taken as degrees. A phase that is not wrapped passes 2
        pi in rad, but needs some twenty resonances to pass this; in degrees one resonance takes it beyond 90.
    """
    keys: dict[str, str] = {}
    of_magnitude, of_phase = (title.lower() for title in titles)
    if re.search(r"db(?![a-z])|decibel", of_magnitude) or np.nanmin(magnitude, initial=0.0) < 0:
        keys["magnitude_unit"] = "dB"
        if "db" not in of_magnitude:
            guesses.append("the magnitude is taken as dB, since some of it is negative")
    largest = float(np.nanmax(np.abs(phase), initial=0.0))
    if "rad" in of_phase:
        keys["phase_unit"] = "rad"
    elif "deg" in of_phase or "°" in of_phase or "grad" in of_phase:
        pass
    elif largest <= 2 * np.pi:
        keys["phase_unit"] = "rad"
        guesses.append(f"the phase is taken as rad, since it does not pass {largest:.3g}")
    elif largest < least_of_degrees:
        keys["phase_unit"] = UNKNOWN
        guesses.append(f"the phase reaches {largest:.3g}, which may be rad or degrees")
    else:
        guesses.append(f"the phase is taken as degrees, since it reaches {largest:.3g}")
    return keys
