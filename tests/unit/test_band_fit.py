"""Poles beside which peaks as high are left are no modes; a weak mode in even noise is one."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from ema.identification.band_fit import SEVERAL, BandFit, _without_common, fit_band, is_common, with_lost_peaks
from ema.identification.evidence import unexplained_peaks
from ema.identification.functions import Functions
from ema.identification.identify import identify_frf
from ema.identification.run_poles import run_poles
from ema.types.frf import FRF, Dofs, Geometry

LINES = np.arange(20.0, 1000.0, 0.5)
POLE = 2 * np.pi * np.array([120.0, 300.0]) * (1j - 0.002)
STRONG = 2 * np.pi * np.array([60.0, 130.0, 300.0]) * (1j - 0.004)
WEAK = 2 * np.pi * 700.0 * (1j - 0.0005)
N = 3


def functions(rng, noise=0.0, pole=POLE):
    """Accelerances of three points to one force, with even noise."""
    s = 2j * np.pi * LINES
    residue = 1j * rng.normal(size=(N, pole.size))
    value = residue @ (1.0 / (s - pole[:, None])) + residue.conj() @ (1.0 / (s - pole.conj()[:, None]))
    value = value * s**2
    even = rng.normal(size=(2, *value.shape))
    return value + noise * np.abs(value).max() * (even[0] + 1j * even[1])


def spiked(rng, value, number):
    """Add as many single high lines to all functions, far from the modes."""
    place = 1200 + 60 * np.arange(number)
    spike = rng.normal(size=(N, 1)) * np.exp(1j * rng.uniform(0, 2 * np.pi, number))
    value = value.copy()
    value[:, place] += 0.3 * np.abs(value).max() * spike / np.abs(spike)
    return value, 2 * np.pi * LINES[place[0]] * (1j - 1e-4)


def measured(value, quantity="accelerance"):
    nodes, axis = np.arange(1, N + 1), np.tile([0.0, 0.0, 1.0], (N, 1))
    return FRF(
        frequency=LINES, value=value[:, None], quantity=quantity, output=Dofs(node=nodes, direction=axis),
        input=Dofs(node=nodes[:1], direction=axis[:1]), run=np.zeros(N, dtype=int), source=("played",) * N,
    )  # fmt: skip


def laid_out(value, quantity="accelerance"):
    return Functions(
        frequency=LINES, value=value, run=np.zeros(N, dtype=int), quantity=quantity, weight=np.ones(value.shape)
    )


def common_in(value, pole):
    """Which of some poles are common in functions."""
    data = laid_out(value)
    return is_common(data, data.linear_fit(pole)).tolist()


@pytest.mark.parametrize(("number", "common"), [(1, False), (SEVERAL, False), (SEVERAL + 1, True)])
def test_a_spike_is_common_where_several_others_are_as_high(number, common):
    rng = np.random.default_rng(3)
    value, spike = spiked(rng, functions(rng, 1e-3), number)
    assert common_in(value, np.append(POLE, spike)) == [False, False, common]


def test_many_spikes_are_common_with_lines_that_weigh_by_the_misfit_too():
    found = 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        value, spike = spiked(rng, functions(rng, 1e-3), SEVERAL + 3)
        data = laid_out(value)
        fit = data.weigh_by_misfit(data.linear_fit(np.append(POLE, spike)))
        found += is_common(data, fit).tolist() == [False, False, True]
    assert found == 20


def nearly_linear(seed, height, width):
    """Receptances of three strong modes, off by a fifth over some lines, and of a weak one far above."""
    rng = np.random.default_rng(seed)
    square = (2j * np.pi * LINES) ** 2
    value = functions(rng, pole=STRONG) / square
    off = gaussian_filter1d(rng.standard_normal((2, *value.shape)), width, axis=2)
    one = functions(rng, pole=np.array([WEAK])) / square
    one *= height * np.abs(value).max() / np.abs(one).max()
    return value * (1.0 + 0.2 * (off[0] + 1j * off[1]) / (np.sqrt(2.0) * off.std())) + one


def test_the_misfit_of_strong_modes_far_away_does_not_make_a_weak_one_common():
    """What it leaves of a receptance far above them is as high."""
    plain, weighed = 0, 0
    for seed in range(10):
        data = laid_out(nearly_linear(seed, 1e-4, 4.0), "receptance")
        fit = data.linear_fit(np.append(STRONG, WEAK))
        plain += is_common(data, fit)[-1]
        weighed += is_common(data, data.weigh_by_misfit(fit))[-1]
    assert plain >= 8
    assert weighed == 0


@pytest.mark.parametrize(("height", "seed"), [(1e-4, 0), (1e-4, 2), (3e-4, 1)])
def test_a_mode_that_the_misfit_of_strong_ones_starves_is_found(height, seed):
    # it was listed: common, or as a mode that explains less than half of its peak, for its residue went to the misfit
    found = fit_band(measured(nearly_linear(seed, height, 10.0), "receptance"), 30, None, (20.0, 990.0))
    np.testing.assert_allclose(np.abs(found.fit.pole[3]), np.abs(WEAK), rtol=1e-4)


def test_a_weak_mode_in_even_noise_is_not_common():
    rng = np.random.default_rng(4)
    found = 0
    for _ in range(20):
        value = functions(rng)
        value += 0.02 * np.abs(value).max() * (rng.normal(size=value.shape) + 1j * rng.normal(size=value.shape))
        found += not any(common_in(value, POLE))
    assert found == 20


def test_a_weak_mode_beside_the_misfit_of_a_strong_one_is_a_mode():
    """What a strong resonance of another form leaves is many times higher than a weak mode 25 half bandwidths away."""
    rng = np.random.default_rng(6)
    weak = 2 * np.pi * 330.0 * (1j - 0.0005)
    value = functions(rng)
    near = np.exp(-(((LINES - 300.0) / 4.0) ** 2)) * rng.choice([-1.0, 1.0], LINES.size)
    value *= 1.0 + 0.2 * near
    value += 3e-4 * functions(rng, pole=np.array([weak]))
    value += 1e-6 * np.abs(value).max() * (rng.normal(size=value.shape) + 1j * rng.normal(size=value.shape))
    assert common_in(value, np.append(POLE, weak)) == [False, False, False]


def test_of_a_band_full_of_high_lines_the_modes_alone_are_named():
    """Above 500 Hz the force has no power: the ratio of two noises, whose lines a window joins to their neighbours."""
    rng = np.random.default_rng(2)
    value = functions(rng)
    high = LINES > 500.0

    def windowed(number):
        noise = rng.normal(size=(number, high.sum() + 3)) + 1j * rng.normal(size=(number, high.sum() + 3))
        return np.stack([np.convolve(row, [0.5, 1.0, 0.5], "valid")[: high.sum()] for row in noise])

    value[:, high] += 0.01 * np.abs(value).max() * windowed(N) / np.abs(windowed(1))
    value += 1e-4 * np.abs(value).max() * (rng.normal(size=value.shape) + 1j * rng.normal(size=value.shape))
    nodes = np.arange(1, N + 1)
    geometry = Geometry(node=nodes, coordinate=np.outer(nodes, [1.0, 0, 0]), line=np.empty((0, 2), dtype=int))
    model = identify_frf(measured(value), geometry, name="a wide band")
    np.testing.assert_allclose(model.frequency, [120.0, 300.0], rtol=1e-3)


def test_a_peak_whose_pole_is_gone_is_listed():
    """Beside an antiresonance a pole lies off the lines on which its peak stands out, and was not reported as lost."""
    pole = 2 * np.pi * np.array([120.0, 400.0, 430.0]) * (1j - np.array([0.002, 0.002, 0.012]))
    s = 2j * np.pi * LINES
    residue = 1j * np.array([[1.0, 1.0, -0.5]])
    value = s**2 * (residue @ (1 / (s - pole[:, None])) + residue.conj() @ (1 / (s - pole.conj()[:, None])))
    axis = np.array([[0.0, 0.0, 1.0]])
    frf = FRF(
        frequency=LINES,
        value=value[:, None],
        quantity="accelerance",
        output=Dofs(node=np.array([1]), direction=axis),
        input=Dofs(node=np.array([2]), direction=axis),
        run=np.zeros(1, dtype=int),
        source=("simulated",),
    )
    data = Functions(frequency=LINES, value=value, run=frf.run, quantity="accelerance", weight=np.ones(value.shape))
    two = data.linear_fit(pole[:2])
    (peak,) = (p for p in unexplained_peaks(data, two) if p.visible and abs(p.frequency - 430) < 10)
    before, after = peak.frequency - LINES[peak.first], LINES[peak.last] - peak.frequency
    assert abs(after - before) > 1  # Hz
    off = peak.frequency + (0.95 * (before + after) / 2) * (1 if before > after else -1)
    assert not LINES[peak.first] <= off <= LINES[peak.last]
    three = data.linear_fit(np.append(pole[:2], 2 * np.pi * off * (1j - 0.012)))
    with_it, without = (BandFit(value=frf.value, fit=fit, runs=run_poles(data, fit), left=()) for fit in (three, two))
    reported = [(p.line, why) for p, why in with_lost_peaks(frf, without, with_it, "gone").left]
    assert (peak.line, "gone") in reported
    assert all(abs(line - peak.line) < 250 for line, _ in reported)  # the plateau beside it is its flank
    assert with_lost_peaks(frf, with_it, with_it, "gone").left == ()
    assert with_lost_peaks(frf, without, without, "gone").left == ()  # what never had a pole was refused or is noise


def test_a_pole_whose_damping_ran_to_0_is_no_mode():
    """The fit of all poles together can end so, beside a mode or at a single line."""
    rng = np.random.default_rng(3)
    value, spike = spiked(rng, functions(rng, 1e-3), 1)
    frf = measured(value)
    fitted = fit_band(frf, 20, np.append(POLE, spike), (LINES[0], LINES[-1]))
    assert fitted.fit.pole.size == 3
    kept = _without_common(frf, fitted)
    np.testing.assert_allclose(kept.fit.pole, fitted.fit.pole[:2])
