import dataclasses
from pathlib import Path

import numpy as np
import pytest

import model
from model.contact.contact import SEPARATION
from model.contact.pressing import press, separate
from model.effects.parts import centred
from model.elements.mesh import rectangle
from model.stack.parts import Interlayer, Pressing, read_curve
from tests.full_matrices import lowest_modes

CURVE = read_curve(Path(__file__).parents[2] / "data/contact/compression_standin.csv")
STACK = model.Stack(
    name="pressed",
    length=0.3,
    width=0.06,
    height=0.032,
    n_lamina=20,
    material=model.Material(young=2e11, poisson=0.28, density=7650.0),
    contact=model.Contact(G_f=1000.0, d_f=5e-11, pressure=320e3, normal_modulus=1e9),
    clamps=(model.Clamp(mass=0.0, x=0.02, y=0.0, footprint=(0.06, 0.05)),),
    mesh=model.Mesh(n_x=8, n_y=2),
    pressing=Pressing(curve=CURVE, plate_rigidity=1e4),
)


def energy(assembly, name, x):
    """Return twice the energy of a term where G_f and d_f are 1."""
    term = assembly.term(name)
    factor = term.factor({**assembly.theta, "G_f": 1.0, "d_f": 1.0})
    return factor * float(x @ assembly.apply(term.krons, x[:, None])[:, 0])


def stretched(assembly: model.Assembly, stack: model.Stack, field: str) -> np.ndarray:
    """Return the displacement u = z or w = z of all laminas."""
    x = np.zeros(assembly.size)
    x[assembly.slices()[field]] = np.outer(stack.lamina_z, assembly.plan.interpolate(field, (1, 0, 0))).ravel()
    return x


def test_contact_stiffness_and_damping_are_integrals_of_the_field():
    field = press(STACK)
    stack = dataclasses.replace(STACK, pressing=field)
    assembly = model.assemble(stack)
    p, tangent = field.at(field.plan.quadrature_points.reshape(2, -1).T)
    area = field.plan.membrane.dx.ravel()
    u, w = (stretched(assembly, stack, f) for f in ("u", "w"))
    pitch = STACK.pitch
    # slip of one pitch at every interface: the shear modulus is p per unit of G_f, so only the force counts
    assert energy(assembly, "tangential contact", u) == pytest.approx(19 * pitch * field.force, rel=1e-6)
    assert energy(assembly, "normal contact", w) == pytest.approx(np.sum(tangent * area) * pitch, rel=1e-5)
    assert energy(assembly, "tangential contact damping", u) == pytest.approx(np.sum(p**2 * area) * pitch, rel=1e-5)
    assert energy(assembly, "normal contact damping", w) == pytest.approx(np.sum(p * tangent * area) * pitch, rel=1e-5)
    assert field.pressure.max() > 2 * field.mean  # an even field would prove nothing


def test_pressing_and_its_frozen_field_give_the_same_equations():
    frozen = model.assemble(dataclasses.replace(STACK, pressing=press(STACK)))
    direct = model.assemble(STACK)
    difference = frozen.matrix("K", frozen.theta) - direct.matrix("K", direct.theta)
    assert abs(difference).max() == 0.0


def test_a_stack_is_pressed_once_for_all_its_effects(monkeypatch):
    pressed = []
    monkeypatch.setattr("model.contact.pressing.press", lambda stack: (pressed.append(stack), press(stack))[1])
    assembly = model.assemble(
        STACK.with_effects(*model.find_effects(["contact_direction", "edge_pressure", "soft_interlayers"]))
    )
    assert len(pressed) == 1
    assert assembly.stack.pressing.mean == pytest.approx(320e3)


def test_even_pressure_gives_the_equations_of_uniform_pressure():
    clamp = dataclasses.replace(STACK.clamps[0], x=0.0)
    even = dataclasses.replace(STACK, clamps=(clamp,), pressing=Pressing(curve=CURVE))
    tangent = float(CURVE.evaluate(np.array(CURVE.strain_at(320e3)))[1])
    uniform = dataclasses.replace(even, pressing=None).with_contact(normal_modulus=tangent)
    for target in ("K", "C"):
        a, b = (s.matrix(target, s.theta) for s in (model.assemble(even), model.assemble(uniform)))
        assert abs(a - b).max() <= 1e-7 * abs(b).max()


