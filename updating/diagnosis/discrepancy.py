"""What a model that is only nearly right leaves between itself and a measurement: sizes, structure and priors.

Beside the noise of the measurement, every model misses every mode by a little. By how much is not known beforehand,
so the size of that discrepancy is estimated for each kind of data, and every explanation is judged with all plausible
sizes (Kennedy and O'Hagan, J. R. Stat. Soc. B 63, 2001; Beck and Katafygiotis, J. Eng. Mech. 124, 1998; Simoen, De
Roeck and Lombaert, Mech. Syst. Signal Process. 56-57, 2015). Its structure is known better than its size:

- A mode is missed by nearly the same in all configurations of a stack, so what changes between them is known best.
- A shape is wrong along other modes, by c_rs = a k_rs with k_rs = w_r w_s / (w_r**2 - w_s**2) where stiffness is wrong
  and w_r**2 / (w_s**2 - w_r**2) where mass is (Fox and Kapoor, AIAA J. 6, 1968). So modes close to each other are
  compared as the subspace that they span, and no threshold says what is close. The modes above those that are solved
  take part too: what a model misses at a clamp or an edge is theirs, and the higher a mode, the more of it.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

Vector = NDArray[np.float64]
Kind = Literal["frequency", "damping", "shape"]

KINDS: tuple[Kind, ...] = ("frequency", "damping", "shape")
MEDIAN = {"frequency": 3e-3, "damping": 0.1, "shape": 2e-2}
"""Medians of the sizes: relative for frequencies and damping ratios, and of a shape's length. Models of built-up
structures that were updated are right to 0.5 to 2 % of a frequency, reassembly of bolted ones changes 0.1 to 0.5 % of a
frequency and 5 to 30 % of a damping ratio."""
SPREAD = float(np.log(5.0) / 1.645)
"""Standard deviation of the logarithm of a size: nine of ten lie within a factor of 5 of the median."""
CORRELATION = 0.9
"""Of the discrepancy of one mode between two configurations."""
RANGE = (1.0 / 60.0, 20.0)
"""Smallest and largest size that is supposed, over the median."""
_FAR, _BEYOND = 0.02, 0.2
"""Size of a discrepancy of frequencies from which on it is implausible to be larger than that of shapes, and the
standard deviation of its logarithm beyond."""
CLOSEST = 2000.0
"""k_rs of modes so close that any mixture of them is possible."""
_USUAL = 5.0  # k_rs of modes 10 % apart: the length of a shape's discrepancy is stated without closer pairs
_N_ABOVE = 200  # modes above those that are solved: further ones take no part
_CHANGES = 16.0  # k_rs of modes 3 % apart: closer ones may mix otherwise in another configuration
_ALONG = 10.0  # standard deviation of a shape along itself, over its length: its scale says nothing


@dataclass(frozen=True, kw_only=True)
class Sizes:
    """Sizes of the discrepancy: standard deviations relative to a frequency, a damping ratio and a shape's length."""

    frequency: float = MEDIAN["frequency"]
    damping: float = MEDIAN["damping"]
    shape: float = MEDIAN["shape"]

    def of(self, kind: NDArray[np.str_]) -> Vector:
        """Return the size that belongs to each row of data, (n,); 0 for what is no kind of data."""
        return np.asarray(sum((kind == name) * getattr(self, name) for name in KINDS), dtype=float)


def log_density(kind: Kind, size: Vector) -> Vector:
    """Return the logarithm of the prior density of the logarithms of sizes of one of `KINDS`."""
    away = np.log(size / MEDIAN[kind]) / SPREAD
    return np.asarray(-0.5 * away**2 - np.log(SPREAD * np.sqrt(2.0 * np.pi)))


