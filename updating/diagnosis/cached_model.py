"""The reduced model of a diagnosis, cached in a file of plain values and arrays: reading it runs no code."""

from __future__ import annotations

import hashlib
import inspect
import json
import platform
import sys
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from functools import cache, partial
from importlib.metadata import version
from pathlib import Path
from types import FunctionType
from typing import IO, Any

import numpy as np
import platformdirs
import scipy.sparse as sp
from numpy.typing import NDArray

from ema.io.files import whole
from model import Assembly, Effect, Instruments, Kron, Mesh, Monomial, ReducedEquations, ReducedSystem, Stack, Term
from model.contact.pressing import InterfaceLaw, PressureField
from model.effects import parts
from model.effects.catalogue import shipped
from model.elements.equations import Formula, Product, Riding
from model.elements.mesh import Plan, plan_on
from model.reduction.reduced_equations import InRange, ReducedTerm
from model.reduction.riding import RidingPart
from model.stack.outline import Outline, Triangulation
from model.stack.parts import (
    Clamp,
    CompressionCurve,
    Contact,
    EdgeSupport,
    Interlayer,
    Material,
    PatchSupport,
    Pressing,
)
from updating.diagnosis.candidates import CandidateModel, candidate_model, clamp_locations
from updating.errors import StoreError
from updating.results.store import digest, versions

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
    longest = 2**16  # bytes of the first line
    try:
        with path.open("rb") as file:
            head = json.loads(file.readline(longest))
            end = file.tell()
            if (head["kind"], head["made"]) != (_KIND, dict(origin)) or head["crc32"] != _checksum_of(file):
                return None
        body = np.asarray(np.memmap(path, np.uint8, "r", end))  # of which only what is used takes memory
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


def _checksum_of(file: IO[bytes]) -> str:
    """Return the `_checksum` of what is left of a file."""
    total = 0
    while part := file.read(2**20):
        total = zlib.crc32(part, total)
    return f"{total:08x}"


def _checksum(body: Buffer) -> str:
    """Return a sum that shows damage; whoever changes a file on purpose could sum anew, whatever the sum."""
    return f"{zlib.crc32(body.data):08x}"


N_CACHED = 3
"""Models that are cached, those that were used last; each takes some 550 MB."""
_TYPES = (
    Assembly, CandidateModel, Clamp, CompressionCurve, Contact, EdgeSupport, InRange, Instruments, InterfaceLaw,
    Interlayer, Kron, Material, Mesh, Monomial, Outline, PatchSupport, Pressing, PressureField, Product,
    ReducedEquations, ReducedSystem, ReducedTerm, Riding, RidingPart, Stack, Term, Triangulation,
)  # fmt: skip


def cached_model(
    stack: Stack,
    instruments: Instruments,
    effects: Mapping[str, Effect],
    aids: Sequence[Effect] = (),
    executor: Executor | None = None,
) -> CandidateModel:
    """Return `candidate_model`, or read it from the user's cache folder where an earlier call left the same.

    A model with effects that do not ship is not cached, for their code may change. A folder that cannot be written, or
    a damaged file there, costs the time alone.

    Parameters
    ----------
    stack, instruments, effects, aids, executor
        As in `candidate_model`.
    """
    file = _file(stack, instruments, effects, aids)
    if file is None:
        return candidate_model(stack, instruments, effects, aids, executor)
    candidates = _read(*file)
    if candidates is not None:
        return candidates
    candidates = candidate_model(stack, instruments, effects, aids, executor)
    path, made, special = file
    with suppress(StoreError, OSError, TypeError):  # what cannot be written is made anew
        write_arrays(path, flattened(candidates, _TYPES, special), made)
        _forget(path.parent)
    return candidates


def kept_model(
    stack: Stack, instruments: Instruments, effects: Mapping[str, Effect], aids: Sequence[Effect] = ()
) -> CandidateModel | None:
    """Return what `cached_model` left, and None where it is not there."""
    file = _file(stack, instruments, effects, aids)
    return None if file is None else _read(*file)


