"""The form of a campaign file: its keys, the files that it names, and which of its states are compared with which."""

from __future__ import annotations

import datetime
import difflib
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Literal, Protocol

import numpy as np
from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from ema.campaign.estimate import Averaging
from ema.io.files import Section, natural
from ema.io.measured_function import parse_unit
from ema.io.table import TableLayout
from ema.io.variables import VariableLayout
from ema.types.errors import CampaignError, MeasurementError
from ema.types.frf import Dof
from lamella_shared import did_you_mean


class State(Protocol):
    """What may name a reference: a configuration or a specimen."""

    @property
    def name(self) -> str:
        """Unique among those that may be named."""

    @property
    def compare_to(self) -> tuple[str, ...]:
        """Names of the reference and its repeats; empty where the state has none."""

    @property
    def repeat_of(self) -> str | None:
        """Name of the state that this one measures again."""


def reference_faults(states: Sequence[State]) -> Iterator[str]:
    """Say what is wrong with the references and repeats of states, as "'NAME': key: what is wrong".

    A name may be unknown, or that of the state itself or of its repeat, and references may go round.
    """
    by_name = {state.name: state for state in states}
    for state in states:
        named = [("compare_to", name) for name in state.compare_to]
        named += [] if state.repeat_of is None else [("repeat_of", state.repeat_of)]
        for key, name in named:
            if name == state.name:
                yield f"{state.name!r}: {key}: names itself; name another state"
            elif name not in by_name:
                yield f"{state.name!r}: {key}: no {name!r}; {did_you_mean(name, list(by_name))}"
            elif key == "compare_to" and by_name[name].repeat_of == state.name:
                yield f"{state.name!r}: compare_to: {name!r} is a repeat of it, not a reference"
            elif key == "repeat_of":
                yield from _faults_of_repeat(state, by_name[name])
        if len(set(state.compare_to)) < len(state.compare_to):
            yield f"{state.name!r}: compare_to: names one state twice: {', '.join(state.compare_to)}"
    way = _circle(by_name)
    if len(way) > 2:  # one that names itself is said above
        yield f"{way[0]!r}: compare_to: goes round: {' -> '.join(way)}; one of them needs no reference"


def _faults_of_repeat(state: State, first: State) -> Iterator[str]:
    """Check a repeat, which has its reference from the state that it repeats."""
    if state.compare_to:
        yield f"{state.name!r}: a repeat has the reference of what it repeats: move compare_to to {first.name!r}"
    if first.repeat_of is not None:
        yield f"{state.name!r}: repeat_of: {first.name!r} is a repeat itself; name what it repeats: {first.repeat_of!r}"


def repeats_of(states: Sequence[State], names: Sequence[str]) -> tuple[str, ...]:
    """Return names followed by those of the states that repeat one of them, each once."""
    again = (state.name for state in states if state.repeat_of in names)
    return tuple(dict.fromkeys((*names, *again)))


def _circle(by_name: Mapping[str, State]) -> list[str]:
    """Return the names of a circle of references, none where there is none."""
    done: set[str] = set()

    def follow(name: str, way: list[str]) -> list[str]:
        if name in way:
            return [*way[way.index(name) :], name]
        if name in done:
            return []
        done.add(name)
        ways = (follow(other, [*way, name]) for other in by_name[name].compare_to if other in by_name)
        return next((circle for circle in ways if circle), [])

    return next((circle for circle in (follow(name, []) for name in by_name) if circle), [])


Format = Literal["uff", "csv", "mat", "hdf5", "numpy", "tdms", "wav"]
Names = tuple[str, ...] | tuple[tuple[str, ...], ...]
"""Names of files, or lists of names of which each gives files that belong side by side."""
SUFFIXES: dict[str, Format] = {
    **dict.fromkeys((".uff", ".unv", ".uf", ".uf3", ".ufb", ".bunv", ".uff58", ".univ"), "uff"),
    ".mat": "mat",
    **dict.fromkeys((".h5", ".hdf5", ".hdf", ".he5"), "hdf5"),
    **dict.fromkeys((".npy", ".npz"), "numpy"),
    ".tdms": "tdms",
    ".wav": "wav",
}  # fmt: skip
"""Formats by suffix; whatever has another one is text."""

