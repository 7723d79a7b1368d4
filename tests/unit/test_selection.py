"""Nothing that shows in the functions is left unsaid: it is a mode, or listed with the reason why it is none."""

from dataclasses import replace

import numpy as np
import pytest

from ema.identification.evidence import LISTED, Refusal, unexplained_peaks
from ema.identification.functions import Functions
from ema.identification.identify import identify_frf
from ema.identification.selection import peaks_to_report, take_in_peaks, try_peak
from ema.quality.explained import ExplainedPower, check_explained, explained_power
from ema.quality.peaks import noise_slope, peaks_of_any_width, peaks_over_noise, whitest
from ema.types.errors import IdentificationError
from ema.types.frf import FRF, Dofs, Geometry

LINES = np.arange(20.0, 500.0, 0.5)


def functions(frequency, damping, shape, noise, seed=0, colour=0.0):
    """Accelerances (n, 1) of modes of given shapes (n, n_mode) over the first point.

    The noise has its share of the rms in mid-band and follows a power of the frequency.
    """
    s, one = 2j * np.pi * LINES, 2 * np.pi * np.asarray(frequency)[:, None]
    modes = s**2 / (s**2 + 2 * np.asarray(damping)[:, None] * one * s + one**2)
    value = (shape * shape[0]) @ modes
    rng = np.random.default_rng(seed)
    white = rng.standard_normal((2, *value.shape))
    size = noise * np.sqrt(np.mean(np.abs(value) ** 2, axis=1, keepdims=True) / 2) * (LINES / 260) ** colour
    return block(value + size * (white[0] + 1j * white[1]))


def block(value):
    n = len(value)
    axis = np.tile([0.0, 0.0, 1.0], (n, 1))
    return FRF(
        frequency=LINES,
        value=value[:, None],
        quantity="accelerance",
        output=Dofs(node=np.arange(1, n + 1), direction=axis),
        input=Dofs(node=np.array([1]), direction=axis[:1]),
        run=np.zeros(n, dtype=int),
        source=("simulated",) * n,
    )


def geometry(n):
    node = np.arange(1, n + 1)
    return Geometry(node=node, coordinate=np.outer(node, [0.1, 0, 0]), line=np.empty((0, 2), dtype=int))


def identified(frf, **options):
    return identify_frf(frf, geometry(frf.output.node.size), name="a", **options)


def beam(n, n_mode):
    return np.cos(np.pi * np.outer(np.linspace(0, 1, n), np.arange(2, n_mode + 2))) + 0.1


def test_wide_peaks_are_seen_in_noise_that_often_hides_each_line():
    frequency = np.arange(0.0, 2000.0)
    bump = 1.0 + 2.0 / (1.0 + ((frequency - 1200.0) / 60.0) ** 2)
    by_line, by_any = 0, 0
    for seed in range(50):
        power = bump * np.random.default_rng(seed).gamma(5.0, 0.2, frequency.size)
        by_line += any(abs(line - 1200) < 60 for line, _, _ in peaks_over_noise(power, 1.0))
        by_any += any(abs(line - 1200) < 60 for line, _, _ in peaks_of_any_width(power, 1.0))
    assert by_line < 0.5 * 50
    assert by_any > 0.95 * 50


def test_averaged_lines_add_few_peaks_that_are_noise():
    more = 0
    for seed in range(40):
        noise = np.random.default_rng(seed).gamma(10.0, 1.0, 2000)
        more += len(peaks_of_any_width(noise, 1.0)) - len(peaks_over_noise(noise, 1.0))
    assert more <= 0.05 * 40


def test_resonances_around_a_wide_peak_are_no_noise_of_averaged_lines():
    # five lines of 8 dB: their means beside those of other resonances were taken for noise
    place, lines = np.arange(100, 800, 30), np.arange(800.0)
    seen = 0
    for seed in range(10):
        noise = np.random.default_rng(seed).gamma(16.0, 1 / 16.0, lines.size)
        peaks = 1.0 + (5.0 / (1.0 + ((lines[:, None] - place) / 2.5) ** 2)).sum(axis=1)
        seen += sum(min(abs(place - line)) < 4 for line, _, _ in peaks_of_any_width(peaks * noise, 1.0))
    assert seen > 0.9 * 10 * place.size


@pytest.mark.parametrize(("beside", "modes"), [(0.45, 3), (0.005, 2)])
def test_a_resonance_between_lines_is_a_mode_whose_damping_is_not_told_and_one_line_is_none(beside, modes):
    # it was refused for its damping, which lines so coarse beside it do not tell
    narrow = LINES[500] + beside * (LINES[1] - LINES[0])
    frf = functions([100.0, 430.0, narrow], [0.01, 0.01, 1e-7], np.array([[1, 1.2, 0.03]]), 3e-3)
    model = identified(frf, band=(20, 500))
    np.testing.assert_allclose(model.frequency, sorted([100.0, narrow, 430.0] if modes == 3 else [100, 430]), rtol=1e-3)


