"""Each verdict is given where its cause is, with channel and band, and not elsewhere.

Every check has a name and a sentence, in the report and in the documents.

Peaks are those that SciPy finds.
"""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import signal

from ema.campaign.campaign import Configuration
from ema.campaign.measurement import Measurement
from ema.identification.identify import identify_frf
from ema.quality.channels import _passed, check, usable
from ema.quality.peaks import find_peaks, peak_widths
from ema.quality.verdict import CHECKS, label, meaning
from ema.types.errors import MeasurementError
from ema.types.frf import FRF, Dofs, Geometry

FREQUENCY = np.arange(20.0, 500.0, 0.5)
MODES = np.array([120.0, 210.0, 380.0])
N = 20
CONFIGURATION = Configuration(name="a", stack=None, torque=None, pressure=None, height=None, files=())


def shape(x):
    """Return three smooth shapes of unit modal mass at positions x in 0..1."""
    return np.cos(np.pi * np.outer(x, [2, 3, 4])) + 0.1


def bar(*, inputs=(1,), damping=0.01, modes=MODES, frequency=FREQUENCY, mass=1.0, noise=0.002):
    """Return a measurement on a bar with driving points at `inputs`."""
    x = np.linspace(0, 1, N)
    omega = 2 * np.pi * frequency
    one = 2 * np.pi * modes
    mode = -(omega**2) / (one[:, None] ** 2 - omega**2 + 2j * damping * one[:, None] * omega)
    value = np.einsum("or,ir,rf->oif", shape(x), shape(x[np.array(inputs) - 1]), mode) / mass
    rng = np.random.default_rng(0)
    level = noise * np.abs(value).max(axis=2, keepdims=True)
    value = value + level * (rng.normal(size=value.shape) + 1j * rng.normal(size=value.shape))
    up = [0.0, 0.0, 1.0]
    geometry = Geometry(node=np.arange(1, N + 1), coordinate=np.outer(x, [0.8, 0, 0]), line=np.empty((0, 2)))
    frf = FRF(
        frequency=frequency,
        value=value,
        quantity="accelerance",
        output=Dofs(node=geometry.node, direction=np.tile(up, (N, 1))),
        input=Dofs(node=inputs, direction=np.tile(up, (len(inputs), 1))),
        run=np.arange(N) // 2,
        source=tuple(f"run{k // 2}.uff" for k in range(N)),
    )
    return Measurement(
        name="a", configuration=CONFIGURATION, frf=frf, geometry=geometry, overload=np.zeros(N), notes=()
    )


def changed(measurement, channel, change):
    value = np.array(measurement.frf.value)
    value[channel] = change(value[channel])
    return replace(measurement, frf=replace(measurement.frf, value=value))


def found(measurement, **options):
    return {(v.check, v.level, v.channel) for v in check(measurement, **options) if v.level != "pass"}


def channels(measurement):
    return {finding for finding in found(measurement) if finding[2]}


def test_a_sound_measurement_passes_every_check():
    verdicts = check(bar())
    assert {v.level for v in verdicts} == {"pass"}
    assert len({v.check for v in verdicts}) == 15
    assert usable(bar(), verdicts).frf.value.shape == (N, 1, FREQUENCY.size)


def test_not_a_number():
    def damage(value):
        value[0, 100:105] = np.nan
        return value

    verdicts = check(changed(bar(), 4, damage))
    (verdict,) = [v for v in verdicts if v.level == "fail"]
    assert (verdict.check, verdict.channel, verdict.band) == ("number", (4,), (70.0, 72.0))
    assert verdict.message.startswith("5+z (run 3, run2.uff): 5 values are not numbers")


@pytest.mark.parametrize("factor", [0.0, 1e-5])
def test_dead(factor):
    assert found(changed(bar(), 4, lambda v: factor * v)) == {("dead", "fail", (4,))}


def noise(shape, seed=1):
    rng = np.random.default_rng(seed)
    return rng.normal(size=shape) + 1j * rng.normal(size=shape)


@pytest.mark.parametrize("n", [2, 3, 5])
@pytest.mark.parametrize("smeared", [1, 3])
def test_unplugged_channels_of_few(n, smeared):
    """Too few channels to be made of each other's resonances; a window shares noise among three lines."""
    measurement = bar()
    few = replace(measurement, frf=measurement.frf.outputs(np.arange(N) < n), overload=np.zeros(n))

    def unplug(value):
        one = np.apply_along_axis(np.convolve, -1, noise(value.shape), np.ones(smeared), mode="same")
        return 0.1 * np.std(value) * one

    (verdict,) = [v for v in check(changed(few, n - 1, unplug)) if v.level == "fail"]
    assert (verdict.check, verdict.channel) == ("dead", (n - 1,))
    assert "its phase jumps from line to line as that of noise does" in verdict.message


