"""A structure of matrices as the inference asks for it: coordinates, terms, and modal matrices near a point."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import cast

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from ema.types.frf import Geometry
from ema.types.modal_model import ModalModel
from model import Effect, MatricesError, MatrixStructure, Parameter, ReducedMatrices, reduce_matrices
from model.matrices.labelled import WHOLE
from model.matrices.readers import Target
from model.matrices.reduced import ObservedPoints, points_on
from updating.diagnosis.answer import Moved
from updating.diagnosis.evidence import (
    DECAY,
    FALL,
    GAIN,
    LABELS,
    PLACE,
    POINTS_SHIFT,
    SENSOR_GAIN,
    STATED_POINTS,
    WINDOW,
    DiagnosisScatter,
    Tested,
)
from updating.diagnosis.fit_settings import free_coordinate, scaled
from updating.diagnosis.matrices_candidates import DRIVE, candidates_of
from updating.diagnosis.stack_model import n_gain, state_of
from updating.errors import PairingError
from updating.inference.explain import Explanation
from updating.inference.protocol import FARTHEST, Change, Coordinate, Modal, Term

Vector = NDArray[np.float64]

_MOST_BASES = 6


class MatricesModel:
    """The model of one structure in all its states, from its reduced matrices.

    Parameters
    ----------
    structure : MatrixStructure
        The structure.
    tested : sequence of Tested
        The configurations.
    scatter : DiagnosisScatter
        Priors of nuisances.
    reduced : list of ReducedMatrices, optional
        What the structure was reduced to for the same points before; it grows as fits go far.
    above : float
        Modes are looked at up to this times the end of the measured band.

    Raises
    ------
    PairingError
        A measured point has no coordinates.
    MatricesError
        A point is not on the structure, or the structure cannot be reduced.
    """

    def __init__(
        self,
        structure: MatrixStructure,
        tested: Sequence[Tested],
        scatter: DiagnosisScatter,
        *,
        reduced: list[ReducedMatrices] | None = None,
        above: float = 1.2,
    ) -> None:
        spare = 4  # modes whose equations are looked at beside as many as were measured
        below = 0.3  # of the lowest measured frequency, below which a mode is motion of a rigid body
        self.scatter, self.tested = scatter, tuple(tested)
        every = [cast("ModalModel", one.modes) for one in tested]
        top = max(float(modes.frequency.max()) for modes in every)
        self.structure = _with_drive(replace(structure, band_Hz=max(structure.band_Hz, above * top)), every[0])
        self.observed = tuple(_placed(self.structure, modes.geometry, modes.node, modes.direction) for modes in every)
        self.damped = any(term.target == "C" for term in self.structure.terms)
        self.states = tuple(state_of(test, touching=self.damped) for test in self.tested)
        lowest = min(float(state.frequency.min()) for state in self.states)
        self.rigid = (2.0 * np.pi * below * lowest) ** 2
        self.n_gain = n_gain([modes.sensor for modes in every])
        point = _every_way(self.structure, every[0])
        self.candidates = candidates_of(
            self.structure, lambda reduced: point.rows(reduced)[0], len(point.node) // 3, lowest
        )
        self.effects: dict[str, Effect] = {name: candidate.effect for name, candidate in self.candidates.items()}
        self.parameters: dict[str, Parameter] = {name: effect.parameters[0] for name, effect in self.effects.items()}
        self._known_to_hold: list[Vector] = []  # factors at which a basis, and so each wider one, is exact enough
        self._reduced = [] if reduced is None else reduced
        if not self._reduced:
            self._reduced.append(reduce_matrices(self.structure))
        frequency = self.reduced.solve()[0]
        most = max(state.frequency.size for state in self.states)
        rigid = int(np.count_nonzero(frequency < np.sqrt(self.rigid) / (2.0 * np.pi)))
        self.n_equation = min(
            max(int(np.count_nonzero(frequency < above * top)), rigid + most + spare), self.reduced.size
        )
        self._parts: tuple[int, list[tuple[Target, str, Vector]]] = (0, [])

    @property
    def bases(self) -> list[ReducedMatrices]:
        """What the structure was reduced to so far, for other tests of it at the same points."""
        return self._reduced

    @property
    def reduced(self) -> ReducedMatrices:
        """The structure on the widest basis so far."""
        return self._reduced[-1]

    @cached_property
    def factors(self) -> dict[str, float]:
        """Nominal factors of the terms that the base model has, and 1 of what no term has."""
        stated = {one.name: one.nominal for one in self.structure.factors if one.nominal != 0.0}
        fixed = {
            WHOLE[term.target]: 1.0
            for term in self.structure.terms
            if term.factor is None and term.matrix.count_nonzero()
        }
        return {**fixed, **stated}

    @property
    def nuisances(self) -> tuple[Coordinate, ...]:
        """Coordinates of the base model."""
        loss = 1.0  # standard deviation of the logarithm of that of damping, which models rarely know
        s = self.scatter
        known = {"stiffness": s.young, "mass": s.density, "damping": loss}
        stated = {one.name: one for one in self.structure.factors}
        found = []
        for name in self.factors:
            if name in stated:
                one = stated[name]
                low, high = (self._coordinate(name, end) for end in (one.lower, one.upper))
                far = FARTHEST * one.std
                found.append(
                    Coordinate(
                        name=name, std=one.std, lower=max(low, -far), upper=min(high, far), step=min(one.std, 0.3),
                        longest=1.0,
                    )
                )  # fmt: skip
            else:
                found.append(_known(name, known[name], known[name]))
        found += [_known(f"gain[sensor {i + 2}]", s.gain, 0.01) for i in range(self.n_gain)]
        if any(np.any(points.slope) for points in self.observed) and np.ptp(self.structure.location[:, 0]) > 0.0:
            found.append(_known(POINTS_SHIFT, s.points_shift, 1e-3))
        if self.damped:
            found.append(_known(DECAY, 1e-3, 1e-3))
        return tuple(found)

    @property
    def terms(self) -> dict[str, Term]:
        """What the structure may lack, and what may be wrong with its file or the measurement."""
        return {
            **{n: Term(name=n, coordinates=(free_coordinate(p),)) for n, p in self.parameters.items()},
            **{n: Term(name=n, frees=frees) for n, frees in self.hypotheses.items()},
        }

    @property
    def hypotheses(self) -> dict[str, dict[str, float]]:
        """What may have been stated or measured wrongly: of each, the nuisances whose prior it widens."""
        stated = 5.0  # times its standard deviation is that of what may be stated wrongly
        found = {
            f"stated_{c.name}": {c.name: stated * c.std}
            for c in self.nuisances
            if c.name in self.factors and c.name != WHOLE["C"] and not self._bounded(c.name)
        }
        names = [c.name for c in self.nuisances]
        for name, which, std in (
            (SENSOR_GAIN, "gain[", GAIN), (STATED_POINTS, POINTS_SHIFT, PLACE), (WINDOW, DECAY, FALL),
        ):  # fmt: skip
            if widened := {c: std for c in names if c.startswith(which)}:
                found[name] = widened
        return found

    def _bounded(self, name: str) -> bool:
        """Tell whether the file says the ends of a factor: then nothing is beyond them."""
        return any(one.name == name and np.isfinite(one.upper) for one in self.structure.factors)

    @property
    def labels(self) -> dict[str, str]:
        """What a person calls each effect and hypothesis."""
        stated = {f"stated_{name}": f"{name.replace('_', ' ')} stated wrongly" for name in self.factors}
        every = {**LABELS, **stated}
        return {n: e.label for n, e in self.effects.items()} | {n: every[n] for n in self.hypotheses}

    def unit(self, nuisance: str) -> str:
        """Return the unit of a nuisance: m of locations, 1/s of a decay, 1 of a factor."""
        return "m" if nuisance == POINTS_SHIFT else "1/s" if nuisance == DECAY else "1"

    def _linear(self, name: str) -> bool:
        return any(one.name == name and one.scale == "lin" for one in self.structure.factors)

    def _coordinate(self, name: str, value: float) -> float:
        nominal = self.factors[name]
        if self._linear(name):
            return value - nominal
        return float(np.log(value / nominal)) if value > 0.0 else -np.inf

    def value(self, name: str, x: float) -> tuple[float, float]:
        """Return a factor, or the strength of an effect, at a coordinate, and its derivative by that."""
        if name in self.parameters:
            return scaled(self.parameters[name], x)
        nominal = self.factors[name]
        if self._linear(name):
            return nominal + x, 1.0
        return float(nominal * np.exp(x)), float(nominal * np.exp(x))

    def moved(self, explanation: Explanation) -> tuple[Moved, ...]:
        """Return every quantity that all fits may move, as stated and as an explanation was fitted with it."""
        found = []
        for c, x, std in list(zip(explanation.coordinates, explanation.x, explanation.std, strict=True))[
            : explanation.n_nuisance
        ]:
            gain = c.name.startswith("gain[")
            if c.name in self.factors:
                stated, (value, slope) = self.factors[c.name], self.value(c.name, float(x))
            else:
                stated = 1.0 if gain else 0.0
                value, slope = (float(np.exp(x)), float(np.exp(x))) if gain else (float(x), 1.0)
            label = f"gain of {c.name[5:-1]} over that of sensor 1" if gain else _LABELS.get(c.name, c.name)
            prior = self.value(c.name, 0.0)[1] * c.std if c.name in self.factors else c.std
            found.append(
                Moved(
                    name=c.name, label=label, unit=self.unit(c.name), stated=stated, value=value,
                    std=float(slope * std), prior=float(prior), deviations=float(x / c.std),
                )
            )  # fmt: skip
        return tuple(found)

    def about(self, coordinates: Sequence[Coordinate], points: Sequence[Vector]) -> MatricesNear:
        """Return the model near some points; where the basis errs there, the structure is reduced there, too."""
        stated = [one.name for one in self.structure.factors]
        for x in points:
            at = {
                c.name: self.value(c.name, float(v))[0] for c, v in zip(coordinates, x, strict=True) if c.name in stated
            }
            if len(self._reduced) < _MOST_BASES and not self._holds(at):
                self._reduced.append(reduce_matrices(self.structure, at, beside=self.reduced))
        return MatricesNear(self, coordinates)

    def _holds(self, at: Mapping[str, float]) -> bool:
        """Tell whether the basis is exact enough at some factors, or hardly elsewhere, where that is known."""
        close = 0.02  # of each factor, within which the error is that of a known point: it grows with the cube
        exact = 1e-4  # relative error of a frequency from which the structure is reduced anew
        factors = np.array([at.get(one.name, one.nominal) for one in self.structure.factors])
        if not any(np.all(np.abs(factors - known) <= close * np.abs(known)) for known in self._known_to_hold):
            if self.reduced.error(at) > exact:
                return False
            self._known_to_hold.append(factors)
        return True

    def parts(self) -> list[tuple[Target, str, Vector]]:
        """Return what the matrices are the sum of: target, what it is multiplied by, and matrix."""
        if self._parts[0] != len(self._reduced):
            parts: list[tuple[Target, str, Vector]] = []
            for term in self.reduced.terms:
                name = next(iter(term.factor.names({})), WHOLE[term.target])
                if name in self.factors:
                    parts.append((term.target, name, np.asarray(term.matrix)))
            for name, one in self.candidates.items():
                parts += [(target, name, matrix) for target, matrix in one.parts(self.reduced).items()]
            self._parts = len(self._reduced), parts
        return self._parts[1]


_LABELS = {
    "stiffness": "stiffness of what no term has",
    "mass": "mass of what no term has",
    "damping": "damping of what no term has",
    POINTS_SHIFT: "shift of all points along x",
    DECAY: "added decay of all modes",
}


def _known(name: str, std: float, step: float) -> Coordinate:
    return Coordinate(name=name, std=std, lower=-FARTHEST * std, upper=FARTHEST * std, step=step)


def _placed(
    structure: MatrixStructure, geometry: Geometry, node: NDArray[np.int64], direction: Vector
) -> ObservedPoints:
    """Place measured components on a structure.

    Raises
    ------
    PairingError
        A point has no coordinates, or is on no place of the structure.
    """
    row = {int(n): i for i, n in enumerate(geometry.node)}
    unknown = sorted({int(n) for n in node} - set(row))
    if unknown:
        raise PairingError(f"points {unknown} were measured but have no coordinates; add them to the points file")
    location = geometry.coordinate[[row[int(n)] for n in node]]
    try:
        return points_on(structure, node, location, direction)
    except MatricesError as error:
        raise PairingError(str(error)) from error


def _every_way(structure: MatrixStructure, modes: ModalModel) -> ObservedPoints:
    """Return the measured points, each along x, y and z."""
    node = np.unique(modes.node)
    return _placed(structure, modes.geometry, np.repeat(node, 3), np.tile(np.eye(3), (node.size, 1)))


def _with_drive(structure: MatrixStructure, modes: ModalModel) -> MatrixStructure:
    """Return a structure with the node nearest to the force as a patch, where the points say where that is."""
    if not np.isin(modes.input.node, modes.geometry.node).all():
        return structure
    placed = _placed(structure, modes.geometry, modes.input.node[:1], modes.input.direction[:1])
    groups = {**structure.groups, DRIVE: placed.node[0, :1]}
    return replace(structure, groups=groups, patches=(*structure.patches, DRIVE))


class MatricesNear:
    """The equations of a structure on the basis of now, for some coordinates.

    Parameters
    ----------
    whole : MatricesModel
        The model.
    coordinates : sequence of Coordinate
        Those of the fit.
    """

    def __init__(self, whole: MatricesModel, coordinates: Sequence[Coordinate]) -> None:
        self.whole, self.names = whole, [c.name for c in coordinates]
        self.at = {name: i for i, name in enumerate(self.names)}
        self.reduced = whole.reduced
        mass = self.reduced.matrix("M", self.reduced.theta)
        value, vector = la.eigh(mass)
        kept = value > 1e-12 * value[-1]
        self.basis = vector[:, kept] / np.sqrt(value[kept])  # in which the nominal mass is the identity
        self.n_equation = min(whole.n_equation, self.basis.shape[1])
        self.rows = [points.rows(self.reduced) for points in whole.observed]
        acting = [(t, n, m) for t, n, m in whole.parts() if n in self.at or n in whole.factors]
        self.acting = {
            target: (
                [n for t, n, _ in acting if t == target],
                np.array([self.basis.T @ m @ self.basis for t, _, m in acting if t == target]),
            )
            for target in WHOLE
        }

    def of(self, coordinates: Sequence[Coordinate]) -> MatricesNear:
        """Return the same for some of the coordinates; the others stay where they are neutral."""
        return MatricesNear(self.whole, coordinates)

    def screen(self, x: Vector, state: int) -> MatricesScreen:
        """Return a state at a point with every term between the modes there."""
        return MatricesScreen(self, x, state)

    def modal(self, x: Vector, state: int) -> Modal:
        """Return the model of a state at coordinates; raises numpy.linalg.LinAlgError where mass is not positive."""
        whole, at = self.whole, dict(zip(self.names, x.tolist(), strict=True))
        theta, size, m = self.theta(x), self.basis.shape[1], self.n_equation
        value, every, matrix = self.solved(x)
        vector, beyond, low = every[:, :m], value[m:], value[:m].copy()
        n_rigid = int(np.count_nonzero(low < whole.rigid))
        low[:n_rigid] = 0.0
        moves: dict[int, Vector] = {}
        for which, (names, stacked) in enumerate((self.acting["K"], self.acting["M"])):
            for name, part in zip(names, stacked, strict=True):
                if name in self.at:
                    change = moves.setdefault(self.at[name], np.zeros((2, size, m)))
                    change[which] += theta[name][1] * (every.T @ (part @ vector))
        damping, damps = (vector.T @ matrix["C"] @ vector)[None], dict[int, Vector]()
        for name, part in zip(*self.acting["C"], strict=True):
            if name in self.at:
                damps[self.at[name]] = theta[name][1] * (vector.T @ part @ vector)[None]
        if DECAY in self.at:
            inertia = vector.T @ matrix["M"] @ vector
            damping = damping + 2.0 * at[DECAY] * inertia
            damps[self.at[DECAY]] = 2.0 * inertia[None]
        rows, look = self._rows(at, every, state)
        stiffness, mass = (np.array([moves[i][which] for i in sorted(moves)]).reshape(-1, size, m) for which in (0, 1))
        return Modal(
            eigenvalue=low,
            n_rigid=n_rigid,
            shape=vector,
            rows=rows[:, :m],
            moves=np.array(sorted(moves), dtype=np.intp),
            stiffness=stiffness[:, :m],
            mass=mass[:, :m],
            beyond=beyond,
            beyond_rows=rows[:, m:],
            beyond_stiffness=stiffness[:, m:],
            beyond_mass=mass[:, m:],
            damping=damping,
            damps=np.array(sorted(damps), dtype=np.intp),
            damping_change=np.array([damps[i] for i in sorted(damps)]).reshape(-1, 1, m, m),
            looks=np.array(sorted(look), dtype=np.intp),
            row_change=np.array([look[i][:, :m] for i in sorted(look)]).reshape(-1, len(rows), m),
        )

    def theta(self, x: Vector) -> dict[str, tuple[float, float]]:
        """Return what each part is multiplied by at coordinates, and its derivative."""
        at = dict(zip(self.names, x.tolist(), strict=True))
        every = {n for names, _ in self.acting.values() for n in names}
        return {n: self.whole.value(n, at.get(n, 0.0)) for n in every}

    def solved(self, x: Vector) -> tuple[Vector, Vector, dict[Target, Vector]]:
        """Return all eigenvalues and modes at coordinates, and K, M and C."""
        theta, size = self.theta(x), self.basis.shape[1]
        matrix: dict[Target, Vector] = {t: np.zeros((size, size)) for t in WHOLE}
        for target, (names, stacked) in self.acting.items():
            if names:
                matrix[target] = np.tensordot([theta[n][0] for n in names], stacked, 1)
        value, every = la.eigh(matrix["K"], matrix["M"], check_finite=False)
        return value, every, matrix

    def _rows(self, at: Mapping[str, float], every: Vector, state: int) -> tuple[Vector, dict[int, Vector]]:
        """Return all modes at the sensors, with their gains, and derivatives by gains and a shift of all points."""
        sensor = self.whole.tested[state].modes.sensor
        gains = [f"gain[sensor {i}]" for i in range(2, self.whole.n_gain + 2)]
        gain = np.exp([0.0, *(at.get(name, 0.0) for name in gains)])[np.minimum(sensor, len(gains))]
        gain = np.where(sensor <= len(gains), gain, 1.0)
        rows, slope = (gain[:, None] * (points @ self.basis @ every) for points in self.rows[state])
        rows = rows + at.get(POINTS_SHIFT, 0.0) * slope
        look = {self.at[n]: (sensor == i)[:, None] * rows for i, n in enumerate(gains, 1) if n in self.at}
        if POINTS_SHIFT in self.at:
            look[self.at[POINTS_SHIFT]] = slope
        return rows, look


class MatricesScreen:
    """A state at one point, with every term between the modes there; see `Screen`."""

    def __init__(self, near: MatricesNear, x: Vector, state: int) -> None:
        self.near, self.x, self.modal = near, x, near.modal(x, state)
        every, m = near.solved(x)[1], near.n_equation
        self._block: dict[Target, Vector] = {}
        self._beyond: dict[Target, Vector] = {}
        for target, (names, stacked) in near.acting.items():
            turned = stacked @ every if names else np.zeros((0, *every.shape))
            low = every if target != "C" else every[:, :m]
            self._block[target] = low.T @ turned[:, :, :m]
            self._beyond[target] = np.einsum("ib,pib->pb", every[:, m:], turned[:, :, m:])

    def change(self, x: Vector) -> Change:
        """Return what the coordinates that differ at `x` change."""
        near = self.near
        here, there = near.theta(self.x), near.theta(x)
        acting = {n for names, _ in near.acting.values() for n in names}
        moved = [i for i in np.flatnonzero(x != self.x).tolist() if near.names[i] in acting]

        def summed(target: Target, blocks: Vector) -> tuple[Vector, Vector]:
            names = near.acting[target][0]
            step = np.array([there[n][0] - here[n][0] for n in names])
            rate = np.array([[there[n][1] * (near.at.get(n) == i) for n in names] for i in moved])
            by = np.tensordot(rate.reshape(len(moved), len(names)), blocks, 1)
            return np.tensordot(step, blocks, 1)[None], by[:, None]

        return Change(
            moved=np.array(moved, dtype=np.intp),
            stiffness=summed("K", self._block["K"]),
            mass=summed("M", self._block["M"]),
            damping=summed("C", self._block["C"]),
            stiffness_beyond=summed("K", self._beyond["K"]),
            mass_beyond=summed("M", self._beyond["M"]),
        )
