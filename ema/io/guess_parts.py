"""Which real arrays of a file seem to be the parts of FRFs: real and imaginary ones, or magnitudes and phases."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ema.io.contents import polar_units
from ema.io.variables import WAYS

_Arrays = Mapping[str, NDArray[Any]]
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
        if not pairs:
            continue
        first = max(pairs, key=lambda pair: arrays[pair[0]].size)
        shape = arrays[first[0]].shape
        alike = [p for p in pairs if _numberless(p) == _numberless(first) and arrays[p[0]].shape == shape]
        is_vector = max(shape) == arrays[first[0]].size
        used = sorted(alike, key=_natural) if is_vector else [first]
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


def _numberless(pair: tuple[str, str]) -> tuple[str, ...]:
    return tuple(re.sub(r"\d+", "#", name) for name in pair)


def _natural(pair: tuple[str, str]) -> list[tuple[int, str]]:
    return [(int(p), "") if p.isdigit() else (0, p) for p in re.split(r"(\d+)", pair[0])]
