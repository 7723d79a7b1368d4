"""Galerkin projection of the terms of the equations of motion on dense bases, on all processors.

Effects bring many terms, and most of them differ little: some act at a few places of the plan alone, some are the same
but for their factor. Both are used here, and that places far apart are not coupled, for at this size the projection
costs as much as the modes. Numbers are the same whatever the number of processors.
"""

from __future__ import annotations

import hashlib
import threading
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray

from model.elements.equations import Assembly, Kron, collected
from model.elements.mesh import FIELDS, Field
from model.reduction.threads import threaded

Vector = NDArray[np.float64]


def projected_terms(assembly: Assembly, basis: Vector) -> tuple[list[int], Iterator[Vector]]:
    """Return basis' A basis, (n, n), of all matrices A that differ, one by one, and which of them each term has.

    Parameters
    ----------
    assembly : Assembly
        Equations of motion.
    basis : (assembly.size, n)
        The basis.
    """
    order = {f: np.argsort(assembly.plan.abscissa(f), kind="stable") for f in FIELDS}
    parts = _by_field(assembly, basis, order)
    memory = _Memory()
    distinct: dict[bytes, tuple[Kron, ...]] = {}
    key_of: dict[int, bytes] = {}
    for term in assembly.terms:
        if id(term.krons) not in key_of:
            krons = collected(term.krons)
            key_of[id(term.krons)] = b"".join(sorted(map(_key, krons)))
            distinct.setdefault(key_of[id(term.krons)], krons)
    number = {key: i for i, key in enumerate(distinct)}

    def projected(krons: tuple[Kron, ...]) -> Vector:
        half = sum(
            (_half(parts, field, of_row, order, memory) for field, of_row in _by_row(krons).items()),
            np.zeros((basis.shape[1], basis.shape[1])),
        )
        return np.asarray(half + half.T)

    return [number[key_of[id(term.krons)]] for term in assembly.terms], threaded(projected, distinct.values())


class _Memory(threading.local):
    """Arrays that each thread uses again: new ones of this size cost the system a fifth of the projection's time."""

    def __init__(self) -> None:
        self._arrays: dict[str, Vector] = {}

    def array(self, name: str, shape: tuple[int, ...]) -> Vector:
        """Return an array of a shape; what it holds is what was left in it."""
        size = int(np.prod(shape))
        if name not in self._arrays or self._arrays[name].size < size:
            self._arrays[name] = np.empty(size)
        return self._arrays[name][:size].reshape(shape)


def _by_row(krons: Iterable[Kron]) -> dict[Field, list[Kron]]:
    """Return products by the field of their rows."""
    found: dict[Field, list[Kron]] = {}
    for kron in krons:
        found.setdefault(kron.row, []).append(kron)
    return found


def _half(
    parts: Mapping[Field, Vector],
    field: Field,
    krons: Iterable[Kron],
    order: Mapping[Field, NDArray[np.intp]],
    memory: _Memory,
) -> Vector:
    """Return a matrix that, with its transpose, is the projection of products with rows of one field, (n, n).

    Their images are summed first, for the product with the basis on the left takes longest.
    """
    left, whole = parts[field], list[tuple[Kron, Vector, sp.csr_matrix]]()
    half = np.zeros((left.shape[2], left.shape[2]))
    for kron in krons:
        planar = kron.planar[order[kron.row]][:, order[kron.column]]
        z = (kron.z.toarray() if sp.issparse(kron.z) else kron.z) * (0.5 if kron.row == kron.column else 1.0)
        few = _low_rank(planar)
        if few is None:
            whole.append((kron, z, planar))
            continue
        first, second = (
            np.einsum("pr,zpk->zrk", shapes, part[:, at], optimize=True)
            for (at, shapes), part in zip(few, (left, parts[kron.column]), strict=True)
        )
        moved = (z @ second.reshape(second.shape[0], -1)).reshape(-1, second.shape[2])
        half += first.reshape(-1, first.shape[2]).T @ moved
    rows = np.flatnonzero(sum(np.diff(planar.indptr) for *_, planar in whole))
    if rows.size:
        image = memory.array("image", (left.shape[0], rows.size, left.shape[2]))
        image[:] = 0.0
        for kron, z, planar in whole:
            _add_image(image, z, planar[rows], parts[kron.column], memory)
        left = left[:, rows] if rows.size < left.shape[1] else left
        half += left.reshape(-1, left.shape[2]).T @ image.reshape(-1, image.shape[2])
    return half


def _low_rank(planar: sp.csr_matrix) -> tuple[tuple[NDArray[np.intp], Vector], tuple[NDArray[np.intp], Vector]] | None:
    """Return a planar matrix as a sum of few products of shapes: where each side acts, and its shapes there.

    The mean displacement under a clamp is one shape of many points. None where the matrix has more than `_FEW`.
    """
    few = 8  # shapes over the plan of which a matrix may be made, to be multiplied by these
    exact = 1e-12  # of a matrix's largest entry, to which it must be the same then
    rows = np.flatnonzero(np.diff(planar.indptr))
    columns = np.unique(planar.indices)
    if planar.nnz <= 0.5 * rows.size * columns.size or min(rows.size, columns.size) <= 2 * few:
        return None
    block = planar[rows][:, columns].toarray()
    image = block @ np.random.default_rng(0).standard_normal((columns.size, few + 1))
    shapes, triangle, _ = la.qr(image, mode="economic", pivoting=True)
    size = np.abs(np.diag(triangle))
    shapes = shapes[:, size > exact * size[0]]
    other = shapes.T @ block
    if shapes.shape[1] > few or np.abs(block - shapes @ other).max() > exact * np.abs(block).max():
        return None
    return (rows, shapes), (columns, other.T)


def _add_image(image: Vector, z: Vector, planar: sp.csr_matrix, right: Vector, memory: _Memory) -> None:
    """Add the sum over j of z[i, j] planar right[j] to image[i]."""
    strips = 8  # across the plan, of such a one: those that are not neighbours have nothing in common
    dense = 0.02  # share of entries above which a planar matrix is multiplied faster as a dense one
    columns = np.unique(planar.indices)
    if columns.size < right.shape[1]:
        planar, right = planar[:, columns], right[:, columns]
    moved = memory.array("moved", (z.shape[0], *right.shape[1:]))
    np.matmul(z, right.reshape(right.shape[0], -1), out=moved.reshape(z.shape[0], -1))
    if planar.nnz <= dense * planar.shape[0] * planar.shape[1]:
        for i, slice_ in enumerate(moved):
            image[i] += planar @ slice_
        return
    for strip in np.array_split(np.arange(planar.shape[0]), min(strips, planar.shape[0])):
        rows = planar[strip[0] : strip[-1] + 1]
        if rows.nnz:
            first, last = rows.indices.min(), rows.indices.max() + 1
            image[:, strip[0] : strip[-1] + 1] += rows[:, first:last].toarray() @ moved[:, first:last]


def _by_field(assembly: Assembly, basis: Vector, order: Mapping[Field, NDArray[np.intp]]) -> dict[Field, Vector]:
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
