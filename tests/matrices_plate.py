"""Modes, as a test gives them, of the shipped plate of matrices, and of that plate with something changed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as sla

import model
from ema import ModalModel, read_campaign
from ema.modal.read_modes import read_modes
from model.matrices.reduced import points_on

EXAMPLE = Path(__file__).parents[1] / "data/matrices_example"
POINTS = np.loadtxt(EXAMPLE / "points.csv", delimiter=",", skiprows=1)
BAND = 1400.0  # Hz
STD = {"frequency": 2e-4, "shape": 0.01}
SEEN = 0.2  # 1/sqrt(kg), of the largest component of a mode that a test sees

Added = tuple[str, Sequence[float], str, float]  # "M" or "K", place in mm, directions, kg or N/m


def as_measured(folder: Path, frequency: np.ndarray, shape: np.ndarray, points: np.ndarray = POINTS) -> ModalModel:
    """Return modes through the files in which a test would bring them."""
    n = frequency.size
    (folder / "modes.csv").write_text(
        "mode,frequency_Hz,damping,frequency_std_Hz,damping_std,shape_std\n"
        + "".join(f"{i + 1},{f},0.01,{STD['frequency'] * f},0.001,{STD['shape']}\n" for i, f in enumerate(frequency))
    )
    names = ",".join(f"mode_{i + 1}_real,mode_{i + 1}_imag" for i in range(n))
    (folder / "shapes.csv").write_text(
        f"node,x,y,z,{names}\n"
        + "".join(
            f"{int(p[0])},0,0,1,{','.join(f'{v},0' for v in row)}\n" for p, row in zip(points, shape, strict=True)
        )
    )
    np.savetxt(folder / "points.csv", points, delimiter=",", header="node,x,y,z", comments="", fmt="%.9g")
    (folder / "campaign.toml").write_text(
        '[campaign]\nname = "test"\n[points]\nfile = "points.csv"\nunit = "mm"\n[[configuration]]\nname = "plate"\n'
        'modes = "file"\ninput = "21+z"\nfiles = ["modes.csv", "shapes.csv"]\n'
    )
    return read_modes(read_campaign(folder / "campaign.toml"), "plate").modal_model


def noisy(folder: Path, frequency: np.ndarray, rows: np.ndarray, seed: int) -> ModalModel:
    """Return what a test measures of modes, (n,) Hz and (n_point, n), in its band."""
    seen = (frequency < BAND) & (np.abs(rows).max(axis=0) > SEEN)
    rng = np.random.default_rng(seed)
    frequency = frequency[seen] * (1 + STD["frequency"] * rng.standard_normal(seen.sum()))
    size = np.sqrt(np.mean(rows[:, seen] ** 2, axis=0))
    shape = rows[:, seen] + STD["shape"] * size * rng.standard_normal((len(rows), seen.sum()))
    return as_measured(folder, frequency, shape)


def plate_test(
    folder: Path,
    structure: model.MatrixStructure,
    factors: Mapping[str, float],
    added: Sequence[Added] = (),
    seed: int = 0,
) -> ModalModel:
    """Return what a test measures of all equations of the structure, at some factors and with something on nodes."""
    theta = {**structure.theta, **factors}
    matrix = {target: structure.matrix(target, theta).tolil() for target in "KM"}
    for target, place, directions, value in added:
        node = structure.node[np.argmin(np.linalg.norm(structure.location - 1e-3 * np.array(place), axis=1))]
        for direction in directions:
            one = (structure.node == node) & (structure.dof == "xyz".index(direction) + 1)
            i = int(np.flatnonzero(one)[0])
            matrix[target][i, i] += value
    square, vector = sla.eigsh(
        sp.csc_matrix(matrix["K"]), 14, sp.csc_matrix(matrix["M"]), sigma=-1e4, v0=np.ones(structure.node.size)
    )
    at = points_on(structure, POINTS[:, 0], 1e-3 * POINTS[:, 1:], np.tile([0.0, 0.0, 1.0], (len(POINTS), 1)))
    up = {int(n): i for i, (n, d) in enumerate(zip(structure.node, structure.dof, strict=True)) if d == 3}
    near = np.array([[up[int(n)] for n in nodes] for nodes in at.node])
    rows = np.einsum("ik,ikm->im", at.weight, vector[near])
    return noisy(folder, np.sqrt(np.abs(square)) / (2 * np.pi), rows, seed)
