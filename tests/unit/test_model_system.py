import contextlib
import dataclasses

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse.linalg as splinalg

import model
from model.contact.contact import normal_krons, tangential_krons
from model.effects.parts import turn_of
from model.elements.equations import Product
from model.reduction.effect_basis import second_answers, shaping
from model.reduction.projection import projected_terms
from model.reduction.through_thickness import shear_shift
from model.solvers.stack_solver import solver_over_laminas, solver_over_plan
from tests.full_matrices import lowest_modes

MATERIAL = model.Material(young=2e11, poisson=0.28, density=7650.0)
CONTACT = model.Contact(G_f=825.0, d_f=5e-11, pressure=320e3, normal_modulus=5e9)
STACK = model.Stack(
    name="small",
    length=0.3,
    width=0.08,
    height=0.065,
    n_lamina=8,
    material=MATERIAL,
    contact=CONTACT,
    clamps=(model.Clamp(mass=2.0, x=0.05, y=0.0, distribution="faces", footprint=(0.04, 0.06)),),
    mesh=model.Mesh(n_x=4, n_y=2),
)


def uneven(stack: model.Stack) -> model.Assembly:
    """Return the stack with interfaces of random stiffness, one nearly loose, and pressure falling along x."""
    assembly = model.assemble(stack)
    rng = np.random.default_rng(1)
    modulus = rng.uniform(0.5, 1.5, stack.n_lamina - 1)  # per mean pressure
    modulus[2] *= 0.01
    x = assembly.plan.quadrature_points[0]
    weight = 1.0 + 2.0 * x / stack.length * 0.8
    contact = {
        "tangential contact": tangential_krons(assembly.plan, stack.pitch, modulus, weight),
        "normal contact": normal_krons(assembly.plan, stack.pitch, 1e4 * CONTACT.pressure * modulus, weight),
    }
    terms = tuple(dataclasses.replace(term, krons=contact.get(term.name, term.krons)) for term in assembly.terms)
    return dataclasses.replace(assembly, terms=terms)


def full_frequencies(assembly: model.Assembly, n: int) -> np.ndarray:
    return lowest_modes(assembly, n)[0]


@pytest.mark.parametrize("target", ["M", "C", "K"])
def test_products_without_the_matrix_agree_with_the_matrix(target):
    assembly = uneven(STACK)
    x = np.random.default_rng(0).standard_normal((assembly.size, 3))
    matrix = assembly.matrix(target, assembly.theta)
    np.testing.assert_allclose(
        assembly.apply(assembly.krons(target, assembly.theta), x), matrix @ x, atol=1e-12 * abs(matrix).max()
    )
    assert abs(matrix - matrix.T).max() <= 1e-12 * abs(matrix).max()


@pytest.mark.parametrize("cut", [solver_over_plan, solver_over_laminas])
def test_chain_solution_agrees_with_the_full_sparse_matrices(cut):
    assembly = uneven(STACK)
    start = np.random.default_rng(0).standard_normal((assembly.size, 18))
    values, vectors = cut(assembly).modes(assembly.theta, (2 * np.pi * 200) ** 2, start, 14, 1e-10)
    expected = full_frequencies(assembly, 14)
    np.testing.assert_allclose(np.sqrt(values[6:]) / (2 * np.pi), expected[6:], rtol=1e-7)
    mass = vectors.T @ (assembly.matrix("M", assembly.theta) @ vectors)
    np.testing.assert_allclose(mass, np.eye(vectors.shape[1]), atol=1e-8)


@pytest.mark.parametrize("name", model.catalogue())
def test_an_effect_that_couples_places_far_apart_is_solved_exactly(name):
    """With fewer through-thickness functions for w than for u and v, as a stack's own have."""
    effect = model.catalogue()[name]
    values = {p.name: p.nominal for p in effect.parameters}
    try:
        laminas = model.assemble(STACK.with_effects(effect, **values))
    except model.EffectError as error:
        pytest.skip(str(error))
    z = np.polynomial.legendre.legvander(np.linspace(-1.0, 1.0, STACK.n_lamina), 3)
    assembly = laminas.project_z({"u": z, "v": z, "w": z[:, :3]})
    theta, shift = assembly.theta, (2 * np.pi * 200) ** 2
    right = np.random.default_rng(2).standard_normal((assembly.size, 2))
    found = solver_over_plan(assembly).factor(theta, shift).solve(right)
    back = assembly.matrix("K", theta) @ found + shift * (assembly.matrix("M", theta) @ found)
    np.testing.assert_allclose(back, right, atol=1e-6 * np.abs(right).max())


def test_projection_agrees_with_the_full_sparse_matrices():
    stack = STACK.with_effects(
        *model.find_effects(["edge_pressure", "stinger_mass"]), edge_excess=0.4, stinger_moving_mass=0.1
    )
    assembly = model.assemble(stack)
    rng = np.random.default_rng(3)
    basis = rng.standard_normal((assembly.size, 5))
    number, projected = projected_terms(assembly, basis)
    found = list(projected)
    for i, term in zip(number, assembly.terms, strict=True):
        expected = basis.T @ (assembly.sparse_sum(term.krons) @ basis)
        np.testing.assert_allclose(found[i], expected, atol=1e-12 * abs(expected).max())


