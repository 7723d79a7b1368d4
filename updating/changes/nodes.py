"""A structure of matrices as kinds of change see it: motions of its nodes, and the terms that its file states.

Matrices say how nodes move, and nothing of strains between them. So what may have changed anywhere sits on nodes, and
parts of the structure are those that a stated term is.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
import scipy
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray

from model.matrices.labelled import DIRECTIONS, WHOLE, rigid_motion
from model.matrices.readers import Target
from model.matrices.reduced import ObservedPoints
from model.matrices.structure import MatrixStructure
from updating.changes.structure import Answers, Part, StatedTerm, Tied
from updating.diagnosis.matrices_model import MatricesNear

Vector = NDArray[np.float64]

N_LOCATION = 220
"""Nodes at which a kind is tried first; more where there are no more than these."""


def motions(structure: MatrixStructure, locations: ObservedPoints) -> sp.csr_array:
    """Return what locations show of vectors in the rows of a structure, (n, n_row)."""
    n, k = locations.node.shape
    order = np.lexsort((structure.dof, structure.node))
    label = structure.node[order].astype(np.int64) * 8 + structure.dof[order]
    row, column, share = [], [], []
    for axis in range(3):
        wanted = locations.node.astype(np.int64) * 8 + axis + 1
        at = np.minimum(np.searchsorted(label, wanted), label.size - 1)
        there = label[at] == wanted
        row.append(np.broadcast_to(np.arange(n)[:, None], (n, k))[there])
        column.append(order[at[there]])
        share.append((locations.weight * locations.direction[:, [axis]])[there])
    entries = np.concatenate(share), (np.concatenate(row), np.concatenate(column))
    return sp.csr_array(sp.coo_array(entries, shape=(n, structure.node.size)))


class Nodes:
    """Rows of the modes of a structure of matrices at its nodes; see `Structure`.

    Parameters
    ----------
    near : MatricesNear
        The structure about the fitted reference.
    x : (n,) float
        Coordinates of the fit.
    shape : (n_basis, m) float
        Mass-normalised modes in the coordinates of `near`.
    band : (float, float)
        Lowest and highest measured natural frequency, Hz.
    further : (n_row, k), optional
        Vectors after the modes, in the rows of the structure.
    """

    stack = None
    ends: tuple[str, ...] = ()

    def __init__(
        self, near: MatricesNear, x: Vector, shape: Vector, band: tuple[float, float], further: Vector | None = None
    ) -> None:
        self.near, self.x, self.shape, self.band = near, x, shape, band
        self.whole, lifted = near.reduced.structure, self._lifted(shape)
        self.vectors = lifted if further is None else np.hstack([lifted, further])
        self.n_mode = self.vectors.shape[1]
        self.factor = {name: value for name, (value, _) in near.theta(x).items()}
        moving = np.flatnonzero(self.whole.dof <= 3)
        number, first = np.unique(self.whole.node[moving], return_index=True)
        location, alone = np.unique(self.whole.location[moving[first]], axis=0, return_index=True)
        order = np.argsort(alone)  # of nodes that lie upon each other one is a location
        self.number, self.location = number[alone[order]], location[order]
        self._row = np.full((self.number.size, 3), -1, dtype=np.intp)
        at = np.minimum(np.searchsorted(self.number, self.whole.node[moving]), self.number.size - 1)
        known = self.number[at] == self.whole.node[moving]
        self._row[at[known], self.whole.dof[moving[known]] - 1] = moving[known]

    def _lifted(self, coordinates: Vector) -> Vector:
        """Return vectors in coordinates of the reduced structure, (n_basis, k), in its rows."""
        return np.asarray(self.near.reduced.basis @ (self.near.basis @ coordinates))

    def _matrix(self, target: Target) -> sp.csr_matrix:
        """Return K or M of the structure as it was fitted."""
        found = sp.csr_matrix((self.whole.node.size,) * 2)
        for term in self.whole.terms:
            if term.target == target:
                name = WHOLE[target] if term.factor is None else term.factor
                found = found + self.factor.get(name, self.whole.theta.get(name, 1.0)) * term.matrix
        return sp.csr_matrix(found)

    @cached_property
    def _matrices(self) -> tuple[sp.csr_matrix, sp.csr_matrix]:
        return self._matrix("K"), self._matrix("M")

    @cached_property
    def _weight(self) -> Vector:
        """Mass that each node moves with along an axis, (n_node,) kg, the largest of three."""
        rows, mass = np.maximum(self._row, 0), self._matrices[1]
        along = [np.asarray(mass @ (self.whole.dof == i + 1).astype(float)) for i in range(3)]
        return np.max([np.where(self._row[:, i] >= 0, along[i][rows[:, i]], 0.0) for i in range(3)], axis=0)

    @cached_property
    def mass(self) -> float:
        """All of the mass, kg."""
        mass = self._matrices[1]
        return max(float(mass[rows][:, rows].sum()) for rows in (self.whole.dof == i for i in (1, 2, 3)))

    @property
    def stiffest(self) -> float:
        """Stiffness that holds the structure's mass at the end of the band, N/m."""
        return self.mass * (2.0 * np.pi * self.whole.band_Hz) ** 2

    @cached_property
    def removable(self) -> float:
        """Largest mass that may go at one location, kg: of what lies near."""
        nearby = 0.1  # of the structure's size: mass that lies within belongs to a location
        extent = np.sort(np.ptp(self.location, axis=0))[:0:-1]
        size = float(np.sqrt(extent[0] * extent[1])) or float(extent[0])
        near = scipy.spatial.KDTree(self.location).query_ball_point(self.locations()[0], nearby * size)
        return float(min(max(self._weight[indices].sum() for indices in near), 0.5 * self.mass))

    @cached_property
    def axes(self) -> tuple[str, ...]:
        """Axes along which a location is said, those of the map being the longest two; none without locations."""
        thin = 0.05  # of the largest extent, below which an axis says nothing of a location
        if not self.whole.placed:
            return ()
        extent = np.ptp(self.location, axis=0)
        order = np.argsort(-extent, kind="stable")
        found = sorted(order[:2].tolist()) + [int(i) for i in order[2:] if extent[i] > thin * extent.max()]
        return tuple(DIRECTIONS[i] for i in found)

    @property
    def box(self) -> Vector:
        """Lowest and highest coordinates along the axes of the map, (2, 2) m."""
        axes = [DIRECTIONS.index(name) for name in self.axes[:2]]
        ends = np.column_stack([self.location.min(axis=0), self.location.max(axis=0)])
        return np.asarray(ends[axes]) if axes else np.zeros((2, 2))

    @cached_property
    def _cells(self) -> tuple[Vector, NDArray[np.intp]]:
        """Side of cells that hold all nodes, one node in the middle of each, and which."""
        n = self.number.size
        if n <= N_LOCATION:
            return np.zeros(3), np.arange(n, dtype=np.intp)
        low, high = 0.0, float(np.ptp(self.location, axis=0).max())
        for _ in range(40):
            side = (low + high) / 2.0
            low, high = (side, high) if self._middles(np.arange(n), side).size > N_LOCATION else (low, side)
        return np.full(3, high), self._middles(np.arange(n), high)

    def _middles(self, node: NDArray[np.intp], side: float) -> NDArray[np.intp]:
        """Return of nodes those that are nearest to the mean of all that share a cube of some side."""
        location = self.location[node]
        cube = np.floor((location - self.location.min(axis=0)) / side + 1e-9).astype(np.int64)
        _, cell = np.unique(cube, axis=0, return_inverse=True)
        cell, count = cell.ravel(), np.bincount(cell.ravel())
        mean = np.column_stack([np.bincount(cell, along) / count for along in location.T])
        away = np.linalg.norm(location - mean[cell], axis=1)
        order = np.lexsort((away, cell))
        return node[order[np.unique(cell[order], return_index=True)[1]]]

    def locations(self) -> tuple[Vector, Vector]:
        """Return locations of nodes, evenly spaced, (n, 3) m, and the sides of the cells that they stand for."""
        side, node = self._cells
        return self.location[node], side

    def finer(self, centre: Vector, step: Vector) -> Vector:
        """Return locations of nodes, closer to each other, of those to which one of some is the nearest."""
        part = 1 / 3  # of the distance between these, to which they are then separated
        every, _ = self.locations()
        chosen = scipy.spatial.KDTree(every).query(centre)[1]
        within = np.isin(scipy.spatial.KDTree(every).query(self.location)[1], chosen)
        node = np.flatnonzero(within)
        return self.location[node if not step.any() else self._middles(node, part * float(step.max()))]

    def located(self, location: Vector) -> Vector:
        """Return locations, (n, 3), as they are."""
        return location

    def _rows(self, at: Vector) -> tuple[NDArray[np.intp], Vector]:
        """Return the nodes at locations, (n,), and their motions along x, y and z, (n, 3, m)."""
        node = scipy.spatial.KDTree(self.location).query(at)[1]
        row = self._row[node]
        return node, np.where(row[:, :, None] < 0, 0.0, self.vectors[np.maximum(row, 0)])

    def tied(self, at: Vector) -> Tied:
        """Return what a mass moves with: a node, in all ways."""
        node, rows = self._rows(at)
        return Tied(location=self.location[node], rows=rows, weight=sp.identity(len(at), format="csr"), part=node)

    def pulled(self, at: Vector) -> Tied:
        """Return what a spring along x, y or z pulls at; numbers of nodes go on for each direction."""
        node, rows = self._rows(at)
        return Tied(
            location=np.tile(self.location[node], (3, 1)),
            rows=rows.transpose(1, 0, 2).reshape(3 * len(at), 1, -1),
            weight=sp.identity(3 * len(at), format="csr"),
            part=np.concatenate([node + self.number.size * (i + 1) for i in range(3)]),
        )

    def layer_name(self, number: int) -> str:  # noqa: ARG002
        """Return nothing: a structure of matrices has no layers."""
        return ""

    def part_name(self, kind: str, number: int) -> str:
        """Return what a node or a term is called."""
        if number < 0:
            return ""
        if kind.endswith("_term"):
            return self.stated[number].name.replace("_", " ")
        direction, node = divmod(number, self.number.size)
        return f"node {self.number[node]}" + (f" along {DIRECTIONS[direction - 1]}" if direction else "")

    def matrices(self) -> tuple[Vector, Vector, Vector]:
        """Return the modes in the coordinates of the reduced structure, and its stiffness and mass in these."""
        _, _, found = self.near.solved(self.x)
        return self.shape, found["K"], found["M"]

    def answers(self, location: Vector, half: float) -> Answers:  # noqa: ARG002
        """Return static answers to forces on the node at a location."""
        (node,), _ = self._rows(location[None])
        row = self._row[node][self._row[node] >= 0]
        force = np.zeros((self.whole.node.size, row.size))
        force[row, np.arange(row.size)] = 1.0
        found, basis = self.near.reduced.static(force), self.near.reduced.basis
        stiffness, mass = (matrix @ found for matrix in self._matrices)
        return Answers(
            vectors=found,
            stiffness=np.vstack([self.near.basis.T @ (basis.T @ stiffness), found.T @ stiffness]),
            mass=np.vstack([self.near.basis.T @ (basis.T @ mass), found.T @ mass]),
        )

    def beside(self, coordinates: Vector, answers: Vector | None) -> Nodes:
        """Return them with further vectors after the modes."""
        further = self._lifted(coordinates)
        further = further if answers is None else further + answers
        return Nodes(self.near, self.x, self.shape, self.band, further)

    @cached_property
    def stated(self) -> tuple[StatedTerm, ...]:
        """Terms of the structure file, each with what a factor of 1 adds where the reference has none of it."""
        found = []
        for factor in self.whole.factors:
            value = self.factor.get(factor.name, factor.nominal)
            parts = tuple(
                self._part(term.matrix, term.target, value or 1.0)
                for term in self.whole.terms
                if term.factor == factor.name and term.target != "C"
            )
            if parts:
                found.append(StatedTerm(name=factor.name, parts=parts, there=value != 0.0))
        return tuple(found)

    def _part(self, matrix: sp.csr_matrix, target: Target, size: float) -> Part:
        """Return some times a matrix as squares of rows: along its axes between the vectors."""
        between = self.vectors.T @ (matrix @ self.vectors)
        value, turn = la.eigh((between + between.T) / 2.0)
        rows = (np.sqrt(np.abs(value)) * turn).T[:, None]
        weight = sp.csr_array(size * np.sign(value)[None])
        return Part(rows=rows, target="M" if target == "M" else "K", weight=weight)

    @property
    def whole_stiffness(self) -> Part:
        """All of the stiffness."""
        return self._part(self._matrices[0], "K", 1.0)

    @property
    def grounded(self) -> list[Part]:
        """Stiffness of each stated term that holds the structure to the ground: rigid motions cost energy."""
        holds_least = 1e-6  # of the energy that a rigid motion would cost, were no entry to cancel another
        motion = rigid_motion(self.whole.location, self.whole.dof)
        motion = motion if self.whole.placed else motion[:, :3]
        holds = set()
        for term in self.whole.terms:
            if term.factor is None or term.target != "K":
                continue
            cost = np.einsum("ij,ij->j", motion, term.matrix @ motion)
            most = np.einsum("ij,ij->j", np.abs(motion), abs(term.matrix) @ np.abs(motion))
            if np.any(cost > holds_least * most):
                holds.add(term.factor)
        found = [term for term in self.stated if term.name in holds and term.there]
        return [part for term in found for part in term.parts if part.target == "K"]
