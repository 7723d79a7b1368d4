import dataclasses

import numpy as np
import pytest
from scipy.sparse import linalg as splinalg

import model
from model.modes.modes import full_parameters
from tests.full_matrices import lowest_modes

STACK = model.Stack(
    name="small",
    length=0.3,
    width=0.08,
    height=0.065,
    n_lamina=24,
    material=model.Material(young=2e11, poisson=0.28, density=7650.0),
    contact=model.Contact(G_f=825.0, d_f=2e-11, pressure=320e3, normal_modulus=5e9),
    clamps=(model.Clamp(mass=1.0, x=0.08, y=0.01, distribution="faces", footprint=(0.04, 0.05)),),
    mesh=model.Mesh(n_x=6, n_y=2),
)
CORNERS = model.Observation(
    node=[1, 2, 3, 4],
    location=[[0.15, 0.04, 0.04], [0.15, -0.04, 0.0], [-0.15, 0.04, 0.0], [0.03, 0.0, -0.04]],
    direction=[[0.0, 0.0, 1.0], [0.0, 0.6, 0.8], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]],
)


@pytest.fixture(scope="module")
def system():
    return model.reduce(STACK)


def full(theta, n):
    assembly = model.assemble(STACK)
    frequency, vectors = lowest_modes(assembly, n, **theta)
    damping = assembly.matrix("C", {**assembly.theta, **theta})
    return frequency, np.einsum("ir,ir->r", vectors, damping @ vectors) / (4 * np.pi * frequency)


@pytest.mark.parametrize("G_f", [300.0, 825.0, 2500.0])
def test_reduced_modes_agree_with_the_full_matrices(system, G_f):
    modes = model.solve_modes(system, G_f=G_f, d_f=3e-11, n_mode=16, observation=CORNERS)
    frequency, damping = full({"G_f": G_f, "d_f": 3e-11}, 16)
    assert modes.n_rigid == 6
    assert np.all(modes.frequency[:6] == 0.0)
    np.testing.assert_allclose(modes.elastic().frequency, frequency[6:], rtol=5e-5)
    np.testing.assert_allclose(modes.elastic().damping, damping[6:], rtol=2e-3)


def test_rounding_beside_very_stiff_motion_is_no_negative_stiffness(system):
    """A basis can hold motion 1e10 times stiffer than the first modes; rigid-body motion is 0 to its rounding."""
    stiff = np.random.default_rng(1).standard_normal(system.size)
    stiff[:6] *= np.finfo(float).eps  # rounding couples it with rigid-body motion
    last = system.terms[-1]
    hard = dataclasses.replace(
        last, name="stiff", target="K", factor=model.Monomial(exponent={}), matrix=1e15 * np.outer(stiff, stiff)
    )
    harder = dataclasses.replace(system, terms=(*system.terms, hard))
    modes = model.solve_modes(harder, G_f=825.0, d_f=3e-11, n_mode=10, observation=CORNERS, by=())
    assert modes.n_rigid == 6
    assert np.all(modes.frequency[:6] == 0.0)
    assert modes.frequency[6] > 100.0


@pytest.fixture(scope="module")
def relaxing():
    """Return a stack whose contact is stiffer at higher frequencies."""
    (effect,) = model.find_effects(["viscoelastic_contact"], model.catalogue())
    reduced = model.reduce(STACK.with_effects(effect))
    return dataclasses.replace(reduced, theta={**reduced.theta, effect.parameters[0].name: 0.08})


