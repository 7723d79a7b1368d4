"""A single lamina against published plate frequencies, omega a**2 sqrt(rho t / D) at nu = 0.3, a along x.

Published are the values of A. W. Leissa, The free vibration of rectangular plates, J. Sound Vib. 31 (1973) 257-293:
Ritz upper bounds from 36 products of beam functions. With all edges clamped they have converged. Beam functions do
not meet the conditions at a free edge, and there the bounds lie up to 1 % high; so plates with free edges must lie
below them by less than 1 %, and agree with a converged Ritz solution in polynomials, made here.
"""

import numpy as np
import pytest
import scipy.linalg as la

import model
from model.stack.parts import EdgeSupport, PatchSupport

STEEL = model.Material(young=2e11, poisson=0.3, density=7850.0)
HELD = float("inf")
CLAMPED = {"across": HELD, "rotation": HELD, "along": HELD}


def parameters(ratio: float, supports: tuple, n_rigid: int, n_mode: int) -> np.ndarray:
    """Return the first frequency parameters of a plate of length over width = ratio."""
    length, thickness = 0.5, 0.5e-3
    plate = model.Stack(
        name="plate",
        length=length,
        width=length / ratio,
        height=thickness,
        n_lamina=1,
        material=STEEL,
        contact=model.Contact(G_f=1.0, d_f=0.0, pressure=1.0, normal_modulus=1.0),
        mesh=model.Mesh(n_x=10, n_y=10),
        supports=supports,
    )
    assembly = model.assemble(plate)
    w = assembly.slices()["w"]
    stiffness = assembly.matrix("K", assembly.theta)[w, w].toarray()
    mass = assembly.matrix("M", assembly.theta)[w, w].toarray()
    values = la.eigh(stiffness, mass, eigvals_only=True, subset_by_index=[n_rigid, n_rigid + n_mode - 1])
    rigidity = STEEL.young * thickness**3 / (12 * (1 - STEEL.poisson**2))
    return np.sqrt(values) * length**2 * np.sqrt(STEEL.density * thickness / rigidity)


def ritz(ratio: float, *, clamped_left: bool, n_mode: int, order: int = 14) -> np.ndarray:
    """Return frequency parameters from products of Legendre polynomials; on the left edge times (1 + x)**2."""
    x, weight = np.polynomial.legendre.leggauss(order + 6)
    shapes = [np.polynomial.legendre.Legendre.basis(m) for m in range(order)]
    factor = np.polynomial.Polynomial([1.0, 2.0, 1.0]) if clamped_left else np.polynomial.Polynomial([1.0])
    along = [s.convert(kind=np.polynomial.Polynomial) * factor for s in shapes]

    def integrals(functions: list, i: int, j: int) -> np.ndarray:
        left, right = (np.array([f.deriv(k)(x) if k else f(x) for f in functions]) for k in (i, j))
        return (left * weight) @ right.T

    a = {(i, j): integrals(along, i, j) for i in range(3) for j in range(3)}
    b = {(i, j): integrals(shapes, i, j) for i in range(3) for j in range(3)}
    nu, r = STEEL.poisson, ratio  # derivatives along y count r times, lengths are halves
    stiffness = np.kron(a[2, 2], b[0, 0]) + r**4 * np.kron(a[0, 0], b[2, 2])
    stiffness += nu * r**2 * (np.kron(a[2, 0], b[0, 2]) + np.kron(a[0, 2], b[2, 0]))
    stiffness += 2 * (1 - nu) * r**2 * np.kron(a[1, 1], b[1, 1])
    values = la.eigh(stiffness, np.kron(a[0, 0], b[0, 0]), eigvals_only=True)
    elastic = values[values > 1e-3]
    return 4.0 * np.sqrt(elastic[:n_mode])


@pytest.mark.parametrize(
    ("ratio", "published"),
    [
        (0.4, [3.4629, 5.2881, 9.6220, 11.437, 18.793, 19.100]),
        (2 / 3, [8.9459, 9.6015, 20.735, 22.353, 25.867, 29.973]),
        (1.0, [13.489, 19.789, 24.432, 35.024, 35.024, 61.526]),
        (1.5, [20.128, 21.603, 46.654, 50.293, 58.201, 67.494]),
        (2.5, [21.643, 33.050, 60.137, 71.484, 117.45, 119.38]),
    ],
)
def test_free_plates(ratio, published):
    found = parameters(ratio, (), 3, 6)
    np.testing.assert_allclose(found, ritz(ratio, clamped_left=False, n_mode=6), rtol=1e-3)
    assert np.all((found < published) & (found > 0.99 * np.array(published)))


