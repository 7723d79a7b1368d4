"""Which variables of a MATLAB, HDF5, NumPy or TDMS file seem to hold FRFs, else time histories."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import prod
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ema.io.array_files import LARGEST, arrays_in
from ema.io.array_histories import pattern_of
from ema.io.contents import FORCE, UNKNOWN, Code, Contents, unit_in, with_names
from ema.io.guess_parts import magnitudes_alone, parts_of_frfs, table_of_frfs
from ema.io.variables import FIRST_CHANNEL, FIRST_COLUMN, WAYS
from ema.types.errors import MeasurementError

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


def pulse_share(value: NDArray[np.float64], *, of_a_pulse: float = 0.1) -> NDArray[np.float64]:
    """Return the share of each record, (..., n_sample), in which it is above a tenth of its largest value: (...).

    The force of a hammer is a short pulse, a response rings on. 1 of a constant record, and of one that is not finite.

    `of_a_pulse`: share of the largest value above which a sample belongs to the pulse of a hammer.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        size = np.abs(value - np.median(value, axis=-1, keepdims=True))
    most = size.max(axis=-1, keepdims=True)
    varies = np.isfinite(most[..., 0]) & (most[..., 0] > 0)
    return np.asarray(np.where(varies, np.mean(size > of_a_pulse * most, axis=-1), 1.0))