_UNIVERSAL = re.compile(rb"(?:\xef\xbb\xbf)?\s*-1 *\r?\n(?: *-1 *\r?\n)* {0,6}\d{2,4}[bB]?\b")
"""How a universal file begins: a delimiter and the number of a data set."""
_HDF5 = b"\x89HDF\r\n\x1a\n"
"""How an HDF5 file begins, which netCDF and others call otherwise."""

NOT_READ = {
    ".frf": "a format of one program: export its FRFs as a universal file (58)",
    ".lms": "a format of one program: export its FRFs as a universal file (58)",
    ".pkl": "a Python object: write its arrays with numpy.savez",
    ".p": "a Python object: write its arrays with numpy.savez",
    ".xlsx": "a workbook: save its sheet as CSV",
    ".xls": "a workbook: save its sheet as CSV",
    ".zip": "an archive: unpack it",
}
"""What to do with files of measurements that are not read, by suffix."""


def format_of(file: Path, stated: Format | None = None) -> Format:
    """Return the format of a file: the stated one, else that of its suffix, else a universal or HDF5 file or text."""
    beginning = 400  # bytes of a file that are looked at
    known = stated or SUFFIXES.get(file.suffix.lower())
    if known is not None:
        return known
    try:
        with file.open("rb") as begin:
            head = begin.read(beginning)
        return "hdf5" if head.startswith(_HDF5) else "uff" if _UNIVERSAL.match(head) else "csv"
    except (OSError, ValueError):
        return "csv"  # reading it says what is wrong


def named_files(path: Path, folder: Path, key: str, patterns: tuple[str, ...], *, shown: int = 60) -> tuple[Path, ...]:
    """Return the files of all patterns, those of one pattern in the natural order of their names.

    Parameters
    ----------
    path, folder : Path
        The campaign file, for messages, and the folder that names are relative to.
    key : str
        Key that names the files, for messages.
    patterns : tuple of str
        Names, which may hold wildcards.
    shown : int
        Characters of a name that is none.

    Raises
    ------
    CampaignError
        A pattern has no file; the message names those with similar names. Or it is no name that a file can have.
    """
    files: list[Path] = []
    for pattern in patterns:
        try:
            files += _named(path, folder, key, pattern)
        except OSError as error:  # such as a name that is too long
            raise CampaignError(f"{path}: {key}: {pattern[:shown]!r} names no file: {error.strerror}") from error
    return tuple(dict.fromkeys(files))


def files_beside(path: Path, folder: Path, key: str, patterns: tuple[str, ...]) -> list[Path]:
    """Return files of several patterns that hold channels of the same records: the first of each, the second of each.

    Raises
    ------
    CampaignError
        As `named_files`, or the patterns do not have as many files each, or one of them twice.
    """
    columns = [named_files(path, folder, key, (pattern,)) for pattern in patterns]
    counts = [len(column) for column in columns]
    if len(set(counts)) > 1 or len({f for column in columns for f in column}) < sum(counts):
        names = "; ".join(
            f"{pattern!r} is {', '.join(f.name for f in column[:3])}{', ...' if len(column) > 3 else ''} "
            f"({len(column)} files)"
            for pattern, column in zip(patterns, columns, strict=True)
        )
        raise CampaignError(
            f"{path}: {key}: of files side by side, in inner brackets, each name has as many, none twice: {names}"
        )
    return [file for row in zip(*columns, strict=True) for file in row]


