"""A structure of matrices reduced to a few coordinates: its modes, and what measured points and terms need."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import scipy
import scipy.linalg as la
from numpy.typing import NDArray

from model.elements.equations import Monomial
from model.matrices.labelled import Index, name_of, rigid_motion
from model.matrices.readers import Target
from model.matrices.structure import MatrixStructure
from model.matrices.text import refuse
from model.reduction.reduced_equations import ReducedTerm, summed
from model.solvers.eigen import CholeskyFactor, NotPositiveError, lowest_modes

Vectors = NDArray[np.float64]


@dataclass(frozen=True, eq=False, kw_only=True)
class ReducedMatrices:
    """The equations of motion of a structure in a few coordinates, SI units, as an engine consumes them.

    Attributes
    ----------
    structure : MatrixStructure
        What was reduced.
    terms : tuple of ReducedTerm
        Factor, a monomial of one parameter or 1, times matrix, (size, size).
    theta : mapping of str to float
        Parameters at which it was reduced.
    basis : (n, size) float
        From coordinates to the rows of the structure.
    static : callable
        Returns static responses to forces, (n, k), of the structure at `theta` with the shift added.
    left : mapping of str to float
        What the reduction leaves out, estimated from the forces that it leaves unbalanced: the largest relative error
        of a frequency in the band, "nominal" and with each term one prior deviation away.
    """

    structure: MatrixStructure
    terms: tuple[ReducedTerm, ...]
    theta: Mapping[str, float]
    basis: Vectors
    static: Callable[[Vectors], Vectors]
    left: Mapping[str, float]

    @property
    def size(self) -> int:
        """Number of coordinates."""
        return self.basis.shape[1]

    def matrix(self, target: Target, theta: Mapping[str, float]) -> Vectors:
        """Return the reduced M, C or K at the parameters `theta`, (size, size)."""
        return summed(self.size, ((t.factor(theta), t.matrix) for t in self.terms if t.target == target))

    def derivative(self, target: Target, theta: Mapping[str, float], name: str) -> Vectors:
        """Return the derivative of the reduced M, C or K by the parameter `name`, (size, size)."""
        terms = (t for t in self.terms if t.target == target)
        return summed(self.size, ((t.factor.derivative(theta, name), t.matrix) for t in terms))

    def moves(self, node: Sequence[int] | Index) -> Vectors:
        """Return the rows of the displacements of nodes along x, y and z, (n, 3, size); zero where they are held.

        Raises
        ------
        MatricesError
            The structure has no such node.
        """
        wanted, structure = np.asarray(node, dtype=np.int64), self.structure
        missing = wanted[~np.isin(wanted, structure.node)]
        if missing.size:
            refuse(f"{self.structure.name}: there is no node {missing[0]} in the matrices")
        found = np.zeros((wanted.size, 3, self.size))
        for axis in range(3):
            rows = np.flatnonzero(structure.dof == axis + 1)
            rows = rows[np.argsort(structure.node[rows])]
            at = np.minimum(np.searchsorted(structure.node[rows], wanted), max(rows.size - 1, 0))
            there = structure.node[rows][at] == wanted if rows.size else np.zeros(wanted.size, dtype=bool)
            found[there, axis] = self.basis[rows[at[there]]]
        return found

    def error(self, theta: Mapping[str, float]) -> float:
        """Return the largest relative error of a frequency of the band at some parameters; see `errors`."""
        return self.errors([theta])[0]

    def errors(self, thetas: Sequence[Mapping[str, float]]) -> list[float]:
        """Return the largest relative error of a frequency of the band at each of some sets of parameters.

        It comes from the forces that modes leave unbalanced. A mode x leaves r = (K - lambda M) x, whose static
        response has the energy r' (K + shift M)^-1 r; to first order the eigenvalue is too high by that times
        (lambda + shift) / what the modes left out lie above it, here at least once.
        """
        forces, values = [], []
        for theta in thetas:
            moved = {**self.theta, **theta}
            frequency, vector = self.solve(moved)
            kept = (frequency < self.structure.band_Hz) & (frequency > 0.0)
            values.append((2.0 * np.pi * frequency[kept]) ** 2)
            forces.append(_forces(self.structure, {None: 1.0, **moved}, self.basis @ vector[:, kept], values[-1]))
        force = np.hstack(forces)
        energy = np.einsum("ij,ij->j", force, self.static(force))
        each = np.split(energy, np.cumsum([value.size for value in values])[:-1])
        shift = _shift(self.structure)
        return [
            float(np.max(error / (2.0 * (value + shift)), initial=0.0))
            for error, value in zip(each, values, strict=True)
        ]

    def solve(self, theta: Mapping[str, float] | None = None, n_mode: int | None = None) -> tuple[Vectors, Vectors]:
        """Return frequencies, (n_mode,) Hz, and mass-normalised vectors, (size, n_mode), at some parameters.

        Raises
        ------
        MatricesError
            Mass is not positive there.
        """
        no_mass = 1e-13  # of the largest reciprocal of an eigenvalue: rounding
        moved = {**self.theta, **(theta or {})}
        stiffness, mass, shift = self.matrix("K", moved), self.matrix("M", moved), _shift(self.structure)
        try:
            # the reciprocal of an eigenvalue, as a joined basis may hold directions that have next to no mass
            inverse, vector = la.eigh(mass, stiffness + shift * mass)
        except la.LinAlgError:
            refuse(f"{self.structure.name}: neither stiffness nor mass is positive at {moved}")
        if inverse[0] < -no_mass * inverse[-1]:
            refuse(f"{self.structure.name}: mass is not positive at {moved}")
        moving = np.flatnonzero(inverse > no_mass * inverse[-1])[::-1][:n_mode]
        value = 1.0 / inverse[moving] - shift
        scaled = vector[:, moving] / np.sqrt(inverse[moving])
        return np.sqrt(np.maximum(value, 0.0)) / (2.0 * np.pi), scaled


def reduce_matrices(
    structure: MatrixStructure, theta: Mapping[str, float] | None = None, *, beside: ReducedMatrices | None = None
) -> ReducedMatrices:
    """Reduce a structure to its modes up to 1.5 times its band and to static responses.

    The responses are those to forces at each of the structure's points and patches, and to what each term changes in
    the modes of the band and again in that response. Rows without mass follow the others in all of them, as if they
    were condensed.

    Parameters
    ----------
    structure : MatrixStructure
        The structure.
    theta : mapping of str to float, optional
        Factors at which modes are taken, where they are not the nominal ones: where a fit stands, say.
    beside : ReducedMatrices, optional
        The same structure reduced at other factors, whose basis is joined to what is found here.

    Raises
    ------
    MatricesError
        The structure is not held together, or motions of a rigid body cost energy though it is stated to be free.
    """
    negative = 0.01  # of the shift: rounding, and text with few digits, give rigid motion less
    theta = {**structure.theta, **(theta or {})}
    stiffness, mass = (structure.matrix(target, theta) for target in ("K", "M"))
    shift = _shift(structure)
    factor = _factored(structure, stiffness + shift * mass)
    modes, value = _modes(mass, factor, shift, structure.band_Hz)
    if value[0] < -negative * shift:
        refuse(f"{structure.name}: the stiffness is negative along the lowest mode; is it that of a buckled state?")
    _check_rigid(structure, stiffness, mass, value)
    loads, answers = _responses(structure, factor, modes, value)
    basis = np.hstack([modes, _beside(modes, answers, loads, mass, shift)])
    if beside is not None:
        basis = _joined(np.hstack([basis, beside.basis]), stiffness + shift * mass)
    terms = tuple(
        ReducedTerm(
            name=t.name,
            target=t.target,
            factor=Monomial(exponent={} if t.factor is None else {t.factor: 1}),
            matrix=_even(basis.T @ (t.matrix @ basis)),
        )
        for t in structure.terms
    )
    found = ReducedMatrices(
        structure=structure, terms=terms, theta=theta, basis=basis, static=partial(_solved, factor),
        left={},
    )  # fmt: skip
    away = {"nominal": theta} | {one.name: {one.name: one.away(1.0)} for one in structure.factors}
    return replace(found, left=dict(zip(away, found.errors(list(away.values())), strict=True)))


def _shift(structure: MatrixStructure) -> float:
    """Return what times the mass is added to the stiffness before it is factored, (rad/s)**2."""
    shift = 1 / 4  # of the band: low against its modes, and far above what rounding gives rigid motion
    return (shift * 2.0 * np.pi * structure.band_Hz) ** 2


def _joined(vectors: Vectors, matrix: Any) -> Vectors:
    """Return a basis of some vectors, (n, k), that are independent in the energy of a matrix."""
    vectors = vectors / np.sqrt(np.einsum("ij,ij->j", vectors, matrix @ vectors))
    return _independent(vectors, vectors.T @ (matrix @ vectors))


def _independent(vectors: Vectors, energy: Vectors) -> Vectors:
    """Return vectors, (n, k), turned so that their energies, (k, k), are 1, without what carries too little."""
    least = 1e-8  # of a static response or a mode's: a frequency changes by half of what is left out
    size, turn = la.eigh(_even(energy)) if energy.size else (np.zeros(0), np.zeros((0, 0)))
    kept = size > least
    return np.asarray(vectors @ (turn[:, kept] / np.sqrt(size[kept])))


def _factored(structure: MatrixStructure, matrix: Any) -> CholeskyFactor:
    """Return the factor of the shifted stiffness.

    Raises
    ------
    MatricesError
        It is not positive definite; the message names a node.
    """
    try:
        return CholeskyFactor(matrix, structure.location)
    except NotPositiveError as error:
        where = name_of(structure.node, structure.dof, error.index)
        refuse(
            f"{structure.name}: the stiffness is not positive near {where}: parts without mass hang loose there, or "
            "rows are Lagrange multipliers"
        )


def _responses(
    structure: MatrixStructure, factor: CholeskyFactor, modes: Vectors, value: Vectors
) -> tuple[list[Vectors], list[Vectors]]:
    """Return forces, those at points first, and their static responses, each (n, k)."""
    order = 2  # powers of a change that responses stand for: what is left is of the third
    loads = [_unit_loads(structure)]
    answers = [_solved(factor, loads[0])]
    below = value < (2.0 * np.pi * structure.band_Hz) ** 2
    for one in structure.factors:
        answer = modes[:, below]
        for _ in range(order):
            loads.append(_forces(structure, {one.name: one.away(1.0) - one.nominal}, answer, value[below]))
            answer = _solved(factor, loads[-1])
            answers.append(answer)
    return loads, answers


def _even(matrix: Vectors) -> Vectors:
    return np.asarray((matrix + matrix.T) / 2.0)


def _solved(factor: CholeskyFactor, load: Vectors) -> Vectors:
    columns = 64  # right-hand sides at once
    parts = [factor.solve(load[:, i : i + columns]) for i in range(0, load.shape[1], columns)]
    return np.hstack(parts) if parts else np.zeros_like(load)


def _modes(mass: Any, factor: CholeskyFactor, shift: float, band_Hz: float) -> tuple[Vectors, Vectors]:
    """Return mass-normalised modes up to beyond the band, (n, k), and their eigenvalues, (k,)."""
    # of the band, up to which modes are kept: static responses stand for those above (Craig and Bampton)
    beyond = 1.5
    tolerance = 1e-11  # relative, of eigenvalues
    first = 20  # modes that are sought first
    limit = (beyond * 2.0 * np.pi * band_Hz) ** 2
    moving = int(np.count_nonzero(mass.diagonal()))
    n, random = min(first, moving), np.random.default_rng(0)
    while True:
        # the mass goes first: only then do rows without mass follow the others
        start = factor.solve(mass @ random.standard_normal((mass.shape[0], n)))
        value, vector = lowest_modes(factor.solve, lambda x: mass @ x, shift, start, n, tolerance)
        if value[-1] > limit or n == moving:
            break
        n = min(2 * n, moving)
    kept = int(np.count_nonzero(value <= limit)) + 1
    return vector[:, :kept], value[:kept]


def _check_rigid(structure: MatrixStructure, stiffness: Any, mass: Any, value: Vectors) -> None:
    """Refuse a structure that is stated to be free, and is not.

    Raises
    ------
    MatricesError
        The message says which motion costs energy.
    """
    rigid = 0.01  # of the lowest elastic frequency, below which motion of a rigid body is free
    stated = structure.rigid_modes
    if stated is None:
        return
    free = np.sqrt(np.maximum(value, 0.0)) / (2.0 * np.pi)
    limit = rigid * (free[stated] if free.size > stated else structure.band_Hz)
    found = int(np.count_nonzero(free < limit))
    if found == stated:
        return
    motion = rigid_motion(structure.location, structure.dof)
    energy = np.einsum("ij,ij->j", motion, stiffness @ motion)
    weight = np.einsum("ij,ij->j", motion, mass @ motion)
    moves = np.sqrt(np.maximum(energy, 0.0) / np.where(weight > 0.0, weight, np.inf)) / (2.0 * np.pi)
    words = ", ".join(
        f"{name} {f:.3g} Hz" for name, f in zip(("x", "y", "z", "about x", "about y", "about z"), moves, strict=True)
    )
    refuse(
        f"{structure.name}: rigid_modes = {stated}, and {found} modes are near 0 (the lowest: "
        f"{', '.join(f'{f:.3g}' for f in free[:7])} Hz). As a rigid body it would move at: {words}. Is a support, a "
        "spring to ground or a coupled node left in the model, or are numbers written with too few digits?"
    )


def _unit_loads(structure: MatrixStructure) -> Vectors:
    """Return unit forces at each point and, shared out evenly, on each patch, (n, k)."""
    move = structure.dof <= 3
    columns = []
    for name in structure.points:
        for i in np.flatnonzero(np.isin(structure.node, structure.groups[name]) & move):
            columns.append((np.arange(structure.node.size) == i).astype(float))
    for name in structure.patches:
        inside = np.isin(structure.node, structure.groups[name])
        columns.extend((inside & (structure.dof == i)).astype(float) for i in (1, 2, 3))
    columns = [one for one in columns if one.any()]
    return np.column_stack(columns) if columns else np.zeros((structure.node.size, 0))


def _forces(structure: MatrixStructure, factors: Mapping[Any, float], vectors: Vectors, value: Vectors) -> Vectors:
    """Return the forces, (n, k), of terms times some factors on vectors at eigenvalues; None is that of what stays."""
    found = np.zeros_like(vectors)
    for term in structure.terms:
        factor = factors.get(term.factor, 0.0)
        if term.target != "C" and factor:
            found += (term.matrix @ vectors) * (factor if term.target == "K" else -factor * value)
    return found


def _beside(
    modes: Vectors, answers: Sequence[Vectors], loads: Sequence[Vectors], mass: Vectors, shift: float
) -> Vectors:
    """Return what static responses have beside the modes, (n, k), without what carries too little energy to matter."""
    scaled = []
    for i, (answer, load) in enumerate(zip(answers, loads, strict=True)):
        energy = np.einsum("ij,ij->j", answer, load)
        # a force at a point counts by its share of its response, a change of a term by its share of the mode
        scale = np.sqrt(energy) if i == 0 else np.full(energy.size, np.sqrt(shift))
        scaled.append((answer / np.where(scale > 0.0, scale, 1.0), load / np.where(scale > 0.0, scale, 1.0)))
    answer, load = (np.hstack([pair[k] for pair in scaled]) for k in (0, 1))
    part = modes.T @ (mass @ answer)
    beside = answer - modes @ part
    # K + shift M is diagonal in modes, so the energies beside them are those of the answers less those along modes
    along = modes.T @ load
    return _independent(beside, answer.T @ load - part.T @ along)


_ABOUT = 27  # nodes about a point: the neighbours of one in a mesh of bricks


_SAME = 1e-6  # of the structure's size: a point is on a node


@dataclass(frozen=True, eq=False, kw_only=True)
class ObservedPoints:
    """Where displacements are looked at.

    Attributes
    ----------
    node : (n, k) int
        Nodes about each location.
    weight, slope : (n, k) float
        What of their motion is that of the location, and its derivative along x, 1/m.
    distance : (n,) float
        From the location to the nearest node, m.
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


