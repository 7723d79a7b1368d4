"""A stack's equations on few coordinates about a point: modes there, and their static responses."""

from __future__ import annotations

import copy
import itertools
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from model.elements.equations import OMEGA, ParameterFactor, Target
from model.reduction.reduced_equations import InRange, Matrix, ReducedTerm, generic
from updating.diagnosis.evidence import DECAY, POINTS_SHIFT
from updating.diagnosis.fit_settings import scaled
from updating.diagnosis.local_basis import (
    ENERGIES,
    MODES,
    N_FURTHER,
    Responses,
    StackScreen,
    Whole,
    distinct,
    gathered,
    leading,
    times,
)
from updating.inference.protocol import Coordinate, Modal

Vector = NDArray[np.float64]

RATIOS = ("young", "density", "normal_modulus")
"""Nuisances that are logarithms of a ratio and parameters of the model."""
RIGID = (2.0 * np.pi * 20.0) ** 2
"""Eigenvalue, (rad/s)**2, up to which a mode is rigid-body motion: suspensions give that some hertz."""


@dataclass(frozen=True, eq=False)
class _Part:
    """A term: its factor, the parameters of the factor that move, and the strengths without which it vanishes."""

    target: Target
    factor: ParameterFactor
    names: frozenset[str]
    needs: frozenset[str]
    matrix: Any  # in full; where it is not projected yet, as a term has it