@pytest.mark.parametrize(
    ("ratio", "published"),
    [
        (0.4, [3.511, 4.786, 8.115, 13.88, 21.64]),
        (2 / 3, [3.502, 6.406, 14.54, 22.04, 26.07]),
        (1.0, [3.492, 8.525, 21.43, 27.33, 31.11]),
        (1.5, [3.477, 11.68, 21.62, 39.49, 53.88]),
        (2.5, [3.456, 17.99, 21.56, 57.46, 60.58]),
    ],
)
def test_cantilever_plates(ratio, published):
    found = parameters(ratio, (EdgeSupport(edge="left", **CLAMPED),), 0, 5)
    np.testing.assert_allclose(found, ritz(ratio, clamped_left=True, n_mode=5), rtol=1e-3)
    assert np.all((found < published) & (found > 0.99 * np.array(published)))


@pytest.mark.parametrize(
    ("ratio", "published"),
    [
        (0.4, [23.648, 27.817, 35.446, 46.702, 61.554, 63.100]),
        (2 / 3, [27.010, 41.716, 66.143, 66.552, 79.850, 100.85]),
        (1.0, [35.992, 73.413, 73.413, 108.27, 131.64, 132.24]),
        (1.5, [60.772, 93.860, 148.82, 149.74, 179.66, 226.92]),
        (2.5, [147.80, 173.85, 221.54, 291.89, 384.71, 394.37]),
    ],
)
def test_clamped_plates(ratio, published):
    found = parameters(ratio, (EdgeSupport(edge="all", **CLAMPED),), 0, 6)
    np.testing.assert_allclose(found, published, rtol=5e-3)


@pytest.mark.parametrize("ratio", [0.4, 1.0, 2.5])
def test_pinned_plates_meet_the_closed_form(ratio):
    found = parameters(ratio, (EdgeSupport(edge="all", across=HELD),), 0, 6)
    m, n = np.meshgrid(np.arange(1, 8), np.arange(1, 8))
    exact = np.sort((np.pi**2 * (m**2 + (n * ratio) ** 2)).ravel())[:6]
    np.testing.assert_allclose(found, exact, rtol=1e-3)


def test_springs_weigh_what_they_are_given():
    # unit motion of a plate of 0.5 x 0.25 m: stiffness per length times the edge, per area times the patch
    plate = model.Stack(
        name="plate",
        length=0.5,
        width=0.25,
        height=3e-3,
        n_lamina=3,
        material=STEEL,
        contact=model.Contact(G_f=1.0, d_f=0.0, pressure=1.0, normal_modulus=1.0),
        mesh=model.Mesh(n_x=4, n_y=2),
        supports=(
            EdgeSupport(edge="right", along=2e3, across=3e3, rotation=5.0),
            PatchSupport(x=0.03, y=0.02, size=(0.1, 0.05), along=7e5, across=1e6, laminas="bottom"),
        ),
    )
    assembly = model.assemble(plate)
    edge, patch = (next(t for t in assembly.terms if t.name == f"support {i}").krons for i in range(2))

    def energy(krons: tuple, field: str, shape: tuple) -> float:
        x = np.zeros((assembly.size, 1))
        x[assembly.slices()[field], 0] = np.tile(assembly.plan.interpolate(field, shape), 3)
        return float(x[:, 0] @ assembly.apply(krons, x)[:, 0])

    assert energy(edge, "v", (1.0, 0.0, 0.0)) == pytest.approx(3 * 2e3 * 0.25, rel=1e-9)
    assert energy(edge, "w", (1.0, 0.0, 0.0)) == pytest.approx(3 * 3e3 * 0.25, rel=1e-9)
    assert energy(edge, "w", (-0.25, 1.0, 0.0)) == pytest.approx(3 * 5.0 * 0.25, rel=1e-9)
    assert energy(patch, "u", (1.0, 0.0, 0.0)) == pytest.approx(7e5 * 0.005, rel=1e-9)
    assert energy(patch, "w", (1.0, 0.0, 0.0)) == pytest.approx(1e6 * 0.005, rel=1e-9)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: EdgeSupport(edge="top", across=1.0), "edge must be one of left, right"),
        (lambda: EdgeSupport(edge="left"), "one of them positive"),
        (lambda: PatchSupport(x=0.0, y=0.0, size=(0.1, 0.0), across=1.0), "size must be positive"),
    ],
)
def test_impossible_supports_are_refused(make, message):
    with pytest.raises(model.StackError, match=message):
        make()
