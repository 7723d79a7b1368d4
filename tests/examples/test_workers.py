"""Where tasks run: local processes and a Dask cluster, whose workers may be killed."""

import os
import signal
import subprocess
import sys
import tempfile
from concurrent.futures import Executor
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from updating.commands.command_line import main
from updating.commands.diagnose import diagnose_pooled
from updating.commands.fit import fit_campaign
from updating.commands.terminal import Run
from updating.errors import WorkerError
from updating.workers import workers as workers_module
from updating.workers.workers import distribute, workers

pytestmark = pytest.mark.usefixtures("two_processes")
DATA = Path(__file__).parents[2] / "data"


@pytest.mark.slow
def test_a_cluster_of_which_a_worker_is_killed_midway_loses_nothing(small, tmp_path, written):
    distributed = pytest.importorskip("distributed")
    campaign, whole = small
    found = []
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        victim = cluster.workers[0].pid
        for one in fit_campaign(
            Run(
                campaign=campaign,
                output=tmp_path / "out",
                cluster=cluster.scheduler_address,
                console=Console(quiet=True),
            )
        ):
            if not found:
                os.kill(victim, signal.SIGKILL)
            found.append(one)
    assert [identified.configuration.name for identified, _ in found] == ["C1", "C2", "C3", "C4"]
    assert written(tmp_path / "out") == written(whole)


@pytest.mark.slow
def test_a_pooled_diagnosis_on_a_cluster_gives_the_same_bytes(tmp_path):
    distributed = pytest.importorskip("distributed")
    campaign, quiet = DATA / "hidden_effect" / "pooled_b" / "campaign.toml", Console(quiet=True)
    diagnose_pooled(Run(campaign=campaign, output=tmp_path / "here", console=quiet))
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        diagnose_pooled(
            Run(campaign=campaign, output=tmp_path / "there", cluster=cluster.scheduler_address, console=quiet)
        )
    here, there = (tmp_path / one / "pooled_diagnosis.json" for one in ("here", "there"))
    assert here.read_bytes() == there.read_bytes()


def test_a_task_that_kills_the_workers_of_a_cluster_is_an_error():
    distributed, dask = pytest.importorskip("distributed"), pytest.importorskip("dask")
    with (
        dask.config.set({"distributed.scheduler.allowed-failures": 0}),
        distributed.LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=None) as cluster,
        pytest.raises(WorkerError, match="lost a task"),
        workers(1, cluster.scheduler_address) as executor,
    ):
        list(executor.map(os._exit, [1]))


def run(tasks):
    with workers(2) as executor:
        assert list(executor.map(divmod, range(9), [2] * 9)) == [divmod(i, 2) for i in range(9)]
        list(executor.map(*tasks))


@pytest.mark.parametrize(
    ("tasks", "error", "words"),
    [
        ((os._exit, [1, 1]), WorkerError, "a worker process was killed"),
        ((divmod, [1, 2], [1, 0]), ZeroDivisionError, "zero"),
    ],
    ids=["killed", "raises"],
)
def test_a_killed_local_worker_is_an_error_and_so_is_what_a_task_raises(tasks, error, words):
    with pytest.raises(error, match=words):
        run(tasks)


STOPPED_AMIDST_A_RESULT = """
import time
from updating.workers.workers import workers
from updating.commands.terminal import Run

class Slow:  # to read
    def __init__(self):
        time.sleep(0.2)
    def __reduce__(self):
        return time.sleep, (1.5,)

class Large:  # more than a pipe holds, and sent while the other is read
    def __init__(self):
        time.sleep(0.4)
    def __reduce__(self):
        return bytes, (bytes(10_000_000),)

if __name__ == "__main__":
    with workers(2) as executor:
        list(executor.map(abs, range(9)))  # both processes have begun
        executor.submit(Slow)
        executor.submit(Large)
        time.sleep(1.0)
        raise KeyboardInterrupt
"""


def test_a_stop_amidst_a_result_that_is_being_sent_ends(tmp_path):
    script = tmp_path / "stopped.py"
    script.write_text(STOPPED_AMIDST_A_RESULT, encoding="utf-8")
    stopped = subprocess.run([sys.executable, script], check=False, timeout=300, capture_output=True, text=True)
    assert stopped.stderr.splitlines()[-1] == "KeyboardInterrupt"


def test_results_come_in_order_from_tasks_that_none_can_import_and_no_file_stays(tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    large = np.arange(1e6)
    with workers(2) as executor:
        assert executor.submit(os.getpid).result() != os.getpid()
        for offset in (1, 2):
            found = list(distribute(lambda i, offset=offset: large[i] + offset, range(40), executor))
            assert found == [i + offset for i in range(40)]
            assert not [path for path in tmp_path.rglob("*") if path.is_file()]
    assert not list(tmp_path.glob("lamella-*"))


def test_what_is_sent_is_named_in_few_words(monkeypatch):
    """A cluster names tasks by them, and a model in words takes seconds and several times its room."""
    sent, large = [], np.arange(1e5)
    monkeypatch.setattr(Executor, "map", lambda _, task, parts: sent.append(task) or map(task, parts))
    assert list(distribute(lambda i: large[i], range(4), Executor())) == [0.0, 1.0, 2.0, 3.0]
    assert len(repr(sent[0])) < 100


class Alone:
    """A task that is read only where no other is kept."""

    def __init__(self, offset):
        self.offset = offset

    def __setstate__(self, state):
        assert not workers_module._LAST
        self.__dict__.update(state)

    def __call__(self, i):
        return self.offset + i


def test_a_process_lets_its_last_task_go_before_it_reads_the_next(monkeypatch):
    """Each may hold a model."""
    monkeypatch.setattr(Executor, "map", lambda _, task, parts: map(task, parts))
    monkeypatch.setattr(workers_module, "_LAST", {})
    for offset in (3, 4):
        assert list(distribute(Alone(offset), range(40), Executor())) == [offset + i for i in range(40)]


@pytest.mark.skipif(sys.platform != "linux", reason="each process imports for itself there")
def test_processes_are_copies_of_one_that_has_imported_what_this_one_has():
    with workers(2) as executor:
        parents = {executor.submit(os.getppid).result() for _ in range(4)}
    assert len(parents) == 1
    assert parents != {os.getppid()}
    assert parents != {os.getpid()}


@pytest.mark.parametrize(
    ("address", "words"), [("tcp://127.0.0.1:1", "no Dask scheduler answers"), ("nowhere", "nowhere")]
)
def test_a_cluster_that_does_not_answer_is_said(address, words, monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr("updating.workers.cluster._ANSWER", "1 s")
    with pytest.raises(WorkerError, match=words), workers(2, address):
        pass


def test_without_dask_the_way_to_have_it_is_said(small, monkeypatch, tmp_path, capsys):
    monkeypatch.setitem(sys.modules, "distributed", None)
    monkeypatch.delitem(sys.modules, "updating.workers.cluster", raising=False)
    monkeypatch.setattr(sys, "argv", ["lamella", "fit", str(small[0]), "-o", str(tmp_path), "--cluster", "tcp://a:1"])
    with pytest.raises(SystemExit):
        main()
    assert 'pip install "lamella[cluster]"' in " ".join(capsys.readouterr().err.split())