def log_together(size: Vector) -> Vector:
    """Return what the prior density of the logarithms of sizes, (..., n_kind), says of them together.

    What bends no shape moves all frequencies alike, and that is what contact stiffness, steel and dimensions do. Errors
    of stiffness or mass that move each frequency otherwise bend shapes by more than that, see above. So frequencies are
    not off by per cents, and by more than shapes are, and a fit that is weighed so would leave them to small errors of
    shapes.
    """
    frequency, shape = size[..., KINDS.index("frequency")], size[..., KINDS.index("shape")]
    beyond = np.minimum(np.log(frequency / _FAR), np.log(frequency / shape))
    return np.asarray(-0.5 * (np.maximum(beyond, 0.0) / _BEYOND) ** 2)


@dataclass(frozen=True, eq=False, kw_only=True)
class Block:
    """Rows of data that are correlated: frequencies or damping ratios of one mode in all configurations, or all shapes.

    Attributes
    ----------
    row : (n,) int
        Which rows.
    rotation : (n, n) float
        Makes their noise white and their discrepancy uncorrelated.
    growth : (n,) float
        Variance of each rotated row by a discrepancy of unit size, over that of its noise.
    log_noise : float
        Logarithm of the determinant of the noise's covariance.
    """

    row: NDArray[np.intp]
    rotation: Vector
    growth: Vector
    log_noise: float


@dataclass(frozen=True, eq=False, kw_only=True)
class Discrepancy:
    """The covariance of what separates a model from a measurement, for every size that the discrepancy may have.

    Attributes
    ----------
    blocks : tuple of Block
        They hold every row of data once.
    """

    blocks: tuple[Block, ...]

    @cached_property
    def growth(self) -> Vector:
        """Variance of each rotated row by a discrepancy of unit size, over that of its noise, (n,)."""
        growth = np.zeros(sum(block.row.size for block in self.blocks))
        for block in self.blocks:
            growth[block.row] = block.growth
        return growth

    @property
    def log_noise(self) -> float:
        """Logarithm of the determinant of the noise's covariance, which all explanations of one evidence share."""
        return sum(block.log_noise for block in self.blocks)

    def rotated(self, rows: Vector) -> Vector:
        """Return rows of data, (n,) or (n, m), with white noise and uncorrelated discrepancy."""
        out = np.empty_like(rows)
        for block in self.blocks:
            out[block.row] = block.rotation @ rows[block.row]
        return out


def block_of(row: NDArray[np.intp], noise: Vector, form: Vector) -> Block:
    """Return the block of rows with a noise and, at unit size, a discrepancy of given covariances, (n, n) each."""
    root = la.cholesky(noise, lower=True)
    inverse = la.solve_triangular(root, np.eye(len(root)), lower=True)
    growth, turn = la.eigh(inverse @ form @ inverse.T)
    return Block(
        row=row,
        rotation=turn.T @ inverse,
        growth=np.clip(growth, 0.0, None),
        log_noise=2.0 * float(np.sum(np.log(np.diag(root)))),
    )


def alike(n: int) -> Vector:
    """Return the correlation of a mode's discrepancy between n configurations, (n, n)."""
    return CORRELATION + (1.0 - CORRELATION) * np.eye(n)


@dataclass(frozen=True, eq=False, kw_only=True)
class Mixing:
    """How a shape may be wrong along other modes.

    Attributes
    ----------
    root : (n_dof, n_dof) float
        Square root of the covariance of the discrepancy at unit size.
    steady : (n_dof, n_dof) float
        The same of what it has in common with other configurations: close modes mix otherwise in each, for as little
        as changes their frequencies turns them, and past a crossing the other way round.
    meets : bool
        Whether another mode is so close that what the mode looks like is a matter of how these two mix.
    """

    root: Vector
    steady: Vector
    meets: bool

    def over(self, length: float) -> Mixing:
        """Return the mixing of a discrepancy whose unit is so many times as large."""
        return replace(self, root=self.root / length, steady=self.steady / length)


