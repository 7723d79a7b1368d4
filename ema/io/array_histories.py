"""Time histories in named arrays, as a campaign file describes them, and in sound files (WAV)."""

from __future__ import annotations

import io
import re
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ema.io.array_files import ArrayInFile, array, arrays_in, pattern_of
from ema.io.measured_function import Channels, MeasuredFunction, require_ascending
from ema.io.variables import FIRST_CHANNEL, VariableLayout
from ema.types.errors import MeasurementError
from lamella_shared import plain_bytes

_PARTS = re.compile(r"(\d+)")
_ORDER = ("run", "hit", "channel", "time")


def read_histories(path: Path, layout: VariableLayout, *, matlab: bool) -> tuple[tuple[Channels, ...], ...]:
    """Read the time histories of a file: for each run its hits, for each hit its channels.

    They come as they stand, as functions of kind "response", since only the user knows which channel is the force.

    Parameters
    ----------
    path : Path
        MATLAB, HDF5, NumPy or TDMS file.
    layout : VariableLayout
        Which variables hold them, and what their axes are; one of time histories.
    matlab : bool
        Whether MATLAB wrote it, see `arrays_in`.

    Raises
    ------
    MeasurementError
        A variable is missing, is complex, or has another shape than the others ask for; the message names file and
        variable.
    """
    assert layout.history is not None
    with arrays_in(path, matlab=matlab) as arrays:
        blocks = [(name, _stacked(path, arrays, layout, name, matlab=matlab)) for name in layout.history]
        first, reference = blocks[0]
        for name, block in blocks:
            if (*block.shape[:2], block.shape[3]) != (*reference.shape[:2], reference.shape[3]):
                message = (
                    f"{path}: variable {name!r} (history): {_counts(block)} do not fit the {_counts(reference)} of "
                    f"{first!r}; expected as many in all; is the order axes = {list(layout.axes)} right?"
                )
                raise MeasurementError(message)
        time = _time(path, arrays, layout, blocks)
        _require_one_start(path, arrays, layout, float(time[1] - time[0]) if time.size > 1 else 0.0)
    inside = 1 if layout.time == FIRST_CHANNEL else 0
    n_run, n_hit = reference.shape[:2]

    def channels(run: int, hit: int) -> Channels:
        place = "".join(f"{what} {k + 1}, " for what, k, n in (("run", run, n_run), ("hit", hit, n_hit)) if n > 1)
        return tuple(
            MeasuredFunction(
                kind="response", abscissa=time, value=block[run, hit, c], quantity=None, output=None, input=None,
                source=f"{path}: variable {name!r}, {place}channel {c + 1}",
            )
            for name, block in blocks
            for c in range(inside, block.shape[2])
        )  # fmt: skip

    return tuple(tuple(channels(run, hit) for hit in range(n_hit)) for run in range(n_run))


def _require_one_start(path: Path, arrays: Mapping[str, ArrayInFile], layout: VariableLayout, step: float) -> None:
    """Refuse channels of a TDMS group that begin more than a sample apart (s): they are not side by side."""
    starts: dict[str, list[tuple[float, str]]] = {}
    for name in (n for given in layout.history or () for n in _alike(path, arrays, "history", given)):
        stated = [arrays[key].read() for key in (f"{name}@wf_start_time", f"{name}@wf_start_offset") if key in arrays]
        if stated:
            starts.setdefault(name.rpartition("/")[0], []).append((float(sum(stated)), name))
    for group in starts.values():
        (first, one), (last, other) = min(group), max(group)
        if last - first > step:
            message = (
                f"{path}: channel {other!r} begins {last - first:.4g} s after {one!r} (wf_start_time, "
                "wf_start_offset), so that their samples are not of the same times; write channels of one task, or cut "
                "them to one start"
            )
            raise MeasurementError(message)


def _counts(block: NDArray[np.float64]) -> str:
    return f"{block.shape[0]} runs, {block.shape[1]} hits, {block.shape[2]} channels and {block.shape[3]} samples"


def _alike(path: Path, arrays: Mapping[str, ArrayInFile], key: str, name: str) -> list[str]:
    """Return the variables that a name with ``*`` stands for, in natural order; without one the name itself."""
    if "*" not in name:
        return [name]
    names = sorted((n for n in arrays if pattern_of(name).fullmatch(n)), key=_natural)
    if not names:
        array(path, arrays, key, name)  # says which there are
    return names


