"""Many specimens as the inference asks for them: what each coordinate moves, and what a linear step promises."""

import dataclasses
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from model import Mesh, Observation, catalogue, read_stack
from model.effects.parts import known_or_usual_instruments
from updating.diagnosis import evidence
from updating.diagnosis.candidates import candidate_model
from updating.diagnosis.evidence import DiagnosisScatter
from updating.diagnosis.stack_model import StackModel
from updating.inference.discrepancy import Sizes
from updating.inference.explain import coordinates_of, errors_at, setting
from updating.inference.tree import Tree
from updating.pooled.screening import Bordered
from updating.pooled.specimen import Group, levels_of
from updating.pooled.specimens_model import SpecimensModel

STACK = dataclasses.replace(
    read_stack(Path(__file__).parents[2] / "data/demo_stack/stack.toml"), n_lamina=40, mesh=Mesh(n_x=8, n_y=2)
)
N_SEEN = 6
NAMES = ("S1", "S2", "S3")
HIGHER = 1.01
SIZES = Sizes(stiffness=4e-3, damping=0.1)


@pytest.fixture(scope="module")
def whole():
    """Three specimens, the last of them higher, with modes that are nobody's."""
    instruments = known_or_usual_instruments(STACK)
    effects = {name: catalogue()[name] for name in ("clamp_mass", "contact_direction", "loose_clamp")}
    n = len(instruments.sensor)
    seen = Observation(node=np.arange(n), location=instruments.sensor, direction=np.tile([0.0, 0.0, 1.0], (n, 1)))
    rng, tested, specimens = np.random.default_rng(0), [], []
    for name in NAMES:
        one = []
        for state, pressure in (("M1", 160e3), ("M2", 320e3)):
            modes = SimpleNamespace(
                frequency=np.linspace(200.0, 700.0, N_SEEN) * (1.0 + 0.01 * rng.standard_normal(N_SEEN)),
                frequency_std=np.full(N_SEEN, 0.01), sensor=np.arange(n) % 2,
                damping=np.full(N_SEEN, 0.01), damping_std=np.full(N_SEEN, 1e-4),
                shape=rng.standard_normal((n, N_SEEN)) + 0j, shape_std=np.full((n, N_SEEN), 0.01),
            )  # fmt: skip
            tested.append(evidence.Tested(name=f"{name} {state}", pressure=pressure, modes=modes, state=state))
            one.append((state, pressure, modes))
        height = STACK.height * (HIGHER if name == "S3" else 1.0)
        notes = {"treatment": "none" if name == "S1" else "glued"}
        stack = dataclasses.replace(STACK, height=height)
        specimens.append(SimpleNamespace(name=name, stack=stack, tested=tuple(one), notes=notes))
    candidates = candidate_model(STACK, instruments, effects)
    model = StackModel(candidates, tested, [seen] * len(tested), DiagnosisScatter())
    group = Group(members=(0, 1, 2), model=model, first=(0, 2, 4, 6), start=(0.0, 0.0))
    return SpecimensModel(specimens, [group], levels_of(specimens))


def near(whole, terms=()):
    coordinates = coordinates_of(whole, [whole.terms[n] for n in terms])
    return coordinates, whole.about(coordinates, [np.zeros(len(coordinates))])


def at(coordinates, **values):
    named = {name.replace("__", "@"): value for name, value in values.items()}
    return np.array([named.get(c.name, 0.0) for c in coordinates])


def test_what_specimens_share_and_what_is_their_own_add_up(whole):
    coordinates, local = near(whole)
    x = at(coordinates, young=0.01, G_f=0.1)
    x[[c.name for c in coordinates].index("young[S2]")] = 0.02
    shared = at(coordinates, young=0.03, G_f=0.1)
    for state in whole.states_of[1]:
        found, expected = local.modal(x, state), local.modal(shared, state)
        np.testing.assert_allclose(found.eigenvalue, expected.eigenvalue, rtol=1e-12)
    other, same = (local.modal(z, 0).eigenvalue for z in (x, at(coordinates, young=0.01, G_f=0.1)))
    np.testing.assert_allclose(other, same, rtol=1e-12)


def test_a_clamp_that_rides_in_one_specimen_adds_as_many_equations_to_all(whole):
    """States with other numbers of equations have no discrepancy in common: no such clamp could be fitted."""
    (name,) = (n for n in whole.terms if n.startswith("loose_clamp") and "S2" in n)
    coordinates, local = near(whole, [name])
    x = np.zeros(len(coordinates))
    before = {local.modal(x, state).eigenvalue.size for state in range(len(whole.states))}
    for i, c in enumerate(coordinates):
        if c.name.startswith(("clamp_compliance", "clamp_number")):
            x[i] = c.upper
    after = {local.modal(x, state).eigenvalue.size for state in range(len(whole.states))}
    assert len(before) == len(after) == 1
    assert after.pop() > before.pop()


