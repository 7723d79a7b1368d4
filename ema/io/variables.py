"""FRFs in the named arrays of MATLAB, HDF5, NumPy and TDMS files, as a campaign file describes them. To SI here.

What these files hold of time histories is described here, too, and read in `ema.io.array_histories`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import prod
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from ema.io.array_files import ArrayInFile, array, arrays_in
from ema.io.files import from_polar
from ema.io.measured_function import MeasuredFunction, Unit
from ema.types.errors import MeasurementError
from lamella_shared import Complexes, Reals

Name = Annotated[str, AfterValidator(lambda name: name.lstrip("/"))]  # HDF5 tools show names from the root


def _several(given: Any) -> Any:
    """Return a list; what is written without brackets is a list of one."""
    return (given,) if isinstance(given, str) else tuple(given) if isinstance(given, list) else given


Names = Annotated[tuple[Name, ...], Field(min_length=1), BeforeValidator(_several)]
Axis = Literal["frequency", "output", "input", "time", "channel", "hit", "run"]
DIRECTIONS = {f"{sign}{axis}": int(f"{sign}{k}") for k, axis in enumerate("xyz", start=1) for sign in "+-"}
"""Signed local directions as they are written, to 1, 2, 3 for +x, +y, +z and negative numbers against them."""
FIRST_COLUMN = "first column"
"""In place of a variable of the frequencies: the first column of each array of FRFs."""
FIRST_CHANNEL = "first channel"
"""In place of a variable of the times: the first channel of each array of time histories."""
WAYS = (("frf",), ("real", "imaginary"), ("magnitude", "phase"))
"""Keys of the FRFs, of which a file has one or one pair."""
_OF_FRFS, _OF_HISTORIES = {"frequency", "output", "input"}, {"time", "channel", "hit", "run"}
_Named = tuple[str, NDArray[Any]]  # a variable and its values (n_frequency, n_output, n_input)


class VariableLayout(BaseModel):
    """Which variables of a MATLAB, HDF5, NumPy or TDMS file hold what; keys of ``[measurement.variables]``.

    Fields of a MATLAB structure are named ``data.H``, data sets in an HDF5 group ``data/H``.

    Attributes
    ----------
    history : tuple of str or None
        Variables of time histories, in place of FRFs; of several the channels of the first come first, then those of
        the next. One with a single channel needs no axis of channels. A name with ``*``, such as ``data(*).force``,
        stands for variables along the first of `axes`, "hit" or "run"; one with two for those along the first two.
    time : str or None
        Variable of their times, s, or ``"first channel"`` where the first channel of each of them holds these.
    sampling_Hz : float, str or None
        Their sampling rate, Hz, or the variable that holds it, where times are missing or rounded.
    frf : tuple of str or None
        Variable of the complex FRFs; of several the outputs of the first come first, then those of the next.
    real, imaginary : tuple of str or None
        Variables of their parts, in place of `frf`; of several pairs as of several `frf`.
    magnitude, phase : tuple of str or None
        Variables of magnitude and phase, in place of `frf`.
    phase_unit : {"deg", "rad"}
        Unit of the phase.
    magnitude_unit : {"linear", "dB"}
        "dB" is 20 log10 of the magnitude over one of its unit.
    axes : tuple of str
        What each axis of these arrays is, in the order that MATLAB or the HDF5 file shows: "frequency", "output" and
        "input" of FRFs; "time", "channel", "hit" (blows that are averaged) and "run" (points that are not) of time
        histories. Axes of length one may be left out.
    frequency : str or None
        Variable of the frequencies, Hz, or ``"first column"`` where the first column of the FRFs holds them.
    axis_start, axis_step : float
        First frequency and step, Hz, where there is no such variable.
    output_point, input_point : str, int or None
        Variable of the point numbers along that axis, or one number for all.
    output_direction, input_direction : str or None
        Variable of the signed directions, 1, 2, 3 for +x, +y, +z and negative numbers against them, or one such as
        ``"+z"`` for all.
    coherence : tuple of str or None
        Variables of the coherences, in the shapes of the FRFs and in their order.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    history: Names | None = None
    time: Name | None = None
    sampling_Hz: Name | Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = None
    frf: Names | None = None
    real: Names | None = None
    imaginary: Names | None = None
    magnitude: Names | None = None
    phase: Names | None = None
    phase_unit: Literal["deg", "rad"] = "deg"
    magnitude_unit: Literal["linear", "dB"] = "linear"
    axes: tuple[Axis, ...] = ("frequency", "output")
    frequency: Name | None = None
    axis_start: float = 0.0
    axis_step: float = Field(default=0.0, ge=0)
    output_point: Name | Annotated[int, Field(ge=1)] | None = None
    output_direction: Name | None = None
    input_point: Name | Annotated[int, Field(ge=1)] | None = None
    input_direction: Name | None = None
    coherence: Names | None = None

    @model_validator(mode="after")
    def _consistent(self) -> VariableLayout:
        if len(set(self.axes)) < len(self.axes):
            raise ValueError(f"axes: each once, found {list(self.axes)}")
        if self.history is not None:
            _require_of_histories(self)
        else:
            self._require_of_frfs()
        return self

    def _require_of_frfs(self) -> None:
        if self.time is not None or self.sampling_Hz is not None:
            raise ValueError("'time' and 'sampling_Hz' belong to 'history', variables of time histories")
        given = [key for keys in WAYS for key in keys if getattr(self, key) is not None]
        if tuple(given) not in WAYS:
            raise ValueError(
                "give either 'frf', the complex FRFs, or 'real' and 'imaginary', or 'magnitude' and 'phase'"
            )
        counts = {key: len(getattr(self, key)) for key in given}
        if len(set(counts.values())) > 1:
            said = ", ".join(f"{count} of {key!r}" for key, count in counts.items())
            raise ValueError(f"as many variables of both parts, found {said}")
        if "frequency" not in self.axes or not set(self.axes) <= _OF_FRFS:
            raise ValueError(
                f"axes: each of 'frequency', 'output', 'input' once, 'frequency' always, found {list(self.axes)}"
            )
        if self.frequency == FIRST_COLUMN and self.axes != ("frequency", "output"):
            raise ValueError(
                f"frequencies in the first column need axes = ['frequency', 'output'], found {list(self.axes)}"
            )
        if self.frequency is None and self.axis_step <= 0:
            raise ValueError("without a variable of the frequencies ('frequency'), axis_step must be positive")
        for end in ("output", "input"):
            if (getattr(self, f"{end}_point") is None) != (getattr(self, f"{end}_direction") is None):
                raise ValueError(f"'{end}_point' and '{end}_direction' belong together")


