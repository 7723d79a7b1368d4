"""Structures whose symmetry gives two modes one frequency: a simply supported square plate and a stator's ring.

Their closed forms are summed; nothing of `ema` or `model` is used for that. Forces act at several points.
"""

from dataclasses import dataclass

import numpy as np

from ema.types.frf import FRF, Dofs, Geometry

DAMPING = 0.004


@dataclass(frozen=True)
class SymmetricStructure:
    """Modes of a structure, mass-normalised shapes at its points, and what of it is measured."""

    frequency: np.ndarray  # (n_mode,), Hz
    shape: np.ndarray  # (n_point, n_mode), 1/sqrt(kg)
    coordinate: np.ndarray  # (n_point, 3), m
    direction: np.ndarray  # (n_point, 3)
    forces: tuple[int, ...]
    lines: np.ndarray

    @property
    def geometry(self):
        return Geometry(
            node=np.arange(len(self.shape)),
            coordinate=self.coordinate[: len(self.shape)],
            line=np.empty((0, 2)),
            axes=(),
        )

    @property
    def seen(self):
        """Which modes the band holds."""
        return (self.frequency > self.lines[0]) & (self.frequency < self.lines[-1])

    def clean(self):
        """Accelerance at all points to all forces, (n_point, n_force, n_line)."""
        one, omega = 2 * np.pi * self.frequency[:, None], 2 * np.pi * self.lines
        ratio = -(omega**2) / (one**2 - omega**2 + 2j * DAMPING * one * omega)
        return np.einsum("or,ir,rf->oif", self.shape, self.shape[list(self.forces)], ratio)

    def measured(self, rng, noise=0.01):
        """FRFs with noise relative to the root mean square of each."""
        clean = self.clean()
        normal = rng.standard_normal(clean.shape) + 1j * rng.standard_normal(clean.shape)
        level = noise * np.sqrt(np.mean(np.abs(clean) ** 2, axis=-1, keepdims=True) / 2)
        dofs = Dofs(node=np.arange(len(self.shape)), direction=self.direction)
        forces = list(self.forces)
        return FRF(
            frequency=self.lines,
            value=clean + level * normal,
            quantity="accelerance",
            output=dofs,
            input=Dofs(node=forces, direction=self.direction[forces]),
            run=np.zeros(len(self.shape), dtype=int),
            source=("generated",) * len(self.shape),
        )


def square_plate(split=0.0):
    """A plate of 2 kg, simply supported: sines, frequencies as m^2 + n^2 (Leissa, Vibration of Plates, ch. 4).

    Its sides differ by as much as makes (m, n) and (n, m) differ by about `split`.
    """
    order = np.array([(m, n) for m in range(1, 8) for n in range(1, 8)])
    # of the pair (1, 2): its difference is 3 / 5 of what the sides' squares differ by
    sides = 1.0 + split * 5.0 / 3.0 * np.array([0.5, -0.5])
    frequency = 40.0 * (order**2 @ sides)
    x, y = (axis.ravel() for axis in np.meshgrid(np.arange(1, 6) / 6.0, np.arange(1, 6) / 6.0))
    shape = np.sqrt(2.0) * np.sin(np.pi * np.outer(x, order[:, 0])) * np.sin(np.pi * np.outer(y, order[:, 1]))
    return SymmetricStructure(
        frequency=frequency,
        shape=shape,
        coordinate=np.stack([x, y, 0 * x], axis=1),
        direction=np.tile([0.0, 0.0, 1.0], (x.size, 1)),
        forces=(1, 5),
        lines=np.arange(50.0, 560.0, 0.25),
    )


def stator_ring(split=0.0, n_point=24):
    """A thin ring of 5 kg: cos and sin around it (Love, Mathematical Theory of Elasticity, sec. 293), radially."""
    n = np.repeat(np.arange(2, 10), 2)
    angle = 2 * np.pi * np.arange(n_point) / n_point
    turned = 0.3 * n + np.tile([0.0, np.pi / 2], n.size // 2)
    frequency = 60.0 * n * (n**2 - 1) / np.sqrt(n**2 + 1) * (1 + split * np.tile([-0.5, 0.5], n.size // 2))
    shape = np.cos(np.outer(angle, n) + turned) * np.sqrt(2 / (5.0 * (1 + n**-2.0)))
    radial = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    return SymmetricStructure(
        frequency=frequency,
        shape=shape,
        coordinate=0.1 * radial,
        direction=radial,
        forces=(0, 5),
        lines=np.arange(80.0, 1700.0, 0.5),
    )
