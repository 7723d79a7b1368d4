"""What a user is told about a measurement."""

from types import SimpleNamespace

import numpy as np

from ema import Verdict
from updating.results.quality import quality


def found(probability, frequency):
    model = SimpleNamespace(
        run=np.array([0, 1, 2]),
        frequency=np.array([100.0, 200.0]),
        run_frequency=np.array(frequency),
        disagreeing_runs=lambda: np.array(probability) < 0.05,
    )
    verdicts = (
        Verdict(check="dead", level="pass", channel=(), band=None, message="every channel responds"),
        Verdict(check="sign", level="warn", channel=(3,), band=None, message="12+z looks turned"),
    )
    return SimpleNamespace(
        verdicts=verdicts,
        measurement=SimpleNamespace(notes=("12+z measured twice",)),
        modal_model=model,
        explained=None,
    )


def test_a_shifted_run_is_named_with_its_modes_and_shifts():
    agree = np.ones((3, 2))
    probability = agree.copy()
    probability[1, 1] = 0.001
    frequency = [[100.0, 200.0], [100.0, 199.8], [100.0, 200.0]]
    findings = quality(found(probability, frequency)).findings
    assert findings == (
        "warn: sign: 12+z looks turned",
        "12+z measured twice",
        "run 2 disagrees with the others: 200.0 Hz by -0.100 %; a sensor's mass does this",
    )
    assert len(quality(found(agree, frequency)).findings) == 2


def test_a_run_whose_modes_all_move_alike_is_no_sensor_mass():
    # nine blows with one fixed sensor: the beam warmed up, and a sensor's mass was blamed
    model = SimpleNamespace(
        run=np.array([0, 1, 2]),
        frequency=np.array([100.0, 200.0, 300.0]),
        run_frequency=np.array([[100.0, 200.0, 300.0], [99.99, 199.982, 299.97], [100.0, 200.0, 300.0]]),
        disagreeing_runs=lambda: np.array([[False] * 3, [True] * 3, [False] * 3]),
    )
    told = SimpleNamespace(
        verdicts=(), measurement=SimpleNamespace(notes=()), modal_model=model, explained=None
    )
    (line,) = quality(told).findings
    assert line.endswith("300.0 Hz by -0.010 %; all modes alike, as temperature or settling moves them")


def test_many_runs_that_differ_are_one_line():
    moved = np.array([1.0, 0.9998, 0.9996, 1.0, 1.0002, 1.0004])
    model = SimpleNamespace(
        run=np.arange(6),
        frequency=np.array([100.0]),
        run_frequency=100.0 * moved[:, None],
        disagreeing_runs=lambda: np.abs(moved - 1.0)[:, None] > 1e-4,
    )
    told = SimpleNamespace(
        verdicts=(), measurement=SimpleNamespace(notes=()), modal_model=model, explained=None
    )
    assert quality(told).findings == (
        "4 of 6 runs disagree with the others, in the median by 0.03 % and at most by 0.04 % (run 3 at 100.0 Hz); "
        "a sensor's mass does this",
    )