@pytest.mark.parametrize("which", ["system", "relaxing"])
def test_derivatives_agree_with_finite_differences(which, request):
    system = request.getfixturevalue(which)
    step = {
        "G_f": 1e-2,
        "d_f": 1e-16,
        "pressure": 1.0,
        "young": 1e-4,
        "density": 1e-4,
        "normal_modulus": 1e-4,
        "fraction": 1e-6,
    }
    observed = model.observe(system, CORNERS)

    def solve(theta):
        rest = {name: theta[name] for name in step if name in theta and name not in ("G_f", "d_f")}
        return model.solve_modes(
            system, G_f=theta["G_f"], d_f=theta["d_f"], observation=observed, parameters=rest
        ).elastic()

    base = solve(system.theta)
    for j, name in enumerate(base.parameter):
        plus, minus = (solve({**system.theta, name: system.theta[name] + s * step[name]}) for s in (1, -1))
        for quantity in ("frequency", "damping"):
            slope = (getattr(plus, quantity) - getattr(minus, quantity)) / (2 * step[name])
            exact = getattr(base, f"{quantity}_gradient")[:, j]
            np.testing.assert_allclose(exact, slope, atol=1e-5 * abs(slope).max() + 1e-9, rtol=1e-4)
        sign = (np.sign(np.sum(plus.shape * base.shape, axis=0)), np.sign(np.sum(minus.shape * base.shape, axis=0)))
        slope = (plus.shape * sign[0] - minus.shape * sign[1]) / (2 * step[name])
        np.testing.assert_allclose(base.shape_gradient[:, :, j], slope, atol=1e-4 * abs(slope).max() + 1e-7, rtol=1e-3)


def test_shapes_are_mass_normalised_rigid_translation_included(system):
    modes = model.solve_modes(system, G_f=825.0, d_f=0.0, n_mode=6, observation=CORNERS)
    # The sum of squares over all rigid-body modes at the centre of mass in one direction is 1 / mass.
    stack_only = model.reduce(dataclasses.replace(STACK, clamps=()), n_snapshot=1)
    centre = model.Observation(node=[1], location=[[0.0, 0.0, 0.0]], direction=[[0.0, 0.0, 1.0]])
    free = model.solve_modes(stack_only, G_f=825.0, d_f=0.0, n_mode=6, observation=centre)
    assert modes.n_rigid == free.n_rigid == 6
    assert np.sum(free.shape**2) == pytest.approx(1.0 / stack_only.stack.mass, rel=1e-6)


def test_modal_damping_stands_for_the_complex_eigenproblem(system):
    modes = model.solve_modes(system, G_f=825.0, d_f=2e-11, n_mode=14, observation=CORNERS).elastic()
    frequency, damping = model.complex_modes(system, G_f=825.0, d_f=2e-11, n_mode=14)
    np.testing.assert_allclose(modes.frequency, frequency, rtol=2e-3)
    np.testing.assert_allclose(modes.damping, damping, rtol=2e-3)
    assert np.max(np.abs(modes.damping / damping - 1.0)) > 1e-8  # damping is not proportional


def test_second_order_of_heavy_damping_gives_the_frequency_of_the_complex_pole(system):
    modes = model.solve_modes(system, G_f=825.0, d_f=8e-11, n_mode=14, observation=CORNERS).elastic()
    frequency, damping = model.complex_modes(system, G_f=825.0, d_f=8e-11, n_mode=14)
    assert damping.max() > 0.1
    assert np.max(np.abs(modes.frequency / frequency - 1.0)) > 1e-3
    # what is left is of fourth order, and of modes that lie close to each other
    np.testing.assert_allclose(modes.pole_frequency, frequency, rtol=1e-4)


def frf_direct(system, *, G_f, d_f, frequency, output, input):  # noqa: A002
    """Receptance by (K + i omega C - omega**2 M) x = f of the z-reduced equations: no mode is truncated."""
    theta = full_parameters(system, G_f, d_f, None)
    stiffness, damping, mass = (system.assembly.matrix(target, theta) for target in ("K", "C", "M"))
    rows_out, rows_in = model.observe(system, output).rows, model.observe(system, input).rows
    load = rows_in.T.toarray().astype(complex)
    dynamic = [(stiffness + 1j * w * damping - w**2 * mass).tocsc() for w in 2.0 * np.pi * frequency]
    return np.stack([rows_out @ splinalg.splu(matrix).solve(load) for matrix in dynamic], axis=-1)


