"""Measured points on a structure of matrices: the nodes about each, and what of their motion is its own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from model.matrices.labelled import Index
from model.matrices.reduced import ReducedMatrices
from model.matrices.structure import MatrixStructure
from model.stack.errors import MatricesError

Vectors = NDArray[np.float64]

_ABOUT = 27  # nodes about a point: the neighbours of one in a mesh of bricks
_LOOKED = 1e-3  # share of a direction along an axis that counts
_SAME = 1e-6  # of the structure's size: a point is on a node
_SINGULAR = 1e-4  # of the polynomial: directions in which nodes do not spread


@dataclass(frozen=True, eq=False, kw_only=True)
class Places:
    """Where displacements are looked at.

    Attributes
    ----------
    node : (n, k) int
        Nodes about each place.
    weight, slope : (n, k) float
        What of their motion is that of the place, and its derivative along x, 1/m.
    distance : (n,) float
        From the place to the nearest node, m.
    direction : (n, 3) float
        Direction that is looked at, of unit length.
    """

    node: Index
    weight: Vectors
    slope: Vectors
    distance: Vectors
    direction: Vectors

    def rows(self, reduced: ReducedMatrices) -> tuple[Vectors, Vectors]:
        """Return the rows from coordinates to displacements, (n, size), and their derivatives along x."""
        every, at = np.unique(self.node, return_inverse=True)
        moves = reduced.moves(every)[at.reshape(self.node.shape)]
        along = np.einsum("nkij,ni->nkj", moves, self.direction)
        return np.einsum("nkj,nk->nj", along, self.weight), np.einsum("nkj,nk->nj", along, self.slope)


def places_on(
    structure: MatrixStructure,
    number: Index,
    location: Vectors,
    direction: Vectors,
    *,
    tolerance: float = 0.01,
) -> Places:
    """Place measured components on a structure.

    A point on a node moves as that; any other as the polynomial of second order that fits the nodes about it best, the
    nearer the better (moving least squares: Lancaster and Salkauskas 1981). Where no file says where nodes are, points
    are the nodes of their numbers.

    Parameters
    ----------
    structure : MatrixStructure
        The structure.
    number, location, direction : (n,), (n, 3), (n, 3)
        Number, place in the structure's coordinates, m, and direction of each component.
    tolerance : float
        How far a point may be from the nearest node, m, where the mesh is finer than that.

    Raises
    ------
    MatricesError
        A point is far from every node, or there is no node of its number.
    """
    n, number = len(direction), np.asarray(number, dtype=np.int64)
    if not structure.placed:
        missing = number[~np.isin(number, structure.node)]
        if missing.size:
            message = (
                f"{structure.name}: point {missing[0]} has no node of its number, by which points are placed where no "
                "file says where nodes are; name one by matrices.nodes, or number the points as the nodes"
            )
            raise MatricesError(message)
        one, none = np.ones((n, 1)), np.zeros((n, 1))
        return Places(node=number[:, None], weight=one, slope=none, distance=none[:, 0], direction=direction)
    k = min(_ABOUT, np.unique(structure.node).size)
    node, distance = np.zeros((n, k), dtype=np.int64), np.zeros(n)
    weight, slope = np.zeros((n, k)), np.zeros((n, k))
    looked = np.abs(direction) > _LOOKED
    for axes in np.unique(looked, axis=0):
        rows = np.flatnonzero(np.all(looked == axes, axis=1))
        moving = _moving(structure, axes)
        node[rows] = structure.node[0]
        if not moving.size:  # nothing moves along these axes
            continue
        found = _near(structure, moving, location[rows], tolerance)
        m = found[0].shape[1]
        node[rows, :m], weight[rows, :m], slope[rows, :m], distance[rows] = found[:4]
        if (found[4] > 0.0).any():
            i = int(np.argmax(found[4]))
            low, high = 1e3 * structure.location.min(axis=0), 1e3 * structure.location.max(axis=0)
            span = ", ".join(f"{a:.4g} to {b:.4g}" for a, b in zip(low, high, strict=True))
            message = (
                f"{structure.name}: point {number[rows[i]]} is {1e3 * found[3][i]:.4g} mm from the nearest node; "
                f"nodes span {span} mm. Points must have the coordinates of the model: check their unit and origin"
            )
            raise MatricesError(message)
    return Places(node=node, weight=weight, slope=slope, distance=distance, direction=direction)


def _moving(structure: MatrixStructure, axes: NDArray[np.bool_]) -> Index:
    """Return the nodes that have a row for each of some axes."""
    nodes = [structure.node[structure.dof == i + 1] for i in np.flatnonzero(axes)]
    found = nodes[0]
    for other in nodes[1:]:
        found = np.intersect1d(found, other)
    return np.unique(found)


def _near(
    structure: MatrixStructure, node: Index, location: Vectors, tolerance: float
) -> tuple[Index, Vectors, Vectors, Vectors, Vectors]:
    """Return nodes about places, (n, k), their weights and slopes, and how far the nearest is, (n,), and is too far."""
    first = np.unique(structure.node, return_index=True)
    place = structure.location[first[1][np.searchsorted(first[0], node)]]
    n, k = len(location), min(_ABOUT, node.size)
    spacing = _spacing(place)
    near = scipy.spatial.KDTree(place / spacing).query(location / spacing, k)[1].reshape(n, k)
    offset = place[near] - location[:, None]
    distance = np.linalg.norm(offset, axis=2)
    mesh = np.sort(np.linalg.norm(place[near] - place[near[:, :1]], axis=2), axis=1)[:, min(3, k - 1)]
    within = np.clip(location, place.min(axis=0), place.max(axis=0))
    beyond = np.linalg.norm(location - within, axis=1)
    cells = np.linalg.norm((place[near] - within[:, None]) / spacing, axis=2).min(
        axis=1
    )  # of a mesh of planes
    allowed = np.where(cells > 1.0, np.maximum(tolerance, mesh), np.inf)
    far = np.maximum(distance.min(axis=1) - allowed, beyond - np.maximum(tolerance, mesh))
    weight, slope = np.zeros((n, k)), np.zeros((n, k))
    size = float(np.linalg.norm(np.ptp(place, axis=0)))
    for i in range(n):
        away = offset[i] / spacing
        reach = max(float(np.linalg.norm(away, axis=1).max()), 1e-12)
        x, y, z = (away / reach).T
        powers = np.column_stack([np.ones(k), x, y, z, x * x, y * y, z * z, x * y, y * z, z * x])
        near_more = np.exp(-2.0 * (x * x + y * y + z * z))
        found = np.linalg.pinv(near_more[:, None] * powers, rcond=_SINGULAR) * near_more
        weight[i], slope[i] = found[0], found[1] / (reach * spacing[0])
        if distance[i].min() < _SAME * size:
            weight[i] = np.arange(k) == int(distance[i].argmin())
    return node[near], weight, slope, distance.min(axis=1), far


def _spacing(place: Vectors) -> Vectors:
    """Return the distance between planes of nodes along x, y and z, (3,), by which neighbours are told."""
    extent = np.ptp(place, axis=0)
    largest = float(extent.max()) or 1.0
    planes = [np.unique(np.round(along / (_SAME * largest))).size for along in place.T]
    return np.where(extent > _SAME * largest, extent / np.maximum(np.array(planes) - 1, 1), largest)
