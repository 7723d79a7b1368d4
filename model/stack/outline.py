"""Outlines of laminas other than the rectangle, and their triangulation.

No mesher that installs from a wheel alone, needs no system library and is free to ship was found, so the little that is
needed is here: even points inside, Delaunay's triangulation of them and the boundary, smoothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy

from lamella_shared import Booleans, Integers, Reals, readonly
from model.stack.errors import StackError

_PICKLES = (".pkl", ".pickle")

_SEGMENTS = 16  # fewest sides of a circle
_LARGEST = 1000.0  # m; what is larger is a slip


@dataclass(frozen=True, eq=False, kw_only=True)
class Triangulation:
    """A lamina cut into triangles.

    Attributes
    ----------
    point : (n_point, 2) float
        Corners, m.
    triangle : (n_triangle, 3) int
        Corners of each triangle.

    Raises
    ------
    StackError
        A triangle is degenerate, or a corner belongs to none.
    """

    point: Reals
    triangle: Integers

    def __post_init__(self) -> None:
        least_angle = 5.0  # degrees
        object.__setattr__(self, "point", readonly("Triangulation", "point", self.point, (None, 2)))
        corners = readonly("Triangulation", "triangle", self.triangle, (None, 3), int)
        object.__setattr__(self, "triangle", corners)
        if corners.size == 0 or np.unique(corners).size != len(self.point):
            raise StackError("mesh: it has no triangles, or points that belong to none")
        angle = smallest_angle(self.point, corners)
        worst = int(np.argmin(angle))
        if angle[worst] < least_angle:
            x, y = self.point[corners[worst]].mean(axis=0)
            raise StackError(
                f"mesh: the triangle at ({x:g}, {y:g}) m has an angle of {angle[worst]:.2g} degrees; at least "
                f"{least_angle:g} are needed. Refine the mesh there (more elements, or drop tiny details)."
            )

    @property
    def area(self) -> float:
        """Area, m2."""
        return float(_areas(self.point, self.triangle).sum())

    @property
    def bounds(self) -> Reals:
        """Lowest and highest x, lowest and highest y, (2, 2) m."""
        return np.column_stack([self.point.min(axis=0), self.point.max(axis=0)])

    def triangulated(self, size: float) -> Triangulation:  # noqa: ARG002  # a given mesh keeps its own fineness
        """Return the mesh as it is."""
        return self


@dataclass(frozen=True, eq=False, kw_only=True)
class Outline:
    """A polygon with holes.

    Attributes
    ----------
    boundary : (n, 2) float
        Corners of the outer polygon in order, m.
    holes : tuple of (m, 2) float
        Corners of each hole in order, m.
    """

    boundary: Reals
    holes: tuple[Reals, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "boundary", readonly("Outline", "boundary", self.boundary, (None, 2)))
        holes = tuple(readonly("Outline", "holes", hole, (None, 2)) for hole in self.holes)
        object.__setattr__(self, "holes", holes)
        for name, polygon in (("boundary", self.boundary), *((f"holes[{i}]", h) for i, h in enumerate(holes))):
            if len(polygon) < 3:
                raise StackError(f"outline: {name} has {len(polygon)} corners; a polygon needs at least 3")
            if not np.all(np.abs(polygon) < _LARGEST):
                raise StackError(f"outline: {name} has corners that are not within {_LARGEST:g} m")
        for i, hole in enumerate(holes):
            if not inside(hole, (self.boundary,)).all():
                raise StackError(f"outline: holes[{i}] reaches outside the boundary")

    @property
    def area(self) -> float:
        """Area, m2."""
        return _polygon_area(self.boundary) - sum(_polygon_area(hole) for hole in self.holes)

    @property
    def bounds(self) -> Reals:
        """Lowest and highest x, lowest and highest y, (2, 2) m."""
        return np.column_stack([self.boundary.min(axis=0), self.boundary.max(axis=0)])

    def triangulated(self, size: float) -> Triangulation:
        """Return a mesh of triangles with sides of about `size`, m.

        Raises
        ------
        StackError
            No sound mesh of that size was found; the message says where it fails.
        """
        attempts = 6
        polygons = (self.boundary, *self.holes)
        rims = [_divided(polygon, size) for polygon in polygons]
        for _ in range(attempts):
            point, triangle, rims, complete = _delaunay(polygons, rims, size)
            if complete:
                used, index = np.unique(triangle, return_inverse=True)
                return Triangulation(point=point[used], triangle=index.reshape(-1, 3))
        raise StackError(f"outline: no mesh of triangles of {size:g} m follows its boundary; take more elements")


def centred(shape: Outline | Triangulation) -> Outline | Triangulation:
    """Return a shape moved so that its bounding box lies around the origin."""
    middle = shape.bounds.mean(axis=1)
    if isinstance(shape, Triangulation):
        return Triangulation(point=shape.point - middle, triangle=shape.triangle)
    return Outline(boundary=shape.boundary - middle, holes=tuple(hole - middle for hole in shape.holes))


def ring(outer: float, inner: float, n_side: int) -> Outline:
    """Return a ring by its outer and inner diameter, m, each circle a polygon of `n_side` sides."""
    if not 0.0 < inner < outer < _LARGEST:
        raise StackError(
            f"ring: the inner diameter {inner:g} m must lie between 0 and the outer one, {outer:g} m, and that below "
            f"{_LARGEST:g} m"
        )
    return Outline(boundary=circle(outer, n_side), holes=(circle(inner, n_side),))


@dataclass(frozen=True, kw_only=True)
class BoltHoles:
    """Round holes on a circle around the centre.

    Attributes
    ----------
    number : int
        Number of holes, the first one at angle 0.
    diameter, circle : float
        Diameter of the holes and of the circle on which they lie, m.
    """

    number: int
    diameter: float
    circle: float


def stator(
    *,
    outer: float,
    inner: float,
    slot: float,
    n_tooth: int,
    tooth_width: float,
    holes: BoltHoles | None = None,
    n_side: int = 96,
) -> Outline:
    """Return a stator sheet: a yoke with parallel-sided teeth inwards and bolt holes in the yoke.

    Parameters
    ----------
    outer, inner : float
        Diameters of the outside and of the bore at the teeth's tips, m.
    slot : float
        Diameter of the slots' bottoms, where the yoke begins, m.
    n_tooth : int
        Number of teeth; the first one stands at angle 0.
    tooth_width : float
        Width of a tooth, m.
    holes : BoltHoles, optional
        Holes in the yoke, the first one behind the first tooth.
    n_side : int
        Sides of the outer circle; other circles in proportion.

    Raises
    ------
    StackError
        The sizes do not fit into one another.
    """
    sound = 0.0 < inner < slot < outer < _LARGEST and n_tooth > 0 and tooth_width > 0.0
    if not (sound and tooth_width < inner * np.sin(min(np.pi / n_tooth, np.pi / 2.0))):
        raise StackError(
            f"stator: 0 < inner ({inner:g}) < slot ({slot:g}) < outer ({outer:g}) < {_LARGEST:g} m must hold, and "
            f"{n_tooth} teeth of {tooth_width:g} m must fit side by side into the bore"
        )
    bolts = () if holes is None else _bolt_holes(holes, slot, outer, n_side)
    half = tooth_width / 2.0
    at_tip, at_slot = (float(np.arcsin(half / (d / 2.0))) for d in (inner, slot))
    pitch = 2.0 * np.pi / n_tooth
    bore = []
    for k in range(n_tooth):
        middle = k * pitch
        n_tip = max(int(np.ceil(2.0 * at_tip / (2.0 * np.pi / n_side))), 1)
        n_slot = max(int(np.ceil((pitch - 2.0 * at_slot) / (2.0 * np.pi / n_side))), 1)
        for angle in middle + np.linspace(-at_tip, at_tip, n_tip + 1):
            bore.append((inner / 2.0, angle))
        for angle in middle + at_slot + np.linspace(0.0, pitch - 2.0 * at_slot, n_slot + 1):
            bore.append((slot / 2.0, angle))
    radius, angle = np.array(bore).T
    bore_polygon = np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])
    return Outline(boundary=circle(outer, n_side), holes=(bore_polygon, *bolts))


def _bolt_holes(holes: BoltHoles, slot: float, outer: float, n_side: int) -> tuple[Reals, ...]:
    """Return the polygons of holes in the yoke, which lies between two diameters."""
    beside = holes.circle * np.sin(min(np.pi / max(holes.number, 1), np.pi / 2.0))
    hole = holes.diameter
    if not (holes.number > 0 and slot + hole < holes.circle < outer - hole and 0.0 < hole < beside):
        raise StackError(f"stator: holes of {hole:g} m on a circle of {holes.circle:g} m do not fit into the yoke")
    found = []
    for k in range(holes.number):
        turn = 2.0 * np.pi * k / holes.number
        middle = holes.circle / 2.0 * np.array([np.cos(turn), np.sin(turn)])
        found.append(middle + circle(hole, max(_SEGMENTS // 2, round(n_side * hole / outer))))
    return tuple(found)


def circle(diameter: float, n_side: int) -> Reals:
    """Return the corners, (n_side, 2), of a regular polygon with the area of the circle."""
    n_side = max(n_side, _SEGMENTS // 2)
    angle = 2.0 * np.pi * np.arange(n_side) / n_side
    radius = diameter / 2.0 * np.sqrt(2.0 * np.pi / n_side / np.sin(2.0 * np.pi / n_side))
    return radius * np.column_stack([np.cos(angle), np.sin(angle)])


def read_mesh(path: str | Path) -> Triangulation:
    """Read triangles from a mesh file in millimetres, of any format that pyvista reads; z is ignored.

    Raises
    ------
    StackError
        The file cannot be read, holds other cells than triangles, or is a pickle, whose reading would run code.
    """
    import pyvista as pv

    path = Path(path)
    if path.suffix.lower() in _PICKLES:  # which older versions of pyvista read
        raise StackError(f"{path}: a pickle runs code when it is read; give a mesh file, such as .vtk, .stl or .msh")
    try:
        there = path.exists()
    except OSError as error:  # such as a name that is too long
        raise StackError(f"{str(path)[:120]}: {error.strerror}") from error
    if not there:
        raise StackError(f"{path}: there is no such mesh file")
    try:
        mesh = pv.read(path)
    except Exception as error:  # the readers raise what they like
        raise StackError(f"{path}: cannot be read as a mesh: {error}") from error
    surface = mesh.extract_surface(algorithm="geometry") if not isinstance(mesh, pv.PolyData) else mesh
    if surface.n_cells == 0 or not surface.is_all_triangles:
        raise StackError(
            f"{path}: holds {surface.n_cells} surface cells, not all of them triangles; use triangles alone"
        )
    corners = np.asarray(surface.regular_faces, dtype=np.int64)
    used, index = np.unique(corners, return_inverse=True)
    point = np.asarray(surface.points, dtype=float)[used, :2] * 1e-3
    try:
        return Triangulation(point=point, triangle=index.reshape(-1, 3))
    except StackError as error:
        raise StackError(f"{path}: {error}") from error


def inside(points: Reals, polygons: tuple[Reals, ...]) -> Booleans:
    """Return whether points (n, 2) lie inside an odd number of polygons (ray crossing)."""
    within = np.zeros(len(points), dtype=bool)
    x, y = points.T
    for polygon in polygons:
        for (x0, y0), (x1, y1) in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
            if y0 != y1:
                crossing = ((y0 > y) != (y1 > y)) & (x < x0 + (y - y0) / (y1 - y0) * (x1 - x0))
                within ^= crossing
    return within


def smallest_angle(point: Reals, triangle: Integers) -> Reals:
    """Return the smallest angle of each triangle, degrees."""
    corner = point[triangle]
    side = np.linalg.norm(corner - np.roll(corner, -1, axis=1), axis=2)
    a, b, c = np.sort(side, axis=1).T
    cosine = np.clip((b**2 + c**2 - a**2) / (2.0 * b * c), -1.0, 1.0)
    return np.degrees(np.arccos(cosine))


def _areas(point: Reals, triangle: Integers) -> Reals:
    a, b, c = (point[triangle[:, i]] for i in range(3))
    return 0.5 * np.abs((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])


def _polygon_area(polygon: Reals) -> float:
    x, y = polygon.T
    return float(0.5 * abs(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))))


def _divided(polygon: Reals, size: float) -> Reals:
    """Return a polygon with points added so that no side is longer than 1.2 sizes."""
    parts = []
    for start, stop in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        n = max(int(np.ceil(np.linalg.norm(stop - start) / (1.2 * size))), 1)
        parts.append(start + np.linspace(0.0, 1.0, n, endpoint=False)[:, None] * (stop - start))
    return np.vstack(parts)


def _delaunay(polygons: tuple[Reals, ...], rims: list[Reals], size: float) -> tuple[Reals, Integers, list[Reals], bool]:
    """Return points, triangles, rims with sides split where no triangle lies on them, and whether all were there."""
    smoothing = 12
    clearance = 0.55  # of the element size, between the boundary and the points inside
    rim = np.vstack(rims)
    low, high = rim.min(axis=0), rim.max(axis=0)
    x, y = np.meshgrid(np.arange(low[0], high[0] + size, size), np.arange(low[1], high[1] + size, size * np.sqrt(0.75)))
    x[1::2] += size / 2.0
    grid = np.column_stack([x.ravel(), y.ravel()])
    grid = grid[inside(grid, polygons)]
    dense = np.vstack([_divided(r, size / 4.0) for r in rims])
    distance = scipy.spatial.cKDTree(dense).query(grid)[0]
    free = grid[distance > clearance * size]
    point = np.vstack([rim, free])
    for step in range(smoothing + 1):
        triangle = np.asarray(scipy.spatial.Delaunay(point).simplices, dtype=np.int64)
        centre = point[triangle].mean(axis=1)
        flat = _areas(point, triangle) < 1e-6 * size**2
        triangle = triangle[inside(centre, polygons) & ~flat]
        if step < smoothing:
            point = _smoothed(point, triangle, len(rim))
    sides = np.sort(triangle[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    present = {(int(a), int(b)) for a, b in sides}
    first, complete, split = 0, True, []
    for r in rims:
        n, parts = len(r), []
        for i in range(n):
            a, b = first + i, first + (i + 1) % n
            parts.append(r[i])
            if (min(a, b), max(a, b)) not in present:
                parts.append((r[i] + r[(i + 1) % n]) / 2.0)
                complete = False
        split.append(np.array(parts))
        first += n
    return point, triangle, split, complete


def _smoothed(point: Reals, triangle: Integers, n_fixed: int) -> Reals:
    """Move each free point to the mean of its neighbours."""
    total, count = np.zeros_like(point), np.zeros(len(point))
    for i in range(3):
        for j in range(3):
            if i != j:
                np.add.at(total, triangle[:, i], point[triangle[:, j]])
                np.add.at(count, triangle[:, i], 1.0)
    moved = point.copy()
    free = np.arange(len(point)) >= n_fixed
    free &= count > 0
    moved[free] = total[free] / count[free, None]
    return moved
