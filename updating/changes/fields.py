"""What a structure's modes do everywhere: strains, slips and motions on a grid, as rows in modal coordinates.

Every stiffness of a stack is an integral of squares: of strains and curvatures of the laminas, of slip and opening of
the interfaces, of motions of what is held. So any local change is a weighted sum of squares of rows at points, and rows
are computed once, on one grid over the plan for all laminas of a layer at once. Laminas move by few functions over the
height, so that as many combinations of them do for all.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, update_wrapper
from typing import Any, Concatenate, ParamSpec

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray

from model import ReducedSystem, Stack
from model.contact.pressing import pressure_distribution
from model.elements.mesh import FIELDS, Derivative, Field
from model.reduction.reduction import shifted_factor
from updating.changes.structure import Answers, StatedTerm, Tied

Vector = NDArray[np.float64]
P = ParamSpec("P")

N_LOCATION = 220
"""Locations at which a kind is tried on one lamina; on a stack, where most have a height as well, half as many."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Layer:
    """A part of the height of a stack.

    Attributes
    ----------
    name : str
        What it is called: "all over the height", "bottom third".
    z : float
        Its middle, m.
    lamina : (n_lamina,) float
        1 for the laminas in it, 0 for others.
    interface : (n_lamina - 1,) float
        The same of the interfaces.
    """

    name: str
    z: float
    lamina: Vector
    interface: Vector


def layers_of(stack: Stack, *, fewest: int = 12) -> tuple[Layer, ...]:
    """Return the whole height and, of `fewest` laminas and more, its thirds."""
    n = stack.n_lamina
    z = stack.lamina_z
    between = (z[1:] + z[:-1]) / 2.0
    found = [Layer(name="", z=0.0, lamina=np.ones(n), interface=np.ones(n - 1))]
    if n >= fewest:
        edges = np.linspace(-stack.height / 2.0, stack.height / 2.0, 4)
        for name, low, high in zip(("bottom", "middle", "top"), edges[:-1], edges[1:], strict=True):
            found.append(
                Layer(
                    name=f"{name} third",
                    z=float((low + high) / 2.0),
                    lamina=((z >= low) & (z < high)).astype(float),
                    interface=((between >= low) & (between < high)).astype(float),
                )
            )
    return tuple(found)


@dataclass(frozen=True, eq=False, kw_only=True)
class Grid:
    """A grid of points over the plan of a structure.

    Attributes
    ----------
    x, y : (n_x,) and (n_y,) float
        Its lines, m; the outer ones are the edges of the bounding box.
    inside : (n_x, n_y) bool
        Which points the outline holds.
    """

    x: Vector
    y: Vector
    inside: NDArray[np.bool_]

    @property
    def point(self) -> Vector:
        """Points within the outline, (n_point, 2) m."""
        x, y = np.meshgrid(self.x, self.y, indexing="ij")
        return np.column_stack([x[self.inside], y[self.inside]])

    @property
    def area(self) -> Vector:
        """Area that each stands for, (n_point,) m2: half a cell at the edges."""
        sides = []
        for line in (self.x, self.y):
            side = np.full(line.size, line[1] - line[0])
            side[[0, -1]] /= 2.0
            sides.append(side)
        return np.asarray(np.outer(*sides)[self.inside])

    @property
    def number(self) -> NDArray[np.intp]:
        """Number of each point among those within the outline, (n_x, n_y); -1 outside."""
        found = np.full(self.inside.shape, -1, dtype=np.intp)
        found[self.inside] = np.arange(np.count_nonzero(self.inside))
        return found

    def shares(self, location: Vector) -> tuple[NDArray[np.intp], Vector]:
        """Return the four points around each location, (n, 4), and their shares, which are 0 beyond the outline.

        Parameters
        ----------
        location : (n, 2)
            Places, m.
        """
        index, weight = [], []
        for axis, line in enumerate((self.x, self.y)):
            step = line[1] - line[0]
            at = (location[:, axis] - line[0]) / step
            low = np.clip(np.floor(at).astype(int), 0, line.size - 2)
            part = np.clip(at - low, 0.0, 1.0)
            beyond = (at < -1e-9) | (at > line.size - 1 + 1e-9)
            index.append((low, low + 1))
            weight.append((np.where(beyond, 0.0, 1.0 - part), np.where(beyond, 0.0, part)))
        number, which, share = self.number, [], []
        for i, wx in zip(index[0], weight[0], strict=True):
            for j, wy in zip(index[1], weight[1], strict=True):
                point = number[i, j]
                which.append(np.maximum(point, 0))
                share.append(np.where(point < 0, 0.0, wx * wy))
        return np.stack(which, axis=1), np.stack(share, axis=1)


