"""Modes over amplitude: a structure that softens, played line by line, at several forces.

A free decay through all amplitudes of a mode that softens.
"""

from dataclasses import replace

import numpy as np
import pytest

from ema.campaign.campaign import read_campaign
from ema.identification.amplitude import Level, amplitude_dependence, identify_force_levels, resonances, ring_down
from ema.identification.identify import identify_frf
from ema.plot.figures import amplitude_figure
from ema.types.errors import MeasurementError
from ema.types.frf import FRF, Dofs, Geometry
from updating.commands.command_line import ema
from updating.results.campaign import over_amplitude, stored_amplitude
from updating.results.identified import assignments, read_back

FREQUENCY = np.arange(90.0, 260.0, 0.2)
MODES = np.array([120.0, 210.0])
DAMPING = 0.01
N = 8
X = np.linspace(0, 1, N)
SHAPE = np.cos(np.pi * np.outer(X, [2, 3])) + 0.1
UP = [0.0, 0.0, 1.0]
GEOMETRY = Geometry(node=np.arange(1, N + 1), coordinate=np.outer(X, [0.8, 0, 0]), line=np.empty((0, 2)))


def stiffness(r, a, slope):
    """omega**2 (1 + i loss) of a mode at amplitudes a: both follow the root of the amplitude."""
    lost = slope * np.sqrt(a)
    return (2 * np.pi * MODES[r]) ** 2 * (1 - lost + 1j * (2 * DAMPING + 0.3 * lost))


def mode(r, force, slope):
    """Receptance of a mode over the force on it, and its largest amplitude, by bisection of the amplitude."""
    omega = 2 * np.pi * FREQUENCY
    low, high = np.zeros(omega.size), np.full(omega.size, force / (DAMPING * (2 * np.pi * MODES[r]) ** 2))
    for _ in range(60):
        middle = (low + high) / 2
        more = force / np.abs(stiffness(r, middle, slope) - omega**2) > middle
        low, high = np.where(more, middle, low), np.where(more, high, middle)
    return 1 / (stiffness(r, low, slope) - omega**2), low.max()


def measured(force, drop, noise=0.005, seed=0):
    """Functions at a force, and frequencies, damping ratios and largest amplitudes of the modes."""
    value, largest, slope = 0, [], []
    for r in range(2):
        linear = abs(SHAPE[0, r]) / (2 * DAMPING * (2 * np.pi * MODES[r]) ** 2)
        slope.append(2 * drop / np.sqrt(linear))
        h, a = mode(r, force * abs(SHAPE[0, r]), slope[-1])
        value = value + np.outer(SHAPE[:, r] * SHAPE[0, r], h)
        largest.append(a)
    rng = np.random.default_rng(seed)
    value = value * -((2 * np.pi * FREQUENCY) ** 2)
    rms = np.sqrt(np.mean(np.abs(value) ** 2, axis=1, keepdims=True) / 2)
    value = value + noise * rms * (rng.normal(size=value.shape) + 1j * rng.normal(size=value.shape))
    frf = FRF(
        frequency=FREQUENCY,
        value=value[:, None],
        quantity="accelerance",
        output=Dofs(node=np.arange(1, N + 1), direction=np.tile(UP, (N, 1))),
        input=Dofs(node=[1], direction=[UP]),
        run=np.zeros(N, dtype=int),
        source=("played",) * N,
    )
    at = np.array([stiffness(r, a, k) for r, (a, k) in enumerate(zip(largest, slope, strict=True))])
    return frf, np.sqrt(at.real) / 2 / np.pi, at.imag / at.real / 2, np.array(largest)


def level(force, drop=0.05, **given):
    frf, *truth = measured(force, drop, **given)
    return Level(force=force, frf=frf, modal_model=identify_frf(frf, GEOMETRY, name=f"{force:g} N")), truth


@pytest.fixture(scope="module")
def levels():
    return [level(force) for force in (1.0, 0.1, 0.01)]


def test_a_leaning_resonance_gives_the_mode_at_its_amplitude(levels):
    found, (frequency, damping, amplitude) = levels[0]
    linear, one = found.modal_model, resonances(found.frf, found.modal_model)
    assert np.all(np.abs(linear.frequency / frequency - 1) > 2e-3)  # a pole is that of no amplitude
    np.testing.assert_allclose(one.frequency, frequency, rtol=1e-4)
    np.testing.assert_allclose(one.damping, damping, rtol=1e-2)
    np.testing.assert_allclose(one.response[0, 0], amplitude * np.abs(SHAPE[0]), rtol=1e-2)


def test_a_linear_structure_is_left_as_it_is():
    found, (frequency, damping, amplitude) = level(1.0, drop=0.0)
    one = resonances(found.frf, found.modal_model)
    assert np.all(np.abs(one.frequency - frequency) < 4 * one.frequency_std)
    assert np.all(np.abs(one.damping - damping) < 4 * one.damping_std)
    np.testing.assert_allclose(one.response[0, 0], amplitude * np.abs(SHAPE[0]), rtol=5e-3)