def test_products_that_share_their_matrix_over_z_are_summed():
    assembly = model.assemble(dataclasses.replace(STACK, clamps=(model.Clamp(mass=2.0, x=0.05, y=0.0),)))
    assert len(assembly.krons("M", assembly.theta)) == 3  # sheets and clamp together, for u, v and w


def test_parameters_that_act_over_the_plan_alone_shape_no_functions_of_z():
    names = ("edge_pressure", "fill_factor", "height_gradient", "soft_interlayers", "normal_stiffness")
    assembly = model.assemble(STACK.with_effects(*model.find_effects(names)))
    values = ("edge_excess", "fill_ratio", "height_excess", "interlayer_loss", "normal_ratio")
    assert shaping(assembly, values) == {"height_excess", "interlayer_loss"}
    assert shaping(assembly, ("G_f", "density")) == {"G_f"}


FIELDS_OF_PRESSURE = ("lost_contact_middle", "height_gradient", "soft_interlayers")
LOST = {"middle_loss": 0.6, "height_excess": 0.3, "interlayer_loss": 0.2}


def stiffness_times(stack, vector, **values):
    assembly = model.assemble(stack)
    return assembly.apply(assembly.krons("K", {**assembly.theta, **values}), vector[:, None])


def test_a_ratio_along_y_acts_on_what_is_left_of_the_pressure():
    """Without stiffness along y, sheets that slide along y feel nothing of a pressure that is lost somewhere."""
    stack = STACK.with_effects(*model.find_effects(["contact_direction", *FIELDS_OF_PRESSURE]))
    assembly = model.assemble(stack)
    sliding = np.zeros(assembly.size)
    sliding[assembly.slices()["v"]] = np.random.default_rng(0).standard_normal(assembly.plan.size("v") * 8)
    free = stiffness_times(stack, sliding, G_yz_ratio=0.0)
    np.testing.assert_allclose(
        stiffness_times(stack, sliding, G_yz_ratio=0.0, **LOST), free, atol=1e-10 * abs(free).max()
    )
    assert abs(stiffness_times(stack, sliding, **LOST) - stiffness_times(stack, sliding)).max() > 1e-3 * abs(free).max()


def test_a_power_of_0_knows_no_pressure():
    stack = STACK.with_effects(*model.find_effects(["pressure_exponent", "lost_contact_middle"]))
    vector = np.random.default_rng(0).standard_normal(model.assemble(stack).size)
    even = stiffness_times(stack, vector, exponent=0.0)
    lost = stiffness_times(stack, vector, exponent=0.0, middle_loss=0.6)
    np.testing.assert_allclose(lost, even, atol=1e-10 * abs(even).max())


def test_rigid_body_motion_has_no_strain_energy():
    stack = dataclasses.replace(STACK, clamps=())
    assembly = uneven(stack)
    values = full_frequencies(assembly, 8)
    assert np.all(values[:6] < 0.01)
    assert values[6] > 10.0


def test_tangential_contact_resists_slip_of_the_facing_surfaces():
    # u[k] = -z[k] dw/dx is a rotation of the whole stack without slip; u alone slides every interface.
    assembly = model.assemble(STACK)
    where, plan = assembly.slices(), assembly.plan
    sliding, turning = np.zeros((2, assembly.size))
    sliding[where["u"]] = np.outer(STACK.lamina_z, plan.interpolate("u", (1.0, 0.0, 0.0))).ravel()
    turning[where["u"]] = -sliding[where["u"]]
    turning[where["w"]] = np.outer(np.ones(8), plan.interpolate("w", (0.0, 1.0, 0.0))).ravel()
    contact = next(t for t in assembly.terms if t.name == "tangential contact").krons
    energy = [float(x @ assembly.apply(contact, x[:, None])[:, 0]) for x in (sliding, turning)]
    volume = STACK.length * STACK.width * 7 * STACK.pitch
    assert energy[0] == pytest.approx(volume, rel=1e-9)  # the factor G_f p comes on top
    assert abs(energy[1]) < 1e-9 * energy[0]


def test_monomial_derivative():
    factor = model.Monomial(exponent={"G_f": 1, "d_f": 2})
    theta = {"G_f": 3.0, "d_f": 5.0, "other": 7.0}
    assert factor(theta) == 75.0
    assert [factor.derivative(theta, name) for name in theta] == [25.0, 30.0, 0.0]


def test_product_derivative():
    power = model.Monomial(exponent={"G_f": 1, "d_f": 2})
    factor = Product(first=power, second=model.Formula(lambda t: t["other"] * t["d_f"]))
    theta = {"G_f": 3.0, "d_f": 5.0, "other": 7.0, "idle": 1.0}
    assert factor(theta) == 2625.0
    assert [factor.derivative(theta, name) for name in theta] == [875.0, 1575.0, 375.0, 0.0]
    assert factor.names(theta) == {"G_f", "d_f", "other"}


