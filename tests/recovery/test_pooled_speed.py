"""How long many specimens take together, and how much memory: part of `make benchmark`."""

import resource
import time
from dataclasses import replace

import numpy as np
import pytest

import model
from tests.independent.campaign import STACK
from tests.independent.layered import Layered
from tests.studies.pooled import specimens_of
from tests.studies.published.shared_opt_G import fit_shared_opt_G
from tests.studies.published.target import prepare, target_of_table
from updating.correlation.shape_class import class_grid, solve_by_class
from updating.diagnosis.candidates import MESSAGES
from updating.pooled.diagnosis import diagnose_specimens
from updating.workers.workers import distribute, workers

pytestmark = pytest.mark.benchmark

CLASSES = ("torsion 1", "bending 1", "bending 2", "torsion 2")
PRESSURES = (1.6e5, 2.4e5, 3.2e5)
HEIGHTS = 5
"""Different ones; specimens of the same share a reduction."""


def peak(_=None):
    """The most memory that this process has had so far, MB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def targets(n_specimen):
    """Specimens at three torques by the model itself, with G_f of their own and two effects that they share."""
    rng = np.random.default_rng(0)
    base = model.read_stack(STACK).with_effects(*model.find_effects(["clamp_inertia", "clamp_mass"]))
    systems, found = {}, []
    for s in range(n_specimen):
        height = base.height * (1.0 + 0.01 * (s % HEIGHTS))
        G_f = 1000.0 * np.exp(0.2 * rng.standard_normal())
        for pressure in PRESSURES:
            stack = replace(base.with_contact(pressure=pressure), height=height)
            if height not in systems:
                system = model.reduce(stack, G_f_range=(200.0, 8000.0), n_snapshot=4)
                systems[height] = system, model.observe(system, class_grid(stack)), pressure
            system, observed, at = systems[height]
            modes, column = solve_by_class(system, observed, CLASSES, G_f=G_f * pressure / at)
            frequency = modes.frequency[column] * (1.0 + 2e-3 * rng.standard_normal(len(CLASSES)))
            found.append(
                target_of_table(stack, CLASSES, frequency, name=f"{s + 1} at {pressure:g}", specimen=f"{s + 1}")
            )
    return found


def test_eighteen_specimens_at_two_torques_are_diagnosed(capsys):
    """The first one, for what a process has had at most it keeps, and this takes more than the other."""
    specimens = specimens_of(1, {}, (), Layered(), number=18)
    begin = time.perf_counter()
    with workers(MESSAGES) as executor:
        found = diagnose_specimens("18 x 2", specimens, model.catalogue(), executor=executor)
        seconds = time.perf_counter() - begin
        most = peak(), max(distribute(peak, range(MESSAGES), executor))
    with capsys.disabled():
        each = "this process {:.0f} MB, another {:.0f} MB".format(*most)
        print(f"\n18 x 2 cold pooled diagnosis: {seconds:.0f} s, {each}, {found.verdict}")
    assert seconds <= 180.0
    assert max(most) <= 1024.0


def test_fifty_specimens_at_three_torques_are_fitted_with_two_shared_effects(capsys):
    prepared = prepare(targets(50), n_snapshot=4)
    begin = time.perf_counter()
    base = fit_shared_opt_G(prepared, (), left_out=False)
    found = fit_shared_opt_G(prepared, ("clamp_inertia", "clamp_mass"), first=base, anew=False, left_out=False)
    seconds = time.perf_counter() - begin
    with capsys.disabled():
        print(f"\n50 x 3 joint fit: {seconds:.0f} s, {peak():.0f} MB, error {100 * found.error():.2f} %")
    assert found.error() < 0.005
    assert seconds <= 60.0
    assert peak() <= 1024.0
