"""Limits of the laminated stack with published or closed-form frequencies."""

import dataclasses

import numpy as np
import pytest
import scipy.linalg as la
import scipy.optimize

import model
from model.solvers.eigen import lowest_modes
from model.solvers.stack_solver import solver_over_plan

STEEL = model.Material(young=2e11, poisson=0.3, density=7850.0)


def stack(**values) -> model.Stack:
    contact = model.Contact(G_f=values.pop("G"), d_f=0.0, pressure=1.0, normal_modulus=values.pop("normal_modulus"))
    return model.Stack(name="limit", contact=contact, **values)


def lowest(assembly: model.Assembly, n_mode: int, guess: float) -> np.ndarray:
    """Return the lowest frequencies of all laminas without any reduction over z, Hz."""
    start = np.random.default_rng(0).standard_normal((assembly.size, n_mode + 6))
    values, _ = solver_over_plan(assembly).modes(assembly.theta, (2 * np.pi * guess) ** 2, start, n_mode, 1e-9)
    return np.sqrt(np.abs(values)) / (2 * np.pi)


def free_plate(ratio: float, n_x: int, n_y: int) -> np.ndarray:
    """Return omega a**2 sqrt(rho t / D) of a single free lamina, length over width = ratio."""
    length, thickness = 0.5, 0.5e-3
    single = stack(
        length=length,
        width=length / ratio,
        height=thickness,
        n_lamina=1,
        material=STEEL,
        G=1.0,
        normal_modulus=1.0,
        mesh=model.Mesh(n_x=n_x, n_y=n_y),
    )
    assembly = model.assemble(single)
    plate = assembly.slices()["w"]
    stiffness = assembly.matrix("K", assembly.theta)[plate, plate].toarray()
    mass = assembly.matrix("M", assembly.theta)[plate, plate].toarray()
    omega = np.sqrt(la.eigh(stiffness, mass, eigvals_only=True, subset_by_index=[3, 8]))
    rigidity = STEEL.young * thickness**3 / (12 * (1 - STEEL.poisson**2))
    return omega * length**2 * np.sqrt(STEEL.density * thickness / rigidity)


def test_free_square_plate_meets_leissa():
    # Leissa (1973), J. Sound Vib. 31, 257-293, table C21, nu = 0.3: upper bounds from 36 beam-function products,
    # the second to fourth of them known to lie 0.6 to 1 % high; converged values are from Gorman (1978).
    found = free_plate(1.0, 8, 8)
    np.testing.assert_allclose(found[:4], [13.468, 19.596, 24.270, 34.801], rtol=5e-4)
    assert np.all(found[:4] < np.array([13.489, 19.789, 24.432, 35.024]))


def test_plate_frequencies_converge_at_fourth_order():
    exact = free_plate(1.5, 16, 12)[0]
    errors = [free_plate(1.5, n, n)[0] / exact - 1.0 for n in (2, 4)]
    assert errors[0] > 0.0
    assert 3.3 < np.log2(errors[0] / errors[1]) < 5.5


def timoshenko_free_free(length: float, height: float, shear_modulus: float, kappa: float) -> float:
    """Return the first bending frequency of a free-free Timoshenko beam of rectangular section, Hz."""
    r2 = height**2 / 12.0 / length**2
    s2 = r2 * STEEL.young / (kappa * shear_modulus)

    def determinant(b: float) -> float:
        # Huang (1961), J. Appl. Mech. 28, 579-584, free-free beam; b = omega L**2 sqrt(rho A / E I)
        root = np.sqrt((r2 - s2) ** 2 + 4.0 / b**2)
        alpha, beta = np.sqrt((-(r2 + s2) + root) / 2.0), np.sqrt((r2 + s2 + root) / 2.0)
        p, q = b * alpha, b * beta
        factor = b / np.sqrt(1.0 - b**2 * r2 * s2)
        return float(
            2.0
            - 2.0 * np.cosh(p) * np.cos(q)
            + factor * (b**2 * r2 * (r2 - s2) ** 2 + (3.0 * r2 - s2)) * np.sinh(p) * np.sin(q)
        )

    b = scipy.optimize.brentq(determinant, 12.0, 22.37)
    return b / length**2 * np.sqrt(STEEL.young * height**2 / 12.0 / STEEL.density) / (2.0 * np.pi)


def test_bonded_limit_is_a_thick_beam():
    # Contact as stiff as steel makes a solid bar; kappa by Cowper (1966) for a rectangle.
    length, height, shear = 0.3, 0.03, STEEL.young / (2 * (1 + STEEL.poisson))
    solid = stack(
        length=length,
        width=0.008,
        height=height,
        n_lamina=80,
        material=STEEL,
        G=shear,
        normal_modulus=STEEL.young,
        mesh=model.Mesh(n_x=12, n_y=1),
    )
    system = model.reduce(solid, n_snapshot=1, n_mode=14)
    along_z = model.Observation(node=[1], location=[[length / 2, 0.0, 0.0]], direction=[[0.0, 0.0, 1.0]])
    modes = model.solve_modes(system, G_f=shear, d_f=0.0, n_mode=14, observation=along_z).elastic()
    found = modes.frequency[np.abs(modes.shape[0]) > 0.1][0]
    kappa = 10 * (1 + STEEL.poisson) / (12 + 11 * STEEL.poisson)
    assert found == pytest.approx(timoshenko_free_free(length, height, shear, kappa), rel=3e-3)


