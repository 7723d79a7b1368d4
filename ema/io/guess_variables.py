"""Which variables of a MATLAB, HDF5, NumPy or TDMS file seem to hold FRFs, whole or in parts, else time histories."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import replace
from math import prod
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ema.io.array_files import LARGEST, arrays_in, labels_in, pattern_of
from ema.io.array_histories import RATE, HistoriesFound, guess_histories
from ema.io.files import (
    UNKNOWN,
    Code,
    Contents,
    dofs_in,
    field_of,
    is_other_ratio,
    natural,
    polar_units,
    unit_in,
    volts_in,
    with_names,
)
from ema.io.measured_function import is_uneven
from ema.io.rows import FEWEST_ROWS
from ema.io.variables import FIRST_COLUMN, WAYS
from ema.types.errors import MeasurementError
from lamella_shared import Reals

_Arrays = dict[str, NDArray[Any]]
_FRF = re.compile(
    r"frf|^h(f|\d+)?(_|$)|^tf|transf|recep|mobil|accelerance|inertance|compliance|^fresp|freqresp", re.IGNORECASE
)
_SPECTRUM = re.compile(r"^[sgx]\d*(_\d+)?$|spec|psd|csd|cross|auto|fft|corr", re.IGNORECASE)
_OF_SPECTRA = re.compile(r"spec|psd|csd|cross|auto(?!mat)|corr(?!ect)", re.IGNORECASE)
_ESTIMATE = re.compile(
    r"(?:^|[_ ])H[12v]?(?=_|\d|$)"
)  # H1_2_1 in a name as FFT1_H1_2_1: it outweighs a word of spectra
_COHERENCE = re.compile(r"coh|gamma|^c\d+_\d+$", re.IGNORECASE)  # C1_2 of the analysers that write H1_2
_CIRCULAR = re.compile(r"^(w|om(ega)?)$|omega|rad_?(per_?)?s(ec)?$|kreisfreq|circ\w*freq", re.IGNORECASE)  # rad/s
_OF_FREQUENCY = re.compile(r"(?:^|[._/])f(?:req\w*)?$|freq|hz", re.IGNORECASE)
_STEP = re.compile(
    r"^((x|wf)_?increment|increment|df|d_f|delta_?f|f_?step|freq\w*_?(step|res\w*|spacing)|resolution)$", re.IGNORECASE
)
_START = re.compile(r"^(start(_value)?|f_?start|f_?min|f_?0|wf_start_offset)$", re.IGNORECASE)
_OF_MODES = re.compile(
    r"^(f_?n|w_?n|omega_?n?|freqs?|frequenc(y|ies)|.*nat\w*freq\w*|lamb(da|d)s?|poles?|eigen\w*)$", re.IGNORECASE
)
_SHAPES = re.compile(r"shape|^phi|^psi|^ms$|^mode|eigenvec", re.IGNORECASE)


def guess_variables(path: Path, *, matlab: bool, beside: Mapping[str, int] = MappingProxyType({})) -> Contents:
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
        raise MeasurementError(
            f"{path}: holds no arrays of numbers; text and objects, such as a dict that numpy.save pickled, are not "
            "read: write arrays, such as numpy.savez(file, frf=..., freq=...)"
        )
    with np.errstate(over="ignore", invalid="ignore"):  # of numbers that are not finite
        return _guess(path, arrays, units, beside)


def _guess(path: Path, arrays: _Arrays, units: Mapping[str, str], beside: Mapping[str, int]) -> Contents:
    """Return what the arrays of a file seem to hold."""
    _require_no_modes(path, arrays)
    keys, block, guesses = _frfs(arrays, units)
    if block is None and (table := _two_parts(arrays) or _parts_along_an_axis(arrays) or table_of_frfs(arrays)):
        keys, parts, guesses = table
        arrays |= parts
        block = parts[next(name for name in parts if name in keys.get("real", keys.get("magnitude", ())))]
    if block is None:
        histories = guess_histories(arrays, beside, labels_in(path))
        if histories is not None:
            return Contents(
                file=path, section="variables", keys=histories.keys, is_time=True, titles=_with_units(histories, units),
                n_run=histories.n_run, lengths=histories.lengths, guesses=histories.guesses,
            )  # fmt: skip
        return Contents(
            file=path, section="variables", keys=keys | {"frequency": UNKNOWN}, dofs=((None, None),),
            guesses=tuple(guesses),
        )  # fmt: skip
    contents = _of_frfs(path, arrays, keys, block, guesses)
    label = _stated_unit(keys, units)
    if label and is_other_ratio(label):
        raise MeasurementError(
            f"{path}: states the unit {label!r} of {keys.get('frf')!r}, which is no response over a force; export "
            "FRFs, response over force"
        )
    return replace(contents, unit=unit_in(label), odd_unit=volts_in(label))


def _require_no_modes(path: Path, arrays: _Arrays) -> None:
    """Refuse a file of modes: one number of each mode that is called a frequency or a pole, and shapes of as many."""
    most_modes = 200
    for name, value in arrays.items():
        n_mode = value.size
        if not (1 < n_mode == max(value.shape, default=0) <= most_modes and _OF_MODES.search(field_of(name))):
            continue
        shapes = [
            other for other, shape in arrays.items()
            if shape.ndim == 2 and n_mode in shape.shape and shape.size > n_mode and _SHAPES.search(field_of(other))
        ]  # fmt: skip
        if shapes:
            raise MeasurementError(
                f"{path}: holds modes ({name!r}, {shapes[0]!r}), and no points: write them as a table, with "
                "frequency_Hz, damping and a column for each DOF such as 12+z, or as universal file (55, 2414)"
            )


def _stated_unit(keys: Mapping[str, Any], units: Mapping[str, str]) -> str:
    """Return the unit that the file states of its FRFs, in one way of all of them; empty where it does not.

    Where it states none of these, that of a header beside them, if only one is of FRFs.
    """
    names = next((keys[part] for way in WAYS for part in way[:1] if part in keys), ())
    stated = {units.get(name, "") for name in ((names,) if isinstance(names, str) else names)}
    if stated != {""}:
        return next(iter(stated)) if len(stated) == 1 else ""
    beside = {label for label in units.values() if unit_in(label) is not None}
    return next(iter(beside)) if len(beside) == 1 else ""


def _with_units(histories: HistoriesFound, units: Mapping[str, str]) -> tuple[str, ...]:
    """Return the titles of channels, of which each is a variable whose unit the file states, with that unit."""
    history = histories.keys["history"]
    names = [history] if isinstance(history, str) else history
    if len(names) != len(histories.titles):
        return histories.titles
    of_arrays = [next((unit for v, unit in units.items() if pattern_of(name).fullmatch(v)), "") for name in names]
    return tuple(
        f"{title} [{unit}]" if unit else title for title, unit in zip(histories.titles, of_arrays, strict=True)
    )


def _of_frfs(path: Path, arrays: _Arrays, keys: dict[str, Any], block: NDArray[Any], guesses: list[str]) -> Contents:
    """Return what a file with FRFs, of the shape of `block`, holds beside them."""
    parts = [key for keys_ in WAYS for key in keys_ if key in keys]
    names = keys[parts[0]]
    own_column = _is_axis(block)
    if not own_column and len(names) == 1:
        block = _one_sided(arrays, keys, block, guesses)
        names = keys[parts[0]]
    used = {name for part in parts for name in keys[part]}
    frequency = FIRST_COLUMN if own_column else _frequency(arrays, block.shape, used)
    steps = {} if frequency else _circular(arrays, block.shape, guesses)
    steps = steps if frequency or steps else _steps(arrays, max(block.shape), guesses)
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
    states = frozenset(end for end, n in (("output", n_output), ("input", n_input)) if _place(arrays, keys, end, n))
    none: list[list[Code]] = [[] for _ in range(n_output * n_input)]
    in_names = [dofs_in(name) for name in names] if len(names) == n_output * n_input else none
    dofs, named = with_names(path, in_names)
    if any(in_names):
        named.append("DOFs are taken from the names of the variables, the response first")
    return Contents(
        file=path, section="variables", keys=keys, dofs=dofs, states=states, lengths={"frequency": n_line},
        guesses=(*guesses, *named),
    )  # fmt: skip


def _frfs(
    arrays: _Arrays, units: Mapping[str, str], *, listed: int = 6
) -> tuple[dict[str, Any], NDArray[Any] | None, list[str]]:
    """Return the keys of the FRFs, an array in their shape, and what was guessed.

    `listed`: names of variables in a comment.
    """
    whole = {name: v for name, v in arrays.items() if np.iscomplexobj(v) and v.size > 1}
    spectra = [n for n in whole if _is_spectrum(n)] if not np.any(arrays.get("tfun", 0)) else []
    called = [
        name
        for name in whole
        if name not in spectra and (_ESTIMATE.search(field_of(name)) or any(map(_FRF.search, re.split(r"[./]", name))))
    ]
    free = called or [name for name in whole if name not in spectra]
    if free:
        first = max(free, key=lambda n: whole[n].size)
        alike = [n for n in free if _numberless(n) == _numberless(first) and whole[n].shape == whole[first].shape]
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
        if _FRF.search(field_of(name)) and value.dtype.kind == "f" and value.ndim == 2
        and value.shape[1] == 2 and value.shape[0] >= FEWEST_ROWS
    ]  # fmt: skip
    names = [name for name in names if arrays[name].shape == arrays[names[0]].shape]
    if not names or not _steps(arrays, arrays[names[0]].shape[0], []):
        return None
    parts = {f"{name}[:, {k}]": arrays[name][:, k] for name in names for k in (0, 1)}
    keys = {key: [f"{name}[:, {k}]" for name in names] for k, key in enumerate(WAYS[1])}
    said = ", ".join(map(repr, names))
    return keys, parts, [f"the two columns of {said} are taken as real and imaginary parts"]


def _parts_along_an_axis(arrays: _Arrays) -> tuple[dict[str, Any], _Arrays, list[str]] | None:
    """Return what `table_of_frfs` does, of a real array that is called FRFs and has its parts along an axis of two.

    Both parts of an FRF are negative somewhere and positive elsewhere, as magnitudes, phases from 0 and dB are not.
    """
    for name, value in arrays.items():
        if value.dtype.kind != "f" or value.ndim < 2 or not _FRF.search(field_of(name)):
            continue
        for at in (value.ndim - 1, 0):
            parts = np.moveaxis(value, at, 0)
            rest = [part.ravel() for part in parts] if len(parts) == 2 else []
            fits = value.ndim > 2 or _frequency(arrays, parts.shape[1:], {name}) is not None
            if not rest or not fits or not all(part.min() < 0.0 < part.max() for part in rest):
                continue
            names = [
                f"{name}[{', '.join(str(k) if axis == at else ':' for axis in range(value.ndim))}]" for k in (0, 1)
            ]
            keys = {key: [part] for key, part in zip(WAYS[1], names, strict=True)}
            said = f"the {'last' if at else 'first'} axis of variable {name!r} is taken as real and imaginary part"
            return keys, dict(zip(names, parts, strict=True)), [said]
    return None


def _is_spectrum(name: str) -> bool:
    """Whether a name, or that of the structure that it is in, is one of spectra and not of FRFs."""
    if _ESTIMATE.search(field_of(name)) or _SPECTRUM.search(field_of(name)):
        return not _ESTIMATE.search(field_of(name))
    parts = re.split(r"[./@]", name)
    return any(map(_OF_SPECTRA.search, parts)) and not any(map(_FRF.search, parts))


def _numberless(name: str) -> str:
    return re.sub(r"\d+", "#", name)


def _counts(value: NDArray[Any]) -> list[int]:
    """Return how many functions an array may hold along each axis beside its longest."""
    shape = (value.shape[0], value.shape[1] - 1) if _is_axis(value) else value.shape
    return sorted(shape)[:-1] or [1]


def _is_axis(value: NDArray[Any]) -> bool:
    """Whether the first column of a long array ascends and is real, as frequencies do."""
    if value.ndim != 2 or not 1 < value.shape[1] < value.shape[0] or value.shape[0] < FEWEST_ROWS:
        return False
    first = value[:, 0]
    return not np.any(first.imag) and bool(first[0].real >= 0 and np.all(np.diff(first.real) > 0))


def _coherences(arrays: _Arrays, block: NDArray[Any], frfs: list[str]) -> list[str]:
    """Return the variables of the coherences: those that are called so, one for each of the FRFs."""
    called = [
        name for name, value in arrays.items()
        if value.shape == block.shape and not np.iscomplexobj(value) and _COHERENCE.search(field_of(name))
    ]  # fmt: skip
    called = [name for name in called if not _is_even_axis(arrays[name])] or called
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
        and not np.iscomplexobj(value) and not _CIRCULAR.search(field_of(name))
        and (np.all(np.diff(value.ravel().astype(float)) > 0) or np.all(np.diff(value.ravel().astype(float)) < 0))
    ]  # fmt: skip
    named = [name for name in fits if _OF_FREQUENCY.search(name)]
    if not fits and (beside := _of_sdt(arrays, shape)) is not None:
        return beside
    return next(iter(named), None) or max(fits, key=lambda name: arrays[name].size, default=None)


def _circular(arrays: _Arrays, shape: tuple[int, ...], guesses: list[str]) -> dict[str, float]:
    """Return the keys of even frequencies that a vector gives in rad/s; none where there is no such vector."""
    for name, value in arrays.items():
        is_vector = value.size == max(value.shape, default=0) > 1 and value.size in shape
        if not is_vector or np.iscomplexobj(value) or not _CIRCULAR.search(field_of(name)):
            continue
        hertz = value.ravel().astype(float) / (2.0 * np.pi)
        if np.all(np.diff(hertz) > 0.0) and not is_uneven(hertz):
            guesses.append(f"the frequencies are variable {name!r}, in rad/s, over 2 pi")
            return axis_keys(hertz)
    return {}


def lone_axis(path: Path, *, matlab: bool) -> Reals | None:
    """Return the only array of a file where it is a vector that ascends evenly, as frequencies do; else None."""
    try:
        with arrays_in(path, matlab=matlab) as held:
            arrays = [array.read() for array in held.values() if 1 < prod(array.shape) <= LARGEST]
    except MeasurementError:
        return None
    if len(arrays) != 1 or arrays[0].size != max(arrays[0].shape) or np.iscomplexobj(arrays[0]):
        return None
    axis = arrays[0].ravel().astype(float)
    return axis if np.all(np.diff(axis) > 0.0) and not is_uneven(axis) else None


def axis_keys(frequency: Reals) -> dict[str, float]:
    """Return the keys of even frequencies, Hz: their first and their step."""
    step = (frequency[-1] - frequency[0]) / (frequency.size - 1)
    return {"axis_start": float(f"{frequency[0]:.12g}"), "axis_step": float(f"{step:.12g}")}


def _one_sided(arrays: _Arrays, keys: dict[str, Any], block: NDArray[Any], guesses: list[str]) -> NDArray[Any]:
    """Return the lines of a block at frequencies of 0 Hz and above, where the file holds those below as well.

    Keys and arrays then hold the names of these parts.
    """
    for name, value in dict(arrays).items():
        is_vector = value.size == max(value.shape, default=0) > 2 and value.size in block.shape
        if not is_vector or np.iscomplexobj(value) or not _OF_FREQUENCY.search(name):
            continue
        there = np.flatnonzero(value.ravel() >= 0.0)
        if there.size < 2 or there.size == value.size or np.any(np.diff(there) != 1):
            continue
        part = f"{there[0]}:{there[-1] + 1}"
        at = block.shape.index(value.size)
        places = ", ".join(part if axis == at else ":" for axis in range(block.ndim))
        along = ", ".join(part if n == value.size else "0" for n in value.shape)  # MATLAB has no vectors, only columns
        arrays[f"{name}[{along}]"] = value.ravel()[there]
        for key in (key for way in WAYS for key in way if key in keys):
            keys[key] = [f"{keys[key][0]}[{places}]"]
        guesses.append(f"of variable {name!r} the frequencies of 0 Hz and above are taken: it is two-sided")
        block = np.take(block, there, axis=at)
    return block


def _of_sdt(arrays: _Arrays, shape: tuple[int, ...]) -> str | None:
    """Return the frequencies of the Structural Dynamics Toolbox, which calls those in Hz w, beside its functions xf."""
    names = (f"{name.removesuffix('.xf')}.w" for name in arrays if name.endswith(".xf"))
    return next((name for name in names if name in arrays and arrays[name].size in shape), None)


def _steps(arrays: _Arrays, n_line: int, guesses: list[str]) -> dict[str, float]:
    """Return the keys of frequencies that a file holds as numbers: a step and perhaps a start, or a sampling rate."""
    numbers = {
        name: float(value.flat[0]) for name, value in arrays.items() if value.size == 1 and not np.iscomplexobj(value)
    }
    for name, step in numbers.items():
        if _STEP.search(field_of(name)) and step > 0.0:
            beside = {other: value for other, value in numbers.items() if _START.search(field_of(other))}
            guesses.append(f"the frequencies come in steps of variable {name!r}")
            return {"axis_step": step} | ({"axis_start": next(iter(beside.values()))} if beside else {})
    of_record = 2.0 * (n_line - 1) in numbers.values()  # how many samples it has: a single frequency is their rate
    for name, rate in numbers.items():
        is_rate = RATE.search(field_of(name)) or (of_record and _OF_FREQUENCY.search(field_of(name)))
        if is_rate and rate > 1.0 and n_line > 1:
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


_Rest = tuple[str, ...]
_WORDS = {
    "real": r"re|real|realpart|realteil",
    "imaginary": r"im|imag|imaginary|imagpart|imaginaerteil|imaginärteil",
    "magnitude": r"m|mag|magn|magnitude|a|amp|ampl|amplitude|amplituda|abs|absolute|modulus|mod|betrag|db|lin|linear",
    "phase": r"p|ph|pha|phase|phas|phi|phs|ang|angle|arg|faza|winkel|deg|degree|degrees|rad|radian|radians",
}
"""What a part may be called, as a word of a name; its unit stands for it."""
_ENDS = {
    "real": r"(?:real|re)$",
    "imaginary": r"(?:imag|im)$",
    "magnitude": r"(?:mag|magnitude|amp|amplitude|abs)$",
    "phase": r"(?:phase|pha|phi|ang|angle)$",
}
"""How a name ends that is written as one word, such as ``Hmag``."""
_NO_FRF = re.compile(r"spec|psd|csd|cross|auto|fft|corr|coh", re.IGNORECASE)
LONGEST_SAMPLE = 2e-3
"""Longest step of an axis without a name, s, that is one of time: as a step of Hz it would ask for records of 500 s."""


def parts_of_frfs(arrays: _Arrays, units: Mapping[str, str]) -> tuple[dict[str, Any], NDArray[Any], list[str]] | None:
    """Return keys of the FRFs, an array in their shape, and what was guessed; None where no two arrays are a pair.

    Two arrays are a pair where they have the same shape and the same name but for a word, such as ``H_mag`` and
    ``H_phase_deg``. Pairs that differ in a number alone hold outputs of their own.

    Parameters
    ----------
    arrays : mapping of str to array
    units : mapping of str to str
        Units of arrays that the file states.
    """
    for keys in WAYS[1:]:
        pairs = _pairs(arrays, keys)
        pairs = [pair for pair in pairs if not any(_is_even_axis(arrays[name]) for name in pair)] or pairs
        if not pairs:
            continue
        first = max(pairs, key=lambda pair: arrays[pair[0]].size)
        shape = arrays[first[0]].shape
        alike = [
            p for p in pairs if [*map(_numberless, p)] == [*map(_numberless, first)] and arrays[p[0]].shape == shape
        ]
        is_vector = max(shape) == arrays[first[0]].size
        used = sorted(alike, key=lambda pair: natural(pair[0])) if is_vector else [first]
        keys_of_parts: dict[str, Any] = {key: [pair[k] for pair in used] for k, key in enumerate(keys)}
        said = ", ".join(f"{a!r} and {b!r}" for a, b in used)
        guesses = [f"variables {said} are taken as {keys[0]} and {keys[1]} of the FRFs"]
        if keys[0] == "magnitude":
            titles = [" ".join(f"{p[k]} {units.get(p[k], '')}" for p in used) for k in (0, 1)]
            size, phase = (np.concatenate([arrays[p[k]].ravel() for p in used]) for k in (0, 1))
            keys_of_parts |= polar_units((titles[0], titles[1]), size.astype(float), phase.astype(float), guesses)
        return keys_of_parts, arrays[first[0]], guesses
    return None


def table_of_frfs(
    arrays: _Arrays, *, full_turn: float = 360.0
) -> tuple[dict[str, Any], dict[str, NDArray[Any]], list[str]] | None:
    """Return keys of FRFs that stand beside their frequencies in one real array, its parts, and what was guessed.

    The first column, or row, ascends in steps that are none of a time; pairs of real and imaginary parts, or of
    magnitudes and phases, follow it. None where no array is like this.

    `full_turn`: degrees, which no phase exceeds.
    """
    tables = {n: v for n, v in arrays.items() if _is_function(n, v) and v.ndim == 2 and min(v.shape) % 2}
    for name, value in sorted(tables.items(), key=lambda column: -column[1].size):
        along = int(np.argmax(value.shape))
        columns = value if along == 0 else value.T
        axis = columns[:, 0].astype(float)
        if columns.shape[1] < 3 or axis[0] < 0.0 or not np.all(np.diff(axis) > 0.0):
            continue
        if float(np.diff(axis).mean()) <= LONGEST_SAMPLE:
            continue  # a time
        first, second = columns[:, 1::2].astype(float), columns[:, 2::2].astype(float)
        is_polar = bool(np.all(first >= 0.0)) and 1.0 < float(np.max(np.abs(second))) <= full_turn
        kinds, guesses = (WAYS[2] if is_polar else WAYS[1]), list[str]()
        places = [f"{name}[:, {column}]" if along == 0 else f"{name}[{column}]" for column in ("0", "1::2", "2::2")]
        keys: dict[str, Any] = {kinds[0]: [places[1]], kinds[1]: [places[2]], "frequency": places[0]}
        guesses.append(
            f"the {'columns' if along == 0 else 'rows'} of variable {name!r} are taken as frequency, {kinds[0]} and "
            f"{kinds[1]}"
        )
        if is_polar:
            keys |= polar_units(("", ""), first, second, guesses)
        return keys, dict(zip(places, (axis, first, second), strict=True)), guesses
    return None


def magnitudes_alone(arrays: _Arrays) -> str:
    """Say which arrays look like magnitudes or parts whose other part is not there; empty where none does."""
    alone = [
        name
        for name, value in arrays.items()
        if _is_function(name, value)
        and any(re.fullmatch(r"mag\w*|amp\w*|abs|db|modulus|betrag|re|real", word) for word in _words(name))
    ]
    if not alone:
        return ""
    return (
        f"{', '.join(map(repr, alone[:6]))} would be magnitudes or real parts, and their phases or imaginary parts are "
        "not in the file: export complex FRFs"
    )


def _pairs(arrays: _Arrays, keys: tuple[str, ...]) -> list[tuple[str, str]]:
    """Return the names of first and second part of each pair."""
    of_rest: dict[tuple[_Rest, tuple[int, ...]], dict[str, list[str]]] = defaultdict(lambda: defaultdict(list))
    for name, value in arrays.items():
        if _is_function(name, value):
            for key in keys:
                for rest in _without(name, key):
                    of_rest[rest, value.shape][key].append(name)
    complete = [arrays_of for arrays_of in of_rest.values() if all(len(arrays_of[key]) == 1 for key in keys)]
    pairs = [(arrays_of[keys[0]][0], arrays_of[keys[1]][0]) for arrays_of in complete]
    return list(dict.fromkeys(pair for pair in pairs if pair[0] != pair[1]))


def _is_function(name: str, value: NDArray[Any], *, fewest_lines: int = 10) -> bool:
    real = value.dtype.kind in "fiu" and value.size > 1 and max(value.shape) >= fewest_lines
    return real and not _NO_FRF.search(name)


def _is_even_axis(value: NDArray[Any]) -> bool:
    """Whether a vector ascends evenly, as frequencies do and neither part of a function nor a coherence."""
    vector = value.ravel()
    return bool(vector.size == max(value.shape) and np.all(np.diff(vector) > 0)) and not is_uneven(vector.astype(float))


def _words(name: str) -> list[str]:
    """Return the words and numbers of a name in lower case."""
    apart = re.sub(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Za-z])(?=\d)|(?<=\d)(?=[A-Za-z])", " ", name.replace("dB", "db"))
    return [word.lower() for word in re.split(r"[^\w]+|_", apart) if word]


def _without(name: str, key: str) -> list[_Rest]:
    """Return what is left of a name without the words of a part; none where it has none of them."""
    words = _words(name)
    rest = tuple(word for word in words if not re.fullmatch(_WORDS[key], word))
    if len(rest) < len(words):
        return [rest]
    ends = [re.sub(_ENDS[key], "", word) for word in words]
    return [tuple(filter(None, ends))] if ends != words else []
