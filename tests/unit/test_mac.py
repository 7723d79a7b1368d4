"""Shape measures against hand-made vectors.

How complex shapes are, and when that is said.
"""

from __future__ import annotations

import csv
import dataclasses

import numpy as np
import pytest

import ema
from ema.modal.mac import cmif, comac, frac, mac, mcf, modal_scale_factor, mpc, mpd, real_shape
from ema.quality.explained import ExplainedPower
from tests.unit.test_read_modes import model
from updating.commands.ema import modes_table

RNG = np.random.default_rng(0)


def complex_shapes(n: int, m: int) -> np.ndarray:
    return RNG.standard_normal((n, m)) + 1j * RNG.standard_normal((n, m))


def test_mac_ignores_scale_and_phase_and_is_zero_for_orthogonal_shapes() -> None:
    phi = complex_shapes(8, 3)
    np.testing.assert_allclose(np.diag(mac(phi, phi * [2.0, -1j, 3 + 4j])), 1.0)
    np.testing.assert_allclose(mac(np.eye(3), np.eye(3)), np.eye(3))
    # cos(60 degrees) squared
    assert mac([[1.0], [0.0]], [[0.5], [np.sqrt(3) / 2]])[0, 0] == pytest.approx(0.25)


def test_mac_uses_the_conjugate() -> None:
    a = np.array([[1.0], [1j]])
    assert mac(a, a.conj())[0, 0] == pytest.approx(0.0, abs=1e-15)


def test_mac_refuses_what_it_cannot_compare() -> None:
    with pytest.raises(ValueError, match="same DOFs: got 3 and 4"):
        mac(np.ones((3, 1)), np.ones((4, 1)))
    with pytest.raises(ValueError, match="b: shape 1 is zero"):
        mac(np.ones((2, 2)), [[1.0, 0.0], [1.0, 0.0]])
    with pytest.raises(ValueError, match="columns"):
        mac(np.ones(3), np.ones(3))


def test_scale_factor_brings_a_shape_to_its_partner() -> None:
    phi = complex_shapes(6, 2)
    np.testing.assert_allclose(modal_scale_factor(phi, phi * [2j, -0.5]), [2j, -0.5])


def test_comac_finds_the_point_that_disagrees() -> None:
    a = RNG.standard_normal((6, 4))
    b = 3.0 * a
    np.testing.assert_allclose(comac(a, b), 1.0)
    b[2] = RNG.standard_normal(4)
    assert int(np.argmin(comac(a, b))) == 2


def test_phase_measures_of_real_turned_and_circular_shapes() -> None:
    real = np.array([[1.0], [-2.0], [0.5]])
    turned = real * np.exp(0.7j)
    circular = np.exp(2j * np.pi * np.arange(3) / 3)[:, None]
    np.testing.assert_allclose(mpc(np.hstack([real, turned, circular])), [1.0, 1.0, 0.0], atol=1e-15)
    np.testing.assert_allclose(mcf(turned), 0.0, atol=1e-15)
    np.testing.assert_allclose(mpd(np.hstack([real + 0j, turned])), 0.0, atol=1e-7)
    # Two components of equal size 2 d apart in phase lie d off their best line.
    np.testing.assert_allclose(mpd(np.array([[np.exp(0.1j)], [np.exp(-0.1j)]])), 0.1)


def test_real_shape_recovers_a_turned_real_mode_and_keeps_the_norm() -> None:
    real = np.array([[0.3], [-1.0], [0.8]])
    # The largest component becomes positive along the line of the shape.
    np.testing.assert_allclose(real_shape(real * np.exp(2.0j)), -real * np.sign(-1.0) * -1.0, atol=1e-12)
    noisy = complex_shapes(5, 2)
    np.testing.assert_allclose(np.linalg.norm(real_shape(noisy), axis=0), np.linalg.norm(noisy, axis=0))


def test_cmif_of_one_input_is_the_norm_over_the_outputs() -> None:
    value = complex_shapes(7, 11)[:, None, :]
    np.testing.assert_allclose(cmif(value), np.linalg.norm(value, axis=0))


def test_frac_is_one_for_scaled_functions_and_less_for_others() -> None:
    a = complex_shapes(3, 50)
    np.testing.assert_allclose(frac(a, a * 2j), 1.0)
    assert np.all(frac(a, a + complex_shapes(3, 50)) < 0.9)
    np.testing.assert_array_equal(frac(a, np.zeros_like(a)), 0.0)


PHASES = np.radians([0.0, 30.0, -30.0, 60.0, -60.0, 0.0])


def with_shape(shape, std=1e-3):
    m = model(scaled=False)
    shape = np.column_stack([shape, *m.shape.T[1:]])
    return dataclasses.replace(m, shape=shape, shape_std=np.full(shape.shape, std))


