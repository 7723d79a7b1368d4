"""The campaign file: what was measured, where, in which configurations, and how its files are laid out."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from ema.campaign.campaign_file import (
    CampaignFile,
    ConfigurationSection,
    CorrectionSection,
    Format,
    MeasurementSection,
    Names,
    PointsSection,
    Reassembly,
    files_beside,
    format_of,
    named_files,
    reference_faults,
)
from ema.campaign.estimate import Averaging
from ema.io.found_modes import ModesStd
from ema.io.measured_function import Unit, parse_unit
from ema.io.sdynpy import holds_data_arrays
from ema.io.table import TableLayout, read_points
from ema.io.uff import FileUnits, read_uff_geometry, read_uff_units
from ema.io.variables import VariableLayout
from ema.types.errors import CampaignError
from ema.types.frf import Dof, Geometry
from lamella_shared import Complexes, did_you_mean, read_form


@dataclass(frozen=True, kw_only=True)
class Files:
    """Measurement files with the DOFs of their functions where the files do not tell.

    Attributes
    ----------
    files : tuple of Path
        In reading order.
    together : bool
        Whether all of them are one roving run; else each file is a run of its own.
    output, input : tuple of Dof
        DOFs of their FRFs in reading order; one entry holds for all of them, none leaves them to the file.
    beside : int
        How many that follow each other hold channels of the same records, such as the force and a response.
    """

    files: tuple[Path, ...]
    together: bool
    output: tuple[Dof, ...]
    input: tuple[Dof, ...]
    beside: int = 1

    @property
    def sets(self) -> tuple[tuple[Path, ...], ...]:
        """The files of each record."""
        return tuple(self.files[k : k + self.beside] for k in range(0, len(self.files), self.beside))


@dataclass(frozen=True, kw_only=True)
class Correction:
    """A correction of single functions: which ones, what is changed, and why.

    Attributes
    ----------
    files : tuple of Path
        Files it holds for.
    function : int or None
        Position of the FRF in its file, from 1; None for all.
    output : Dof or None
        Response DOF that it holds for; None for all.
    scale : float
        Factor on the function; -1 turns the sign.
    conjugate : bool
        The function is the complex conjugate of an FRF: turn the sign of its imaginary part.
    new_output, new_input : Dof or None
        DOF to use in place of the stated one.
    exclude : bool
        Leave the function out.
    reason : str
        Why, for the notes of the measurement.
    """

    files: tuple[Path, ...]
    function: int | None
    output: Dof | None
    scale: float
    conjugate: bool
    new_output: Dof | None
    new_input: Dof | None
    exclude: bool
    reason: str

    def changed(self, value: Complexes) -> Complexes:
        """Return the values of a function, (n_frequency,), as they are corrected."""
        return self.scale * (value.conj() if self.conjugate else value)


@dataclass(frozen=True, kw_only=True)
class Configuration:
    """One state of the structure that was measured.

    Attributes
    ----------
    name : str
        Unique in its campaign.
    stack : str or None
        Which stack, by its name or number.
    torque, pressure, height : float or None
        Bolt torque (N m), mean surface pressure (Pa) and stack height (m); None where not stated.
    files : tuple of Files
        What was measured.
    force : float or None
        Level of the force, N; None where not stated.
    force_levels : tuple of Configuration
        The same state at other forces, to see whether the structure is linear; not identified.
    compare_to : tuple of str
        Names of the reference that the state is compared with, and of repeats of it; empty where it has none.
    repeat_of : str or None
        Name of the configuration that this one measures again.
    has_modes : bool
        Whether its files hold modes that another program identified, in place of functions.
    """

    name: str
    stack: str | None
    torque: float | None
    pressure: float | None
    height: float | None
    files: tuple[Files, ...]
    force: float | None = None
    force_levels: tuple[Configuration, ...] = ()
    compare_to: tuple[str, ...] = ()
    repeat_of: str | None = None
    has_modes: bool = False


@dataclass(frozen=True, kw_only=True)
class IdentificationOptions:
    """What the campaign file asks of the identification; None leaves the choice to it.

    Attributes
    ----------
    band : (float, float) or None
        Frequency band, Hz.
    order : int or None
        Highest model order.
    """

    band: tuple[float, float] | None
    order: int | None


@dataclass(frozen=True, eq=False, kw_only=True)
class Campaign:
    """A measurement campaign as its file describes it; the FRFs themselves are not loaded.

    Attributes
    ----------
    name : str
        Title.
    path, folder : Path
        The campaign file, and the folder that its file names are relative to.
    stack : Path or None
        Stack file of the model, if named.
    points : Path or None
        File of the points, if named.
    geometry : Geometry
        The measured points; none where no file is named.
    without_coordinates : tuple of int
        Points that are measured although the geometry does not hold them; any other such point is refused.
    configurations : tuple of Configuration
        In the order of the file.
    identification : IdentificationOptions
        Band and order.
    format : {"uff", "csv", "mat", "hdf5", "numpy", "tdms", "wav"} or None
        Format of the FRF files; None decides by the suffix.
    unit : Unit or None
        Unit of the FRFs, which overrides what the files say.
    table : TableLayout or None
        Column layout of text files.
    variables : VariableLayout or None
        What the variables of MATLAB and HDF5 files hold.
    averaging : Averaging or None
        How FRFs are estimated from files of time histories; None where the files hold FRFs.
    decay_rate : float
        What an exponential window of the analyser adds to the decay rate of every mode in files of FRFs, 1/s.
    sensor_mass : float
        Mass of each sensor that roves, kg, to be taken out of the modes; 0 where not stated.
    corrections : tuple of Correction
        Corrections of single functions.
    notes : tuple of str
        What was odd about the points and how it was resolved.
    reassembly : Reassembly
        How far a state scatters that is assembled anew.
    full_scale : tuple of float
        What full scale means in each channel of sound files, or in all, in the units of `averaging`; else empty.
    modes_std : ModesStd
        How sure the modes are of configurations whose files hold modes and do not say it.
    file_units : FileUnits or None
        Units that a universal file of the points states, for functions whose files state none.
    project, author, date : str
        What stands in the title block of the report; empty where not stated.
    """

    name: str
    path: Path
    folder: Path
    stack: Path | None
    points: Path | None
    geometry: Geometry
    without_coordinates: tuple[int, ...]
    configurations: tuple[Configuration, ...]
    identification: IdentificationOptions
    format: Format | None
    unit: Unit | None
    table: TableLayout | None
    variables: VariableLayout | None
    averaging: Averaging | None
    decay_rate: float
    sensor_mass: float
    corrections: tuple[Correction, ...]
    notes: tuple[str, ...]
    reassembly: Reassembly = field(default_factory=Reassembly)
    full_scale: tuple[float, ...] = ()
    modes_std: ModesStd = field(default_factory=ModesStd)
    file_units: FileUnits | None = None
    project: str = ""
    author: str = ""
    date: str = ""

    def configuration(self, name: str) -> Configuration:
        """Return the configuration called `name`.

        Raises
        ------
        CampaignError
            There is none of that name; the message lists the closest ones.
        """
        for configuration in self.configurations:
            if configuration.name == name:
                return configuration
        names = [c.name for c in self.configurations]
        raise CampaignError(f"{self.path}: no configuration {name!r}; {did_you_mean(name, names)}")


def read_campaign(path: str | Path) -> Campaign:
    """Read and check a campaign file (TOML).

    File names in it are relative to its folder and may hold wildcards::

        [campaign]
        name = "Stack 4, two torques"          # title
        [structure]
        stack = "stack.toml"                   # the model's stack file; may be left out
        [points]                               # may be left out for an identification alone
        file = "points.csv"                    # columns node,x,y,z; or a universal file with points
        unit = "mm"                            # needed for CSV; for a universal file it overrides set 164
        lines = [[1, 2, 3], [4, 5, 6]]         # trace lines for drawing, beside those of a universal file
        without_coordinates = [99]             # measured points that are not in the list; others are refused
        [measurement]
        format = "uff"                         # or "csv", "mat", "hdf5", "numpy", "tdms"; left out, the suffix decides
        unit = "(m/s2)/N"                      # overrides what universal files say; needed for the others
        [measurement.table]                    # columns of CSV files, see `ema.io.table.TableLayout`
        [measurement.variables]                # MATLAB, HDF5, NumPy, TDMS files, see `ema.io.variables.VariableLayout`
        [measurement.time]                     # only where files are time histories of one force and its responses,
        window = "boxcar"                      # all files of a run averaged; see `ema.campaign.estimate.Averaging`
        force_unit = "N"                       # units of text files, in place of 'unit' above
        [[configuration]]
        name = "M1"                            # beside it modes = "file" where 'files' hold modes, not FRFs
        compare_to = "M0"                      # its reference, or a list with repeats of it; may be left out
        stack = 4                              # which stack; this and the next four may be left out
        torque_Nm = 1.5
        pressure_kPa = 160
        height_mm = 64.8
        force_N = 2                            # level of the force; may be left out
        files = ["M1/*.uff"]                   # in natural order, each one run unless a hammer roves and the sensors
                                               # stay; [["F*.csv", "A*.csv"]]: side by side
        output = ["1+z", "2+z"]                # DOFs of the FRFs in reading order, if the files hold none: point,
        input = ["45+z"]                       # sign, axis, one for all; or {node = 4, direction = [0, 0.7, 0.7]}
        [[configuration.force_level]]          # the same state at another force, at all points or some:
        force_N = 10                           # compared with 'files' for linearity, not identified
        files = ["M1/10N/*.uff"]               # output and input as above where they are left out
        [[configuration]]                      # where one run is several files, name the runs instead
        name = "M2"
        [[configuration.run]]
        files = ["M2/left.csv", "M2/right.csv"]  # output and input as above
        [[correction]]                         # of single functions; applies where all that is given fits
        files = "M1/run03.uff"
        function = 2                           # position of the FRF in its file, from 1
        output = "12+z"                        # its response DOF as read
        scale = -1                             # factor; conjugate = true turns the imaginary part, exclude = true
        new_output = "12-z"                    # leaves the function out; another DOF; new_input likewise
        reason = "sensor was mounted upside down"
        [reassembly]                           # if known: relative scatter of frequency, damping, shape
        [identification]                       # both may be left out
        band_Hz = [30, 1100]
        order = 60                             # highest model order

    Raises
    ------
    CampaignError
        The file asks for what does not exist or is not possible; the message names file, key and what is allowed.
    MeasurementError
        The file of the points cannot be read.
    """
    return campaign_of(Path(path), read_form(Path(path), CampaignFile, CampaignError))


def campaign_of(path: Path, content: CampaignFile) -> Campaign:
    """Return the campaign that a file describes, checked also for what its form alone does not show.

    Parameters
    ----------
    path : Path
        The file.
    content : CampaignFile
        What it holds.

    Raises
    ------
    CampaignError, MeasurementError
        See `read_campaign`.
    """
    folder = path.resolve().parent
    points = None if content.points.file is None else folder / content.points.file
    geometry, notes = geometry_of(path, folder, content.points)
    names = [c.name for c in content.configuration]
    if len(set(names)) < len(names):
        raise CampaignError(f"{path}: configuration: names must be unique, found {names}")
    configurations = tuple(_configuration(path, folder, c) for c in content.configuration)
    faults = [f"{path}: configuration {fault}" for fault in reference_faults(configurations)]
    if faults:
        raise CampaignError("\n".join(faults))
    read = [state for c in configurations for state in (c, *c.force_levels)]
    described = [f for s in read if not s.has_modes for group in s.files for f in group.files]
    _require_description(path, content.measurement, described)
    if content.measurement.time is None and any(group.beside > 1 for s in read for group in s.files):
        raise CampaignError(
            f"{path}: files in inner brackets, side by side, are of time histories: they need [measurement.time]"
        )
    options = content.identification
    return Campaign(
        name=content.campaign.name,
        path=path,
        folder=folder,
        stack=None if content.structure.stack is None else folder / content.structure.stack,
        points=points,
        geometry=geometry,
        without_coordinates=content.points.without_coordinates,
        configurations=configurations,
        identification=IdentificationOptions(band=options.band_Hz, order=options.order),
        format=content.measurement.format,
        unit=None if content.measurement.unit is None else parse_unit(content.measurement.unit),
        table=content.measurement.table,
        variables=content.measurement.variables,
        averaging=content.measurement.time,
        decay_rate=1.0 / content.measurement.exponential_window_s,
        sensor_mass=1e-3 * content.measurement.sensor_mass_g,
        corrections=tuple(_correction(path, folder, c) for c in content.correction),
        notes=notes,
        reassembly=content.reassembly,
        full_scale=content.measurement.full_scale,
        modes_std=ModesStd(
            frequency=content.modes.frequency_std, damping=content.modes.damping_std, shape=content.modes.shape_std
        ),
        file_units=read_uff_units(points) if points is not None and format_of(points) == "uff" else None,
        project=content.campaign.project,
        author=content.campaign.author,
        date=content.campaign.date,
    )


def _require_description(path: Path, given: MeasurementSection, files: list[Path]) -> None:
    """Refuse files that do not describe themselves and that the campaign file does not describe."""
    bare = given.variables is None  # functions of SDynPy need no description
    formats = {
        f for file in files
        if not ((f := format_of(file, given.format)) == "numpy" and bare and holds_data_arrays(file))
    }  # fmt: skip
    stated = given.unit is not None or given.time is not None
    if ("wav" in formats) != bool(given.full_scale) or ("wav" in formats and given.time is None):
        raise CampaignError(
            f"{path}: measurement: sound files (.wav) hold time histories and need 'full_scale', the value of each "
            "channel at full scale in its unit, and [measurement.time] with force_unit and response_unit"
        )
    if "csv" in formats and (given.table is None or not stated):
        raise CampaignError(f"{path}: measurement: text files need 'unit' and [measurement.table] with their columns")
    if formats & {"mat", "hdf5", "numpy", "tdms"} and (given.variables is None or not stated):
        raise CampaignError(
            f"{path}: measurement: MATLAB, HDF5, NumPy and TDMS files need 'unit' and [measurement.variables] with "
            "what their variables hold; those of time histories [measurement.time] in place of 'unit'"
        )


def _configuration(path: Path, folder: Path, given: ConfigurationSection) -> Configuration:
    key = f"configuration {given.name!r}: files"
    groups = given.run or (given,)
    level_key = f"configuration {given.name!r}: force_level: files"
    configuration = Configuration(
        name=given.name,
        stack=None if given.stack is None else str(given.stack),
        torque=given.torque_Nm,
        pressure=None if given.pressure_kPa is None else given.pressure_kPa * 1e3,
        height=None if given.height_mm is None else given.height_mm * 1e-3,
        files=tuple(
            _files(path, folder, key, group.files, (group.output, group.input), together=bool(given.run))
            for group in groups
        ),
        force=given.force_N,
        compare_to=given.compare_to,
        repeat_of=given.repeat_of,
        has_modes=given.modes is not None,
    )
    levels = tuple(
        replace(
            configuration,
            name=f"{given.name} at {level.force_N:g} N",
            force=level.force_N,
            compare_to=(),
            repeat_of=None,
            files=(
                _files(
                    path,
                    folder,
                    level_key,
                    level.files,
                    (level.output or given.output, level.input or given.input),
                    together=False,
                ),
            ),
        )
        for level in given.force_level
    )
    return replace(configuration, force_levels=levels)


def _files(
    path: Path, folder: Path, key: str, names: Names, dofs: tuple[tuple[Dof, ...], tuple[Dof, ...]], *, together: bool
) -> Files:
    """Return the files of names, or those of lists of names that belong side by side."""
    output, force = dofs
    plain = tuple(name for name in names if isinstance(name, str))
    sets = [name for name in names if not isinstance(name, str)]
    files = named_files(path, folder, key, plain) if plain else ()
    return Files(
        files=(*files, *(file for one in sets for file in files_beside(path, folder, key, one))),
        together=together,
        output=output,
        input=force,
        beside=len(sets[0]) if sets else 1,
    )


def _correction(path: Path, folder: Path, given: CorrectionSection) -> Correction:
    files = named_files(path, folder, "correction: files", given.files)
    return Correction(
        files=files,
        function=given.function,
        output=given.output,
        scale=given.scale,
        conjugate=given.conjugate,
        new_output=given.new_output,
        new_input=given.new_input,
        exclude=given.exclude,
        reason=given.reason,
    )


def geometry_of(
    path: Path, folder: Path, given: PointsSection, *, most_points: int = 100_000
) -> tuple[Geometry, tuple[str, ...]]:
    """Return the points that a section of a campaign file lists, none without a file, and what reading them noted.

    `most_points`: points; more take minutes to draw and are a slip.

    Raises
    ------
    CampaignError
        The section asks for what does not exist or is not possible.
    MeasurementError
        The file of the points cannot be read.
    """
    if given.file is None:
        whole = np.empty(0, dtype=np.int64)
        return Geometry(node=whole, coordinate=np.empty((0, 3)), line=whole.reshape(0, 2)), ()
    file = folder / given.file
    try:
        special = file.exists() and not (file.is_file() or file.is_dir())
    except OSError as error:  # such as a name that is too long
        raise CampaignError(f"{path}: points.file: {given.file[:60]!r} names no file: {error.strerror}") from error
    if special:
        raise CampaignError(f"{path}: points.file: {given.file!r} is a pipe or a device; name a plain file")
    unit = None if given.unit is None else parse_unit(given.unit)
    if unit is not None and unit.dimension != (1, 0, 0):
        raise CampaignError(f"{path}: points.unit: {given.unit!r} is not a unit of length")
    if format_of(file) == "uff":
        geometry, notes = read_uff_geometry(file, unit)
    elif unit is None:
        raise CampaignError(f"{path}: points.unit: a list of points needs its unit, such as unit = 'mm'")
    else:
        geometry, notes = read_points(file, unit), ()
    if geometry.node.size > most_points:
        raise CampaignError(
            f"{file}: holds {geometry.node.size} points, at most {most_points} can be; leave out what was not measured"
        )
    drawn = [pair for line in given.lines for pair in pairwise(line)]
    absent = sorted({n for pair in drawn for n in pair} - {int(n) for n in geometry.node})
    if absent:
        raise CampaignError(f"{path}: points.lines: no such points: {absent}")
    pairs = [*map(tuple, geometry.line.tolist()), *drawn]
    lines = np.array(list(dict.fromkeys(pairs)), dtype=np.int64).reshape(-1, 2)
    return replace(geometry, line=lines), notes
