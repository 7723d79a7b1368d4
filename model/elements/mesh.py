"""Finite elements of one lamina in its plane: spaces, planar forms and point evaluation.

The in-plane displacements u and v live on quadratic elements, the deflection w on plate elements whose slopes are
continuous: Bogner-Fox-Schmit's on a rectangle, Argyris's on triangles. A deflection with kinks, or springs at nodes on
slope freedoms, let a thin lamina bend between the nodes and bypass the contact; then frequencies do not
converge.

Plate elements evaluate their powers once for all shape functions, not once for each as those of skfem do.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import scipy
import scipy.sparse as sp
import scipy.sparse.linalg as splinalg
import skfem
from numpy.typing import NDArray
from skfem.element.discrete_field import DiscreteField
from skfem.element.element_global import ElementGlobal

from lamella_shared import Integers, Reals
from model.stack.outline import Triangulation
from model.stack.stack import Stack


class PowersOnce(ElementGlobal):  # type: ignore[misc]  # skfem has no types
    """An element whose shape functions are sums of powers of places."""

    _evaluated: tuple[Any, Any, Any] | None = None  # places, cells, and the powers there

    def gbasis(self, mapping: Any, X: Any, i: int, tind: Any = None) -> tuple[Any]:
        """Return the i-th shape function with its derivatives; sums are those of `ElementGlobal`, to the last bit."""
        if self.V is None:  # what it is made of is made there
            super().gbasis(mapping, X[..., :1], i, tind)
        if self._evaluated is None or self._evaluated[0] is not X or self._evaluated[1] is not tind:
            self._evaluated = (X, tind, self._powers(mapping.F(X, tind=tind)))
        powers = self._evaluated[2]
        if i == self.V.shape[-1] - 1:  # the last one: elements are sent to other processes, places are not
            self._evaluated = None
        weight = self.V[:, :, i] if tind is None else self.V[tind][:, :, i]
        shape = next(iter(powers.values()))[0].shape
        found = [np.zeros((self.dim,) * k + shape) for k in range(self.derivatives + 1)]
        for which, values in powers.items():
            for row, value in enumerate(values):
                found[len(which)][which] += weight[:, row][:, None] * value
        return (DiscreteField(value=found[0], grad=found[1], hess=found[2]),)

    def shapes(self, mapping: Any, X: Any, tind: Any, which: tuple[int, ...]) -> Reals:
        """Return one derivative of all shape functions at places of cells, (n_shape, n_cell, n_place)."""
        if self.V is None:  # what it is made of is made there
            super().gbasis(mapping, X[..., :1], 0, tind)
        x = mapping.F(X, tind=tind)
        powers = np.array([np.broadcast_to(power(*x), x.shape[1:]) for power in self._pbasis[which]])
        return np.asarray(np.einsum("crs,rcp->scp", self.V[tind], powers, optimize=True))

    def _powers(self, x: Any) -> dict[tuple[int, ...], list[Any]]:
        """Return all powers and their derivatives at places of each cell."""
        every = (which for k in range(self.derivatives + 1) for which in itertools.product(range(self.dim), repeat=k))
        size = np.broadcast_shapes(*(part.shape for part in x))
        return {which: [np.broadcast_to(power(*x), size) for power in self._pbasis[which]] for which in every}


class ElementQuadBFS(PowersOnce, skfem.ElementQuadBFS):  # type: ignore[misc]
    """Bogner-Fox-Schmit's rectangle."""


class ElementTriArgyris(PowersOnce, skfem.ElementTriArgyris):  # type: ignore[misc]
    """Argyris's triangle."""


Field = Literal["u", "v", "w"]

FIELDS: tuple[Field, ...] = ("u", "v", "w")

Derivative = Literal["", "x", "y", "xx", "xy", "yy"]


def _derivative(field: Any, derivative: Derivative) -> Reals:
    axes = ["xy".index(letter) for letter in derivative]
    tensor = (field, field.grad, field.hess)[len(axes)]
    return np.asarray(tensor)[tuple(axes)] if axes else np.asarray(tensor)


