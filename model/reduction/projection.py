"""Galerkin projection of the terms of the equations of motion on dense bases, on all processors.

Effects bring many terms, and most of them differ little: some act at a few places of the plan alone, some hold the same
products. Both are used here, and that places far apart are not coupled, for at this size the projection costs as
much as the modes. Numbers are the same whatever the number of processors.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from model.elements.equations import Assembly, Kron, collected
from model.elements.mesh import FIELDS, Field
from model.reduction.threads import threaded

Vector = NDArray[np.float64]

_DENSE = 0.02  # share of entries above which a planar matrix is multiplied faster as a dense one

_COLUMNS = 48  # vectors that a term is applied to at once

_IMAGES = 256  # in one product with a basis

_STRIPS = 8  # across the plan, of such a one: those that are not neighbours have nothing in common


def projected_terms(assembly: Assembly, basis: Vector) -> dict[int, Vector]:
    """Return basis' A basis, (n, n), of every term's matrix A, by the identity of its Kronecker products.

    Parameters
    ----------
    assembly : Assembly
        Equations of motion.
    basis : (assembly.size, n)
        The basis.
    """
    order = {f: np.argsort(assembly.plan.abscissa(f), kind="stable") for f in FIELDS}
    parts = _by_field(assembly, basis, order)
    terms = {id(term.krons): {_key(kron): kron for kron in collected(term.krons)} for term in assembly.terms}
    distinct = {key: kron for krons in terms.values() for key, kron in krons.items()}

    def projected(kron: Kron) -> Vector:
        z = kron.z.toarray() if sp.issparse(kron.z) else kron.z
        here = kron.planar[order[kron.row]][:, order[kron.column]]
        found = _product(parts[kron.row], z, here, parts[kron.column])
        return found if kron.row == kron.column else found + found.T

    found = dict(zip(distinct, threaded(projected, distinct.values()), strict=True))
    n = basis.shape[1]
    return {
        which: sum((found[key] for key in krons), start=np.zeros((n, n))) for which, krons in terms.items()
    }


def projected_columns(assembly: Assembly, basis: Vector, fresh: Vector) -> dict[int, Vector]:
    """Return basis' A fresh, (n, m), of every term's matrix A, by the identity of its Kronecker products.

    Images of several terms stand side by side in one product with the basis: few columns alone make a slow one.

    Parameters
    ----------
    assembly : Assembly
        Equations of motion.
    basis, fresh : (assembly.size, n) and (assembly.size, m)
        The basis, and some vectors.
    """
    krons = {id(term.krons): term.krons for term in assembly.terms}
    blocks = np.array_split(fresh, -(-fresh.shape[1] // _COLUMNS), axis=1)
    n_term = max(_IMAGES // blocks[0].shape[1], 1)
    which = [list(krons)[i : i + n_term] for i in range(0, len(krons), n_term)]

    def projected(of: tuple[list[int], Vector]) -> Vector:
        group, block = of
        images = np.hstack([assembly.apply(krons[term], block) for term in group])
        return np.asarray((basis.T @ images).reshape(basis.shape[1], len(group), -1))

    found = threaded(projected, [(group, block) for group in which for block in blocks])
    rows = (found[i : i + len(blocks)] for i in range(0, len(found), len(blocks)))
    return {
        term: np.hstack([part[:, i] for part in row])
        for group, row in zip(which, rows, strict=True)
        for i, term in enumerate(group)
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
