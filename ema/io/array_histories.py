"""Time histories in named arrays and sound files (WAV): read as a campaign file says, and guessed for a first one."""

from __future__ import annotations

import io
import re
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ema.io.array_files import ArrayInFile, array, arrays_in, pattern_of
from ema.io.files import FORCE, UNKNOWN, field_of, natural
from ema.io.measured_function import Channels, MeasuredFunction, require_ascending
from ema.io.variables import FIRST_CHANNEL, VariableLayout
from ema.types.errors import MeasurementError
from lamella_shared import Reals, plain_bytes

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
                raise MeasurementError(
                    f"{path}: variable {name!r} (history): {_counts(block)} do not fit the {_counts(reference)} of "
                    f"{first!r}; expected as many in all; is the order axes = {list(layout.axes)} right?"
                )
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
            raise MeasurementError(
                f"{path}: channel {other!r} begins {last - first:.4g} s after {one!r} (wf_start_time, "
                "wf_start_offset), so that their samples are not of the same times; write channels of one task, or cut "
                "them to one start"
            )


def _counts(block: Reals) -> str:
    return f"{block.shape[0]} runs, {block.shape[1]} hits, {block.shape[2]} channels and {block.shape[3]} samples"


def _alike(path: Path, arrays: Mapping[str, ArrayInFile], key: str, name: str) -> list[str]:
    """Return the variables that a name with ``*`` stands for, in natural order; without one the name itself."""
    if "*" not in name:
        return [name]
    names = sorted((n for n in arrays if pattern_of(name).fullmatch(n)), key=natural)
    if not names:
        array(path, arrays, key, name)  # says which there are
    return names


def _starred(name: str, variable: str) -> tuple[str, ...]:
    """Return what stands in a variable where a name has ``*``."""
    match = pattern_of(name).fullmatch(variable)
    assert match is not None
    return match.groups()


def _stacked(
    path: Path, arrays: Mapping[str, ArrayInFile], layout: VariableLayout, name: str, *, matlab: bool
) -> Reals:
    """Return an array of the axes run, hit, channel, time, or many along the first axes, as long as the shortest."""
    count = name.count("*")
    stacked = [
        (n, _block(path, arrays, layout, n, layout.axes[count:], matlab=matlab))
        for n in _alike(path, arrays, "history", name)
    ]
    n_sample = min(block.shape[3] for _, block in stacked)

    def along(level: int, part: list[tuple[str, Reals]]) -> Reals:
        if level == count:
            return part[0][1][..., :n_sample]
        of_name: dict[str, list[tuple[str, Reals]]] = {}
        for n, block in part:
            of_name.setdefault(_starred(name, n)[level], []).append((n, block))
        blocks = [along(level + 1, group) for group in of_name.values()]
        for block, group in zip(blocks, of_name.values(), strict=True):
            if block.shape != blocks[0].shape:
                raise MeasurementError(
                    f"{path}: variable {group[0][0]!r} (history): {_counts(block)} do not fit the {_counts(blocks[0])} "
                    f"of {part[0][0]!r}; expected as many in each of {name!r}"
                )
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
) -> Reals:
    """Return an array with the axes run, hit, channel, time; those that it does not have are of length one."""
    value = array(path, arrays, "history", name)
    if np.iscomplexobj(value):
        raise MeasurementError(
            f"{path}: variable {name!r} (history): its numbers are complex, expected time histories; where they are "
            "FRFs, name them as 'frf' and leave [measurement.time] out"
        )
    several = layout.history is not None and len(layout.history) > 1
    axes, shape = _axes_of(value, named, droppable=matlab and not several)
    if len(axes) != len(shape):
        raise MeasurementError(
            f"{path}: variable {name!r} (history): {arrays[name]} have {len(shape)} axes, axes = {list(named)} "
            "names others; say which axis is what"
        )
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
    path: Path, arrays: Mapping[str, ArrayInFile], layout: VariableLayout, blocks: list[tuple[str, Reals]]
) -> Reals:
    name, block = blocks[0]
    count = block.shape[3]
    where, time = f"{path}: variable {name!r} (time)", block[0, 0, 0]
    if layout.time == FIRST_CHANNEL:
        for other, of_block in blocks:
            if of_block.shape[2] < 2 or np.any(of_block[0, 0, 0] != block[0, 0, 0]):
                raise MeasurementError(
                    f"{path}: variable {other!r} (history): expected the times in its first channel, the same as in "
                    f"{name!r}, and others beside them, found {of_block.shape[2]} channels; is the order axes = "
                    f"{list(layout.axes)} right?"
                )
    elif layout.time is not None:
        given = _alike(path, arrays, "time", layout.time)
        where, time = f"{path}: variable {given[0]!r} (time)", array(path, arrays, "time", given[0])
        fits = time.size == count or (len(given) > 1 and time.size > count)  # of the first of several hits
        if not fits or max(time.shape, default=0) != time.size or np.iscomplexobj(time):
            raise MeasurementError(
                f"{where}: expected {count} real numbers, as many as {name!r} has samples, found {arrays[given[0]]}; "
                f"is the order axes = {list(layout.axes)} right?"
            )
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
        raise MeasurementError(
            f"{path}: has {data.shape[1]} channels, and 'full_scale' of the campaign file {len(full_scale)} numbers; "
            "give one for each channel, or one for all"
        )
    if rate <= 0 or data.shape[0] < 2 or not np.isfinite(data).all():
        raise MeasurementError(
            f"{path}: holds {data.shape[0]} samples at {rate:g} Hz, or values that are not finite; expected a record "
            "with its sampling rate in the header"
        )
    time = np.arange(data.shape[0]) / rate
    return tuple(
        MeasuredFunction(
            kind="response", abscissa=time, value=data[:, c] * full_scale[c if len(full_scale) > 1 else 0],
            quantity=None, output=None, input=None, source=f"{path}: channel {c + 1}",
        )
        for c in range(data.shape[1])
    )  # fmt: skip


