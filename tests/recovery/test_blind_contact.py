"""Contact parameters of virtual tests, found without knowing them: `make blind`."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ema import identify_frf
from updating import fit
from updating.virtual.campaign import simulate
from updating.virtual.vibration_test import VirtualConfiguration, read_virtual_test

SPECIFICATION = Path(__file__).parents[2] / "data/demo_stack/virtual_test.toml"
SEEDS = range(100, 106)


def draw(seed):
    """A test with contact parameters and noise of its own."""
    rng = np.random.default_rng(seed)
    test = read_virtual_test(SPECIFICATION)
    configuration = VirtualConfiguration(
        name=f"seed {seed}",
        torque=3.0,
        pressure=320e3,
        G_f=float(np.exp(rng.uniform(np.log(700), np.log(2000)))),
        d_f=float(np.exp(rng.uniform(np.log(5e-12), np.log(3e-11)))),
    )
    noise = float(np.exp(rng.uniform(np.log(0.003), np.log(0.03))))
    return replace(test, seed=seed, noise=noise, configurations=(configuration,))


@pytest.mark.blind
def test_contact_parameters_of_unseen_tests_are_recovered():
    errors = []
    print(
        f"\n{'seed':>5} {'noise %':>8} {'modes':>6} {'G_f true':>9} {'found':>9} {'±':>6} {'d_f true':>9} {'found':>9}"
    )
    for seed in SEEDS:
        test = draw(seed)
        truth = test.configurations[0]
        frf, _ = simulate(test)[truth.name]
        measured = identify_frf(frf, test.geometry, name=truth.name)
        found = fit(test.stack.with_contact(pressure=truth.pressure), measured)
        errors.append((found.G_f.value / truth.G_f - 1, found.d_f.value / truth.d_f - 1))
        print(
            f"{seed:5d} {100 * test.noise:8.2f} {measured.frequency.size:6d} {truth.G_f:9.1f} {found.G_f.value:9.1f} "
            f"{found.G_f.std:6.1f} {truth.d_f:9.3e} {found.d_f.value:9.3e}"
        )
    worst = np.max(np.abs(errors), axis=0)
    print(f"largest relative error: G_f {100 * worst[0]:.2f} %, d_f {100 * worst[1]:.2f} %")
    assert worst[0] < 5e-3
    assert worst[1] < 3e-2
