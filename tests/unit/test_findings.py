"""What a user reads about a measurement."""

from types import SimpleNamespace

import numpy as np
import pytest

from ema import Verdict
from ema.modal.runs import run_changes
from ema.types.frf import Dofs
from updating.results.identified import quality

MODES = np.array([100.0, 200.0, 300.0])


def roved(shift, *, shape=None, scaled=False, std=1e-6):
    """Modes of runs that are off by shares of frequencies, (n_run, n_mode); an output a run, no driving point."""
    shift = np.array(shift)
    n_run, n_mode = shift.shape
    frequency = MODES[:n_mode]
    pole = 2.0 * np.pi * frequency * (1j - 0.005)
    run_std = np.full(shift.shape, std) * frequency
    up = np.tile([0.0, 0.0, 1.0], (n_run, 1))
    shape = np.ones(shift.shape) if shape is None else np.array(shape)
    return SimpleNamespace(
        node=np.arange(n_run),
        direction=up,
        input=Dofs(node=[n_run], direction=up[:1]),
        run=np.arange(n_run),
        frequency=frequency,
        frequency_std=run_std.min(axis=0) / np.sqrt(n_run),
        pole=pole,
        residue=(shape / (2j * pole.imag))[:, None, :],
        run_pole=pole * (1.0 + shift),
        run_frequency_std=run_std,
        decay_rate=0.0,
        run_frequency=frequency * (1.0 + shift),
        resolved_run_std=run_std,
        disagreeing_runs=lambda: np.abs(shift - np.median(shift, axis=0)) > 5.0 * std,
        shape=shape,
        scaled=np.full(n_mode, scaled),
        sensor_mass=0.0,
    )


def changes(model, *, sensors_rove=True):
    return run_changes(model, model.run, sensors_rove=sensors_rove)


def test_a_shifted_run_is_named_with_its_modes_and_shifts():
    verdicts = (
        Verdict(check="dead", level="pass", channel=(), band=None, message="every channel responds"),
        Verdict(check="sign", level="warn", channel=(3,), band=None, message="12+z looks turned"),
    )

    def found(shift):
        frf = SimpleNamespace(run=np.arange(3), reciprocal=False)
        measurement = SimpleNamespace(notes=("12+z measured twice",), frf=frf)
        return SimpleNamespace(verdicts=verdicts, measurement=measurement, modal_model=roved(shift), explained=None)

    assert quality(found([[0, 0], [0, -1e-3], [0, 0]])).findings == (
        "sign of the sensors: warning: 12+z looks turned",
        "12+z measured twice",
        "run 2 disagrees with the others: 200.0 Hz by -0.100 %; scatter between runs, which neither a sensor's mass "
        "nor a drift explains",
    )
    assert len(quality(found(np.zeros((3, 2)))).findings) == 2


def test_runs_whose_modes_all_move_alike_are_no_sensor_mass():
    # nine blows with one fixed sensor: the beam warmed up, and a sensor's mass was blamed
    model = roved(np.outer([0.0, -1e-4, 0.0, 2e-4, 1e-4, 0.0], np.ones(3)))
    assert changes(model).finding == (
        "runs 2, 4, 5 disagree with the others: "
        "run 2: 100.0 Hz by -0.010 %, 200.0 Hz by -0.010 %, 300.0 Hz by -0.010 %; "
        "run 4: 100.0 Hz by +0.020 %, 200.0 Hz by +0.020 %, 300.0 Hz by +0.020 %; "
        "run 5: 100.0 Hz by +0.010 %, 200.0 Hz by +0.010 %, 300.0 Hz by +0.010 %; "
        "all modes of a run move alike, as temperature or settling moves them"
    )


def test_a_drift_follows_the_order_of_the_runs():
    found = changes(roved(np.outer(np.linspace(0.0, 1e-3, 7), np.ones(3))))
    assert found.cause == "drift"
    assert found.finding.endswith("by +0.1 % from the first to the last")


@pytest.mark.parametrize("scaled", [True, False])
def test_shifts_by_the_square_of_the_shapes_are_a_mass(scaled):
    rng = np.random.default_rng(0)
    shape = rng.standard_normal((8, 3))
    model = roved(-0.5 * 2e-3 * shape**2 + 1e-5 * rng.standard_normal((8, 3)), shape=shape, scaled=scaled)
    found = changes(model)
    assert found.cause == "sensor mass"
    assert found.finding.endswith("where they sit: 2 g each" if scaled else "where they sit")
    # where a hammer roves, one sensor stays and moves nothing from run to run
    assert changes(model, sensors_rove=False).cause == "scatter"


def test_a_mode_that_no_run_determines_says_nothing_of_the_others():
    shift = np.outer(np.linspace(0.0, 1e-3, 7), np.ones(3))
    model = roved(shift)
    model.resolved_run_std[:, 2] = np.inf
    found = changes(model)
    assert found.cause == "drift"
    assert found.finding.endswith("by +0.1 % from the first to the last")


def test_shifts_upwards_or_by_several_masses_are_no_mass():
    rng = np.random.default_rng(1)
    shape = rng.standard_normal((8, 3))
    upwards = roved(1e-3 * shape**2, shape=shape)
    assert changes(upwards).cause == "scatter"
    several = roved(-1e-3 * np.array([1.0, 0.0, -1.0]) * shape**2, shape=shape, scaled=True)
    assert changes(several).cause == "scatter"


def test_many_runs_that_differ_are_one_line():
    shift = np.array([0.0, -2e-4, -4e-4, 0.0, 2e-4, 4e-4])
    assert changes(roved(shift[:, None])).finding == (
        "4 of 6 runs disagree with the others, in the median by 0.03 % and at most by 0.04 % (run 3 at 100.0 Hz); "
        "scatter between runs, which neither a sensor's mass nor a drift explains"
    )


def test_chance_is_rarely_taken_for_a_mass():
    causes = []
    for seed in range(25):
        rng = np.random.default_rng([5, seed])
        causes.append(changes(roved(1e-4 * rng.standard_normal((6, 3)), shape=rng.random((6, 3)))).cause)
    assert causes.count("sensor mass") == 0  # of 50, one may be
    assert causes.count("scatter") >= 24
