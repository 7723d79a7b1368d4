"""Shapes that SDynPy saves: a NumPy array of structures with frequency, damping, coordinates and shape of each mode."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ema.io.files import plain_bytes
from ema.io.found_modes import FoundModes, joined, without_unmeasured
from ema.types.errors import MeasurementError
from ema.types.geometry import Geometry

FIELDS = ("frequency", "damping", "coordinate", "shape_matrix")
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
        message = f"{path}: its array of shapes is empty"
        raise MeasurementError(message)
    return without_unmeasured(joined(parts))


def _mode(path: Path, number: int, mode: Any, geometry: Geometry) -> FoundModes:
    frequency, damping = float(mode["frequency"]), float(np.real(mode["damping"]))
    if not (0.0 < frequency < np.inf and 0.0 <= damping < 1.0):
        message = (
            f"{path}: mode {number} has the frequency {frequency:g} Hz and the damping ratio {damping:g}; expected one "
            "above 0, and a ratio below 1: leave out rigid-body modes"
        )
        raise MeasurementError(message)
    code = mode["coordinate"]["direction"].astype(int)
    is_translation = (np.abs(code) >= 1) & (np.abs(code) <= 3)
    shape = np.asarray(mode["shape_matrix"], dtype=complex)[is_translation]
    if not np.isfinite(shape).all() or not shape.size:
        message = f"{path}: the shape of mode {number} has no translation, or values that are not finite"
        raise MeasurementError(message)
    real_mass = mode.dtype.names is not None and "modal_mass" in mode.dtype.names
    mass = complex(mode["modal_mass"]) if real_mass and not np.iscomplexobj(mode["shape_matrix"]) else 0j
    scaled = mass.imag == 0.0 and 0.0 < mass.real < np.inf
    node = mode["coordinate"]["node"].astype(np.int64)[is_translation]
    return FoundModes(
        source=str(path),
        frequency=np.array([frequency]),
        damping=np.array([damping if damping > 0.0 else np.nan]),
        frequency_std=np.array([np.nan]),
        damping_std=np.array([np.nan]),
        shape=(shape / np.sqrt(mass.real) if scaled else shape)[:, None],
        shape_std=np.array([np.nan]),
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
        message = f"{path}: cannot be read as a NumPy file: {getattr(error, 'strerror', None) or error}"
        raise MeasurementError(message) from error
    found = [a for a in arrays.values() if set(FIELDS) <= set(a.dtype.names or ())]
    named = [a for a in found if {"node", "direction"} <= set(a.dtype["coordinate"].base.names or ())]
    if len(named) != 1:
        held = ", ".join(f"{name} ({', '.join(a.dtype.names or ('numbers',))})" for name, a in arrays.items())
        message = (
            f"{path}: expected one array of structures with {', '.join(FIELDS)}, as SDynPy saves shapes; the file "
            f"holds {held or 'nothing'}"
        )
        raise MeasurementError(message)
    return np.atleast_1d(named[0]).reshape(-1)