def test_a_channel_that_picks_up_the_force():
    measurement = bar()
    few = replace(measurement, frf=measurement.frf.outputs(np.arange(N) < 3), overload=np.zeros(3))
    flat = changed(few, 1, lambda v: 0.1 + 1e-3 * noise(v.shape))
    assert channels(flat) == {("dead", "warn", (1,))}


def test_a_set_of_noise_alone():
    measurement = bar()
    frf = replace(measurement.frf, value=noise(measurement.frf.value.shape))
    (verdict,) = [v for v in check(replace(measurement, frf=frf)) if v.check == "dead" and not v.channel]
    assert verdict.level == "warn"
    assert "is the force plugged in" in verdict.message


def test_a_channel_of_another_test():
    other = bar(modes=np.array([90.0, 260.0, 333.0])).frf.value[4]
    assert found(changed(bar(), 4, lambda _: other)) == {("dead", "fail", (4,))}


def test_a_noisy_channel():
    rng = np.random.default_rng(1)

    def damage(value):
        return value + 0.4 * np.std(value) * rng.normal(size=value.shape)

    assert channels(changed(bar(), 4, damage)) == {("unshared", "warn", (4,))}


def test_overload_of_the_records():
    assert found(replace(bar(), overload=np.eye(N)[3] * 0.02)) == {("clipped", "fail", (3,))}


def test_coherence_with_band():
    coherence = np.ones((N, 1, FREQUENCY.size))
    coherence[0, 0, 150:250] = 0.3
    measurement = bar()
    verdicts = check(replace(measurement, frf=replace(measurement.frf, coherence=coherence)))
    (verdict,) = [v for v in verdicts if v.level != "pass"]
    assert (verdict.check, verdict.channel) == ("coherence", (0,))
    assert 95 <= verdict.band[0] <= verdict.band[1] <= 144.5


def test_what_a_sensor_shows_at_rest_is_not_its_coherence():
    """An offset of an unplugged channel was all its power, and a stored coherence above 1 there let it pass."""
    measurement = bar()
    line = FREQUENCY - FREQUENCY[0]
    value, coherence = measurement.frf.value.copy(), np.full((N, 1, line.size), 0.4)
    value[..., 0], coherence[..., 0] = 1e4, 1.28
    frf = replace(measurement.frf, frequency=line, value=value, coherence=coherence)
    refused = [v for v in check(replace(measurement, frf=frf)) if v.check == "coherence"]
    assert {(v.level, v.channel) for v in refused} == {("fail", (k,)) for k in range(N)}
    assert "leave its key out" in refused[0].message
    coherence[:, 0, 5] = 1.28
    above = [v for v in check(replace(measurement, frf=replace(frf, coherence=coherence))) if "above 1" in v.message]
    assert {v.level for v in above} == {"warn"}


def test_driving_point_of_the_wrong_sign():
    # too few channels for the neighbours to tell, so the power at the driving point alone decides
    measurement = bar()
    few = replace(
        changed(measurement, 0, np.negative),
        frf=changed(measurement, 0, np.negative).frf.outputs(np.arange(N) < 4),
        overload=np.zeros(4),
    )
    assert ("sign", "fail", (0,)) in found(few)
    turned = replace(few.frf, output=Dofs(node=few.frf.output.node, direction=-few.frf.output.direction))
    assert ("sign", "fail", (0,)) not in found(replace(few, frf=turned))


def test_a_whole_set_of_the_opposite_sign_turns_the_force_and_keeps_its_driving_point():
    measurement = bar()
    turned = replace(measurement, frf=replace(measurement.frf, value=-measurement.frf.value))
    verdicts = check(turned)
    (verdict,) = [v for v in verdicts if v.level != "pass"]
    assert (verdict.check, verdict.level, verdict.channel, verdict.force) == ("force sign", "warn", (), (0,))
    kept = usable(turned, verdicts).frf
    assert kept.output.node.size == N
    np.testing.assert_array_equal(kept.input.direction, [[0.0, 0.0, -1.0]])
    assert identify_frf(kept, measurement.geometry, name="a").scaled.all()


def test_a_driving_point_against_its_neighbours_is_its_sensor():
    assert found(changed(bar(), 0, np.negative)) == {("sign", "fail", (0,))}


def test_sign_of_a_neighbour():
    assert channels(changed(bar(), 6, np.negative)) == {("sign", "fail", (6,))}


