"""How much memory a campaign takes: it does not grow with the number of configurations."""

import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from ema import FRF, Dofs, Geometry
from ema.io.uff import write_uff

pytestmark = [pytest.mark.benchmark, pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="reads /proc")]


def peak(process):
    """The most memory that a process has had so far, MB; 0 for one that is gone."""
    try:
        lines = Path(f"/proc/{process}/status").read_text(encoding="utf-8").splitlines()
    except OSError:
        return 0.0
    return next((int(line.split()[1]) / 1024 for line in lines if line.startswith("VmHWM")), 0.0)


def peaks(arguments):
    """Run a command and return the most memory of its main process and of any worker, MB."""
    command = [sys.executable, "-c", "from updating.commands.command_line import main; main()", *map(str, arguments)]
    main = worker = 0.0
    with subprocess.Popen(command, stdout=subprocess.DEVNULL) as process:
        children = Path(f"/proc/{process.pid}/task/{process.pid}/children")
        while process.poll() is None:
            main = max(main, peak(process.pid))
            worker = max([worker, *map(peak, children.read_text(encoding="utf-8").split())])
            time.sleep(0.1)
    assert process.returncode == 0
    return main, worker


def test_two_hundred_configurations_take_the_memory_of_twenty(write_small_campaign, tmp_path, capsys):
    found = {}
    for n in (20, 200):
        folder = tmp_path / str(n)
        folder.mkdir()
        found[n] = peaks(["fit", write_small_campaign(folder, n), "-o", folder / "out"])
    with capsys.disabled():
        for n, (main, worker) in found.items():
            print(f"\n{n} configurations: {main:.0f} MB in the main process, {worker:.0f} MB in a worker", end="")
    for few, many in zip(found[20], found[200], strict=True):
        assert many < 1.1 * few


def universal_file(folder, n_line):
    """Write a campaign of functions of three noisy modes as one universal file; return the size of its arrays (MB)."""
    folder.mkdir()
    rng, n = np.random.default_rng(0), 120
    frequency = np.linspace(1.0, 500.0, n_line)
    one, omega = 2 * np.pi * np.array([80.0, 210.0, 390.0])[:, None], 2 * np.pi * frequency
    shape = np.cos(np.pi * np.outer(np.linspace(0, 1, n), [1, 2, 3])) + 0.1
    value = (shape * shape[0]) @ (-(omega**2) / (one**2 - omega**2 + 0.01j * one * omega))
    value += 0.01 * (rng.normal(size=value.shape) + 1j * rng.normal(size=value.shape))
    up = np.tile([0.0, 0.0, 1.0], (n, 1))
    frf = FRF(
        frequency=frequency, value=value[:, None], quantity="accelerance",
        output=Dofs(node=np.arange(1, n + 1), direction=up), input=Dofs(node=[1], direction=up[:1]),
        run=np.zeros(n, dtype=int), source=("generated",) * n,
    )  # fmt: skip
    points = np.outer(np.arange(n), [0.01, 0.0, 0.0])
    geometry = Geometry(node=np.arange(1, n + 1), coordinate=points, line=np.zeros((0, 2)))
    write_uff(folder / "frf.uff", geometry, frf)
    (folder / "campaign.toml").write_text(
        '[campaign]\nname = "large"\n[points]\nfile = "frf.uff"\n[[configuration]]\nname = "C1"\nfiles = ["frf.uff"]\n'
    )
    return value.nbytes / 2**20


def test_a_large_universal_file_takes_few_times_its_arrays(tmp_path, capsys):
    """Beyond what the same file takes of few lines: modules, and the pictures."""
    size = {n: universal_file(tmp_path / str(n), n) for n in (2000, 30_000)}
    taken = {n: peaks(["ema", tmp_path / str(n) / "campaign.toml", "-o", tmp_path / str(n) / "out"])[0] for n in size}
    times = (taken[30_000] - taken[2000]) / (size[30_000] - size[2000])
    with capsys.disabled():
        print(f"\n{size[30_000]:.0f} MB of functions: {taken[30_000]:.0f} MB, {times:.2f} times more", end="")
    assert times < 2.5