def _require_of_histories(layout: VariableLayout) -> None:
    """Refuse what does not describe time histories."""
    foreign = layout.model_fields_set - {"history", "time", "sampling_Hz", "axes"}
    if foreign:
        raise ValueError(
            f"{', '.join(map(repr, sorted(foreign)))}: of FRFs, not of time histories ('history'); their points and "
            "directions are 'output' and 'input' of the configuration"
        )
    if "time" not in layout.axes or not set(layout.axes) <= _OF_HISTORIES:
        raise ValueError(
            "axes of time histories: each of 'time', 'channel', 'hit', 'run' at most once, 'time' always, such as "
            f"['time', 'channel'], found {list(layout.axes)}"
        )
    for name in layout.history or ():
        if not set(layout.axes[: name.count("*")]) <= {"hit", "run"}:
            raise ValueError(
                f"{name!r}: each * stands for one of the first axes, 'hit' or 'run', such as axes = ['hit', 'channel', "
                f"'time'], found {list(layout.axes)}"
            )
    if layout.time is None and layout.sampling_Hz is None:
        raise ValueError(
            "time histories need 'time', the variable of their times, or their sampling rate as 'sampling_Hz'"
        )


def read_variables(
    path: Path, layout: VariableLayout, unit: Unit | None, *, matlab: bool
) -> tuple[MeasuredFunction, ...]:
    """Read every FRF of a MATLAB or HDF5 file, and their coherences: all inputs of the first output, then the next.

    Parameters
    ----------
    path : Path
        MATLAB file of any version, or HDF5 file.
    layout : VariableLayout
        Which variable holds what.
    unit : Unit or None
        Unit of the FRFs, which come in SI units.
    matlab : bool
        Whether MATLAB wrote it, see `arrays_in`.

    Raises
    ------
    MeasurementError
        A variable is missing or has another shape than the others ask for; the message names file and variable.
    """
    with arrays_in(path, matlab=matlab) as arrays:
        named = _frfs(path, arrays, layout)
        frequency = _frequency(path, arrays, layout, named)
        value = np.concatenate([block for _, block in named], axis=1)
        outputs = _dofs(path, arrays, layout, "output", value.shape[1])
        inputs = _dofs(path, arrays, layout, "input", value.shape[2])
        coherences = _coherences(path, arrays, layout, named)
    factor = 1.0 if unit is None else unit.factor
    with np.errstate(over="ignore", invalid="ignore"):  # what is not finite is for the quality check to say
        frfs = [
            MeasuredFunction(
                kind="frf",
                abscissa=frequency,
                value=one * factor,
                quantity=None if unit is None else unit.frf,
                output=outputs[i],
                input=inputs[j],
                source=source,
            )
            for i, j, one, source in _each(path, named)
        ]
    return (
        *frfs,
        *(
            MeasuredFunction(
                kind="coherence", abscissa=frequency, value=one, quantity=None, output=outputs[i], input=inputs[j],
                source=source,
            )
            for i, j, one, source in _each(path, coherences)
        ),
    )  # fmt: skip