class StackNear:
    """A stack's equations on few coordinates about some points: modes there, and their static responses.

    What a fit moves far, such as contact and effects, acts by its exact factor; locations and dimensions, which move by
    millimetres, act linearly about the first point.

    Parameters
    ----------
    whole : Whole
        The model.
    coordinates : sequence of Coordinate
        Those of the fit.
    points : sequence of (n_coordinate,) float
        Where the basis is made.
    """

    def __init__(self, whole: Whole, coordinates: Sequence[Coordinate], points: Sequence[Vector]) -> None:
        self.whole, self.names = whole, [c.name for c in coordinates]
        self.n_equation = whole.n_equation + whole.n_riding(self.names)
        self.at = {name: i for i, name in enumerate(self.names)}
        self.first = dict(zip(self.names, points[0], strict=True))
        known = whole.parameters
        slips = () if whole.slip is None else [p.name for p in whole.slip.parameters]
        self.far = [n for n in self.names if n in ("G_f", "d_f", *RATIOS) or (n in known and n not in slips)]
        self.near = [n for n in self.names if n in whole.clamp_locations]
        self.sized = [n for n in self.names if n in whole.dimensions]
        self.moving = frozenset(self.far)
        moving = frozenset((*self.far, *self.near, OMEGA))
        n_state = len(whole.measured)
        thetas = [whole.theta(dict(zip(self.names, x, strict=True)), c)[0] for x in points for c in range(n_state)]
        terms = whole.acting(thetas, moving)
        step = {c.name: c.step for c in coordinates}
        self._by_place = self._placed(terms, thetas[:n_state])
        terms = [(term, names) for term, names in terms if not names & frozenset(self.near)]
        self._basis(terms, thetas, step, self._elsewhere(coordinates))
        self._parts(terms, thetas[:n_state])

    def _elsewhere(self, coordinates: Sequence[Coordinate]) -> list[dict[str, float]]:
        """Return coordinates with those that are neutral at their starts: where an effect acts, its place matters."""
        idle = [c for c in coordinates if len(c.starts) > 1 and self.first[c.name] == 0.0]
        most = max((len(c.starts) for c in idle), default=0)
        return [{**self.first, **{c.name: c.starts[i % len(c.starts)] for c in idle}} for i in range(most)]

    def _stack(self, parts: Iterable[_Part], size: int, small: Callable[[Any], Vector]) -> None:
        """Set the parts, whose matrices `small` writes in `size` coordinates, in one array for each target."""
        parts = list(parts)
        self.stacked, self.of_target = dict[str, Vector](), dict[str, list[_Part]]()
        for t in "KMC":
            of_target = [p for p in parts if p.target == t]
            stacked = np.empty((len(of_target), size, size))
            for matrix, p in zip(stacked, of_target, strict=True):
                matrix[:] = small(p.matrix)
            self.stacked[t] = stacked
            self.of_target[t] = [replace(p, matrix=m) for p, m in zip(of_target, stacked, strict=True)]
        self.parts = [p for of_target in self.of_target.values() for p in of_target]
        self._moved = {n for t in ENERGIES for p in self.of_target[t] for n in p.names & self.moving}

    def _placed(
        self, terms: Sequence[tuple[ReducedTerm, frozenset[str]]], thetas: Sequence[Mapping[str, float]]
    ) -> list[dict[tuple[str, Target], list[Matrix]]]:
        """Return the derivatives of K and M by each place in each state, where there are any, each as a sum."""
        by_state = list[dict[tuple[str, Target], list[Matrix]]]()
        made: dict[tuple[str, Target, tuple[float, ...]], list[Matrix]] = {}
        for theta in thetas:
            by_state.append({})
            for name, target in itertools.product(self.near, ENERGIES):
                acting = [t for t, names in terms if name in names and t.target == target]
                derivative = tuple(t.factor.derivative(theta, name) for t in acting)
                if any(derivative):
                    if (name, target, derivative) not in made:
                        made[name, target, derivative] = gathered(
                            self.whole.equations.size,
                            ((d, t.matrix) for d, t in zip(derivative, acting, strict=True) if d),
                        )
                    by_state[-1][name, target] = made[name, target, derivative]
        return by_state

    def _basis(
        self,
        terms: Sequence[tuple[ReducedTerm, frozenset[str]]],
        thetas: Sequence[Mapping[str, float]],
        step: Mapping[str, float],
        elsewhere: Sequence[Mapping[str, float]],
    ) -> None:
        """Choose the basis: modes at every point, and responses of the lowest to each coordinate that moves."""
        whole, blocks, n_basis = self.whole, list[Vector](), self.n_equation + N_FURTHER
        of, number = list[str](), list[int]()  # the coordinate of each vector, and the mode
        reference, n_state = None, len(whole.measured)
        self._whole_matrices: list[dict[str, Vector]] = []
        self.mesh: list[Vector | None] = []
        self._inertia: list[Vector] = []
        first: dict[tuple[float, ...], int] = {}
        for c, theta in enumerate(thetas):
            alike = first.setdefault(tuple(theta.values()), c)
            if alike < c:  # such as another stack at the same torque
                if c < n_state:
                    self._whole_matrices.append(self._whole_matrices[alike])
                    self.mesh.append(self.mesh[alike])
                    self._inertia.append(self._inertia[alike])
                continue
            stiffness, mass = (whole.equations.matrix(t, theta) for t in ("K", "M"))
            value, vector = la.eigh(stiffness, mass)
            floor = value[value > whole.rigid][0]
            if c < n_state:
                self._whole_matrices.append({"K": stiffness, "M": mass, "C": whole.equations.matrix("C", theta)})
            if reference is None:
                first_mass = mass
                reference = la.cholesky(stiffness + floor * mass, lower=True)
            size = np.sqrt(np.maximum(value, floor))
            blocks.append(vector[:, :n_basis] * (30.0 / size[:n_basis]))
            of += [MODES] * n_basis
            number += range(n_basis)
            low, beyond = vector[:, : self.n_equation], vector[:, n_basis:]
            lam = np.maximum(value[: self.n_equation], floor)
            below = value[n_basis:, None] - lam
            slope = whole.theta(self.first, 0)[1]
            state = c % n_state
            variants = [dict(theta), *(whole.theta(at, state)[0] for at in elsewhere)]
            force: dict[str, dict[int, Vector]] = {}
            for term, names in terms:
                if term.target == "C":
                    continue
                image = None
                for name in sorted(names - {OMEGA}):
                    for i, at in enumerate(variants):
                        derivative = term.factor.derivative(at, name)
                        if derivative:
                            if image is None:
                                image = times(term.matrix, low)
                                image = -image * value[: self.n_equation] if term.target == "M" else image
                            of_name = force.setdefault(name, {})
                            of_name[i] = of_name.get(i, 0.0) + derivative * image
            for (name, target), matrices in self._by_place[state].items():
                image = np.sum([times(matrix, low) for matrix in matrices], axis=0)
                image = -image * value[: self.n_equation] if target == "M" else image
                of_name = force.setdefault(name, {})
                of_name[0] = of_name.get(0, 0.0) + image
            answering = [
                (name, image, step[name] * slope.get(name, 1.0))
                for name, of_name in force.items()
                for image in distinct(of_name)
            ]
            if c < n_state:
                answering += [
                    (name, self._sized(name, theta, low, value[: self.n_equation]), step[name]) for name in self.sized
                ]
            if answering:
                forces = np.hstack([image * (small / np.sqrt(lam)) for _, image, small in answering])
                blocks.append(beyond @ ((beyond.T @ forces) / np.tile(below, len(answering))))
                of += [name for name, *_ in answering for _ in lam]
                number += [*range(lam.size)] * len(answering)
            if c < n_state:
                finer, inertia = whole.finer_mesh(theta)
                self.mesh.append(finer)
                self._inertia.append(inertia)
        assert reference is not None
        vectors = np.hstack(blocks)
        weighed = reference.T @ vectors
        self.basis = leading(weighed @ weighed.T, reference, first_mass)
        self.size = self.basis.shape[1]
        held = reference.T @ self.basis
        energy = la.cholesky(held.T @ held, lower=True)
        self._responses: Responses | None = Responses(
            weighed=energy.T @ (self.basis.T @ first_mass) @ vectors,
            of=np.array(of),
            number=np.array(number),
            energy=energy,
        )

    def _sized(self, name: str, theta: Mapping[str, float], low: Vector, lam: Vector) -> Vector:
        """Return the force by which a dimension acts on modes, per unit of its logarithm."""
        change = self.whole.dimension(name, theta)
        return np.asarray(change["K"] @ low - (change["M"] @ low) * lam)

    def _parts(
        self, terms: Sequence[tuple[ReducedTerm, frozenset[str]]], thetas: Sequence[Mapping[str, float]]
    ) -> None:
        """Project the terms: exact ones with factors, locations and dimensions as derivatives at the first point."""
        ranges: dict[int, Vector] = {}  # which many matrices share

        def project(matrix: Matrix) -> Vector:
            if not isinstance(matrix, InRange):
                return np.asarray(self.basis.T @ matrix @ self.basis)
            if id(matrix.range) not in ranges:
                ranges[id(matrix.range)] = matrix.range.T @ self.basis
            within = ranges[id(matrix.range)]
            return np.asarray(within.T @ matrix.core @ within)

        n = self.size
        neutral = [self.whole.theta(dict.fromkeys(self.names, 0.0), c)[0] for c in range(len(thetas))]
        points = [(at_neutral, generic(at_neutral, self.moving)) for at_neutral in neutral]
        strengths = frozenset(name for name, p in self.whole.parameters.items() if not p.is_location)

        def needed(factor: ParameterFactor, name: str) -> bool:
            return not any(factor({**anywhere, name: at_neutral[name]}) for at_neutral, anywhere in points)

        parts = (
            _Part(
                t.target,
                t.factor,
                names,
                frozenset(name for name in names & strengths if needed(t.factor, name)),
                t.matrix,
            )
            for t, names in terms
            if names
        )
        self._stack(parts, n, project)
        self.linear = {t: np.zeros((len(thetas), len(self.near) + len(self.sized), n, n)) for t in "KM"}
        fixed = {t: np.zeros((len(thetas), n, n)) for t in "KMC"}
        for c, theta in enumerate(thetas):
            for target in "KMC":
                moving = np.tensordot([p.factor(theta) for p in self.of_target[target]], self.stacked[target], axes=1)
                fixed[target][c] = project(self._whole_matrices[c][target]) - moving
            for (name, target), matrices in self._by_place[c].items():
                self.linear[target][c, self.near.index(name)] = np.sum(list(map(project, matrices)), axis=0)
        for i, name in enumerate(self.sized, len(self.near)):
            for c, theta in enumerate(thetas):
                for target, change in self.whole.dimension(name, theta).items():
                    self.linear[target][c, i] = project(change)
        for c, finer in enumerate(self.mesh):
            if finer is not None:
                forces = self.basis.T @ self._inertia[c]
                fixed["K"][c] += forces @ finer @ forces.T
        self.fixed = fixed
        del self._whole_matrices, self._by_place, self._inertia
        self.rows = [measured.rows @ self.basis for measured in self.whole.measured]
        self.slopes = [measured.slope @ self.basis for measured in self.whole.measured]

    @property
    def n_number(self) -> int:
        """How many numbers the matrices of the terms and of the states hold."""
        return sum(m.size for of in (self.stacked, self.fixed, self.linear) for m in of.values())

    def of(self, coordinates: Sequence[Coordinate]) -> StackNear:
        """Return the same for some of the coordinates, on as much smaller a basis; the others stay where neutral."""
        part = copy.copy(self)
        part.names = [c.name for c in coordinates]
        part.at = {name: i for i, name in enumerate(part.names)}
        part.far = [n for n in self.far if n in part.at]
        part.near, part.sized = ([n for n in names if n in part.at] for names in (self.near, self.sized))
        part.moving = frozenset(part.far)
        part.n_equation = self.whole.n_equation + self.whole.n_riding(part.names)
        neutral = [self.whole.theta(dict.fromkeys(part.names, 0.0), c)[0] for c in range(len(self.rows))]
        moving = part.moving | {OMEGA}
        there = [p for p in self.parts if p.needs <= part.moving]
        fixed = {t: m.copy() for t, m in self.fixed.items()}
        for p in there:
            if not p.names & moving:
                for c, theta in enumerate(neutral):
                    fixed[p.target][c] += p.factor(theta) * p.matrix
        kept = [i for i, name in enumerate((*self.near, *self.sized)) if name in part.at]
        part.fixed, part.linear = fixed, {t: m[:, kept] for t, m in self.linear.items()}
        part._stack([p for p in there if p.names & moving], self.size, np.asarray)
        if self._responses is not None:
            part._project(self._responses.basis(coordinates, self.first, part.n_equation))
        return part

    def _project(self, basis: Vector) -> None:
        """Write all in a smaller basis, (size, m); some of its coordinates have no smaller one then."""

        def projected(matrix: Vector) -> Vector:
            return np.asarray(basis.T @ matrix @ basis)

        self.fixed = {t: projected(m) for t, m in self.fixed.items()}
        for t, m in self.linear.items():
            small = np.zeros((*m.shape[:2], basis.shape[1], basis.shape[1]))
            acting = np.nonzero(m.any(axis=(2, 3)))
            small[acting] = projected(m[acting])
            self.linear[t] = small
        self._stack(self.parts, basis.shape[1], projected)
        self.basis, self.size = self.basis @ basis, basis.shape[1]
        self.rows = [rows @ basis for rows in self.rows]
        self.slopes = [slope @ basis for slope in self.slopes]
        self._responses = None

    def measured_as(self, whole: Whole) -> StackNear:
        """Return the same for other measured modes of the same states and points, those of `whole`."""
        part = copy.copy(self)
        part.whole = whole
        return part

    def modal(
        self,
        x: Vector,
        state: int,
        solved: tuple[Vector, Vector, dict[str, Vector]] | None = None,
        n_equation: int | None = None,
    ) -> Modal:
        """Return the model of a state at coordinates.

        `solved` is what that returns there, where it is known, and `n_equation` how many equations are looked at, where
        other states need more: all states have as many.
        """
        at = dict(zip(self.names, x.tolist(), strict=True))
        theta, slope = self.whole.theta(at, state)
        value, vectors, matrix = solved or self.solved(x, state)
        n = n_equation or self.whole.n_equation + self.whole.n_riding_within(theta)
        vector, beyond = vectors[:, :n], value[n:]
        value = value[:n]
        n_rigid = int(np.count_nonzero(value < self.whole.rigid))
        value[:n_rigid] = 0.0
        between = self._between(vectors, vector)
        moves, stiffness, mass = self._moves(theta, slope, state, vectors, vector, between)
        damping, damps = self._losses(theta, slope, state, vector, matrix["C"])
        if DECAY in self.at:
            inertia = vector.T @ matrix["M"] @ vector
            damping = damping + 2.0 * at[DECAY] * inertia
            damps[self.at[DECAY]] = 2.0 * inertia[None]
        of_mode, of_mode_change = self._of_mode(theta, slope, state, between)
        slipping = self._slipping(at, state)
        if slipping is not None:
            G = self._columns("G_f", state)
            (contact,) = stiffness[moves == G[0], :n]  # what the contact holds
            softer, lossy = slipping
            omega = 2.0 * np.pi * self.whole.measured[state].state.frequency
            for i, change in ((None, softer[0]), *softer[1].items(), *((i, softer[0]) for i in G)):
                block = -change[:, None, None] * contact
                if i is None:
                    of_mode = block if of_mode is None else of_mode + block
                else:
                    of_mode_change[i] = of_mode_change[i] + block if i in of_mode_change else block
            for i, change in ((None, lossy[0]), *lossy[1].items(), *((i, lossy[0]) for i in G)):
                block = (change / omega)[:, None, None] * contact
                if i is None:
                    damping = damping + block
                else:
                    damps[i] = damps.get(i, 0.0) + block
        n_each = max((len(change) for change in damps.values()), default=1)
        rows, looks, changes = self._rows(at, vector, state)
        return Modal(
            eigenvalue=value,
            n_rigid=n_rigid,
            shape=vector,
            rows=rows,
            moves=moves,
            stiffness=stiffness[:, :n],
            mass=mass[:, :n],
            beyond=beyond,
            beyond_rows=self._gained(at, state)[:, None] * (self.rows[state] @ vectors[:, n:]),
            beyond_stiffness=stiffness[:, n:],
            beyond_mass=mass[:, n:],
            damping=damping,
            damps=np.array(sorted(damps), dtype=np.intp),
            damping_change=np.array([np.broadcast_to(damps[i], (n_each, n, n)) for i in sorted(damps)]).reshape(
                -1, n_each, n, n
            ),
            looks=np.array(looks, dtype=np.intp),
            row_change=np.array(changes).reshape(-1, *rows.shape),
            of_mode=of_mode,
            of_mode_moves=np.array(sorted(of_mode_change), dtype=np.intp),
            of_mode_change=np.array([of_mode_change[i] for i in sorted(of_mode_change)]),
        )

    def n_equation_at(self, x: Vector, state: int) -> int:
        """Return how many equations are looked at in a state at coordinates, those of what rides included."""
        theta = self.whole.theta(dict(zip(self.names, x.tolist(), strict=True)), state)[0]
        return self.whole.n_equation + self.whole.n_riding_within(theta)

    def _between(self, vectors: Vector, low: Vector) -> dict[str, Vector]:
        """Return the terms of K and M between all modes and those in equations, (n_part, size, n_equation)."""
        return {t: vectors.T @ (self.stacked[t] @ low) if self.of_target[t] else np.zeros(0) for t in "KM"}

    def solved(self, x: Vector, state: int) -> tuple[Vector, Vector, dict[str, Vector]]:
        """Return all eigenvalues and modes of the local equations at coordinates, and K, M and C."""
        at = dict(zip(self.names, x.tolist(), strict=True))
        matrix = self._matrices(at, self.whole.theta(at, state)[0], state)
        value, vectors = la.eigh(matrix["K"], matrix["M"], check_finite=False)
        return value, vectors, matrix

    def screen(self, x: Vector, state: int) -> StackScreen:
        """Return a state at a point with every term between the modes there."""
        return StackScreen(self, x, state)

    def _matrices(self, at: Mapping[str, float], theta: Mapping[str, float], state: int) -> dict[str, Vector]:
        """Return K, M and C of a state: dimensions from the nominal ones, locations from those of the first point."""
        moved = np.array([*(at[n] - self.first[n] for n in self.near), *(at[n] for n in self.sized)])
        matrices = {}
        for target in "KMC":
            total = self.fixed[target][state]
            if self.of_target[target]:
                factor = np.array([p.factor(theta) for p in self.of_target[target]])
                total = total + np.tensordot(factor, self.stacked[target], 1)
            if target != "C" and moved.size:
                total = total + np.tensordot(moved, self.linear[target][state], 1)
            matrices[target] = total
        return matrices

    def _columns(self, name: str, state: int) -> list[int]:
        """Return the coordinates by which a parameter of a state moves: the shared one and the state's."""
        assembled = self.whole.measured[state].assembled
        return [self.at[n] for n in (name, f"{name}[{assembled}]") if n in self.at]

    def _moves(
        self,
        theta: Mapping[str, float],
        slope: Mapping[str, float],
        state: int,
        vectors: Vector,
        low: Vector,
        between: Mapping[str, Vector],
    ) -> tuple[NDArray[np.intp], Vector, Vector]:
        """Return the coordinates that move K or M, and the derivatives between all modes and the lowest by these.

        As (q,), and for K and for M (q, size, n_equation).
        """
        columns = {n: self._columns(n, state) for n in self.far}
        linear = [self.at[n] for n in (*self.near, *self.sized)]
        moves = sorted({*linear, *(i for n in self._moved for i in columns[n])})
        row, derivatives = {i: k for k, i in enumerate(moves)}, list[Vector]()
        for target in ENERGIES:
            parts = self.of_target[target]
            weight = np.zeros((len(moves), len(parts)))
            for j, p in enumerate(parts):
                for name in p.names & self.moving:
                    rate = p.factor.derivative(theta, name) * slope[name]
                    for i in columns[name]:
                        weight[row[i], j] += rate
            change = np.zeros((len(moves), self.size, low.shape[1]))
            if parts:
                change += np.tensordot(weight, between[target], 1)
            if linear:
                change[[row[i] for i in linear]] += vectors.T @ (self.linear[target][state] @ low)
            derivatives.append(change)
        return np.array(moves, dtype=np.intp), derivatives[0], derivatives[1]

    def _losses(
        self, theta: Mapping[str, float], slope: Mapping[str, float], state: int, vector: Vector, matrix: Vector
    ) -> tuple[Vector, dict[int, Vector]]:
        """Return modal damping, one for each measured mode where it depends on frequency, and its derivatives."""
        parts = self.of_target["C"]
        damping, damps = (vector.T @ matrix @ vector)[None], dict[int, Vector]()
        if not parts:
            return damping, damps
        at_modes = self._at_modes(theta, state)
        for p, block in zip(parts, vector.T @ (self.stacked["C"] @ vector), strict=True):
            slow = OMEGA in p.names
            if slow:
                away = np.array([p.factor(t) for t in at_modes]) - p.factor(theta)
                damping = damping + away[:, None, None] * block
            for name in sorted(p.names & self.moving):
                rate = np.array([p.factor.derivative(t, name) for t in (at_modes if slow else [theta])]) * slope[name]
                for i in self._columns(name, state):
                    damps[i] = damps.get(i, 0.0) + rate[:, None, None] * block
        return damping, damps

    def _at_modes(self, theta: Mapping[str, float], state: int) -> list[dict[str, float]]:
        """Return the parameters at the frequency of each measured mode."""
        omega = 2.0 * np.pi * self.whole.measured[state].state.frequency
        return [{**theta, OMEGA: w} for w in omega.tolist()]

    def _of_mode(
        self, theta: Mapping[str, float], slope: Mapping[str, float], state: int, between: Mapping[str, Vector]
    ) -> tuple[Vector | None, dict[int, Vector]]:
        """Return the stiffness that each measured mode feels beside that at the middle frequency, and its derivatives.

        As (n_measured, n_equation, n_equation), None where nothing depends on frequency; derivatives by coordinate.
        """
        stiffness, changes = None, dict[int, Vector]()
        at_modes = self._at_modes(theta, state)
        for p, block in zip(self.of_target["K"], between["K"], strict=True):
            if OMEGA not in p.names:
                continue
            square = block[: block.shape[1]]
            away = np.array([p.factor(t) for t in at_modes]) - p.factor(theta)
            if np.any(away):
                change = away[:, None, None] * square
                stiffness = change if stiffness is None else stiffness + change
            for name in sorted(p.names & self.moving):
                here = p.factor.derivative(theta, name)
                rate = np.array([p.factor.derivative(t, name) for t in at_modes]) - here
                if np.any(rate):
                    for i in self._columns(name, state):
                        change = (rate * slope[name])[:, None, None] * square
                        changes[i] = changes[i] + change if i in changes else change
        return stiffness, changes

    def _slipping(
        self, at: Mapping[str, float], state: int, *, step: float = 1e-3
    ) -> tuple[tuple[Vector, dict[int, Vector]], tuple[Vector, dict[int, Vector]]] | None:
        """Return softening and loss factor of the contact by slip at each mode's strain, and derivatives by coordinate.

        None where slip is not in the fit or no amplitude is known.
        """
        slip, strain = self.whole.slip, self.whole.measured[state].strain
        if slip is None or slip.over_strain is None or strain is None:
            return None
        if not any(p.name in self.at for p in slip.parameters):
            return None

        def law(**moved: float) -> tuple[Vector, Vector]:
            values = {p.name: scaled(p, {**at, **moved}.get(p.name, 0.0))[0] for p in slip.parameters}
            softening, loss = slip.over_strain(values, strain)  # type: ignore[misc]
            return softening.mean(axis=1), loss.mean(axis=1)

        here = law()
        softer, lossy = dict[int, Vector](), dict[int, Vector]()
        for p in slip.parameters:
            there = law(**{p.name: at[p.name] + step})
            softer[self.at[p.name]], lossy[self.at[p.name]] = (
                (after - before) / step for before, after in zip(here, there, strict=True)
            )
        return (here[0], softer), (here[1], lossy)

    def _rows(self, at: Mapping[str, float], vector: Vector, state: int) -> tuple[Vector, list[int], list[Vector]]:
        """Return the modes at the sensors, with their gains, and the derivatives by gains and a shift of all points."""
        measured = self.whole.measured[state]
        rows, looks, changes = self.rows[state] @ vector, [], []
        gain = self._gained(at, state)
        slope = self.slopes[state] @ vector
        rows = rows + at.get(POINTS_SHIFT, 0.0) * slope
        rows = gain[:, None] * rows
        if POINTS_SHIFT in self.at:
            looks.append(self.at[POINTS_SHIFT])
            changes.append(gain[:, None] * slope)
        for i in range(self.whole.n_gain):
            looks.append(self.at[f"gain[sensor {i + 2}]"])
            changes.append((measured.sensor == i + 1)[:, None] * rows)
        return rows, looks, changes

    def _gained(self, at: Mapping[str, float], state: int) -> Vector:
        """Return the gain of the accelerometer that measured each component, (n_dof,)."""
        sensor = self.whole.measured[state].sensor
        gain = np.ones(sensor.size)
        for i in range(self.whole.n_gain):
            gain = np.where(sensor == i + 1, np.exp(at.get(f"gain[sensor {i + 2}]", 0.0)), gain)
        return gain