@pytest.mark.parametrize("band", [(20, 500), (340, 460), (150, 480)])
def test_neighbours_in_one_function_are_two_modes_in_every_band(band):
    # all shapes of one point are alike: the second of two clear peaks was taken for a misfit of the first
    frequency, damping = [54, 135, 215, 267, 405, 417.5, 470], [0.007] * 4 + [0.008, 0.007, 0.007]
    frf = functions(frequency, damping, np.array([[1, 1.2, 0.9, 1.6, 0.7, 0.5, 0.8]]), 3e-3)
    model = identified(frf, band=band)
    inside = [f for f in frequency if band[0] < f < band[1]]
    np.testing.assert_allclose(model.frequency, inside, rtol=2e-3)  # 470 Hz outside of a band pulls a little
    assert model.unexplained == ()


@pytest.mark.parametrize(("n", "size", "gap"), [(1, 0.2, 7.5), (1, 0.4, 6), (2, 0.2, 6)])
def test_two_peaks_that_have_no_mode_do_not_hide_each_other(n, size, gap):
    # what one of them leaves counted as noise where the other was tried, and both were refused
    frequency, damping = [54, 135, 215, 417.5, 300, 300 + gap], [0.007, 0.007, 0.007, 0.007, 0.005, 0.004]
    shape = np.array([[1, 1.2, 0.9, 0.8, size, size], [0.7, -0.9, 1, 0.8, size, -size]])[:n]
    data = rows(functions(frequency, damping, shape, 1e-3))
    four = data.linear_fit(poles(frequency[:4], damping[:4]))
    fit, left = take_in_peaks(data, four, np.empty(0, dtype=complex), (20, 500))
    np.testing.assert_allclose(np.sort(np.abs(fit.pole)) / (2 * np.pi), np.sort(frequency), rtol=1e-3)
    assert left == ()


def test_a_peak_that_steps_up_from_a_dip_to_a_plateau_is_no_plateau():
    # its share of the power of sixty lines was below a hundredth, and nothing was said of it
    frequency, damping = np.array([60, 100, 150, 301.3]), [0.004, 0.005, 0.004, 0.0012]
    shape, blows = np.array([[1, 1.2, 0.9, 0.06]]), []
    for k, off in enumerate((-0.004, -0.002, 0.0, 0.002, 0.004)):
        at = frequency * (1 + off * np.array([1, 1, 1, 0]))
        blows.append(functions(at, damping, shape, 1e-6, seed=k).value[:, 0])
    model = identified(block(np.mean(blows, axis=0)), band=(20, 500))
    assert np.any(np.abs(model.frequency - 301.3) < 0.1)


def test_a_peak_of_few_loud_functions_is_seen_beside_many_that_are_noise():
    # each function counted by its own mean: those that hardly move are loudest where the others are quiet
    loud = rows(functions([80, 260], [0.004, 0.01], np.array([[1, 0.3], [0.8, -0.2]]), 1e-3))
    noise = np.random.default_rng(4).standard_normal((2, 30, LINES.size))
    value = np.vstack([loud.value, 1e-3 * (noise[0] + 1j * noise[1])])
    data = replace(loud, value=value, run=np.zeros(32, dtype=int), weight=np.ones(value.shape))
    peak = peak_at(data, data.linear_fit(poles([80], [0.004])), 260)
    assert peak.visible
    assert peak.frequency == pytest.approx(260, abs=1)


def test_what_the_modes_leave_in_the_end_decides_whether_a_peak_is_listed():
    # it was decided when the peak was tried, with modes that were given up later
    data = rows(functions([80, 190, 330], [0.01] * 3, beam(4, 3), 1e-3))
    two = data.linear_fit(poles([80, 190], [0.01] * 2))
    (peak,) = unexplained_peaks(data, two)
    assert peak.share > LISTED
    refused = {peak.line: Refusal(reason="explained by others once", least=LISTED)}
    assert [reason for _, reason in peaks_to_report(data, two, refused)] == ["explained by others once"]
    assert peaks_to_report(data, two, {peak.line: Refusal(reason="noise", least=np.inf)}) == ()


def test_a_line_of_the_mains_is_listed_and_no_mode():
    frf = functions([80, 190, 330], [0.01] * 3, beam(10, 3), 1e-3)
    value = frf.value.copy()
    line = np.argmin(np.abs(LINES - 150))
    phase = np.exp(2j * np.pi * np.random.default_rng(1).uniform(size=10))
    value[:, 0, line] += 5 * np.abs(value[:, 0, line]).max() * phase
    model = identified(replace(frf, value=value))
    np.testing.assert_allclose(model.frequency, [80, 190, 330], rtol=1e-3)
    (peak,) = model.unexplained
    assert peak.frequency == 150
    assert len(peak.channel) == 10
    assert peak.reason


