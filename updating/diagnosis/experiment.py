"""Further tests that a laboratory can afford, and how well each would tell explanations apart."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from model import Effect, Modes, Parameter, SolveError
from model.effects.parts import every_lamina, mean_over, square
from model.elements.equations import Assembly, Monomial, Term
from model.elements.mesh import FIELDS
from updating.diagnosis.assembly import Assembled, base_shift
from updating.diagnosis.candidates import N_MODEL
from updating.diagnosis.evidence import Evidence, Shift, Tested, solved
from updating.diagnosis.explanation import Explanation
from updating.diagnosis.residual import Residual, covariance_of, residual
from updating.diagnosis.second_level import second_level

Vector = NDArray[np.float64]

ADDED_MASS = 1.0
_PAD = (0.02, 0.02)
_MOVE = 0.05
_FREQUENCY_STD, _DAMPING_STD, _SHAPE_STD = 2e-4, 0.01, 0.01


def _known_mass(name: str, place: tuple[float, float], what: str) -> Effect:
    """Return a mass fixed at a place of the plan, given in shares of half length and half width."""

    def terms(assembly: Assembly) -> tuple[Term, ...]:
        stack = assembly.stack
        x = place[0] * (stack.length - _PAD[0]) / 2.0
        y = place[1] * (stack.width - _PAD[1]) / 2.0
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
                name=name,
                unit="kg",
                nominal=ADDED_MASS,
                lower=0.0,
                upper=2.0,
                source="a weight from the scales",
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
                name="test_clamps_moved",
                unit="1",
                nominal=1.0,
                lower=0.0,
                upper=1.0,
                source="0 before, 1 after",
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


@dataclass(frozen=True, kw_only=True)
class NextTest:
    """How well a further test would tell the explanations apart that are left.

    Attributes
    ----------
    name, instruction : str
        The test.
    distance : float
        Smallest discrimination distance between two explanations after it; above 3 it separates them.
    now : float
        The same before it.
    """

    name: str
    instruction: str
    distance: float
    now: float


@dataclass(frozen=True, eq=False, kw_only=True)
class _Expected:
    frequency: Vector
    frequency_std: Vector
    damping: Vector
    damping_std: Vector
    shape: NDArray[np.complex128]
    shape_std: Vector


def rank_tests(evidence: Assembled, explanations: Sequence[Explanation]) -> tuple[NextTest, ...]:
    """Rank further tests by the smallest distance that they leave between explanations, the best first.

    For explanations A and B the data of the further test are predicted with A, and B is fitted to them and to the data
    at hand by a linear step; the root of what its misfit exceeds A's by is the distance.
    """
    if len(explanations) < 2:
        return ()
    now = min(np.sqrt(max(b.misfit - a.misfit, 0.0)) for a in explanations[:1] for b in explanations[1:])
    found = []
    for experiment in EXPERIMENTS:
        if any(name == "test_clamps_moved" for name, _ in experiment.known) and not evidence.stack.clamps:
            continue
        if experiment.pressure_ratio != 1.0 and not evidence.touching:
            continue
        try:
            apart = _distances(evidence, experiment, explanations)
        except SolveError:  # clamps that are moved and sit elsewhere than stated, for instance
            continue
        found.append(
            NextTest(
                name=experiment.name, instruction=experiment.instruction, distance=min(apart), now=float(now)
            )
        )
    again = _second_level(evidence, explanations)
    if again is not None:
        instruction = "test again at three times the force"
        found.append(NextTest(name="second_force", instruction=instruction, distance=again, now=float(now)))
    return tuple(sorted(found, key=lambda test: -test.distance))


def _second_level(evidence: Evidence, explanations: Sequence[Explanation]) -> float | None:
    """Return the smallest distance that a second force level leaves; None where several levels were tested.

    It tells what follows the amplitude from all that does not, by as much as slip of the usual strength does, and
    nothing else.
    """
    shows = second_level(evidence.supposing(explanations[0].effects), explanations[0])
    if shows is None:
        return None
    moves = [
        any(name in evidence.effects and evidence.effects[name].family == "amplitude" for name in own.effects)
        for own in explanations
    ]
    apart = [
        float(np.hypot(np.sqrt(abs(a.misfit - b.misfit)), shows if moves[i] != moves[j] else 0.0))
        for (i, a), (j, b) in itertools.combinations(enumerate(explanations), 2)
    ]
    return min(apart)


def _pressure(evidence: Evidence, experiment: Experiment) -> float:
    tested = [t.pressure for t in evidence.tested]
    if experiment.pressure_ratio < 0.0:
        return -experiment.pressure_ratio * min(tested)
    return experiment.pressure_ratio * max(tested)


def _distances(
    evidence: Assembled, experiment: Experiment, explanations: Sequence[Explanation]
) -> list[float]:
    """Return the distance of every explanation from the data that every other one predicts for a test."""
    found = []
    for a in explanations:
        further = _further(evidence, experiment, a)
        found += [_distance(evidence, further, a, b) for b in explanations if b is not a]
    return found


def _distance(evidence: Assembled, further: Assembled | None, a: Explanation, b: Explanation) -> float:
    """Return the distance of b from the data of a further test that a predicts, with what is known already."""
    if further is None:  # a test without a mode in the band tells nothing
        return 0.0
    nuisance = b.nuisance[: evidence.n_common]
    weighed = replace(further, covariance=covariance_of(further, nuisance, b.parameter, b.coordinate))
    fresh = residual(weighed, nuisance, b.parameter, b.coordinate)
    return float(np.sqrt(max(_misfit_with(evidence, fresh, b) - a.misfit, 0.0)))


def _further(evidence: Assembled, experiment: Experiment, a: Explanation) -> Assembled | None:
    """Return the evidence of a further test alone as an explanation predicts it; None without a mode in the band."""
    alone = _alone(evidence, experiment)
    theta = alone.theta(a.nuisance[: evidence.n_common], 0)
    modes = solved(alone, 0, {**theta, **a.effect_values}, (), N_MODEL)
    seen = _seen(modes, max(float(t.modes.frequency.max()) for t in evidence.tested))
    if not seen.size:
        return None
    expected = _expected(modes, seen)
    usual = np.median(evidence.sensor_scatter[0][evidence.used[0]])  # the same sensors at the same points
    number = (np.arange(seen.size),)
    alone = replace(
        alone,
        tested=(replace(alone.tested[0], modes=expected),),
        used=number,
        identity=number,
        sensor_scatter=(np.full(seen.size, usual),),
    )
    shift = base_shift(alone, 0, theta["G_f"])
    as_measured = replace(alone.tested[0], modes=_refined_mesh(expected, shift))
    return replace(alone, tested=(as_measured,), shift=(shift,))


def _alone(evidence: Assembled, experiment: Experiment) -> Assembled:
    """Return the evidence with a further test in place of those at hand: first with the modes of one of these."""
    test = Tested(
        name=experiment.name,
        pressure=_pressure(evidence, experiment),
        modes=evidence.tested[0].modes,
        known=dict(experiment.known),
    )
    return replace(
        evidence,
        tested=(test,),
        observation=evidence.observation[:1],
        observed=evidence.observed[:1],
        place_slope=evidence.place_slope[:1],
        sensor=evidence.sensor[:1],
        hypotheses={},
        released=(),
    )


def _seen(modes: Modes, top: float) -> NDArray[np.intp]:
    """Return the modes that a test up to a frequency, Hz, identifies: not those that z sensors hardly see."""
    seen = np.flatnonzero(modes.frequency < 1.05 * top)
    large = np.sqrt(np.mean(modes.shape[:, seen] ** 2, axis=0))
    return np.asarray(seen[large > 0.2 * large.max(initial=0.0)])


def _expected(modes: Modes, seen: NDArray[np.intp]) -> _Expected:
    """Return what an identification is expected to give of modes."""
    shape = modes.shape[:, seen]
    return _Expected(
        frequency=modes.frequency[seen],
        frequency_std=_FREQUENCY_STD * modes.frequency[seen],
        damping=modes.damping[seen],
        damping_std=_DAMPING_STD * modes.damping[seen],
        shape=shape.astype(complex),
        shape_std=np.tile(_SHAPE_STD * np.sqrt(np.mean(shape**2, axis=0)), (shape.shape[0], 1)),
    )


def _refined_mesh(expected: _Expected, shift: Shift) -> _Expected:
    """Return expected modes as an ever finer mesh would give them."""
    return replace(
        expected,
        frequency=np.exp(shift.mesh) * expected.frequency,
        shape=expected.shape + np.linalg.norm(expected.shape.real, axis=0) * shift.mesh_shape,
    )


def _misfit_with(evidence: Assembled, fresh: Residual, b: Explanation) -> float:
    """Return the misfit of b to the data at hand and to `fresh`, those of a further test, after a linear step."""
    data, old = fresh.kind != "prior", b.residual
    n_old, n_effect, common = old.jacobian.shape[1], len(b.parameter), evidence.n_common
    n_own = 2  # the further test's own reassembly: G_f and d_f
    jacobian = np.zeros((int(data.sum()), n_old + n_own))
    jacobian[:, np.r_[0:common, n_old - n_effect : n_old]] = fresh.jacobian[data]
    jacobian[:, n_old:] = fresh.jacobian[data][:, :n_own]
    priors = np.zeros((n_own, n_old + n_own))
    priors[:, n_old:] = -np.diag([1.0 / evidence.scatter.stiffness, 1.0 / evidence.scatter.loss])
    before = np.hstack([old.jacobian, np.zeros((old.value.size, n_own))])
    free = ~np.r_[np.zeros(n_old - n_effect, bool), b.at_bound, np.zeros(n_own, bool)]
    value = np.concatenate([old.value, fresh.value[data], np.zeros(n_own)])
    q = np.linalg.qr(np.vstack([before, jacobian, priors])[:, free])[0]
    return float(value @ value - np.sum((q.T @ value) ** 2))
