"""Frozen data types in a file of plain values and arrays, and back: reading it runs no code."""

from __future__ import annotations

import hashlib
import json
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ema.io.files import whole
from updating.errors import StoreError

_SPARSE = {kind.__name__: kind for kind in (sp.csr_matrix, sp.csc_matrix, sp.csr_array, sp.csc_array)}

_NUMBERS = "biufc"  # kinds of arrays that hold nothing but numbers


@dataclass(frozen=True, eq=False, kw_only=True)
class Special:
    """How values of a type are written that are not written field by field.

    Attributes
    ----------
    kind : type
        The type.
    down : callable
        From such a value to what can be written.
    up : callable
        The way back.
    """

    kind: type
    down: Callable[[Any], Any]
    up: Callable[[Any], Any]


@dataclass(frozen=True, eq=False, kw_only=True)
class Graph:
    """Values that refer to each other, each written once.

    Attributes
    ----------
    nodes : list
        What can become JSON; each refers to those before it, the last one is the whole.
    arrays : list of array
        The arrays that nodes refer to.
    """

    nodes: list[Any]
    arrays: list[NDArray[Any]]


def flattened(root: object, types: Iterable[type], special: Iterable[Special]) -> Graph:
    """Return a value, and all that it is made of, as a graph.

    Parameters
    ----------
    root : object
        Frozen data types, tuples, lists, mappings with words for keys, numbers, text, arrays and sparse matrices.
    types : iterable of type
        The data types that may occur.
    special : iterable of Special
        Those that are written in another way.

    Raises
    ------
    TypeError
        Something else occurs.
    """
    return _Flattening(types, special).graph(root)


def restored(graph: Graph, types: Iterable[type], special: Iterable[Special]) -> Any:
    """Return the value of a graph; what was one object is one again.

    Nothing but the given types is made, whatever the graph says. One that was not written by `flattened` may raise
    anything.

    Parameters
    ----------
    graph, types, special
        As in `flattened`.
    """
    known = {kind.__name__: kind for kind in types}
    ups = {s.kind.__name__: s.up for s in special}
    values: list[Any] = []

    def value(item: Any) -> Any:
        return values[item["at"]] if isinstance(item, dict) else item

    for tag, name, content in graph.nodes:
        if tag == "array":
            values.append(graph.arrays[content].T if name == "transposed" else graph.arrays[content])
        elif tag == "sparse":
            shape, *parts = content
            matrix = _SPARSE[name](tuple(shape))
            # set directly: no checks, no copies
            matrix.data, matrix.indices, matrix.indptr = map(value, parts)
            values.append(matrix)
        elif tag == "special":
            values.append(ups[name](value(content)))
        elif tag == "type":
            values.append(known[name](**{key: value(item) for key, item in content.items()}))
        elif tag == "mapping":
            values.append({key: value(item) for key, item in content.items()})
        else:
            items = [value(item) for item in content]
            values.append(tuple(items) if name == "tuple" else items)
    return values[-1]


class _Flattening:
    def __init__(self, types: Iterable[type], special: Iterable[Special]) -> None:
        self._types = frozenset(types)
        self._special = {s.kind: s for s in special}
        self._nodes: list[Any] = []
        self._arrays: list[NDArray[Any]] = []
        self._places: dict[int, int] = {}
        self._same: dict[tuple[Any, ...], int] = {}
        self._alive: list[object] = []  # or another object might get the place in memory of one that is done

    def graph(self, root: object) -> Graph:
        """Return the graph of a value."""
        self._item(root)
        return Graph(nodes=self._nodes, arrays=self._arrays)

    def _item(self, value: object) -> Any:
        """Return a plain value as it is, and of anything else where its node is."""
        if isinstance(value, np.generic):
            return value.item()
        if value is None or isinstance(value, bool | int | float | str):
            return value
        if id(value) not in self._places:
            node = self._node(value)
            self._places[id(value)] = len(self._nodes)
            self._nodes.append(node)
            self._alive.append(value)
        return {"at": self._places[id(value)]}

    def _node(self, value: Any) -> tuple[str, str, Any]:
        kind = type(value)
        if isinstance(value, np.ndarray) and value.dtype.kind in _NUMBERS:
            # the order is kept, for products are rounded by it
            transposed = value.flags.f_contiguous and not value.flags.c_contiguous
            array = np.ascontiguousarray(value.T if transposed else value)
            content = (array.dtype.str, array.shape, hashlib.sha256(array.data).digest())
            if content not in self._same:  # patterns of matrices repeat
                self._same[content] = len(self._arrays)
                self._arrays.append(array)
            return "array", "transposed" if transposed else "", self._same[content]
        if kind.__name__ in _SPARSE and kind is _SPARSE[kind.__name__]:
            parts = (value.data, value.indices, value.indptr)
            return "sparse", kind.__name__, [list(map(int, value.shape)), *map(self._item, parts)]
        if kind in self._special:
            return "special", kind.__name__, self._item(self._special[kind].down(value))
        if kind in self._types:
            given = (field.name for field in fields(value) if field.init)
            return "type", kind.__name__, {name: self._item(getattr(value, name)) for name in given}
        if isinstance(value, Mapping) and all(isinstance(key, str) for key in value):
            return "mapping", "", {key: self._item(item) for key, item in value.items()}
        if kind in (tuple, list):
            return "items", kind.__name__, [self._item(item) for item in value]
        raise TypeError(f"a {kind.__name__} cannot be written as arrays")


