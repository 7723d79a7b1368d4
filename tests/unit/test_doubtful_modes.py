"""What is doubtful about single modes is reported: damping that nothing determines, turned residues, background.

What a stabilisation chart says of its poles and columns.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ema import Geometry
from ema.identification.doubtful_modes import _shared, _verdict, check_modes, dropped_columns, stability
from ema.identification.functions import resonant
from ema.identification.identify import identify_frf
from ema.identification.stabilization import stabilization
from ema.quality.explained import check_explained, explained_power
from ema.types.frf import FRF, Dofs
from ema.types.modal_model import UnexplainedPeak
from tests.unit.test_selection import LINES, beam, functions, identified


def with_turned_mode(angle, size=0.3):
    """Three modes, and one on the flank of the strongest whose residues are turned as one."""
    frf = functions([80, 190, 330], [0.01] * 3, beam(12, 3), 1e-4)
    s, one = 2j * np.pi * LINES, 2 * np.pi * 250
    weak = s**2 / (s**2 + 2 * 0.02 * one * s + one**2)
    shape = size * np.random.default_rng(3).choice([-1, 1], 12) * np.exp(1j * np.radians(angle))
    return replace(frf, value=frf.value + (shape[:, None] * weak)[:, None])


@pytest.mark.parametrize("angle", [0, 85])
def test_a_clear_peak_is_a_mode_whichever_way_its_residues_are_turned(angle):
    frf = with_turned_mode(angle, 0.06)
    model = identified(frf)
    np.testing.assert_allclose(model.frequency, [80, 190, 250, 330], rtol=2e-3)
    reported = [v.message for v in check_modes(frf, model) if v.check == "phases"]
    assert len(reported) == (angle > 45)
    assert all("degrees" in text for text in reported)


def test_shapes_without_a_common_phase_are_told():
    frf = with_turned_mode(0)
    model = identified(frf)
    residue = model.residue.copy()
    residue[:, 0, 2] *= np.exp(1j * np.linspace(-1.2, 1.2, 12))
    (verdict,) = check_modes(frf, replace(model, residue=residue))
    assert verdict.check == "phases"
    assert "250 Hz (0." in verdict.message
    assert "no phase in common" in verdict.message


def test_sound_modes_are_not_doubted():
    frf = functions([80, 190, 330], [0.01, 0.002, 0.03], beam(12, 3), 1e-2)
    assert check_modes(frf, identified(frf)) == ()


def test_damping_that_is_less_than_its_standard_deviation_is_told():
    frf = functions([80, 190, 330], [0.01] * 3, beam(12, 3), 1e-3)
    model = identified(frf)
    (verdict,) = check_modes(frf, replace(model, damping_std=model.damping * [0.1, 1.5, 0.1]))
    assert verdict.check == "damping"
    assert verdict.message.startswith("the data do not determine the damping at 190 Hz (1 ± 1.5 %)")


def test_a_broad_mode_without_a_peak_is_told_and_one_with_a_peak_is_not():
    clear = functions([80, 190, 330], [0.01, 0.15, 0.01], beam(12, 3) * [1, 3, 1], 1e-4)
    model = identified(clear)
    assert check_modes(clear, model) == ()
    hidden = functions([80, 330], [0.01] * 2, beam(12, 2), 1e-4)
    (verdict,) = check_modes(hidden, model)
    assert verdict.check == "broad"
    assert "190" in verdict.message or "189" in verdict.message


def test_what_is_damped_too_much_for_a_resonance_is_no_mode_but_background():
    pole = 2 * np.pi * 200 * np.array([-0.01 + 1j, -0.29 + 1j, -0.6 + 1j])
    assert resonant(pole, (20, 500)).tolist() == [True, True, False]
    frf = functions([80, 190, 330], [0.01] * 3, beam(12, 3), 1e-3)
    model = identified(frf)
    wide = replace(model, outside_pole=pole[2:], outside_residue=np.zeros((12, 1, 1)), run_outside_pole=None)
    (verdict,) = check_modes(frf, wide)
    assert verdict.check == "background"
    assert "stands for the background" in verdict.message


def test_a_peak_in_the_resonance_of_a_mode_is_not_told_as_a_missed_one():
    frf = functions([80, 190, 330], [0.01] * 3, beam(12, 3), 1e-3)
    model = identified(frf)
    peaks = tuple(UnexplainedPeak(frequency=f, share=0.1, channel=(), reason="for a reason") for f in (191.5, 250.0))
    model = replace(model, unexplained=peaks)
    beside, missed = (v.message for v in check_explained(explained_power(frf, model), model)[1:])
    assert "at 191.5 Hz in the resonance of the mode at 190 Hz, 10 %" in beside
    assert "at 250 Hz that no mode was found for, 10 %" in missed


def test_one_doubtful_mode_does_not_tell_that_the_structure_changed():
    assert "the structure changed" in _verdict(["M1 80 Hz and 81 Hz", "M2"], changed=True).message
    assert "no change of the structure" in _verdict(["M1 80 Hz and 81 Hz"], changed=False).message


F = np.arange(50.0, 800.0, 0.5)
MODES = (120.0, 300.0, 720.0)


@pytest.fixture(scope="module")
def chart_functions() -> FRF:
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


def test_poles_of_modes_are_stable_in_shape_too_and_others_are_not(chart_functions: FRF) -> None:
    diagram = stabilization(chart_functions, order=24)
    found = stability(diagram, chart_functions)
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


def test_a_column_that_is_no_mode_is_given_with_its_reason(chart_functions: FRF) -> None:
    geometry = Geometry(node=np.arange(8), coordinate=np.eye(8, 3), line=np.empty((0, 2), int))
    found = identify_frf(chart_functions, geometry, name="M", order=24)
    np.testing.assert_allclose(found.frequency, MODES, rtol=1e-3)
    diagram = stabilization(chart_functions, order=24)
    noise, twin = 2 * np.pi * np.array([500.0, 300.4]) * (-0.004 + 1j)
    modes = found.pole
    shown = replace(diagram, chosen=np.sort_complex(np.append(modes, [noise, twin]) / 1j) * 1j)
    reasons = {round(one.frequency): one.reason for one in dropped_columns(shown, chart_functions, found)}
    assert reasons == {
        500: "beside the modes that were taken it does not stand out of the noise",
        300: f"the mode of the column at {found.frequency[1]:.1f} Hz once more",
    }
    fewer = replace(diagram, chosen=modes)
    assert dropped_columns(fewer, chart_functions, found) == ()
