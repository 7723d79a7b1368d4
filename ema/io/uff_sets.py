"""Geometry, functions and modes as data sets of a universal file, ready to be written."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ema.io.uff58 import encode_58b
from ema.types.errors import MeasurementError
from ema.types.frf import FRF, Quantity
from ema.types.geometry import Dofs, Geometry
from ema.types.modal_model import ModalModel

_ALONG = 1e-6  # that unit vectors may be off each other
_TYPE_OF_MOTION: dict[Quantity, int] = {"receptance": 8, "mobility": 11, "accelerance": 12}
LABEL_OF_MOTION: dict[Quantity, str] = {"receptance": "m", "mobility": "m/s", "accelerance": "m/s^2"}
"""Unit of the response whose FRF each is."""


def geometry_sets(geometry: Geometry) -> list[dict[str, Any]]:
    """Return units (164), local axes (2420), points (2411) and trace lines (82) as pyuff takes them."""
    zero = np.zeros(geometry.node.size, dtype=int)
    local = np.flatnonzero(np.abs(geometry.axes - np.eye(3)).max(axis=(1, 2), initial=0.0) > 0)
    system = zero.copy()
    system[local] = 1 + np.arange(local.size)
    x, y, z = geometry.coordinate.T
    sets: list[dict[str, Any]] = [
        {"type": 164, "units_code": 1, "units_description": "SI: Meter (newton)", "temp_mode": 1,
         "length": 1.0, "force": 1.0, "temp": 1.0, "temp_offset": 273.15},
    ]  # fmt: skip
    if local.size:
        matrices = [np.vstack([geometry.axes[i], np.zeros(3)]) for i in local]
        names = [f"point {geometry.node[i]}" for i in local]
        sets.append(
            {"type": 2420, "CS_sys_labels": system[local], "CS_types": zero[local], "CS_colors": zero[local],
             "CS_names": names, "CS_matrices": matrices}
        )  # fmt: skip
    sets.append(
        {"type": 2411, "node_nums": geometry.node, "def_cs": zero, "disp_cs": system, "color": zero,
         "x": x, "y": y, "z": z}
    )  # fmt: skip
    if geometry.line.size:
        nodes = np.column_stack([geometry.line, np.zeros(len(geometry.line), dtype=int)]).ravel()[:-1]
        sets.append({"type": 82, "trace_num": 1, "n_nodes": nodes.size, "color": 0, "id": "lines", "nodes": nodes})
    return sets


def with_axes_along(geometry: Geometry, *dofs: Dofs) -> Geometry:
    """Return points with local axes along the directions in which something is there, where it is off their axes.

    A universal file knows a direction by the axis of its point alone. Where more than three directions meet at a point,
    or some are not at right angles, its axes stay as they are.
    """
    axes = geometry.axes.copy()
    for i, node in enumerate(geometry.node.tolist()):
        directions = np.vstack([there.direction[there.node == node] for there in dofs])
        different: list[NDArray[np.float64]] = []
        for direction in directions:
            if all(abs(direction @ other) < 1.0 - _ALONG for other in different):
                different.append(direction)
        is_off = any(_code(geometry, node, direction) == 0 for direction in different)
        if is_off and np.abs(np.triu(np.array(different) @ np.transpose(different), 1)).max() < _ALONG:
            axes[i] = np.linalg.qr(np.transpose(different), mode="complete")[0].T
            axes[i, 2] *= np.sign(np.linalg.det(axes[i]))
    return replace(geometry, axes=axes)


def encoded_frfs(frf: FRF, geometry: Geometry) -> list[bytes]:
    """Return a dataset 58b for each function, followed by that of its coherence where there is one.

    A direction that is not along an axis of its point is written as 0, which stands for none.

    Raises
    ------
    MeasurementError
        The frequency axis is not uniform.
    """
    step = np.diff(frf.frequency)
    if step.size == 0 or np.ptp(step) > 1e-6 * step.mean():
        message = "a universal file is written for a uniform frequency axis only; this one is not"
        raise MeasurementError(message)
    blocks = []
    for i, source in enumerate(frf.source):
        for j in range(frf.input.node.size):
            header = {
                "id": (f"run {frf.run[i]}", Path(source).name),
                "response node": int(frf.output.node[i]),
                "response direction": _code(geometry, int(frf.output.node[i]), frf.output.direction[i]),
                "reference node": int(frf.input.node[j]),
                "reference direction": _code(geometry, int(frf.input.node[j]), frf.input.direction[j]),
                "abscissa specific data type": 18,
                "abscissa axis label": "Frequency",
                "abscissa units label": "Hz",
            }
            ordinate = {
                "function type": 4,
                "ordinate numerator specific data type": _TYPE_OF_MOTION[frf.quantity],
                "ordinate numerator units label": LABEL_OF_MOTION[frf.quantity],
                "ordinate denominator specific data type": 13,
                "ordinate denominator units label": "N",
            }
            start, spacing = float(frf.frequency[0]), float(step.mean())
            blocks.append(encode_58b(header | ordinate, start, spacing, frf.value[i, j]))
            if frf.coherence is not None:
                blocks.append(encode_58b(header | {"function type": 6}, start, spacing, frf.coherence[i, j]))
    return blocks


def mode_sets(modal_model: ModalModel, geometry: Geometry) -> list[dict[str, Any]]:
    """Return a dataset 55 for each mode: complex eigenvalue, modal A and B, shape in the axes of each point.

    A mass-normalised shape has the modal A of 2 i omega_d, so that its residue is shape**2 / A; modal A and B of
    a shape without scale are 0, which stands for unknown.
    """
    node, index = np.unique(modal_model.node, return_inverse=True)
    axes = np.stack([geometry.axes[geometry.node == n][0] if n in geometry.node else np.eye(3) for n in node])
    sets = []
    for r, pole in enumerate(modal_model.free_pole):
        vector = np.zeros((node.size, 3), dtype=complex)
        np.add.at(vector, index, modal_model.direction * modal_model.shape[:, [r]])
        local = np.einsum("nij,nj->ni", axes, vector)
        modal_a = 2j * pole.imag if modal_model.scaled[r] else 0j
        sets.append(
            {"type": 55, "id1": modal_model.name, "id2": f"{modal_model.frequency[r]:.6g} Hz, damping "
             f"{100 * modal_model.damping[r]:.4g} %", "model_type": 1, "analysis_type": 3, "data_ch": 2,
             "spec_data_type": 8, "load_case": 1, "mode_n": r + 1, "eig": pole, "modal_a": modal_a,
             "modal_b": -pole * modal_a, "node_nums": node, "r1": local[:, 0], "r2": local[:, 1], "r3": local[:, 2]}
        )  # fmt: skip
    return sets


def _code(geometry: Geometry, node: int, direction: NDArray[np.float64]) -> int:
    codes = (1, 2, 3, -1, -2, -3)
    along = (code for code in codes if np.allclose(geometry.direction(node, code), direction, atol=_ALONG))
    return next(along, 0)
