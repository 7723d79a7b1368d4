"""Faults injected into synthetic sets of 44 channels are found in the right channel, and only there.

The sets: a free plate of 11 x 4 points with closed-form shapes (products of free beam functions), 4 to 10
modes in the band and three above it, damping 0.2 to 2 %, force at a random point that is not measured, two
roving accelerometers that visit the points in random order, noise of 0.1 to 5 % of each channel's rms.
"""

from dataclasses import replace

import numpy as np
import pytest

from ema.campaign.campaign import Configuration
from ema.campaign.estimate import clipped_share
from ema.campaign.measurement import Measurement
from ema.quality.channels import check
from ema.types.frf import FRF, Dofs, Geometry

NX, NY = 11, 4
FAULTS = ("swapped", "sign", "sign of runs", "scale", "dead", "clipped")  # the first word is the check that tells


def beam_shape(order, s):
    """Return the shape of a free-free beam of unit length, order 0 and 1 being its rigid-body motions."""
    if order < 2:
        return np.ones_like(s) if order == 0 else np.sqrt(3) * (2 * s - 1)
    root = {2: 4.730040744863, 3: 7.853204624096, 4: 10.995607838002}.get(order, (2 * order - 1) * np.pi / 2)
    ratio = (np.cosh(root) - np.cos(root)) / (np.sinh(root) - np.sin(root))
    return np.cosh(root * s) + np.cos(root * s) - ratio * (np.sinh(root * s) + np.sin(root * s))


ORDERS = [(2, 0), (1, 1), (3, 0), (2, 1), (4, 0), (3, 1), (5, 0), (4, 1), (0, 2), (1, 2), (6, 0), (5, 1), (2, 2)]


def plate(rng):
    """Return a faultless measurement."""
    n_mode = int(rng.integers(4, 11)) + 3
    noise = 10 ** rng.uniform(-3, np.log10(0.05))
    x, y = (v.ravel() for v in np.meshgrid(np.linspace(0, 1, NX), np.linspace(0, 1, NY)))
    force = rng.uniform(0, 1, (2, 1))
    shape, at_force = (
        np.array([beam_shape(i, u) * beam_shape(j, v) for i, j in ORDERS[:n_mode]]).T for u, v in ((x, y), force)
    )
    one = 2 * np.pi * np.concatenate([np.sort(rng.uniform(150, 1400, n_mode - 3)), [2300, 2600, 3100]])
    damping = 10 ** rng.uniform(np.log10(0.002), np.log10(0.02), n_mode)
    frequency = np.arange(100, 1500.1, 1.0)
    omega = 2 * np.pi * frequency
    mode = -(omega**2) / (one[:, None] ** 2 - omega**2 + 2j * damping[:, None] * one[:, None] * omega)
    rigid = 1 + 3 * (2 * x - 1) * (2 * force[0] - 1) + 3 * (2 * y - 1) * (2 * force[1] - 1)
    value = ((shape * at_force) @ mode + rigid[:, None]) / 5.0  # 5 kg
    level = noise * np.sqrt(np.mean(np.abs(value) ** 2, axis=1, keepdims=True) / 2)
    value += level * (rng.normal(size=value.shape) + 1j * rng.normal(size=value.shape))
    n = NX * NY
    run = np.empty(n, dtype=int)
    run[rng.permutation(n)] = np.arange(n) // 2
    geometry = Geometry(
        node=np.arange(1, n + 1), coordinate=np.column_stack([0.5 * x, 0.08 * y, np.zeros(n)]), line=np.empty((0, 2))
    )
    frf = FRF(
        frequency=frequency,
        value=value[:, None],
        quantity="accelerance",
        output=Dofs(node=geometry.node, direction=np.tile([0.0, 0.0, 1.0], (n, 1))),
        input=Dofs(node=[99], direction=[[0.0, 0.0, 1.0]]),
        run=run,
        source=tuple(f"run{k}.uff" for k in run),
    )
    empty = Configuration(name="plate", stack=None, torque=None, pressure=None, height=None, files=())
    return Measurement(name="plate", configuration=empty, frf=frf, geometry=geometry, overload=np.zeros(n), notes=())


def inject(measurement, fault, rng):
    """Return the measurement with one fault, and the channels that have it."""
    value, overload = np.array(measurement.frf.value), np.array(measurement.overload)
    first, second = (int(i) for i in rng.choice(len(value), 2, replace=False))
    channels = (first,)
    level = np.sqrt(np.mean(np.abs(value[first]) ** 2))
    if fault == "swapped":
        value[[first, second]] = value[[second, first]]
        channels = tuple(sorted((first, second)))
    elif fault == "sign":
        value[first] *= -1
    elif fault == "sign of runs":  # the force was turned in some
        run = measurement.frf.run
        turned = np.isin(run, rng.choice(run.max() + 1, rng.integers(2, 9), replace=False))
        value[turned] *= -1
        channels = tuple(np.flatnonzero(turned).tolist())
    elif fault == "scale":
        value[first] *= np.exp(rng.choice([-1, 1]) * rng.uniform(np.log(1.5), np.log(10)))
    elif fault == "dead":  # the noise of an open input, 0.1 to 10 % of the signal
        noise = rng.normal(size=value.shape[2]) + 1j * rng.normal(size=value.shape[2])
        value[first, 0] = 10 ** rng.uniform(-3, -1) * level * noise
    elif rng.random() < 0.5:  # clipped, seen in the function: peaks stop at one height
        size = np.abs(value[first])
        value[first] *= np.minimum(1, rng.uniform(0.3, 0.7) * size.max() / size)
    else:  # clipped, seen in the record of a random response
        value[first, 0], overload[first] = overloaded(value[first, 0], rng)
    return replace(measurement, frf=replace(measurement.frf, value=value), overload=overload), channels


