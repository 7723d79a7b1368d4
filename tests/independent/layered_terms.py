"""Equations of layers: which strains there are, their integrals, and freedoms in the order in which bands are narrow.

Fields are three arrays (n_x, n_y, n_z, k), one for each displacement: splines along x and y by functions of the height.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from tests.independent.bench import Array, Bench
from tests.independent.layered_blocks import Factor
from tests.independent.layered_effects import Laws, Part
from tests.independent.layered_plan import DEGREE, Plan

Fields = Sequence[Array]
Strain = tuple[tuple[int, tuple[int, int], str], ...]
"""Displacements with how often they are derived along x and y, and what is taken of the layers: see `Height`."""

SLIP: tuple[Strain, Strain] = (((0, (0, 0), "step"), (2, (1, 0), "mean")), ((1, (0, 0), "step"), (2, (0, 1), "mean")))
"""Slip of the facing surfaces over the pitch: the layers' motion, and the tilt of both of them."""
OPENING: Strain = ((2, (0, 0), "step"),)
STRETCH: tuple[Strain, Strain] = (((0, (1, 0), "layer"),), ((1, (0, 1), "layer"),))
DISTORTION: Strain = ((0, (0, 1), "layer"), (1, (1, 0), "layer"))
CURVATURE: tuple[Strain, Strain] = (((2, (2, 0), "layer"),), ((2, (0, 2), "layer"),))
TWIST: Strain = ((2, (1, 1), "layer"),)


class Height:
    """What strains take of the layers, in functions of the height.

    Attributes
    ----------
    basis : three (n_layer, n_z) float
        Orthonormal columns for each displacement.
    pitch : float
        Of the layers, m.
    """

    def __init__(self, basis: Sequence[Array], height: float):
        self.basis = tuple(basis)
        self.pitch = height / len(basis[0])

    def take(self, component: int, what: str) -> Array:
        """Return the values of layers, or their step over the pitch or mean at interfaces, (n_level, n_z)."""
        layer = self.basis[component]
        if what == "step":
            return np.diff(layer, axis=0) / self.pitch
        return layer if what == "layer" else 0.5 * (layer[1:] + layer[:-1])


@dataclass(frozen=True, kw_only=True)
class Term:
    """Part of a matrix between two displacements: (n_x, n_x, n_y, n_y) over the plan, (n_z, n_z) over the height."""

    row: int
    column: int
    planar: Array
    across: Array

    def times(self, fields: Fields) -> Array:
        """Return the product with the fields."""
        n_x, n_y = self.planar.shape[0], self.planar.shape[2]
        right = np.tensordot(self.across, fields[self.column], axes=(1, 2))
        planar = self.planar.transpose(0, 2, 1, 3).reshape(n_x * n_y, n_x * n_y)
        found = planar @ right.transpose(1, 2, 0, 3).reshape(n_x * n_y, -1)
        return found.reshape(n_x, n_y, len(self.across), -1)


def energy(terms: Iterable[Term], fields: Fields) -> Array:
    """Return the quadratic form of a matrix with each of the fields (k,)."""
    found = np.zeros(fields[0].shape[-1])
    for term in terms:
        found += np.einsum("abcr,abcr->r", fields[term.row], term.times(fields))
    return found


def terms_of(
    plan: Plan, height: Height, parts: Sequence[Part], strains: tuple[Strain, Strain], factor: float = 1.0
) -> list[Term]:
    """Return the integral of a law's parts times two strains."""
    found = []
    for part in parts:
        if not np.any(part.planar):
            continue
        for row, left, upper in strains[0]:
            for column, right, lower in strains[1]:
                weight = factor * height.pitch * part.level[:, None]
                across = height.take(row, upper).T @ (weight * height.take(column, lower))
                planar = plan.form(part.planar, left, right)
                found.append(Term(row=row, column=column, planar=planar, across=across))
    return found


def contact_terms(
    plan: Plan, height: Height, shear: tuple[Sequence[Part], Sequence[Part]], normal: Sequence[Part]
) -> list[Term]:
    """Return the terms of slip and opening with moduli, or with viscosities."""
    found = terms_of(plan, height, normal, (OPENING, OPENING))
    for slip, parts in zip(SLIP, shear, strict=True):
        found += terms_of(plan, height, parts, (slip, slip))
    return found


def steel_terms(plan: Plan, height: Height, bench: Bench, laws: Laws) -> list[Term]:
    """Return the terms of sheets in plane stress, which bend one by one: as thin as a sheet, not as a layer."""
    ratio, poisson = laws.young_ratio, bench.poisson
    along = bench.young / (1.0 - ratio * poisson**2)
    stretch = np.array([[1.0, ratio * poisson], [ratio * poisson, ratio]]) * along
    shear = bench.young / (2.0 * (1.0 + poisson))
    thin = (bench.height / bench.n_lamina) ** 2 / 12.0
    found = terms_of(plan, height, laws.steel, (DISTORTION, DISTORTION), shear)
    found += terms_of(plan, height, laws.steel, (TWIST, TWIST), 4.0 * thin * shear)
    for i in range(2):
        for j in range(2):
            found += terms_of(plan, height, laws.steel, (STRETCH[i], STRETCH[j]), stretch[i, j])
            found += terms_of(plan, height, laws.steel, (CURVATURE[i], CURVATURE[j]), thin * stretch[i, j])
    return found


