"""Galerkin projection of the terms of the equations of motion on dense bases.

Effects bring many terms, and most of them differ little: some act at a few places of the plan alone, some hold the same
products. Both are used here, and that places far apart are not coupled, for at this size the projection costs as
much as the modes.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from model.mesh import FIELDS, Field
from model.system import Assembly, Kron, collected
from model.threads import threaded

Vector = NDArray[np.float64]

_DENSE = 0.02  # share of entries above which a planar matrix is multiplied faster as a dense one
_STRIPS = 8  # across the plan, of such a one: those that are not neighbours have nothing in common


def projected_terms(assembly: Assembly, left: Vector, right: Vector) -> dict[int, Vector]:
    """Return left' A right, (n, m), of every term's matrix A, by the identity of its Kronecker products.

    Parameters
    ----------
    assembly : Assembly
        Equations of motion.
    left, right : (assembly.size, n) and (assembly.size, m)
        The bases; where they are one object, its symmetry is used.
    """
    order = {f: np.argsort(assembly.plan.abscissa(f), kind="stable") for f in FIELDS}
    right_parts = _by_field(assembly, right, order)
    left_parts = right_parts if left is right else _by_field(assembly, left, order)
    terms = {id(term.krons): {_key(kron): kron for kron in collected(term.krons)} for term in assembly.terms}
    distinct = {key: kron for krons in terms.values() for key, kron in krons.items()}

    def one(row: Field, column: Field, z: Vector, planar: sp.csr_matrix) -> Vector:
        here = planar[order[row]][:, order[column]]
        return _product(left_parts[row], z, here, right_parts[column])

    def projected(kron: Kron) -> Vector:
        z = kron.z.toarray() if sp.issparse(kron.z) else kron.z
        found = one(kron.row, kron.column, z, kron.planar)
        if kron.row == kron.column:
            return found
        return found + (found.T if left is right else one(kron.column, kron.row, z.T, kron.planar.T.tocsr()))

    found = dict(zip(distinct, threaded(projected, distinct.values()), strict=True))
    return {
        which: sum((found[key] for key in krons), start=np.zeros((left.shape[1], right.shape[1])))
        for which, krons in terms.items()
    }


def _product(left: Vector, z: Vector, planar: sp.csr_matrix, right: Vector) -> Vector:
    """Return the sum over all i and j of z[i, j] left[i]' planar right[j]."""
    coo = planar.tocoo()
    rows, columns = np.unique(coo.row), np.unique(coo.col)
    part = planar[rows][:, columns]
    if columns.size < right.shape[1]:
        right = right[:, columns]
    if rows.size < left.shape[1]:
        left = left[:, rows]
    moved = (z @ right.reshape(right.shape[0], -1)).reshape(-1, *right.shape[1:])
    if part.nnz > _DENSE * rows.size * columns.size:
        image = np.empty((moved.shape[0], rows.size, moved.shape[2]))
        for strip in np.array_split(np.arange(rows.size), min(_STRIPS, rows.size)):
            own = part[strip[0] : strip[-1] + 1]
            first, last = own.indices.min(), own.indices.max() + 1
            np.matmul(
                own[:, first:last].toarray(), moved[:, first:last], out=image[:, strip[0] : strip[-1] + 1]
            )
    else:
        image = np.stack([part @ slice_ for slice_ in moved])
    return np.asarray(left.reshape(-1, left.shape[2]).T @ image.reshape(-1, image.shape[2]))


def _by_field(
    assembly: Assembly, basis: Vector, order: Mapping[Field, NDArray[np.intp]]
) -> dict[Field, Vector]:
    """Return a basis as (n_z, n_planar, k) arrays, the planar degrees of freedom in an order of their own."""
    where = assembly.slices()
    return {f: basis[where[f]].reshape(assembly.n_z[f], -1, basis.shape[1])[:, order[f]] for f in FIELDS}


def _key(kron: Kron) -> bytes:
    """Return what only products that are the same share."""
    digest = hashlib.blake2b(f"{kron.row}{kron.column}".encode())
    parts: list[Any] = [kron.planar.indptr, kron.planar.indices, kron.planar.data]
    parts += [kron.z.indptr, kron.z.indices, kron.z.data] if sp.issparse(kron.z) else [kron.z]
    for part in parts:
        digest.update(part.tobytes())
    return digest.digest()
