"""A stack's reduced equations as the inference asks for them: coordinates, terms, and modal matrices near a point."""

from __future__ import annotations

from collections.abc import Collection, Hashable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from model import Effect, Observation, Parameter, ReducedEquations, ReducedSystem, observe, shared_parameters
from model.elements.equations import OMEGA
from model.reduction.reduced_equations import ReducedTerm, full, generic
from model.reduction.riding import RidingPart
from updating.diagnosis.answer import Moved
from updating.diagnosis.candidates import DIMENSIONS, G_F_RANGE, CandidateModel, FinerMesh
from updating.diagnosis.evidence import (
    D_F_START,
    DECAY,
    FALL,
    GAIN,
    LABELS,
    PLACE,
    POINTS_SHIFT,
    PRESSURE,
    SENSOR_GAIN,
    SIZE,
    STATED_PLACE,
    STATED_POINTS,
    STATED_PRESSURE,
    STATED_SIZE,
    WINDOW,
    DiagnosisScatter,
    Tested,
    unit_shape,
)
from updating.diagnosis.fit_settings import FitSettings, scaled
from updating.diagnosis.local_basis import ENERGIES, StackState
from updating.diagnosis.moved import moved
from updating.diagnosis.slipping import slip_effect
from updating.diagnosis.stack_near import RATIOS, RIGID, StackNear
from updating.inference.explain import Explanation
from updating.inference.protocol import FARTHEST, Coordinate, State, Term

Vector = NDArray[np.float64]

_BELOW = 0.3  # of the lowest measured frequency, for what is held may have modes as low as rigid-body motion has
_LIKE = 0.05  # of the logarithm of contact stiffness and pressure, within which one answer does