def _starred(name: str, variable: str) -> tuple[str, ...]:
    """Return what stands in a variable where a name has ``*``."""
    match = pattern_of(name).fullmatch(variable)
    assert match is not None
    return match.groups()


def _natural(name: str) -> list[int | str]:
    return [int(part) if part.isdigit() else part for part in _PARTS.split(name)]


def _stacked(
    path: Path, arrays: Mapping[str, ArrayInFile], layout: VariableLayout, name: str, *, matlab: bool
) -> NDArray[np.float64]:
    """Return an array of the axes run, hit, channel, time, or many along the first axes, as long as the shortest."""
    count = name.count("*")
    stacked = [
        (n, _block(path, arrays, layout, n, layout.axes[count:], matlab=matlab))
        for n in _alike(path, arrays, "history", name)
    ]
    n_sample = min(block.shape[3] for _, block in stacked)

    def along(level: int, part: list[tuple[str, NDArray[np.float64]]]) -> NDArray[np.float64]:
        if level == count:
            return part[0][1][..., :n_sample]
        of_name: dict[str, list[tuple[str, NDArray[np.float64]]]] = {}
        for n, block in part:
            of_name.setdefault(_starred(name, n)[level], []).append((n, block))
        blocks = [along(level + 1, group) for group in of_name.values()]
        for block, group in zip(blocks, of_name.values(), strict=True):
            if block.shape != blocks[0].shape:
                message = (
                    f"{path}: variable {group[0][0]!r} (history): {_counts(block)} do not fit the {_counts(blocks[0])} "
                    f"of {part[0][0]!r}; expected as many in each of {name!r}"
                )
                raise MeasurementError(message)
        return np.concatenate(blocks, axis=_ORDER.index(layout.axes[level]))

    return along(0, stacked)


def _block(
    path: Path,
    arrays: Mapping[str, ArrayInFile],
    layout: VariableLayout,
    name: str,
    named: tuple[str, ...],
    *,
    matlab: bool,
) -> NDArray[np.float64]:
    """Return an array with the axes run, hit, channel, time; those that it does not have are of length one."""
    value = array(path, arrays, "history", name)
    if np.iscomplexobj(value):
        message = (
            f"{path}: variable {name!r} (history): its numbers are complex, expected time histories; where they are "
            "FRFs, name them as 'frf' and leave [measurement.time] out"
        )
        raise MeasurementError(message)
    several = layout.history is not None and len(layout.history) > 1
    axes, shape = _axes_of(value, named, droppable=matlab and not several)
    if len(axes) != len(shape):
        message = (
            f"{path}: variable {name!r} (history): {arrays[name]} have {len(shape)} axes, axes = {list(named)} "
            "names others; say which axis is what"
        )
        raise MeasurementError(message)
    lengths = [shape[axes.index(a)] if a in axes else 1 for a in _ORDER]
    order = [axes.index(a) for a in _ORDER if a in axes]
    return value.reshape(shape).transpose(order).reshape(lengths)


def _axes_of(value: NDArray[Any], axes: tuple[str, ...], *, droppable: bool) -> tuple[tuple[str, ...], tuple[int, ...]]:
    """Return what the axes of an array are, and its shape without those of length one that are not named."""
    shape = value.shape
    if value.size == max(shape, default=0):  # MATLAB has no vectors, only columns and rows
        return ("time",), (value.size,)
    if len(shape) > len(axes):
        shape = tuple(n for n in shape if n > 1)
    if len(shape) < len(axes):
        # MATLAB drops axes of length one at the end; else it is a force beside responses of many channels
        dropped = droppable and axes[-1] in ("hit", "run")
        axes = axes[: len(shape)] if dropped else tuple(a for a in axes if a != "channel")
    return axes, shape