@dataclass(frozen=True, eq=False, kw_only=True)
class Plan:
    """The plan of one lamina, meshed, with the spaces of its displacement fields.

    Attributes
    ----------
    membrane : skfem.CellBasis
        Space of u and of v.
    plate : skfem.CellBasis
        Space of w.
    """

    membrane: Any
    plate: Any

    def basis(self, field: Field) -> Any:
        """Return the space of a displacement field."""
        return self.plate if field == "w" else self.membrane

    def size(self, field: Field) -> int:
        """Return the number of planar degrees of freedom of a field."""
        return int(self.basis(field).N)

    def sampled(self, order: int) -> Plan:
        """Return the same spaces with quadrature points that are exact for polynomials of another order."""
        bases = [skfem.Basis(b.mesh, b.elem, intorder=order) for b in (self.membrane, self.plate)]
        return Plan(membrane=bases[0], plate=bases[1])

    def elements(self, field: Field) -> sp.csr_matrix:
        """Return 1 where an element holds a degree of freedom of a field, (size(field), n_element)."""
        dofs = self.basis(field).element_dofs
        columns = np.broadcast_to(np.arange(dofs.shape[1]), dofs.shape)
        return sp.coo_matrix((np.ones(dofs.size), (dofs.ravel(), columns.ravel()))).tocsr()

    def abscissa(self, field: Field) -> Reals:
        """Return x of each degree of freedom of a field, (size(field),) m."""
        return np.asarray(self.basis(field).doflocs[0])

    @property
    def quadrature_points(self) -> Reals:
        """Coordinates of the quadrature points, (2, n_element, n_point) m."""
        return np.asarray(self.membrane.global_coordinates())

    @property
    def area(self) -> float:
        """Area of the plan, m2."""
        return float(self.membrane.dx.sum())

    @property
    def bounds(self) -> Reals:
        """Lowest and highest x, lowest and highest y, ((2, 2)) m."""
        p = self.membrane.mesh.p
        return np.column_stack([p.min(axis=1), p.max(axis=1)])

    def form(
        self,
        row: Field,
        column: Field,
        derivatives: tuple[Derivative, Derivative] = ("", ""),
        weight: Reals | float = 1.0,
    ) -> sp.csr_matrix:
        """Integrate the product of two fields' shape functions, or of their derivatives, over the plan.

        Parameters
        ----------
        row, column : "u", "v" or "w"
            Fields whose shape functions give the rows and columns.
        derivatives : (str, str)
            Derivative of each, such as "x" or "xy".
        weight : float or (n_element, n_point)
            Factor under the integral, at `quadrature_points` where it varies.

        Returns
        -------
        csr_matrix, (size(row), size(column))
            Entries that cancel to zero stay stored, so the pattern depends on the mesh alone.
        """
        left, right = self.basis(row), self.basis(column)
        values_left = np.array([_derivative(f[0], derivatives[0]) for f in left.basis])
        values_right = np.array([_derivative(f[0], derivatives[1]) for f in right.basis])
        blocks = np.einsum("ieq,jeq->eij", values_left * (left.dx * weight), values_right, optimize=True)
        rows = np.broadcast_to(left.element_dofs.T[:, :, None], blocks.shape)
        columns = np.broadcast_to(right.element_dofs.T[:, None, :], blocks.shape)
        return sp.coo_matrix((blocks.ravel(), (rows.ravel(), columns.ravel())), (left.N, right.N)).tocsr()

    def at_quadrature(self, field: Field, derivative: Derivative = "") -> sp.csr_matrix:
        """Return the matrix that evaluates a field at all quadrature points, (n_element n_point, size(field))."""
        basis = self.basis(field)
        values = np.array([_derivative(f[0], derivative).ravel() for f in basis.basis])
        columns = np.repeat(basis.element_dofs, basis.dx.shape[1], axis=1)
        rows = np.broadcast_to(np.arange(values.shape[1]), values.shape)
        return sp.coo_matrix((values.ravel(), (rows.ravel(), columns.ravel())), (values.shape[1], basis.N)).tocsr()

    def interpolate(self, field: Field, linear: tuple[float, float, float]) -> Reals:
        """Return the degrees of freedom, (size(field),), of the linear function c0 + c1 x + c2 y."""
        return np.asarray(self._linear["w" if field == "w" else "u"] @ linear)

    @functools.cached_property
    def _linear(self) -> dict[Field, Reals]:
        """Degrees of freedom of 1, x and y in the spaces of u and w, (size(field), 3) each."""
        found: dict[Field, Reals] = {}
        x, y = self.quadrature_points
        for field in ("u", "w"):
            basis = self.basis(field)
            load = np.zeros((basis.N, 3))
            for i, value in enumerate((np.ones_like(x), x, y)):
                loads = np.array([(np.asarray(shape[0]) * value * basis.dx).sum(axis=1) for shape in basis.basis])
                load[:, i] = np.bincount(basis.element_dofs.ravel(), loads.ravel(), minlength=basis.N)
            mass = self.form(field, field)
            found[field] = splinalg.splu(mass.tocsc()).solve(load)
        return found

    def point_rows(self, field: Field, points: Reals, derivative: Derivative = "") -> sp.csr_matrix:
        """Return the matrix that evaluates a field, or a derivative of it, at points of the plan.

        A place outside the outline, such as one on the arc beside its polygon, counts as the nearest one inside.

        Parameters
        ----------
        field : "u", "v" or "w"
            The field.
        points : (n, 2)
            Places on the plan, m.
        derivative : str
            Derivative to evaluate.

        Returns
        -------
        csr_matrix, (n, size(field))
        """
        basis = self.basis(field)
        x, cells = self._located(np.asarray(points, dtype=float))
        local = basis.mapping.invF(x[:, :, np.newaxis], tind=cells)
        if isinstance(basis.elem, PowersOnce):
            axes = tuple("xy".index(letter) for letter in derivative)
            values = basis.elem.shapes(basis.mapping, local, cells, axes)[..., 0]
        else:
            shapes = (basis.elem.gbasis(basis.mapping, local, k, tind=cells)[0] for k in range(basis.Nbfun))
            values = np.array([_derivative(shape, derivative)[:, 0] for shape in shapes])
        rows = np.broadcast_to(np.arange(x.shape[1]), values.shape)
        return sp.coo_matrix(
            (values.ravel(), (rows.ravel(), basis.element_dofs[:, cells].ravel())), (x.shape[1], basis.N)
        ).tocsr()

    def nearest(self, points: Reals) -> Reals:
        """Return the points, (n, 2), of the plan that are nearest to places (n, 2)."""
        return self._located(np.asarray(points, dtype=float))[0].T

    def _located(self, points: Reals) -> tuple[Reals, NDArray[np.intp]]:
        """Return the nearest points of the plan, (2, n), and the elements that they lie in."""
        nearest = 12  # triangles tried for the place of a point
        mesh = self.membrane.mesh
        if isinstance(mesh, skfem.MeshQuad):
            low, high = self.bounds.T
            x = np.clip(points, low, high).T
            return x, mesh.element_finder(mapping=self.membrane.mapping)(*x)
        corners = mesh.p.T[mesh.t.T]
        n_near = min(nearest, len(corners))
        near = scipy.spatial.cKDTree(corners.mean(axis=1)).query(points, n_near)[1].reshape(len(points), n_near)
        candidate = _nearest_in_triangle(points[:, None], corners[near])
        chosen = np.argmin(np.linalg.norm(candidate - points[:, None], axis=2), axis=1)
        rows = np.arange(len(points))
        return candidate[rows, chosen].T, near[rows, chosen]


