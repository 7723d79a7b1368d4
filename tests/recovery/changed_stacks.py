"""Stacks that a second model simulates before and after one change at a place, assembled anew in between."""

from __future__ import annotations

import dataclasses

import numpy as np

from ema.types.frf import Geometry
from tests.independent.campaign import (
    KINDS,
    SHAKER,
    Configuration,
    Plan,
    Simulated,
    TableNoise,
    Tolerances,
    deviating,
    modal_tables,
    nominal_points,
    read_bench,
    tightened,
)
from tests.independent.campaign import _damped as damped
from tests.recovery.reference_models import modal_model

NAMES = ("R1", "R2", "S")


def pair(seed, planted, second_model, *, reassembly=0.01, band=(100.0, 1300.0), noise=None):
    """Return name, stated pressure and modes of a reference, its repeat, and a state with something planted."""
    plan = Plan(
        seed=seed,
        model_key="solid",
        kind="null",
        planted={},
        configurations=tuple(Configuration(name=name, torque=3.0, pressure=320e3) for name in NAMES),
        band=band,
        tolerances=Tolerances(reassembly=reassembly, pressure=0.0),
    )
    rng = np.random.default_rng([seed, KINDS.index(plan.kind), 1])
    stated = read_bench(plan.stack)
    nominal = nominal_points(stated, plan.shaker)
    stack, point = deviating(plan, stated, nominal, rng)
    benches = [tightened(plan, stack, i, rng) for i in range(len(NAMES))]
    benches[2] = dataclasses.replace(benches[2], planted=planted)
    modes = [damped(second_model.modes(bench, plan.n_mode)) for bench in benches]
    gain = 1.0 + plan.tolerances.gain * rng.standard_normal(2)
    made = Simulated(
        plan=plan, frequency=np.zeros(1), frf=[], noise=[], bench=benches, modes=modes, point=point, nominal=nominal,
        factor=np.tile(gain, (SHAKER - 1) // 2), row=np.arange(SHAKER - 1),
    )  # fmt: skip
    geometry = Geometry(node=np.arange(1, SHAKER + 1), coordinate=nominal, line=np.empty((0, 2), dtype=int))
    tables = modal_tables(made, noise or TableNoise())
    return [(t.configuration.name, t.configuration.pressure, modal_model(t, geometry, plan.band)) for t in tables]
