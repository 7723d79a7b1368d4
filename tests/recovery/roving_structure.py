"""A chain of masses measured with two sensors that rove: what differs from run to run is known.

The equations of each run are solved by themselves, with its sensors on it; nothing of `ema` is used for that.
"""

import numpy as np
import scipy.linalg as la

from ema.types.frf import FRF, Dofs, Geometry

N, SENSORS, FORCE = 12, 2, 3
RUN = np.arange(N) // SENSORS
BAND = (20.0, 200.0)
LINES = np.arange(BAND[0], BAND[1] + 0.1, 0.25)
DAMPING = np.resize([0.01, 0.004, 0.006, 0.003], N)
STIFFNESS = 1.48e6 * (2.0 * np.eye(N) - np.eye(N, k=1) - np.eye(N, k=-1))
N_SEEN = 4
GEOMETRY = Geometry(node=np.arange(N), coordinate=np.outer(np.arange(N), [0.1, 0, 0]), line=np.empty((0, 2)))


def modes(points=(), mass=0.0):
    """Frequencies, Hz, and mass-normalised shapes with a mass, kg, on some points."""
    total = np.eye(N)
    total[points, points] += mass
    square, shape = la.eigh(STIFFNESS, total)
    return np.sqrt(square) / (2 * np.pi), shape


def accelerance(points, mass, stretched):
    """Functions of the sensors of a run, its frequencies stretched by a factor."""
    frequency, shape = modes(points, mass)
    one, omega = 2 * np.pi * stretched * frequency[:, None], 2 * np.pi * LINES
    dynamic = one**2 - omega**2 + 2j * DAMPING[:, None] * one * omega
    return (shape[points] * shape[FORCE]) @ (-(omega**2) / dynamic)


def measured(rng, *, mass=0.0, stretched=None, force=5e-3, response=3e-3):
    """FRFs with noise: that of the force, common to a run, relative to them; of responses relative to their r.m.s."""

    def normal(*shape):
        return (rng.standard_normal(shape) + 1j * rng.standard_normal(shape)) / np.sqrt(2)

    n_run = RUN.max() + 1
    stretched = np.ones(n_run) if stretched is None else stretched
    clean = np.concatenate([accelerance(np.flatnonzero(k == RUN), mass, stretched[k]) for k in range(n_run)])
    level = response * np.sqrt(np.mean(np.abs(clean) ** 2, axis=1, keepdims=True))
    value = clean * (1 + force * normal(n_run, LINES.size)[RUN]) + level * normal(*clean.shape)
    up = np.tile([0.0, 0.0, 1.0], (N, 1))
    return FRF(
        frequency=LINES,
        value=value[:, None],
        quantity="accelerance",
        output=Dofs(node=np.arange(N), direction=up),
        input=Dofs(node=[FORCE], direction=up[:1]),
        run=RUN,
        source=("generated",) * N,
    )
