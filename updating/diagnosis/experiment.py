"""Further tests that a laboratory can afford, how well each separates explanations, and slip over the force level."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from model import Effect, Parameter
from model.effects.contact_slip import EFFECT, STRAIN
from model.effects.parts import every_lamina, mean_over, square
from model.elements.equations import Assembly, Monomial, Term
from model.elements.mesh import FIELDS
from updating.diagnosis.answer import ContactAmplitude, NextTest
from updating.diagnosis.evidence import SomeModes, Tested
from updating.diagnosis.fit_settings import scaled
from updating.diagnosis.ranking import misfit
from updating.diagnosis.slipping import N_SHARE, slipped
from updating.diagnosis.stack_model import StackModel
from updating.inference.discrepancy import joined, whitened
from updating.inference.equation_error import equation_errors
from updating.inference.explain import Explanation, coordinates_of
from updating.inference.protocol import Coordinate, LocalModel
from updating.inference.search import Search

Vector = NDArray[np.float64]

ADDED_MASS = 1.0
_PAD = (0.02, 0.02)
_MOVE = 0.05
_FREQUENCY_STD, _DAMPING_STD, _SHAPE_STD = 2e-4, 0.01, 0.01


def _known_mass(name: str, location: tuple[float, float], what: str) -> Effect:
    """Return a mass fixed at a location on the plan, given in shares of half length and half width."""

    def terms(assembly: Assembly) -> tuple[Term, ...]:
        stack = assembly.stack
        x = location[0] * (stack.length - _PAD[0]) / 2.0
        y = location[1] * (stack.width - _PAD[1]) / 2.0
        krons = tuple(square(f, mean_over(assembly, f, (x, y), _PAD), every_lamina(stack)) for f in FIELDS)
        return (Term(name=name, target="M", factor=Monomial(exponent={name: 1}), krons=krons),)

    return Effect(
        name=name,
        label=what,
        family="inertia",
        summary=what,
        description=what,
        parameters=(
            Parameter(
                name=name, unit="kg", nominal=ADDED_MASS, lower=0.0, upper=2.0, source="a weight from the scales"
            ),
        ),
        terms=terms,
    )


def _moved_clamps() -> Effect:
    """Return the outermost clamps moved towards the middle by 50 mm: mass taken here and put there."""

    def terms(assembly: Assembly) -> tuple[Term, ...]:
        stack = assembly.stack
        reach = max((abs(clamp.x) for clamp in stack.clamps), default=0.0)
        krons = []
        for clamp in stack.clamps:
            if clamp.mass > 0.0 and abs(clamp.x) >= 0.9 * reach > 0.0:
                for at, sign in ((clamp.x, -1.0), (clamp.x - np.sign(clamp.x) * _MOVE, 1.0)):
                    krons += [
                        square(
                            f,
                            mean_over(assembly, f, (at, clamp.y), clamp.footprint),
                            every_lamina(stack),
                            sign * clamp.mass,
                        )
                        for f in FIELDS
                    ]
        factor = Monomial(exponent={"test_clamps_moved": 1})
        return (Term(name="test_clamps_moved", target="M", factor=factor, krons=tuple(krons)),)

    what = "the outer clamps moved towards the middle"
    return Effect(
        name="test_clamps_moved",
        label=what,
        family="inertia",
        summary=what,
        description=what,
        parameters=(
            Parameter(
                name="test_clamps_moved", unit="1", nominal=1.0, lower=0.0, upper=1.0, source="0 before, 1 after"
            ),
        ),
        terms=terms,
    )


def aids() -> tuple[Effect, ...]:
    """Return what further tests could do to the stack."""
    return (
        _known_mass("test_mass_end", (1.0, 0.0), "a known mass in the middle of one end"),
        _known_mass("test_mass_corner", (1.0, 1.0), "a known mass on one corner"),
        _known_mass("test_mass_middle", (0.0, 1.0), "a known mass at the middle of one side"),
        _moved_clamps(),
    )


@dataclass(frozen=True, kw_only=True)
class Experiment:
    """A further test.

    Attributes
    ----------
    name : str
        One word.
    instruction : str
        What to do.
    pressure_ratio : float
        Its pressure over the highest that was tested.
    known : tuple of (str, float)
        What it sets.
    """

    name: str
    instruction: str
    pressure_ratio: float = 1.0
    known: tuple[tuple[str, float], ...] = ()


EXPERIMENTS = (
    Experiment(name="lower_torque", instruction="test at half of the lowest torque", pressure_ratio=-0.5),
    Experiment(name="higher_torque", instruction="test at twice the highest torque", pressure_ratio=2.0),
    Experiment(
        name="mass_end",
        instruction="fix a known mass of 1 kg in the middle of one end and test again",
        known=(("test_mass_end", ADDED_MASS),),
    ),
    Experiment(
        name="mass_corner",
        instruction="fix a known mass of 1 kg on one corner and test again",
        known=(("test_mass_corner", ADDED_MASS),),
    ),
    Experiment(
        name="mass_side",
        instruction="fix a known mass of 1 kg at the middle of one long side and test again",
        known=(("test_mass_middle", ADDED_MASS),),
    ),
    Experiment(
        name="clamps_moved",
        instruction="move the outer clamps by 50 mm towards the middle and test again",
        known=(("test_clamps_moved", 1.0),),
    ),
)


def rank_tests(model: StackModel, search: Search, explanations: Sequence[Explanation]) -> tuple[NextTest, ...]:
    """Rank further tests by the smallest distance that they leave between explanations, the best first.

    For explanations A and B the data of the further test are predicted with A, and B is fitted to them and to the data
    at hand by a linear step. The distance is the root of the difference between its misfit and that of A.
    """
    if len(explanations) < 2:
        return ()
    misfits = [misfit(explanation, explanation.evidence.sizes) for explanation in explanations]
    now = min(float(np.sqrt(max(value - misfits[0], 0.0))) for value in misfits[1:])
    ranked = []
    for experiment in EXPERIMENTS:
        if any(name == "test_clamps_moved" for name, _ in experiment.known) and not model.stack.clamps:
            continue
        if experiment.pressure_ratio != 1.0 and not model.touching:
            continue
        try:
            apart = _distances(model, search, experiment, explanations, misfits)
        except np.linalg.LinAlgError:  # clamps that are moved and sit elsewhere than stated, for instance
            continue
        ranked.append(NextTest(name=experiment.name, instruction=experiment.instruction, distance=min(apart), now=now))
    again = _second_level(model, explanations, misfits)
    if again is not None:
        instruction = "test again at three times the force"
        ranked.append(NextTest(name="second_force", instruction=instruction, distance=again, now=now))
    return tuple(sorted(ranked, key=lambda test: -test.distance))


def _second_level(model: StackModel, explanations: Sequence[Explanation], misfits: Sequence[float]) -> float | None:
    """Return the smallest distance that a second force level leaves; None where several levels were tested.

    It separates explanations that depend on amplitude from those that do not, by as much as slip of the usual strength
    does, and no others.
    """
    shows = second_level(model, explanations[0])
    if shows is None:
        return None
    moves = [
        any(name in model.effects and model.effects[name].family == "amplitude" for name in explanation.terms)
        for explanation in explanations
    ]
    return min(
        float(np.hypot(np.sqrt(abs(misfits[i] - misfits[j])), shows if moves[i] != moves[j] else 0.0))
        for i, j in itertools.combinations(range(len(explanations)), 2)
    )


def _distances(
    model: StackModel,
    search: Search,
    experiment: Experiment,
    explanations: Sequence[Explanation],
    misfits: Sequence[float],
) -> list[float]:
    """Return the distance of every explanation from the data that every other one predicts for a test."""
    tested = [configuration.pressure for configuration in model.tested]
    ratio = experiment.pressure_ratio
    pressure = -ratio * min(tested) if ratio < 0.0 else ratio * max(tested)
    first = Tested(name=experiment.name, pressure=pressure, modes=model.tested[0].modes, known=dict(experiment.known))
    alone = model.of_tests([first], model.observation[:1])
    names = dict.fromkeys(name for explanation in explanations for name in explanation.terms)
    all_coordinates = coordinates_of(alone, [alone.terms[n] for n in names if n in alone.terms])
    local = alone.about(all_coordinates, [_at(all_coordinates, explanations[0])])
    apart = []
    for i, explanation in enumerate(explanations):
        coordinates = coordinates_of(alone, [alone.terms[n] for n in explanation.terms if n in alone.terms])
        expected = _expected(model, local.of(coordinates), _at(coordinates, explanation))
        if expected is None:  # a test without a mode in the band separates nothing
            return [0.0]
        test = alone.of_tests([replace(first, modes=expected)], model.observation[:1])
        for j, other in enumerate(explanations):
            if i != j:
                rise = _misfit_with(test, search, local.measured_as(test), other) - misfits[i]
                apart.append(float(np.sqrt(max(rise, 0.0))))
    return apart


def _at(coordinates: Sequence[Coordinate], explanation: Explanation) -> Vector:
    """Return coordinates of a further test where an explanation has them; its reassembly is not known."""
    have = {c.name: x for c, x in zip(explanation.coordinates, explanation.x, strict=True)}
    return np.array([have.get(c.name, 0.0) for c in coordinates])


def _expected(model: StackModel, local: LocalModel, x: Vector) -> SomeModes | None:
    """Return what an identification is expected to give up to the band's end; None without a mode in it.

    Modes that the sensors hardly see are not identified.
    """
    modal = local.modal(x, 0)
    frequency = np.sqrt(modal.eigenvalue) / (2.0 * np.pi)
    top = max(float(state.frequency.max()) for state in model.states)
    seen = np.flatnonzero((np.arange(frequency.size) >= modal.n_rigid) & (frequency < 1.05 * top))
    shape = modal.rows[:, seen]
    large = np.sqrt(np.mean(shape**2, axis=0))
    seen = seen[large > 0.2 * large.max(initial=0.0)]
    if not seen.size:
        return None
    shape = modal.rows[:, seen]
    damping = np.einsum("ii->i", modal.damping[0])[seen] / (4.0 * np.pi * frequency[seen])
    return SomeModes(
        frequency=frequency[seen],
        frequency_std=_FREQUENCY_STD * frequency[seen],
        damping=damping,
        damping_std=_DAMPING_STD * damping,
        shape=shape.astype(complex),
        shape_std=np.tile(_SHAPE_STD * np.sqrt(np.mean(shape**2, axis=0)), (len(shape), 1)),
        sensor=model.tested[0].modes.sensor,
    )


def _misfit_with(test: StackModel, search: Search, local: LocalModel, explanation: Explanation) -> float:
    """Return the misfit of an explanation to the data at hand and to a further test after a linear step."""
    coordinates = coordinates_of(test, [test.terms[n] for n in explanation.terms if n in test.terms])
    at = _at(coordinates, explanation)
    noise = np.full(test.states[0].frequency.size, float(np.median(np.concatenate(search.setting.noise))))
    errors = equation_errors(test.states[0], local.of(coordinates).modal(at, 0), noise, at.size)
    fresh, slope, _ = whitened(joined([errors], np.ones((1, 1))), explanation.evidence.sizes)
    old, before, _ = whitened(explanation.problem, explanation.evidence.sizes)
    names = [c.name for c in explanation.coordinates]
    jacobian = np.zeros((fresh.size, explanation.x.size + 2))
    for i, c in enumerate(coordinates):
        if c.name in names:
            jacobian[:, names.index(c.name)] = slope[:, i]
        for extra, shared in enumerate(("G_f", "d_f")):  # of the further test's own assembly
            if c.name == shared:
                jacobian[:, explanation.x.size + extra] = slope[:, i]
    scatter = test.scatter
    std = np.array([*(c.std for c in explanation.coordinates), scatter.stiffness, scatter.loss])
    held = np.isfinite(std)
    value = np.concatenate([old, fresh, np.append(explanation.x, [0.0, 0.0])[held] / std[held]])
    matrix = np.vstack([np.hstack([before, np.zeros((old.size, 2))]), jacobian, np.diag(1.0 / std)[held]])
    free = ~np.append(explanation.at_bound, [False, False])
    q = np.linalg.qr(matrix[:, free])[0]
    return float(value @ value - np.sum((q.T @ value) ** 2))


FORCE = 3.0
"""Force of the second level over that of the first."""


def second_level(model: StackModel, explanation: Explanation) -> float | None:
    """Return by how many standard deviations usual slip would move frequencies at three times the force.

    The amplitude of a test at one level is unknown: the first is taken to shear the contact by the strain at which the
    effect's strength is stated. Slip grows with the amplitude, and thus somewhat less than with the force. A frequency
    that is measured twice differs by noise and drift.

    Parameters
    ----------
    model : StackModel
        Measurement and model.
    explanation : Explanation
        The fit that stands for the stack.

    Returns
    -------
    float or None
        None where several levels are there, or no contact.
    """
    drift = 2e-4  # of a frequency, by which tests on one day differ
    if not model.touching or any(tested.strain is not None for tested in model.tested):
        return None
    values = {p.name: p.nominal for p in EFFECT.parameters}
    local, moved = model.about(explanation.coordinates, [explanation.x]), []
    contact = [c.name for c in explanation.coordinates].index("G_f")
    for c, (state, errors) in enumerate(zip(model.states, explanation.errors, strict=True)):
        modal = local.modal(explanation.x, c)
        stiffness = modal.stiffness[modal.moves.tolist().index(contact)]  # what the contact holds
        held = np.einsum("ri,ij,rj->r", errors.weight, stiffness, errors.weight) / errors.eigenvalue
        root = [
            slipped(EFFECT, values, np.full((held.size, N_SHARE), times * STRAIN), held).root for times in (1.0, FORCE)
        ]
        noise = np.hypot(state.frequency_std / state.frequency, drift)
        moved.append(np.log(root[1] / root[0]) / (np.sqrt(2.0) * noise))
    return float(np.linalg.norm(np.concatenate(moved)))


def contact_amplitudes(model: StackModel, explanation: Explanation) -> tuple[ContactAmplitude, ...]:
    """Return the amplitudes of the contact, level by level; none where no amplitude was measured.

    Parameters
    ----------
    model : StackModel
        Measurement and model.
    explanation : Explanation
        Whose slip it is, if it has any.
    """
    effect, amplitudes = model.slip, []
    values = {}
    if effect is not None and effect.name in explanation.terms:
        values = {p.name: scaled(p, explanation.value(p.name))[0] for p in effect.parameters}
    for tested in model.tested:
        if tested.strain is None or tested.motion is None:
            continue
        for r, strain in enumerate(tested.strain):
            softening, loss = (
                effect.over_strain(values, strain)
                if values and effect is not None and effect.over_strain is not None
                else np.zeros((2, 1))
            )
            amplitudes.append(
                ContactAmplitude(
                    configuration=tested.name,
                    mode=r + 1,
                    frequency=float(tested.modes.frequency[r]),
                    motion=float(tested.motion[r]),
                    strain=float(np.mean(strain)),
                    largest_strain=float(strain[-1]),
                    slip=float(strain[-1] * np.mean(model.stack.spacing)),
                    softening=float(np.mean(softening)),
                    loss=float(np.mean(loss)),
                )
            )
    return tuple(amplitudes)