def test_a_specimen_stands_where_its_height_does(whole):
    coordinates, local = near(whole)
    lower, higher = (local.modal(np.zeros(len(coordinates)), whole.states_of[s][0]) for s in (0, 2))
    taller = np.zeros(len(coordinates))
    taller[[c.name for c in coordinates].index("height[S1]")] = np.log(HIGHER)
    np.testing.assert_allclose(local.modal(taller, 0).eigenvalue, higher.eigenvalue, rtol=1e-12)
    assert np.abs(higher.eigenvalue[-1] / lower.eigenvalue[-1] - 1.0) > 1e-3


@pytest.mark.parametrize(
    ("term", "members"), [("clamp_mass", (0, 1, 2)), ("clamp_mass@treatment = glued", (1, 2)), ("clamp_mass@S2", (1,))]
)
def test_a_term_changes_the_specimens_that_have_it(whole, term, members):
    coordinates, local = near(whole, [term])
    x = np.zeros(len(coordinates))
    x[-1] = 0.2
    for s, states in enumerate(whole.states_of):
        for state in states:
            plain, heavy = (local.modal(z, state) for z in (np.zeros(x.size), x))
            assert np.allclose(plain.eigenvalue, heavy.eigenvalue, rtol=1e-9) == (s not in members)
            assert (x.size - 1 in heavy.touched) == (s in members)
    assert set(whole.terms[term].states) == {c for s in members for c in whole.states_of[s]}


def test_derivatives_stand_at_the_coordinates_that_they_are_by(whole):
    coordinates, local = near(whole)
    modal = local.modal(np.zeros(len(coordinates)), 2)  # M1 of S2
    names = [coordinates[modal.touched[i]].name for i in modal.moves]
    assert {"young", "young[S2]", "G_f[S2]", "G_f[S2 M1]"} <= set(names)
    assert not {"young[S1]", "G_f[S2 M2]", "G_f[S1 M1]"} & set(names)
    by = dict(zip(names, modal.stiffness, strict=True))
    np.testing.assert_allclose(by["young"], by["young[S2]"])
    np.testing.assert_allclose(by["G_f"], by["G_f[S2 M1]"])


def test_prior_of_what_is_shared_and_of_what_is_own_is_that_of_one_stack(whole):
    std = {c.name: c.std for c in whole.nuisances}
    alone = {c.name: c.std for c in whole.first.nuisances}
    for name in ("young", "density", "length"):
        assert np.hypot(std[name], std[f"{name}[S1]"]) == pytest.approx(alone[name])


@pytest.mark.parametrize("term", ["clamp_mass", "clamp_mass@treatment = glued", "clamp_mass@S2"])
def test_a_border_promises_what_a_linear_step_of_all_brings(whole, term):
    coordinates, local = near(whole, [term])
    x = np.zeros(len(coordinates))
    tree = Tree(paths=tuple(s.path for s in whole.states), shares=(0.6, 0.2, 0.2))
    common = dataclasses.replace(setting(whole, local, x, shares=tree.shares), tree=tree)
    problem = common.join(errors_at(whole, local, common, x), x.size)
    precision = np.array([c.std**-2.0 for c in coordinates])
    weighed = problem.weighed(SIZES)
    hessian = weighed.hessian + problem.curvature + np.diag(precision + 1e-12)
    slope = weighed.slope + problem.beside(SIZES).sum(axis=0)
    with_it = slope @ np.linalg.solve(hessian, slope)
    without = slope[:-1] @ np.linalg.solve(hessian[:-1, :-1], slope[:-1])
    step = -np.linalg.solve(hessian, slope)

    by_rig, everywhere = near(whole, ["clamp_mass"])
    errors = errors_at(whole, everywhere, common, np.zeros(len(by_rig)))
    bordered = Bordered(whole, common.join(errors, len(by_rig)), SIZES, np.zeros(len(by_rig) - 1), precision[:-1])
    free = dataclasses.replace(coordinates[-1], lower=-np.inf, upper=np.inf)
    members = whole.meant[term].level.members
    gain, value, base, _ = bordered.added(members, [len(by_rig) - 1], [free], np.zeros(1))
    volume = np.linalg.slogdet(hessian)[1] - np.linalg.slogdet(hessian[:-1, :-1])[1] - np.log(precision[-1])
    assert value[0] == pytest.approx(step[-1], rel=1e-5)
    np.testing.assert_allclose(base(), step[:-1], atol=1e-5 * np.abs(step).max())
    assert gain == pytest.approx(0.5 * (with_it - without) - 0.5 * volume, rel=1e-4, abs=1e-3)
