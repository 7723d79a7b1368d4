"""Time and memory of the identification."""

import subprocess
import sys
import time
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from ema.identification.stabilization import lscf_poles
from ema.types.frf import Dofs

pytestmark = pytest.mark.benchmark
NONE = "not automatic"


ALONE = """
import re, sys, time
import numpy as np
import ema
value = np.load(sys.argv[1])
n = len(value)
up = np.tile([0.0, 0.0, 1.0], (n, 1))
frf = ema.FRF(
    frequency=np.arange(0.5, 2000.25, 0.5), value=value[:, None], quantity="accelerance",
    output=ema.Dofs(node=np.arange(n), direction=up), input=ema.Dofs(node=[0], direction=up[:1]),
    run=np.zeros(n, dtype=int), source=("generated",) * n,
)
geometry = ema.Geometry(node=np.arange(n), coordinate=np.outer(np.arange(n), [0.1, 0, 0]), line=np.zeros((0, 2)))
start = time.process_time()
assert ema.identify_frf(frf, geometry, name="set").frequency.size == 6
seconds = time.process_time() - start
# the peak that getrusage tells would be that of the process this one was started from
print(seconds, int(re.search(r"VmHWM:\\s+(\\d+)", open("/proc/self/status").read())[1]) / 1024)
"""


def whole_identification(value: NDArray, folder: Path) -> tuple[float, float]:
    """Processor seconds of an identification, and peak memory (MB) of the process that loads and identifies."""
    np.save(folder / "value.npy", value)
    command = [sys.executable, "-c", ALONE, str(folder / "value.npy")]
    seconds, peak = subprocess.run(command, check=True, capture_output=True, text=True).stdout.split()
    return float(seconds), float(peak)


def polypy_seconds(sets, peers, value: NDArray) -> str:
    if not peers.has_polypy:
        return "not installed"
    peers.polypy(value, sets.lines, 4)  # the import takes seconds
    start = time.perf_counter()
    peers.polypy(value, sets.lines, 100)
    return f"{time.perf_counter() - start:.2f} s"


def test_speed_beside_sdypy(sets, peers, report, tmp_path: Path):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        from sdypy.EMA import Model
    frf, truth = sets.noisy(np.random.default_rng(7), sets.frequency, sets.damping, 0.01)
    value = frf.value[:, 0]
    ours, theirs = [], []
    for _ in range(5):
        start = time.process_time()
        poles = lscf_poles(sets.lines, value[:, None], 100)[-1]
        ours.append(time.process_time() - start)
        padded = np.concatenate([np.zeros((sets.n, 1)), value, np.zeros((sets.n, 1))], axis=1)
        axis = 0.5 * np.arange(padded.shape[1])
        model = Model(padded, axis, lower=0.5, upper=axis[-1], pol_order_high=100)
        start = time.process_time()
        model.get_poles(show_progress=False)
        theirs.append(time.process_time() - start)
    peer = np.asarray(model.all_poles[-1])
    difference = max(
        float(np.min(np.abs(peer - p)) / np.abs(p))
        for p in poles[[int(np.argmin(np.abs(poles - q))) for q in truth.pole]]
    )
    ratio = min(theirs) / min(ours)
    report(
        "poles at order 100",
        "3 x faster than sdypy-EMA, same to 1e-8",
        f"{min(ours):.2f} s, {ratio:.2f} x faster, {difference:.1e}",
        f"{min(theirs):.2f} s",
        polypy_seconds(sets, peers, value),
    )
    seconds, peak = whole_identification(value, tmp_path)
    report(
        "whole identification, intervals included",
        "what sdypy-EMA takes for poles alone, 300 MB",
        f"{seconds:.2f} s, {peak:.0f} MB in a process of its own",
        NONE,
        NONE,
    )
    assert ratio >= 3.0
    assert difference < 1e-8
    assert seconds < min(theirs)
    assert peak < 300.0


def of_runs(sets, n_run: int, per_run: int, rng: np.random.Generator):
    """Return functions of roving runs, each with natural frequencies of its own that are off by some 0.1 %."""
    few = replace(sets, n=n_run * per_run, lines=sets.lines[:1601])
    whole, truth = few.noisy(rng, few.frequency / 2.5, few.damping, 0.01)
    run, value = np.repeat(np.arange(n_run), per_run), np.array(whole.value[:, 0])
    for number in range(n_run):
        moved = truth.frequency * (1.0 + 1e-3 * rng.standard_normal(truth.frequency.size))
        of_run, _ = few.noisy(rng, moved, truth.damping, 0.01, phi=truth.shape)
        value[run == number] = of_run.value[run == number, 0]
    return few, few.block(value, "accelerance", 0, run)


def seconds_of(few, frf) -> float:
    start = time.process_time()
    few.identified(frf)
    return time.process_time() - start


def test_runs_cost_no_more_than_linear_time(sets, report):
    rng = np.random.default_rng(11)
    few, many = (seconds_of(*of_runs(sets, n_run, 3, rng)) for n_run in (5, 20))
    report("20 roving runs of 3 sensors", "4 times 5 runs", f"{many:.1f} s, {many / few:.1f} times", NONE, NONE)
    assert many < 1.2 * 4 * few


def test_a_roving_hammer_takes_a_minute(sets, report):
    """Of 74 points and 3 sensors, 222 functions of 1601 lines, as one run."""
    few = replace(sets, n=74, lines=np.arange(1601) * 0.125 + 0.125)
    rng = np.random.default_rng(12)
    frequency = np.array([18.9, 40.1, 87.8, 89.6, 97.1, 105.2, 118.0, 125.5, 130.0, 135.0, 143.5, 166.3])
    damping = np.array([34, 31, 47, 36, 16, 10, 44, 43, 84, 89, 65, 12]) * 1e-4
    phi = np.stack([np.cos(k * np.pi * np.linspace(0, 1, few.n)) for k in range(1, 13)], axis=1)
    phi = phi + 0.15 * rng.standard_normal(phi.shape)
    value = np.stack(
        [few.noisy(rng, frequency, damping, 0.02, phi=phi, drive=k)[0].value[:, 0] for k in (3, 30, 60)], axis=1
    )
    z = np.tile([0.0, 0.0, 1.0], (3, 1))
    frf = replace(few.block(value[:, 0], "accelerance", 3), value=value, input=Dofs(node=[3, 30, 60], direction=z))
    seconds = seconds_of(few, frf)
    report("222 functions of 1601 lines", "60 s", f"{seconds:.1f} s", NONE, NONE)
    assert seconds < 60.0
