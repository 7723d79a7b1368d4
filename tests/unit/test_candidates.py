"""The reduced model that explanations are computed with: as good where an effect is strong as where it is weak."""

import dataclasses
import itertools
from pathlib import Path

import numpy as np
import pytest

from model import Mesh, catalogue, read_stack
from model.effects.parts import known_or_usual_instruments
from model.modes.modes import reduced_eigenpairs
from model.reduction.through_thickness import N_RIGID
from tests.enrichment import enriched
from updating.diagnosis.candidates import N_MODEL, candidate_model

STACK = dataclasses.replace(
    read_stack(Path(__file__).parents[2] / "data/demo_stack/stack.toml"), n_lamina=12, mesh=Mesh(n_x=8, n_y=2)
)
N_MEASURED = 10
QUICK = {(700.0, 0.05, 0.03), (2500.0, 0.62, 0.0005)}


@pytest.fixture(scope="module")
def system():
    effects = {name: catalogue()[name] for name in ("clamp_inertia", "clamp_mass", "contact_direction")}
    return candidate_model(STACK, known_or_usual_instruments(STACK), effects).system


def squared(system, theta):
    return reduced_eigenpairs(system, {**system.theta, **theta}, N_MODEL)[0][N_RIGID : N_RIGID + N_MEASURED]


@pytest.mark.parametrize(
    ("G_f", "station", "inertia"),
    [
        pytest.param(*at, marks=() if at in QUICK else pytest.mark.slow)
        for at in itertools.product((700.0, 2500.0), (0.05, 0.23, 0.62, 0.98), (0.0005, 0.003, 0.03))
    ],
)
def test_a_clamp_is_met_wherever_it_stands_and_however_heavy_it_is(system, inertia, station, G_f):
    there = {"clamp_roll_inertia": inertia, "clamp_station": station, "G_f": G_f}
    exact = squared(enriched(system, [there], N_MODEL), there)
    np.testing.assert_allclose(np.sqrt(squared(system, there) / exact), 1.0, atol=2e-4)
