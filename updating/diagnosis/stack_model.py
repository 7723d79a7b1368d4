"""A stack's reduced equations as the inference asks for them: coordinates, terms, and modal matrices near a point."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from ema.types.modal_model import ModalModel
from model import Effect, Observation, Parameter, observe, shared_parameters
from model.elements.equations import OMEGA
from model.reduction.reduced_equations import ReducedTerm
from updating.diagnosis.candidates import G_F_RANGE, CandidateModel
from updating.diagnosis.coordinates import bounds_of, coordinate_of, scaled
from updating.diagnosis.evidence import D_F_START, DECAY, POINTS_SHIFT, DiagnosisScatter, unit_shape
from updating.diagnosis.sensor_place import place_slopes
from updating.diagnosis.stack_near import RATIOS, FinerMesh, StackNear, StackState
from updating.inference.protocol import Coordinate, State, Term

Vector = NDArray[np.float64]

_FARTHEST = 8.0  # prior standard deviations that a nuisance may move


class StackModel:
    """The model of one stack in all its states, from reduced equations with all effects.

    Parameters
    ----------
    candidates : CandidateModel
        The reduced model with all effects that the stack can have.
    tested : sequence of (str, float, ModalModel)
        Name, pressure in Pa and identified modes of each configuration.
    observation : sequence of Observation
        The measured points of each.
    scatter : DiagnosisScatter
        Priors of nuisances.
    assembled : mapping of str to str, optional
        Name of the state that a configuration is a force level of.
    effects : mapping of str to Effect, optional
        Candidates; all of `candidates` by default.
    """

    def __init__(
        self,
        candidates: CandidateModel,
        tested: Sequence[tuple[str, float, ModalModel]],
        observation: Sequence[Observation],
        scatter: DiagnosisScatter,
        assembled: Mapping[str, str] | None = None,
        effects: Mapping[str, Effect] | None = None,
    ) -> None:
        self.candidates, self.equations = candidates, candidates.system.equations
        self.stack, self.scatter = candidates.stack, scatter
        self.effects = {
            n: e
            for n, e in (candidates.effects if effects is None else effects).items()
            if e.over_strain is None
        }
        known, assembled = tested, assembled or {}
        self.measured = tuple(
            StackState(
                state=_state(name, assembled.get(name, name), modes, touching=self.stack.n_lamina > 1),
                parameter={"pressure": pressure},
                assembled=assembled.get(name, name),
                rows=observe(candidates.system, points).reduced_rows,
                slope=place_slopes(candidates.system, points)[:, 0],
                sensor=modes.sensor,
            )
            for (name, pressure, modes), points in zip(known, observation, strict=True)
        )
        self.states = tuple(own.state for own in self.measured)
        self.n_gain = _n_gain([own.sensor for own in self.measured])
        self.dimensions = tuple(candidates.resized)
        self.places = candidates.places
        self._names = [
            frozenset(t.factor.names(_generic(self.equations.theta))) for t in self.equations.terms
        ]
        self.mesh = FinerMesh(candidates)

    @property
    def touching(self) -> bool:
        """Whether laminas touch: one alone has no contact."""
        return self.stack.n_lamina > 1

    @property
    def nuisances(self) -> tuple[Coordinate, ...]:
        """Coordinates of the base model."""
        s, contact = self.scatter, self.stack.contact
        start = np.log(D_F_START / contact.d_f) if contact.d_f > 0.0 else 0.0
        found = []
        if self.touching:
            low, high = np.log(np.array(G_F_RANGE) / contact.G_f).tolist()
            found += [
                Coordinate(name="G_f", std=np.inf, lower=low, upper=high, step=0.1, longest=0.4),
                Coordinate(
                    name="d_f",
                    std=np.inf,
                    lower=start - np.log(100.0),
                    upper=start + np.log(100.0),
                    longest=0.4,
                ),
            ]

        def known(name: str, std: float, step: float) -> Coordinate:
            return Coordinate(name=name, std=std, lower=-_FARTHEST * std, upper=_FARTHEST * std, step=step)

        found += [known("young", s.young, 0.02), known("density", s.density, 0.01)]
        if self.touching:
            found.append(known("normal_modulus", s.normal_modulus, 0.3))
        found += [known(name, s.clamp_place, 3e-3) for name in self.places]
        found += [known(name, getattr(s, name), 2e-3) for name in self.dimensions]
        found += [known(f"gain[sensor {i + 2}]", s.gain, 0.01) for i in range(self.n_gain)]
        found.append(known(POINTS_SHIFT, s.points_shift, 1e-3))
        found.append(known(DECAY, 1e-3, 1e-3))
        names = tuple(dict.fromkeys(own.assembled for own in self.measured))
        if len(names) > 1 and self.touching:
            found += [
                Coordinate(name=f"{what}[{name}]", std=std, step=std, longest=0.4)
                for what, std in (("G_f", s.stiffness), ("d_f", s.loss))
                for name in names
            ]
        return tuple(found)

    @property
    def terms(self) -> dict[str, Term]:
        """Every effect of the catalogue that the stack can have."""
        return {
            name: Term(name=name, coordinates=tuple(_coordinate(p) for p in effect.parameters))
            for name, effect in self.effects.items()
        }

    @property
    def parameters(self) -> dict[str, Parameter]:
        """Parameters of all effects by name."""
        return shared_parameters(self.effects.values())

    def theta(self, at: Mapping[str, float], state: int) -> tuple[dict[str, float], dict[str, float]]:
        """Return the model's parameters in a state at coordinates by name, and their derivatives by coordinates."""
        own, contact = self.measured[state], self.stack.contact
        theta = {**self.equations.theta, **own.parameter}
        slope = {}
        G_f = contact.G_f * np.exp(at.get("G_f", 0.0) + at.get(f"G_f[{own.assembled}]", 0.0))
        d_f = (contact.d_f or D_F_START) * np.exp(at.get("d_f", 0.0) + at.get(f"d_f[{own.assembled}]", 0.0))
        theta["G_f"], theta["d_f"], theta[OMEGA] = float(G_f), float(d_f), 2.0 * np.pi * _MIDDLE
        for name in RATIOS:
            theta[name] = float(np.exp(at.get(name, 0.0)))
        for name in ("G_f", "d_f", *RATIOS):
            slope[name] = theta[name]
        for name in self.places:
            theta[name], slope[name] = at.get(name, 0.0), 1.0
        known = self.parameters
        for name, value in at.items():
            if name in known:
                theta[name], slope[name] = scaled(known[name], value)
        return theta, slope

    def about(self, coordinates: Sequence[Coordinate], points: Sequence[Vector]) -> StackNear:
        """Return the model near some points of the coordinates."""
        return StackNear(self, coordinates, points)

    def acting(
        self, thetas: Sequence[Mapping[str, float]], moving: frozenset[str]
    ) -> list[tuple[ReducedTerm, frozenset[str]]]:
        """Return the terms that do not vanish while some parameters move, with what of these each depends on."""
        return [
            (term, names & moving)
            for term, names in zip(self.equations.terms, self._names, strict=True)
            if names & moving or any(term.factor(theta) != 0.0 for theta in thetas)
        ]