def _named(path: Path, folder: Path, key: str, pattern: str) -> list[Path]:
    """Return the files of one pattern."""
    if re.search(r"[*?\[]", pattern):
        anchor = Path(pattern).anchor
        files = list(Path(anchor).glob(pattern[len(anchor) :]) if anchor else folder.glob(pattern))
    else:
        files = [folder / pattern]
    files = sorted((f for f in files if f.is_file()), key=natural)
    if not files:
        there = [f.name for f in (folder / pattern).parent.glob("*")]
        if (folder / pattern).exists() and not (folder / pattern).is_dir():
            raise CampaignError(f"{path}: {key}: {pattern!r} is a pipe or a device; name plain files")
        close = difflib.get_close_matches(Path(pattern).name, there, n=2)
        hint = f"; did you mean {' or '.join(close)}?" if close else ""
        raise CampaignError(f"{path}: {key}: no file {pattern!r} in {folder}{hint}")
    return files


def _dof(given: object) -> Dof:
    """Return the DOF written as '12+z' or, where it is off the axes, as a table with a direction."""
    if isinstance(given, str) and (written := re.fullmatch(r"(\d+)([+-])([xyzXYZ])", given)) is not None:
        node, sign, axis = written.groups()
        x, y, z = (-1.0 if sign == "-" else 1.0) * np.eye(3)["xyz".index(axis.lower())]
        return _possible(Dof(int(node), (float(x), float(y), float(z))))
    if isinstance(given, dict) and set(given) == {"node", "direction"} and type(given["node"]) is int:
        direction = given["direction"]
        numbers = isinstance(direction, list) and all(type(part) in (int, float) for part in direction)
        if numbers and len(direction) == 3 and 0 < (length := math.hypot(*direction)) < math.inf:
            x, y, z = (part / length for part in direction)
            return _possible(Dof(given["node"], (x, y, z)))
    raise ValueError(
        f"{given!r} is not a DOF: write a point number with a signed direction, such as '12+z', "
        "or {node = 12, direction = [0, 0.6, 0.8]}"
    )


def _possible(
    dof: Dof,
    *,
    # Point number, as in universal files.
    largest: int = 2**31 - 1,
) -> Dof:
    if not 0 <= dof.node <= largest:
        raise ValueError(f"{dof.node} is not a point number, which is 0 to {largest}")
    return dof


def _date(given: object) -> object:
    """Return a date, which TOML has without quotes, as text."""
    return given.isoformat() if isinstance(given, datetime.date) else given


def _several(given: object) -> object:
    """Return a list; what is written without brackets is a list of one."""
    return tuple(given) if isinstance(given, list) else (given,)


def _several_records(given: object) -> object:
    """Return a list of names, or of lists of as many names of files that belong side by side."""
    several = _several(given)
    assert isinstance(several, tuple)
    inner = [entry for entry in several if isinstance(entry, list)]
    if inner and (len(inner) < len(several) or len({len(entry) for entry in inner}) > 1):
        raise ValueError(
            "names are either all text, or all lists of files side by side, each of as many, such as "
            '[["force_*.csv", "response_*.csv"]]'
        )
    return tuple(tuple(entry) if isinstance(entry, list) else entry for entry in several)


def _checked_unit(text: str) -> str:
    try:
        parse_unit(text)
    except MeasurementError as error:
        raise ValueError(str(error)) from error
    return text


DofEntry = Annotated[Dof, BeforeValidator(_dof)]
DofEntries = Annotated[tuple[DofEntry, ...], BeforeValidator(_several)]
FileNames = Annotated[tuple[str, ...], BeforeValidator(_several)]
RecordNames = Annotated[
    tuple[str, ...] | tuple[Annotated[tuple[str, ...], Field(min_length=1)], ...], BeforeValidator(_several_records)
]


def _not_empty(name: str) -> str:
    if not name.strip():
        raise ValueError("a configuration needs a name, which is empty")
    return name


