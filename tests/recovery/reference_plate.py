"""A thin plate that `model` did not make: quintic triangles (Argyris) of scikit-fem, with springs along an edge.

Nothing here uses `model`: what it makes is what a laboratory would measure of such a plate.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import scipy.linalg as la
import skfem
from numpy.typing import NDArray
from skfem.helpers import dd, ddot, dot, eye, grad, trace

from ema.types.frf import Dofs, Geometry
from ema.types.modal_model import ModalModel

Array = NDArray[np.float64]

LENGTH, WIDTH, THICKNESS = 0.42, 0.26, 3e-3
YOUNG, POISSON, DENSITY = 2e11, 0.3, 7850.0
RIGIDITY = YOUNG * THICKNESS**3 / (12.0 * (1.0 - POISSON**2))
FREQUENCY_STD, SHAPE_STD = 3e-4, 5e-3


@dataclass(frozen=True, kw_only=True)
class Edge:
    """Springs along the edge at the lowest x: N/m per m against moving, N m/rad per m against turning."""

    translation: float
    rotation: float


@cache
def free_plate(mesh: tuple[int, int]) -> tuple[skfem.Basis, Any, Array]:
    """Return the elements of a plate, its stiffness, sparse, and its mass."""
    grid = skfem.MeshTri.init_tensor(np.linspace(0.0, LENGTH, mesh[0] + 1), np.linspace(0.0, WIDTH, mesh[1] + 1))
    basis = skfem.Basis(grid, skfem.ElementTriArgyris(), intorder=8)

    @skfem.BilinearForm
    def bending(u, v, _):
        def moment(w):
            return RIGIDITY * ((1.0 - POISSON) * dd(w) + POISSON * eye(trace(dd(w)), 2))

        return ddot(moment(u), dd(v))

    @skfem.BilinearForm
    def inertia(u, v, _):
        return DENSITY * THICKNESS * u * v

    return basis, skfem.asm(bending, basis), skfem.asm(inertia, basis).toarray()


@cache
def stiffness_of(mesh: tuple[int, int], edge: Edge | None) -> Array:
    """Return the stiffness of a plate with springs along its edge."""
    basis, stiffness, _ = free_plate(mesh)
    if edge is None:
        return stiffness.toarray()
    held = skfem.FacetBasis(
        basis.mesh, basis.elem, facets=basis.mesh.facets_satisfying(lambda x: np.isclose(x[0], 0.0)), intorder=8
    )

    @skfem.BilinearForm
    def springs(u, v, w):
        return edge.translation * u * v + edge.rotation * dot(grad(u), w.n) * dot(grad(v), w.n)

    return (stiffness + skfem.asm(springs, held)).toarray()


def plate_modes(
    n_mode: int,
    edge: Edge | None,
    places: Array,
    mesh: tuple[int, int] = (6, 4),
    mass: tuple[float, float, float] | None = None,
) -> tuple[Array, Array]:
    """Return frequencies (n_mode,), Hz, and deflections (n_place, n_mode) at places (n_place, 2), m.

    `mass` adds so many kg at a place, as (x, y, kg).
    """
    basis, _, heavy = free_plate(mesh)
    first = 3 if edge is None else 0
    if mass is not None:
        row = basis.probes(np.array([[mass[0] + LENGTH / 2.0], [mass[1] + WIDTH / 2.0]])).toarray()
        heavy = heavy + mass[2] * row.T @ row
    values, vectors = la.eigh(stiffness_of(mesh, edge), heavy, subset_by_index=[first, first + n_mode - 1])
    inside = np.clip(places.T + np.array([[LENGTH], [WIDTH]]) / 2.0, 1e-9, np.array([[LENGTH], [WIDTH]]) - 1e-9)
    return np.sqrt(values) / (2.0 * np.pi), basis.probes(inside) @ vectors


def grid_of_points(n_x: int = 7, n_y: int = 5) -> Array:
    """Return measured points of the plan, (n, 2) m from its centre; none on the edge at the lowest x."""
    x = np.linspace(-0.5, 0.5, n_x + 1)[1:] * LENGTH
    y = np.linspace(-0.5, 0.5, n_y) * WIDTH
    return np.array([(a, b) for a in x for b in y])


def measured(
    edge: Edge | None,
    n_mode: int = 10,
    seed: int = 0,
    damping: float = 2e-3,
    mass: tuple[float, float, float] | None = None,
) -> ModalModel:
    """Return what a test of the plate identifies, with noise."""
    places = grid_of_points()
    frequency, deflection = plate_modes(n_mode, edge, places, mass=mass)
    random, n = np.random.default_rng(seed), len(places)
    largest = np.abs(deflection).max(axis=0)
    frequency = frequency * (1.0 + FREQUENCY_STD * random.standard_normal(n_mode))
    shape = deflection / largest + SHAPE_STD * random.standard_normal(deflection.shape)
    ratio = damping * (1.0 + 0.05 * random.standard_normal(n_mode))
    pole = 2.0 * np.pi * frequency * (-ratio + 1j * np.sqrt(1.0 - ratio**2))
    spread = np.empty(2 * n_mode)
    spread[0::2], spread[1::2] = 0.05 * np.abs(pole.real), FREQUENCY_STD * pole.imag
    node = np.arange(1, n + 1)
    zero = np.zeros((n, 1))
    return ModalModel(
        name="plate",
        frequency=frequency,
        damping=ratio,
        frequency_std=FREQUENCY_STD * frequency,
        damping_std=0.05 * ratio,
        pole=pole,
        residue=(shape / (2j * pole.imag))[:, None, :],
        outside_pole=np.empty(0, complex),
        outside_residue=np.empty((n, 1, 0), complex),
        lower=zero.astype(complex),
        upper=zero.astype(complex),
        shape=shape.astype(complex),
        shape_std=np.full(shape.shape, SHAPE_STD),
        scaled=np.zeros(n_mode, dtype=bool),
        node=node,
        direction=np.tile([0.0, 0.0, 1.0], (n, 1)),
        sensor=np.zeros(n, dtype=np.int64),
        input=Dofs(node=node[-1:], direction=np.array([[0.0, 0.0, 1.0]])),
        band=(1.0, 1.1 * float(frequency.max())),
        geometry=Geometry(
            node=node, coordinate=np.column_stack([places, np.zeros(n)]), line=np.empty((0, 2), np.int64)
        ),
        quantity="accelerance",
        covariance=np.diag(spread**2),
        residue_std=np.full((n, 1, n_mode), SHAPE_STD),
        noise=zero,
        correlation=np.ones((n, 1)),
        error=zero,
        run=np.array([0]),
        run_pole=pole[None],
        run_frequency_std=(FREQUENCY_STD * frequency)[None],
        run_damping_std=(0.05 * ratio)[None],
        run_probability=np.ones((1, n_mode)),
        unexplained=(),
    )
