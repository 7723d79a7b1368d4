"""One lamina, which touches no other, and stacks that supports hold, which have no rigid-body motion."""

import numpy as np
import pytest
import scipy.linalg as la

import model
from model.effects.soft_interlayers import terms as soft_interlayers
from model.modes.refinement import refine
from model.stack.parts import EdgeSupport
from tests.enrichment import enriched
from updating.commands.model import solve

STEEL = model.Material(young=2e11, poisson=0.3, density=7850.0)
CONTACT = model.Contact(G_f=1000.0, d_f=1e-11, pressure=2e5, normal_modulus=1e9)
CLAMPED = EdgeSupport(edge="left", along=np.inf, across=np.inf, rotation=np.inf)
NOWHERE = model.Observation(node=[1], location=[[0.1, 0.0, 0.0]], direction=[[0.0, 0.0, 1.0]])
COMPLIANCE = model.find_effects(["support_compliance"])
FILE = """
name = "plate"
length_mm = 300
width_mm = 200
height_mm = 2
n_lamina = 1

[material]
young_GPa = 200
poisson = 0.3
density_kg_m3 = 7850

[mesh]
n_x = 4
n_y = 2
"""


def stack(n_lamina, *supports, **changes):
    contact = {"contact": CONTACT} if n_lamina > 1 else {}
    return model.Stack(
        name="plate",
        length=0.3,
        width=0.2,
        height=2e-3 * n_lamina,
        n_lamina=n_lamina,
        material=STEEL,
        mesh=model.Mesh(n_x=4, n_y=2),
        supports=supports,
        **{**contact, **changes},
    )


def frequencies(system, theta=None, n_mode=8):
    found = model.solve_modes(system, G_f=1000.0, d_f=0.0, n_mode=n_mode, observation=NOWHERE, parameters=theta)
    return found.frequency


def every_frequency(one, n_mode=8):
    assembly = model.assemble(one)
    stiffness, mass = (assembly.matrix(target, assembly.theta).toarray() for target in ("K", "M"))
    values = la.eigh(stiffness, mass, eigvals_only=True, subset_by_index=[0, n_mode - 1])
    return np.sqrt(np.maximum(values, 0.0)) / (2.0 * np.pi)


@pytest.mark.parametrize("n_lamina", [1, 4])
def test_a_held_stack_is_refined(n_lamina):
    system = model.reduce(stack(n_lamina, CLAMPED))
    found = refine(system, G_f=1000.0, n_mode=8)
    assert found.converged
    assert found.frequency[0] > 10.0
    np.testing.assert_allclose(found.frequency, frequencies(system), rtol=1e-4)


def test_one_lamina_is_free_of_its_contact():
    one = stack(1)
    assert model.reduce(one.with_contact(G_f=1.0, pressure=1.0)).size == model.reduce(one).size
    rigid, first = every_frequency(one)[5:7]
    assert rigid < 1e-3 * first
    np.testing.assert_allclose(frequencies(model.reduce(one))[6:], every_frequency(one)[6:], rtol=1e-6)


def test_effects_between_laminas_say_that_there_is_one():
    with pytest.raises(model.EffectError, match="soft_interlayers: the stack has one lamina"):
        soft_interlayers(model.assemble(stack(1)))


def test_a_file_of_one_lamina_needs_no_contact(tmp_path):
    path = tmp_path / "stack.toml"
    path.write_text(FILE)
    assert model.read_stack(path).n_lamina == 1
    path.write_text(FILE.replace("n_lamina = 1", "n_lamina = 2"))
    with pytest.raises(model.StackError, match=r"stack.toml: key contact.G_f is missing; it must be given"):
        model.read_stack(path)
    with pytest.raises(model.StackError, match="contact is missing; 2 laminas need it"):
        model.Stack(name="two", length=0.3, width=0.2, height=2e-3, n_lamina=2, material=STEEL)


def test_as_many_modes_of_a_held_stack_as_are_asked_for(tmp_path):
    path = tmp_path / "stack.toml"
    path.write_text(f'{FILE}\n[[supports]]\nedge = "left"\ncondition = "clamped"\n')
    modes, verification = solve(model.read_stack(path), (path,), tmp_path / "out", 3, 1e-4)
    assert modes.frequency.size == 3
    assert verification.error.shape == (3,)


@pytest.mark.parametrize(("translation", "rotation"), [(1e8, 1e3), (1e6, 1e7), (1e4, 0.1)])
def test_an_edge_gives_way_as_springs_of_the_stack_file_do(translation, rotation):
    soft = EdgeSupport(edge="left", along=translation, across=translation, rotation=rotation)
    given = stack(1, CLAMPED).with_effects(*COMPLIANCE, edge_translation=translation, edge_rotation=rotation)
    np.testing.assert_allclose(every_frequency(given), every_frequency(stack(1, soft)), rtol=2e-4, atol=0.3)


def test_an_edge_is_as_the_stack_file_says_until_it_gives_way():
    held = stack(1, CLAMPED)
    np.testing.assert_allclose(every_frequency(held.with_effects(*COMPLIANCE)), every_frequency(held), rtol=1e-9)


def test_a_basis_of_a_held_stack_is_enriched_from_its_first_mode_on():
    one = stack(1, CLAMPED).with_effects(*COMPLIANCE)
    theta = {"edge_translation": 1e8, "edge_rotation": 1e3}
    system = model.reduce(one, n_snapshot=1)
    right = every_frequency(one.with_effects(**theta))
    assert np.abs(frequencies(system, theta) / right - 1.0).max() > 0.02
    better = enriched(system, [theta], 12)
    np.testing.assert_allclose(frequencies(better, theta), right, rtol=1e-4)