def test_sliding_limit_is_single_laminas():
    loose = stack(
        length=0.3,
        width=0.08,
        height=4e-3,
        n_lamina=4,
        material=STEEL,
        G=1e-6,
        normal_modulus=1e-6,
        mesh=model.Mesh(n_x=4, n_y=2),
    )
    single = dataclasses.replace(loose, n_lamina=1, height=1e-3)
    four = lowest(model.assemble(loose), 40, 30.0)
    one = lowest(model.assemble(single), 10, 30.0)
    np.testing.assert_allclose(four[24:32], np.repeat(one[6:8], 4), rtol=1e-5)


@pytest.mark.parametrize("shear", [1e5, 1e7, 1e9])
def test_two_lamina_beam_with_interlayer_slip(shear):
    # Simply supported beam of two equal layers, Girhammar and Pan (2007), Int. J. Mech. Sci. 49, 150-158: with
    # w = W sin kx and u = -+U cos kx the slip is 2 U + t k W and everything is exact in one wave number.
    length, width, t = 0.3, 0.01, 2e-3
    material = dataclasses.replace(STEEL, poisson=0.0)
    pair = stack(
        length=length,
        width=width,
        height=2 * t,
        n_lamina=2,
        material=material,
        G=shear,
        normal_modulus=1e12,
        mesh=model.Mesh(n_x=8, n_y=1),
    )
    assembly = model.assemble(pair)
    plan, where = assembly.plan, assembly.slices()
    held = []
    for side in (-length / 2, length / 2):
        # on an edge x = const the deflection is held by w and dw/dy at its nodes
        names, places = plan.plate.doflocs, plan.plate.dofs
        for kind in (0, 2):
            nodes = places.nodal_dofs[kind]
            held += [nodes[np.abs(names[0, nodes] - side) < 1e-9]]
    planar = np.concatenate(held)
    free = np.ones(assembly.size, dtype=bool)
    for k in range(2):
        free[where["w"].start + k * plan.size("w") + planar] = False
    free[where["v"]] = False
    stiffness, mass = (assembly.matrix(m, assembly.theta)[free][:, free].toarray() for m in ("K", "M"))
    values = la.eigh(stiffness, mass, eigvals_only=True, subset_by_index=[0, 20])
    found = np.sqrt(np.abs(values)) / (2 * np.pi)

    k = np.pi / length
    area, inertia = width * t, width * t**3 / 12
    slip = shear * width / t
    # stiffness and mass of the two amplitudes U and W
    strain = np.array(
        [
            [2 * material.young * area * k**2 + 4 * slip, 2 * slip * t * k],
            [2 * slip * t * k, 2 * material.young * inertia * k**4 + slip * t**2 * k**2],
        ]
    )
    kinetic = material.density * np.diag([2 * area, 2 * area + 2 * inertia * k**2])
    expected = np.sqrt(la.eigh(strain, kinetic, eigvals_only=True)[0]) / (2 * np.pi)
    assert np.min(np.abs(found / expected - 1.0)) < 1e-4


def torsion_constant(width: float, height: float) -> float:
    """Return Saint-Venant's torsion constant of a rectangle, m4 (Timoshenko and Goodier, section 109)."""
    a, b = max(width, height), min(width, height)
    n = np.arange(1, 60, 2)
    return a * b**3 / 3 * (1 - 192 * b / (np.pi**5 * a) * np.sum(np.tanh(n * np.pi * a / (2 * b)) / n**5))


def test_torsion_of_an_orthotropic_prism():
    # In-plane shear modulus G_xy of the steel, G_xz of the contact: stretching z by sqrt(G_xy / G_xz) makes the
    # section isotropic (Lekhnitskii, Theory of Elasticity of an Anisotropic Body, section 31).
    length, width, height = 2.0, 0.05, 0.05
    shear_xy = STEEL.young / (2 * (1 + STEEL.poisson))
    shear_xz = shear_xy / 4
    prism = stack(
        length=length,
        width=width,
        height=height,
        n_lamina=80,
        material=STEEL,
        G=shear_xz,
        normal_modulus=STEEL.young,
        mesh=model.Mesh(n_x=10, n_y=4),
    )
    system = model.reduce(prism, n_snapshot=1, n_mode=16)
    edges = model.Observation(
        node=[1, 2],
        location=[[length / 2, width / 2, 0.0], [length / 2, -width / 2, 0.0]],
        direction=[[0.0, 0.0, 1.0]] * 2,
    )
    modes = model.solve_modes(system, G_f=prism.contact.G_f, d_f=0.0, n_mode=16, observation=edges).elastic()
    twist = np.abs(modes.shape[0] - modes.shape[1]) > 1.9 * np.abs(modes.shape).max(axis=0)
    found = modes.frequency[twist & (np.abs(modes.shape).max(axis=0) > 0.05)][0]
    stretch = np.sqrt(shear_xy / shear_xz)
    rigidity = shear_xz / stretch * torsion_constant(width, height * stretch)
    polar = STEEL.density * (width * height**3 + height * width**3) / 12
    assert found == pytest.approx(np.sqrt(rigidity / polar) / (2 * length), rel=2e-3)


def test_iteration_keeps_what_it_is_given_when_the_space_is_invariant():
    values = np.array([1.0, 2.0, 3.0, 4.0])
    found, _ = lowest_modes(lambda x: x / (values + 1.0)[:, None], lambda x: x, 1.0, np.eye(4)[:, :3], 3, 1e-12)
    np.testing.assert_allclose(found, values[:3])
