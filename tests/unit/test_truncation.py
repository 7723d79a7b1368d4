"""A truncated basis against the one that it was cut from, in soft and stiff contact."""

import numpy as np

import model
from model.reduction.truncation import truncated

STACK = model.Stack(
    name="small",
    length=0.3,
    width=0.08,
    height=0.065,
    n_lamina=24,
    material=model.Material(young=2e11, poisson=0.28, density=7650.0),
    contact=model.Contact(G_f=825.0, d_f=5e-11, pressure=320e3, normal_modulus=5e9),
    clamps=(model.Clamp(mass=1.0, x=0.08, y=0.01, distribution="faces", footprint=(0.04, 0.05)),),
    mesh=model.Mesh(n_x=7, n_y=3),
)
N_MODE = 14
POINTS = model.Observation(node=np.array([1]), location=np.zeros((1, 3)), direction=np.eye(3)[:1])


def frequencies(system, G_f):
    modes = model.solve_modes(system, G_f=G_f, d_f=0.0, n_mode=N_MODE, observation=POINTS, by=())
    return modes.elastic().frequency


def test_soft_modes_keep_their_frequency():
    """Softer contact than the nominal: there the torsion mode has next to no share of a mass-weighted basis."""
    system = model.reduce(STACK, G_f_range=(60.0, 6000.0), n_mode=N_MODE, n_snapshot=6)
    samples = [{"G_f": G_f} for G_f in np.geomspace(60.0, 6000.0, 6)]
    small = truncated(system, samples, N_MODE, 0.05)
    assert small.size < 0.8 * system.size
    for G_f in (60.0, 90.0, 800.0, 6000.0):
        np.testing.assert_allclose(frequencies(small, G_f), frequencies(system, G_f), rtol=6e-4)


def test_a_truncated_basis_stays_orthonormal():
    """Enrichment relies on it."""
    system = model.reduce(STACK, n_mode=N_MODE, n_snapshot=3)
    small = truncated(system, [{"G_f": 500.0}, {"G_f": 2000.0}], N_MODE, 0.05)
    mass = small.matrix("M", small.theta)
    np.testing.assert_allclose(mass, np.eye(small.size), atol=1e-9)
