"""The laminated model's speed and accuracy beside SuperLU on the full matrices: `make benchmark`."""

import dataclasses
import gc
import resource
import time
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse.linalg as splinalg

import model
from model.contact.contact import tangential_krons
from model.modes.refinement import residual_error
from tests.full_matrices import shifted_inverse

pytestmark = pytest.mark.benchmark

N_MODE = 16  # six rigid-body modes and the first ten elastic ones
ANYWHERE = model.Observation(node=[1], location=[[0.1, 0.0, 0.0]], direction=[[0.0, 0.0, 1.0]])


def stack(n_lamina: int, n_x: int, n_y: int) -> model.Stack:
    return model.Stack(
        name="benchmark",
        length=0.3,
        width=0.08,
        height=0.065 * n_lamina / 240,
        n_lamina=n_lamina,
        material=model.Material(young=2e11, poisson=0.28, density=7650.0),
        contact=model.Contact(G_f=825.0, d_f=5e-11, pressure=320e3, normal_modulus=5e9),
        mesh=model.Mesh(n_x=n_x, n_y=n_y),
    )


def uneven(assembly: model.Assembly) -> tuple[model.Term, ...]:
    """Return what makes interfaces random by 30 %, five of them weak, and the pressure fall along x."""
    n = assembly.n_z["w"] - 1
    change = np.random.default_rng(0).uniform(-0.3, 0.3, n)
    change[np.linspace(1, n - 2, 5).astype(int)] = -0.95
    x = assembly.plan.quadrature_points[0]
    krons = tangential_krons(assembly.plan, 0.065 / 240, 320e3 * change, 1.0 + x / 4.0)
    factor = model.Monomial(exponent={"G_f": 1, "amount": 1})
    return (model.Term(name="uneven", target="K", factor=factor, krons=krons),)


def ring() -> model.Stack:
    """Return the shipped stator under even pressure with about 5,000 nodes a lamina."""
    shipped = model.read_stack(Path(__file__).parents[2] / "data/stator/stack.toml")
    even = dataclasses.replace(shipped, pressing=None, clamps=(), mesh=model.Mesh(n_x=52))
    return even.with_contact(G_f=825.0, normal_modulus=1e9)


class Clock:
    def __enter__(self):
        gc.collect()
        self._start = (time.perf_counter(), time.process_time())
        return self

    def __exit__(self, *_):
        self.wall = time.perf_counter() - self._start[0]
        self.cpu = time.process_time() - self._start[1]


def line(work: str, clock: Clock, worst: float, bound: float) -> None:
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    print(f"{work:<58s} {clock.wall:8.3f} {clock.cpu:8.3f} {memory:8.2f}   {worst:8.1e}   {bound:8.1e}", flush=True)


def frequencies(system: model.ReducedSystem) -> np.ndarray:
    modes = model.solve_modes(system, G_f=825.0, d_f=0.0, n_mode=N_MODE, observation=ANYWHERE)
    return modes.elastic().frequency


def by_superlu(stiffness, mass) -> np.ndarray:
    """Return elastic frequencies by ARPACK with a SuperLU factor in its symmetric mode."""
    sigma = -1e6
    inverse = shifted_inverse(stiffness, mass, sigma)
    values = splinalg.eigsh(stiffness, N_MODE, mass, sigma=sigma, OPinv=inverse, return_eigenvectors=False, tol=1e-12)
    return np.sqrt(np.sort(values)[6:]) / (2.0 * np.pi)


def test_speed_and_accuracy():
    print(
        f"\n{'work (first 10 elastic modes)':<58s} {'wall s':>8s} {'CPU s':>8s} {'peak GiB':>8s}   "
        f"{'worst':>8s}   {'bound':>8s}"
    )
    for kind, terms, bound in (("uniform", None, 1e-5), ("uneven", uneven, 5e-5)):
        added = {} if terms is None else {"terms": terms, "theta": {"amount": 1.0}}
        small = stack(48, 16, 4)
        with Clock() as clock:
            system = model.reduce(small, n_mode=N_MODE + 2, n_snapshot=1, **added)
            found = frequencies(system)
        matrices = [system.laminas.matrix(target, system.theta).tocsc() for target in ("K", "M")]
        with Clock() as direct:
            exact = by_superlu(*matrices)
        size = system.laminas.size
        error = np.max(np.abs(found / exact - 1.0))
        line(f"48 laminas x 16 x 4, {size} DOF, {kind}: reduced", clock, error, bound)
        line(f"48 laminas x 16 x 4, {size} DOF, {kind}: SuperLU, full matrices", direct, 0.0, 0.0)
        assert error < bound
        assert clock.cpu < direct.cpu

    for mesh, kind, terms, bound in (
        ((24, 8), "uniform", None, 1e-5),
        ((24, 8), "uneven", uneven, 5e-5),
        ((60, 16), "uniform", None, 1e-5),
    ):
        added = {} if terms is None else {"terms": terms, "theta": {"amount": 1.0}}
        with Clock() as clock:
            system = model.reduce(stack(240, *mesh), n_mode=N_MODE + 2, n_snapshot=1, **added)
            frequencies(system)
        with Clock() as verified:
            refined = model.refine(system, G_f=825.0, n_mode=N_MODE)
        name = f"240 laminas x {mesh[0]} x {mesh[1]}, {system.laminas.size} DOF, {kind}"
        line(f"{name}: reduced", clock, refined.reduction_error.max(), bound)
        line(f"{name}: verify, refine", verified, refined.error.max(), 1e-6)
        assert refined.converged
        assert refined.reduction_error.max() < bound

    with Clock() as clock:
        system = model.reduce(ring(), n_mode=N_MODE + 2, n_snapshot=1)
        frequencies(system)
    with Clock() as verified:
        error = residual_error(system, G_f=825.0, n_mode=N_MODE).max()
    nodes = system.laminas.plan.size("u")
    name = f"stator of 12 teeth, 240 laminas x {nodes} nodes, {system.laminas.size} DOF"
    line(f"{name}: reduced", clock, error, 1e-4)
    line(f"{name}: error estimate", verified, error, 1e-4)
    assert error < 1e-4

    ranges = {"young": (0.9, 1.1), "density": (0.9, 1.1), "normal_modulus": (0.3, 3.0)}
    with Clock() as clock:
        system = model.reduce(stack(240, 24, 8), n_mode=N_MODE + 2, ranges=ranges)
    points = np.random.default_rng(1).random((3, 4))
    worst = 0.0
    for point in points:
        theta = {
            name: low + (high - low) * part
            for (name, (low, high)), part in zip(system.ranges.items(), point, strict=True)
        }
        refined = model.refine(
            system, G_f=theta.pop("G_f"), n_mode=N_MODE, parameters=theta, max_steps=2, tolerance=1e-5
        )
        worst = max(worst, refined.reduction_error.max())
    line(f"four parameters, {4 * len(system.ranges)} snapshots", clock, worst, 1e-4)
    tied = model.observe(system, ANYWHERE)
    with Clock() as clock:
        for _ in range(20):
            model.solve_modes(system, G_f=900.0, d_f=1e-11, n_mode=N_MODE, observation=tied)
    clock.wall, clock.cpu = clock.wall / 20, clock.cpu / 20
    line("  a new set of parameters, with gradients", clock, worst, 1e-4)
    assert worst < 1e-4
