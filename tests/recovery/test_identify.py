"""Identification of seeded sets with known modes, and of measured structures with published frequencies."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path

import numpy as np
import pytest
import pyuff
import scipy.io
from numpy.typing import NDArray

from ema.identification.identify import identify_frf
from ema.modal.mac import mac
from ema.types.errors import IdentificationError, MeasurementError
from ema.types.frf import FRF, Dofs, Geometry, Quantity
from ema.types.modal_model import ModalModel, synthesize

REAL = Path(__file__).parents[2].parent / "shared/realdata"

FREQUENCY = np.array([152.0, 398.0, 611.0, 800.0, 1100.0, 1390.0])
DAMPING = np.array([0.002, 0.005, 0.01, 0.02, 0.004, 0.04])


def dofs(n: int) -> Dofs:
    return Dofs(node=np.arange(1, n + 1), direction=np.tile([0.0, 0.0, 1.0], (n, 1)))


def block(frequency: NDArray, value: NDArray, quantity: Quantity = "accelerance") -> FRF:
    value = value if value.ndim == 3 else value[:, None]
    n_output, n_input, _ = value.shape
    return FRF(
        frequency=frequency,
        value=value,
        quantity=quantity,
        output=dofs(n_output),
        input=dofs(n_input),
        run=np.zeros(n_output, dtype=int),
        source=("generated",) * n_output,
    )


def geometry(n: int) -> Geometry:
    node = np.arange(1, n + 1)
    line = np.stack([node[:-1], node[1:]], axis=1)
    return Geometry(node=node, coordinate=np.outer(node, [0.1, 0.0, 0.0]), line=line)


def six_modes(seed: int, noise: float, quantity: Quantity = "accelerance") -> tuple[FRF, NDArray]:
    """44 x 1 functions of six modes, 0-2000 Hz, with white noise of `noise` times each function's rms."""
    rng = np.random.default_rng(seed)
    f = np.arange(0.5, 2000.25, 0.5)
    phi = np.stack([np.cos(k * np.pi * np.linspace(0.0, 1.0, 44)) for k in range(1, 7)], axis=1)
    phi += 0.15 * rng.standard_normal(phi.shape)
    pole = 2 * np.pi * FREQUENCY * (-DAMPING + 1j * np.sqrt(1 - DAMPING**2))
    residue = phi * phi[0] / (2j * pole.imag)
    s = 2j * np.pi * f
    value = residue @ (1 / (s - pole[:, None])) + residue.conj() @ (1 / (s - pole.conj()[:, None]))
    value = value * s ** {"receptance": 0, "mobility": 1, "accelerance": 2}[quantity]
    rms = np.sqrt(np.mean(np.abs(value) ** 2, axis=1, keepdims=True))
    scatter = rng.standard_normal(value.shape) + 1j * rng.standard_normal(value.shape)
    return block(f, value + noise * rms * scatter / np.sqrt(2), quantity), phi


@pytest.mark.parametrize("quantity", ["receptance", "mobility", "accelerance"])
def test_six_modes_in_noise_are_found_without_a_guess(quantity: Quantity) -> None:
    frf, phi = six_modes(1, 0.01, quantity)
    model = identify_frf(frf, geometry(44), name="six modes")
    # Scatter in receptance is larger at the high modes, whose signal falls with omega**2 there.
    np.testing.assert_allclose(model.frequency, FREQUENCY, rtol=5e-4)
    np.testing.assert_allclose(model.damping, DAMPING, rtol=0.03)
    assert np.all(np.diag(mac(model.shape, phi)) > 0.999)
    assert model.scaled.all()
    sign = np.sign(np.sum(model.shape.real * phi, axis=0))
    error = np.linalg.norm(model.shape * sign - phi, axis=0) / np.linalg.norm(phi, axis=0)
    assert np.all(error < 0.05)
    assert np.all(model.correlation > 0.99)


def test_clean_data_give_the_exact_modes_and_functions() -> None:
    frf, phi = six_modes(2, 0.0)
    model = identify_frf(frf, geometry(44), name="clean")
    np.testing.assert_allclose(model.frequency, FREQUENCY, rtol=1e-9)
    np.testing.assert_allclose(model.damping, DAMPING, rtol=1e-7)
    assert model.scaled.all()
    sign = np.sign(np.sum(model.shape.real * phi, axis=0))
    np.testing.assert_allclose(model.shape * sign, phi, atol=1e-6)
    np.testing.assert_allclose(
        synthesize(model, frf.frequency, "accelerance"), frf.value, atol=1e-6 * np.abs(frf.value).max()
    )


