"""Effects that stacks of a table share, by opt_G over all: planted values come out, and prediction tells what helps."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from model import find_effects, read_stack
from model.stack.parts import Mesh
from tests.studies.published.campaign import pressure_law
from tests.studies.published.shared_opt_G import fit_shared_opt_G
from tests.studies.published.target import prepare, solve_target, target_of_table
from updating.errors import FitError

ROOT = Path(__file__).parents[2]
CLASSES = ("torsion 1", "bending 1", "bending 2", "torsion 2")
TRUE = {"clamp_roll_inertia": 0.004, "clamp_station": 0.79}
G_F = {"1": 1300.0, "2": 900.0, "3": 1100.0}
EXPONENT = 0.5


def simulated(effects, values, pressures):
    """Stacks at some pressures, with the frequencies that the model has at these values."""
    stack = read_stack(ROOT / "data/pirnat2013/stack_C1.toml")
    stack = dataclasses.replace(stack, n_lamina=40, mesh=Mesh(n_x=8, n_y=2)).with_effects(*find_effects(effects))
    blank = [
        target_of_table(stack.with_contact(pressure=p), CLASSES, np.full(4, 500.0), name=f"{name} {p:g}", specimen=name)
        for name in G_F
        for p in pressures
    ]
    found = []
    for one in prepare(blank, n_snapshot=3):
        modes, column = solve_target(one, {**values, "G_f": G_F[one.target.specimen]}, ())
        target = dataclasses.replace(one.target, frequency=modes.frequency[column])
        found.append(dataclasses.replace(one, target=target))
    return found


@pytest.fixture(scope="module")
def stacks():
    return simulated(["clamp_inertia", "fill_factor"], TRUE, [160e3])


@pytest.fixture(scope="module")
def fitted(stacks):
    return fit_shared_opt_G(stacks, ["clamp_inertia"])


def test_planted_values_are_found_from_exact_data(fitted):
    assert {p.name: p.value for p in fitted.parameter} == pytest.approx(TRUE, rel=1e-3)
    assert fitted.G_f == pytest.approx(G_F, rel=1e-3)
    assert fitted.error() < 1e-4
    assert not any(p.at_bound for p in fitted.parameter)


@pytest.mark.slow
def test_an_effect_that_is_there_lowers_the_error_of_what_is_left_out_and_another_does_not(stacks, fitted):
    base, wrong = (fit_shared_opt_G(stacks, names) for names in ((), ("fill_factor",)))
    assert base.error() > 0.05
    assert fitted.error(fitted.left_out) < 1e-3
    assert fitted.error(fitted.mode_left_out) < 1e-3
    assert wrong.error(wrong.left_out) > 0.5 * base.error(base.left_out)
    assert wrong.error(wrong.mode_left_out) > 0.5 * base.error(base.mode_left_out)


@pytest.mark.slow
def test_a_mode_left_out_is_what_a_fit_without_it_predicts(stacks):
    noise = np.random.default_rng(0)
    noisy = [
        dataclasses.replace(
            p,
            target=dataclasses.replace(
                p.target, frequency=p.target.frequency * np.exp(2e-3 * noise.standard_normal(4))
            ),
        )
        for p in stacks
    ]
    all_of_them = fit_shared_opt_G(noisy, ["clamp_inertia"])
    without = [dataclasses.replace(p, used=p.used & ~((i == 0) & (np.arange(4) == 2))) for i, p in enumerate(noisy)]
    refitted = fit_shared_opt_G(without, ["clamp_inertia"], first=all_of_them, anew=False, left_out=False)
    assert all_of_them.mode_left_out[0][2] == pytest.approx(refitted.frequency[0][2], rel=5e-4)
    assert {p.name: (p.lower < TRUE[p.name] < p.upper) for p in all_of_them.parameter} == dict.fromkeys(TRUE, True)


@pytest.mark.slow
def test_bounds_and_fixed_values_hold(stacks):
    low = fit_shared_opt_G(stacks, ["clamp_inertia"], bounds={"clamp_roll_inertia": (0.0, 0.002)}, left_out=False)
    assert low.parameter[0].at_bound
    assert not low.parameter[0].determined
    fixed = fit_shared_opt_G(stacks, ["clamp_inertia"], fixed=TRUE, left_out=False)
    assert not fixed.parameter
    assert fixed.error() < 1e-4


def test_a_fit_of_nothing_is_refused(stacks):
    blind = [dataclasses.replace(p, used=np.zeros(4, dtype=bool)) for p in stacks]
    with pytest.raises(FitError, match="no mode is left"):
        fit_shared_opt_G(blind, ["clamp_inertia"])


@pytest.mark.slow
def test_two_torques_show_the_law_of_pressure():
    law = pressure_law(simulated(["pressure_exponent"], {"exponent": EXPONENT}, [160e3, 320e3]))
    assert law.exponent == pytest.approx(EXPONENT, abs=1e-3)
    assert law.own == pytest.approx(EXPONENT, abs=1e-3)
    assert law.error("power") < 1e-3 < 0.05 < law.error("linear")
    assert law.error("refitted") < 1e-3
