"""How long a structure of many equations takes: read, reduced, and ten of its terms fitted to a test.

The structure is a plate of bricks on springs, whose stiffness is the sum of ten parts along and across it. Each run is
a process of its own, so that its memory is its own.
"""

from __future__ import annotations

import multiprocessing
import resource
import tempfile
import time
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import scipy.sparse as sp

import model
from model.solvers.eigen import CholeskyFactor, lowest_modes
from tests.matrices_plate import as_measured
from tests.studies.runner import study
from updating.diagnosis.matrices_answer import fit_matrices

SIZES = (10_000, 30_000, 100_000, 300_000)
"""Degrees of freedom, about."""
FORMS = ("npz", "text")
"""Arrays of numpy, or text with a triangle of each matrix as CalculiX writes it."""
SIDES = np.array([0.6, 0.36, 0.012])  # m
YOUNG, POISSON, DENSITY = 7e10, 0.3, 2700.0
SPRING = 2e7  # N/m in all along each axis, at the lowest x
PARTS = (5, 2)  # of the stiffness, along and across
N_MODE, N_SENSOR, BAND = 10, (9, 6), 500.0


@dataclass(frozen=True, kw_only=True)
class LargeCase:
    """One structure.

    Attributes
    ----------
    size : int
        Degrees of freedom that were asked for, and `n` those that it has.
    form : str
        How its files are written.
    read, fitted : float
        Processor seconds to read it, and to reduce it and fit its terms.
    memory : float
        Largest memory of the process, GB; what made the files is not in it.
    error : float
        Largest error of a factor, over the standard deviation that the fit states.
    """

    size: int
    form: str
    n: int
    read: float
    fitted: float
    memory: float
    error: float