def test_a_window_is_taken_out_here_as_in_the_poles():
    found, _ = level(1.0, drop=0.0)
    windowed = replace(found.modal_model, decay_rate=2.0)
    one, plain = (resonances(found.frf, model) for model in (windowed, found.modal_model))
    np.testing.assert_allclose(plain.damping - one.damping, 2.0 / (2 * np.pi * plain.frequency), rtol=1e-6)


def test_few_lines_leave_the_mode_as_it_was_identified():
    found, _ = level(1.0, drop=0.0)
    thin = replace(found.frf, frequency=FREQUENCY[::8], value=found.frf.value[..., ::8])
    one = resonances(thin, found.modal_model)
    np.testing.assert_array_equal(one.frequency, found.modal_model.frequency)
    np.testing.assert_allclose(one.response[0, 0], resonances(found.frf, found.modal_model).response[0, 0], rtol=2e-2)


def test_modes_are_followed_over_levels_in_the_order_of_the_force(levels):
    found = amplitude_dependence("M1", [one for one, _ in levels])
    assert found.level == ("0.01 N", "0.1 N", "1 N")
    assert found.point == "1+z"
    truth = [t for _, t in reversed(levels)]
    np.testing.assert_allclose(found.frequency, [t[0] for t in truth], rtol=1e-4)
    np.testing.assert_allclose(found.damping, [t[1] for t in truth], rtol=2e-2)
    np.testing.assert_allclose(found.motion, [t[2] * np.abs(SHAPE[0]) for t in truth], rtol=3e-2)
    np.testing.assert_allclose(found.softening, truth[-1][0] / truth[0][0] - 1, atol=2e-4)
    assert np.all(found.mac > 0.99)
    assert all("contact that slips does this" in text for text in found.findings)
    assert "at 1+z the frequency changes by -" in found.findings[0]


def test_a_mode_that_a_level_lacks_leaves_a_gap(levels):
    first, second = levels[2][0], levels[0][0]
    short = identify_frf(second.frf, GEOMETRY, name="short", band=(150.0, 260.0))
    found = amplitude_dependence("M1", [first, replace(second, modal_model=short)])
    assert np.isnan(found.frequency[1, 0])
    assert found.mode.tolist() == [[0, 1], [-1, 0]]
    assert np.isnan(found.softening[0])
    assert len(found.findings) == 1


def test_a_linear_structure_is_not_said_to_slip():
    said = [
        text
        for seed in range(3)
        for text in amplitude_dependence(
            "M1", [level(f, drop=0.0, seed=10 * seed + k)[0] for k, f in enumerate((0.1, 1.0))]
        ).findings
    ]
    assert len(said) == 6
    assert all("no change with amplitude shows" in text for text in said)


def test_the_figure_has_a_line_for_every_mode(levels):
    left, right = amplitude_figure(amplitude_dependence("M1", [one for one, _ in levels])).axes
    assert len(left.containers) == len(right.containers) == 2
    assert left.get_xlabel() == "displacement amplitude at 1+z [µm]"


@pytest.fixture
def campaign_file(tmp_path, campaign_text):
    """A campaign of one state at 0.1 N, 1 N and 2 N; nothing was measured at the last but noise."""
    rows = [f"{n},{1e3 * 0.8 * x},0,0" for n, x in zip(range(1, N + 1), X, strict=True)]
    (tmp_path / "points.csv").write_text("\n".join(["node,x,y,z", *rows]))
    rng = np.random.default_rng(3)
    for name, force in (("low", 0.1), ("high", 1.0), ("noise", 2.0)):
        value = measured(min(force, 1.0), 0.05)[0].value[:, 0]
        value = value if name != "noise" else rng.normal(size=value.shape) + 1j * rng.normal(size=value.shape)
        columns = [FREQUENCY, *(p for v in value for p in (v.real, v.imag))]
        np.savetxt(tmp_path / f"{name}.csv", np.column_stack(columns), delimiter=",")
    dofs = ", ".join(f'"{n}+z"' for n in range(1, N + 1))
    levels = "".join(
        f'[[configuration.force_level]]\nforce_N = {force}\nfiles = ["{name}.csv"]\n'
        for name, force in (("high", 1), ("noise", 2))
    )
    given = f'force_N = 0.1\nfiles = ["low.csv"]\noutput = [{dofs}]\ninput = ["1+z"]\n'
    (tmp_path / "campaign.toml").write_text(campaign_text + given + levels)
    return tmp_path / "campaign.toml"


def test_levels_of_a_campaign_are_identified_and_one_that_cannot_be_is_named(campaign_file):
    (found,), lost = identify_force_levels(read_campaign(campaign_file), "M1")
    assert found.force == 1.0
    assert [text[:51] for text in lost] == ["M1 at 2 N is left out of the modes over amplitude: "]
    np.testing.assert_allclose(resonances(found.frf, found.modal_model).frequency, measured(1.0, 0.05)[1], rtol=1e-4)


