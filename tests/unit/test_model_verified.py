"""Verified modes against full matrices: even and weak stacks, an outline, a tolerance that the first basis misses."""

import dataclasses

import numpy as np
import pytest

import model
from model.modes.refinement import solve_verified
from model.stack.outline import stator
from tests.full_matrices import lowest_modes

N = 24
UNIFORM = model.Stack(
    name="small",
    length=0.3,
    width=0.08,
    height=0.065,
    n_lamina=N,
    material=model.Material(young=2e11, poisson=0.28, density=7650.0),
    contact=model.Contact(G_f=825.0, d_f=5e-11, pressure=320e3, normal_modulus=5e9),
    mesh=model.Mesh(n_x=7, n_y=3),
)
SHAPE = stator(outer=0.2, inner=0.11, slot=0.16, n_tooth=6, tooth_width=0.014, n_side=16)
ANYWHERE = model.Observation(node=[1], location=[[0.1, 0.0, 0.0]], direction=[[0.0, 0.0, 1.0]])
N_MODE = 16


@dataclasses.dataclass(frozen=True)
class WeakZone:
    """Pressure with a hole in it and two interfaces that hardly touch."""

    mean: float = 320e3

    def at(self, points):
        x, y = points.T
        over = 1.0 - 0.95 * np.exp(-((x - 0.05) ** 2 + (y + 0.01) ** 2) / 0.03**2)
        pressure = np.tile(320e3 * over, (N - 1, 1))
        pressure[[4, 15]] *= 0.05
        return pressure, np.full_like(pressure, 5e9)


STACKS = {
    "uniform": UNIFORM,
    "weak zone": dataclasses.replace(UNIFORM, pressing=WeakZone()),
    "stator": dataclasses.replace(
        UNIFORM,
        n_lamina=6,
        height=0.065 / 4,
        length=float(np.ptp(SHAPE.bounds[0])),
        width=float(np.ptp(SHAPE.bounds[1])),
        outline=SHAPE,
        mesh=model.Mesh(n_x=6),
    ),
}


def exact(stack):
    return lowest_modes(model.assemble(stack), N_MODE)[0][6:]


@pytest.mark.parametrize("name", STACKS)
def test_estimate_is_not_below_the_true_error_of_the_full_matrices(name):
    _, modes, check = solve_verified(STACKS[name], n_mode=N_MODE, observation=ANYWHERE)
    true = modes.frequency[6:] / exact(STACKS[name]) - 1.0
    assert check.basis == "first"
    assert check.within_tolerance
    assert np.all(true <= 1.05 * check.error[6:] + 1e-8)
    assert np.all(check.error[6:] <= 4.0 * true + 1e-6)


def test_a_tolerance_that_the_first_basis_misses_is_met_and_said():
    weak = STACKS["weak zone"]
    _, modes, check = solve_verified(weak, n_mode=N_MODE, observation=ANYWHERE, tolerance=2e-7)
    assert check.first_error > 2e-7
    assert check.basis != "first"
    assert check.within_tolerance
    true = modes.frequency[6:] / exact(weak) - 1.0
    assert np.all(np.abs(true) < 2e-7)
