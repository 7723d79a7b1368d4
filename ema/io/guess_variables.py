"""Which variables of a MATLAB or HDF5 file seem to hold FRFs."""

from __future__ import annotations

import re
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ema.io.array_files import LARGEST, arrays_in
from ema.io.contents import UNKNOWN, Code, Contents, with_names

_Arrays = dict[str, NDArray[Any]]


def guess_variables(path: Path, *, matlab: bool) -> Contents:
    """Return what a MATLAB or HDF5 file seems to hold, with `UNKNOWN` for what nothing in it looks like.

    The FRFs are the largest complex array, or two real ones whose names say so; their frequency axis is the one as
    long as an ascending vector; coherences have their shape and lie between 0 and 1.

    Raises
    ------
    MeasurementError
        The file cannot be read.
    """
    with arrays_in(path, matlab=matlab) as held:
        arrays = {name: found.read() for name, found in held.items() if 0 < prod(found.shape) <= LARGEST}
    keys, block = _frfs(arrays)
    if block is None:
        return Contents(
            file=path, section="variables", keys=keys | {"frequency": UNKNOWN}, dofs=((None, None),)
        )
    frequency = _frequency(arrays, block.shape)
    keys["frequency"] = frequency or UNKNOWN
    guesses = [f"variable {keys.get('frf', keys.get('real'))!r} is taken as the FRFs"]
    n_line = arrays[frequency].size if frequency else max(block.shape)
    axes = _axes(block.shape, n_line)
    keys["axes"] = axes
    if len(axes) > 1:
        guesses.append(f"axes are taken as {', '.join(axes)} by their lengths")
    lengths = dict(zip(axes, [n for n in block.shape if n > 1], strict=False))
    n_output, n_input = lengths.get("output", 1), lengths.get("input", 1)
    coherence = [
        name for name, value in arrays.items()
        if value.shape == block.shape and not np.iscomplexobj(value) and value.min() >= 0 and value.max() <= 1
    ]  # fmt: skip
    if coherence:
        keys["coherence"] = coherence[0]
    states = frozenset(
        end for end, n in (("output", n_output), ("input", n_input)) if _place(arrays, keys, end, n)
    )
    none: list[list[Code]] = [[] for _ in range(n_output * n_input)]
    dofs, named = with_names(path, none)
    return Contents(
        file=path, section="variables", keys=keys, dofs=dofs, states=states, guesses=(*guesses, *named)
    )


def _frfs(arrays: _Arrays) -> tuple[dict[str, Any], NDArray[Any] | None]:
    """Return the keys of the FRFs, and an array in their shape."""
    whole = [name for name, value in arrays.items() if np.iscomplexobj(value) and value.size > 1]
    if whole:
        name = max(whole, key=lambda n: arrays[n].size)
        return {"frf": name}, arrays[name]
    for name, value in arrays.items():
        if value.size > 1 and re.search(r"(?:^|[._/])re(?:al)?\b|_re(?:al)?$", name, re.IGNORECASE):
            other = re.sub(r"re(al)?$", lambda m: "imag" if m[1] else "im", name, flags=re.IGNORECASE)
            same = {n.lower(): n for n, v in arrays.items() if v.shape == value.shape}
            if other.lower() in same:
                return {"real": name, "imaginary": same[other.lower()]}, value
    return {"frf": UNKNOWN}, None


def _frequency(arrays: _Arrays, shape: tuple[int, ...]) -> str | None:
    """Return the name of an ascending vector as long as an axis; one that is named like it comes first."""
    fits = [
        name for name, value in arrays.items()
        if value.size == max(value.shape, default=0) > 1 and value.size in shape
        and not np.iscomplexobj(value) and np.all(np.diff(value.ravel().astype(float)) > 0)
    ]  # fmt: skip
    named = [name for name in fits if re.search(r"(?:^|[._/])f(?:req\w*)?$|freq|hz", name, re.IGNORECASE)]
    return next(iter(named), None) or max(fits, key=lambda name: arrays[name].size, default=None)


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
    """Add the variables of points and directions whose names and lengths fit; say whether there are both."""
    found: dict[str, str] = {}
    for key, what in (("point", r"point|node|dof"), ("direction", r"dir")):
        for name, value in arrays.items():
            words = re.split(r"[^a-z]+", re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name).lower())
            is_input = any(word.startswith(("in", "ref", "force", "exc", "shak")) for word in words)
            own = re.search(what, name, re.IGNORECASE) and is_input == (end == "input")
            whole = value.size == count and not np.iscomplexobj(value) and np.all(value == np.round(value))
            if own and whole and (key == "point" or np.all(np.isin(np.abs(value), (1, 2, 3)))):
                found.setdefault(f"{end}_{key}", name)
    if len(found) < 2:
        return False
    keys.update(found)
    return True
