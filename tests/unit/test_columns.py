"""What a stabilisation chart says of its poles and columns."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ema import Geometry
from ema.identification.doubtful_modes import _shared, dropped_columns, stability
from ema.identification.identify import identify_frf
from ema.identification.stabilization import stabilization
from ema.types.frf import FRF
from ema.types.geometry import Dofs

F = np.arange(50.0, 800.0, 0.5)
MODES = (120.0, 300.0, 720.0)


@pytest.fixture(scope="module")
def functions() -> FRF:
    """Functions of three modes in noise of 1 %."""
    rng = np.random.default_rng(3)
    pole = 2 * np.pi * np.array(MODES) * (-0.005 + 1j)
    residue = rng.standard_normal((8, 3)) / pole.imag / 2j
    s = 2j * np.pi * F
    value = s**2 * (residue @ (1 / (s - pole[:, None])) + residue.conj() @ (1 / (s - pole.conj()[:, None])))
    rms = np.sqrt(np.mean(np.abs(value) ** 2, axis=1, keepdims=True))
    value += 0.01 * rms * (rng.standard_normal(value.shape) + 1j * rng.standard_normal(value.shape))
    z = np.tile([0.0, 0.0, 1.0], (8, 1))
    return FRF(
        frequency=F, value=value[:, None], quantity="accelerance", output=Dofs(node=np.arange(8), direction=z),
        input=Dofs(node=[0], direction=z[:1]), run=np.zeros(8, dtype=int), source=("generated",) * 8,
    )  # fmt: skip


def test_poles_of_modes_are_stable_in_shape_too_and_others_are_not(functions: FRF) -> None:
    diagram = stabilization(functions, order=24)
    found = stability(diagram, functions)
    hertz = np.abs(diagram.pole) / (2 * np.pi)
    of_mode = np.any(np.abs(hertz[:, None] / MODES - 1.0) < 2e-3, axis=1) & (diagram.order > 12)
    assert found.shape[of_mode].mean() > 0.95
    assert found.shape[~diagram.stable].mean() < 0.2
    assert np.all(found.shape <= found.damping)
    assert np.all(found.damping <= found.frequency)
    assert not found.frequency[diagram.order == diagram.order.min()].any()  # there is no order below


def test_what_is_shared_is_told_apart() -> None:
    pole = 2 * np.pi * np.array([100.0]) * (-0.01 + 1j)
    shape, other = np.array([[1.0], [0.0]]), np.array([[0.0], [1.0]])
    heavier = 2 * np.pi * np.array([100.0]) * (-0.02 + 1j)
    far = 1.02 * pole
    assert _shared(pole, shape, pole, shape)[:, 0].tolist() == [True, True, True]
    assert _shared(pole, shape, pole, other)[:, 0].tolist() == [True, True, False]
    assert _shared(pole, shape, heavier, shape)[:, 0].tolist() == [True, False, False]
    assert _shared(pole, shape, far, shape)[:, 0].tolist() == [False, False, False]


def test_a_column_that_is_no_mode_is_given_with_its_reason(functions: FRF) -> None:
    geometry = Geometry(node=np.arange(8), coordinate=np.eye(8, 3), line=np.empty((0, 2), int))
    found = identify_frf(functions, geometry, name="M", order=24)
    np.testing.assert_allclose(found.frequency, MODES, rtol=1e-3)
    diagram = stabilization(functions, order=24)
    noise, twin = 2 * np.pi * np.array([500.0, 300.4]) * (-0.004 + 1j)
    modes = found.pole
    shown = replace(diagram, chosen=np.sort_complex(np.append(modes, [noise, twin]) / 1j) * 1j)
    reasons = {round(own.frequency): own.reason for own in dropped_columns(shown, functions, found)}
    assert reasons == {
        500: "beside the modes that were taken it does not stand out of the noise",
        300: f"the mode of the column at {found.frequency[1]:.1f} Hz once more",
    }
    fewer = replace(diagram, chosen=modes)
    assert dropped_columns(fewer, functions, found) == ()