def _file(
    stack: Stack, instruments: Instruments, effects: Mapping[str, Effect], aids: Sequence[Effect]
) -> tuple[Path, Mapping[str, Any], tuple[Special, ...]] | None:
    """Return where a model is cached, what it is made by, and how it is written; None of one that is not cached."""
    shipped_effects = [vars(effect) for effect in shipped()]  # by what they are: other processes have copies
    if any(vars(effect) not in shipped_effects for effect in (*stack.effects, *effects.values())):
        return None
    made_by = {**versions(), "scikit-fem": version("scikit-fem"), "python": platform.python_version()}
    base = replace(stack, instruments=instruments)
    what = digest({"stack": base, "effects": [*effects, *(aid.name for aid in aids)]})
    special = _special((*stack.effects, *effects.values(), *aids, *clamp_locations(base)))
    return (folder() / f"model_{what}.arrays", {"versions": made_by, "stack": stack.name, "digest": what}, special)


def folder() -> Path:
    """Return where models are cached."""
    return platformdirs.user_cache_path("lamella", appauthor=False)


def _read(path: Path, made: Mapping[str, Any], special: Sequence[Special]) -> CandidateModel | None:
    try:
        graph = read_arrays(path, made)
        if graph is None:
            return None
        candidates = restored(graph, _TYPES, special)
        path.touch()  # for it was used now
    except Exception:  # no file, or what one makes of its reading that somebody wrote by hand
        return None
    return candidates if isinstance(candidates, CandidateModel) else None


def _forget(where: Path) -> None:
    """Remove all models but those that were used last."""
    files = sorted(where.glob("model_*"), key=lambda file: file.stat().st_mtime, reverse=True)
    for file in files[N_CACHED:]:
        with suppress(OSError):  # Windows removes none that another process has mapped
            file.unlink(missing_ok=True)


def _special(effects: Iterable[Effect]) -> tuple[Special, ...]:
    """Return how what is no data is written: effects and their factors by name, and a mesh's spaces by the mesh."""
    known = {effect.name: effect for effect in effects}
    return (
        Special(kind=Effect, down=lambda effect: effect.name, up=known.__getitem__),
        Special(kind=Formula, down=lambda formula: formula.function, up=Formula),
        *(Special(kind=kind, down=_written, up=_formula) for kind in (FunctionType, partial)),
        Special(
            kind=Plan, down=lambda plan: (plan.membrane.mesh.p, plan.membrane.mesh.t), up=lambda mesh: plan_on(*mesh)
        ),
    )


def _written(function: Any) -> dict[str, Any]:
    """Return the name of a function in its module and, of a partial one, what it is given.

    Raises
    ------
    TypeError
        It cannot be found by a name.
    """
    given = dict[str, Any]()
    if isinstance(function, partial) and not function.args:
        function, given = function.func, function.keywords
    written = {"module": function.__module__, "name": function.__qualname__, "given": given}
    if _function(written) is not function:
        raise TypeError(f"{function} is not found by its name")
    return written


def _formula(written: Mapping[str, Any]) -> Any:
    """Return the function that is meant, with what it is given."""
    function = _function(written)
    return partial(function, **written["given"]) if written["given"] else function


@cache
def _modules() -> frozenset[str]:
    """Return the modules that factors of the effects that ship are in."""
    return frozenset((parts.__name__, *(effect.terms.__module__ for effect in shipped())))


def _function(written: Mapping[str, Any]) -> Any:
    """Return a function by its name: one of the parameters alone, in the modules of the effects that ship.

    Raises
    ------
    TypeError
        There is none: a file must not choose what code runs.
    """
    module, name = written["module"], written["name"]
    if module in _modules():
        factor = getattr(sys.modules[module], name, None)
        if inspect.isfunction(factor) and factor.__module__ == module:
            (first, *_) = inspect.get_annotations(factor).values()
            if first == "Theta":
                return factor
    raise TypeError(f"{module}.{name} is no factor of an effect")