@pytest.mark.parametrize("start", [825.0, *(pytest.param(start, marks=pytest.mark.slow) for start in (857.0, 880.0))])
def test_a_strong_mode_outside_the_band_does_not_pull_those_inside(start: float) -> None:
    """The band begins one and a half to five half bandwidths (16 Hz) above the mode at 800 Hz."""
    frf, _ = six_modes(4, 1e-4)
    model = identify_frf(frf, geometry(44), name="flank", band=(start, 1900.0))
    np.testing.assert_allclose(model.frequency, [1100.0, 1390.0], rtol=1e-5)
    np.testing.assert_allclose(model.damping, [0.004, 0.04], rtol=1e-3)
    assert model.outside_pole.size
    np.testing.assert_allclose(model.correlation, 1.0, atol=1e-5)


def test_shapes_are_as_good_as_they_say_with_modes_on_both_sides_of_the_band() -> None:
    frf, phi = six_modes(2, 0.01)
    model = identify_frf(frf, geometry(44), name="six modes", band=(300.0, 1000.0))
    scale = np.einsum("om,om->m", phi[:, 1:4], model.shape) / np.sum(phi[:, 1:4] ** 2, axis=0)
    off = np.sqrt(np.mean(np.abs(model.shape - phi[:, 1:4] * scale) ** 2 / model.shape_std**2, axis=0))
    assert np.all(off < 1.7)  # 2.0 to 2.2 where the flank of the mode below was left to the residual terms


def test_close_pair_stays_a_pair() -> None:
    """800 and 802.4 Hz damped by 1 %, so a third of a half bandwidth apart: half a percent noise."""
    rng = np.random.default_rng(0)
    f = np.arange(600.0, 1000.0, 0.5)
    phi = rng.standard_normal((20, 2))
    pole = 2 * np.pi * np.array([800.0, 802.4]) * (-0.01 + 1j * np.sqrt(1 - 1e-4))
    residue = phi * phi[0] / (2j * pole.imag)
    s = 2j * np.pi * f
    value = s**2 * (residue @ (1 / (s - pole[:, None])) + residue.conj() @ (1 / (s - pole.conj()[:, None])))
    scatter = rng.standard_normal(value.shape) + 1j * rng.standard_normal(value.shape)
    value += 0.005 * np.sqrt(np.mean(np.abs(value) ** 2)) * scatter / np.sqrt(2)
    model = identify_frf(block(f, value), geometry(20), name="pair")
    expect(model, [800.0, 802.4], 2e-4)


@pytest.mark.parametrize("n_set", [4, pytest.param(25, marks=pytest.mark.slow)])
def test_intervals_cover_the_truth(n_set: int) -> None:
    """Twelve scaled errors of six modes in each set: standard normal within the scatter of that many."""
    scaled = []
    for seed in range(n_set):
        frf, _ = six_modes(seed, 0.05)
        model = identify_frf(frf, geometry(44), name="noisy")
        scaled += [(model.frequency - FREQUENCY) / model.frequency_std, (model.damping - DAMPING) / model.damping_std]
    errors = np.concatenate(scaled)
    # Mean and variance of so many normal numbers: four standard deviations of each.
    assert abs(errors.mean()) < 4.0 / np.sqrt(errors.size)
    assert abs(errors.var() - 1.0) < 4.0 * np.sqrt(2.0 / errors.size)


def test_one_response_and_many_force_points_give_a_shape_over_the_force_points() -> None:
    frf, phi = six_modes(3, 0.01)
    hammer = FRF(
        frequency=frf.frequency,
        value=frf.value.swapaxes(0, 1),
        quantity=frf.quantity,
        output=frf.input,
        input=frf.output,
        run=[0],
        source=("generated",),
    )
    model = identify_frf(hammer, geometry(44), name="hammer")
    assert model.shape.shape == (44, 6)
    assert np.all(np.diag(mac(model.shape, phi)) > 0.999)