def test_a_mode_of_rough_phases_that_stands_alone_is_taken():
    # each blow on the roving points has its own small delay, so that weak residues turn
    frf = functions([80, 190, 330], [0.004] * 3, beam(24, 3), 1e-3)
    rng = np.random.default_rng(2)
    s, one = 2j * np.pi * LINES, 2 * np.pi * 250
    turned = 0.05 * rng.choice([-1, 1], 24) * np.exp(0.45j * rng.standard_normal(24))
    weak = s**2 / (s**2 + 2 * 0.004 * one * s + one**2)
    model = identified(replace(frf, value=frf.value + (turned[:, None] * weak)[:, None]))
    np.testing.assert_allclose(model.frequency, [80, 190, 250, 330], rtol=1e-3)


@pytest.mark.parametrize("quantity", ["receptance", "mobility", "accelerance"])
def test_the_modes_do_not_hang_on_the_quantity_of_the_file(quantity):
    # as receptance, the accelerometer's noise of the low lines drowned the modes of the high ones
    shape = beam(6, 4)
    shape[:, 3] *= 0.15
    frf = functions([40, 120, 260, 430], [0.01] * 4, shape, 3e-2)
    model = identified(frf.convert(quantity))
    np.testing.assert_allclose(model.frequency, identified(frf).frequency, rtol=1e-9)
    np.testing.assert_allclose(model.frequency, [40, 120, 260, 430], rtol=2e-3)
    assert model.quantity == quantity


@pytest.mark.parametrize(("colour", "white"), [(0, "accelerance"), (1, "mobility"), (2, "receptance")])
def test_the_colour_of_the_noise_is_measured(colour, white):
    frf = functions([80, 190, 330], [0.01] * 3, beam(10, 3), 1e-2, colour=colour)
    assert noise_slope(frf.frequency, frf.value[:, 0]) == pytest.approx(colour, abs=0.25)
    assert {whitest(frf.convert(q)) for q in ("receptance", "mobility", "accelerance")} == {white}


def test_poles_by_hand_that_leave_a_mode_fail_the_identification_in_plain_words():
    frf = functions([80, 190, 330], [0.01] * 3, beam(10, 3), 1e-3)
    pole = 2 * np.pi * 80 * np.array([-0.01 + 1j])
    model = identified(frf, pole=pole)
    explained = explained_power(frf, model)
    whole, *peaks = check_explained(explained, model)
    assert explained.mean < 0.7
    assert whole.level == "fail"
    assert whole.message.startswith("the identification has failed: the modes explain 0.")
    assert {round(v.band[0], -1) for v in peaks} == {190, 330}
    assert all("chosen by hand" in v.message for v in peaks)


def explained(whole):
    share = np.array(whole)[:, None]
    names = tuple(f"{k}+z" for k in range(1, len(whole) + 1))
    edge = np.array([20.0, 500.0])
    return ExplainedPower(channel=names, edge=edge, share=share, whole=np.array(whole), quantity="accelerance")


@pytest.mark.parametrize(
    ("whole", "level", "words"),
    [
        ([0.99, 0.95], "pass", "explain 0.970"),
        ([0.99, 0.75], "warn", "2+z 0.75; least in 20-500 Hz 0.87: modes are missing"),
        ([0.6, 0.7], "fail", "the identification has failed"),
    ],
)
def test_the_limits_of_the_share_of_power(whole, level, words):
    frf = functions([80], [0.01], beam(2, 1), 1e-3)
    verdict = check_explained(explained(whole), identified(frf))[0]
    assert verdict.level == level
    assert words in verdict.message


def test_a_roving_hammer_is_compared_at_its_points():
    frf = functions([80, 190], [0.01] * 2, beam(5, 2), 1e-3)
    model = identified(frf)
    found = explained_power(frf, model)
    assert found.channel == ("1+z", "2+z", "3+z", "4+z", "5+z")
    assert found.share.shape == (5, 2)
    assert found.whole.min() > 0.999


def rows(frf):
    value = frf.value[:, 0]
    return Functions(frequency=LINES, value=value, run=frf.run, quantity=frf.quantity, weight=np.ones_like(value.real))


def poles(frequency, damping):
    return 2 * np.pi * np.asarray(frequency) * (1j - np.asarray(damping))


def peak_at(data, fit, frequency):
    return next(p for p in unexplained_peaks(data, fit) if abs(p.frequency - frequency) < 10)


