"""States of a simulated structure, assembled anew each time, with and without a change.

The structure is a simply supported plate that is seen at 24 points. Assembly changes its stiffness by a random
symmetric matrix in modal coordinates, a part of which is common to all modes: it moves frequencies and mixes shapes as
in real structures. Laboratories differ in how well they assemble, and none states it: the comparison has its default.
"""

from dataclasses import dataclass

import numpy as np
from scipy.stats import binomtest

from ema.modal.change import change
from ema.types.frf import Dof, Dofs, Geometry
from updating.pooled.specimen import assembled

N_MODE = 10
SEEN = slice(0, 7)
"""Modes that are measured; those above mix into them all the same."""


@dataclass(frozen=True, kw_only=True)
class Laboratory:
    """How a laboratory assembles and measures; relative standard deviations."""

    frequency: float
    damping: float
    sensor: float
    common: float
    noise: float
    unequal: float


def laboratory(random, *, frequency=2.2e-3):
    """Draw a laboratory whose frequencies scatter by 0.1 to 0.5 %, damping ratios by 5 to 30 %, in nine of ten."""
    return Laboratory(
        frequency=frequency * np.exp(0.5 * random.standard_normal()),
        damping=0.12 * np.exp(0.55 * random.standard_normal()),
        sensor=random.uniform(0.003, 0.02),
        common=random.uniform(0.0, 0.9),
        noise=random.choice([1e-5, 3e-4]),
        unequal=random.uniform(0.0, 0.4),
    )


class Plate:
    """A plate of random side ratio; two of its modes may be close."""

    def __init__(self, random):
        ratio = random.uniform(0.4, 1.0)
        waves = sorted(
            ((m, n) for m in range(1, 8) for n in range(1, 8)), key=lambda w: w[0] ** 2 + (w[1] / ratio) ** 2
        )
        x, y = (grid.ravel() for grid in np.meshgrid((np.arange(6) + 0.7) / 7, (np.arange(4) + 0.6) / 5))
        waves = waves[:N_MODE]
        self.shape = np.array([np.sin(m * np.pi * x) * np.sin(n * np.pi * y) for m, n in waves]).T
        self.frequency = 20.0 * np.array([m**2 + (n / ratio) ** 2 for m, n in waves])
        self.damping = 0.004 * np.exp(0.3 * random.standard_normal(N_MODE))
        self.place = np.column_stack([x, y, 0.0 * x])

    def assembled(self, random, lab, name, *, softer=0.0, mode=0):
        """Return a state as it is identified; one mode may be softer by a share of its stiffness."""
        uneven = np.exp(lab.unequal * random.standard_normal(N_MODE))
        one = random.standard_normal((N_MODE, N_MODE)) * np.sqrt(np.outer(uneven, uneven))
        one = (one + one.T) / np.sqrt(2.0) * np.sqrt(1.0 - lab.common)  # twice the variance on the diagonal
        one += np.sqrt(2.0 * lab.common) * random.standard_normal() * np.eye(N_MODE)
        relative = np.eye(N_MODE) + np.sqrt(2.0) * lab.frequency * one
        relative[mode, mode] -= softer
        values, vectors = np.linalg.eigh(np.outer(self.frequency, self.frequency) * relative)
        shape = (self.shape @ vectors)[:, SEEN]
        frequency, damping = np.sqrt(values)[SEEN], self.damping[SEEN]
        damping = damping * np.exp(lab.damping * random.standard_normal(damping.size))
        shape = shape * (1.0 + lab.sensor * random.standard_normal((len(shape), 1)))
        shape = shape / np.abs(shape).max(axis=0)
        d_noise, s_noise = max(20.0 * lab.noise, 1e-3), max(10.0 * lab.noise, 1e-3)
        return assembled(
            name,
            np.array([
                frequency * (1.0 + lab.noise * random.standard_normal(frequency.size)),
                lab.noise * frequency,
                damping * (1.0 + d_noise * random.standard_normal(damping.size)),
                d_noise * damping,
            ]),
            (shape + s_noise * random.standard_normal(shape.shape), np.full(shape.shape, s_noise)),
            geometry=Geometry(node=np.arange(1, 25), coordinate=self.place, line=np.empty((0, 2), dtype=int)),
            dofs=Dofs(node=np.arange(1, 25), direction=np.tile([0.0, 0.0, 1.0], (24, 1))),
            sensor=np.zeros(24, dtype=np.int64),
            force=Dof(1, (0.0, 0.0, 1.0)),
        )  # fmt: skip


def compared(seed, *, scatters=0.0, n_reference=None, frequency=2.2e-3):
    """Compare a state with its reference, one mode of which is moved by some scatters of the difference.

    Returns
    -------
    tuple of (Change, int)
        What was found, and the number of the mode that was moved, from 0.
    """
    random = np.random.default_rng(seed)
    lab, plate = laboratory(random, frequency=frequency), Plate(random)
    n = int(random.integers(1, 5)) if n_reference is None else n_reference
    mode = int(random.integers(0, 5))
    softer = 2.0 * scatters * lab.frequency * np.sqrt(1.0 + 1.0 / n)
    before = [plate.assembled(random, lab, f"R{k}") for k in range(n)]
    after = plate.assembled(random, lab, "S", softer=softer, mode=mode)
    return change([after], before), mode


def interval(hits, total):
    """Return a rate with its 95 % interval as text."""
    low, high = binomtest(hits, total).proportion_ci(method="exact")
    return f"{hits} of {total} = {100 * hits / total:.1f} % ({100 * low:.1f} to {100 * high:.1f})"
