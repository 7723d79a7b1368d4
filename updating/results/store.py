"""Results as files: JSON documents that say what made them, written whole or not at all, and read back."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from functools import cache
from importlib.metadata import version
from itertools import count
from pathlib import Path
from types import UnionType
from typing import Any, TypeVar, Union, get_args, get_origin

import cattrs
import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel

from ema.io.files import whole
from ema.types.frf import FRF, Dof, Dofs
from lamella_shared import frozen
from model import Effect, catalogue, find_effects
from updating.errors import StoreError

T = TypeVar("T")


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file whole or not at all, so that no half-written file is ever seen.

    Raises
    ------
    StoreError
        The folder cannot be made or written, or the disk is full.
    """
    with whole(path, StoreError) as part:
        part.write_bytes(content)


def write_result(path: Path, result: object, *, inputs: tuple[Path, ...], options: Mapping[str, object]) -> None:
    """Write a frozen result as JSON with the versions, input hashes and options that made it.

    Parameters
    ----------
    path : Path
        File to write.
    result : dataclass instance
        What to write; NaN becomes null, complex arrays become an object of two arrays.
    inputs : tuple of Path
        Files that the result was computed from; their SHA-256 goes into the document.
    options : dict
        Options that were used.

    Raises
    ------
    StoreError
        An input cannot be read any more, or the file cannot be written.
    """
    document = {
        "kind": type(result).__name__,
        "provenance": _provenance(inputs, options),
        "result": _CONVERTER.unstructure(result),
    }
    document["digest"] = _seal(document)
    text = json.dumps(document, ensure_ascii=False, indent=1, allow_nan=False)
    write_bytes(path, (text + "\n").encode())


def read_result(path: Path, kind: type[T], *, edited: bool = False) -> T:
    """Read a result written by `write_result`.

    Parameters
    ----------
    path : Path
        The file.
    kind : type
        Type of the result.
    edited : bool
        Whether one that was changed after it was written will do.

    Raises
    ------
    StoreError
        The file is missing, is not JSON, holds another kind of result, or was changed.
    """
    document = read_document(path)
    if document.get("kind") != kind.__name__:
        raise StoreError(f"{path}: expected a {kind.__name__}, found {document.get('kind')!r}")
    try:
        result = _CONVERTER.structure(document["result"], kind)
    except Exception as error:  # cattrs, pydantic and the types themselves raise what they like
        raise StoreError(
            f"{path}: not a complete {kind.__name__}; write it anew with the command that made it"
        ) from error
    if not edited and not is_intact(document):
        raise StoreError(
            f"{path}: was changed after it was written; write it anew with the command that made it, or use it as it "
            "is with --keep"
        )
    return result


def read_current(
    path: Path, kind: type[T], *, inputs: tuple[Path, ...], options: Mapping[str, object], keep: bool = False
) -> T | None:
    """Read a result if this version made it from these inputs with these options; None where it must be made anew.

    It must be as it was written, too.

    Parameters
    ----------
    path : Path
        File that `write_result` may have written.
    kind : type
        Type of the result.
    inputs, options
        What `write_result` would be given.
    keep : bool
        Whether any complete result of this kind will do, whoever wrote it.
    """
    if not path.exists():
        return None
    try:
        if keep:
            return read_result(path, kind, edited=True)
        if read_document(path).get("provenance") != json.loads(json.dumps(_provenance(inputs, options))):
            return None
        return read_result(path, kind)
    except StoreError:  # damaged, or of an older form
        return None


def kept(
    path: Path,
    kind: type[T],
    make: Callable[[], T],
    *,
    inputs: tuple[Path, ...],
    options: Mapping[str, object],
    keep: bool = False,
) -> T:
    """Return the result that an earlier run left, or make it and write it.

    Parameters
    ----------
    path, kind, inputs, options, keep
        As in `read_current`.
    make : callable
        Makes the result.

    Raises
    ------
    StoreError
        As in `write_result`.
    """
    result = read_current(path, kind, inputs=inputs, options=options, keep=keep)
    if result is None:
        result = make()
        write_result(path, result, inputs=inputs, options=options)
    return result


