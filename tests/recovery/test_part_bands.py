"""A band of very many lines, taken in parts, has the modes that it has at once."""

from __future__ import annotations

import numpy as np
import pytest

from ema.identification import functions
from ema.identification.identify import identify_frf
from ema.identification.stabilization import stabilization
from ema.types.frf import FRF
from ema.types.modal_model import ModalModel
from tests.recovery.test_identify import block, geometry

F = 0.025 * np.arange(1, 24001)
"""24,000 lines to 600 Hz: three parts, whose ends are sought a quarter of a part about 200 and 400 Hz."""
FREQUENCY = np.array([21.0, 77.0, 140.0, 199.5, 204.0, 291.0, 380.0, 402.0, 515.0, 588.0])
DAMPING = np.array([0.004, 0.002, 0.001, 0.003, 0.002, 0.001, 0.002, 0.004, 0.001, 0.002])


def wide(seed: int) -> FRF:
    rng = np.random.default_rng(seed)
    phi = np.stack([np.cos(k * np.pi * np.linspace(0.0, 1.0, 8)) for k in range(1, 11)], axis=1)
    phi += 0.15 * rng.standard_normal(phi.shape)
    pole = 2 * np.pi * FREQUENCY * (-DAMPING + 1j * np.sqrt(1 - DAMPING**2))
    residue = phi * phi[0] / (2j * pole.imag)
    s = 2j * np.pi * F
    value = s**2 * (residue @ (1 / (s - pole[:, None])) + residue.conj() @ (1 / (s - pole.conj()[:, None])))
    rms = np.sqrt(np.mean(np.abs(value) ** 2, axis=1, keepdims=True))
    scatter = rng.standard_normal(value.shape) + 1j * rng.standard_normal(value.shape)
    return block(F, value + 0.01 * rms * scatter / np.sqrt(2))


@pytest.fixture(scope="module")
def parts() -> ModalModel:
    """Return what is identified in three parts."""
    frf = wide(0)
    assert len(functions.part_bands(frf.value)) == 3
    return identify_frf(frf, geometry(8), name="wide")


def has_every_mode_once(model: ModalModel) -> bool:
    near = np.abs(model.frequency - FREQUENCY) < 4.5 * model.frequency_std
    return bool(np.all(near & (np.abs(model.damping - DAMPING) < 4.5 * model.damping_std)))


def test_every_mode_is_found_once(parts: ModalModel) -> None:
    assert parts.frequency.size == FREQUENCY.size
    assert has_every_mode_once(parts)


@pytest.mark.slow
def test_modes_are_those_of_the_band_at_once(parts: ModalModel, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(functions, "MOST_LINES", F.size)
    whole = identify_frf(wide(0), geometry(8), name="wide")
    assert has_every_mode_once(whole)
    assert np.all(np.abs(parts.frequency - whole.frequency) < whole.frequency_std)
    np.testing.assert_allclose(parts.frequency_std, whole.frequency_std, rtol=0.2)
    assert np.all(np.abs(parts.shape - whole.shape) < 2.0 * whole.shape_std)
    np.testing.assert_allclose(parts.error, whole.error, rtol=0.01)


def test_chosen_poles_are_each_fitted_in_their_part() -> None:
    frf = wide(1)
    chosen = 2 * np.pi * FREQUENCY[[1, 4, 8]] * (-0.002 + 1j)
    model = identify_frf(frf, geometry(8), name="wide", pole=chosen)
    np.testing.assert_allclose(model.frequency, FREQUENCY[[1, 4, 8]], rtol=1e-4)


def test_parts_end_where_little_happens_and_hold_every_line_once() -> None:
    frf = wide(2)
    parts = functions.part_bands(frf.value)
    lines = np.concatenate([np.arange(F.size)[part.core] for part in parts])
    np.testing.assert_array_equal(lines, np.arange(F.size))
    for part in parts[1:]:
        assert np.all(np.abs(F[part.core.start] / FREQUENCY - 1.0) > 0.005)
        assert part.lines.start == part.core.start - functions.OVERLAP


def test_one_diagram_holds_the_poles_of_all_parts() -> None:
    frf = wide(3)
    diagram = stabilization(frf)
    hertz = np.abs(diagram.chosen) / (2 * np.pi)
    assert np.all(np.diff(hertz) > 0.0)
    for f in FREQUENCY:
        assert np.count_nonzero(np.abs(hertz / f - 1.0) < 1e-3) == 1
    for k in range(hertz.size):
        of_cluster = np.abs(diagram.pole[diagram.cluster == k]) / (2 * np.pi)
        assert abs(np.median(of_cluster) / hertz[k] - 1.0) < 0.01