_MIDDLE = 600.0  # Hz, at which the eigenproblem is solved where stiffness depends on frequency


def _generic(theta: Mapping[str, float]) -> dict[str, float]:
    """Return parameters at which no factor hides a dependence by chance."""
    return {name: 1.0123 * value + 1.01e-3 for name, value in theta.items()} | {OMEGA: 2.0 * np.pi * _MIDDLE}


def _coordinate(p: Parameter) -> Coordinate:
    """Return the coordinate of an effect's parameter: in units of its range, 0 at neutral, with a wide prior."""
    (low,), (high,) = bounds_of([p])
    if p.sampled:
        starts = tuple(float(low + share * (high - low)) for share in (0.15, 0.5, 0.85))
    else:
        nominal = coordinate_of(p, p.nominal)
        starts = tuple(float(np.clip(share * nominal, low, high)) for share in (0.2, 1.0))
    return Coordinate(
        name=p.name, std=1.0, lower=float(low), upper=float(high), starts=starts, step=0.1, longest=0.4
    )


def _state(name: str, assembled: str, modes: ModalModel, *, touching: bool) -> State:
    length = np.linalg.norm(modes.shape, axis=0)
    n = modes.frequency.size
    return State(
        name=name,
        path=("stack", assembled, name),
        frequency=modes.frequency,
        frequency_std=modes.frequency_std,
        damping=modes.damping if touching else np.full(n, np.nan),
        damping_std=modes.damping_std,
        shape=unit_shape(modes.shape),
        shape_std=np.linalg.norm(modes.shape_std / length, axis=0) / np.sqrt(len(modes.shape)),
    )


def _n_gain(sensors: Sequence[NDArray[np.int64]], *, places: int = 4) -> int:
    """Return how many roving accelerometers have a gain beside the first's; with few places each it is scatter."""
    number = max(int(own.max()) + 1 for own in sensors)
    return number - 1 if min(own.size for own in sensors) >= places * number else 0
