"""Equations near a point: the state that is looked at, the basis of modes and responses, and a screening of effects."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from model import Effect, Parameter, ReducedEquations
from model.elements.equations import OMEGA, Target
from model.reduction.reduced_equations import InRange, Matrix, ReducedTerm, summed
from updating.diagnosis.candidates import CandidateModel
from updating.inference.protocol import Change, Coordinate, Modal, State

Vector = NDArray[np.float64]

N_FURTHER = 13
"""Modes about a point that a local basis holds beyond those whose equations are looked at, beside the static responses
of these."""
RESPONSE = 1e-2
"""Share of a mode's energy, as an amplitude, from which a response counts: 1e-2 leaves 1e-5 of a frequency nearby."""


def times(matrix: Matrix, x: Vector) -> Vector:
    """Return the product of a matrix, in full or of low rank, with vectors."""
    if isinstance(matrix, InRange):
        return np.asarray(matrix.range @ (matrix.core @ (matrix.range.T @ x)))
    return np.asarray(matrix @ x)


def gathered(n: int, parts: Iterable[tuple[float, Matrix]]) -> list[Matrix]:
    """Return the sum of factors times matrices, (n, n), as few matrices: those of one range are one."""
    full, between = list[tuple[float, Vector]](), dict[int, InRange]()
    for factor, matrix in parts:
        if not isinstance(matrix, InRange):
            full.append((factor, matrix))
            continue
        core = factor * matrix.core
        shared = between.get(id(matrix.range))
        between[id(matrix.range)] = replace(matrix, core=core if shared is None else shared.core + core)
    return [*between.values(), *([summed(n, full)] if full else [])]


def distinct(forces: Mapping[int, Vector], *, same: float = 1e-6) -> list[Vector]:
    """Return as few forces as have the same sum of squares as those of a coordinate, at its point and elsewhere.

    Those that differ by a factor only from the force at the point, number 0, count once.
    """
    first = forces.get(0)
    kept = [f.ravel() for i, f in forces.items() if i == 0 or first is None or not _parallel(f, first, same)]
    if len(kept) == 1:
        return [next(iter(forces.values()))]
    rows = np.array(kept)
    square, mixture = la.eigh(rows @ rows.T)
    shape = next(iter(forces.values())).shape
    return [row.reshape(shape) for row in mixture[:, square > same**2 * square[-1]].T @ rows]


def _parallel(first: Vector, second: Vector, same: float) -> bool:
    return abs(np.vdot(first, second)) > (1.0 - same) * np.linalg.norm(first) * np.linalg.norm(second)


def leading(gram: Vector, energy: Vector, mass: Vector) -> Vector:
    """Return a basis of the leading combinations of some vectors.

    Parameters
    ----------
    gram : (n, n) float
        Sum of their squares, each vector times the transpose of `energy`: of modes, scaled to an energy of 1 and more,
        and of responses to steps of coordinates. Squares hold eight digits of a size, more than `RESPONSE` asks for.
    energy : (n, n) float
        Lower Cholesky factor of the matrix that measures energy.
    mass : (n, n) float
        The mass, for which the basis is orthonormal.

    Returns
    -------
    (n, m) float
        The basis, the strongest combinations first.
    """
    _, direction = la.eigh(gram, subset_by_value=(RESPONSE**2, np.inf), check_finite=False)
    basis = la.solve_triangular(energy.T, direction[:, ::-1], check_finite=False)
    root = la.cholesky(basis.T @ mass @ basis, lower=True)
    return np.asarray(la.solve_triangular(root, basis.T, lower=True).T)