def test_sensors_that_point_the_other_way_are_no_fault():
    measurement = bar(inputs=(2,))
    turn = np.where(np.arange(N) % 3 == 0, -1.0, 1.0)[:, None]
    output = Dofs(node=measurement.frf.output.node, direction=turn * measurement.frf.output.direction)
    value = turn[:, :, None] * measurement.frf.value
    assert found(replace(measurement, frf=replace(measurement.frf, value=value, output=output))) == set()


def test_the_factor_of_a_scale_fault_is_told():
    (verdict,) = [v for v in check(changed(bar(), 6, lambda v: v / 9.80665)) if v.channel]
    assert (verdict.check, verdict.level, verdict.channel) == ("scale", "fail", (6,))
    assert float(verdict.message.split("multiplied by ")[1].split(";")[0]) == pytest.approx(9.80665, rel=0.05)


def test_too_few_channels_are_said():
    few = bar().frf.outputs(np.arange(N) < 5)
    verdicts = check(replace(bar(), frf=few, overload=np.zeros(5)))
    assert [v.message for v in verdicts if v.level == "warn"] == [
        "5 channels in one direction are too few to check sign, scale and exchange"
    ]


def test_reciprocity():
    two = bar(inputs=(2, 9))
    assert found(two) == set()
    value = np.array(two.frf.value)
    value[1, 1] *= 1.3
    assert found(replace(two, frf=replace(two.frf, value=value))) == {("reciprocity", "warn", (1, 8))}


def test_non_uniform_axis_fails_as_a_whole():
    measurement = bar()
    frequency = np.array(measurement.frf.frequency)
    frequency[300:] += 0.2
    broken = replace(measurement, frf=replace(measurement.frf, frequency=frequency))
    verdicts = check(broken)
    assert [(v.check, v.level, v.channel) for v in verdicts] == [("axis", "fail", ())]
    with pytest.raises(MeasurementError, match="not uniform, its steps are"):
        usable(broken, verdicts)


@pytest.mark.parametrize("factor", [1e-8, 1e8])
def test_size_that_no_structure_has(factor):
    measurement = bar()
    frf = replace(measurement.frf, value=factor * measurement.frf.value)
    assert found(replace(measurement, frf=frf)) == {("unit", "warn", ())}


def test_quantity_that_does_not_fit_the_phase():
    measurement = bar()
    wrong = replace(measurement.frf.convert("mobility"), quantity="accelerance")
    assert ("unit", "fail", ()) in found(replace(measurement, frf=wrong))
    assert found(replace(measurement, frf=measurement.frf.convert("mobility"))) == set()


@pytest.mark.parametrize(("damping", "lines"), [(0.01, None), (0.001, "120 Hz (0.5 lines)")])
def test_resonances_of_few_lines(damping, lines):
    verdicts = [v for v in check(bar(damping=damping, noise=1e-5)) if v.check == "resolution"]
    assert [v.level for v in verdicts] == ["pass" if lines is None else "warn"]
    if lines is not None:
        assert lines in verdicts[0].message
        assert verdicts[0].band == pytest.approx((120, 380), abs=0.1)


def test_only_the_band_is_judged():
    assert found(bar(damping=0.001, noise=1e-5), band=(125.0, 205.0)).isdisjoint({("resolution", "warn", ())})


def test_failed_channels_are_left_out_with_the_reason():
    measurement = changed(bar(), 4, lambda v: 0 * v)
    rest = usable(measurement, check(measurement))
    assert rest.frf.output.node.tolist() == [1, 2, 3, 4, *range(6, N + 1)]
    assert rest.overload.shape == (N - 1,)
    assert rest.notes[0].startswith("left out: 5+z (run 3, run2.uff): dead")


@pytest.mark.parametrize("inputs", [(1, 20, 7), pytest.param((1, 20), marks=pytest.mark.slow)])
def test_one_function_of_several_forces_that_is_turned_is_named_and_makes_no_modes(inputs):
    """Its point contradicted all others, and the rank of the residues became that of two modes at every pole."""
    sound = bar(inputs=inputs)

    def turn(value):
        value = value.copy()
        value[1] *= -1
        return value

    fault = changed(sound, 4, turn)
    assert not any(v.level == "fail" for v in check(sound))
    (failed,) = (v for v in check(fault) if v.level == "fail")
    assert (failed.check, failed.channel) == ("sign", (4,))
    assert ("20+z is turned" in failed.message) or (len(inputs) == 2 and "or the other one" in failed.message)
    model = identify_frf(usable(fault, check(fault)).frf, fault.geometry, name="a")
    np.testing.assert_allclose(model.frequency, MODES, rtol=1e-3)


def test_a_pair_of_modes_at_one_frequency_turns_no_function():
    """At a double root the forces have another proportion from point to point, without a fault."""
    sound = bar(inputs=(1, 20, 7), modes=np.array([120.0, 120.1, 380.0]))
    assert not any(v.check == "sign" and v.level == "fail" for v in check(sound))