def guess_histories(arrays: _Records, beside: Mapping[str, int]) -> HistoriesFound | None:
    """Return what arrays seem to hold of time histories; None where nothing in them tells of a time or a hammer.

    That something is a time history tells a variable of times, of a sampling rate or of a time step, a first channel
    that ascends in steps of a time, or a record with the short pulse of a hammer; or a file beside it.

    Parameters
    ----------
    arrays : mapping of str to array
    beside : mapping of str to int
        Lengths of the axes of a force in a file that belongs beside this one; empty where there is none.
    """
    guesses: list[str] = []
    every = tuple(arrays)
    arrays = _as_one(arrays)
    of_time = _time(arrays)
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
    lengths = dict(zip(axes, (n for n in _largest(records).shape if n > 1), strict=True))
    axes = _starred(names[0], axes, guesses) + axes
    said = f"variables {', '.join(map(repr, names))} are" if len(names) > 1 else f"variable {names[0]!r} is"
    guesses.insert(0, f"{said} taken as time histories")
    return HistoriesFound(
        keys={"history": names if len(names) > 1 else names[0], "axes": axes}
        | (keys or {"sampling_Hz": UNKNOWN}),
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


def _starred(name: str, axes: list[str], guesses: list[str]) -> list[str]:
    """Return what the axes are that each * of a name stands for: points, where it says so, else hits."""
    parts = [part for part in re.split(r"[./]", name) if "*" in part]
    kinds = [
        "run" if re.search(_OF_POINTS, part, re.IGNORECASE) or "hit" in axes else "hit" for part in parts
    ]
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


def _time(arrays: _Records) -> str | None:
    """Return the variable of the times: a vector that ascends and is called so."""
    for name, value in arrays.items():
        vector = value.size == max(value.shape, default=0) >= _FEWEST_SAMPLES and not np.iscomplexobj(value)
        if vector and _TIME.search(_last(name)) and np.all(np.diff(value.ravel().astype(float)) >= 0):
            return name
    return None


def _sampling(arrays: _Records, guesses: list[str]) -> dict[str, Any]:
    """Return the key of the sampling rate: the variable that is called so, or the number that a time step gives."""
    numbers = {name: float(v.flat[0]) for name, v in arrays.items() if v.size == 1 and not np.iscomplexobj(v)}
    for name, value in numbers.items():
        if RATE.search(_last(name)) and not _TIME_STEP.search(_last(name)) and value > 1.0:
            return {"sampling_Hz": name}
    for name, value in numbers.items():
        if _TIME_STEP.search(_last(name)) and 0.0 < value < 1.0:
            guesses.append(f"the sampling rate is one over variable {name!r}, {value:g} s")
            return {"sampling_Hz": float(f"{1.0 / value:.9g}")}
    return {}


def _records(arrays: _Records, of_time: str | None, n_sample: int | None) -> list[str]:
    """Return the variables of records as long as the times or, without these, as the longest; a force comes first."""
    real = {
        name: value for name, value in arrays.items()
        if value.size > 1 and value.dtype.kind in "fi" and name != of_time
        and not _NO_HISTORY.search(_last(name)) and not _TIME.fullmatch(_last(name))
        and max(value.shape) >= _FEWEST_SAMPLES and not _ascends(value)
    }  # fmt: skip
    if n_sample is None:
        n_sample = max((max(value.shape) for value in real.values()), default=0)
    records = [name for name, value in real.items() if n_sample in value.shape]
    forces = [name for name in records if FORCE.search(_last(name))]
    return forces + [name for name in records if name not in forces]


def _ascends(value: NDArray[Any]) -> bool:
    """Whether a vector ascends, as frequencies do."""
    return value.size == max(value.shape) and bool(np.all(np.diff(value.ravel().astype(float)) > 0))


def _has_pulse(value: NDArray[np.float64], n_sample: int, *, fewest_of_a_pulse: int = 512) -> bool:
    """Whether some record of an array is at rest but for a short pulse, which no mode shape or spectrum of few is.

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
    smaller = [sorted(n for n in v.shape if n > 1) for v in records.values() if v.ndim]
    channel: int | None = None
    if (
        len(records) == 1
        and len(rest) == 1
        and np.all(pulse_share(np.moveaxis(largest.reshape(lengths), at, -1)) < PULSE)
    ):
        channel = None  # blows of a force that has a file of its own
    elif len(records) == 1 or any(len(shape) < len(lengths) for shape in smaller):
        channel = _channel_axis(largest.reshape(lengths), at, rest, smaller)
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


def _channel_axis(
    value: NDArray[np.float64], at: int, rest: list[int], smaller: list[list[int]]
) -> int | None:
    """Return the axis of the channels: what a smaller array, of a force, lacks, else along which one has pulses."""
    if len(rest) < 2:
        return rest[0] if rest else None
    for shape in smaller:
        lacking = [k for k in rest if sorted(n for j, n in enumerate(value.shape) if j != k) == shape]
        if lacking:
            return lacking[0]
    share = pulse_share(np.moveaxis(value, at, -1))  # its axes are those of `rest`, in their order
    spread = [float(np.ptp(np.log(np.median(_flat(share, k), axis=1) + 1e-6))) for k in range(len(rest))]
    return rest[int(np.argmax(spread))]


def _flat(share: NDArray[np.float64], axis: int) -> NDArray[np.float64]:
    return np.moveaxis(share, axis, 0).reshape(share.shape[axis], -1)


def _first_is_time(value: NDArray[np.float64], axes: list[str], *, longest_sample: float = 2e-3) -> bool:
    """Whether the first channel ascends in steps that are those of a time.

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
        names += [_last(name) if n == 1 else ""] * (n - inside)
    return tuple(names)


_Arrays = dict[str, NDArray[Any]]
_FRF = re.compile(
    r"frf|^h(f|\d+)?(_|$)|^tf|transf|recep|mobil|accelerance|inertance|compliance|^fresp|freqresp",
    re.IGNORECASE,
)
_SPECTRUM = re.compile(r"^[sgx]\d*(_\d+)?$|spec|psd|csd|cross|auto|fft|corr", re.IGNORECASE)
_OF_SPECTRA = re.compile(r"spec|psd|csd|cross|auto(?!mat)|corr(?!ect)", re.IGNORECASE)
_ESTIMATE = re.compile(
    r"(?:^|[_ ])H[12v]?(?=_|\d|$)"
)  # H1_2_1 in a name as FFT1_H1_2_1: it outweighs a word of spectra
_COHERENCE = re.compile(r"coh|gamma|^c\d+_\d+$", re.IGNORECASE)  # C1_2 of the analysers that write H1_2
_CIRCULAR = re.compile(r"^(w|om(ega)?)$", re.IGNORECASE)  # rad/s
_STEP = re.compile(
    r"^((x|wf)_?increment|increment|df|d_f|delta_?f|f_?step|freq\w*_?(step|res\w*|spacing)|resolution)$",
    re.IGNORECASE,
)
_START = re.compile(r"^(start(_value)?|f_?start|f_?min|f_?0|wf_start_offset)$", re.IGNORECASE)
_FEWEST_LINES = 10


def guess_variables(
    path: Path, *, matlab: bool, beside: Mapping[str, int] = MappingProxyType({})
) -> Contents:
    """Return what a MATLAB, HDF5, NumPy or TDMS file seems to hold, with `UNKNOWN` for what nothing in it looks like.

    The FRFs are the complex arrays that are called so, such as ``H1_2``, else the largest that is not called a
    spectrum, or two real ones whose names say so. Their frequencies are an ascending vector as long as one of their
    axes that is not called a circular frequency, or their first column. Coherences have their shape and are called
    so. Where there are no FRFs it may hold time histories, see `guess_histories`.

    Parameters
    ----------
    path : Path
    matlab : bool
        Whether MATLAB wrote it.
    beside : mapping of str to int
        Lengths of the axes of a force in a file that may belong beside this one.

    Raises
    ------
    MeasurementError
        The file cannot be read.
    """
    with arrays_in(path, matlab=matlab) as held:
        arrays = {name: array.read() for name, array in held.items() if 0 < prod(array.shape) <= LARGEST}
        units = {name: array.unit for name, array in held.items() if array.unit}
    if not arrays:
        message = f"{path}: holds no arrays of numbers; text and objects are not read"
        raise MeasurementError(message)
    with np.errstate(over="ignore", invalid="ignore"):  # of numbers that are not finite
        return _guess(path, arrays, units, beside)


def _guess(path: Path, arrays: _Arrays, units: Mapping[str, str], beside: Mapping[str, int]) -> Contents:
    """Return what the arrays of a file seem to hold."""
    keys, block, guesses = _frfs(arrays, units)
    if block is None and (table := _two_parts(arrays) or table_of_frfs(arrays)) is not None:
        keys, parts, guesses = table
        arrays |= parts
        block = parts[next(name for name in parts if name in keys.get("real", keys.get("magnitude", ())))]
    if block is None:
        histories = guess_histories(arrays, beside)
        if histories is not None:
            return Contents(
                file=path, section="variables", keys=histories.keys, is_time=True, titles=_with_units(histories, units),
                n_run=histories.n_run, lengths=histories.lengths, guesses=histories.guesses,
            )  # fmt: skip
        return Contents(
            file=path, section="variables", keys=keys | {"frequency": UNKNOWN}, dofs=((None, None),),
            guesses=tuple(guesses),
        )  # fmt: skip
    return replace(_of_frfs(path, arrays, keys, block, guesses), unit=_stated_unit(keys, units))


def _stated_unit(keys: Mapping[str, Any], units: Mapping[str, str]) -> str | None:
    """Return the unit of a response over a force that the file states of its FRFs, in one way of all of them."""
    names = next((keys[part] for way in WAYS for part in way[:1] if part in keys), ())
    stated = {units.get(name) for name in ((names,) if isinstance(names, str) else names)}
    label = next(iter(stated)) if len(stated) == 1 else None
    return None if label is None else unit_in(label)


def _with_units(histories: HistoriesFound, units: Mapping[str, str]) -> tuple[str, ...]:
    """Return the titles of channels, of which each is a variable whose unit the file states, with that unit."""
    history = histories.keys["history"]
    names = [history] if isinstance(history, str) else history
    if len(names) != len(histories.titles):
        return histories.titles
    of_arrays = [
        next((unit for v, unit in units.items() if pattern_of(name).fullmatch(v)), "") for name in names
    ]
    return tuple(
        f"{title} [{unit}]" if unit else title
        for title, unit in zip(histories.titles, of_arrays, strict=True)
    )


def _of_frfs(
    path: Path, arrays: _Arrays, keys: dict[str, Any], block: NDArray[Any], guesses: list[str]
) -> Contents:
    """Return what a file with FRFs, of the shape of `block`, holds beside them."""
    parts = [key for keys_ in WAYS for key in keys_ if key in keys]
    names = keys[parts[0]]
    own_column = _is_axis(block)
    used = {name for part in parts for name in keys[part]}
    frequency = FIRST_COLUMN if own_column else _frequency(arrays, block.shape, used)
    steps = {} if frequency else _steps(arrays, max(block.shape), guesses)
    keys |= steps if steps else {"frequency": frequency or UNKNOWN}
    shape = (block.shape[0], block.shape[1] - 1) if own_column else block.shape
    # Where nothing tells the frequencies, functions have more lines than there are functions.
    n_line = arrays[frequency].size if frequency in arrays else shape[0] if own_column else max(shape)
    columns = own_column or (len(names) > 1 and shape[0] == n_line)
    axes = ["frequency", "output"] if columns else _axes(shape, n_line)
    keys["axes"] = axes
    if own_column:
        guesses.append("the first column of the FRFs is taken as their frequencies")
    elif len(axes) > 1:
        guesses.append(f"axes are taken as {', '.join(axes)} by their lengths")
    coherence = _coherences(arrays, block, names)
    if coherence:
        keys["coherence"] = coherence if len(coherence) > 1 else coherence[0]
    if len(names) == 1:
        keys |= {part: keys[part][0] for part in parts}
    lengths = dict(zip(axes, [n for n in shape if n > 1], strict=False))
    n_output, n_input = lengths.get("output", 1) * max(len(names), 1), lengths.get("input", 1)
    states = frozenset(
        end for end, n in (("output", n_output), ("input", n_input)) if _place(arrays, keys, end, n)
    )
    none: list[list[Code]] = [[] for _ in range(n_output * n_input)]
    dofs, named = with_names(path, none)
    return Contents(
        file=path, section="variables", keys=keys, dofs=dofs, states=states, guesses=(*guesses, *named)
    )


def _frfs(
    arrays: _Arrays, units: Mapping[str, str], *, listed: int = 6
) -> tuple[dict[str, Any], NDArray[Any] | None, list[str]]:
    """Return the keys of the FRFs, an array in their shape, and what was guessed.

    `listed`: names of variables in a comment.
    """
    whole = {name: v for name, v in arrays.items() if np.iscomplexobj(v) and v.size > 1}
    spectra = [n for n in whole if _is_spectrum(n)]
    called = [
        name
        for name in whole
        if name not in spectra
        and (_ESTIMATE.search(_last(name)) or any(map(_FRF.search, re.split(r"[./]", name))))
    ]
    free = called or [name for name in whole if name not in spectra]
    if free:
        first = max(free, key=lambda n: whole[n].size)
        alike = [
            n for n in free if _numberless(n) == _numberless(first) and whole[n].shape == whole[first].shape
        ]
        names = alike if len(alike) > 1 and max(_counts(whole[first])) == 1 else [first]
        others = [name for name in whole if name not in names][:listed]
        said = f"variable{'s' * (len(names) > 1)} {', '.join(map(repr, names))} {'are' if len(names) > 1 else 'is'}"
        beside = f"; other complex variables are {', '.join(map(repr, others))}" if others else ""
        return {"frf": names}, whole[first], [f"{said} taken as the FRFs{beside}"]
    if (parts := parts_of_frfs(arrays, units)) is not None:
        return parts
    said = f"complex variables {', '.join(map(repr, spectra[:listed]))} look like spectra" if spectra else ""
    said = said or magnitudes_alone(arrays)
    return {"frf": UNKNOWN}, None, [said] if said else []


def _two_parts(arrays: _Arrays) -> tuple[dict[str, Any], _Arrays, list[str]] | None:
    """Return what `table_of_frfs` does, of arrays that are called FRFs and hold both parts in two columns.

    Their frequencies are steps that the file states as numbers.
    """
    names = [
        name for name, value in arrays.items()
        if _FRF.search(_last(name)) and value.dtype.kind == "f" and value.ndim == 2
        and value.shape[1] == 2 and value.shape[0] >= _FEWEST_LINES
    ]  # fmt: skip
    names = [name for name in names if arrays[name].shape == arrays[names[0]].shape]
    if not names or not _steps(arrays, arrays[names[0]].shape[0], []):
        return None
    parts = {f"{name}[:, {k}]": arrays[name][:, k] for name in names for k in (0, 1)}
    keys = {key: [f"{name}[:, {k}]" for name in names] for k, key in enumerate(WAYS[1])}
    said = ", ".join(map(repr, names))
    return keys, parts, [f"the two columns of {said} are taken as real and imaginary parts"]


def _is_spectrum(name: str) -> bool:
    """Whether a name, or that of the structure that it is in, is one of spectra and not of FRFs."""
    if _ESTIMATE.search(_last(name)) or _SPECTRUM.search(_last(name)):
        return not _ESTIMATE.search(_last(name))
    parts = re.split(r"[./@]", name)
    return any(map(_OF_SPECTRA.search, parts)) and not any(map(_FRF.search, parts))


def _last(name: str) -> str:
    """Return the name of a field without those of the structures that it is in."""
    return re.split(r"[./@]", name)[-1]


def _numberless(name: str) -> str:
    return re.sub(r"\d+", "#", name)


def _counts(value: NDArray[Any]) -> list[int]:
    """Return how many functions an array may hold along each axis beside its longest."""
    shape = (value.shape[0], value.shape[1] - 1) if _is_axis(value) else value.shape
    return sorted(shape)[:-1] or [1]


def _is_axis(value: NDArray[Any]) -> bool:
    """Whether the first column of a long array ascends and is real, as frequencies do."""
    if value.ndim != 2 or not 1 < value.shape[1] < value.shape[0] or value.shape[0] < _FEWEST_LINES:
        return False
    first = value[:, 0]
    return not np.any(first.imag) and bool(first[0].real >= 0 and np.all(np.diff(first.real) > 0))


def _coherences(arrays: _Arrays, block: NDArray[Any], frfs: list[str]) -> list[str]:
    """Return the variables of the coherences: those that are called so, one for each of the FRFs."""
    called = [
        name for name, value in arrays.items()
        if value.shape == block.shape and not np.iscomplexobj(value) and _COHERENCE.search(_last(name))
    ]  # fmt: skip
    if len(frfs) <= 1:
        number = re.findall(r"\d+", frfs[0]) if frfs else []
        same = [name for name in called if re.findall(r"\d+", name) == number]
        return (same or called)[:1]
    of_number = {tuple(re.findall(r"\d+", name)): name for name in called}
    coherences = [of_number.get(tuple(re.findall(r"\d+", name))) for name in frfs]
    return [name for name in coherences if name is not None] if None not in coherences else []


def _frequency(arrays: _Arrays, shape: tuple[int, ...], used: set[str]) -> str | None:
    """Return the name of an ascending vector as long as an axis; one that is named like it comes first.

    `used`: names of the FRFs, which are none.
    """
    fits = [
        name for name, value in arrays.items()
        if name not in used and value.size == max(value.shape, default=0) > 1 and value.size in shape
        and not np.iscomplexobj(value) and not _CIRCULAR.search(_last(name))
        and (np.all(np.diff(value.ravel().astype(float)) > 0) or np.all(np.diff(value.ravel().astype(float)) < 0))
    ]  # fmt: skip
    named = [name for name in fits if re.search(r"(?:^|[._/])f(?:req\w*)?$|freq|hz", name, re.IGNORECASE)]
    if not fits and (beside := _of_sdt(arrays, shape)) is not None:
        return beside
    return next(iter(named), None) or max(fits, key=lambda name: arrays[name].size, default=None)


def _of_sdt(arrays: _Arrays, shape: tuple[int, ...]) -> str | None:
    """Return the frequencies of the Structural Dynamics Toolbox, which calls those in Hz w, beside its functions xf."""
    names = (f"{name.removesuffix('.xf')}.w" for name in arrays if name.endswith(".xf"))
    return next((name for name in names if name in arrays and arrays[name].size in shape), None)


def _steps(arrays: _Arrays, n_line: int, guesses: list[str]) -> dict[str, float]:
    """Return the keys of frequencies that a file holds as numbers: a step and perhaps a start, or a sampling rate."""
    numbers = {
        name: float(value.flat[0])
        for name, value in arrays.items()
        if value.size == 1 and not np.iscomplexobj(value)
    }
    for name, step in numbers.items():
        if _STEP.search(_last(name)) and step > 0.0:
            beside = {other: value for other, value in numbers.items() if _START.search(_last(other))}
            guesses.append(f"the frequencies come in steps of variable {name!r}")
            return {"axis_step": step} | ({"axis_start": next(iter(beside.values()))} if beside else {})
    for name, rate in numbers.items():
        if RATE.search(_last(name)) and rate > 1.0 and n_line > 1:
            guesses.append(f"the frequencies reach from 0 to half of the sampling rate, variable {name!r}")
            return {"axis_step": float(f"{rate / (2 * (n_line - 1)):.12g}")}
    return {}


def _axes(shape: tuple[int, ...], n_line: int) -> list[str]:
    """Return what the axes longer than one are: beside the frequency the longest are the outputs."""
    lengths = [n for n in shape if n > 1]
    axes = [UNKNOWN] * len(lengths)
    axes[lengths.index(n_line)] = "frequency"
    for name in ("output", "input"):
        free = [k for k, axis in enumerate(axes) if axis == UNKNOWN]
        if free:
            axes[max(free, key=lambda k: lengths[k])] = name
    return axes


def _place(arrays: _Arrays, keys: dict[str, Any], end: str, count: int) -> bool:
    """Add the variables of points, and of directions, whose names and lengths fit; say whether points are there."""
    variables: dict[str, str] = {}
    for key, what in (("point", r"point|node|dof"), ("direction", r"dir")):
        for name, value in arrays.items():
            words = re.split(r"[^a-z]+", re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name).lower())
            is_input = any(word.startswith(("in", "ref", "force", "exc", "shak")) for word in words)
            fits = re.search(what, name, re.IGNORECASE) and is_input == (end == "input")
            whole = value.size == count and not np.iscomplexobj(value) and np.all(value == np.round(value))
            if fits and whole and (key == "point" or np.all(np.isin(np.abs(value), (1, 2, 3)))):
                variables.setdefault(f"{end}_{key}", name)
    if f"{end}_point" not in variables:
        return False
    keys.update({f"{end}_direction": UNKNOWN} | variables)
    return True