MODES = ""
"""The coordinate of vectors that answer to none."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Responses:
    """The vectors that a basis was chosen from: modes, and responses to steps of coordinates.

    Attributes
    ----------
    weighed : (size, n) float
        In the basis, weighed so that their squares are energies.
    of : (n,) str
        The coordinate of which each is a response.
    number : (n,) int
        The mode that it is, or that responds, from 0 at each point.
    energy : (size, size) float
        Lower Cholesky factor of the matrix that measures energy.
    """

    weighed: Vector
    of: NDArray[np.str_]
    number: NDArray[np.intp]
    energy: Vector
    _grams: dict[tuple[str, int], Vector] = field(default_factory=dict, repr=False)

    def _gram(self, name: str, n: int) -> Vector:
        """Return the sum of squares of the vectors of a coordinate that belong to the lowest modes, (size, size)."""
        if (name, n) not in self._grams:
            vectors = self.weighed[:, (self.of == name) & (self.number < n)]
            self._grams[name, n] = vectors @ vectors.T
        return self._grams[name, n]

    def basis(self, coordinates: Sequence[Coordinate], at: Mapping[str, float], n_equation: int) -> Vector:
        """Return an orthonormal basis, (size, m), for some of the coordinates.

        Responses to a coordinate that was neutral where the vectors were made are scaled to its starts. Only the
        `n_equation` lowest modes respond.
        """
        total = self._gram(MODES, n_equation + N_FURTHER).copy()
        for c in coordinates:
            far = max(map(abs, c.starts)) / c.step if len(c.starts) > 1 and at[c.name] == 0.0 else 1.0
            total += max(far, 1.0) ** 2 * self._gram(c.name, n_equation)
        return leading(total, self.energy, np.eye(len(total)))


@dataclass(frozen=True, eq=False, kw_only=True)
class StackState:
    """One state of a stack: what it knows of itself, and the measurement.

    Attributes
    ----------
    state : State
        The measured modes.
    parameter : mapping of str to float
        Values that the state sets, pressure among them.
    assembled : str
        What was put together once: all its force levels share this name.
    rows : (n_dof, n_basis) float
        Measured points.
    slope : (n_dof, n_basis) float
        How these change as all points move along x, 1/m.
    sensor : (n_dof,) int
        The accelerometer that measured each shape component, from 0.
    strain : (n_mode, n_share) float, optional
        Strains of equal parts of the contact's energy in resonance of each mode, where amplitudes are known.
    """

    state: State
    parameter: Mapping[str, float]
    assembled: str
    rows: Vector
    slope: Vector
    sensor: NDArray[np.int64]
    strain: Vector | None = None


class Whole(Protocol):
    """What the equations near a point need of the model of a stack, `StackModel`."""

    equations: ReducedEquations
    candidates: CandidateModel
    measured: tuple[StackState, ...]
    clamp_locations: tuple[str, ...]
    dimensions: tuple[str, ...]
    n_gain: int
    n_equation: int
    rigid: float
    slip: Effect | None

    @property
    def parameters(self) -> Mapping[str, Parameter]:
        """Parameters of all effects by name."""

    def theta(self, at: Mapping[str, float], state: int) -> tuple[dict[str, float], dict[str, float]]:
        """Return the model's parameters in a state at coordinates by name, and their derivatives by coordinates."""

    def n_riding(self, names: Collection[str]) -> int:
        """Return how many modes what rides on the structure has, where coordinates let it."""

    def n_riding_within(self, theta: Mapping[str, float]) -> int:
        """Return how many of these lie where equations are looked at, at parameters of the model."""

    def finer_mesh(self, theta: Mapping[str, float]) -> tuple[Vector | None, Vector]:
        """Return what a finer mesh adds to the stiffness between the modes of the plain stack, and M times these."""

    def dimension(self, name: str, theta: Mapping[str, float]) -> dict[str, Vector]:
        """Return the derivatives of K and M by the logarithm of a dimension."""

    def acting(
        self, thetas: Sequence[Mapping[str, float]], moving: frozenset[str]
    ) -> list[tuple[ReducedTerm, frozenset[str]]]:
        """Return the terms that do not vanish while some parameters move, with what of these each depends on."""


ENERGIES: tuple[Target, ...] = ("K", "M")
TARGETS: tuple[Target, ...] = (*ENERGIES, "C")


class Near(Protocol):
    """What a screen needs of the equations near a point, `StackNear`."""

    names: list[str]
    at: dict[str, int]
    moving: frozenset[str]
    of_target: dict[str, Any]
    stacked: dict[str, Any]
    size: int
    whole: Any

    def modal(self, x: Vector, state: int, solved: tuple[Vector, Vector, dict[str, Vector]] | None = None) -> Modal:
        """Return the model of a state at coordinates; `solved` is what that returns there, where it is known."""

    def solved(self, x: Vector, state: int) -> tuple[Vector, Vector, dict[str, Vector]]:
        """Return all eigenvalues and modes of the local equations at coordinates, and K, M and C."""