_KIND = "arrays of Lamella"

_ALIGNED = 64  # bytes

_LONGEST = 2**16  # bytes of the first line

Buffer = NDArray[np.uint8]


def write_arrays(path: Path, graph: Graph, origin: Mapping[str, Any]) -> None:
    """Write a graph whole or not at all.

    Parameters
    ----------
    path : Path
        The file.
    graph : Graph
        What to write.
    origin : mapping
        What it was made from and with, as plain values; `read_arrays` must be given the same.

    Raises
    ------
    StoreError
        The file cannot be written.
    """
    shapes = [(array.dtype.str, array.shape) for array in graph.arrays]
    text = _filled(json.dumps({"nodes": graph.nodes, "arrays": shapes}).encode())
    parts = [np.frombuffer(text, np.uint8)]
    for array in graph.arrays:
        raw = np.ascontiguousarray(array).reshape(-1).view(np.uint8)
        parts += [raw, np.zeros(-raw.size % _ALIGNED, np.uint8)]
    body = np.concatenate(parts)
    head = {"kind": _KIND, "made": origin, "text": len(text), "crc32": _checksum(body)}
    with whole(path, StoreError) as part, part.open("wb") as file:
        file.write(_filled(json.dumps(head).encode()))
        file.write(body.data)


def read_arrays(path: Path, origin: Mapping[str, Any]) -> Graph | None:
    """Return the graph of a file; None where there is none, it was made from something else, or is damaged.

    Parameters
    ----------
    path, origin
        As in `write_arrays`.
    """
    try:
        content = np.fromfile(path, np.uint8)
        end = int(np.flatnonzero(content[:_LONGEST] == ord("\n"))[0]) + 1
        head = json.loads(content[:end].tobytes())
        body = content[end:]
        if (head["kind"], head["made"]) != (_KIND, dict(origin)) or head["crc32"] != _checksum(body):
            return None
        text = json.loads(body[: head["text"]].tobytes())
        return Graph(nodes=text["nodes"], arrays=list(_arrays(body, head["text"], text["arrays"])))
    except (OSError, ValueError, LookupError, TypeError):
        return None


def _arrays(body: Buffer, start: int, shapes: list[Any]) -> Iterator[NDArray[Any]]:
    """Yield the arrays behind the text, as parts of the one that was read."""
    for kind, shape in shapes:
        dtype = np.dtype(kind)
        if dtype.kind not in _NUMBERS:
            raise ValueError(f"not an array of numbers: {kind}")
        size = int(np.prod(shape)) * dtype.itemsize
        yield body[start : start + size].view(dtype).reshape(shape)
        start += size + -size % _ALIGNED


def _filled(text: bytes) -> bytes:
    """Return a line of text, filled up so that what follows is aligned."""
    return text + b" " * (-(len(text) + 1) % _ALIGNED) + b"\n"


def _checksum(body: Buffer) -> str:
    """Return a sum that shows damage; whoever changes a file on purpose could sum anew, whatever the sum."""
    return f"{zlib.crc32(body.data):08x}"