def test_amplitude_is_a_result_of_the_identification(campaign_file, tmp_path, capsys):
    ema(campaign_file, tmp_path / "out")
    (assigned,) = assignments(read_campaign(campaign_file), tmp_path / "out")
    over = stored_amplitude(read_back(assigned))
    assert over.dependence.level == ("M1", "M1 at 1 N")
    np.testing.assert_array_equal(over.level[1].frequency, over.dependence.frequency[1])
    assert (tmp_path / "out/M1/amplitude.png").stat().st_size > 1e4
    printed = " ".join(capsys.readouterr().out.split())
    assert "M1 over amplitude: motion at 1+z" in printed
    assert "contact that slips does this" in printed
    assert "M1 at 2 N is left out" in printed
    written = (tmp_path / "out/M1/amplitude.json").stat().st_mtime_ns
    over_amplitude(assigned, read_back(assigned))
    assert (tmp_path / "out/M1/amplitude.json").stat().st_mtime_ns == written  # read back, not made anew


def test_without_a_force_of_its_own_a_configuration_says_what_is_missing(campaign_file, tmp_path, capsys, undrawn):
    campaign_file.write_text(campaign_file.read_text().replace("force_N = 0.1\n", ""))
    ema(campaign_file, tmp_path / "out")
    assert "M1: with its own force_N, its modes over amplitude would be shown" in capsys.readouterr().out
    assert not (tmp_path / "out/M1/amplitude.json").exists()


RATE = 4000.0
DECAYING = np.array([60.0, 95.0])
DECAYING_SHAPE = np.array([[1.0, 0.8], [0.5, -1.0], [-0.7, 0.6]])


def decay(drop, damping=0.004, noise=0.0, duration=2.0):
    """Displacements of three channels in two modes, whose frequency is lower by drop a**2 at amplitude a from 1 on."""
    omega, time = 2 * np.pi * DECAYING[:, None], np.arange(0, duration, 1 / RATE)
    envelope = np.exp(-damping * omega * time)
    phase = omega * time - drop * (1 - envelope**2) / (2 * damping)  # the integral of the frequency
    q = np.array([[1.0], [0.5]]) * envelope * np.cos(phase)
    return DECAYING_SHAPE @ q + noise * np.random.default_rng(0).standard_normal((3, time.size))


def follow(record, mode=0, **given):
    return ring_down(
        record,
        RATE,
        **{"shape": DECAYING_SHAPE, "frequency": DECAYING, "mode": mode, "quantity": "receptance", **given},
    )


def test_a_linear_decay_has_one_frequency_and_damping():
    for mode in range(2):
        found = follow(decay(0.0), mode)
        np.testing.assert_allclose(found.frequency, DECAYING[mode], rtol=1e-4)
        np.testing.assert_allclose(found.damping, 0.004, rtol=3e-2)


def test_a_softening_mode_is_followed_down_its_backbone():
    found = follow(decay(0.03, noise=1e-3))
    assert found.amplitude[0] > 3 * found.amplitude[-1]
    expected = DECAYING[0] * (1 - 0.03 * found.amplitude**2)
    np.testing.assert_allclose(found.frequency, expected, rtol=1e-3)
    assert found.frequency[0] < 0.992 * DECAYING[0]
    np.testing.assert_allclose(found.damping, 0.004, rtol=0.15)


def test_amplitude_is_displacement_whatever_was_measured():
    record = decay(0.0)
    spectrum = np.fft.rfft(record)
    omega = 2 * np.pi * np.fft.rfftfreq(record.shape[1], 1 / RATE)
    velocity = np.fft.irfft(1j * omega * spectrum, record.shape[1])
    first, second = follow(record), follow(velocity, quantity="mobility")
    np.testing.assert_allclose(second.amplitude[2:-2], first.amplitude[2:-2], rtol=2e-2)


def test_one_channel_is_filtered_by_its_band_alone():
    found = follow(decay(0.0)[:1], shape=DECAYING_SHAPE[:1])
    np.testing.assert_allclose(found.frequency, DECAYING[0], rtol=1e-3)


def test_noise_at_the_end_is_not_fitted():
    found = follow(decay(0.0, damping=0.02, noise=5e-3))
    assert found.amplitude.size < 0.5 * follow(decay(0.0, damping=0.002)).amplitude.size
    np.testing.assert_allclose(found.damping, 0.02, rtol=0.2)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"shape": DECAYING_SHAPE[:2]}, "3 channels, shapes of 2 channels and 2 modes"),
        ({"frequency": DECAYING[:1]}, "and 1 frequencies do not belong together"),
    ],
)
def test_what_does_not_fit_is_refused(change, message):
    with pytest.raises(MeasurementError, match=message):
        follow(decay(0.0, duration=0.2), **change)


def test_a_record_that_is_too_short_is_refused():
    with pytest.raises(MeasurementError, match="too short, or too noisy, for a mode at 60 Hz"):
        follow(decay(0.0, duration=0.2))
