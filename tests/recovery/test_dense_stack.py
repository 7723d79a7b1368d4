"""A stack whose bandwidths overlap, as a second model has it at three torques: how many of its modes are found.

pytest -m benchmark -s tests/recovery/test_dense_stack.py
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import ema
from tests.independent.campaign import Configuration, draw, simulate, write_campaign
from tests.independent.layered import Layered

pytestmark = pytest.mark.benchmark

STACK = Path(__file__).parents[1] / "independent" / "stacks" / "dense.toml"
TORQUES = (("low", 2.0, 150e3), ("mid", 4.0, 300e3), ("high", 6.0, 450e3))
MET = 0.1
"""Half-power bandwidths within which a mode is met."""


def test_modes_of_a_dense_stack_are_found_and_none_is_invented(tmp_path: Path, capsys) -> None:
    plan = replace(
        draw(92, "single", "layered"),
        stack=STACK,
        shaker=(-0.152, 0.0352),
        band=(100.0, 2200.0),
        configurations=tuple(Configuration(name=n, torque=t, pressure=p) for n, t, p in TORQUES),
    )
    made = simulate(plan, Layered())
    campaign = ema.read_campaign(write_campaign(made, tmp_path))
    for found, true in zip(ema.identify(campaign), made.modes, strict=True):
        inside = (true.frequency > 100.0) & (true.frequency < 2200.0)
        f, width = true.frequency[inside], 2.0 * (true.damping * true.frequency)[inside]
        off = np.abs(found.modal_model.frequency[:, None] - f) / width
        met, invented = (off.min(axis=0) < MET).sum(), (off.min(axis=1) > 0.5).sum()
        with capsys.disabled():
            print(f"\n{found.modal_model.name}: {met} of {f.size} modes met, {invented} invented", end="")
        assert invented == 0
        assert met >= 0.35 * f.size
        assert found.explained.mean > 0.99
