"""What tasks say while they last is shown beside their number, wherever they run."""

import io
import logging
import time
from functools import partial

import pytest
from rich.console import Console

import updating.workers.workers as workers
from updating.workers.progress import PERIOD, in_lines, shown
from updating.workers.workers import in_parallel

_LONGEST = 120.0  # s, after which a message that is still not shown is lost


def terminal():
    return Console(file=io.StringIO(), force_terminal=True, width=120)


def at_work(step):
    logging.getLogger("ema.identification").info("run %d of 30", step)
    logging.getLogger("ema.identification").debug("look at \x1b[31m it")


def test_what_tasks_say_is_shown(monkeypatch):
    monkeypatch.setattr(workers, "n_processor", lambda: 1)
    console = terminal()
    list(in_parallel(at_work, [3, 3, 3], "identify", console))
    page = console.file.getvalue()
    assert "identify: run 3 of 30" in page
    assert "3/3" in page
    assert "\x1b[31m it" not in page
    assert not logging.getLogger("ema").handlers


def test_what_tasks_in_other_processes_say_is_shown_while_they_last(two_processes):
    console, end = terminal(), time.monotonic() + _LONGEST
    say = partial(logging.getLogger("ema.part").info, "run %d of 30")
    with workers.workers(3) as executor, shown("identify", 3, console):
        list(executor.map(say, [3, 3, 3]))
        while "identify: run 3 of 30" not in console.file.getvalue() and time.monotonic() < end:
            time.sleep(0.05)
    assert "identify: run 3 of 30" in console.file.getvalue()
    assert not logging.getLogger("ema").handlers


def test_nothing_is_shown_where_there_is_no_terminal(monkeypatch):
    monkeypatch.setattr(workers, "n_processor", lambda: 1)
    console = Console(file=io.StringIO())
    list(in_parallel(at_work, [1], "identify", console))
    assert console.file.getvalue().strip() == ""


@pytest.mark.parametrize("period", ["often", "nan", "-1", "inf", ""])
def test_a_slip_in_the_period_of_progress_stops_no_work(monkeypatch, period):
    monkeypatch.setenv(PERIOD, period)
    with in_lines(lambda: "at work", Console(file=io.StringIO())):
        done = True
    assert done


def test_progress_is_reported_as_often_as_asked(monkeypatch, capfd):
    monkeypatch.setenv(PERIOD, "0.1")
    said, end = "", time.monotonic() + _LONGEST
    with in_lines(lambda: "at work", Console(file=io.StringIO())):
        while said.count("at work (") < 2 and time.monotonic() < end:
            time.sleep(0.05)
            said += capfd.readouterr().err
    assert said.count("at work (") >= 2
