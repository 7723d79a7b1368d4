"""Trace lines of a first campaign file: neighbours of the grid that the points form, else triangles on the faces."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ema.campaign.draft import PointsFound
from ema.campaign.named_files import format_of
from ema.io.table import read_points
from ema.io.uff import read_uff_geometry
from ema.io.units import parse_unit
from ema.types.errors import MeasurementError

_SAME = 1e-3  # of the span: points whose coordinates differ by less stand in one row of a grid
_GAP = 3.0  # of the usual distance of neighbours: what is farther apart has a hole between
_GRID = 0.9  # of all points have neighbours along two axes, or along one where they stand in a row: a grid
_PER_ROW = 6  # lines in a row of the file


def lines_text(points: PointsFound) -> list[str]:
    """Return the rows of a campaign file with the guessed trace lines; none where the points already have lines."""
    try:
        if format_of(points.file) == "uff":
            geometry, _ = read_uff_geometry(points.file)
        else:
            geometry = read_points(points.file, parse_unit("m"))
    except MeasurementError:
        return []
    if geometry.line.size:
        return []
    lines = trace_lines(geometry.node, geometry.coordinate)
    if not lines:
        return []
    rows = [", ".join(map(str, lines[k : k + _PER_ROW])) for k in range(0, len(lines), _PER_ROW)]
    return [
        "# guessed from where the points are: points that a drawing joins; change, add or take away as you like",
        "lines = [",
        *(f"    {row}," for row in rows),
        "]",
    ]


def trace_lines(node: NDArray[np.int64], coordinate: NDArray[np.float64]) -> list[list[int]]:
    """Return lines through points that are neighbours.

    Points that form a grid are joined along the axes. Others are joined as triangles (Delaunay) on each plane face of
    the structure: on the plane that all points lie in, else on those of the least and the largest x, y and z.

    Parameters
    ----------
    node : (n_node,) int
        Numbers of the points.
    coordinate : (n_node, 3) float
        Where they are, in any unit.

    Returns
    -------
    list of list of int
        Point numbers along each line, two or more.
    """
    if node.size < 2:
        return []
    span = float(np.ptp(coordinate, axis=0).max())
    cell = (
        np.round(coordinate / (_SAME * span)).astype(np.int64)
        if span > 0.0
        else np.zeros((node.size, 3), int)
    )
    rows = list(_rows(cell))
    joined = np.zeros((node.size, 3), dtype=bool)
    for axis, row in rows:
        joined[row, axis] = True
    extended = int(np.count_nonzero(np.ptp(cell, axis=0) > 0))
    if np.mean(joined.sum(axis=1) >= min(2, extended)) >= _GRID:
        return [node[row].tolist() for _, row in rows]
    edges = sorted(set(_face_edges(coordinate, _SAME * span)))
    return [[int(node[a]), int(node[b])] for a, b in edges]


def _rows(cell: NDArray[np.int64]) -> Iterator[tuple[int, NDArray[np.int64]]]:
    """Yield each row of neighbours along an axis, as axis and indices of the points, parted at holes."""
    for axis in range(3):
        others = np.delete(cell, axis, axis=1)
        rows = [
            own[np.argsort(cell[own, axis], kind="stable")]
            for own in (np.flatnonzero((others == at).all(axis=1)) for at in np.unique(others, axis=0))
            if own.size > 1
        ]
        if not rows:
            continue
        usual = float(np.median(np.concatenate([np.diff(cell[row, axis]) for row in rows])))
        for row in rows:
            holes = np.flatnonzero(np.diff(cell[row, axis]) > _GAP * usual) + 1
            yield from ((axis, part) for part in np.split(row, holes) if part.size > 1)


def _face_edges(coordinate: NDArray[np.float64], same: float) -> Iterator[tuple[int, int]]:
    """Yield the edges of the triangles on every face, as pairs of indices of points in rising order."""
    for face, plane in _faces(coordinate, same):
        for triangle in _triangles(plane):
            closed: Sequence[int] = [*face[triangle].tolist(), int(face[triangle[0]])]
            yield from ((min(pair), max(pair)) for pair in pairwise(closed))


def _faces(
    coordinate: NDArray[np.float64], same: float
) -> Iterator[tuple[NDArray[np.int64], NDArray[np.float64]]]:
    """Yield the points of each plane face, and where they are in its plane."""
    centred = coordinate - coordinate.mean(axis=0)
    _, _, direction = np.linalg.svd(centred, full_matrices=False)
    every = np.arange(len(coordinate))
    if len(direction) < 3 or np.ptp(centred @ direction[2]) <= same:
        yield every, centred @ direction[:2].T
        return
    for axis in range(3):
        for end in (coordinate[:, axis].min(), coordinate[:, axis].max()):
            face = np.flatnonzero(np.abs(coordinate[:, axis] - end) <= same)
            yield face, np.delete(coordinate[face], axis, axis=1)


def _triangles(plane: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return triangles (n, 3) of points in a plane, without those that span a hole; none where all are in a row."""
    import scipy.spatial as spatial

    if len(plane) < 3 or np.linalg.matrix_rank(plane - plane.mean(axis=0), tol=1e-9 * np.ptp(plane)) < 2:
        return np.empty((0, 3), dtype=np.int64)
    triangle = spatial.Delaunay(plane).simplices.astype(np.int64)
    corner = plane[triangle]
    longest = np.linalg.norm(corner - np.roll(corner, 1, axis=1), axis=2).max(axis=1)
    return triangle[longest <= _GAP * np.median(longest)]