def test_noise_alone_is_refused() -> None:
    rng = np.random.default_rng(0)
    f = np.arange(1.0, 1000.0)
    noise = rng.standard_normal((10, f.size)) + 1j * rng.standard_normal((10, f.size))
    with pytest.raises(IdentificationError, match="stands out of the noise"):
        identify_frf(block(f, noise), geometry(10), name="noise")


def test_bad_data_are_named() -> None:
    frf, _ = six_modes(4, 0.01)
    value = frf.value.copy()
    value[6, 0, 100] = np.nan
    with pytest.raises(MeasurementError, match=r"point 7 over point 1 .*NaN"):
        identify_frf(block(frf.frequency, value), geometry(44), name="bad")
    value = frf.value.copy()
    value[3] = 0.0
    with pytest.raises(MeasurementError, match=r"point 4 .*zero at every line"):
        identify_frf(block(frf.frequency, value), geometry(44), name="bad")
    with pytest.raises(MeasurementError, match="even steps"):
        identify_frf(block(frf.frequency**1.1, frf.value), geometry(44), name="bad")
    with pytest.raises(IdentificationError, match="too few for order"):
        identify_frf(frf, geometry(44), name="bad", band=(100.0, 102.0))


def measured(folder: str) -> Path:
    path = REAL / folder
    if not path.exists():
        pytest.skip(f"measured data {path} are not on this machine")
    return path


def expect(model: ModalModel, frequency: list[float], relative: float) -> None:
    assert model.frequency.size == len(frequency), model.frequency
    np.testing.assert_allclose(model.frequency, frequency, rtol=relative)


def test_measured_beam_in_uff() -> None:
    path = measured("beam-uff-pyuff") / "beam.uff"
    sets = [s for s in pyuff.UFF(str(path)).read_sets() if s["type"] == 58]
    frf = block(sets[0]["x"], np.array([s["data"] for s in sets]))
    model = identify_frf(frf, geometry(3), name="beam", band=(30.0, 1100.0))
    # 922 Hz stands 20 dB over the valleys beside it in the second function, 157.5 Hz is a step of 2 dB; earlier
    # versions left them out in silence.
    expect(model, [52.56, 144.63, 157.47, 283.12, 468.28, 698.45, 922.04, 972.96], 1e-3)


@pytest.mark.slow  # three other measured structures are quicker
def test_measured_free_beam_with_roving_hammer() -> None:
    folder = measured("beam-freefree-modelab")
    value = []
    for k in range(1, 10):
        table = np.loadtxt(folder / f"Hxysv0000{k}.txt.gz", skiprows=9, usecols=(0, 1, 2), encoding="latin1")
        value.append(table[:, 1] + 1j * table[:, 2])
    frf = block(table[:, 0], np.array(value)[None])
    model = identify_frf(frf, geometry(9), name="beam")
    # The beam on its suspension stands 20 dB out at 5.31 Hz.
    expect(model, [5.31, 111.993, 306.852, 596.367, 974.178], 1e-3)


def test_measured_three_storey_building() -> None:
    path = measured("building-3storey-iqs") / "experimental_building_frf.zip"
    with zipfile.ZipFile(path) as archive:
        (member,) = (n for n in archive.namelist() if n.endswith(".npz"))
        value = np.load(io.BytesIO(archive.read(member)))["data"].T
    frf = block(0.0625 * np.arange(1601), value)
    model = identify_frf(frf, geometry(9), name="building", band=(15.0, 97.0))
    # The source's estimates differ by the method; damping of 3 % spreads the first by as much.
    expect(model, [21.42, 50.01, 68.29], 2e-3)


def test_measured_ruler() -> None:
    path = measured("ruler-freefree-pydvma") / "ruler_grid_acc_3.mat"
    value = scipy.io.loadmat(str(path))["yspec"].T[None]
    frf = block(np.linspace(0.0, 10000.0, 16385), value)
    model = identify_frf(frf, geometry(10), name="ruler", band=(20.0, 620.0))
    # Bending of a free beam and two modes near 517 and 551 Hz; modes damped by 1 % drift with the method.
    expect(model, [39.4, 108.5, 212.4, 352.3, 517.6, 551.1], 3e-3)
