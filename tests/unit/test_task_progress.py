"""What tasks say while they last is shown beside their number, wherever they run."""

import io
import logging
from functools import partial

import pytest
from rich.console import Console

import updating.workers.workers as workers
from updating.workers.workers import in_parallel


def at_work(step):
    logging.getLogger("ema.identification").info("run %d of 30", step)
    logging.getLogger("ema.identification").debug("look at \x1b[31m it")


@pytest.mark.parametrize("n_process", [1, 2])
def test_what_tasks_say_is_shown(n_process, monkeypatch):
    monkeypatch.setattr(workers, "n_processor", lambda: n_process)
    page = io.StringIO()
    console = Console(file=page, force_terminal=True, width=120)
    say = at_work if n_process == 1 else partial(logging.getLogger("ema.part").info, "run %d of 30")
    list(in_parallel(say, [3, 3, 3], "identify", console))
    assert "identify: run 3 of 30" in page.getvalue()
    assert "3/3" in page.getvalue()
    assert "\x1b[31m it" not in page.getvalue()
    assert not logging.getLogger("ema").handlers


def test_nothing_is_shown_where_there_is_no_terminal(monkeypatch):
    monkeypatch.setattr(workers, "n_processor", lambda: 1)
    page = io.StringIO()
    list(in_parallel(at_work, [1], "identify", Console(file=page)))
    assert page.getvalue().strip() == ""
