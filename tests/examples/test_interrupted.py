"""A run that is stopped goes on where it stopped, and its results are those of a run that was not."""

import os
import re
import signal
import subprocess
import sys
import time

import pytest
from rich.console import Console

from updating.commands.fit import fit_campaign
from updating.commands.terminal import Run
from updating.commands.update import run_update

posix = pytest.mark.skipif(os.name != "posix", reason="needs signals and process groups")
LAMELLA = (
    "import signal; signal.signal(signal.SIGINT, signal.default_int_handler);"  # a background job ignores it
    "from updating.commands.command_line import main; main()"
)


def until(condition, process=None):
    for _ in range(3000):
        if condition():
            return
        assert process is None or process.poll() is None, process.communicate()
        time.sleep(0.1)
    pytest.fail("nothing happened within five minutes")


def stopped(arguments, first, how):
    """Run a command, stop it as soon as a file is there, and return its exit code and what it said."""
    process = subprocess.Popen(
        [sys.executable, "-c", LAMELLA, *map(str, arguments)],
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, start_new_session=True,
    )  # fmt: skip
    try:
        until(first.exists, process)
        os.kill(process.pid, how)
        said = process.communicate(timeout=300)[0]
        until(lambda: not is_alive(process.pid))
    finally:
        if is_alive(process.pid):
            os.killpg(process.pid, signal.SIGKILL)
    return process.returncode, said


def is_alive(group):
    """Tell whether any process of a group is left."""
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True


@posix
def test_a_fit_that_is_stopped_three_times_goes_on_and_ends_with_the_same_bytes(small, written, tmp_path):
    """By Ctrl-C, by SIGTERM, which the workbench and batch systems send, and killed."""
    campaign, whole = small
    out = tmp_path / "out"

    def leave_to_do(*names):
        """Remove what workers may have finished before they were stopped."""
        for name in names:
            (out / name / "fit.json").unlink(missing_ok=True)

    for name, how in (("C1", signal.SIGINT), ("C2", signal.SIGTERM)):
        leave_to_do(name, "C3", "C4")
        code, said = stopped(["fit", campaign, "-o", out], out / name / "fit.json", how)
        assert code == 130
        assert "Interrupted; what was done is kept" in said
        assert not re.search("leaked|Traceback", said)
    kept = (out / "C1/fit.json").stat().st_mtime_ns
    leave_to_do("C3", "C4")
    code, _ = stopped(["fit", campaign, "-o", out], out / "C3/fit.json", signal.SIGKILL)
    assert code == -signal.SIGKILL
    assert not (out / "report.html").exists()
    again = list(fit_campaign(Run(campaign=campaign, output=out, console=Console(quiet=True))))
    assert [found.configuration.name for found, _ in again] == ["C1", "C2", "C3", "C4"]
    assert (out / "C1/fit.json").stat().st_mtime_ns == kept
    assert len(written(whole)) == 21
    assert {**written(out), "campaign.json": b""} == {**written(whole), "campaign.json": b""}  # its path is relative


@pytest.mark.slow
@posix
def test_an_updating_that_is_killed_goes_on_and_ends_with_the_same_bytes(small, written, tmp_path):
    campaign, _ = small
    specification, out = tmp_path / "update.toml", tmp_path / "out"
    specification.write_text(
        f'name = "small"\n[[campaign]]\nfile = "{campaign}"\nconfigurations = ["C1"]\n', encoding="utf-8"
    )
    stopped(["update", specification, "-o", out], out / "C1/modal_model.json", signal.SIGKILL)
    assert not (out / "update.json").exists()
    kept = (out / "C1/modal_model.json").stat().st_mtime_ns
    run_update(Run(campaign=specification, output=out, console=Console(quiet=True)))
    assert (out / "C1/modal_model.json").stat().st_mtime_ns == kept
    run_update(Run(campaign=specification, output=tmp_path / "whole", console=Console(quiet=True)))
    assert (out / "update.json").exists()
    assert written(out) == written(tmp_path / "whole")