def test_a_channel_with_noise_above_what_the_hammer_excites_is_live():
    measurement = bar()
    few = replace(measurement, frf=measurement.frf.outputs(np.arange(N) < 3), overload=np.zeros(3))
    quiet = np.arange(FREQUENCY.size) > 0.4 * FREQUENCY.size
    drowned = changed(few, 1, lambda v: np.where(quiet, 3 * np.std(v) * noise(v.shape), v))
    assert not [v for v in check(drowned) if v.check == "dead" and v.level != "pass"]


@pytest.mark.parametrize("damping", [2e-5, 2e-4, 1e-3])
@pytest.mark.parametrize("offset", [0.0, 0.3, 0.5])
def test_a_resonance_narrower_than_the_lines_is_not_of_another_quantity(damping, offset):
    """At its peak line alone it has any phase: three sound sets of five were refused."""
    lines, modes = np.arange(20.0, 500.0), np.array([120.0, 210.0, 380.0]) + offset
    measurement = bar(damping=damping, modes=modes, frequency=lines, noise=1e-4)
    assert not {f for f in found(measurement) if f[0] == "unit"}
    wrong = replace(measurement.frf.convert("mobility"), quantity="accelerance")
    reported = [v for v in check(replace(measurement, frf=wrong)) if "have the phase of mobility" in v.message]
    assert [v.level for v in reported] == ["fail" if damping > 5e-4 else "warn"]


def test_an_impossible_coherence_is_not_used():
    coherence = np.full((N, 1, FREQUENCY.size), 0.3)
    coherence[:, 0, 5] = 2.2
    measurement = bar()
    frf = replace(measurement.frf, coherence=coherence)
    reported = found(replace(measurement, frf=frf))
    assert reported == {("coherence", "warn", (k,)) for k in range(N)}


@pytest.mark.parametrize("samples", [-1.2, 1.2])
def test_a_driving_point_that_is_late_is_not_of_the_wrong_sign(samples):
    """A hammer's pulse of one to three samples has its time to a sample or so."""
    modes = np.array([310.0, 420.0, 480.0])
    measurement = bar(modes=modes)
    late = np.exp(-2j * np.pi * FREQUENCY * samples / (2.56 * FREQUENCY[-1]))
    reported = [
        v for v in check(changed(measurement, 0, lambda v: v * late)) if v.channel == (0,) and v.level != "pass"
    ]
    assert ("driving point", "warn") in {(v.check, v.level) for v in reported}
    assert not any("of the wrong sign" in v.message for v in reported)


ROOT = Path(__file__).parents[2]


def test_every_check_that_the_source_names_has_a_name_and_a_sentence():
    named = {verdict.check for verdict in _passed([])}
    for file in (ROOT / "ema" / "quality").glob("*.py"):
        text = file.read_text(encoding="utf-8")
        named |= set(re.findall(r'check="([a-z ]+)"', text))
        named |= set(re.findall(r'_verdict\(frf, "([a-z ]+)"', text))
    assert len(named) > 15
    assert named <= CHECKS.keys()
    for key in named:
        assert label(key)
        assert meaning(key).endswith(".")
    assert label("a new one") == "a new one"


def test_the_documents_explain_every_check():
    text = (ROOT / "docs" / "own_test.md").read_text(encoding="utf-8")
    for key, (name, sentence) in CHECKS.items():
        assert f"| {name} | {key} | {sentence} |" in text


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("digits", [0, 1, 9])  # rounded, it has flat tops and equal heights
def test_peaks_are_those_of_scipy(seed, digits):
    rng = np.random.default_rng(seed)
    level = np.round(np.cumsum(rng.standard_normal(700)) + 3 * rng.standard_normal(700), digits)
    lines, prominence = find_peaks(level, 2.0)
    right, properties = signal.find_peaks(level, prominence=2.0)
    np.testing.assert_array_equal(lines, right)
    np.testing.assert_array_equal(prominence, properties["prominences"])
    np.testing.assert_allclose(peak_widths(level, lines), signal.peak_widths(level, right, rel_height=0.5)[0])


@pytest.mark.parametrize(
    "level", [[], [1.0], [1.0, 2.0], [1.0, 1.0, 1.0], [3.0, 2.0, 1.0], [0.0, 1.0, 0.0], [0.0, 2.0, 2.0]]
)
def test_short_curves(level):
    level = np.array(level)
    lines, _ = find_peaks(level, 0.5)
    np.testing.assert_array_equal(lines, signal.find_peaks(level, prominence=0.5)[0])
    assert peak_widths(level, lines).size == lines.size