def _content(path: Path) -> tuple[float, Reals]:
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
        raise MeasurementError(
            f"{path}: cannot be read as a WAV file: {getattr(error, 'strerror', None) or error}; expected the whole of "
            "a file of 8 to 64 bits, not compressed"
        ) from error


_Records = Mapping[str, NDArray[Any]]
_TIME = re.compile(r"^t$|time|zeit|^cas|^čas", re.IGNORECASE)
RATE = re.compile(
    r"^f_?s(amp\w*)?$|^s_?r(ate)?$|^rate$|^(?!no?_?samp|num|count)(?=.*sampl)(?!.*samples$)|samp_?(rate|f)|abtast|vzor",
    re.IGNORECASE,
)
"""What a sampling rate may be called; ``wf_samples`` and ``n_sample`` are counts of samples."""
_TIME_STEP = re.compile(r"^d_?t$|^delta_?t$|^t_?s$|interval|increment|^dx$", re.IGNORECASE)
_NO_HISTORY = re.compile(r"psd|csd|spec|auto|cross|corr|fft|coh|freq|mag|phase|window", re.IGNORECASE)
_NUMBERED = re.compile(
    r"(\(\d+\)|\{\d+\}|(?<!\d)(?<!Dev)(?<!DAQ)(?<!Mod)(?<!Slot)\d+(?=[^./@]*[./@]))"
)  # no numbers of devices, as in LabVIEW's cDAQ1Mod2/ai0
_OF_POINTS = r"point|node|dof|pos|punkt|knoten|to[cč]k|^p[^a-z]*$|^pt"
_FEWEST_SAMPLES = 64
PULSE = 0.02
"""Share of a record that the pulse of a hammer takes at most."""


@dataclass(frozen=True, kw_only=True)
class HistoriesFound:
    """Keys of ``[measurement.variables]``, lengths of axes, names of channels, runs, what was taken for granted."""

    keys: dict[str, Any]
    lengths: dict[str, int]
    titles: tuple[str, ...]
    n_run: int
    guesses: tuple[str, ...]


