"""How much memory a campaign takes: it does not grow with the number of configurations."""

import subprocess
import sys
import time
from pathlib import Path

import pytest

pytestmark = [
    pytest.mark.benchmark,
    pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="reads /proc"),
]


def peak(process):
    """The most memory that a process has had so far, MB; 0 for one that is gone."""
    try:
        lines = Path(f"/proc/{process}/status").read_text(encoding="utf-8").splitlines()
    except OSError:
        return 0.0
    return next((int(line.split()[1]) / 1024 for line in lines if line.startswith("VmHWM")), 0.0)


def peaks(arguments):
    """Run a command and return the most memory of its main process and of any worker, MB."""
    command = [
        sys.executable,
        "-c",
        "from updating.commands.command_line import main; main()",
        *map(str, arguments),
    ]
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
            print(
                f"\n{n} configurations: {main:.0f} MB in the main process, {worker:.0f} MB in a worker",
                end="",
            )
    for few, many in zip(found[20], found[200], strict=True):
        assert many < 1.1 * few
