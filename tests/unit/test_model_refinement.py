"""Error estimate and refinement against full matrices, where the reduction is easy and where it is not."""

import dataclasses

import numpy as np
import pytest
import scipy.sparse as sp

import model
from model.contact.contact import tangential_krons
from tests.full_matrices import lowest_modes

N = 24
STACK = model.Stack(
    name="small",
    length=0.3,
    width=0.08,
    height=0.065,
    n_lamina=N,
    material=model.Material(young=2e11, poisson=0.28, density=7650.0),
    contact=model.Contact(G_f=825.0, d_f=5e-11, pressure=320e3, normal_modulus=5e9),
    clamps=(model.Clamp(mass=1.0, x=0.08, y=0.01, distribution="faces", footprint=(0.04, 0.05)),),
    mesh=model.Mesh(n_x=7, n_y=3),
)
N_MODE = 16


def interfaces(change, weight=None):
    """Return the term that adds change[k] times the tangential stiffness to each interface."""

    def terms(assembly):
        x, y = assembly.plan.quadrature_points
        krons = tangential_krons(assembly.plan, STACK.pitch, 320e3 * change, 1.0 if weight is None else weight(x, y))
        factor = model.Monomial(exponent={"G_f": 1, "amount": 1})
        return (model.Term(name="interfaces", target="K", factor=factor, krons=krons),)

    return terms


def bar(assembly):
    """Return a spring between two far places of the lowest lamina."""
    rows = assembly.plan.point_rows("w", np.array([[-0.1, 0.0], [0.1, 0.02]]))
    stretch = sp.csr_matrix(rows[[0]] - rows[[1]])
    z = np.zeros((N, N))
    z[0, 0] = 1e8
    kron = model.Kron(row="w", column="w", z=z, planar=(stretch.T @ stretch).tocsr())
    factor = model.Monomial(exponent={"amount": 1})
    return (model.Term(name="bar", target="K", factor=factor, krons=(kron,)),)


def weak():
    change = np.zeros(N - 1)
    change[[3, 9, 10, 15, 20]] = -0.95
    return change


CASES = {
    "random": (interfaces(np.random.default_rng(0).uniform(-0.3, 0.3, N - 1)), 5e-5),
    "five weak": (interfaces(weak()), 5e-5),
    "soft zone": (
        interfaces(np.full(N - 1, -0.9), lambda x, y: np.exp(-((x - 0.05) ** 2 + (y + 0.01) ** 2) / 0.03**2)),
        5e-5,
    ),
    "bar": (bar, 1e-4),
}


def full_frequencies(assembly, theta, n):
    frequency, _ = lowest_modes(assembly, n, **theta)
    return frequency[2 * np.pi * frequency > 1.0]


def solve(system, G_f=825.0):
    anywhere = model.Observation(node=[1], location=[[0.1, 0.0, 0.0]], direction=[[0.0, 0.0, 1.0]])
    return model.solve_modes(system, G_f=G_f, d_f=0.0, n_mode=N_MODE, observation=anywhere)


@pytest.mark.parametrize(
    "case", ["bar", *(pytest.param(name, marks=pytest.mark.slow) for name in CASES if name != "bar")]
)
def test_estimate_meets_the_true_error_and_refinement_removes_it(case):
    terms, bound = CASES[case]
    system = model.reduce(
        STACK, terms=terms, theta={"amount": 1.0}, n_snapshot=1, n_mode=N_MODE, G_f_range=(412.5, 1650.0)
    )
    exact = full_frequencies(system.laminas, system.theta, N_MODE)
    error = solve(system).elastic().frequency / exact - 1.0
    assert np.all(error > 0.0)  # Galerkin frequencies are upper bounds
    assert error.max() < bound

    estimate = model.refine(system, G_f=825.0, n_mode=N_MODE, max_steps=1)
    ratio = estimate.reduction_error[-exact.size :] / error
    assert np.all((ratio > 1.0) & (ratio < 2.2))

    refined = model.refine(system, G_f=825.0, n_mode=N_MODE)
    assert refined.converged
    assert np.all(np.abs(refined.reduction_error[-exact.size :] / error - 1.0) < 0.2)
    left = refined.frequency[-exact.size :] / exact - 1.0
    assert np.all(left < 2e-6)
    assert np.all(left < 3.0 * refined.error[-exact.size :] + 1e-8)


def test_values_outside_the_range_are_said_to_be_and_their_error_is_seen():
    system = model.reduce(STACK, n_snapshot=1, n_mode=N_MODE, G_f_range=(400.0, 1600.0))
    assert solve(system).outside == ()
    modes = solve(system, G_f=8000.0)
    assert modes.outside == ("G_f",)
    exact = full_frequencies(system.laminas, {**system.theta, "G_f": 8000.0}, N_MODE)
    error = modes.elastic().frequency / exact - 1.0
    refined = model.refine(system, G_f=8000.0, n_mode=N_MODE)
    assert error.max() > 1e-3
    np.testing.assert_allclose(refined.frequency[6:], exact, rtol=2e-5)
    assert refined.reduction_error.max() == pytest.approx(error.max(), rel=0.05)


@pytest.mark.slow
def test_one_reduction_holds_over_a_box_of_parameters():
    def terms(assembly):
        (plain,) = interfaces(np.linspace(-0.5, 0.5, N - 1))(assembly)
        return (dataclasses.replace(plain, factor=model.Formula(lambda theta: np.sqrt(1.0 + theta["amount"]) - 1.0)),)

    ranges = {"amount": (0.0, 3e3), "young": (0.9, 1.1)}
    system = model.reduce(
        STACK, terms=terms, theta={"amount": 0.0}, ranges=ranges, G_f_range=(400.0, 1600.0), n_mode=18
    )
    anywhere = model.Observation(node=[1], location=[[0.1, 0.0, 0.0]], direction=[[0.0, 0.0, 1.0]])
    for theta in ({"G_f": 450.0, "amount": 2.9e3, "young": 1.1}, {"G_f": 1500.0, "amount": 10.0, "young": 0.9}):
        rest = {name: theta[name] for name in ranges}
        modes = model.solve_modes(
            system, G_f=theta["G_f"], d_f=0.0, n_mode=N_MODE, observation=anywhere, parameters=rest
        )
        exact = full_frequencies(system.laminas, {**system.theta, **theta}, N_MODE)
        np.testing.assert_allclose(modes.elastic().frequency, exact, rtol=1e-4)
    column = modes.parameter.index("amount")
    ahead = model.solve_modes(
        system, G_f=1500.0, d_f=0.0, n_mode=N_MODE, observation=anywhere, parameters={**rest, "amount": 10.01}
    )
    slope = (ahead.frequency - modes.frequency)[6:] / 0.01
    np.testing.assert_allclose(modes.frequency_gradient[6:, column], slope, rtol=1e-2, atol=1e-6)


def test_ranges_name_known_parameters():
    with pytest.raises(model.SolveError, match="did you mean young"):
        model.reduce(STACK, ranges={"yuong": (0.9, 1.1)})
    with pytest.raises(model.SolveError, match="lower to a higher"):
        model.reduce(STACK, ranges={"young": (1.1, 0.9)})