def grid_of(system: ReducedSystem) -> Grid:
    """Return the grid over the plan of a structure."""
    outside = 1e-6  # of the plan's size: a grid point that is farther from the outline is none
    # Points of the grid on one lamina: 1/45 of a square's side apart, where the highest modes of a test have a tenth
    # of a wavelength
    n_point = 2000
    n_point_stack = 700  # on a stack, whose laminas need several rows at each
    plan = system.assembly.plan
    (x0, x1), (y0, y1) = plan.bounds
    n = n_point if system.stack.n_lamina == 1 else n_point_stack
    step = float(np.sqrt((x1 - x0) * (y1 - y0) / n))
    x, y = (np.linspace(low, high, max(9, round((high - low) / step) + 1)) for low, high in ((x0, x1), (y0, y1)))
    inside = np.ones((x.size, y.size), dtype=bool)
    if system.stack.outline is not None:
        location = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
        away = np.linalg.norm(plan.nearest(location) - location, axis=1)
        inside = (away < outside * max(x1 - x0, y1 - y0)).reshape(inside.shape)
    return Grid(x=x, y=y, inside=inside)


def kept(method: Callable[Concatenate[Fields, Layer, P], Vector]) -> Callable[Concatenate[Fields, Layer, P], Vector]:
    """Return a method whose rows are computed once for each layer: kinds share them, and so what they do to errors."""

    def found(self: Fields, layer: Layer, /, *args: P.args, **kwargs: P.kwargs) -> Vector:
        key = (method.__name__, layer.name, args)
        if key not in self.kept:
            self.kept[key] = method(self, layer, *args, **kwargs)
        return self.kept[key]

    update_wrapper(found, method)
    return found


