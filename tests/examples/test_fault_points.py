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
from tests.unit.test_diagnosis_text import diagnosis
from updating.commands import diagnose as diagnose_command
from updating.commands import ema as ema_command
from updating.commands import fit as fit_command
from updating.commands import update as update_command
from updating.commands.diagnose import diagnose_campaign
from updating.commands.ema import identify_campaign
from updating.commands.fit import fit_campaign
from updating.commands.report import make_report
from updating.commands.terminal import Run
from updating.commands.update import run_update
from updating.diagnosis.candidates import candidate_model
from updating.errors import StoreError, WorkerError
from updating.fitting.fit import Fit
from updating.report import page
from updating.report.results import read_results
from updating.results import identified
from updating.results.identified import assignments, require_none
from updating.results.store import kept, read_result
from updating.workers import workers as workers_module
from updating.workers.workers import distribute, workers

QUIET = Console(quiet=True)
ANSWER = diagnosis("nothing missing", signatures={}, second_level=None, sentences=("Nothing is missing.",))
KILLED, FULL = 9, 28
DRAWN = shutil.ignore_patterns("figures", "report.html")
pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")


@pytest.fixture(scope="module")
def numbers(small, tmp_path_factory):
    """What identification and fit of the first configuration give, computed once."""
    text = small[0].read_text(encoding="utf-8")
    campaign = small[0].with_name("points_of_fault.toml")
    campaign.write_text(text[: text.index('[[configuration]]\nname = "C2"')], encoding="utf-8")
    (one,) = assignments(read_campaign(campaign), tmp_path_factory.mktemp("assigned"))
    return campaign, tuple(identified.identify(one.campaign, {})), read_result(small[1] / "C1/fit.json", Fit)


@pytest.fixture(scope="module")
def specification(small):
    """An updating file of two configurations."""
    file = small[0].with_name("update.toml")
    file.write_text(
        'name = "small"\neffects = ["clamp_inertia"]\n'
        f'[[campaign]]\nfile = "{small[0].name}"\nconfigurations = ["C1", "C2"]\n',
        encoding="utf-8",
    )
    return file


@pytest.fixture(scope="module")
def updated(specification, tmp_path_factory):
    """What an updating gives, computed once."""
    return run_update(Run(campaign=specification, output=tmp_path_factory.mktemp("updated"), console=QUIET))


@pytest.fixture(scope="module")
def shown(small):
    """The sections of a report, drawn once."""
    return page.sections(read_results(small[1]))


