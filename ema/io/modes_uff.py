"""Mode shapes of universal files: data sets 55 (data at nodes) and 2414 (analysis data), to SI.

Normal modes and complex modes are read, with their modal mass or modal A where it is stated. Frequency responses,
static and transient results in such data sets are no modes and are left out with a note.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ema.io.found_modes import FoundModes, are_percent, joined, without_unmeasured
from ema.io.uff import mass_unit
from ema.io.uff58 import BYTES, COMPLEX, DataSet, cut
from ema.types.errors import MeasurementError
from ema.types.frf import Geometry
from lamella_shared import Complexes, Integers

MODE_SETS = ("55", "2414")
_FUNCTIONS = ("58", "58b")
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[EeDd][+-]?\d+)?")
_HERTZ = re.compile(rf"({_NUMBER.pattern})\s*Hz", re.IGNORECASE)
_NORMAL, _COMPLEX_FIRST, _COMPLEX_SECOND = 2, 3, 7
_DISPLACEMENT = 8


@dataclass(frozen=True, eq=False, kw_only=True)
class _Header:
    """What the head of a data set says: its analysis, form of values, and what each analysis states of the mode."""

    analysis: int
    is_displacement: bool
    is_complex: bool
    n_value: int
    frequency: float
    modal_mass: float
    damping: float
    eigenvalue: complex
    modal_a: complex
    body: list[str]
    is_turned: bool = False


def holds(path: Path) -> tuple[bool, bool]:
    """Tell whether a universal file has data sets of shapes, and whether of functions, by their heads alone."""
    try:
        kinds = {data_set.kind for data_set in cut(path, heads=True)}
    except MeasurementError:  # there is no such file, or it is none
        return False, False
    return not kinds.isdisjoint(MODE_SETS), not kinds.isdisjoint(_FUNCTIONS)


def read_modes_uff(path: Path, geometry: Geometry) -> FoundModes:
    """Read the modes of a universal file.

    Parameters
    ----------
    path : Path
        The file; data set 164 in it gives the unit of modal masses, else they are in SI.
    geometry : Geometry
        The points, whose local axes are those that shapes are given in.

    Raises
    ------
    MeasurementError
        It cannot be read, or holds no mode; the message names file, data set and place.
    """
    sets = cut(path)
    notes: list[str] = []
    mass = mass_unit(sets)
    heads = [(s, _head_55(s) if s.kind == "55" else _head_2414(s)) for s in sets if s.kind in MODE_SETS]
    heads = _upper_half(_in_rad_s(path, _as_ratios(path, heads, notes), notes))
    modes = [mode for data_set, head in heads if (mode := _mode(data_set, head, geometry, mass, notes)) is not None]
    if not modes:
        held = ", ".join(sorted({s.kind for s in sets}))
        said = f" ({notes[0]})" if notes else ""
        raise MeasurementError(
            f"{path}: no mode shape (data sets 55 or 2414) in the file; it holds data sets {held}{said}"
        )
    whole = joined(modes)
    return without_unmeasured(replace(whole, source=str(path), notes=(*whole.notes, *dict.fromkeys(notes))))


_Heads = list[tuple[DataSet, _Header]]


def _as_ratios(path: Path, heads: _Heads, notes: list[str]) -> _Heads:
    """Return heads with damping ratios where a program wrote those of normal modes in per cent."""
    if not are_percent(head.damping for _, head in heads if head.analysis == _NORMAL and head.frequency > 0.0):
        return heads
    largest = max(head.damping for _, head in heads)
    notes.append(
        f"{path}: the damping, up to {largest:g}, is taken in per cent, for as a ratio it is that of no resonance"
    )
    return [(s, replace(head, damping=head.damping / 100.0)) for s, head in heads]


def _in_rad_s(path: Path, heads: _Heads, notes: list[str], *, same: float = 0.01) -> _Heads:
    """Return heads with eigenvalues in rad/s where the titles of all of them state these very numbers in Hz."""
    stated = []
    for data_set, head in heads:
        title = _HERTZ.search(" ".join(_lines(data_set)[:8]))
        if head.analysis in (_COMPLEX_FIRST, _COMPLEX_SECOND) and head.eigenvalue:
            stated.append(float(title[1].upper().replace("D", "E")) / abs(head.eigenvalue) if title else 0.0)
    if not stated or np.abs(np.array(stated) - 1.0).max() > same:
        return heads
    notes.append(f"{path}: the eigenvalues are taken in Hz, not rad/s, for the titles of their data sets say so")
    turn = 2.0 * np.pi
    return [(s, replace(head, eigenvalue=turn * head.eigenvalue)) for s, head in heads]


def _upper_half(heads: _Heads) -> _Heads:
    """Return heads with conjugate eigenvalues and modal A where all modes are those of negative frequencies."""
    eigen = [head.eigenvalue.imag for _, head in heads if head.analysis in (_COMPLEX_FIRST, _COMPLEX_SECOND)]
    if not eigen or max(eigen) >= 0.0:
        return heads
    return [
        (s, replace(head, eigenvalue=head.eigenvalue.conjugate(), modal_a=head.modal_a.conjugate(), is_turned=True))
        for s, head in heads
    ]


def _mode(data_set: DataSet, head: _Header, geometry: Geometry, mass: float, notes: list[str]) -> FoundModes | None:
    """Return the mode of a data set; None where it is none."""
    analyses = {0: "unknown", 1: "static", 4: "transient", 5: "frequency response", 6: "buckling"}
    if head.analysis not in (_NORMAL, _COMPLEX_FIRST, _COMPLEX_SECOND):
        what = analyses.get(head.analysis, f"analysis type {head.analysis}")
        notes.append(f"{data_set.where}: holds no mode ({what}); left out")
        return None
    if head.n_value not in (3, 6):
        raise MeasurementError(
            f"{data_set.where}: {head.n_value} values per node; a shape has 3 (translations) or 6 (and rotations)"
        )
    if head.analysis == _NORMAL:
        frequency, damping = head.frequency, head.damping
    else:
        frequency = abs(head.eigenvalue) / (2.0 * np.pi)
        damping = -head.eigenvalue.real / abs(head.eigenvalue) if frequency > 0.0 else 0.0
    if head.analysis != _NORMAL and head.eigenvalue.imag < 0.0:
        return None  # the conjugate partner of a mode
    if not (0.0 < frequency < np.inf and 0.0 <= damping < 1.0):
        notes.append(
            f"{data_set.where}: frequency {frequency:g} Hz and damping ratio {damping:g} are no vibration (a rigid "
            "body or a pole that grows); left out"
        )
        return None
    node, value = _values(data_set, head)
    value = value.conj() if head.is_turned else value
    shape, scaled = _mass_normalised(head, value[:, :3].reshape(-1), frequency, damping, mass)
    return FoundModes(
        source=data_set.where,
        frequency=np.array([frequency]),
        damping=np.array([damping if damping > 0.0 else np.nan]),
        shape=shape[:, None],
        scaled=np.array([scaled]),
        node=np.repeat(node, 3),
        direction=np.array([geometry.direction(int(n), code) for n in node for code in (1, 2, 3)]),
    )


def _mass_normalised(
    head: _Header, shape: Complexes, frequency: float, damping: float, mass: float
) -> tuple[Complexes, bool]:
    """Return a shape of unit modal mass where the file states its scale, and whether it does.

    The modal A of a shape of unit modal mass is 2 i omega_d, as `write_uff` writes it.
    """
    if not head.is_displacement:
        return shape, False
    if head.analysis == _NORMAL and 0.0 < head.modal_mass < np.inf:
        return shape / np.sqrt(head.modal_mass * mass), True
    if head.analysis == _COMPLEX_FIRST and head.modal_a != 0.0:
        omega = 2.0 * np.pi * frequency * np.sqrt(1.0 - damping**2)
        return shape * np.sqrt(2j * omega / (head.modal_a * mass)), True
    return shape, False


def _head_55(data_set: DataSet) -> _Header:
    """Read the head of a data set 55: five lines of text, the form, and the parameters of the analysis."""
    lines = _lines(data_set)
    _, analysis, _, specific, form, n_value = _integers(data_set, lines, 5, 6)
    at = 6
    counts = _integers(data_set, lines, at, 2)
    n_integer, n_real = counts[0], counts[1]
    if not (0 <= n_integer <= 20 and 0 <= n_real <= 100):
        raise MeasurementError(f"{data_set.where}: line 7 of the set announces {n_integer} integers and {n_real} reals")
    at += -(-(2 + n_integer) // 8)
    rows = -(-n_real // 6)
    reals = [number for row in range(at, at + rows) for number in _reals(data_set, lines, row)]
    reals += [0.0] * max(0, 6 - len(reals))
    normal = analysis == _NORMAL
    return _Header(
        analysis=analysis,
        is_displacement=specific == _DISPLACEMENT,
        is_complex=_is_complex(data_set, form),
        n_value=n_value,
        frequency=reals[0],
        modal_mass=reals[1] if normal else 0.0,
        damping=_damping(reals[2], reals[3]) if normal else 0.0,
        eigenvalue=0j if normal else complex(reals[0], reals[1]),
        modal_a=0j if normal else complex(reals[2], reals[3]),
        body=lines[at + rows :],
    )


def _head_2414(data_set: DataSet) -> _Header:
    """Read the head of a data set 2414, which has the parameters of every analysis."""
    lines = _lines(data_set)
    place = _integers(data_set, lines, 2, 1)[0]
    _, analysis, _, result, form, n_value = _integers(data_set, lines, 8, 6)
    modes = (_NORMAL, _COMPLEX_FIRST, _COMPLEX_SECOND)
    if analysis in modes and place != 1:
        raise MeasurementError(
            f"{data_set.where}: holds data on elements (location {place}); mode shapes are data at nodes, 1"
        )
    numbers = (*_reals(data_set, lines, 11), *[0.0] * 6)
    eigen = (*_reals(data_set, lines, 12), *[0.0] * 6)
    return _Header(
        analysis=analysis,
        is_displacement=result == _DISPLACEMENT,
        is_complex=_is_complex(data_set, form) if analysis in modes else False,
        n_value=n_value,
        frequency=numbers[1],
        modal_mass=numbers[3],
        damping=_damping(numbers[4], numbers[5]),
        eigenvalue=complex(eigen[0], eigen[1]),
        modal_a=complex(eigen[2], eigen[3]),
        body=lines[13:],
    )


def _damping(viscous: float, hysteretic: float) -> float:
    """Return the damping ratio; a loss factor is twice that at resonance."""
    return viscous if viscous != 0.0 else 0.5 * hysteretic


def _is_complex(data_set: DataSet, form: int) -> bool:
    if form not in BYTES:
        raise MeasurementError(f"{data_set.where}: data type {form} is not one of 2 and 4 (real), 5 and 6 (complex)")
    return form in COMPLEX


def _values(data_set: DataSet, head: _Header, *, largest_node: int = 2**31 - 1) -> tuple[Integers, Complexes]:
    """Return the nodes of a data set and the values at each, (n_node,) and (n_node, n_value)."""
    n_number = head.n_value * (2 if head.is_complex else 1)
    nodes: list[int] = []
    values: list[list[float]] = []
    for text, numbers in _records(data_set, head.body, n_number):
        if len(numbers) < n_number or not np.isfinite(numbers).all():
            raise MeasurementError(
                f"{data_set.where}: point {text} has {len(numbers)} finite values, expected {n_number}; the set is cut "
                "off or was written with another number of values per node"
            )
        if not (re.fullmatch(r"\d+", text) and int(text) <= largest_node):
            raise MeasurementError(f"{data_set.where}: expected a point number, found {text!r}")
        nodes.append(int(text))
        values.append(numbers)
    if not nodes:
        raise MeasurementError(f"{data_set.where}: no values at points below its head")
    table = np.array(values, dtype=float)
    return np.array(nodes, dtype=np.int64), (
        table[:, 0::2] + 1j * table[:, 1::2] if head.is_complex else table.astype(complex)
    )


def _records(data_set: DataSet, lines: list[str], n_number: int) -> Iterator[tuple[str, list[float]]]:
    """Yield the line of each point with the numbers below it."""
    at = 0
    while at < len(lines):
        text = lines[at].strip()
        at += 1
        if not text:
            continue
        numbers: list[float] = []
        while len(numbers) < n_number and at < len(lines):
            numbers += _numbers(data_set, lines[at])
            at += 1
        yield (text.split() or [""])[0], numbers[:n_number]


def _lines(data_set: DataSet) -> list[str]:
    return data_set.body.replace(b"\r", b"").decode("latin-1").splitlines()


def _numbers(data_set: DataSet, line: str) -> list[float]:
    """Return the numbers of a line, which may touch each other: a sign begins a new one."""
    numbers = _NUMBER.findall(line)
    if _NUMBER.sub("", line).strip():
        raise MeasurementError(f"{data_set.where}: expected numbers, found {line.strip()[:60]!r}")
    return [float(re.sub("[Dd]", "e", word)) for word in numbers]


def _reals(data_set: DataSet, lines: list[str], row: int) -> list[float]:
    _require_row(data_set, lines, row)
    return _numbers(data_set, lines[row])


def _integers(data_set: DataSet, lines: list[str], row: int, least: int) -> list[int]:
    """Return the integers of a line, of which there must be `least`; further ones follow in the next."""
    _require_row(data_set, lines, row)
    words = lines[row].split()
    if len(words) < least or not all(re.fullmatch(r"-?\d{1,10}", word) for word in words[:least]):
        raise MeasurementError(
            f"{data_set.where}: line {row + 1} of the set should be {least} whole numbers, found "
            f"{lines[row].strip()[:60]!r}"
        )
    return [int(word) for word in words[:least]]


def _require_row(data_set: DataSet, lines: list[str], row: int) -> None:
    if row >= len(lines):
        raise MeasurementError(f"{data_set.where}: ends after line {len(lines)}, within its head")
