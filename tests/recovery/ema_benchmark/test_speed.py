"""Time and memory of the identification."""

import subprocess
import sys
import time
import warnings
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from ema.identification.stabilization import lscf_poles

pytestmark = pytest.mark.benchmark


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
        "not automatic",
        "not automatic",
    )
    assert ratio >= 3.0
    assert difference < 1e-8
    assert seconds < min(theirs)
    assert peak < 300.0
