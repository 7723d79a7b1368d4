"""The inference on a chain of masses: errors of equations, their discrepancy, and fits that pair no modes."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg as la

from updating.inference import equation_error
from updating.inference.decide import decide
from updating.inference.discrepancy import joined, shared_levels
from updating.inference.equation_error import equation_errors, shape_noise
from updating.inference.explain import FORM, converged, explain, setting, step_within
from updating.inference.protocol import Coordinate, Modal, State, Term
from updating.inference.search import Search, begin

N, M, N_MEASURED = 30, 12, 5
EVERY = 2.0 * np.eye(N) - np.eye(N, k=1) - np.eye(N, k=-1)
SPRING = np.diff(np.eye(N), axis=0)[8:12]
SPOT = SPRING.T @ SPRING
ROWS = np.eye(N)[::2]
BASE = (Coordinate(name="stiffness", std=np.inf, longest=0.4), Coordinate(name="density", std=0.05))
TERM = Term(name="spot", coordinates=(Coordinate(name="loss", std=1.0, lower=-0.9, upper=0.9, starts=(0.2,)),))
CLOSE = 1e-3
LOSSY = 1e-4  # damping over stiffness, s


def matrices(at):
    """Stiffness and mass of the chain, and their derivatives by coordinates."""
    factor, heavy = 1e6 * np.exp(at.get("stiffness", 0.0)), np.exp(at.get("density", 0.0))
    whole = EVERY - at.get("loss", 0.0) * SPOT
    zero = np.zeros((N, N))
    change = {"stiffness": (factor * whole, zero), "density": (zero, heavy * np.eye(N)), "loss": (-factor * SPOT, zero)}
    return factor * whole, heavy * np.eye(N), change


class Chain:
    """A model of the protocol: exact everywhere, so local about every point."""

    def __init__(self, states, coordinates=BASE):
        self.states, self.coordinates = states, coordinates
        self.nuisances, self.terms = BASE, {"spot": TERM}

    def about(self, coordinates, points):
        return Chain(self.states, tuple(coordinates))

    def screen(self, x, state):
        return None

    def modal(self, x, state):
        names = [c.name for c in self.coordinates]
        stiffness, mass, change = matrices(dict(zip(names, x, strict=True)))
        value, every = la.eigh(stiffness, mass)
        low = every[:, :M]
        moved = [[every.T @ part @ low for part in change[name]] for name in names]
        k, m = (np.array([pair[i] for pair in moved]) for i in (0, 1))
        return Modal(
            eigenvalue=value[:M], n_rigid=0, shape=low, rows=ROWS @ low, moves=np.arange(len(names)),
            stiffness=k[:, :M], mass=m[:, :M], damping=LOSSY * np.diag(value[:M])[None],
            damps=np.arange(len(names)), damping_change=LOSSY * k[:, None, :M],
            looks=np.arange(0), row_change=np.zeros((0, len(ROWS), M)), beyond=value[M:],
            beyond_rows=ROWS @ every[:, M:], beyond_stiffness=k[:, M:], beyond_mass=m[:, M:],
        )  # fmt: skip


def measured(stiffness, mass, *, noise=1e-3, seed=0, name="A"):
    """Return the first modes of a chain as an identification gives them."""
    rng = np.random.default_rng(seed)
    value, vector = la.eigh(stiffness, mass, subset_by_index=[0, N_MEASURED - 1])
    shape = ROWS @ vector
    shape += noise * np.linalg.norm(shape, axis=0) / np.sqrt(len(ROWS)) * rng.standard_normal(shape.shape)
    frequency = np.sqrt(value) / (2.0 * np.pi) * (1.0 + 1e-5 * rng.standard_normal(N_MEASURED))
    return State(
        name=name,
        path=("chain", name),
        frequency=frequency,
        frequency_std=1e-5 * frequency,
        damping=0.5 * LOSSY * np.sqrt(value),
        damping_std=0.5e-2 * LOSSY * np.sqrt(value),
        shape=shape / np.linalg.norm(shape, axis=0),
        shape_std=np.full(N_MEASURED, noise / np.sqrt(len(ROWS))),
    )


def errors(state, x, coordinates=BASE):
    model = Chain((state,), coordinates)
    modal = model.modal(np.asarray(x, float), 0)
    return equation_errors(state, modal, shape_noise(state, modal), len(coordinates))


def test_shapes_of_modes_that_are_closer_than_their_frequencies_are_known_are_uncertain():
    stiffness, mass, _ = matrices({})
    state = measured(stiffness, mass)
    modal = Chain((state,)).modal(np.zeros(2), 0)
    apart = shape_noise(state, modal)
    gap = 1e-3 * state.frequency[1]
    close = replace(state, frequency=np.array([state.frequency[1] - gap, *state.frequency[1:]]))
    noise = shape_noise(replace(close, frequency_std=np.full(N_MEASURED, 0.2 * gap)), modal)
    turned = 0.2 * np.sqrt(2.0) / np.sqrt(len(ROWS))  # of the other mode, of unit length
    np.testing.assert_allclose(noise[:2], turned, rtol=0.1)
    np.testing.assert_array_less(noise[2:], 1.5 * apart[2:])


def test_modes_of_the_model_leave_no_error():
    found = errors(measured(*matrices({})[:2], noise=1e-6), [0.0, 0.0])
    assert np.abs(found.value).max() < 1e-3
    np.testing.assert_allclose(found.damping, 0.0, atol=1e-4)


def test_a_mixture_is_compared_with_no_mode_that_has_a_small_part_in_it():
    """The third measured mode has equal parts of the first four: its partner among them may be far off."""
    found = errors(measured(*matrices({})[:2]), [0.0, 0.0])
    equal = np.where(np.arange(N_MEASURED) == 2, np.where(np.arange(M) < 4, 0.5, 0.0)[:, None], found.weight.T).T
    mixed = replace(found, weight=equal)
    assert mixed.paired[2] == mixed.frequency[2]
    np.testing.assert_allclose(mixed.paired[[0, 1, 3]], found.paired[[0, 1, 3]])


def test_a_mixture_of_two_close_modes_leaves_no_error():
    """Two modes at nearly the same frequency mix at will: no pairing is right, and none is needed."""
    state = measured(*matrices({})[:2], noise=1e-6)
    chain = Chain((state,)).modal(np.zeros(2), 0)
    value = chain.eigenvalue.copy()
    value[1] = value[0] * (1.0 + CLOSE)
    close = replace(chain, eigenvalue=value)
    turn = np.array([[0.6, -0.8], [0.8, 0.6]])
    shape = state.shape.copy()
    shape[:, :2] = close.rows[:, :2] @ turn
    shape /= np.linalg.norm(shape, axis=0)
    frequency = state.frequency.copy()
    frequency[:2] = frequency[0]
    mixed = replace(state, shape=shape, frequency=frequency)
    found = equation_errors(mixed, close, shape_noise(mixed, close), 2)
    assert np.abs(found.value[:2]).max() < 1.1 * CLOSE


@pytest.mark.parametrize("i", range(3))
def test_derivatives_of_frequencies_are_those_of_differences(i):
    coordinates = (*BASE, *TERM.coordinates)
    state = measured(*matrices({"loss": 0.1})[:2], noise=1e-6)
    at, step = np.array([0.0, 0.0, 0.1]), 1e-4 * np.eye(3)[i]
    found = errors(state, at, coordinates)
    slope = 0.5 * np.einsum("rsp,rs->rp", found.jacobian, found.weight)[:, i]
    ends = [errors(state, at + sign * step, coordinates).frequency for sign in (1.0, -1.0)]
    np.testing.assert_allclose((ends[0] - ends[1]) / 2e-4, slope, rtol=2e-3, atol=2e-4)


def test_errors_scatter_as_a_random_perturbation_makes_them():
    """Equation errors of chains whose stiffness and mass are perturbed have the covariance of the discrepancy."""
    stiffness, mass, _ = matrices({})
    value, vector = la.eigh(stiffness, mass)
    inertia = (mass @ vector)[:, :M]  # of the modes whose equations are looked at
    force = inertia * np.sqrt(value[:M])
    size, rng = 1e-3, np.random.default_rng(1)
    samples = []

    def perturbed() -> np.ndarray:
        e = np.triu(rng.standard_normal((M, M)), 1)
        return size * np.sqrt(0.5) * (e + e.T + np.diag(np.sqrt(2.0) * rng.standard_normal(M)))

    for _ in range(200):
        stiffer, heavier = force @ perturbed() @ force.T, inertia @ perturbed() @ inertia.T
        state = measured(stiffness + stiffer, mass + heavier, noise=1e-7)
        samples.append(errors(state, [0.0, 0.0]).value)
    variance = np.mean(np.square(samples), axis=0) / size**2
    one = errors(measured(stiffness, mass, noise=1e-7), [0.0, 0.0])
    expected = np.diag(joined([one], np.ones((1, 1))).discrepancy).reshape(N_MEASURED, M)
    np.testing.assert_allclose(variance, expected, rtol=0.5)  # five standard deviations of 200 samples
    assert np.mean(variance / expected) == pytest.approx(1.0, abs=0.1)


def test_states_share_the_levels_of_the_tree_that_they_have_in_common():
    paths = [("rig", "a", "1"), ("rig", "a", "2"), ("rig", "b", "1")]
    common = shared_levels(paths, (0.5, 0.3, 0.2))
    np.testing.assert_allclose(common, [[1.0, 0.8, 0.5], [0.8, 1.0, 0.5], [0.5, 0.5, 1.0]])


@pytest.fixture(scope="module")
def changed():
    """Two states of a chain that is softer at a spot."""
    truth = {"stiffness": 0.2, "density": 0.02, "loss": 0.3}
    made = matrices(truth)[:2]
    model = Chain((measured(*made, seed=1, name="A"), measured(*made, seed=2, name="B")))
    common = setting(model, model, np.array([0.2, 0.0]), shares=(0.9, 0.1))
    return model, common


def test_a_fit_ends_at_the_truth_from_wherever_it_starts(changed):
    model, common = changed
    fits = [explain(model, [TERM], common, np.array(start)) for start in ([-0.5, 0, 0.0], [0.0, 0, 0.2], [0.6, 0, 0.7])]
    for fit in fits:
        assert abs(fit.value("loss") - 0.3) < 0.01
        assert FORM * 0.3 < fit.std[-1] < 1.2 * FORM * 0.3
        assert fit.log_evidence == pytest.approx(fits[0].log_evidence, abs=0.1)
        assert not fit.at_bound.any()


def test_the_evidence_tells_what_is_missing(changed):
    model, common = changed
    base = explain(model, [], common, np.zeros(2))
    whole = explain(model, [TERM], common, np.zeros(3))
    assert whole.log_evidence - base.log_evidence > 10.0
    assert whole.evidence.sizes.stiffness < 0.2 * base.evidence.sizes.stiffness


def test_a_measured_mode_that_the_model_lacks_draws_no_fit_away():
    """One of ten modes, in two states, is of something else: it is taken apart, and all others fit."""
    stiffness, mass, _ = matrices({"stiffness": 0.1})
    states = [measured(stiffness, mass, seed=seed, name=name) for seed, name in enumerate("AB")]
    strange = np.array(states[0].frequency)
    strange[3] *= 1.15
    model = Chain([replace(states[0], frequency=strange), states[1]])
    common, base = begin(model, shares=(0.9, 0.1), starts=[np.zeros(2)])
    assert base.apart == {(0, 3)}
    assert base.value("stiffness") == pytest.approx(0.1, abs=3 * base.std[0])
    drawn = converged(model, [], common, np.zeros(2))
    assert drawn.log_evidence < base.log_evidence - 10.0
    assert base.evidence.sizes.stiffness < 0.2 * drawn.evidence.sizes.stiffness


class Blind(Chain):
    """The same chain, whose third mode the sensors do not see."""

    def about(self, coordinates, points):
        return Blind(self.states, tuple(coordinates))

    def modal(self, x, state):
        modal = super().modal(x, state)
        return replace(modal, rows=modal.rows * (np.arange(M) != 2))


def test_a_measured_mode_that_sensors_do_not_see_in_the_model_says_nothing():
    """What a coupling brings to the sensors looks like the second mode; the others fit, and nothing seems to lack."""
    state = measured(*matrices({"stiffness": 0.1})[:2])
    coupled = state.shape[:, 1] + 0.05 * state.shape[:, 3]
    state = replace(state, shape=np.column_stack([*state.shape.T[:2], coupled, *state.shape.T[3:]]))
    model = Blind((state,))
    common, base = begin(model, shares=(1.0,), starts=[np.zeros(2)])
    assert base.apart == common.unseen == {(0, 2)}
    assert base.value("stiffness") == pytest.approx(0.1, abs=3 * base.std[0])
    found = Search(
        setting=common, measured=model.states, priors={}, freed=frozenset(), fitted={frozenset(): base}, chosen=base
    )
    assert decide(found).verdict == "nothing missing"
    strange = replace(found, setting=replace(common, unseen=frozenset()))
    assert decide(strange).verdict == "unlike anything"


def test_where_a_coordinate_ends_at_its_bound_the_others_step_as_is_best_there():
    """Clipped afterwards, a step to (1, -1) of two coordinates that act alike would raise the cost."""
    hessian, slope = np.array([[1.0, 0.9], [0.9, 1.0]]), np.array([-1.0, -0.8])
    limits = {"std": 1.0, "longest": np.inf}
    coordinates = (Coordinate(name="a", upper=0.1, **limits), Coordinate(name="b", **limits))
    to = step_within(slope, hessian, np.zeros(2), coordinates)
    np.testing.assert_allclose(to, [0.1, 0.8 - 0.9 * 0.1], rtol=1e-5)


def test_the_covariance_of_modal_coordinates_stays_positive_where_a_shape_is_measured_far_better_than_known():
    """A shape of modes that sensors hardly see is long: the inverse by itself was negative by rounding."""
    rng = np.random.default_rng(0)
    for _ in range(50):
        rows = rng.standard_normal((44, 5)) @ rng.standard_normal((5, 21)) + 1e-6 * rng.standard_normal((44, 21))
        gap, seen = rng.uniform(0.02, 5.0, (1, 21)), rng.standard_normal((1, 21))
        covariance = equation_error._coordinates(rows.T @ rows, seen, np.array([300.0]), np.array([1e-4]), gap, 1.0)[2][
            0
        ]
        assert la.eigvalsh(covariance)[0] > -1e-12


@pytest.mark.parametrize(("noise", "factor"), [(0.01, 1.0), (0.05, 3.0)])
def test_few_sensors_leave_the_scatter_of_shapes_to_the_evidence(monkeypatch, noise, factor):
    """Modes of the model reach all that ten sensors see: nothing but frequencies tells scatter from a wrong model."""
    monkeypatch.setattr("tests.unit.test_inference.ROWS", np.eye(N)[::3])
    states = [measured(*matrices({})[:2], noise=noise, seed=seed, name=name) for seed, name in enumerate("AB")]
    stated = 0.01 / np.sqrt(len(ROWS))
    model = Chain([replace(state, shape_std=np.full(N_MEASURED, stated)) for state in states])
    common, _ = begin(model, shares=(0.9, 0.1), starts=[np.zeros(2)])
    np.testing.assert_allclose(np.concatenate(common.noise), factor * stated, rtol=0.05)