def pulse_share(value: Reals, *, of_a_pulse: float = 0.1) -> Reals:
    """Return the share of each record, (..., n_sample), in which it is above a tenth of its largest value: (...).

    The force of a hammer is a short pulse, a response rings on. 1 of a constant record, and of one that is not finite.

    `of_a_pulse`: share of the largest value above which a sample belongs to the pulse of a hammer.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        size = np.abs(value - np.median(value, axis=-1, keepdims=True))
    most = size.max(axis=-1, keepdims=True)
    varies = np.isfinite(most[..., 0]) & (most[..., 0] > 0)
    return np.asarray(np.where(varies, np.mean(size > of_a_pulse * most, axis=-1), 1.0))


def guess_histories(
    arrays: _Records, beside: Mapping[str, int], labels: Sequence[tuple[str, ...]] = ()
) -> HistoriesFound | None:
    """Return what arrays seem to hold of time histories; None where nothing in them tells of a time or a hammer.

    That something is a time history tells a variable of times, of a sampling rate or of a time step, a first channel
    that ascends in steps of a time, or a record with the short pulse of a hammer; or a file beside it.

    Parameters
    ----------
    arrays : mapping of str to array
    beside : mapping of str to int
        Lengths of the axes of a force in a file that belongs beside this one; empty where there is none.
    labels : sequence of tuple of str
        Lists of texts in the file: one for each channel of a single array names them.
    """
    guesses: list[str] = []
    every = tuple(arrays)
    arrays = _as_one(arrays)
    of_time = _time_record(arrays)
    keys = _sampling(arrays, guesses) if of_time is None else {"time": of_time}
    n_sample = None if of_time is None else arrays[of_time].size
    names = _records(arrays, of_time, n_sample)
    if not names:
        return None
    n_sample = max(arrays[names[0]].shape)
    records = {name: arrays[name].astype(float) for name in names}
    axes = _axes_beside(records, beside) if beside else _axes_of_records(records, n_sample, guesses)
    if axes is None:
        return None
    inside = not keys and _first_is_time(records[names[0]], axes)
    if inside:
        keys = {"time": FIRST_CHANNEL}
        guesses.append("the first channel is taken as the time in s")
    elif not keys and not beside and not any(_has_pulse(value, n_sample) for value in records.values()):
        return None
    titles = _titles(records, axes, inside=inside)
    if not any(titles):
        named = (texts[inside:] for texts in labels if len(texts) == len(titles) + inside)
        titles = next(named, titles)
    lengths = dict(zip(axes, (n for n in _largest(records).shape if n > 1), strict=True))
    axes = _axes_with_star(names[0], axes, guesses) + axes
    said = f"variables {', '.join(map(repr, names))} are" if len(names) > 1 else f"variable {names[0]!r} is"
    guesses.insert(0, f"{said} taken as time histories")
    return HistoriesFound(
        keys={"history": names if len(names) > 1 else names[0], "axes": axes} | (keys or {"sampling_Hz": UNKNOWN}),
        lengths=lengths,
        titles=titles,
        n_run=_runs(names[0], axes, every, records),
        guesses=tuple(guesses),
    )


def _as_one(arrays: _Records) -> _Records:
    """Return the first of arrays that differ in the number of a structure, cell or group alone, by a name with *."""
    alike: dict[str, list[str]] = {}
    for name in arrays:
        alike.setdefault(_NUMBERED.sub(_star, name), []).append(name)
    several = {_common(names): names for names in alike.values() if len(names) > 1}
    several = {name: names for name, names in several.items() if name.count("*") < 3}
    of_several = {names[0]: name for name, names in several.items()}
    left_out = {other for names in several.values() for other in names[1:]}
    return {of_several.get(name, name): value for name, value in arrays.items() if name not in left_out}


def _star(match: re.Match[str]) -> str:
    return re.sub(r"\d+", "*", match[0])


def _common(names: list[str]) -> str:
    """Return names that differ in their numbers as one, with * for each number that differs."""
    parts = zip(*(_NUMBERED.split(name) for name in names), strict=True)
    return "".join(words[0] if len(set(words)) == 1 else re.sub(r"\d+", "*", words[0]) for words in parts)


def _axes_with_star(name: str, axes: list[str], guesses: list[str]) -> list[str]:
    """Return the axis that each * of a name stands for: points where the name says so, else hits."""
    parts = [part for part in re.split(r"[./]", name) if "*" in part]
    kinds = ["run" if re.search(_OF_POINTS, part, re.IGNORECASE) or "hit" in axes else "hit" for part in parts]
    if kinds in (["hit", "hit"], ["run", "run"]):
        kinds = ["run", "hit"]
    if parts:
        guesses.append(f"{' and '.join(map(repr, parts))} in the names is taken as {', '.join(kinds)}")
    return kinds


def _runs(name: str, axes: list[str], every: tuple[str, ...], records: _Records) -> int:
    """Return how many runs there are: numbers of a name's * that stands for them, or the length of their axis."""
    if "run" not in axes:
        return 1
    place, count = axes.index("run"), name.count("*")
    if place < count:
        return len({match[place + 1] for other in every if (match := pattern_of(name).fullmatch(other))})
    shape = [n for n in max(records.values(), key=lambda v: v.ndim).shape if n > 1]
    return shape[place - count]