def _factor(scale: float) -> float:
    if not math.isfinite(scale) or scale == 0.0:
        raise ValueError(f"multiplies the function, so it is not {scale:g}; leave a function out with exclude = true")
    return scale


FullScale = Annotated[float, Field(gt=0, allow_inf_nan=False)]
UnitText = Annotated[str, AfterValidator(_checked_unit)]


class TitleSection(Section):
    """What a campaign is called, and what stands in the title block of its report."""

    name: str
    project: str = ""
    author: str = ""
    date: Annotated[str, BeforeValidator(_date)] = ""


class StructureSection(Section):
    """The model's stack."""

    stack: str | None = None


class PointsSection(Section):
    """Where the points are listed; shapes are drawn and compared with a model by their coordinates alone."""

    file: str | None = None
    unit: UnitText | None = None
    lines: tuple[tuple[int, ...], ...] = ()
    without_coordinates: tuple[int, ...] = ()

    @model_validator(mode="after")
    def _of_a_file(self) -> PointsSection:
        if self.file is None and (self.unit is not None or self.lines):
            raise ValueError("'unit' and 'lines' are of the points that 'file' lists: name it, or leave them out")
        return self


class MeasurementSection(Section):
    """How the files hold what was measured."""

    format: Format | None = None
    unit: UnitText | None = None
    table: TableLayout | None = None
    variables: VariableLayout | None = None
    time: Averaging | None = None
    full_scale: Annotated[tuple[FullScale, ...], BeforeValidator(_several)] = ()
    exponential_window_s: float = Field(default=math.inf, gt=0.0)
    sensor_mass_g: float = Field(default=0.0, ge=0.0, allow_inf_nan=False)

    @model_validator(mode="after")
    def _is_frf_unit(self) -> MeasurementSection:
        if self.unit is not None and parse_unit(self.unit).frf is None:
            raise ValueError(
                f"unit {self.unit!r} is not a response over a force, such as 'm/s2/N', 'mm/s/N', 'g/lbf'; volts are "
                "divided by the sensor's sensitivity: 'V/N/(100 mV/g)'"
            )
        if self.time is not None and "exponential_window_s" in self.model_fields_set:
            raise ValueError("[measurement.time] has 'response_end' for its window: leave 'exponential_window_s' out")
        if self.time is not None and self.unit is not None:
            raise ValueError("[measurement.time] takes 'force_unit' and 'response_unit' in place of 'unit'")
        if self.table is not None and (self.table.layout == "time") != (self.time is not None):
            raise ValueError("layout = 'time' and [measurement.time] belong together")
        if self.variables is not None and self.variables.history is None and self.time is not None:
            raise ValueError(
                "[measurement.time] is of time histories, and [measurement.variables] without 'history' is of files of "
                "FRFs"
            )
        if self.variables is not None and self.variables.history is not None and self.time is None:
            raise ValueError("'history' in [measurement.variables] needs [measurement.time] with how it is averaged")
        return self


class RunSection(Section):
    """The files of one roving run."""

    files: RecordNames = Field(min_length=1)
    output: DofEntries = ()
    input: DofEntries = ()


class ForceLevelSection(Section):
    """The files of a configuration at another force, to be compared with those that are identified."""

    force_N: float = Field(gt=0, allow_inf_nan=False)
    files: RecordNames = Field(min_length=1)
    output: DofEntries = ()
    input: DofEntries = ()


class ModesSection(Section):
    """How sure modes are that another program identified, where their files do not say it; relative."""

    frequency_std: float | None = Field(default=None, gt=0, lt=1)
    damping_std: float | None = Field(default=None, gt=0)
    shape_std: float | None = Field(default=None, gt=0, lt=1)


class StateSection(Section):
    """One state of a structure and the files of its functions."""

    name: Annotated[str, AfterValidator(_not_empty)]
    torque_Nm: float | None = Field(default=None, ge=0, allow_inf_nan=False)
    pressure_kPa: float | None = Field(default=None, gt=0, allow_inf_nan=False)
    files: RecordNames = ()
    output: DofEntries = ()
    input: DofEntries = ()
    run: tuple[RunSection, ...] = ()