@pytest.fixture
def commands(request, numbers, small, monkeypatch):
    """The commands as functions of a folder, with these numbers in place of hours of work."""
    campaign, found, fitted = numbers

    def report(folder):
        shown = request.getfixturevalue("shown")
        shutil.copytree(small[1], folder, ignore=DRAWN, dirs_exist_ok=True)
        with monkeypatch.context() as quick:
            quick.setattr(page, "sections", lambda *_: shown)
            quick.setattr(page, "configuration_section", lambda *_: None)  # they are among the sections
            page.write_report(folder)

    def update(folder):
        before = request.getfixturevalue("updated")
        with monkeypatch.context() as quick:
            quick.setattr(update_command, "joint_fit", lambda *_, **__: before)
            run_update(Run(campaign=request.getfixturevalue("specification"), output=folder, console=QUIET))

    monkeypatch.setattr(workers_module, "n_processor", lambda: 1)  # all writes are this process's
    monkeypatch.setattr(identified, "identify", lambda *_: found)
    monkeypatch.setattr(fit_command, "fit_configuration", lambda *_, **__: fitted)
    monkeypatch.setattr(ema_command, "as_png", lambda _: b"picture")
    monkeypatch.setattr(diagnose_command, "diagnose_stack", lambda *_, **__: ANSWER)
    return {
        "report": report,
        "update": update,
        "diagnose": lambda folder: diagnose_campaign(Run(campaign=campaign, output=folder, console=QUIET)),
        "fit": lambda folder: list(fit_campaign(Run(campaign=campaign, output=folder, console=QUIET))),
        "ema": lambda folder: require_none(
            identify_campaign(Run(campaign=campaign, output=folder, console=QUIET))[2], 1
        ),
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


N_WRITE = {"fit": 6, "ema": 14, "update": 15, "diagnose": 5, "report": 71}
"""Files that each command writes for one configuration; the report is of four."""
COMPUTED = {"update": "updated", "report": "shown"}
FAULTS = ["killed before", "killed amidst", "killed after", "disk full"]


QUICK = (("fit", "killed amidst"), ("diagnose", "killed amidst"))


@pytest.mark.parametrize(
    ("command", "fault"),
    [pytest.param(c, f, marks=() if (c, f) in QUICK else pytest.mark.slow) for c in N_WRITE for f in FAULTS],
)
def test_every_write(request, commands, written, tmp_path, monkeypatch, command, fault):
    if command in COMPUTED:  # once, and not while writes are counted
        request.getfixturevalue(COMPUTED[command])
    work, whole = commands[command], tmp_path / "whole"
    counter = Faulty(0, fault)
    with monkeypatch.context() as counting:
        counting.setattr(Path, "replace", counter.method())
        work(whole)
    expected = written(whole)
    assert counter.count == N_WRITE[command]
    assert counter.count == len(expected) or command == "report"  # which finds results
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


@pytest.mark.parametrize("at", [pytest.param(i, marks=() if i == 3 else pytest.mark.slow) for i in range(N_ITEM)])
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


FEW = ("stinger_mass", "clamp_inertia")


@pytest.fixture
def at_work(small, numbers, specification, monkeypatch):
    """Commands with a real pool of two processes, as functions of a folder; a diagnosis of few effects."""
    campaign, done = numbers[0], small[1]
    monkeypatch.setattr(workers_module, "n_processor", lambda: 2)
    known = diagnose_command.catalogue()
    monkeypatch.setattr(diagnose_command, "catalogue", lambda _: {name: known[name] for name in FEW})
    monkeypatch.setattr(diagnose_command, "cached_model", candidate_model)  # what is cached is not reduced again

    def report(folder):
        shutil.copytree(done, folder, ignore=DRAWN, dirs_exist_ok=True)
        make_report(folder)

    return {
        "report": report,
        "update": lambda folder: run_update(Run(campaign=specification, output=folder, console=QUIET)),
        "diagnose": lambda folder: diagnose_campaign(Run(campaign=campaign, output=folder, console=QUIET)),
    }


class Killing:
    """`map` of a pool, by which tasks go to its workers, with one of them killed at one of its calls."""

    def __init__(self, at):
        self.at, self.count, self.true = at, 0, workers_module._Processes.map

    def method(self):
        def exchange(pool, *given, **named):
            self.count += 1
            if self.count == self.at:
                pool.submit(os._exit, KILLED)
            return self.true(pool, *given, **named)

        return exchange


N_EXCHANGE = {"report": 1, "update": 4, "diagnose": 3}
"""Rounds of tasks that each command sends to its workers at least, of a small campaign."""


@pytest.mark.slow
@pytest.mark.parametrize("command", N_EXCHANGE)
def test_every_exchange_of_a_command(at_work, written, tmp_path, monkeypatch, command):
    """A worker is killed at each: it is said, nothing half is left, and the command goes on to the same end."""
    work, out = at_work[command], tmp_path / "out"
    counter = Killing(0)
    with monkeypatch.context() as counting:
        counting.setattr(workers_module._Processes, "map", counter.method())
        work(out)
    expected = written(out)
    assert counter.count >= N_EXCHANGE[command]
    goes_on, said = [], []
    for at in range(1, counter.count + 1):
        shutil.rmtree(out)
        with monkeypatch.context() as killing:
            killing.setattr(workers_module._Processes, "map", Killing(at).method())
            try:
                work(out)  # which ends well where the worker had done all of its part
            except WorkerError as error:
                said.append(str(error))
        left = written(out)
        assert left.items() <= expected.items(), at
        if left not in goes_on:  # from the same files it goes on the same way
            goes_on.append(left)
            work(out)
            assert written(out) == expected, at
    assert len(said) >= N_EXCHANGE[command]
    assert all("the same command goes on" in text for text in said)
