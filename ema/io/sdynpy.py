"""What SDynPy saves: NumPy arrays of structures, of functions and of shapes."""

from __future__ import annotations

import io
import zipfile
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ema.io.array_files import LARGEST, NPY, numpy_header
from ema.io.found_modes import FoundModes, joined, without_unmeasured
from ema.io.measured_function import KIND_OF_TYPE, Kind, MeasuredFunction, Unit
from ema.types.errors import MeasurementError
from ema.types.frf import Geometry
from lamella_shared import plain_bytes

FUNCTION_FIELDS = frozenset(("abscissa", "ordinate", "coordinate"))
"""Fields of such an array; `coordinate` has `node` and `direction`, of the response and of the force."""
_TYPE = "function_type"  # number beside the array, as in universal files


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
        raise MeasurementError(
            f"{path}: cannot be read as a NumPy file, it is damaged or of another kind: {error}"
        ) from error
    if not functions:
        raise MeasurementError(
            f"{path}: holds no functions of SDynPy, arrays with the fields {', '.join(sorted(FUNCTION_FIELDS))}"
        )
    return tuple(functions)


def _is_data(dtype: np.dtype[Any]) -> bool:
    if not set(dtype.names or ()) >= FUNCTION_FIELDS:
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
    largest_bytes = 16 * LARGEST
    headers = _headers(path)
    shapes = {name: shape for name, (shape, dtype) in headers.items() if _is_data(dtype)}
    for name, shape in shapes.items():
        if prod(shape) * headers[name][1].itemsize > largest_bytes:
            raise MeasurementError(f"{path}: variable {name!r}: holds {shape} functions, more than can be read")
    with path.open("rb") as file:
        loaded = np.load(file, allow_pickle=False)
        if isinstance(loaded, np.ndarray):
            return [("array", (np.atleast_1d(loaded), None))] if shapes else []
        kind = headers.get(_TYPE)
        whole = kind is not None and kind[0] == () and kind[1].kind in "iu"
        number = int(loaded[_TYPE]) if whole else None
        return [(name, (np.atleast_1d(loaded[name]), number)) for name in shapes]


def _functions(
    path: Path, name: str, array: tuple[NDArray[Any], int | None], unit: Unit | None
) -> list[MeasuredFunction]:
    """Return the functions of one array, in its order, with the DOFs that it states."""
    data, number = array
    flat = data.reshape(-1)
    kind: Kind = "frf" if np.iscomplexobj(flat["ordinate"]) else "other"
    if number is not None:
        kind = KIND_OF_TYPE.get(number, "other")
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


def _dof(coordinate: Any, *, largest_point: float = 1e10) -> tuple[int, int] | None:
    """Return point and signed direction; None where the file states none, or a rotation.

    `largest_point`: as in universal files.
    """
    node, direction = int(coordinate["node"]), int(coordinate["direction"])
    return (node, direction) if 0 < node < largest_point and 1 <= abs(direction) <= 3 else None


SHAPE_FIELDS = ("frequency", "damping", "coordinate", "shape_matrix")
"""Fields of such an array; `coordinate` has `node` and `direction`."""


def is_shape_array(path: Path) -> bool:
    """Tell whether a NumPy file holds shapes of SDynPy."""
    try:
        _array(path)
    except MeasurementError:
        return False
    return True


def read_modes_numpy(path: Path, geometry: Geometry) -> FoundModes:
    """Read the modes of a file that SDynPy's `ShapeArray.save` or `numpy.savez` of its array wrote.

    Real shapes come with their modal mass, kg. The scale of complex ones is not stated in SDynPy and not used.

    Parameters
    ----------
    path : Path
        The file.
    geometry : Geometry
        The points, whose local axes are those of the directions.

    Raises
    ------
    MeasurementError
        It cannot be read or is no such array.
    """
    array = _array(path)
    parts = [_mode(path, k, mode, geometry) for k, mode in enumerate(array, start=1)]
    if not parts:
        raise MeasurementError(f"{path}: its array of shapes is empty")
    return without_unmeasured(joined(parts))


def _mode(path: Path, number: int, mode: Any, geometry: Geometry) -> FoundModes:
    frequency, damping = float(mode["frequency"]), float(np.real(mode["damping"]))
    if not (0.0 < frequency < np.inf and 0.0 <= damping < 1.0):
        raise MeasurementError(
            f"{path}: mode {number} has the frequency {frequency:g} Hz and the damping ratio {damping:g}; expected one "
            "above 0, and a ratio below 1: leave out rigid-body modes"
        )
    code = mode["coordinate"]["direction"].astype(int)
    is_translation = (np.abs(code) >= 1) & (np.abs(code) <= 3)
    shape = np.asarray(mode["shape_matrix"], dtype=complex)[is_translation]
    if not np.isfinite(shape).all() or not shape.size:
        raise MeasurementError(f"{path}: the shape of mode {number} has no translation, or values that are not finite")
    real_mass = mode.dtype.names is not None and "modal_mass" in mode.dtype.names
    mass = complex(mode["modal_mass"]) if real_mass and not np.iscomplexobj(mode["shape_matrix"]) else 0j
    scaled = mass.imag == 0.0 and 0.0 < mass.real < np.inf
    node = mode["coordinate"]["node"].astype(np.int64)[is_translation]
    return FoundModes(
        source=str(path),
        frequency=np.array([frequency]),
        damping=np.array([damping if damping > 0.0 else np.nan]),
        shape=(shape / np.sqrt(mass.real) if scaled else shape)[:, None],
        scaled=np.array([scaled]),
        node=node,
        direction=np.array(
            [geometry.direction(int(n), int(c)) for n, c in zip(node, code[is_translation], strict=True)]
        ),
    )


def _array(path: Path) -> NDArray[Any]:
    """Return the array of structures of a file, flat."""
    try:
        with io.BytesIO(plain_bytes(path)) as content:
            loaded = np.load(content, allow_pickle=False)
            arrays = {"array": loaded} if isinstance(loaded, np.ndarray) else dict(loaded)
    except Exception as error:  # zip and NumPy raise what they like at damaged archives
        raise MeasurementError(
            f"{path}: cannot be read as a NumPy file: {getattr(error, 'strerror', None) or error}"
        ) from error
    candidates = [a for a in arrays.values() if set(SHAPE_FIELDS) <= set(a.dtype.names or ())]
    named = [a for a in candidates if {"node", "direction"} <= set(a.dtype["coordinate"].base.names or ())]
    if len(named) != 1:
        held = ", ".join(f"{name} ({', '.join(a.dtype.names or ('numbers',))})" for name, a in arrays.items())
        raise MeasurementError(
            f"{path}: expected one array of structures with {', '.join(SHAPE_FIELDS)}, as SDynPy saves shapes; the "
            f"file holds {held or 'nothing'}"
        )
    return np.atleast_1d(named[0]).reshape(-1)