def points_on(
    structure: MatrixStructure, number: Index, location: Vectors, direction: Vectors, *, tolerance: float = 0.01
) -> ObservedPoints:
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
    looked_at = 1e-3  # share of a direction along an axis that counts
    n, number = len(direction), np.asarray(number, dtype=np.int64)
    if not structure.placed:
        missing = number[~np.isin(number, structure.node)]
        if missing.size:
            refuse(
                f"{structure.name}: point {missing[0]} has no node of its number, by which points are placed where no "
                "file says where nodes are; name one by matrices.nodes, or number the points as the nodes"
            )
        one, none = np.ones((n, 1)), np.zeros((n, 1))
        return ObservedPoints(node=number[:, None], weight=one, slope=none, distance=none[:, 0], direction=direction)
    k = min(_ABOUT, np.unique(structure.node).size)
    node, distance = np.zeros((n, k), dtype=np.int64), np.zeros(n)
    weight, slope = np.zeros((n, k)), np.zeros((n, k))
    looked = np.abs(direction) > looked_at
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
            refuse(
                f"{structure.name}: point {number[rows[i]]} is {1e3 * found[3][i]:.4g} mm from the nearest node; "
                f"nodes span {span} mm. Points must have the coordinates of the model: check their unit and origin"
            )
    return ObservedPoints(node=node, weight=weight, slope=slope, distance=distance, direction=direction)