def overloaded(function, rng):
    """Return the H1 of a response that is cut at 1.5 to 2.5 times its rms, and the share of its samples there."""
    n_block, n = 30, 4096
    start = 100
    cross, power, share = np.zeros(function.size, complex), np.zeros(function.size), 0.0
    limit = rng.uniform(1.5, 2.5)
    for _ in range(n_block):
        spectrum = np.zeros(n // 2 + 1, complex)
        force = np.exp(2j * np.pi * rng.uniform(size=function.size)) * rng.rayleigh(size=function.size)
        spectrum[start : start + function.size] = function * force
        record = np.fft.irfft(spectrum, n)
        cap = limit * np.std(record)
        record = np.clip(record, -cap, cap)
        share += clipped_share(record) / n_block
        cross += np.fft.rfft(record)[start : start + function.size] * force.conj()
        power += np.abs(force) ** 2
    return cross / power, share


def named(verdicts):
    return [(v.check, v.channel) for v in verdicts if v.channel and v.level != "pass"]


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_named_with_its_channel(fault):
    rng = np.random.default_rng(7)
    measurement, channels = inject(plate(rng), fault, rng)
    assert named(check(measurement)) == [(fault.split()[0], channels)]


def test_a_sound_set_raises_no_alarm():
    assert named(check(plate(np.random.default_rng(8)))) == []


def test_runs_whose_force_was_turned_are_told_as_these():
    rng = np.random.default_rng(7)
    measurement, channels = inject(plate(rng), "sign of runs", rng)
    numbers = ", ".join(str(k + 1) for k in np.unique(measurement.frf.run[list(channels)]))
    (message,) = [v.message for v in check(measurement) if v.check == "sign" and v.level == "fail"]
    assert message.startswith(f"all functions of runs {numbers} are turned")


def test_two_faults_are_both_named():
    rng = np.random.default_rng(9)
    measurement, first = inject(plate(rng), "sign", rng)
    measurement, second = inject(measurement, "scale", rng)
    assert first != second
    assert sorted(named(check(measurement))) == sorted([("sign", first), ("scale", second)])


def shifted(measurement, rng, largest):
    """Return the measurement with the resonances of each run shifted, as by a roving sensor's mass."""
    value, frequency = np.array(measurement.frf.value[:, 0]), measurement.frf.frequency
    for run in np.unique(measurement.frf.run):
        stretched = frequency * (1 + largest * rng.random())
        for channel in np.flatnonzero(measurement.frf.run == run):
            parts = (np.interp(stretched, frequency, p) for p in (value[channel].real, value[channel].imag))
            value[channel] = next(parts) + 1j * next(parts)
    return replace(measurement, frf=replace(measurement.frf, value=value[:, None]))


def test_shifted_runs_accuse_no_channel():
    # set 4 was one of those in which the likeliest fault is a corner of the wrong scale
    rng = np.random.default_rng([9, 4])
    verdicts = check(shifted(plate(rng), rng, 0.003))
    assert named(verdicts) == []
    assert ("neighbours", "warn") in [(v.check, v.level) for v in verdicts]


@pytest.mark.benchmark
def test_study_of_injected_faults(capsys):
    n_set = 100
    lines = []
    for fault in FAULTS:
        right = others = 0
        for seed in range(n_set):
            rng = np.random.default_rng([1, seed])
            measurement, channels = inject(plate(rng), fault, rng)
            found = named(check(measurement))
            right += (fault.split()[0], channels) in found
            others += any(c not in channels for _, group in found for c in group)
        lines.append((fault, right / n_set, others / n_set))
    alarms = sum(bool(named(check(plate(np.random.default_rng([2, seed]))))) for seed in range(n_set)) / n_set
    rngs = [np.random.default_rng([3, seed]) for seed in range(n_set)]
    on_shift = sum(bool(named(check(shifted(plate(rng), rng, 0.003)))) for rng in rngs) / n_set
    with capsys.disabled():
        print(f"\ninjected faults, {n_set} sets of 44 channels each")
        for fault, right, others in lines:
            print(
                f"  {fault:12s} named with the right channel {100 * right:5.1f} %, others accused {100 * others:4.1f} %"
            )
        print(f"  false alarms in sound sets {100 * alarms:.1f} %")
        print(f"  false alarms where runs are shifted by up to 0.3 % {100 * on_shift:.1f} %")
    assert all(right >= 0.95 for _, right, _ in lines)
    assert alarms <= 0.05
    assert on_shift <= 0.05