def test_measures_of_a_shape_of_known_phases():
    found = ema.complexity(with_shape(np.exp(1j * PHASES)))
    cosine = np.mean(np.cos(2 * PHASES))  # of equal magnitudes and phases symmetric about 0
    assert found.mpc[0] == pytest.approx(cosine**2)
    assert found.mcf[0] == pytest.approx(1.0 - cosine**2)
    assert found.mpd[0] == pytest.approx(30.0)
    assert found.phase_scatter[0] == pytest.approx(np.sqrt(np.mean(np.degrees(PHASES) ** 2)))


@pytest.mark.parametrize("minor", [0.0, 0.2, 0.5, 1.0])
@pytest.mark.parametrize("turn", [0.0, 0.7, 2.0])
def test_closed_forms_of_an_ellipse(minor, turn):
    """Components 1 and i e trace an ellipse of axes 1 and e: every measure is a function of e, however it is turned."""
    shape = np.array([1.0, 1j * minor, 0.0, 0.0, 0.0, 0.0]) * np.exp(1j * turn)
    found = ema.complexity(with_shape(shape))
    mpc = ((1 - minor**2) / (1 + minor**2)) ** 2
    assert found.mpc[0] == pytest.approx(mpc, abs=1e-12)
    assert found.mcf[0] == pytest.approx(1 - mpc, abs=1e-12)
    if minor < 1.0:  # a circle has no line of best fit
        assert found.mpd[0] == pytest.approx(90 * minor / (1 + minor), abs=1e-5)
        assert found.phase_scatter[0] == pytest.approx(90 * np.sqrt(minor**2 / (1 + minor**2)), abs=1e-5)
    assert found.is_complex[0] == (mpc < 0.8)


def test_measures_do_not_depend_on_scale_and_sign():
    rng = np.random.default_rng(1)
    shape = rng.standard_normal(6) + 0.3j * rng.standard_normal(6)
    signs = np.array([1, -1, 1, 1, -1, -1])
    one, other = (ema.complexity(with_shape(s)) for s in (shape, 1e3 * np.exp(2j) * signs * shape))
    for name in ("mpc", "mpd", "mcf", "phase_scatter"):
        assert getattr(other, name)[0] == pytest.approx(getattr(one, name)[0], rel=1e-9)


def test_real_shape_in_any_phase_passes():
    m = with_shape(np.array([1.0, -2.0, 0.5, 0.0, 1.0, -1.0]) * np.exp(1.1j))
    found = ema.complexity(m)
    assert found.mpc[0] == pytest.approx(1.0)
    assert found.phase_scatter[0] == pytest.approx(0.0, abs=1e-6)
    assert [v.level for v in ema.check_complexity(m)] == ["pass"]


def test_complex_mode_is_named_with_the_mac_that_a_real_shape_can_have():
    shape = np.exp(1j * PHASES)
    (verdict,) = ema.check_complexity(with_shape(shape))
    assert verdict.level == "warn"
    assert "101.25 Hz is too complex to be compared as real" in verdict.message
    angles = np.linspace(0.0, np.pi, 721)
    best = max(ema.mac(shape[:, None], (shape * np.exp(-1j * a)).real[:, None])[0, 0] for a in angles)
    assert f"above {best:.2f}" in verdict.message
    assert "noise alone" not in verdict.message
    (verdict,) = ema.check_complexity(with_shape(shape, std=0.5))
    assert "noise alone explains" in verdict.message


def test_noise_gives_the_mcf_that_is_expected_of_it():
    rng, std, real = np.random.default_rng(0), 0.02, np.linspace(-1.0, 1.2, 6)
    noise = std * (rng.standard_normal((6, 4000)) + 1j * rng.standard_normal((6, 4000)))
    measured = ema.mcf(real[:, None] + noise).mean()
    expected = ema.complexity(with_shape(real.astype(complex), std)).by_noise[0]
    assert measured == pytest.approx(expected, rel=0.25)  # the line itself is fitted to six components


def test_table_of_modes_has_the_measures(tmp_path):
    m = with_shape(np.exp(1j * PHASES))
    ema.write_modes_csv(tmp_path / "modes.csv", m)
    with (tmp_path / "modes.csv").open() as file:
        row = next(csv.DictReader(file))
    found = ema.complexity(m)
    for column, value in (
        ("MPC", found.mpc), ("MPD_deg", found.mpd), ("MCF", found.mcf), ("phase_scatter_deg", found.phase_scatter)
    ):  # fmt: skip
        assert float(row[column]) == pytest.approx(value[0], rel=1e-5)
    assert row["too_complex"] == "yes"


def test_the_table_of_modes_has_a_column_of_complexity():
    # the row of all modes had a cell less than the others, which ended `lamella ema`
    measured = dataclasses.replace(with_shape(np.exp(1j * PHASES)), read_from="")
    n = measured.frequency.size
    explained = ExplainedPower(
        channel=("1+z",),
        edge=np.arange(n + 1.0),
        share=np.full((1, n), 0.9),
        whole=np.array([0.8]),
        quantity="mobility",
    )
    table = modes_table(measured, explained)
    assert table.header[-1] == "MPC"
    assert [len(row) for row in table.rows] == [len(table.header)] * (n + 1)
    assert table.column_class
