"""Functions that SDynPy saves: NumPy arrays of structures with abscissa, ordinate and coordinates of each function."""

from __future__ import annotations

import zipfile
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ema.io.array_files import LARGEST, NPY, numpy_header
from ema.io.measured_function import Kind, MeasuredFunction
from ema.io.units import Unit
from ema.types.errors import MeasurementError

FIELDS = frozenset(("abscissa", "ordinate", "coordinate"))
"""Fields of such an array; `coordinate` has `node` and `direction`, of the response and of the force."""
_TYPE = "function_type"  # number beside the array, as in universal files
_KINDS: dict[int, Kind] = {1: "response", 4: "frf", 6: "coherence"}
_LARGEST_POINT = 1e10  # as in universal files
_LARGEST_BYTES = 16 * LARGEST


def holds_data_arrays(path: Path) -> bool:
    """Tell by its headers whether a NumPy file holds functions of SDynPy."""
    try:
        return any(_is_data(dtype) for _, dtype in _headers(path).values())
    except Exception:  # zip and NumPy raise what they like at damaged archives
        return False


def read_data_arrays(path: Path, unit: Unit | None) -> tuple[MeasuredFunction, ...]:
    """Read the functions of a file that SDynPy's `NDDataArray.save` or `numpy.savez` of its arrays wrote.

    What a function is tells its number of the type, else its numbers: complex ones with two coordinates are FRFs. The
    files state no units.

    Parameters
    ----------
    path : Path
        The file.
    unit : Unit or None
        Unit of the FRFs, which come in SI units.

    Raises
    ------
    MeasurementError
        It cannot be read, or is no such array.
    """
    try:
        functions = [f for name, array in _arrays(path) for f in _functions(path, name, array, unit)]
    except MeasurementError:
        raise
    except Exception as error:  # zip and NumPy raise what they like at damaged archives
        message = f"{path}: cannot be read as a NumPy file, it is damaged or of another kind: {error}"
        raise MeasurementError(message) from error
    if not functions:
        message = f"{path}: holds no functions of SDynPy, arrays with the fields {', '.join(sorted(FIELDS))}"
        raise MeasurementError(message)
    return tuple(functions)


def _is_data(dtype: np.dtype[Any]) -> bool:
    if not set(dtype.names or ()) >= FIELDS:
        return False
    return set(dtype["coordinate"].base.names or ()) >= {"node", "direction"}


def _headers(path: Path) -> dict[str, tuple[tuple[int, ...], np.dtype[Any]]]:
    """Return shape and type of each array of a file."""
    with path.open("rb") as file:
        if file.read(len(NPY)) == NPY:
            return {"array": numpy_header(path.open("rb"))}
    with zipfile.ZipFile(path) as archive:
        names = [name for name in archive.namelist() if name.endswith(".npy")]
        return {name.removesuffix(".npy"): numpy_header(archive.open(name)) for name in names}


def _arrays(path: Path) -> list[tuple[str, tuple[NDArray[Any], int | None]]]:
    """Return the arrays of functions, each with the number of its type, if the file holds one."""
    headers = _headers(path)
    found = {name: shape for name, (shape, dtype) in headers.items() if _is_data(dtype)}
    for name, shape in found.items():
        if prod(shape) * headers[name][1].itemsize > _LARGEST_BYTES:
            message = f"{path}: variable {name!r}: holds {shape} functions, more than can be read"
            raise MeasurementError(message)
    with path.open("rb") as file:
        loaded = np.load(file, allow_pickle=False)
        if isinstance(loaded, np.ndarray):
            return [("array", (np.atleast_1d(loaded), None))] if found else []
        kind = headers.get(_TYPE)
        whole = kind is not None and kind[0] == () and kind[1].kind in "iu"
        number = int(loaded[_TYPE]) if whole else None
        return [(name, (np.atleast_1d(loaded[name]), number)) for name in found]


def _functions(
    path: Path, name: str, array: tuple[NDArray[Any], int | None], unit: Unit | None
) -> list[MeasuredFunction]:
    """Return the functions of one array, in its order, with the DOFs that it states."""
    data, number = array
    flat = data.reshape(-1)
    kind: Kind = "frf" if np.iscomplexobj(flat["ordinate"]) else "other"
    if number is not None:
        kind = _KINDS.get(number, "other")
    coordinate = flat["coordinate"].reshape(flat.size, -1)
    if kind == "frf" and coordinate.shape[1] != 2:
        kind = "other"
    factor = unit.factor if unit is not None and kind == "frf" else 1.0
    functions: list[MeasuredFunction] = []
    for k, one in enumerate(flat):
        value = np.atleast_1d(one["ordinate"])
        with np.errstate(over="ignore", invalid="ignore"):  # what is not finite is for the quality check
            value = value * factor if kind == "frf" else value.real
        dofs = [_dof(end) for end in coordinate[k]]
        abscissa = np.atleast_1d(one["abscissa"])
        if functions and np.array_equal(abscissa, functions[-1].abscissa):
            abscissa = functions[-1].abscissa  # held once for all
        functions.append(
            MeasuredFunction(
                kind="other" if any(abs(int(end["direction"])) > 3 for end in coordinate[k]) else kind,
                abscissa=abscissa,
                value=value,
                quantity=unit.frf if unit is not None and kind == "frf" else None,
                output=dofs[0] if dofs else None,
                input=dofs[1] if len(dofs) > 1 else None,
                source=f"{path}: variable {name!r}, function {k + 1}",
            )
        )
    return functions


def _dof(coordinate: Any) -> tuple[int, int] | None:
    """Return point and signed direction; None where the file states none, or a rotation."""
    node, direction = int(coordinate["node"]), int(coordinate["direction"])
    return (node, direction) if 0 < node < _LARGEST_POINT and 1 <= abs(direction) <= 3 else None