class StackScreen:
    """A state of a local model at one point, with every term between the modes there.

    Parameters
    ----------
    near : Near
        The local model, with the coordinates of all terms.
    x : (n_coordinate,) float
        The point.
    state : int
        Which state.

    Raises
    ------
    numpy.linalg.LinAlgError
        The model has no modes there.
    """

    def __init__(self, near: Near, x: Vector, state: int) -> None:
        self.near, self.x, self.state = near, x, state
        solved = near.solved(x, state)
        self.modal, vectors = near.modal(x, state, solved), solved[1]
        m = self._n = self.modal.eigenvalue.size
        self._blocks, self._beyond = dict[str, Vector](), dict[str, Vector]()
        for t in "KMC":
            if near.of_target[t]:
                whole = near.stacked[t] @ (vectors if t != "C" else vectors[:, :m])
                self._blocks[t] = (vectors if t != "C" else vectors[:, :m]).T @ whole[:, :, :m]
                if t != "C":
                    self._beyond[t] = np.einsum("ib,pib->pb", vectors[:, m:], whole[:, :, m:])
        self._here = near.whole.theta(dict(zip(near.names, x.tolist(), strict=True)), state)[0]
        self._factors: dict[int, Vector] = {}
        self._by_name: dict[tuple[str, Target], list[int]] = {}
        for t in TARGETS:
            for i, p in enumerate(near.of_target[t]):
                for name in p.names:
                    self._by_name.setdefault((name, t), []).append(i)
        slip = near.whole.slip
        slips = slip is not None and near.whole.measured[state].strain is not None
        self._slips = {near.at[p.name] for p in slip.parameters if p.name in near.at} if slip and slips else set()

    def _factor(self, part: Any, slow: bool) -> Vector:
        """Return the factor of a part at the point; at the frequency of each measured mode where it depends on that."""
        if id(part) not in self._factors:
            omega = 2.0 * np.pi * self.near.whole.measured[self.state].state.frequency
            points = [{**self._here, OMEGA: w} for w in omega.tolist()] if slow else [self._here]
            self._factors[id(part)] = np.array([part.factor(at) for at in points])
        return self._factors[id(part)]

    def change(self, x: Vector) -> Change | None:
        """Return what the coordinates that differ at `x` change; None where that depends on amplitudes."""
        near = self.near
        moved = [i for i in np.flatnonzero(x != self.x).tolist() if near.names[i] in near.moving]
        if self._slips.intersection(moved):
            return None
        names = frozenset(near.names[i] for i in moved)
        nothing = frozenset(near.names[i] for i in np.flatnonzero((x == 0.0) & (self.x == 0.0)).tolist())
        theta, slope = near.whole.theta(dict(zip(near.names, x.tolist(), strict=True)), self.state)
        omega = 2.0 * np.pi * near.whole.measured[self.state].state.frequency

        at_modes = [{**theta, OMEGA: w} for w in omega.tolist()]

        def summed(target: Target, *blocks: Vector) -> list[tuple[Vector, Vector]]:
            """Return the sums over terms of what changes, and derivatives, last axes as those of each of `blocks`."""
            of_target = near.of_target[target]
            acting = sorted({i for name in names for i in self._by_name.get((name, target), ())})
            acting = [i for i in acting if not of_target[i].needs & nothing]
            parts = [of_target[i] for i in acting]
            slow = [OMEGA in p.names for p in parts]
            n = len(at_modes) if any(slow) else 1
            weight = np.zeros((1 + len(moved), n, len(parts)))  # of each part, and its derivatives
            for i, (p, depends_on_omega) in enumerate(zip(parts, slow, strict=True)):
                points, here = at_modes if depends_on_omega else [theta], self._factor(p, depends_on_omega)
                weight[0, :, i] = [p.factor(at) for at in points] - here
                for k, name in enumerate(near.names[j] for j in moved):
                    if name in p.names:
                        weight[1 + k, :, i] = [p.factor.derivative(at, name) * slope[name] for at in points]
            sums = [np.tensordot(weight, block[acting], 1) for block in blocks]
            return [(block[0], block[1:]) for block in sums]

        none = np.zeros((0, near.size, self._n))
        (stiffness, far), (mass, heavy) = (
            summed(t, self._blocks.get(t, none), self._beyond.get(t, none[:, self._n :, 0])) for t in ENERGIES
        )
        (damping,) = summed("C", self._blocks.get("C", none[:, : self._n]))
        return Change(
            moved=np.array(moved, dtype=np.intp),
            stiffness=stiffness,
            mass=mass,
            damping=damping,
            stiffness_beyond=far,
            mass_beyond=heavy,
        )
