"""Galerkin projection of Kronecker products on dense bases.

Effects bring many terms, and most of them differ little: some act at a few places of the plan alone, some hold the same
products. Both are used here, for at this size the projection costs as much as the modes.
"""

from __future__ import annotations

import hashlib
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from model.mesh import FIELDS, Field
from model.system import Assembly, Kron

Vector = NDArray[np.float64]

_DENSE = 0.02  # share of entries above which a planar matrix is multiplied faster as a dense one


class Projection:
    """The products left' A right of matrices A that are sums of Kronecker products.

    Parameters
    ----------
    assembly : Assembly
        Equations of motion that the products belong to.
    left, right : (assembly.size, n) and (assembly.size, m)
        The bases.
    """

    def __init__(self, assembly: Assembly, left: Vector, right: Vector) -> None:
        self._right = _by_field(assembly, right)
        self._left = self._right if left is right else _by_field(assembly, left)
        self._shape = (left.shape[1], right.shape[1])
        self._known: dict[bytes, Vector] = {}

    def __call__(self, krons: tuple[Kron, ...]) -> Vector:
        """Return left' A right, (n, m), of the sum A of some products."""
        total = np.zeros(self._shape)
        for kron in krons:
            key = _key(kron)
            if key not in self._known:
                self._known[key] = self._projected(kron)
            total += self._known[key]
        return total

    def _projected(self, kron: Kron) -> Vector:
        z = kron.z.toarray() if sp.issparse(kron.z) else kron.z
        found = self._one(kron.row, kron.column, z, kron.planar)
        if kron.row == kron.column:
            return found
        if self._left is self._right:
            return found + found.T
        return found + self._one(kron.column, kron.row, z.T, kron.planar.T)

    def _one(self, row: Field, column: Field, z: Vector, planar: sp.csr_matrix) -> Vector:
        coo = planar.tocoo()
        rows, columns = np.unique(coo.row), np.unique(coo.col)
        part = planar.tocsr()[rows][:, columns]
        right, left = self._right[column], self._left[row]
        if columns.size < right.shape[1]:
            right = right[:, columns]
        if rows.size < left.shape[1]:
            left = left[:, rows]
        image = (z @ right.reshape(right.shape[0], -1)).reshape(-1, *right.shape[1:])
        if part.nnz > _DENSE * rows.size * columns.size:
            image = part.toarray() @ image
        else:
            image = np.stack([part @ slice_ for slice_ in image])
        return np.asarray(left.reshape(-1, left.shape[2]).T @ image.reshape(-1, image.shape[2]))


def _by_field(assembly: Assembly, basis: Vector) -> dict[Field, Vector]:
    where = assembly.slices()
    return {f: basis[where[f]].reshape(assembly.n_z[f], -1, basis.shape[1]) for f in FIELDS}


def _key(kron: Kron) -> bytes:
    """Return what only products that are the same share."""
    digest = hashlib.blake2b(f"{kron.row}{kron.column}".encode())
    parts: list[Any] = [kron.planar.indptr, kron.planar.indices, kron.planar.data]
    parts += [kron.z.indptr, kron.z.indices, kron.z.data] if sp.issparse(kron.z) else [kron.z]
    for part in parts:
        digest.update(part.tobytes())
    return digest.digest()