def _each(path: Path, blocks: list[_Named]) -> Iterator[tuple[int, int, NDArray[Any], str]]:
    """Give each function with the numbers of its output, over all blocks, and of its input, and where it is from."""
    start = 0
    for name, block in blocks:
        for i in range(block.shape[1]):
            for j in range(block.shape[2]):
                yield (start + i, j, block[:, i, j], f"{path}: variable {name!r}, output {i + 1}, input {j + 1}")
        start += block.shape[1]


def _frfs(path: Path, arrays: Mapping[str, ArrayInFile], layout: VariableLayout) -> list[_Named]:
    """Return the FRFs, each with the variable that messages name."""
    if layout.frf is not None:
        frfs = [(name, _block(path, arrays, layout, "frf", name)) for name in layout.frf]
        for name, value in frfs:
            if not np.iscomplexobj(value):
                raise MeasurementError(
                    f"{path}: variable {name!r} (frf): its numbers are real, expected complex ones; where the parts "
                    "are variables of their own, name them as 'real' and 'imaginary', or as 'magnitude' and 'phase'"
                )
    else:
        keys = next(keys for keys in WAYS if getattr(layout, keys[0]) is not None)
        pairs = zip(*(getattr(layout, key) for key in keys), strict=True)
        frfs = [(names[0], _of_parts(path, arrays, layout, keys, names)) for names in pairs]
    for name, value in frfs:
        if (value.shape[0], value.shape[2]) != (frfs[0][1].shape[0], frfs[0][1].shape[2]):
            key = next(keys[0] for keys in WAYS if getattr(layout, keys[0]) is not None)
            raise MeasurementError(
                f"{path}: variable {name!r} ({key}): {arrays[name]} do not fit the {arrays[frfs[0][0]]} of "
                f"{frfs[0][0]!r}; expected the same frequencies and inputs in all"
            )
    return frfs


def _of_parts(
    path: Path, arrays: Mapping[str, ArrayInFile], layout: VariableLayout, keys: tuple[str, ...], names: tuple[str, ...]
) -> Complexes:
    """Return FRFs from two variables, of real and imaginary parts or of magnitudes and phases."""
    first, second = (_block(path, arrays, layout, key, name) for key, name in zip(keys, names, strict=True))
    if first.shape != second.shape or np.iscomplexobj(first) or np.iscomplexobj(second):
        raise MeasurementError(
            f"{path}: variables {names[0]!r} ({keys[0]}) and {names[1]!r} ({keys[1]}): expected real numbers in "
            f"one shape, found {arrays[names[0]]} and {arrays[names[1]]}"
        )
    if keys[0] == "real":
        return np.asarray(first + 1j * second)
    return from_polar(first, second, decibel=layout.magnitude_unit == "dB", degrees=layout.phase_unit == "deg")


def _coherences(
    path: Path, arrays: Mapping[str, ArrayInFile], layout: VariableLayout, frfs: list[_Named]
) -> list[_Named]:
    names = layout.coherence or ()
    if names and len(names) != len(frfs):
        raise MeasurementError(
            f"{path}: variables {', '.join(map(repr, names))} (coherence): expected one for each of the "
            f"{len(frfs)} of the FRFs"
        )
    coherences = [(name, _block(path, arrays, layout, "coherence", name)) for name in names]
    for (name, coherence), (frf, value) in zip(coherences, frfs, strict=False):
        if coherence.shape != value.shape or np.iscomplexobj(coherence):
            raise MeasurementError(
                f"{path}: variable {name!r} (coherence): expected real numbers in the shape of "
                f"{frf!r}, {arrays[name]} do not fit"
            )
    return coherences


def _block(path: Path, arrays: Mapping[str, ArrayInFile], layout: VariableLayout, key: str, name: str) -> NDArray[Any]:
    """Return an array with the axes frequency, output, input; axes that the layout does not name have length one."""
    value = array(path, arrays, key, name)
    axes = layout.axes
    if layout.frequency == FIRST_COLUMN:
        value = _two_columns(path, arrays, key, name)[:, 1:]
    shape = value.shape
    if len(shape) > len(axes):  # MATLAB has no vectors, only columns and rows
        shape = tuple(n for n in shape if n > 1)
    shape += (1,) * (len(axes) - len(shape))  # and it drops axes of length one at the end
    if len(shape) != len(axes):
        raise MeasurementError(
            f"{path}: variable {name!r} ({key}): {arrays[name]} are more axes than axes = {list(axes)} "
            "names; say which axis is what"
        )
    order = [axes.index(a) for a in ("frequency", "output", "input") if a in axes]
    lengths = [shape[axes.index(a)] if a in axes else 1 for a in ("frequency", "output", "input")]
    return value.reshape(shape).transpose(order).reshape(lengths)


