"""A fault at every write of a whole run: the command, given again, ends with the same bytes.

A child process is killed at the point, with no chance to clean up; or its disk is full there. The numbers are those of
a run that went well, so that a point takes milliseconds; a slow test kills workers at every exchange of a real pool.
"""

import os
import shutil
import warnings
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import pytest
from rich.console import Console

from ema.campaign.campaign import read_campaign
from ema.types.errors import EmaError
from updating.commands import ema as ema_command
from updating.commands import fit as fit_command
from updating.commands.ema import identify_campaign
from updating.commands.fit import fit_campaign
from updating.errors import StoreError, WorkerError
from updating.fitting.fit import Fit
from updating.results import identified
from updating.results.identified import assignments, require_none
from updating.results.store import kept, read_result
from updating.workers import workers as workers_module
from updating.workers.workers import distribute, workers

QUIET = Console(quiet=True)
KILLED, FULL = 9, 28
pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")


@pytest.fixture(scope="module")
def numbers(small, tmp_path_factory):
    """What identification and fit of the first configuration give, computed once."""
    text = small[0].read_text(encoding="utf-8")
    campaign = small[0].with_name("points_of_fault.toml")
    campaign.write_text(text[: text.index('[[configuration]]\nname = "C2"')], encoding="utf-8")
    (one,) = assignments(read_campaign(campaign), tmp_path_factory.mktemp("assigned"))
    return campaign, tuple(identified.identify(one.campaign, {})), read_result(small[1] / "C1/fit.json", Fit)


@pytest.fixture
def commands(numbers, monkeypatch):
    """The commands as functions of a folder, with these numbers in place of hours of work."""
    campaign, found, fitted = numbers
    monkeypatch.setattr(identified, "identify", lambda *_: found)
    monkeypatch.setattr(fit_command, "fit_configuration", lambda *_, **__: fitted)
    monkeypatch.setattr(ema_command, "as_png", lambda _: b"picture")
    return {
        "fit": lambda folder: list(fit_campaign(campaign, folder, 0.8, QUIET)),
        "ema": lambda folder: require_none(identify_campaign(campaign, folder, None, QUIET)[2], 1),
    }


class Faulty:
    """`Path.replace`, by which every file comes to its place, with a fault at one of its calls."""

    def __init__(self, at, fault):
        self.at, self.fault, self.count, self.true = at, fault, 0, Path.replace

    def method(self):
        def replace(part, target):
            return self(part, target)

        return replace

    def __call__(self, part, target):
        self.count += 1
        if self.count != self.at:
            return self.true(part, target)
        if self.fault == "killed before":
            os._exit(KILLED)
        if self.fault == "killed amidst":
            part.write_bytes(part.read_bytes()[:10])
            os._exit(KILLED)
        if self.fault == "killed after":
            self.true(part, target)
            os._exit(KILLED)
        raise OSError(FULL, "No space left on device")


def in_a_child(work, faulty):
    """Do work in a copy of this process, and return its exit code: 0 where nothing happened."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of threads: BLAS has one, and nothing else runs
        child = os.fork()
    if child == 0:
        Path.replace = faulty.method()
        try:
            work()
        except (StoreError, EmaError):
            os._exit(FULL)
        except BaseException:
            os._exit(1)
        os._exit(0)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


N_WRITE = {"fit": 6, "ema": 14}
"""Files that each command writes for one configuration."""
FAULTS = ["killed before", "killed amidst", "killed after", "disk full"]


QUICK = ("fit", "killed amidst")


@pytest.mark.parametrize(
    ("command", "fault"),
    [pytest.param(c, f, marks=() if (c, f) == QUICK else pytest.mark.slow) for c in N_WRITE for f in FAULTS],
)
def test_every_write(commands, written, tmp_path, monkeypatch, command, fault):
    work, whole = commands[command], tmp_path / "whole"
    counter = Faulty(0, fault)
    with monkeypatch.context() as counting:
        counting.setattr(Path, "replace", counter.method())
        work(whole)
    expected = written(whole)
    assert counter.count == len(expected) == N_WRITE[command]
    for at in range(1, counter.count + 1):
        out = tmp_path / str(at)
        code = in_a_child(partial(work, out), Faulty(at, fault))
        assert code == (FULL if fault == "disk full" else KILLED), at
        assert written(out).items() <= expected.items(), at  # whole files, and none of another run
        work(out)
        assert written(out) == expected, at
        shutil.rmtree(out)


@dataclass(frozen=True)
class Square:
    """A result of a task."""

    value: int


def squares(folder, at, item):
    """Keep the square of a number in a file; at one of them the worker is killed, once."""
    mark = folder / "killed"
    if item == at and not mark.exists():
        mark.touch()
        os._exit(KILLED)
    return kept(folder / f"{item}.json", Square, partial(Square, value=item**2), inputs=(), options={}).value


N_ITEM = 6


@pytest.mark.parametrize(
    "at", [pytest.param(i, marks=() if i == 3 else pytest.mark.slow) for i in range(N_ITEM)]
)
def test_every_exchange(tmp_path, written, monkeypatch, at):
    monkeypatch.setattr(workers_module, "n_processor", lambda: 2)
    whole, out = tmp_path / "whole", tmp_path / "out"
    whole.mkdir()
    out.mkdir()
    expected = [squares(whole, None, i) for i in range(N_ITEM)]
    with pytest.raises(WorkerError, match="the same command goes on"), workers(N_ITEM) as executor:
        list(distribute(partial(squares, out, at), range(N_ITEM), executor))
    with workers(N_ITEM) as executor:
        assert list(distribute(partial(squares, out, at), range(N_ITEM), executor)) == expected
    (out / "killed").unlink()
    assert written(out) == written(whole)
