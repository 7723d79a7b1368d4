"""A file of arrays: a line that says what made it, and a checksum of all that follows. Reading it runs no code."""

from __future__ import annotations

import json
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ema.io.files import whole
from updating.errors import StoreError
from updating.results.graph import Graph

_KIND = "arrays of Lamella"
_ALIGNED = 64  # bytes
_LONGEST = 2**16  # bytes of the first line
_NUMBERS = "biufc"

Buffer = NDArray[np.uint8]


def write_arrays(path: Path, graph: Graph, made: Mapping[str, Any]) -> None:
    """Write a graph whole or not at all.

    Parameters
    ----------
    path : Path
        The file.
    graph : Graph
        What to write.
    made : mapping
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
    head = {"kind": _KIND, "made": made, "text": len(text), "crc32": _checksum(body)}
    with whole(path, StoreError) as part, part.open("wb") as file:
        file.write(_filled(json.dumps(head).encode()))
        file.write(body.data)


def read_arrays(path: Path, made: Mapping[str, Any]) -> Graph | None:
    """Return the graph of a file; None where there is none, it was made from something else, or is damaged.

    Parameters
    ----------
    path, made
        As in `write_arrays`.
    """
    try:
        content = np.fromfile(path, np.uint8)
        end = int(np.flatnonzero(content[:_LONGEST] == ord("\n"))[0]) + 1
        head = json.loads(content[:end].tobytes())
        body = content[end:]
        if (head["kind"], head["made"]) != (_KIND, dict(made)) or head["crc32"] != _checksum(body):
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
            message = f"not an array of numbers: {kind}"
            raise ValueError(message)
        size = int(np.prod(shape)) * dtype.itemsize
        yield body[start : start + size].view(dtype).reshape(shape)
        start += size + -size % _ALIGNED


def _filled(text: bytes) -> bytes:
    """Return a line of text, filled up so that what follows is aligned."""
    return text + b" " * (-(len(text) + 1) % _ALIGNED) + b"\n"


def _checksum(body: Buffer) -> str:
    """Return a sum that shows damage; whoever changes a file on purpose could sum anew, whatever the sum."""
    return f"{zlib.crc32(body.data):08x}"