def test_frf_agrees_with_the_direct_solution(system):
    point = model.Observation(node=[1], location=[[0.15, 0.04, 0.0325]], direction=[[0.0, 0.0, 1.0]])
    lines = np.array([20.0, 300.0, 460.0, 700.0, 1000.0])
    arguments = {"G_f": 825.0, "d_f": 2e-11, "frequency": lines, "output": CORNERS, "input": point}
    direct = frf_direct(system, **arguments)
    receptance = model.frf(system, quantity="receptance", **arguments)
    assert receptance.shape == (4, 1, 5)
    np.testing.assert_allclose(receptance, direct, atol=3e-3 * np.abs(direct).max(axis=(0, 1)).min())
    accelerance = model.frf(system, **arguments)
    np.testing.assert_allclose(accelerance, -((2 * np.pi * lines) ** 2) * receptance)
    swapped = model.frf(system, **{**arguments, "output": point, "input": CORNERS})
    np.testing.assert_allclose(swapped[0], accelerance[:, 0], atol=1e-8 * np.abs(accelerance).max())


def test_stiffness_that_rigid_body_motion_does_not_feel_leaves_it_at_zero():
    stiff = dataclasses.replace(STACK, clamps=(model.Clamp(mass=1.0, x=0.05, y=0.0, footprint=(0.02, 0.02)),))
    system = model.reduce(stiff.with_effects(*model.find_effects(["clamp_bars", "suspension"])), n_snapshot=1)
    term = {term.name: np.abs(term.matrix) for term in system.terms}
    assert term["clamp_bars"][:6].max() == 0.0 < term["clamp_bars"].max()
    assert term["suspension"][:3, :3].max() > 0.0


def test_what_cannot_be_asked_is_refused(system):
    with pytest.raises(model.SolveError, match=r"n_mode = 0"):
        model.solve_modes(system, G_f=825.0, d_f=0.0, n_mode=0, observation=CORNERS)
    with pytest.raises(model.SolveError, match=r"yuong.*young"):
        model.solve_modes(system, G_f=825.0, d_f=0.0, observation=CORNERS, parameters={"yuong": 1.0})
    with pytest.raises(model.SolveError, match="negative"):
        model.solve_modes(system, G_f=-825.0, d_f=0.0, observation=CORNERS)
    with pytest.raises(model.SolveError, match=r"mass at .* is not positive"):
        model.solve_modes(system, G_f=825.0, d_f=0.0, observation=CORNERS, parameters={"density": -1.0})
    with pytest.raises(model.SolveError, match="accelerance"):
        model.frf(system, G_f=825.0, d_f=0.0, frequency=[1.0], output=CORNERS, input=CORNERS, quantity="compliance")
    with pytest.raises(ValueError, match=r"expected unit vectors, got length 2 .*node 7"):
        model.Observation(node=[7], location=[[0, 0, 0]], direction=[[2, 0, 0]])


def test_samples_lie_on_the_nearest_lamina_inside_the_outline():
    sampled, distance = model.sample_points(STACK, [[0.16, 0.0, 0.05], [0.0, 0.0, STACK.lamina_z[7]]])
    np.testing.assert_allclose(sampled[0], [0.15, 0.0, STACK.lamina_z[-1]])
    assert distance[0] == pytest.approx(np.hypot(0.01, 0.05 - STACK.lamina_z[-1]))
    assert distance[1] == 0.0


def test_surface_repeats_the_observed_shape(system):
    modes = model.solve_modes(system, G_f=825.0, d_f=0.0, observation=CORNERS)
    surface = model.mode_surface(system, modes, 7, lamina=[0, -1])
    (corner,) = np.flatnonzero(np.all(np.isclose(surface.location[1, :, :2], [0.15, 0.04]), axis=1))
    assert surface.location[1, corner, 2] == STACK.lamina_z[-1]
    assert surface.displacement[1, corner, 2] == pytest.approx(modes.shape[0, 7])
    assert len(surface.edge) == 2 * (STACK.mesh.n_x + STACK.mesh.n_y)
    with pytest.raises(model.SolveError, match="0 to 11"):
        model.mode_surface(system, modes, 12, lamina=[0])


def test_picture_is_a_png(system):
    from model.plot.plots import mode_png

    modes = model.solve_modes(system, G_f=825.0, d_f=0.0, observation=CORNERS)
    picture = mode_png(system, modes, 6, size=(300, 200))
    assert picture.startswith(b"\x89PNG")
    assert len(picture) > 2000