def _time_record(arrays: _Records) -> str | None:
    """Return the variable that holds the times: a vector that ascends and has a name of times."""
    for name, value in arrays.items():
        vector = value.size == max(value.shape, default=0) >= _FEWEST_SAMPLES and not np.iscomplexobj(value)
        if vector and _TIME.search(field_of(name)) and np.all(np.diff(value.ravel().astype(float)) >= 0):
            return name
    return None


def _sampling(arrays: _Records, guesses: list[str]) -> dict[str, Any]:
    """Return the key of the sampling rate: a variable with such a name, or the number that a time step gives."""
    numbers = {name: float(v.flat[0]) for name, v in arrays.items() if v.size == 1 and not np.iscomplexobj(v)}
    for name, value in numbers.items():
        if RATE.search(field_of(name)) and not _TIME_STEP.search(field_of(name)) and value > 1.0:
            return {"sampling_Hz": name}
    for name, value in numbers.items():
        if _TIME_STEP.search(field_of(name)) and 0.0 < value < 1.0:
            guesses.append(f"the sampling rate is one over variable {name!r}, {value:g} s")
            return {"sampling_Hz": float(f"{1.0 / value:.9g}")}
    return {}


def _records(arrays: _Records, of_time: str | None, n_sample: int | None) -> list[str]:
    """Return the variables of records as long as the times or, without these, as the longest; a force comes first."""
    real = {
        name: value for name, value in arrays.items()
        if value.size > 1 and value.dtype.kind in "fi" and name != of_time
        and not _NO_HISTORY.search(field_of(name)) and not _TIME.fullmatch(field_of(name))
        and max(value.shape) >= _FEWEST_SAMPLES and not _ascends(value)
    }  # fmt: skip
    if n_sample is None:
        n_sample = max((max(value.shape) for value in real.values()), default=0)
    records = [name for name, value in real.items() if n_sample in value.shape]
    forces = [name for name in records if FORCE.search(field_of(name))]
    return forces + [name for name in records if name not in forces]


def _ascends(value: NDArray[Any]) -> bool:
    """Tell whether a vector ascends, as frequencies do."""
    return value.size == max(value.shape) and bool(np.all(np.diff(value.ravel().astype(float)) > 0))


def _has_pulse(value: Reals, n_sample: int, *, fewest_of_a_pulse: int = 512) -> bool:
    """Tell whether some record of an array is at rest but for a short pulse, which no mode shape or spectrum of few is.

    `fewest_of_a_pulse`: samples of a record of which nothing but a pulse tells that it is one.
    """
    share = pulse_share(np.moveaxis(value, value.shape.index(n_sample), -1))
    return n_sample >= fewest_of_a_pulse and bool(np.any(share < PULSE))