def _time(
    path: Path, arrays: Mapping[str, ArrayInFile], layout: VariableLayout, blocks: list[tuple[str, NDArray[np.float64]]]
) -> NDArray[np.float64]:
    name, block = blocks[0]
    count = block.shape[3]
    where, time = f"{path}: variable {name!r} (time)", block[0, 0, 0]
    if layout.time == FIRST_CHANNEL:
        for other, of_block in blocks:
            if of_block.shape[2] < 2 or np.any(of_block[0, 0, 0] != block[0, 0, 0]):
                message = (
                    f"{path}: variable {other!r} (history): expected the times in its first channel, the same as in "
                    f"{name!r}, and others beside them, found {of_block.shape[2]} channels; is the order axes = "
                    f"{list(layout.axes)} right?"
                )
                raise MeasurementError(message)
    elif layout.time is not None:
        given = _alike(path, arrays, "time", layout.time)
        where, time = f"{path}: variable {given[0]!r} (time)", array(path, arrays, "time", given[0])
        fits = time.size == count or (len(given) > 1 and time.size > count)  # of the first of several hits
        if not fits or max(time.shape, default=0) != time.size or np.iscomplexobj(time):
            message = (
                f"{where}: expected {count} real numbers, as many as {name!r} has samples, found {arrays[given[0]]}; "
                f"is the order axes = {list(layout.axes)} right?"
            )
            raise MeasurementError(message)
        time = time.ravel()[:count]
    if layout.sampling_Hz is not None:
        return np.arange(count) / _rate(path, arrays, layout.sampling_Hz)
    require_ascending(where, "value", 1, time, "[measurement.variables]")
    return time


def _rate(path: Path, arrays: Mapping[str, ArrayInFile], name: str | float) -> float:
    """Return the stated sampling rate, Hz."""
    if not isinstance(name, str):
        return name
    value = array(path, arrays, "sampling_Hz", _alike(path, arrays, "sampling_Hz", name)[0])
    if value.size != 1 or np.iscomplexobj(value) or not 0 < value.flat[0] < np.inf:
        message = f"{path}: variable {name!r} (sampling_Hz): expected one positive number, found {value.size}"
        if value.size == 1:
            message = f"{path}: variable {name!r} (sampling_Hz): expected a positive number, found {value.flat[0]}"
        raise MeasurementError(message)
    return float(value.flat[0])


def read_wav(path: Path, full_scale: tuple[float, ...]) -> tuple[MeasuredFunction, ...]:
    """Read the channels of a sound file as time histories.

    They come as functions of kind "response", since only the user knows which channel is the force.

    Parameters
    ----------
    path : Path
        WAV file of 8 to 64 bits, whole numbers or floating point.
    full_scale : tuple of float
        What full scale means in each channel, in the unit that the campaign file states; one number for all.

    Raises
    ------
    MeasurementError
        It cannot be read, or has another number of channels; the message names file and channel.
    """
    rate, data = _content(path)
    if len(full_scale) not in (1, data.shape[1]):
        message = (
            f"{path}: has {data.shape[1]} channels, and 'full_scale' of the campaign file {len(full_scale)} numbers; "
            "give one for each channel, or one for all"
        )
        raise MeasurementError(message)
    if rate <= 0 or data.shape[0] < 2 or not np.isfinite(data).all():
        message = (
            f"{path}: holds {data.shape[0]} samples at {rate:g} Hz, or values that are not finite; expected a record "
            "with its sampling rate in the header"
        )
        raise MeasurementError(message)
    time = np.arange(data.shape[0]) / rate
    return tuple(
        MeasuredFunction(
            kind="response", abscissa=time, value=data[:, c] * full_scale[c if len(full_scale) > 1 else 0],
            quantity=None, output=None, input=None, source=f"{path}: channel {c + 1}",
        )
        for c in range(data.shape[1])
    )  # fmt: skip


def _content(path: Path) -> tuple[float, NDArray[np.float64]]:
    """Return the sampling rate, Hz, and the samples over full scale, (n_sample, n_channel)."""
    middle_of_bytes = 2.0**7  # of whole numbers of 8 bits, which have no sign
    # Full scale of whole numbers; SciPy gives those of 24 bits as the upper ones of 32
    full_scale = {"int16": 2.0**15, "int32": 2.0**31, "int64": 2.0**63, "uint8": 2.0**7}
    from scipy.io import wavfile  # here: few tests come as sound

    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("error", message="Reached EOF prematurely")  # what is cut off
            warnings.filterwarnings("ignore", message="Chunk")  # of text beside the samples
            rate, raw = wavfile.read(io.BytesIO(plain_bytes(path)))
        samples: NDArray[Any] = np.atleast_1d(raw)
        full = full_scale.get(samples.dtype.name, 1.0)
        middle = middle_of_bytes if samples.dtype.name == "uint8" else 0.0
        return float(rate), ((samples.astype(float) - middle) / full).reshape(len(samples), -1)
    except Exception as error:  # SciPy raises what it likes at damaged headers
        message = (
            f"{path}: cannot be read as a WAV file: {getattr(error, 'strerror', None) or error}; expected the whole of "
            "a file of 8 to 64 bits, not compressed"
        )
        raise MeasurementError(message) from error