def _nearest_in_triangle(point: Reals, corner: Reals) -> Reals:
    """Return the points (..., 2) of triangles (..., 3, 2) that are nearest to points (..., 2)."""
    point = np.broadcast_to(point, (*corner.shape[:-2], 2))
    edge = np.roll(corner, -1, axis=-2) - corner
    offset = point[..., None, :] - corner
    cross = edge[..., 0] * offset[..., 1] - edge[..., 1] * offset[..., 0]
    within = np.all(cross >= 0.0, axis=-1) | np.all(cross <= 0.0, axis=-1)
    along = np.clip(np.sum(offset * edge, axis=-1) / np.sum(edge**2, axis=-1), 0.0, 1.0)
    on_edge = corner + along[..., None] * edge
    distance = np.linalg.norm(on_edge - point[..., None, :], axis=-1)
    best = np.argmin(distance, axis=-1)[..., None, None]
    outside = np.take_along_axis(on_edge, best, axis=-2)[..., 0, :]
    return np.where(within[..., None], point, outside)


def rectangle(length: float, width: float, n_x: int, n_y: int, edges: Sequence[float] = ()) -> Plan:
    """Mesh a rectangle centred at the origin.

    Parameters
    ----------
    length, width : float
        Along x and y, m.
    n_x, n_y : int
        Number of elements along x and y; they are equal where no edges are given.
    edges : sequence of float
        Places along x, m, where elements shall end: what acts on a part of an element is met slowly as the mesh grows
        finer. Those that nearly coincide count once. Between them elements are as near to length / n_x as may be.
    """
    mesh = skfem.MeshQuad.init_tensor(_cuts(length, n_x, edges), np.linspace(-width / 2.0, width / 2.0, n_y + 1))
    return plan_on(mesh.p, mesh.t)