def mixing_of(mode: int, frequency: Vector, shape: Vector) -> tuple[Mixing, float]:
    """Return the mixing of a mode with m_rs and k_rs of 1, and the usual length of what it is wrong by.

    Parameters
    ----------
    mode : int
        Which of the modes.
    frequency : (n_mode,)
        Of all modes that the sensors see, Hz; 0 of rigid-body motion.
    shape : (n_dof, n_mode)
        Their shapes, of unit modal mass.

    Returns
    -------
    mixing : Mixing
    length : float
        Root of the sum of its variances, modes closer than 10 % counting as if they were that far.
    """
    other = np.arange(frequency.size) != mode
    own = frequency[mode]
    lean = _lean(own, frequency[other])
    columns = shape[:, other] / np.linalg.norm(shape[:, mode])
    seen = np.linalg.norm(columns, axis=0)
    by_above = np.sum(_lean(own, _above(frequency)) ** 2) * np.mean(seen**2) / len(shape)
    above = float(np.sqrt(by_above))  # in every direction
    root, steady = (_root(columns * own_lean, above) for own_lean in (lean, lean * (lean < _CHANGES)))
    meets = bool(np.any(lean * np.minimum(seen, 1.0) >= _CHANGES))
    return Mixing(root=root, steady=steady, meets=meets), float(
        np.linalg.norm(np.minimum(lean, _USUAL) * seen)
    )


def _root(columns: Vector, everywhere: float) -> Vector:
    """Return the symmetric square root of what columns and a standard deviation in every direction give together."""
    left, size, _ = la.svd(columns, full_matrices=False)
    return np.asarray(
        (left * (np.hypot(size, everywhere) - everywhere)) @ left.T + everywhere * np.eye(len(left))
    )


def _lean(own: float, others: Vector) -> Vector:
    """Return by how much a mode turns into others where stiffness and mass are wrong alike."""
    away = others**2 - own**2
    away = np.where(np.abs(away) < own**2 / CLOSEST, own**2 / CLOSEST, away)
    return np.asarray(np.hypot(own**2 / away, own * others / away) / np.sqrt(2.0))


def _above(frequency: Vector) -> Vector:
    """Return frequencies of the modes above some, which go on as densely as the upper half of these."""
    elastic = np.sort(frequency[frequency > 0.0])
    apart = (elastic[-1] - elastic[elastic.size // 2]) / max(elastic.size - 1 - elastic.size // 2, 1)
    return np.asarray(elastic[-1] + max(apart, elastic[-1] / elastic.size / 10.0) * np.arange(1, _N_ABOVE))


@dataclass(frozen=True, eq=False, kw_only=True)
class MeasuredShape:
    """A measured shape beside what may separate it from the model's.

    Attributes
    ----------
    row : (n_dof,) int
        Its rows of data.
    mode : int
        The mode of the stack, the same in all configurations.
    shape : (n_dof,) float
        As measured, at unit length: along it scale is free, and by their signs configurations are compared.
    std : (n_dof,) float
        Standard deviations of its components.
    slope : (n_dof, n_place) float
        Change by the errors of places that all shapes share, in standard deviations of these.
    mixing : Mixing
        Of the discrepancy at unit size.
    """

    row: NDArray[np.intp]
    mode: int
    shape: Vector
    std: Vector
    slope: Vector
    mixing: Mixing


def shape_block(shapes: Sequence[MeasuredShape]) -> Block:
    """Return the block of all shapes: errors of places are those of all, discrepancies alike in those of one mode."""
    noise = la.block_diag(
        *(np.diag(own.std**2) + _ALONG**2 * np.outer(own.shape, own.shape) for own in shapes)
    )
    slope = np.vstack([own.slope for own in shapes])
    noise += slope @ slope.T
    form = np.zeros_like(noise)
    edge = np.concatenate([[0], np.cumsum([own.row.size for own in shapes])])
    for (i, one), (j, other) in itertools.product(enumerate(shapes), repeat=2):
        at = slice(edge[i], edge[i + 1]), slice(edge[j], edge[j + 1])
        if i == j:
            form[at] = one.mixing.root @ one.mixing.root.T
        elif one.mode == other.mode and one.row.size == other.row.size:
            # sensors differ in number where a channel was left out of one configuration
            turned = 1.0 if one.shape @ other.shape >= 0.0 else -1.0
            form[at] = turned * CORRELATION * one.mixing.steady @ other.mixing.steady.T
    return block_of(np.concatenate([own.row for own in shapes]), noise, form)