def test_reduced_frequencies_are_those_of_the_full_matrices_under_an_uneven_field():
    stack = dataclasses.replace(STACK, pressing=press(STACK), mesh=model.Mesh(n_x=6, n_y=1))
    assembly = model.assemble(stack)
    exact = lowest_modes(assembly, 12)[0][6:]
    system = model.reduce(stack, n_snapshot=1, G_f_range=(900.0, 1100.0))
    place = model.Observation(node=[1], location=[[0.15, 0.03, 0.0]], direction=[[0.0, 0.0, 1.0]])
    found = model.solve_modes(system, G_f=1000.0, d_f=5e-11, n_mode=12, observation=place).frequency[6:]
    np.testing.assert_allclose(found, exact, rtol=5e-5)


def test_a_field_is_separated_within_the_tolerance():
    field = press(STACK)
    value = field.pressure.reshape(19, -1)
    found = separate(value, SEPARATION)
    rebuilt = found.over_z.T @ found.over_plan
    assert np.abs(rebuilt - value).max() <= SEPARATION * value.max()
    assert np.abs(rebuilt - value).max() == pytest.approx(found.error * value.max(), rel=1e-6, abs=1e-9)
    assert 1 < found.over_z.shape[0] <= 10
    assert separate(np.zeros((3, 4)), 1e-6).over_z.shape == (0, 3)


def test_a_field_for_another_pressure_is_refused():
    pressed = dataclasses.replace(STACK, pressing=press(STACK))
    with pytest.raises(model.StackError, match="mean of 320 kPa, its contact a pressure of 160 kPa"):
        pressed.with_contact(pressure=160e3)
    assert STACK.with_contact(pressure=160e3).contact.pressure == 160e3


def test_a_soft_layer_takes_the_place_of_contact():
    layer = Interlayer(below=10, thickness=2e-3, shear_modulus=1e6, normal_modulus=5e7, density=1200.0)
    stack = dataclasses.replace(STACK, interlayers=(layer,), height=0.034, pressing=None)
    assert stack.pitch == pytest.approx(STACK.pitch)
    assert stack.lamina_z[[0, -1]] == pytest.approx([-0.017 + 0.0008, 0.017 - 0.0008])
    assembly = model.assemble(stack)
    u, w = (stretched(assembly, stack, f) for f in ("u", "w"))
    area, gap = 0.3 * 0.06, 2e-3 + STACK.pitch
    # strain 1 over the spacing means a slip of gap, all of it in the layer
    assert energy(assembly, "interlayers", u) == pytest.approx(1e6 * (gap / 2e-3) * gap * area, rel=1e-9)
    assert energy(assembly, "interlayers", w) == pytest.approx(5e7 * (gap / 2e-3) * gap * area, rel=1e-9)
    assert energy(assembly, "tangential contact", u) == pytest.approx(320e3 * 18 * STACK.pitch * area, rel=1e-9)
    rigid = np.zeros(assembly.size)
    rigid[assembly.slices()["w"]] = np.tile(assembly.plan.interpolate("w", (1, 0, 0)), 20)
    assert energy(assembly, "interlayer mass", rigid) == pytest.approx(1200.0 * 2e-3 * area, rel=1e-9)
    assert stack.mass == pytest.approx(area * (7650.0 * 0.032 + 2.4), rel=1e-12)


@pytest.mark.parametrize("n_x", [4, 18])
def test_what_is_lost_at_the_ends_is_counted_there_on_every_mesh(n_x):
    """The last quadrature point lies within the last element: on 4 elements 14 % less was lost there than was said."""
    plan = rectangle(0.4, 0.1, n_x, 2)
    x, _ = plan.quadrature_points

    def shape(x):
        return -((x / 0.2) ** 2)

    change = centred(shape(x), np.asarray(plan.membrane.dx), shape(plan.membrane.mesh.p[0]))
    np.testing.assert_allclose(change, (1.0 / 3.0 - (x / 0.2) ** 2) / (2.0 / 3.0), atol=1e-3)