def _cuts(length: float, n: int, edges: Sequence[float]) -> Reals:
    """Return where elements end, from -length / 2 to length / 2."""
    # Of an element, from which a part has one more: the sizes of stacks and clamps make just a half common, and then
    # neither rounding nor a dimension that is slightly off may change the mesh.
    half = 0.45
    coincide = 0.1  # of an element: edges that are closer are one
    end, size = length / 2.0, length / n
    inner = np.unique([edge for edge in edges if abs(edge) < end - coincide * size])
    apart = np.flatnonzero(np.diff(inner) > coincide * size) + 1
    marks = [-end, *(float(group.mean()) for group in np.split(inner, apart) if group.size), end]
    parts = [
        np.linspace(low, high, max(1, math.floor((high - low) / size + 1.0 - half)) + 1)
        for low, high in itertools.pairwise(marks)
    ]
    return np.concatenate([parts[0], *(part[1:] for part in parts[1:])])


def triangles(mesh: Triangulation) -> Plan:
    """Take a lamina that is cut into triangles."""
    return plan_on(np.ascontiguousarray(mesh.point.T), np.ascontiguousarray(mesh.triangle.T))


def plan_on(point: Reals, cell: Integers) -> Plan:
    """Take a lamina that is cut into rectangles or triangles.

    Parameters
    ----------
    point : (2, n_point)
        x and y of the corners, m.
    cell : (4, n_cell) or (3, n_cell)
        Corners of each rectangle or triangle.
    """
    triangle_order = 10  # exact for products of Argyris's quintic deflections
    quadrature_order = 6  # exact for products of the bicubic deflections of the rectangle
    if len(cell) == 4:
        mesh, order = skfem.MeshQuad(point, cell), quadrature_order
        elements = (skfem.ElementQuadS2(), ElementQuadBFS())
    else:
        mesh, order = skfem.MeshTri(point, cell), triangle_order
        elements = (skfem.ElementTriP2(), ElementTriArgyris())
    membrane, plate = (skfem.Basis(mesh, element, intorder=order) for element in elements)
    return Plan(membrane=membrane, plate=plate)


def plan_of(stack: Stack) -> Plan:
    """Mesh a lamina of the stack as its `mesh` says; elements of a rectangle end where clamps do."""
    if stack.outline is None:
        edges = [clamp.x + side * clamp.footprint[0] / 2.0 for clamp in stack.clamps for side in (-1.0, 1.0)]
        return rectangle(stack.length, stack.width, stack.mesh.n_x, stack.mesh.n_y, edges)
    return triangles(stack.outline.triangulated(stack.length / stack.mesh.n_x))