class StackModel:
    """The model of one stack in all its states, from reduced equations with all effects.

    Parameters
    ----------
    candidates : CandidateModel
        The reduced model with all effects that the stack can have.
    tested : sequence of Tested
        The configurations.
    observation : sequence of Observation
        The measured points of each.
    scatter : DiagnosisScatter
        Priors of nuisances.
    effects : mapping of str to Effect, optional
        Candidates; all of `candidates` by default.
    start : float
        Logarithm of G_f over the stack file's, about which the model is near the measurement.
    n_equation : int, optional
        Modes, rigid ones included, whose equations are looked at; by default those to `above` times the band's end.
        Those near the end of a list turn with the modes beyond it, and the derivative by a weak parameter has the wrong
        sign with more.
    above : float
        See `n_equation`.
    like : StackModel, optional
        Another model of the same stack and equations, whose points and finer mesh need not be computed again.
    settings : FitSettings
        What is known of parameters beforehand.
    """

    def __init__(
        self,
        candidates: CandidateModel,
        tested: Sequence[Tested],
        observation: Sequence[Observation],
        scatter: DiagnosisScatter,
        effects: Mapping[str, Effect] | None = None,
        *,
        start: float = 0.0,
        n_equation: int | None = None,
        above: float = 1.2,
        like: StackModel | None = None,
        settings: FitSettings = FitSettings(),  # noqa: B008  # it is frozen
    ) -> None:
        self.candidates, self.equations = candidates, candidates.system.equations
        self.stack, self.scatter, self.settings = candidates.stack, scatter, settings
        self.effects = dict(candidates.effects if effects is None else effects)
        self.tested, self.observation, self.start = tuple(tested), tuple(observation), start
        self.slip = slip_effect(self.effects)
        self._seen: dict[Observation, tuple[Vector, Vector]] = {} if like is None else like._seen
        self.measured = tuple(
            StackState(
                state=state_of(configuration, touching=self.stack.n_lamina > 1),
                parameter={"pressure": configuration.pressure, **configuration.known},
                assembled=configuration.assembled,
                rows=self._rows(points)[0],
                slope=self._rows(points)[1],
                sensor=configuration.modes.sensor,
                strain=configuration.strain,
            )
            for configuration, points in zip(tested, observation, strict=True)
        )
        self.states = tuple(measured.state for measured in self.measured)
        lowest = min(float(state.frequency.min()) for state in self.states)
        self.rigid = min(RIGID, (2.0 * np.pi * _BELOW * lowest) ** 2)
        self.n_gain = n_gain([measured.sensor for measured in self.measured])
        self.dimensions = tuple(candidates.resized)
        self.clamp_locations = candidates.clamp_locations
        everywhere = {**self.equations.theta, OMEGA: 2.0 * np.pi * _MIDDLE}
        self._names = [frozenset(t.factor.names(generic(everywhere, everywhere))) for t in self.equations.terms]
        self._top = (2.0 * np.pi * above * max(float(state.frequency.max()) for state in self.states)) ** 2
        self.n_equation = n_equation or self._within()
        self._near: dict[tuple[Hashable, ...], StackNear] = {}
        self.mesh: FinerMesh = FinerMesh(candidates) if like is None else like.mesh
        self._finer: dict[tuple[int, ...], tuple[Vector | None, Vector]] = {} if like is None else like._finer
        self._resized: dict[tuple[str, tuple[int, ...]], dict[str, Vector]] = {} if like is None else like._resized

    def _rows(self, points: Observation) -> tuple[Vector, Vector]:
        """Return the rows of measured points, (n_dof, n_basis), and how they change as all move along x."""
        if points not in self._seen:
            rows = observe(self.candidates.system, points).reduced_rows
            self._seen[points] = rows, location_slopes(self.candidates.system, points)[:, 0]
        return self._seen[points]

    def of_tests(self, tested: Sequence[Tested], observation: Sequence[Observation]) -> StackModel:
        """Return the model of the same stack in other tests, the same equations being looked at."""
        return StackModel(
            self.candidates,
            tested,
            observation,
            self.scatter,
            self.effects,
            start=self.start,
            n_equation=self.n_equation,
            like=self,
            settings=self.settings,
        )

    def with_effects(self, effects: Mapping[str, Effect], settings: FitSettings | None = None) -> StackModel:
        """Return the same model with other candidates and, where it is given, other knowledge of parameters."""
        return StackModel(
            self.candidates,
            self.tested,
            self.observation,
            self.scatter,
            effects,
            start=self.start,
            n_equation=self.n_equation,
            like=self,
            settings=settings or self.settings,
        )

    def _within(self, *, spare: int = 4) -> int:
        """Return how many modes lie where equations are looked at, and `spare` more than were measured at least.

        What is missing may lower frequencies, and a mode that was measured must not be one beyond all equations.
        """
        theta = self.theta({"G_f": self.start}, 0)[0]
        value = la.eigh(self.equations.matrix("K", theta), self.equations.matrix("M", theta), eigvals_only=True)
        rigid = int(np.count_nonzero(value < self.rigid))
        most = max(state.frequency.size for state in self.states)
        return max(int(np.count_nonzero(value < self._top)), rigid + most + spare)

    def n_riding(self, names: Collection[str]) -> int:
        """Return how many modes what rides on the structure has, where coordinates let it: one of all that can."""
        return max((n for part, n in self._riding if part.names(self.equations.theta) & set(names)), default=0)

    def n_riding_within(self, theta: Mapping[str, float]) -> int:
        """Return how many of these lie where equations are looked at, at parameters of the model.

        A rider that hardly moves on its seat has its modes far above; equations of further modes of the structure in
        place of these would be more than other models have, and no evidence for it.
        """
        return max((n for part, n in self._riding if part.eigenvalue(theta) < self._top), default=0)

    @cached_property
    def _riding(self) -> list[tuple[RidingPart, int]]:
        """The masses of what rides on the structure, and the number of its motions."""
        return [
            (term.factor, int(np.count_nonzero(np.diag(full(term.matrix)) > 0.5)))
            for term in self.equations.terms
            if isinstance(term.factor, RidingPart) and term.factor.part == "own"
        ]

    @property
    def touching(self) -> bool:
        """Whether laminas touch: one alone has no contact."""
        return self.stack.n_lamina > 1

    @cached_property
    def nuisances(self) -> tuple[Coordinate, ...]:
        """Coordinates of the base model."""
        s, contact = self.scatter, self.stack.contact
        start = np.log(D_F_START / contact.d_f) if contact.d_f > 0.0 else 0.0
        coordinates = []
        if self.touching:
            low, high = np.log(np.array(G_F_RANGE) / contact.G_f).tolist()
            coordinates += [
                Coordinate(name="G_f", std=np.inf, lower=low, upper=high, step=0.1, longest=0.4),
                Coordinate(
                    name="d_f", std=np.inf, lower=start - np.log(100.0), upper=start + np.log(100.0), longest=0.4
                ),
            ]

        def known(name: str, std: float, step: float) -> Coordinate:
            return Coordinate(name=name, std=std, lower=-FARTHEST * std, upper=FARTHEST * std, step=step)

        coordinates += [known("young", s.young, 0.02), known("density", s.density, 0.01)]
        if self.touching:
            coordinates.append(known("normal_modulus", s.normal_modulus, 0.3))
        coordinates += [known(name, s.clamp_place, 3e-3) for name in self.clamp_locations]
        coordinates += [known(name, getattr(s, name), 2e-3) for name in self.dimensions]
        coordinates += [known(f"gain[sensor {i + 2}]", s.gain, 0.01) for i in range(self.n_gain)]
        coordinates.append(known(POINTS_SHIFT, s.points_shift, 1e-3))
        coordinates.append(known(DECAY, 1e-3, 1e-3))
        names = tuple(dict.fromkeys(state.assembled for state in self.measured))
        if len(names) > 1 and self.touching:
            coordinates += [
                Coordinate(name=f"{what}[{name}]", std=std, step=std, longest=0.4)
                for what, std in (("G_f", s.stiffness), ("d_f", s.loss))
                for name in names
            ]
        return self.settings.of_stack(coordinates, self.stack)

    @cached_property
    def terms(self) -> dict[str, Term]:
        """Every effect of the catalogue that the stack can have, and what may be wrong with the measurement."""
        return {
            **{
                name: Term(name=name, coordinates=tuple(map(self.settings.of_effect, effect.parameters)))
                for name, effect in self.effects.items()
            },
            **{name: Term(name=name, frees=frees) for name, frees in self.hypotheses.items()},
        }

    @cached_property
    def hypotheses(self) -> dict[str, dict[str, float]]:
        """What may have been stated or measured wrongly: of each, the nuisances whose prior it widens."""
        known = [c.name for c in self.nuisances]
        by_name = {
            name: {c: std for c in known if c.startswith(which)}
            for name, (which, std) in (
                (STATED_PRESSURE, ("G_f[", PRESSURE)),
                (STATED_SIZE, (DIMENSIONS, SIZE)),
                (STATED_PLACE, ("clamp_", PLACE)),
                (SENSOR_GAIN, ("gain[", GAIN)),
                (STATED_POINTS, (POINTS_SHIFT, PLACE)),
                (WINDOW, (DECAY, FALL)),
            )
        }
        return {name: frees for name, frees in by_name.items() if frees and (name != WINDOW or self.touching)}

    @property
    def labels(self) -> dict[str, str]:
        """Plain name of each effect and hypothesis."""
        of_effects = {name: effect.label for name, effect in self.effects.items()}
        return of_effects | {name: LABELS[name] for name in self.hypotheses}

    def unit(self, nuisance: str) -> str:
        """Return the unit of a nuisance: m of locations, 1/s of a decay, 1 where it is the logarithm of a ratio."""
        return "m" if nuisance in (*self.clamp_locations, POINTS_SHIFT) else "1/s" if nuisance == DECAY else "1"

    def moved(self, explanation: Explanation) -> tuple[Moved, ...]:
        """Return every quantity that all fits may move, as stated and as an explanation was fitted with it."""
        return moved(self.stack, explanation)

    @cached_property
    def parameters(self) -> dict[str, Parameter]:
        """Parameters of all effects by name."""
        return shared_parameters(self.effects.values())

    def theta(self, at: Mapping[str, float], state: int) -> tuple[dict[str, float], dict[str, float]]:
        """Return the model's parameters in a state at coordinates by name, and their derivatives by coordinates."""
        measured, contact = self.measured[state], self.stack.contact
        theta = {**self.equations.theta, **measured.parameter}
        slope = {}
        G_f = contact.G_f * np.exp(at.get("G_f", 0.0) + at.get(f"G_f[{measured.assembled}]", 0.0))
        log_d_f = at.get("d_f", 0.0) + at.get(f"d_f[{measured.assembled}]", 0.0)
        d_f = (contact.d_f or D_F_START) * np.exp(log_d_f)
        theta["G_f"], theta["d_f"], theta[OMEGA] = float(G_f), float(d_f), 2.0 * np.pi * _MIDDLE
        for name in RATIOS:
            theta[name] = float(np.exp(at.get(name, 0.0)))
        for name in ("G_f", "d_f", *RATIOS):
            slope[name] = theta[name]
        for name in self.clamp_locations:
            theta[name], slope[name] = at.get(name, 0.0), 1.0
        slips = () if self.slip is None else [p.name for p in self.slip.parameters]  # at each mode's strain
        known = self.parameters
        for name, value in at.items():
            if name in known and name not in slips:
                theta[name], slope[name] = scaled(known[name], value)
        return theta, slope

    def about(
        self, coordinates: Sequence[Coordinate], points: Sequence[Vector], *, kept: int = 20_000_000
    ) -> StackNear:
        """Return the model near some points of the coordinates; the last ones, of `kept` numbers in all, are kept."""
        key = tuple((c.name, c.step, c.starts) for c in coordinates), tuple(x.tobytes() for x in points)
        near = self._near.pop(key, None) or StackNear(self, coordinates, points)
        self._near[key] = near  # the last one is the newest
        while sum(one.n_number for one in self._near.values()) > kept and len(self._near) > 1:
            del self._near[next(iter(self._near))]
        return near

    def finer_mesh(self, theta: Mapping[str, float]) -> tuple[Vector | None, Vector]:
        """Return what a finer mesh adds to the stiffness between the modes of the plain stack, and M times these.

        The finer mesh knows neither effects nor clamps that sit elsewhere; what it adds follows the contact slowly, so
        that one answer does for all contacts that are nearly as stiff.
        """
        contact, key = self._nearby(theta)
        if key not in self._finer:
            stiffness, mass = self.equations.matrix("K", contact), self.equations.matrix("M", contact)
            value, vector = la.eigh(stiffness, mass)
            bare = vector[:, : self.n_equation]
            self._finer[key] = (self.mesh.change(contact, value[: self.n_equation], bare, self.rigid), mass @ bare)
        return self._finer[key]

    def dimension(self, name: str, theta: Mapping[str, float]) -> dict[str, Vector]:
        """Return the derivatives of K and M, (n_basis, n_basis), by the logarithm of a dimension.

        Supports are left out: what is held is held as stiffly at any size.
        """
        n_kept = 4  # contacts at which all of these are cached, 11 MB each
        contact, key = self._nearby(theta)
        if (name, key) not in self._resized:
            resized_stack: ReducedEquations = self.candidates.resized[name]
            k = resized_stack.size
            ratio = np.log(getattr(resized_stack.stack, name) / getattr(self.stack, name))
            free = [t for t in resized_stack.terms if not t.name.startswith("support")]
            plain = {t.name for t in free}
            resized = replace(resized_stack, terms=tuple(free))
            base = replace(self.equations, terms=tuple(t for t in self.equations.terms if t.name in plain))
            derivatives: dict[str, Vector] = {}
            for target in ENERGIES:
                change = np.zeros((self.equations.size, self.equations.size))
                change[:k, :k] = resized.matrix(target, contact) - base.matrix(target, contact)[:k, :k]
                derivatives[target] = change / ratio
            if len(self._resized) >= n_kept * len(self.dimensions):
                del self._resized[next(iter(self._resized))]
            self._resized[name, key] = derivatives
        return self._resized[name, key]

    def _nearby(self, theta: Mapping[str, float]) -> tuple[dict[str, float], tuple[int, ...]]:
        """Return parameters of the plain stack with a contact within `_LIKE` of some, and their key."""
        contact = {**self.equations.theta, OMEGA: theta[OMEGA]}
        key = [round(float(np.log(theta[name])) / _LIKE) for name in ("G_f", "pressure")]
        contact["G_f"], contact["pressure"] = (float(np.exp(_LIKE * k)) for k in key)
        return contact, tuple(key)

    def acting(
        self, thetas: Sequence[Mapping[str, float]], moving: frozenset[str]
    ) -> list[tuple[ReducedTerm, frozenset[str]]]:
        """Return the terms that do not vanish while some parameters move, with what of these each depends on."""
        anywhere, idle = [generic(theta, moving) for theta in thetas], frozenset(self.parameters) - moving
        return [
            (term, names & moving)
            for term, names in zip(self.equations.terms, self._names, strict=True)
            # A place may be far from where a term acts; what an effect that is idle does not let act is nowhere.
            if (names & moving and not names & idle) or any(term.factor(theta) != 0.0 for theta in anywhere)
        ]


