"""The form of a campaign file: its keys and what they may hold."""

from __future__ import annotations

import datetime
import math
import re
from typing import Annotated, Literal

import numpy as np
from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from ema.campaign.estimate import Averaging
from ema.campaign.named_files import Format
from ema.campaign.references import DAMPING_SCATTER, FREQUENCY_SCATTER, SHAPE_SCATTER
from ema.io.form import Section
from ema.io.table import TableLayout
from ema.io.units import parse_unit
from ema.io.variables import VariableLayout
from ema.types.errors import MeasurementError
from ema.types.geometry import Dof

_LARGEST = 2**31 - 1  # point number, as in universal files
_HIGHEST = 1e9  # Hz


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
    message = (
        f"{given!r} is not a DOF: write a point number with a signed direction, such as '12+z', "
        "or {node = 12, direction = [0, 0.6, 0.8]}"
    )
    raise ValueError(message)


def _possible(dof: Dof) -> Dof:
    if not 0 <= dof.node <= _LARGEST:
        message = f"{dof.node} is not a point number, which is 0 to {_LARGEST}"
        raise ValueError(message)
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
        message = (
            "names are either all text, or all lists of files side by side, each of as many, such as "
            '[["force_*.csv", "response_*.csv"]]'
        )
        raise ValueError(message)
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
    tuple[str, ...] | tuple[Annotated[tuple[str, ...], Field(min_length=1)], ...],
    BeforeValidator(_several_records),
]
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
            message = "'unit' and 'lines' are of the points that 'file' lists: name it, or leave them out"
            raise ValueError(message)
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
            message = (
                f"unit {self.unit!r} is not a response over a force, such as 'm/s2/N', 'mm/s/N', 'g/lbf'; volts are "
                "divided by the sensor's sensitivity: 'V/N/(100 mV/g)'"
            )
            raise ValueError(message)
        if self.time is not None and "exponential_window_s" in self.model_fields_set:
            message = "[measurement.time] has 'response_end' for its window: leave 'exponential_window_s' out"
            raise ValueError(message)
        if self.time is not None and self.unit is not None:
            message = "[measurement.time] takes 'force_unit' and 'response_unit' in place of 'unit'"
            raise ValueError(message)
        if self.table is not None and (self.table.layout == "time") != (self.time is not None):
            message = "layout = 'time' and [measurement.time] belong together"
            raise ValueError(message)
        if self.variables is not None and self.variables.history is None and self.time is not None:
            message = (
                "[measurement.time] is of time histories, and [measurement.variables] without 'history' is of files of "
                "FRFs"
            )
            raise ValueError(message)
        if self.variables is not None and self.variables.history is not None and self.time is None:
            message = "'history' in [measurement.variables] needs [measurement.time] with how it is averaged"
            raise ValueError(message)
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


class ConfigurationSection(Section):
    """One state of the structure and its files."""

    name: str
    compare_to: FileNames = ()
    repeat_of: str | None = None
    modes: Literal["file"] | None = None
    stack: str | int | None = None
    torque_Nm: float | None = Field(default=None, ge=0, allow_inf_nan=False)
    pressure_kPa: float | None = Field(default=None, gt=0, allow_inf_nan=False)
    height_mm: float | None = Field(default=None, gt=0, allow_inf_nan=False)
    force_N: float | None = Field(default=None, gt=0, allow_inf_nan=False)
    files: RecordNames = ()
    output: DofEntries = ()
    input: DofEntries = ()
    run: tuple[RunSection, ...] = ()
    force_level: tuple[ForceLevelSection, ...] = ()

    @model_validator(mode="after")
    def _one_way_to_name_files(self) -> ConfigurationSection:
        if bool(self.files) == bool(self.run):
            message = "give either 'files' (each file is one run) or [[configuration.run]] tables"
            raise ValueError(message)
        if self.run and (self.output or self.input):
            message = "'output' and 'input' belong into each [[configuration.run]] table"
            raise ValueError(message)
        if self.modes is not None and (self.run or self.force_level or self.output or len(self.input) > 1):
            message = (
                "modes = \"file\" takes 'files' and one 'input', the DOF of the force; 'output', run and "
                "force_level are of functions"
            )
            raise ValueError(message)
        return self

    @model_validator(mode="after")
    def _different_forces(self) -> ConfigurationSection:
        forces = [self.force_N, *(level.force_N for level in self.force_level)]
        if len(set(forces)) < len(forces):
            message = f"force_level: the forces of one configuration must differ, found {forces} N"
            raise ValueError(message)
        return self


class CorrectionSection(Section):
    """A correction of single functions."""

    files: FileNames = ("**/*",)
    function: int | None = Field(default=None, ge=1)
    output: DofEntry | None = None
    scale: float = 1.0
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
        if self.band_Hz is not None and not 0 <= self.band_Hz[0] < self.band_Hz[1] <= _HIGHEST:
            message = (
                f"band_Hz must be [lower, upper] with 0 <= lower < upper <= {_HIGHEST:g}, found "
                f"{list(self.band_Hz)}"
            )
            raise ValueError(message)
        return self


class ReassemblySection(Section):
    """How far a state scatters that is assembled anew: standard deviations relative to the value."""

    frequency: float = Field(default=FREQUENCY_SCATTER, gt=0, lt=1)
    damping: float = Field(default=DAMPING_SCATTER, gt=0, lt=3)
    shape: float = Field(default=SHAPE_SCATTER, gt=0, lt=1)


class CampaignFile(Section):
    """The whole file."""

    campaign: TitleSection
    structure: StructureSection = StructureSection()
    points: PointsSection = PointsSection()
    measurement: MeasurementSection = MeasurementSection()
    configuration: tuple[ConfigurationSection, ...] = Field(min_length=1)
    modes: ModesSection = ModesSection()
    correction: tuple[CorrectionSection, ...] = ()
    identification: IdentificationSection = IdentificationSection()
    reassembly: ReassemblySection = ReassemblySection()