class Fields:
    """Rows of the modes of a stack or plate on a grid; see `Structure`.

    Parameters
    ----------
    system : ReducedSystem
        The structure.
    modes : (system.size, m)
        Mass-normalised modes in its coordinates.
    theta : mapping of str to float
        Parameters that they were solved for.
    band : (float, float)
        Lowest and highest measured natural frequency, Hz.
    further : (assembly.size, k), optional
        Vectors after the modes, in the equations of motion after reduction over the height.
    like : Fields, optional
        Those of the same structure with other vectors, whose grid these share.
    """

    stated: tuple[StatedTerm, ...] = ()
    axes, ends = ("x", "y"), ("left end", "front")
    stiffest = np.inf

    def __init__(
        self,
        system: ReducedSystem,
        modes: Vector,
        theta: Mapping[str, float],
        band: tuple[float, float],
        further: Vector | None = None,
        like: Fields | None = None,
    ) -> None:
        self.system, self.stack, self.theta, self.band, self.modes = system, system.stack, theta, band, modes
        self.grid: Grid = grid_of(system) if like is None else like.grid
        # matrices that evaluate fields on the grid
        self.evaluated: dict[tuple[Field, Derivative], Any] = {} if like is None else like.evaluated
        vectors = system.basis @ modes
        self.vectors = vectors if further is None else np.hstack([vectors, further])
        self.n_mode = self.vectors.shape[1]
        where = system.assembly.slices()
        self.coefficient = {
            f: self.vectors[where[f]].reshape(system.assembly.n_z[f], -1, self.n_mode).transpose(1, 0, 2)
            for f in FIELDS
        }
        self.kept: dict[tuple[object, ...], Vector] = {}
        self.shared: dict[tuple[object, ...], Any] = {}  # what several kinds of change need at the same locations
        self._rows: dict[tuple[Field, Derivative], Vector] = {}

    @cached_property
    def layers(self) -> tuple[Layer, ...]:
        """The whole height, and its thirds."""
        return layers_of(self.stack)

    def layer_name(self, number: int) -> str:
        """Return what a part of the height is called."""
        return self.layers[number].name

    def part_name(self, kind: str, number: int) -> str:
        """Return what a clamp or an edge is called."""
        if number < 0:
            return ""
        if "edge" not in kind:
            return f"clamp {number + 1}"
        return f"the {self.stack.supports[number].edge} edge"  # type: ignore[union-attr]  # patches are no edges

    @property
    def box(self) -> Vector:
        """Lowest and highest x, lowest and highest y of the plan, (2, 2) m."""
        return np.asarray(self.system.assembly.plan.bounds, dtype=float)

    def locations(self) -> tuple[Vector, Vector]:
        """Return locations over the plan, (n, 2) m, evenly spaced, and their steps along x and y.

        The outer ones are half a step from the edges.
        """
        grid = self.grid
        n = N_LOCATION if self.stack.n_lamina == 1 else N_LOCATION // 2
        sides = [float(np.ptp(line)) for line in (grid.x, grid.y)]
        step = np.sqrt(sides[0] * sides[1] / n)
        lines, steps = [], []
        for line, side in zip((grid.x, grid.y), sides, strict=True):
            count = max(3, round(side / step))
            lines.append(line[0] + (np.arange(count) + 0.5) * side / count)
            steps.append(side / count)
        found = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, 2)
        _, share = grid.shares(found)
        return found[share.sum(axis=1) > 0.5], np.array(steps)

    def finer(self, centre: Vector, step: Vector, n: int = 3) -> Vector:
        """Return n by n locations within the cell about each of some, (n n k, 2), cell after cell."""
        part = (np.arange(n) - (n - 1) / 2.0) / n
        away = np.stack(np.meshgrid(part, part, indexing="ij"), axis=-1).reshape(-1, 2) * step
        found = (centre[:, None] + away).reshape(-1, 2)
        low, high = self.box.T
        return np.clip(found, low, high)

    def located(self, location: Vector) -> Vector:
        """Return locations, (n, 3), without their heights."""
        return location[:, :2]

    def tied(self, at: Vector) -> Tied:
        """Return what a mass moves with: laminas in the mean of their squares."""
        return self._at(at, self.motion(self.layers[0]))

    def pulled(self, at: Vector) -> Tied:
        """Return what a spring across the laminas pulls at."""
        return self._at(at, self.deflection)

    def _at(self, at: Vector, rows: Vector) -> Tied:
        key = "points", at.tobytes()
        if key not in self.shared:
            which, share = self.grid.shares(at)
            row = np.broadcast_to(np.arange(len(at))[:, None], which.shape)
            weight = sp.coo_array((share.ravel(), (row.ravel(), which.ravel())), shape=(len(at), len(self.grid.point)))
            self.shared[key] = weight.tocsr()
        location = np.column_stack([at, np.zeros(len(at))])
        return Tied(location=location, rows=rows, weight=self.shared[key], part=np.full(len(at), -1, dtype=np.intp))

    def matrices(self) -> tuple[Vector, Vector, Vector]:
        """Return the modes in the coordinates of the reduced stack, and its stiffness and mass in these."""
        return self.modes, self.system.matrix("K", self.theta), self.system.matrix("M", self.theta)

    def beside(self, coordinates: Vector, answers: Vector | None) -> Fields:
        """Return them with further vectors after the modes."""
        further = self.system.basis @ coordinates
        further = further if answers is None else further + answers
        return Fields(self.system, self.modes, self.theta, self.band, further, like=self)

    @cached_property
    def _plate(self) -> tuple[Any, Any, Any, Vector, Vector]:
        """Factor of the stiffness of a single plate, its stiffness and mass, and both times its reduced coordinates."""
        assembly, basis = self.system.assembly, self.system.basis
        factor = shifted_factor(assembly, self.theta)
        stiffness, mass = assembly.matrix("K", self.theta), assembly.matrix("M", self.theta)
        return factor, stiffness, mass, np.asarray(stiffness @ basis), np.asarray(mass @ basis)

    def answers(self, location: Vector, half: float) -> Answers | None:
        """Return a plate's static answers to forces and moments about a location, at nine points; a stack has none.

        A single plate bends sharply at a point, what is thick does not.
        """
        smallest = 0.1  # of the root of the plan's area: half the side of the square over which forces are tried
        offsets = np.array([-1.0, 0.0, 1.0])
        if self.stack.n_lamina > 1:
            return None
        assembly, plan = self.system.assembly, self.system.assembly.plan
        half = max(half, smallest * float(np.sqrt(self.grid.area.sum())))
        where, about = assembly.slices(), [value + half * offsets for value in location[:2]]
        at = plan.nearest(np.stack(np.meshgrid(*about, indexing="ij"), axis=-1).reshape(-1, 2))
        force = []
        for field in FIELDS:
            n_z, size = assembly.n_z[field], plan.size(field)
            rows = [plan.point_rows(field, at)]
            rows += [plan.point_rows(field, at, d) for d in ("x", "y")] if field == "w" else []
            block = sp.kron(sp.identity(n_z), sp.vstack(rows)).toarray().T
            whole = np.zeros((assembly.size, block.shape[1]))
            whole[where[field]] = block.reshape(n_z * size, -1)
            force.append(whole)
        factor, stiffness, mass, stiff_basis, heavy_basis = self._plate
        found = np.asarray(factor.solve(np.hstack(force)))
        return Answers(
            vectors=found,
            stiffness=np.vstack([stiff_basis.T @ found, found.T @ (stiffness @ found)]),
            mass=np.vstack([heavy_basis.T @ found, found.T @ (mass @ found)]),
        )

    def at(self, field: Field, derivative: Derivative = "") -> Vector:
        """Return a field at all grid points, (n_point, n_function, m)."""
        key = (field, derivative)
        if key not in self._rows:
            if key not in self.evaluated:
                plan = self.system.assembly.plan
                self.evaluated[key] = plan.point_rows(field, self.grid.point, derivative)
            self._rows[key] = self._seen(self.evaluated[key], field)
        return self._rows[key]

    def at_points(self, point: Vector, field: Field, derivative: Derivative = "") -> Vector:
        """Return a field, or a derivative, at points (n, 2), (n, n_function, m)."""
        return self._seen(self.system.assembly.plan.point_rows(field, point, derivative), field)

    def _seen(self, rows: Any, field: Field) -> Vector:
        """Return what rows over the freedoms of a field see of the vectors, (n, n_function, m)."""
        coefficient = self.coefficient[field]
        seen = rows @ coefficient.reshape(coefficient.shape[0], -1)
        return np.asarray(seen.reshape(rows.shape[0], *coefficient.shape[1:]))

    def _compressed(self, parts: Sequence[tuple[Field, Vector]]) -> list[Vector]:
        """Return matrices (r, n_function) whose squares are those of given ones (n, n_function), together."""
        basis = la.orth(np.hstack([matrix for _, matrix in parts]), rcond=1e-9)
        return [basis.T @ matrix for _, matrix in parts]

    def lamina(self, layer: Layer, what: Sequence[tuple[Field, Derivative]]) -> list[Vector]:
        """Return fields of the laminas of a layer, (n_point, r, m) each: squares over r sum over laminas."""
        fields = list(dict.fromkeys(f for f, _ in what))
        over_z = dict(
            zip(
                fields, self._compressed([(f, layer.lamina[:, None] * self.system.phi[f]) for f in fields]), strict=True
            )
        )
        return [np.einsum("rf,pfm->prm", over_z[f], self.at(f, d), optimize=True) for f, d in what]

    def mean(self, layer: Layer, field: Field, derivative: Derivative = "") -> Vector:
        """Return the mean of a field over the laminas of a layer, (n_point, 1, m)."""
        row = layer.lamina @ self.system.phi[field] / layer.lamina.sum()
        return np.einsum("f,pfm->pm", row, self.at(field, derivative))[:, None]

    @cached_property
    def deflection(self) -> Vector:
        """Mean deflection of all laminas, (n_point, 1, m)."""
        return self.mean(self.layers[0], "w")

    @cached_property
    def plane_stress(self) -> tuple[float, float, float, float]:
        """Stiffness of the laminas in plane stress: q11, q12, q22, q66, Pa."""
        young = self.theta.get("young", 1.0)
        q11, q12, q22, q66 = (young * q for q in self.stack.material.plane_stress())
        return q11, q12, q22, q66

    @cached_property
    def mass(self) -> float:
        """Mass of the laminas, kg."""
        return float(
            self.theta.get("density", 1.0)
            * self.stack.material.density
            * self.stack.pitch
            * self.stack.n_lamina
            * self.grid.area.sum()
        )

    @cached_property
    def removable(self) -> float:
        """Largest mass that may go at one location, kg: a clamp, and what lies near."""
        nearby = 0.1  # over the root of the plan's area: mass that lies within belongs to a location
        clamps = max((clamp.mass for clamp in self.stack.clamps), default=0.0)
        return float(np.pi * nearby**2 * self.mass + clamps)

    @kept
    def strain(self, layer: Layer) -> Vector:
        """Return the strain energy of laminas per area as rows, (n_point, R, m): half their squares is the energy."""
        return self._strained(layer, 1.0, (1.0, 1.0))

    @kept
    def around_hole(self, layer: Layer) -> Vector:
        """Return the same of the energy that goes with a small hole, per area of it."""
        nu = self.stack.material.poisson
        return self._strained(layer, 2.0 / (1.0 - nu), (4.0 / (3.0 + nu), 4.0 / (1.0 + nu)))

    def _strained(self, layer: Layer, mean: float, rest: tuple[float, float]) -> Vector:
        """Return rows of `mean` times the energy by the mean of two strains and `rest` times all other.

        The first of `rest` is of bending, the second of strains in the plane.
        """
        q11, q12, q22, q66 = self.plane_stress
        t = self.stack.pitch
        whole = np.array([[q11, q12, 0.0], [q12, q22, 0.0], [0.0, 0.0, q66]])
        even = (q11 + q22 + 2.0 * q12) / 4.0 * np.outer([1.0, 1.0, 0.0], [1.0, 1.0, 0.0])
        bent, stretched = (la.cholesky(other * whole + (mean - other) * even) for other in rest)
        wxx, wyy, wxy = self.lamina(layer, [("w", "xx"), ("w", "yy"), ("w", "xy")])
        rows = _times(bent * np.sqrt(t**3 / 12.0), [wxx, wyy, 2.0 * wxy])
        if self.stack.n_lamina > 1 or np.any(self.coefficient["u"]):
            ux, vy, uy, vx = self.lamina(layer, [("u", "x"), ("v", "y"), ("u", "y"), ("v", "x")])
            rows += _times(stretched * np.sqrt(t), [ux, vy, uy + vx])
        return np.concatenate(rows, axis=1)

    @kept
    def evenly_bent(self, layer: Layer) -> Vector:
        """Return the same of the energy by the mean of two curvatures."""
        q11, q12, q22, _ = self.plane_stress
        wxx, wyy = self.lamina(layer, [("w", "xx"), ("w", "yy")])
        return np.asarray(np.sqrt((q11 + q22 + 2.0 * q12) / 4.0 * self.stack.pitch**3 / 12.0) * (wxx + wyy))

    @kept
    def across(self, layer: Layer, angle: float) -> Vector:
        """Return moment and force of laminas across a line as a crack feels them, (n_point, R, m).

        They are over the root of the stiffness. In its plane a crack opens 4 / (1 - nu**2) where a bent one turns
        4 / ((3 + nu) (1 - nu)), and forces are larger by the root of the ratio.

        Parameters
        ----------
        layer : Layer
            Which laminas.
        angle : float
            Of the line against the x axis, rad.
        """
        q11, q12, q22, q66 = self.plane_stress
        t, (c, s) = self.stack.pitch, (-np.sin(angle), np.cos(angle))  # normal of the line
        stiff = c**4 * q11 + s**4 * q22 + 2.0 * c**2 * s**2 * (q12 + 2.0 * q66)

        def normal(x: Vector, y: Vector, xy: Vector) -> Vector:
            """Stress resultant across the line of strains, the shear as an engineering strain."""
            return np.asarray(c * c * (q11 * x + q12 * y) + s * s * (q12 * x + q22 * y) + 2.0 * c * s * q66 * xy)

        wxx, wyy, wxy = self.lamina(layer, [("w", "xx"), ("w", "yy"), ("w", "xy")])
        rows = [normal(wxx, wyy, 2.0 * wxy) * np.sqrt(t**3 / 12.0 / stiff)]
        if self.stack.n_lamina > 1 or np.any(self.coefficient["u"]):
            ux, vy, uy, vx = self.lamina(layer, [("u", "x"), ("v", "y"), ("u", "y"), ("v", "x")])
            nu = self.stack.material.poisson
            rows.append(normal(ux, vy, uy + vx) * np.sqrt(t / stiff * (3.0 + nu) / (1.0 + nu)))
        return np.concatenate(rows, axis=1)

    def along(self, angle: float) -> Vector:
        """Return the curvature of the middle of the stack along a direction, (n_point, 1, m), 1/m."""
        c, s = np.cos(angle), np.sin(angle)
        whole = self.layers[0]
        xx, yy, xy = (self.mean(whole, "w", d) for d in ("xx", "yy", "xy"))
        return np.asarray(c * c * xx + s * s * yy + 2.0 * c * s * xy)

    @kept
    def motion(self, layer: Layer) -> Vector:
        """Return motions of laminas, (n_point, R, m), whose squares have the mean of their squares."""
        rows = self.lamina(layer, [(f, "") for f in FIELDS])
        return np.concatenate(rows, axis=1) / np.sqrt(layer.lamina.sum())

    @cached_property
    def clamps(self) -> Vector:
        """Motion of the clamps' masses as rows, (n_clamp, R, m), whose squares are each mass as the model has it."""
        assembly, found = self.system.assembly, []
        for i in range(len(self.stack.clamps)):
            moved = assembly.apply(assembly.term(f"clamp {i} mass").krons, self.vectors)
            found.append(as_rows(self.vectors.T @ moved))
        return np.array(found)

    @kept
    def contact(self, layer: Layer) -> Vector:
        """Return slip and opening of interfaces as rows, (n_point, R, m), whose squares are their energy per area."""
        return np.concatenate(self.slip_and_opening(layer), axis=1)

    @kept
    def slip(self, layer: Layer) -> Vector:
        """Return slip alone."""
        return self.slip_and_opening(layer)[0]

    def slip_and_opening(self, layer: Layer) -> tuple[Vector, Vector]:
        """Return both apart."""
        stack, phi = self.stack, self.system.phi
        n = stack.n_lamina
        jump, middle = np.diff(np.eye(n), axis=0), (np.eye(n)[1:] + np.eye(n)[:-1]) / 2.0
        shear, normal = self._moduli
        spacing = stack.spacing
        over = shear[0] * layer.interface
        z_u, z_v, z_w = self._compressed(
            [
                ("u", np.sqrt(over / spacing)[:, None] * (jump @ phi["u"])),
                ("v", np.sqrt(over / spacing)[:, None] * (jump @ phi["v"])),
                ("w", np.sqrt(over * spacing)[:, None] * (middle @ phi["w"])),
            ]
        )
        directions: tuple[tuple[Vector, Field, Derivative], ...] = ((z_u, "u", "x"), (z_v, "v", "y"))
        slip = [
            np.einsum("rf,pfm->prm", z, self.at(f), optimize=True)
            + np.einsum("rf,pfm->prm", z_w, self.at("w", d), optimize=True)
            for z, f, d in directions
        ]
        (z_n,) = self._compressed([("w", np.sqrt(normal[0] * layer.interface / spacing)[:, None] * (jump @ phi["w"]))])
        opening = np.einsum("rf,pfm->prm", z_n, self.at("w"), optimize=True)
        return (
            np.concatenate(slip, axis=1) * np.sqrt(shear[1])[:, None, None],
            opening * np.sqrt(normal[1])[:, None, None],
        )

    @cached_property
    def _moduli(self) -> tuple[tuple[Vector, Vector], tuple[Vector, Vector]]:
        """Return shear and normal modulus, Pa, each over the interfaces and over the plan: nearly their product."""
        stack, n, point = self.stack, self.stack.n_lamina - 1, self.grid.point
        distribution = pressure_distribution(stack)
        if distribution is None:
            p, normal = (np.full((n, 1), v) for v in (stack.contact.pressure, stack.contact.normal_modulus))
        else:
            p, normal = (np.array(field) for field in distribution.at(point))
        p = p / stack.contact.pressure * self.theta["pressure"]
        found = []
        for value, factor in ((p, self.theta["G_f"]), (normal, self.theta.get("normal_modulus", 1.0))):
            touching = value * factor * stack.touching[:, None]
            over_plan = np.broadcast_to(touching.mean(axis=0) / max(float(touching.mean()), 1e-300), (len(point),))
            found.append((touching.mean(axis=1), np.asarray(over_plan)))
        return found[0], found[1]


def as_rows(matrix: Vector) -> Vector:
    """Return rows, (m, m), whose squares sum to a matrix without negative eigenvalues."""
    value, axes = la.eigh(matrix)
    return np.asarray(np.sqrt(np.maximum(value, 0.0))[:, None] * axes.T)


def _times(matrix: Vector, rows: Sequence[Vector]) -> list[Vector]:
    """Return combinations of rows."""
    return [np.asarray(sum(share * row for share, row in zip(line, rows, strict=True) if share)) for line in matrix]