def test_clamp_mass_is_its_mass_in_every_direction():
    assembly = model.assemble(STACK)
    clamp = next(t for t in assembly.terms if t.name == "clamp 0 mass").krons
    for field in ("u", "v", "w"):
        x = np.zeros((assembly.size, 1))
        x[assembly.slices()[field], 0] = np.tile(assembly.plan.interpolate(field, (1.0, 0.0, 0.0)), 8)
        assert float(x[:, 0] @ assembly.apply(clamp, x)[:, 0]) == pytest.approx(2.0, rel=1e-9)


@pytest.fixture(scope="module")
def with_catalogue():
    """A stack reduced with all effects that it can have, all neutral."""
    assembly, possible = model.assemble(STACK), []
    for effect in model.catalogue().values():
        with contextlib.suppress(model.EffectError):
            effect.terms(assembly)
            possible.append(effect)
    return model.reduce(STACK.with_effects(*possible), n_snapshot=1, n_mode=8)


def test_the_stack_without_effects_has_its_modes_on_the_first_coordinates(with_catalogue):
    base = with_catalogue.base(("pressure", "G_f", "d_f"))
    assert base.size == with_catalogue.n_base < with_catalogue.size / 2
    assert len(base.terms) < len(with_catalogue.terms)
    for target in ("M", "C", "K"):
        whole = with_catalogue.matrix(target, {**with_catalogue.theta, "pressure": 2e5, "omega": 4000.0})
        there = base.matrix(target, {**with_catalogue.theta, "pressure": 2e5, "omega": 4000.0})
        np.testing.assert_allclose(there, whole[: base.size, : base.size], atol=1e-12 * abs(whole).max())
    exact = model.reduce(STACK, n_snapshot=1, n_mode=8)
    for one in (base, with_catalogue):
        mine, right = (
            la.eigh(each.matrix("K", each.theta), each.matrix("M", each.theta), eigvals_only=True)[6:8]
            for each in (one, exact)
        )
        np.testing.assert_allclose(mine, right, rtol=1e-4)


def test_second_answers_are_what_a_strong_effect_answers_to_its_first_answers():
    (effect,) = model.find_effects(["waviness"])
    (amplitude,) = effect.parameters
    effect = dataclasses.replace(effect, parameters=(dataclasses.replace(amplitude, nominal=0.9),))
    system = model.reduce(STACK.with_effects(effect), n_mode=12)
    assembly, theta, base = system.assembly, system.theta, system.basis[:, : system.n_base]
    shift = shear_shift(STACK, theta)
    held = assembly.matrix("K", theta) + shift * assembly.matrix("M", theta)
    strong = {**theta, **{p.name: p.nominal for p in effect.parameters}}
    change = assembly.matrix("K", strong) - assembly.matrix("K", theta)
    value, modes = la.eigh(system.base(()).matrix("K", theta), system.base(()).matrix("M", theta))
    base = base @ modes[:, :12]
    answer = base[:, 6:] / np.sqrt(value[6:12])
    solve = splinalg.splu(held.tocsc(), permc_spec="MMD_AT_PLUS_A").solve
    for _ in range(2):
        answer = solve(change @ answer)

    def energy_beside(known):
        left = answer - known @ la.solve(known.T @ (held @ known), known.T @ (held @ answer))
        return np.linalg.eigvalsh(left.T @ (held @ left))[-1]

    factor = solver_over_plan(assembly).factor(theta, shift)
    found = second_answers(assembly, [effect], factor, theta, (value[6:12], base[:, 6:]), base, 1e-7)
    assert energy_beside(base) > 2e-6
    assert energy_beside(np.hstack([base, found])) < 1e-7


def test_a_reduction_answers_to_an_inertia_at_stations_that_it_was_not_made_for():
    strong = {"clamp_roll_inertia": 0.01, "clamp_station": 0.3}
    corners = model.Observation(
        node=[1, 2], location=[[0.15, 0.04, 0.0325], [0.15, -0.04, 0.0325]], direction=[[0.0, 0.0, 1.0]] * 2
    )

    def solved(system, values):
        one = {"G_f": CONTACT.G_f, "d_f": 0.0, "n_mode": 10, "observation": corners, "parameters": values, "by": ()}
        return model.solve_modes(system, **one).elastic().frequency

    neutral = model.reduce(STACK.with_effects(*model.find_effects(["clamp_inertia"])))
    exact = model.reduce(STACK.with_effects(*model.find_effects(["clamp_inertia"]), **strong), n_mode=24)
    before, after = solved(neutral, {}), solved(exact, {})
    assert np.min(after / before) < 0.9
    np.testing.assert_allclose(solved(neutral, strong), after, rtol=2e-3)


def test_a_clamp_on_a_point_turns_with_the_slope_there_as_one_on_little_does():
    assembly = model.assemble(STACK)
    point, little = (turn_of(assembly, (0.05, 0.0), (length, 0.0), "x").toarray() for length in (0.0, 1e-4))
    assert np.abs(point).max() > 0.0
    np.testing.assert_allclose(point, little, atol=1e-3 * np.abs(point).max())