_MIDDLE = 600.0  # Hz, at which the eigenproblem is solved where stiffness depends on frequency


def state_of(tested: Tested, *, touching: bool) -> State:
    """Return the measured modes of a configuration; without contact, or loss of its own, damping is not compared."""
    modes = tested.modes
    length = np.linalg.norm(modes.shape, axis=0)
    n = modes.frequency.size
    return State(
        name=tested.name,
        path=("stack", tested.assembled, tested.name),
        frequency=modes.frequency,
        frequency_std=modes.frequency_std,
        damping=modes.damping if touching else np.full(n, np.nan),
        damping_std=modes.damping_std,
        shape=unit_shape(modes.shape),
        shape_std=np.linalg.norm(modes.shape_std / length, axis=0) / np.sqrt(len(modes.shape)),
    )


def n_gain(sensors: Sequence[NDArray[np.int64]], *, places: int = 4) -> int:
    """Return how many roving accelerometers have a gain beside the first's; with few places each it is scatter."""
    number = max(int(indices.max()) + 1 for indices in sensors)
    return number - 1 if min(indices.size for indices in sensors) >= places * number else 0


_STEP = 1e-3  # m, over which slopes are taken


def location_slopes(system: ReducedSystem, observation: Observation) -> Vector:
    """Return how observed displacements change as their points move along x and y, (n_dof, 2, n_basis), 1/m.

    A point at an edge moves inwards only.
    """
    half = np.array([system.stack.length, system.stack.width]) / 2.0
    slopes = []
    for axis in (0, 1):
        ends = []
        for step in (-_STEP, _STEP):
            moved = observation.location.copy()
            moved[:, axis] = np.clip(moved[:, axis] + step, -half[axis], half[axis])
            ends.append((moved[:, axis], observe(system, replace(observation, location=moved)).reduced_rows))
        (before, low), (after, high) = ends
        slopes.append((high - low) / (after - before)[:, None])
    return np.stack(slopes, axis=1)