def read_document(path: Path) -> dict[str, Any]:
    """Read a whole result document: kind, provenance and the plain values of the result.

    Raises
    ------
    StoreError
        The file is missing or is not a result document.
    """
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise StoreError(f"cannot read {path}: {error.strerror}") from error
    except (ValueError, RecursionError) as error:
        raise StoreError(f"{path}: not a JSON file ({error})") from error
    if not isinstance(document, dict) or not {"kind", "provenance", "result"} <= document.keys():
        raise StoreError(f"{path}: not a result of Lamella; expected an object with 'kind', 'provenance' and 'result'")
    return document


def is_intact(document: Mapping[str, Any]) -> bool:
    """Tell whether a document is as it was written: its digest is that of the rest. Older ones have none."""
    rest = {key: value for key, value in document.items() if key != "digest"}
    return document.get("digest") == _seal(rest)


def folder_name(configuration: str) -> str:
    """Name of a configuration as the name of its folder: letters, digits, dots, dashes and underscores stay."""
    return re.sub(r"[^\w.-]+", "_", configuration).strip("._") or "configuration"


def write_frf(path: Path, frf: FRF) -> None:
    """Write FRFs as a compressed NumPy archive; the values are kept in full precision."""
    arrays: dict[str, Any] = {n: value for n, value in vars(frf).items() if isinstance(value, np.ndarray)}
    for name in ("output", "input"):
        dofs: Dofs = getattr(frf, name)
        arrays[f"{name}_node"], arrays[f"{name}_direction"] = dofs.node, dofs.direction
    arrays |= {
        "quantity": np.array(frf.quantity),
        "source": np.array(frf.source),
        "decay_rate": np.array(frf.decay_rate),
        "reciprocal": np.array(frf.reciprocal),
    }
    with whole(path, StoreError) as part, part.open("wb") as file:
        np.savez_compressed(file, **arrays)


def read_frf(path: Path) -> FRF:
    """Read FRFs written by `write_frf`.

    Raises
    ------
    StoreError
        The file is missing or is not such an archive.
    """
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            return FRF(
                frequency=archive["frequency"],
                value=frozen(archive["value"]),  # large
                quantity=str(archive["quantity"]),  # type: ignore[arg-type]  # written from a Quantity
                output=Dofs(node=archive["output_node"], direction=archive["output_direction"]),
                input=Dofs(node=archive["input_node"], direction=archive["input_direction"]),
                run=archive["run"],
                source=tuple(str(s) for s in archive["source"]),
                coherence=archive.get("coherence"),
                decay_rate=float(archive["decay_rate"]),
                reciprocal=bool(archive["reciprocal"]),
            )
    except Exception as error:  # zip, deflate and NumPy raise what they like at damaged archives
        raise StoreError(f"cannot read the FRFs in {path}: {error}") from error


def versions() -> dict[str, str]:
    """Return the versions of this program, down to its files, and of what its numbers depend on."""
    by_package = {name: version(name) for name in ("lamella", "numpy", "scipy")}
    by_package["lamella"] += f"+{_code_digest()}"
    return by_package


def digest(result: object) -> str:
    """Return the SHA-256 of what a result, frozen data types and plain values, would be written as."""
    return hashlib.sha256(json.dumps(_CONVERTER.unstructure(result)).encode()).hexdigest()


def _seal(document: Mapping[str, Any]) -> str:
    """Return the SHA-256 of a document's values, however its lines are broken."""
    return hashlib.sha256(json.dumps(document, sort_keys=True).encode()).hexdigest()


def _provenance(inputs: tuple[Path, ...], options: Mapping[str, object]) -> dict[str, Any]:
    files = dict.fromkeys(inputs)
    # as much of each path as tells them apart
    depth = next(n for n in count(1) if len({file.parts[-n:] for file in files}) == len(files))
    return {
        "versions": versions(),
        "inputs": {"/".join(file.parts[-depth:]): file_digest(file) for file in files},
        "options": dict(options),
    }