def test_a_broad_peak_is_not_explained_by_a_weak_neighbour_that_moves_into_it():
    shape = beam(8, 3) * [1, 0.4, 0.02]
    data = rows(functions([80, 230, 330], [0.004, 0.06, 0.01], shape, 1e-3))
    fit = data.linear_fit(poles([80, 330], [0.004, 0.01]))
    start = poles([230], [0.05])
    found = try_peak(data, fit, peak_at(data, fit, 230), start, (20, 500))
    assert not isinstance(found, Refusal), found
    np.testing.assert_allclose(np.sort(found.imag) / (2 * np.pi), [80, 230, 330], rtol=0.01)


def test_a_peak_is_not_explained_because_a_larger_misfit_around_it_is():
    data = rows(functions([200], [0.01], beam(8, 1), 1e-3))
    fit = data.linear_fit(np.empty(0, dtype=complex))
    smooth = 8 * np.sqrt(np.mean(np.abs(data.value) ** 2, axis=1, keepdims=True))
    fit = replace(fit, residual=data.value + smooth)
    peak = replace(peak_at(data, fit, 200), share=50.0)
    found = try_peak(data, fit, peak, poles([200], [0.02]), (20, 500))
    assert not isinstance(found, Refusal), found
    np.testing.assert_allclose(found.imag / (2 * np.pi), [200], rtol=1e-3)


def test_a_receptance_is_not_judged_by_the_integrated_noise_of_its_first_lines():
    frf = functions([80, 190, 330], [0.01] * 3, beam(10, 3), 1e-2)
    drift = np.where(LINES < 22, 20 * np.abs(frf.value).max(), 0.0) * (LINES / 22) ** 2
    receptance = replace(frf, value=frf.value + drift).convert("receptance")
    model = identified(frf.convert("receptance"))
    share = explained_power(receptance, model)
    np.testing.assert_allclose(share.whole, explained_power(receptance.convert("accelerance"), model).whole)
    assert share.quantity == "accelerance"
    assert "of the measured power, as accelerance, in the mean" in check_explained(share, model)[0].message


def test_complex_conjugates_are_told():
    frf = functions([80, 190, 330], [0.01] * 3, beam(10, 3), 1e-2)
    with pytest.raises(IdentificationError, match="the phase rises through the resonances, as of the complex"):
        identified(replace(frf, value=frf.value.conj()))


def test_complex_conjugates_of_one_noisy_function_are_told_and_what_to_write():
    # as sharp as the lines are apart, in noise of a fifth of each value: what tells is the peak, not stable poles
    alone = functions([192.4], [6e-4], np.ones((1, 1)), 0.0)
    rng = np.random.default_rng(3)
    value = alone.value[:, 0] * (1 + 0.2 * rng.standard_normal((1, LINES.size, 2)) @ np.array([1, 1j]))
    np.testing.assert_allclose(identified(block(value)).frequency, 192.4, rtol=1e-3)
    with pytest.raises(IdentificationError, match=r"write conjugate = true .* in a \[\[correction\]\]"):
        identified(block(value.conj()))


def test_noise_is_not_told_to_be_complex_conjugates():
    rng = np.random.default_rng(3)
    noise = rng.standard_normal((3, LINES.size, 2)) @ np.array([1, 1j])
    with pytest.raises(IdentificationError, match=r"none of .* stable poles"):
        identified(block(noise))


def test_a_peak_beside_the_flank_of_a_mode_beyond_the_band_is_found():
    frf = functions([300.0, 478.0, 503.0], [0.004, 0.006, 0.003], np.array([[1.0, 0.35, 1.0]]), 1e-3)
    assert identified(frf).frequency == pytest.approx([300.0, 478.0], rel=2e-3)


def test_a_resonance_whose_own_lines_have_spoiled_phases_is_found_by_its_flanks():
    """As of records that end too early; and all residues are turned, as by the filter of one channel."""
    rng, n, turn = np.random.default_rng(3), 10, np.exp(0.6j)
    shape = np.cos(np.pi * np.outer(np.linspace(0, 1, n), [2, 3])) + 0.15
    strong, spoiled = poles([300.0, 88.0], [0.006, 0.003])
    data = rows(functions([300.0], [0.006], shape[:, 1:], 1e-3))
    s = 2j * np.pi * LINES
    noise = np.where(np.abs(LINES - 88.0) < 1.1, 1.0, 0.05) * (rng.standard_normal((2, n, s.size)).T @ [1, 1j]).T
    value = data.value + turn * s**2 * shape[:, :1] / (s - spoiled) / 600.0 * (1.0 + noise)
    data = replace(data, value=value)
    fit, _ = take_in_peaks(data, data.linear_fit(np.array([strong])), np.empty(0, dtype=complex), (20, 500))
    assert np.sort(np.abs(fit.pole)) / (2 * np.pi) == pytest.approx([88.0, 300.0], abs=0.3)