def _moving(structure: MatrixStructure, axes: NDArray[np.bool_]) -> Index:
    """Return the nodes that have a row for each of some axes."""
    node, count = np.unique(structure.node[np.isin(structure.dof, np.flatnonzero(axes) + 1)], return_counts=True)
    return np.asarray(node[count == np.count_nonzero(axes)])


def _near(
    structure: MatrixStructure, node: Index, location: Vectors, tolerance: float
) -> tuple[Index, Vectors, Vectors, Vectors, Vectors]:
    """Return nodes about places, (n, k), their weights and slopes, and how far the nearest is, (n,), and is too far."""
    singular = 1e-4  # of the polynomial: directions in which nodes do not spread
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
    cells = np.linalg.norm((place[near] - within[:, None]) / spacing, axis=2).min(axis=1)  # of a mesh of planes
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
        found = np.linalg.pinv(near_more[:, None] * powers, rcond=singular) * near_more
        weight[i], slope[i] = found[0], found[1] / (reach * spacing[0])
        if distance[i].min() < _SAME * size:
            weight[i] = np.arange(k) == int(distance[i].argmin())
    return node[near], weight, slope, distance.min(axis=1), far


def _spacing(place: Vectors) -> Vectors:
    """Return the distance between planes of nodes along x, y and z, (3,), by which neighbours are known."""
    extent = np.ptp(place, axis=0)
    largest = float(extent.max()) or 1.0
    planes = [np.unique(np.round(along / (_SAME * largest))).size for along in place.T]
    return np.where(extent > _SAME * largest, extent / np.maximum(np.array(planes) - 1, 1), largest)
