"""A stack as the inference asks for it: its local equations are those of the reduced model, wherever they stand."""

import dataclasses
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from model import Mesh, Observation, catalogue, read_stack, solve_modes
from model.effects.parts import known_or_usual_instruments
from updating.diagnosis import evidence
from updating.diagnosis.candidates import N_MODEL, candidate_model
from updating.diagnosis.evidence import DiagnosisScatter
from updating.diagnosis.fit_settings import coordinate_of
from updating.diagnosis.stack_model import StackModel
from updating.inference.equation_error import equation_errors
from updating.inference.explain import coordinates_of
from updating.inference.screen import _changed

STACK = dataclasses.replace(
    read_stack(Path(__file__).parents[2] / "data/demo_stack/stack.toml"), n_lamina=40, mesh=Mesh(n_x=8, n_y=2)
)
N_SEEN = 6
N_COMPARED = 5  # the next two are close, and the correction of so coarse a mesh mixes them


@pytest.fixture(scope="module")
def whole():
    instruments = known_or_usual_instruments(STACK)
    effects = {name: catalogue()[name] for name in ("clamp_mass", "contact_direction", "added_mass", "loose_clamp")}
    n = len(instruments.sensor)
    observation = Observation(
        node=np.arange(n), location=instruments.sensor, direction=np.tile([0.0, 0.0, 1.0], (n, 1))
    )
    modes = SimpleNamespace(
        frequency=np.linspace(200.0, 700.0, N_SEEN), frequency_std=np.full(N_SEEN, 0.01), sensor=np.arange(n) % 2,
        damping=np.full(N_SEEN, 0.01), damping_std=np.full(N_SEEN, 1e-4),
        shape=np.random.default_rng(0).standard_normal((n, N_SEEN)) + 0j, shape_std=np.full((n, N_SEEN), 0.01),
    )  # fmt: skip
    candidates = candidate_model(STACK, instruments, effects)
    tested = [
        evidence.Tested(name=name, pressure=pressure, modes=modes) for name, pressure in (("M1", 160e3), ("M2", 320e3))
    ]
    return StackModel(candidates, tested, [observation, observation], DiagnosisScatter())


def exact(whole, at, state):
    """Return the elastic frequencies of the reduced model with all effects, Hz."""
    theta, _ = whole.theta(at, state)
    point = Observation(node=np.array([1]), location=np.zeros((1, 3)), direction=np.array([[0.0, 0.0, 1.0]]))
    found = solve_modes(
        whole.candidates.system, G_f=theta["G_f"], d_f=theta["d_f"], n_mode=14, observation=point, by=(),
        parameters={n: v for n, v in theta.items() if n in whole.candidates.system.theta and n not in ("G_f", "d_f")},
    ).elastic()  # fmt: skip
    return found.frequency


@pytest.mark.parametrize(
    ("at", "state"),
    [
        ({"G_f": -0.3}, 1),
        ({"clamp_1_x": -0.004, "clamp_2_y": 0.002}, 0),
        ({"G_yz_ratio": -0.2, "young": 0.02}, 1),
        ({"clamp_added_mass": 0.2, "G_f[M1]": 0.1}, 0),
        ({"clamp_added_mass": 0.2, "G_f[M1]": 0.1}, 1),
    ],
)
def test_modes_about_a_point_are_those_of_the_whole_model(whole, at, state):
    """The finer mesh's correction is that of the plain stack: it must not undo what moves a clamp or adds a mass."""
    coordinates = coordinates_of(whole, tuple(whole.terms.values()))
    x = np.array([at.get(c.name, 0.0) for c in coordinates])
    plain = np.array([at.get(c.name, 0.0) if c.name in ("G_f", "young", "G_f[M1]") else 0.0 for c in coordinates])

    def local(point):
        value = whole.about(coordinates, [point]).modal(point, state).eigenvalue
        return np.sqrt(value[value > 0.0][:N_COMPARED]) / (2.0 * np.pi)

    mesh = local(plain) / exact(whole, dict(zip([c.name for c in coordinates], plain, strict=True)), state)[:N_COMPARED]
    np.testing.assert_allclose(local(x) / mesh, exact(whole, at, state)[:N_COMPARED], rtol=5e-4)


def test_derivatives_by_what_moves_are_those_of_differences(whole):
    coordinates = coordinates_of(whole, tuple(whole.terms.values()))
    x = np.zeros(len(coordinates))
    near = whole.about(coordinates, [x])
    found = near.modal(x, 0)
    for name in ("G_f", "density", "clamp_1_x", "width", "G_yz_ratio"):
        i = [c.name for c in coordinates].index(name)
        step = 1e-3 * coordinates[i].step * np.eye(x.size)[i]
        ends = [near.modal(x + sign * step, 0).eigenvalue for sign in (1.0, -1.0)]
        slope = (ends[0] - ends[1])[6:12] / (2.0 * step[i])
        k = list(found.moves).index(i)
        expected = np.diag(found.stiffness[k]) - found.eigenvalue * np.diag(found.mass[k])
        np.testing.assert_allclose(slope, expected[6:12], rtol=1e-3, atol=1e-4 * found.eigenvalue[11])