class ConfigurationSection(StateSection):
    """One configuration of a campaign."""

    compare_to: FileNames = ()
    repeat_of: str | None = None
    modes: Literal["file"] | None = None
    stack: str | int | None = None
    height_mm: float | None = Field(default=None, gt=0, allow_inf_nan=False)
    force_N: float | None = Field(default=None, gt=0, allow_inf_nan=False)
    force_level: tuple[ForceLevelSection, ...] = ()

    @model_validator(mode="after")
    def _one_way_to_name_files(self) -> ConfigurationSection:
        if bool(self.files) == bool(self.run):
            raise ValueError("give either 'files' or [[configuration.run]] tables")
        if self.run and (self.output or self.input):
            raise ValueError("'output' and 'input' belong into each [[configuration.run]] table")
        if self.modes is not None and (self.run or self.force_level or self.output or len(self.input) > 1):
            raise ValueError(
                "modes = \"file\" takes 'files' and one 'input', the DOF of the force; 'output', run and "
                "force_level are of functions"
            )
        return self

    @model_validator(mode="after")
    def _different_forces(self) -> ConfigurationSection:
        forces = [self.force_N, *(level.force_N for level in self.force_level)]
        if len(set(forces)) < len(forces):
            raise ValueError(f"force_level: the forces of one configuration must differ, found {forces} N")
        return self


class CorrectionSection(Section):
    """A correction of single functions."""

    files: FileNames = ("**/*",)
    function: int | None = Field(default=None, ge=1)
    output: DofEntry | None = None
    scale: Annotated[float, AfterValidator(_factor)] = 1.0
    conjugate: bool = False
    new_output: DofEntry | None = None
    new_input: DofEntry | None = None
    exclude: bool = False
    reason: str


class IdentificationSection(Section):
    """What is asked of the identification."""

    band_Hz: tuple[float, float] | None = None
    order: int | None = Field(default=None, ge=2)

    @model_validator(mode="after")
    def _ascending(self) -> IdentificationSection:
        highest = 1e9  # Hz
        if self.band_Hz is not None and not 0 <= self.band_Hz[0] < self.band_Hz[1] <= highest:
            raise ValueError(
                f"band_Hz must be [lower, upper] with 0 <= lower < upper <= {highest:g}, found {list(self.band_Hz)}"
            )
        return self


class Reassembly(Section):
    """Standard deviations between two assemblies of one and the same structure.

    Those that stand here hold where the campaign states none. Bolted structures change by 0.1 to 0.5 % of a frequency
    and by 5 to 30 % of a damping ratio; a cantilever plate that was clamped anew moved by up to 0.4 %. Sensors that are
    put back are off by about 1 % in gain and 1 to 2 mm in place, which is 2 % of a shape's length.

    Attributes
    ----------
    frequency, damping : float
        Relative ones of natural frequencies and of damping ratios.
    shape : float
        Of a shape, over its length.
    """

    frequency: float = Field(default=3e-3, gt=0, lt=1)
    damping: float = Field(default=0.2, gt=0, lt=3)
    shape: float = Field(default=2e-2, gt=0, lt=1)


class CommonSections(Section):
    """What campaigns of configurations and campaigns of specimens state alike."""

    campaign: TitleSection
    measurement: MeasurementSection = MeasurementSection()
    correction: tuple[CorrectionSection, ...] = ()
    identification: IdentificationSection = IdentificationSection()
    reassembly: Reassembly = Reassembly()


class CampaignFile(CommonSections):
    """The whole file."""

    structure: StructureSection = StructureSection()
    points: PointsSection = PointsSection()
    configuration: tuple[ConfigurationSection, ...] = Field(min_length=1)
    modes: ModesSection = ModesSection()