def mass_terms(plan: Plan, height: Height, density: float) -> list[Term]:
    """Return the terms of the layers' mass."""
    planar = plan.form(density * height.pitch, (0, 0), (0, 0))
    even = [basis.T @ basis for basis in height.basis]
    return [Term(row=i, column=i, planar=planar, across=even[i]) for i in range(3)]


class Order(Protocol):
    """An order of the freedoms."""

    def pack(self, fields: Fields) -> Array:
        """Return fields as vectors (n, k)."""
        ...

    def unpack(self, vector: Array) -> list[Array]:
        """Return vectors as fields."""
        ...

    def factor(self, terms: Sequence[Term]) -> Factor:
        """Return the Cholesky factor of a sum of terms."""
        ...


@dataclass(frozen=True, kw_only=True)
class ByLength:
    """Freedoms from one end of the stack to the other: for few functions of the height that all meet.

    Attributes
    ----------
    plan : (int, int)
        Splines along x and y.
    across : (int, int, int)
        Functions of the height of each displacement.
    """

    plan: tuple[int, int]
    across: tuple[int, int, int]

    def pack(self, fields: Fields) -> Array:
        """Return fields as vectors (n, k)."""
        n_x, n = self.plan[0], fields[0].shape[-1]
        parts = [field.transpose(0, 2, 1, 3).reshape(n_x, -1, n) for field in fields]
        return np.concatenate(parts, axis=1).reshape(-1, n)

    def unpack(self, vector: Array) -> list[Array]:
        """Return vectors as fields."""
        n_x, n_y = self.plan
        parts = np.split(vector.reshape(n_x, -1, vector.shape[1]), n_y * np.cumsum(self.across)[:2], axis=1)
        shape = (n_x, -1, n_y, vector.shape[1])
        return [part.reshape(shape).transpose(0, 2, 1, 3) for part in parts]

    def factor(self, terms: Sequence[Term]) -> Factor:
        """Return the Cholesky factor of a sum of terms."""
        n_x, size = self.plan[0], self.plan[1] * sum(self.across)
        band = [self._offset(terms, d) for d in range(DEGREE + 1)]
        groups = [range(i, min(i + DEGREE, n_x)) for i in range(0, n_x, DEGREE)]

        def block(rows: range, columns: range) -> Array:
            found = np.zeros((len(rows), size, len(columns), size))
            for a, i in enumerate(rows):
                for b, j in enumerate(columns):
                    if abs(i - j) <= DEGREE:
                        found[a, :, b] = band[j - i][i] if j >= i else band[i - j][j].T
            return found.reshape(len(rows) * size, -1)

        pairs = zip(groups[1:], groups[:-1], strict=True)
        return Factor([block(one, one) for one in groups], [block(after, before) for after, before in pairs])

    def _offset(self, terms: Sequence[Term], offset: int) -> Array:
        """Return the blocks (n_x - offset, n, n) between splines along x that are so far apart."""
        n_x, n_y = self.plan
        ends = np.cumsum([0, *self.across]) * n_y
        found = np.zeros((n_x - offset, ends[-1], ends[-1]))
        near = np.arange(n_x - offset)
        for row in range(3):
            for column in range(3):
                here = [term for term in terms if (term.row, term.column) == (row, column)]
                if not here:
                    continue
                planar = np.stack([term.planar[near, near + offset].ravel() for term in here], axis=1)
                across = np.stack([term.across.ravel() for term in here])
                both = (planar @ across).reshape(-1, n_y, n_y, self.across[row], self.across[column])
                both = both.transpose(0, 3, 1, 4, 2).reshape(len(near), ends[row + 1] - ends[row], -1)
                found[:, ends[row] : ends[row + 1], ends[column] : ends[column + 1]] = both
        return found


@dataclass(frozen=True, kw_only=True)
class ByHeight:
    """Freedoms layer by layer, as each layer meets its neighbours alone.

    Attributes
    ----------
    plan : (int, int)
        Splines along x and y.
    n_layer : int
        Layers, each with freedoms of its own.
    """

    plan: tuple[int, int]
    n_layer: int

    def pack(self, fields: Fields) -> Array:
        """Return fields as vectors (n, k)."""
        return np.stack(fields).transpose(3, 0, 1, 2, 4).reshape(-1, fields[0].shape[-1])

    def unpack(self, vector: Array) -> list[Array]:
        """Return vectors as fields."""
        shape = (self.n_layer, 3, *self.plan, vector.shape[1])
        return list(vector.reshape(shape).transpose(1, 2, 3, 0, 4))

    def factor(self, terms: Sequence[Term]) -> Factor:
        """Return the Cholesky factor of a sum of terms."""
        return Factor(list(self._offset(terms, 0)), list(self._offset(terms, 1).transpose(0, 2, 1)))

    def _offset(self, terms: Sequence[Term], offset: int) -> Array:
        """Return the blocks (n_layer - offset, n, n) of layers that are so far apart."""
        n_plan = self.plan[0] * self.plan[1]
        found = np.zeros((self.n_layer - offset, 3, n_plan, 3, n_plan))
        for term in terms:
            planar = term.planar.transpose(0, 2, 1, 3).reshape(n_plan, n_plan)
            found[:, term.row, :, term.column] += np.multiply.outer(np.diag(term.across, offset), planar)
        return found.reshape(self.n_layer - offset, 3 * n_plan, -1)