@pytest.mark.parametrize("state", [0, 1])
def test_on_the_small_basis_of_a_term_modes_are_those_of_the_large_one(whole, state):
    """A screening makes one for each term, from the local equations with all terms."""
    every = coordinates_of(whole, tuple(whole.terms.values()))
    large = whole.about(every, [np.zeros(len(every))])
    for term, name in (("clamp_mass", "clamp_added_mass"), ("contact_direction", "G_yz_ratio")):
        coordinates = coordinates_of(whole, [whole.terms[term]])
        (start, *_) = next(c.starts for c in coordinates if c.name == name)
        small = large.of(coordinates)
        assert small.size < large.size
        for share, within in ((0.0, 1e-5), (1.0, 2e-4)):
            at = {"G_f": 0.1, name: share * start, "young": -0.01}
            x = np.array([at.get(c.name, 0.0) for c in coordinates])
            all_of_them = np.array([at.get(c.name, 0.0) for c in every])
            value, expected = small.modal(x, state).eigenvalue, large.modal(all_of_them, state).eigenvalue
            np.testing.assert_allclose(value[6:], expected[6:], rtol=within)


def test_a_clamp_that_does_not_ride_adds_no_equations(whole):
    """With more equations than the base model a loose clamp without any looseness was likelier than that by e**13."""
    base, coordinates = whole.nuisances, coordinates_of(whole, [whole.terms["loose_clamp"]])
    neutral = np.zeros(len(coordinates))
    without = whole.about(base, [neutral[: len(base)]]).modal(neutral[: len(base)], 0).eigenvalue
    near = whole.about(coordinates, [neutral])
    np.testing.assert_allclose(near.modal(neutral, 0).eigenvalue[6:], without[6:], rtol=1e-4)
    rides = {"clamp_number": 0.0, "clamp_compliance": 1e-7}
    at = np.array(
        [coordinate_of(whole.parameters[c.name], rides[c.name]) if c.name in rides else 0.0 for c in coordinates]
    )
    assert near.modal(at, 0).eigenvalue.size > without.size


@pytest.mark.parametrize(("x", "y"), [(0.0, 0.333), (0.333, 0.0), (-0.5, 0.5), (0.0, 0.0)])
def test_a_screen_knows_what_a_mass_changes_wherever_it_sits(whole, x, y):
    """Fits start with a mass on the axes too, where one of its coordinates is neutral."""
    coordinates = coordinates_of(whole, [whole.terms["added_mass"]])
    names = [c.name for c in coordinates]
    near = whole.about(coordinates, [np.zeros(len(names))])
    at = np.zeros(len(names))
    at[[names.index(n) for n in ("added_mass", "added_x", "added_y")]] = 0.3, x, y
    _, every, here = near.solved(np.zeros(at.size), 0)
    expected = every.T @ (near.solved(at, 0)[2]["M"] - here["M"]) @ every[:, : whole.n_equation]
    change = near.screen(np.zeros(at.size), 0).change(at)
    assert np.abs(expected).max() > 1e-3
    np.testing.assert_allclose(change.mass[0][0], expected, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize(("name", "far"), [("clamp_added_mass", 0.02), ("G_yz_ratio", 0.15)])
def test_a_screen_turns_modes_of_a_changed_stack_into_errors_that_its_change_takes_back(whole, name, far):
    """The errors that a change leaves in the plain model's equations vanish as the screen adds that change."""
    coordinates = coordinates_of(whole, tuple(whole.terms.values()))
    i = [c.name for c in coordinates].index(name)
    near = whole.about(coordinates, [np.zeros(len(coordinates))])
    x = far * np.eye(len(coordinates))[i] * np.sign(coordinates[i].upper)
    changed, screen = near.modal(x, 0), near.screen(np.zeros(x.size), 0)
    seen = slice(changed.n_rigid, changed.n_rigid + N_SEEN)
    shape = screen.modal.rows @ np.linalg.lstsq(screen.modal.rows, changed.rows[:, seen])[0]
    each = np.broadcast_to(changed.damping, (N_SEEN, *changed.damping.shape[1:]))
    damping = np.einsum("rrr->r", each[:, seen, seen]) / (2.0 * np.sqrt(changed.eigenvalue[seen]))
    state = dataclasses.replace(
        whole.states[0],
        frequency=np.sqrt(changed.eigenvalue[seen]) / (2.0 * np.pi),
        damping=damping,
        shape=shape / np.linalg.norm(shape, axis=0),
    )
    errors = equation_errors(state, screen.modal, np.full(N_SEEN, 1e-4), x.size)
    value, loss = _changed(state, errors, screen.modal, screen.change(x))
    after = errors.value + value[:, 0].reshape(errors.value.shape)
    before, left = (np.sum(one * errors.weight, axis=1) for one in (errors.value, after))  # what sensors see surely
    np.testing.assert_allclose(left, 0.0, atol=0.05 * np.abs(before).max())
    if name == "clamp_added_mass":  # what modes beyond lose is left out
        np.testing.assert_allclose(errors.damping + loss[:, 0], 0.0, atol=0.2 * np.abs(errors.damping).max())
    step = screen.change(x * 1.001)
    assert step is not None
    slope = (_changed(state, errors, screen.modal, step)[0][:, 0] - value[:, 0]) / (1e-3 * x[i])
    np.testing.assert_allclose(value[:, 1], slope, rtol=0.02, atol=0.02 * np.abs(slope).max())


def test_a_finer_mesh_corrects_only_modes_that_its_model_was_reduced_for(whole):
    """A test at low torque has more modes in its band than the model was reduced for; a finer mesh only softens."""
    more = StackModel(
        whole.candidates, whole.tested, whole.observation, whole.scatter, whole.effects, n_equation=N_MODEL + 8
    )
    theta = more.theta({"G_f": -1.0}, 0)[0]
    change, inertia = more.finer_mesh(theta)
    vector = np.linalg.solve(more.equations.matrix("M", theta), inertia)
    eigenvalue = np.einsum("ij,ik,kj->j", vector, more.equations.matrix("K", theta), vector)
    share = np.diag(change)[6:] / eigenvalue[6:]
    assert np.all(share < 1e-3)
    assert np.all(share > -0.2)
    assert np.any(share < -1e-3)