def _axes_of_records(records: _Records, n_sample: int, guesses: list[str]) -> list[str]:
    """Return what the axes are of the array that has most of them."""
    largest = _largest(records)
    lengths = [n for n in largest.shape if n > 1]
    names = [UNKNOWN] * len(lengths)
    at = lengths.index(n_sample)
    names[at] = "time"
    rest = [k for k in range(len(lengths)) if k != at]
    smaller = [sum(n > 1 for n in v.shape) for v in records.values() if v.ndim]
    channel: int | None = None
    if (
        len(records) == 1
        and len(rest) == 1
        and np.all(pulse_share(np.moveaxis(largest.reshape(lengths), at, -1)) < PULSE)
    ):
        channel = None  # blows of a force that has a file of its own
    elif len(records) == 1 or any(n < len(lengths) for n in smaller):
        channel = _channel_axis(largest.reshape(lengths), at, rest, records)
    if channel is not None:
        names[channel] = "channel"
        rest.remove(channel)
    for k, name in zip(sorted(rest, key=lambda k: lengths[k]), ("hit", "run"), strict=False):
        names[k] = name
    if len(lengths) > 2 or rest:
        guesses.append(
            f'axes are taken as {", ".join(names)}; an axis of points, not of blows that are averaged, is "run"'
        )
    return names


def _largest(records: _Records) -> NDArray[Any]:
    """Return the array with most axes."""
    return max(records.values(), key=lambda v: sum(n > 1 for n in v.shape))


def _axes_beside(records: _Records, beside: Mapping[str, int]) -> list[str] | None:
    """Return what the axes are by those of a force: what is left is that of the channels; None where they differ."""
    lengths = [n for n in _largest(records).shape if n > 1]
    axes = ["channel"] * len(lengths)
    for name, length in beside.items():
        free = [k for k, n in enumerate(lengths) if n == length and axes[k] == "channel"]
        if not free:
            return None
        axes[free[0]] = name
    return axes if axes.count("channel") < 2 else None


def _channel_axis(value: Reals, at: int, rest: list[int], records: _Records) -> int | None:
    """Return the axis of the channels: what a smaller array, of a force, lacks, else along which one has pulses.

    Where it may lack several, it is the one without which its blows explain most of the responses.
    """
    if len(rest) < 2:
        return rest[0] if rest else None
    for force in records.values():
        shape = [n for n in force.shape if n > 1]
        lacking = [k for k in rest if sorted(n for j, n in enumerate(value.shape) if j != k) == sorted(shape)]
        if len(lacking) > 1:
            return max(lacking, key=lambda k: _explained(force.reshape(shape), np.moveaxis(value, [k, at], [0, -1])))
        if lacking:
            return lacking[0]
    share = pulse_share(np.moveaxis(value, at, -1))  # its axes are those of `rest`, in their order
    spread = [float(np.ptp(np.log(np.median(_flat(share, k), axis=1) + 1e-6))) for k in range(len(rest))]
    return rest[int(np.argmax(spread))]


def _explained(force: Reals, response: Reals) -> float:
    """Return the share of the power of responses, (n_channel, n_hit, n_sample), that a force, of each hit, explains."""
    of_force = np.fft.rfft(np.moveaxis(force, int(np.argmax(force.shape)), -1))
    of_response = np.fft.rfft(response)
    both = np.abs(np.sum(of_response * of_force.conj(), axis=1)) ** 2
    power = np.sum(np.abs(of_force) ** 2, axis=0)
    return float(np.sum(both / np.where(power > 0.0, power, 1.0)) / np.sum(np.abs(of_response) ** 2))


def _flat(share: Reals, axis: int) -> Reals:
    return np.moveaxis(share, axis, 0).reshape(share.shape[axis], -1)


def _first_is_time(value: Reals, axes: list[str], *, longest_sample: float = 2e-3) -> bool:
    """Tell whether the first channel ascends in steps that are those of a time.

    `longest_sample`: S, of a first channel that is taken for the time without being called so.
    """
    if "channel" not in axes:
        return False
    value = value.reshape([n for n in value.shape if n > 1])
    first = np.moveaxis(value, [axes.index("channel"), axes.index("time")], [0, -1])[0]
    step = np.diff(first.reshape(-1, first.shape[-1])[0])
    return bool(np.all(step >= 0) and 0 < np.median(step) <= longest_sample)


def _titles(records: _Records, axes: list[str], *, inside: bool) -> tuple[str, ...]:
    """Return a name for each channel: that of its variable, where this holds one, else none."""
    names: list[str] = []
    for name, value in records.items():
        shape = [n for n in value.shape if n > 1]
        n = shape[axes.index("channel")] if len(shape) == len(axes) and "channel" in axes else 1
        names += [field_of(name) if n == 1 else ""] * (n - inside)
    return tuple(names)
