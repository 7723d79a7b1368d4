"""Chains whose sensors are so heavy that modes of different runs are several bandwidths apart.

Masses, springs, the place of the force, and which sensors sit where in which run are drawn; each run's equations are
solved with its sensors on it, and nothing of `ema` is used for that.
"""

from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from ema.types.frf import FRF, Dofs, Geometry

N, N_SEEN = 12, 5
SHIFTS = 0.005, 0.04


@dataclass(frozen=True, kw_only=True)
class Chain:
    """A chain, its test, and the sensors' mass, kg, that moves its modes by up to `shift`."""

    masses: NDArray
    stiffness: NDArray
    damping: NDArray
    force: int
    run: NDArray
    shift: float
    mass: float

    def modes(self, points=(), mass=0.0) -> tuple[NDArray, NDArray]:
        """Frequencies, Hz, and mass-normalised shapes with a mass, kg, on some points."""
        total = np.diag(self.masses)
        total[points, points] += mass
        square, shape = la.eigh(self.stiffness, total)
        return np.sqrt(square) / (2.0 * np.pi), shape

    @property
    def band(self) -> tuple[float, float]:
        frequency = self.modes()[0]
        return 0.5 * frequency[0], 0.5 * (frequency[N_SEEN - 1] + frequency[N_SEEN])

    def shifts(self, mass: float) -> NDArray:
        """By which share the sensors of each run lower each mode of the band, (n_run, n_mode)."""
        bare = self.modes()[0][:N_SEEN]
        runs = [self.modes(np.flatnonzero(self.run == k), mass)[0][:N_SEEN] for k in range(self.run.max() + 1)]
        return 1.0 - np.array(runs) / bare


GEOMETRY = Geometry(node=np.arange(N), coordinate=np.outer(np.arange(N), [0.1, 0, 0]), line=np.empty((0, 2)))


def drawn(rng: np.random.Generator) -> Chain:
    """A chain with sensors of a mass that moves a mode by a share of `SHIFTS`."""
    spring = 1.48e6 * rng.uniform(0.8, 1.2, N + 1)
    sensors = int(rng.choice([1, 2, 3]))
    chain = Chain(
        masses=rng.uniform(0.8, 1.2, N),
        stiffness=np.diag(spring[1:] + spring[:-1]) - np.diag(spring[1:-1], 1) - np.diag(spring[1:-1], -1),
        damping=np.resize(rng.permutation([0.01, 0.004, 0.006, 0.003]), N),
        force=int(rng.integers(N)),
        run=rng.permutation(np.arange(N) // sensors),
        shift=float(rng.uniform(*SHIFTS)),
        mass=0.0,
    )
    low, high = 0.0, 3.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if chain.shifts(middle).max() < chain.shift else (low, middle)
    return Chain(**{**vars(chain), "mass": low})


def measured(chain: Chain, rng: np.random.Generator, *, force: float = 5e-3, response: float = 3e-3) -> FRF:
    """FRFs with noise: of the force, common to a run, relative to them; of responses relative to their r.m.s."""

    def normal(*shape):
        return (rng.standard_normal(shape) + 1j * rng.standard_normal(shape)) / np.sqrt(2)

    lines = np.arange(np.ceil(4.0 * chain.band[0]) / 4.0, chain.band[1], 0.25)
    omega, value = 2.0 * np.pi * lines, np.empty((N, lines.size), dtype=complex)
    for k in range(chain.run.max() + 1):
        points = np.flatnonzero(chain.run == k)
        frequency, shape = chain.modes(points, chain.mass)
        one = 2.0 * np.pi * frequency[:, None]
        dynamic = one**2 - omega**2 + 2j * chain.damping[:, None] * one * omega
        value[points] = (shape[points] * shape[chain.force]) @ (-(omega**2) / dynamic)
    level = response * np.sqrt(np.mean(np.abs(value) ** 2, axis=1, keepdims=True))
    value = value * (1.0 + force * normal(chain.run.max() + 1, lines.size)[chain.run]) + level * normal(*value.shape)
    up = np.tile([0.0, 0.0, 1.0], (N, 1))
    return FRF(
        frequency=lines,
        value=value[:, None],
        quantity="accelerance",
        output=Dofs(node=np.arange(N), direction=up),
        input=Dofs(node=[chain.force], direction=up[:1]),
        run=chain.run,
        source=("generated",) * N,
    )