@cache
def _code_digest() -> str:
    """First digits of the digest of the program's own files, which may change without their version."""
    digest = hashlib.sha256()
    root = Path(__file__).parents[2]
    files = sorted(f for package in ("ema", "model", "updating") for f in (root / package).rglob("*.py"))
    for file in (root / "lamella_shared.py", *files):
        digest.update(file.read_bytes())
    return digest.hexdigest()[:12]


def file_digest(path: Path) -> str:
    """Return the SHA-256 of a file.

    Raises
    ------
    StoreError
        It cannot be read.
    """
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise StoreError(f"cannot read {path}: {error.strerror}") from error


def _plain(array: NDArray[Any]) -> Any:
    """Array as nested lists; complex as two of them; NaN, which JSON does not have, as null; empty ones as a shape."""
    if array.size == 0 and array.ndim > 1:
        return {"shape": list(array.shape)}
    if np.iscomplexobj(array):
        return {"real": _plain(array.real), "imag": _plain(array.imag)}
    if array.dtype.kind == "f" and not np.all(np.isfinite(array)):
        replaced = array.astype(object)
        replaced[~np.isfinite(array)] = None
        return replaced.tolist()
    return array.tolist()


def _array(value: Any, _: type) -> NDArray[Any]:
    if isinstance(value, dict) and "shape" in value:
        return np.empty(value["shape"])
    if isinstance(value, dict):
        return np.asarray(value["real"], float) + 1j * np.asarray(value["imag"], float)
    array = np.asarray(value)
    return array.astype(float) if array.dtype == object else array


def _is_array(kind: Any) -> bool:
    return kind is np.ndarray or get_origin(kind) is np.ndarray


def _members(union: Any) -> list[type]:
    """Return the data types of a union; a protocol among its members stands for types that are not stored."""
    return [m for m in get_args(union) if isinstance(m, type) and is_dataclass(m)]


def _is_union_of_types(kind: Any) -> bool:
    members = [m for m in get_args(kind) if m is not type(None)]
    return get_origin(kind) in (Union, UnionType) and len(members) > 1 and len(_members(kind)) > 0


def _by_fields(value: Any, kind: Any) -> Any:
    """Structure a union as the member that has the fields which were written."""
    if value is None:
        return None
    for member in _members(kind):
        if {f.name for f in fields(member)} == set(value):
            return _CONVERTER.structure(value, member)
    raise ValueError(f"no type of {kind} has the fields {', '.join(value)}")


def _make_converter() -> cattrs.Converter:
    converter = cattrs.Converter(detailed_validation=False)
    converter.register_unstructure_hook_func(_is_array, _plain)
    converter.register_structure_hook_func(_is_array, _array)
    converter.register_structure_hook_func(_is_union_of_types, _by_fields)
    unstructure_float: Callable[[float], float | str | None] = lambda x: (  # noqa: E731
        float(x) if np.isfinite(x) else None if np.isnan(x) else str(float(x))
    )
    converter.register_unstructure_hook(float, unstructure_float)
    converter.register_structure_hook(float, lambda x, _: np.nan if x is None else float(x))
    converter.register_unstructure_hook(complex, lambda z: {"real": z.real, "imag": z.imag})
    converter.register_structure_hook(complex, lambda z, _: complex(z["real"], z["imag"]))
    # effects hold code: by name, and only the catalogue's come back
    converter.register_unstructure_hook(Effect, lambda effect: effect.name)
    converter.register_structure_hook(Effect, lambda name, _: find_effects([name], catalogue())[0])
    converter.register_unstructure_hook(BaseModel, lambda x: x.model_dump(mode="json"))
    converter.register_structure_hook(BaseModel, lambda x, kind: kind.model_validate(x))
    converter.register_structure_hook(
        Dof, lambda x, _: Dof(int(x[0]), (float(x[1][0]), float(x[1][1]), float(x[1][2])))
    )
    converter.register_unstructure_hook(Path, str)
    converter.register_structure_hook(Path, lambda x, _: Path(x))
    return converter


_CONVERTER = _make_converter()