def _two_columns(path: Path, arrays: Mapping[str, ArrayInFile], key: str, name: str) -> NDArray[Any]:
    value = array(path, arrays, key, name)
    if value.ndim != 2 or not 1 < value.shape[1] < value.shape[0]:
        raise MeasurementError(
            f"{path}: variable {name!r} ({key}): expected the frequencies in its first column and values beside "
            f"them, found {arrays[name]}"
        )
    return value


def _frequency(path: Path, arrays: Mapping[str, ArrayInFile], layout: VariableLayout, frfs: list[_Named]) -> Reals:
    name, count = frfs[0][0], frfs[0][1].shape[0]
    if layout.frequency is None:
        return layout.axis_start + layout.axis_step * np.arange(count, dtype=np.float64)
    if layout.frequency == FIRST_COLUMN:
        columns = [_two_columns(path, arrays, "frequency", other)[:, 0] for other, _ in frfs]
        for (other, _), column in zip(frfs, columns, strict=True):
            if np.any(column.imag != 0) or np.any(column != columns[0]):
                raise MeasurementError(
                    f"{path}: variable {other!r} (frequency): expected the frequencies in its first column, real and "
                    f"the same as in {name!r}"
                )
        return _ascending(f"{path}: variable {name!r} (frequency)", columns[0].real)
    value = array(path, arrays, "frequency", layout.frequency)
    where = f"{path}: variable {layout.frequency!r} (frequency)"
    if value.size != count or max(value.shape, default=1) != value.size or np.iscomplexobj(value):
        raise MeasurementError(
            f"{where}: expected {count} real numbers, as many as the frequency axis of {name!r} "
            f"({arrays[name]}) has, found {arrays[layout.frequency]}; is the order "
            f"axes = {list(layout.axes)} right?"
        )
    return _ascending(where, value.ravel())


def _ascending(where: str, frequency: Reals) -> Reals:
    if not np.all(np.diff(frequency) > 0) and not np.all(np.diff(frequency) < 0):
        at = int(np.argmin(np.diff(frequency) > 0)) + 2
        raise MeasurementError(f"{where}: value {at}: the frequency does not ascend")
    return frequency


def _dofs(
    path: Path,
    arrays: Mapping[str, ArrayInFile],
    layout: VariableLayout,
    end: Literal["output", "input"],
    count: int,
    *,
    largest_point: float = 1e10,
) -> list[tuple[int, int]] | list[None]:
    """Return points and signed directions along an axis, or none of them where the campaign file lists them.

    `largest_point`: as in universal files.
    """
    point, direction = (getattr(layout, f"{end}_{what}") for what in ("point", "direction"))
    if point is None:
        return [None] * count
    points = np.full(count, point) if isinstance(point, int) else _whole(path, arrays, f"{end}_point", point, count)
    codes = (
        np.full(count, DIRECTIONS[direction.lower()])
        if direction.lower() in DIRECTIONS
        else _whole(path, arrays, f"{end}_direction", direction, count)
    )
    for key, values, right, fits in (
        ("point", points, "a point number", (points >= 1) & (points < largest_point)),
        ("direction", codes, "a direction 1, 2, 3, -1, -2 or -3", np.isin(np.abs(codes), (1, 2, 3))),
    ):
        if not fits.all():
            at = int(np.argmin(fits))
            raise MeasurementError(
                f"{path}: variable {getattr(layout, f'{end}_{key}')!r} ({end}_{key}): value {at + 1} is "
                f"{values[at]:g}, expected {right}"
            )
    return [(int(p), int(c)) for p, c in zip(points, codes, strict=True)]


def _whole(path: Path, arrays: Mapping[str, ArrayInFile], key: str, name: str, count: int) -> Reals:
    """Return `count` whole numbers of a variable; one holds for all."""
    value = array(path, arrays, key, name)
    where = f"{path}: variable {name!r} ({key})"
    if prod(value.shape) not in (1, count):
        end = key.partition("_")[0]
        raise MeasurementError(
            f"{where}: {arrays[name]} numbers for {count} {end}s; expected one for each, or one for all"
        )
    if np.iscomplexobj(value) or not np.all(value == np.round(value)):
        raise MeasurementError(f"{where}: expected whole numbers")
    return np.broadcast_to(value.ravel(), (count,))