def _brick(sides: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return stiffness and mass, (24, 24), of a brick with eight nodes by 2 by 2 by 2 points of Gauss."""
    corner = np.array([[(i >> k & 1) * 2.0 - 1.0 for k in range(3)] for i in range(8)])
    lame, shear = YOUNG * POISSON / ((1 + POISSON) * (1 - 2 * POISSON)), YOUNG / (2 * (1 + POISSON))
    law = np.diag([2 * shear] * 3 + [shear] * 3)
    law[:3, :3] += lame
    stiffness, mass, volume = np.zeros((24, 24)), np.zeros((24, 24)), float(np.prod(sides) / 8.0)
    for at in corner / np.sqrt(3.0):
        factor = 1.0 + corner * at
        shape = factor.prod(axis=1) / 8.0
        slope = np.stack([corner[:, k] * np.delete(factor, k, 1).prod(axis=1) / 8.0 for k in range(3)], axis=1)
        slope = slope * 2.0 / sides
        strain = np.zeros((6, 8, 3))
        for k in range(3):
            strain[k, :, k] = slope[:, k]
            i, j = (k + 1) % 3, (k + 2) % 3
            strain[3 + k, :, i], strain[3 + k, :, j] = slope[:, j], slope[:, i]
        stiffness += volume * strain.reshape(6, 24).T @ law @ strain.reshape(6, 24)
        mass += volume * DENSITY * np.kron(np.outer(shape, shape), np.eye(3))
    return stiffness, mass


def plate(size: int) -> tuple[np.ndarray, list[sp.csc_matrix], sp.csc_matrix, np.ndarray]:
    """Return places of nodes, (n, 3) m, ten parts of the stiffness, the mass, and the rows on springs."""
    along = round((size / 3 / 4 / 0.6) ** 0.5)
    count = np.array([along, round(0.6 * along), 4])
    number = np.arange(count.prod()).reshape(count)
    line = [np.linspace(0.0, side, n) for side, n in zip(SIDES, count, strict=True)]
    place = np.stack(np.meshgrid(*line, indexing="ij"), axis=-1).reshape(-1, 3)
    cells = [slice(0, -1), slice(1, None)]
    node = np.stack([number[tuple(cells[i >> k & 1] for k in range(3))].ravel() for i in range(8)], axis=1)
    row = (3 * node[:, :, None] + np.arange(3)).reshape(len(node), 24)
    stiffness, mass = _brick(SIDES / (count - 1))
    middle = place[node].mean(axis=1) / SIDES
    part = np.floor(middle[:, 0] * PARTS[0]).astype(int) * PARTS[1] + np.floor(middle[:, 1] * PARTS[1]).astype(int)

    def assembled(matrix: np.ndarray, rows: np.ndarray) -> sp.csc_matrix:
        values = np.broadcast_to(matrix, (len(rows), 24, 24))
        i, j = (np.broadcast_to(r, values.shape).ravel() for r in (rows[:, :, None], rows[:, None, :]))
        return sp.csc_matrix((values.ravel(), (i, j)), shape=(place.size,) * 2)

    parts = [assembled(stiffness, row[part == j]) for j in range(PARTS[0] * PARTS[1])]
    held = (3 * np.flatnonzero(place[:, 0] == 0.0)[:, None] + np.arange(3)).ravel()
    return place, parts, assembled(mass, row), held


def write(folder: Path, size: int, form: str) -> np.ndarray:
    """Write a structure, and what a test measures of it with other factors; return these."""
    place, parts, mass, held = plate(size)
    n, truth = place.size, np.exp(0.2 * np.random.default_rng(size).standard_normal(len(parts)))
    spring = np.zeros(n)
    spring[held] = SPRING / (held.size / 3)
    every = {f"k{j}": part for j, part in enumerate(parts)} | {"mass": mass}
    suffix = {"npz": ".npz", "text": ".sti"}[form]
    for name, matrix in every.items():
        if form == "npz":
            sp.save_npz(folder / f"{name}.npz", matrix)
        else:
            half = sp.coo_matrix(sp.triu(matrix))
            table = np.column_stack([half.row + 1, half.col + 1, half.data])
            np.savetxt(folder / f"{name}.sti", table, fmt="%d %d %.16e")
    labels = [f"{i // 3 + 1},{i % 3 + 1},{x:.9g},{y:.9g},{z:.9g}" for i, (x, y, z) in enumerate(np.repeat(place, 3, 0))]
    (folder / "dofs.csv").write_text("node,dof,x,y,z\n" + "\n".join(labels) + "\n")
    text = f'name = "plate"\n[matrices]\nunits = "m-kg-s"\nmass = "mass{suffix}"\ndofs = "dofs.csv"\n'
    text += '[[group]]\nname = "root"\nbox_mm = [[-1, 0.001], [-1, 1000], [-1, 100]]\n'
    text += f'[[term]]\nname = "root_springs"\ngroup = "root"\nspring_N_m = {SPRING}\nstd = 1e-3\n'
    for j in range(len(parts)):
        text += f'[[term]]\nname = "part_{j}"\nstiffness = "k{j}{suffix}"\nstd = 0.3\n'
    (folder / "structure.toml").write_text(text + f"[reduction]\nband_Hz = {BAND}\n")

    whole = sum(f * part for f, part in zip(truth, parts, strict=True)) + sp.diags_array(spring)
    shift = (2.0 * np.pi * BAND / 4.0) ** 2
    factor = CholeskyFactor(sp.csr_matrix(whole + shift * mass), np.repeat(place, 3, 0))
    start = np.random.default_rng(0).standard_normal((n, N_MODE + 6))
    value, vector = lowest_modes(factor.solve, lambda x: mass @ x, shift, start, N_MODE, 1e-10)
    top = np.flatnonzero(place[:, 2] == place[:, 2].max())
    grid = [np.linspace(0.1 * side, side, k) for side, k in zip(SIDES[:2], N_SENSOR, strict=True)]
    wanted = np.stack(np.meshgrid(*grid, indexing="ij"), axis=-1).reshape(-1, 2)
    node = top[np.argmin(np.linalg.norm(place[top, None, :2] - wanted, axis=2), axis=0)]
    rng, seen = np.random.default_rng(1), vector[3 * node + 2, :N_MODE]
    shape = seen + 0.01 * np.sqrt(np.mean(seen**2, axis=0)) * rng.standard_normal(seen.shape)
    points = np.column_stack([np.arange(len(node)) + 1, 1e3 * place[node]])
    np.savez(
        folder / "test.npz", points=points, shape=shape,
        frequency=np.sqrt(value) / (2.0 * np.pi) * (1.0 + 2e-4 * rng.standard_normal(N_MODE)),
    )  # fmt: skip
    return truth


def fitted(folder: Path) -> tuple[int, float, float, float, dict[str, tuple[float, float]]]:
    """Read a structure and fit it.

    Returns its size, processor seconds of both, memory, GB, and the factors with their standard deviations.
    """
    begun = time.process_time()
    structure = model.read_matrices(folder / "structure.toml")
    read = time.process_time() - begun
    test = np.load(folder / "test.npz")
    modes = as_measured(folder, test["frequency"], test["shape"], test["points"])
    begun = time.process_time()
    fit = fit_matrices(structure, modes)
    found = {one.name: (one.value, one.std) for one in fit.moved}
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    return structure.node.size, read, time.process_time() - begun, memory, found


def run(size: int, form: str) -> LargeCase:
    """Write a structure and fit it, each in a process of its own."""
    with (
        tempfile.TemporaryDirectory() as name,
        multiprocessing.get_context("spawn").Pool(1, maxtasksperchild=1) as pool,
    ):
        truth = pool.apply(write, (Path(name), size, form))
        n, read, fit, memory, found = pool.apply(fitted, (Path(name),))
    one = [found[f"part_{j}"] for j in range(len(truth))]
    error = float(max(abs(value - true) / std for (value, std), true in zip(one, truth, strict=True)))
    return LargeCase(size=size, form=form, n=n, read=read, fitted=fit, memory=memory, error=error)


def planned() -> list[tuple[int, str]]:
    """Return sizes and forms, the smallest first."""
    return [(size, form) for size in SIZES for form in FORMS]


def study_of(n: int, record: Path) -> list[LargeCase]:
    """Run the first n cases, or go on with them."""
    show = partial(print, flush=True)
    return study(planned()[:n], run, record, LargeCase, lambda c: (c.size, c.form), say=show)


def rows(cases: list[LargeCase]) -> list[str]:
    """Return a line for each case."""
    return [
        f"| {c.n:,} degrees of freedom, {c.form} | read {c.read:.0f} s | reduced and fitted {c.fitted:.0f} s | "
        f"{c.memory:.1f} GB | factors within {c.error:.1f} of their standard deviations |"
        for c in cases
    ]
