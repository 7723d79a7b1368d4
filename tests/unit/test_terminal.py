"""What is printed is what was meant: names and paths as they stand, on any terminal, and whole tables in files."""

import io
import logging
import os
import re
import subprocess
import sys
import time

import pytest
from rich.console import Console
from rich.table import Table

from updating.commands import terminal
from updating.commands.terminal import LiteralConsole, bar, progress
from updating.workers import progress as progress_module

NAMES = ["[/foo]", "run[a]", "[bold]thick[/bold]", ":smile:"]


@pytest.fixture
def console():
    return LiteralConsole(file=io.StringIO(), width=100)


@pytest.mark.parametrize("name", NAMES)
def test_names_are_no_markup(console, name):
    table = Table(title=f"title {name}", caption=f"caption {name}")
    table.add_column(f"head {name}")
    table.add_row(f"cell {name}")
    console.print(f"line {name}")
    console.print(table)
    for place in ("line", "title", "caption", "head", "cell"):
        assert f"{place} {name}" in console.file.getvalue()


def test_control_characters_are_printed_as_escapes(console):
    table = Table(title="\x1b[31mred")
    table.add_row("a\rb\x9bc")
    console.print(table, "bell\a\ttab\nline")
    printed = console.file.getvalue()
    assert r"\x1b[31mred" in printed
    assert r"a\x0db\x9bc" in printed
    assert r"bell\x07" in printed
    assert "\nline" in printed
    assert not {"\x1b", "\r", "\x9b", "\a"} & set(printed)


@pytest.mark.parametrize("name", [*NAMES, "\x1b[31mred"])
def test_what_long_work_is_at_is_no_markup_either(name):
    console = LiteralConsole(file=io.StringIO(), width=100, force_terminal=True, color_system=None)
    with progress("diagnose", console):
        logging.getLogger("updating").info("fit %s", name)
    with bar(console) as shown:
        shown.add_task("draw [/foo]", total=1)
    assert "\x1b[31m" not in console.file.getvalue()


@pytest.mark.parametrize("encoding", ["ascii", "cp1252", "utf-8"])
def test_signs_that_a_terminal_lacks_are_escapes(monkeypatch, encoding):
    content = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(content, encoding=encoding))
    terminal.print_what_can_be()
    LiteralConsole(width=100).print("1480 ± 24, G\u1da0, M\udcff")
    sys.stdout.flush()
    printed = content.getvalue().decode(encoding)
    assert ("±" in printed) == (encoding != "ascii")
    assert r"\udcff" in printed


def test_an_error_on_an_ascii_terminal(tmp_path):
    command = [sys.executable, "-c", "from updating.commands.command_line import main; main()"]
    run = subprocess.run(
        [*command, "ema", "nowhére[/x]\x1b[31m.toml", "-o", "out"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONIOENCODING": "ascii", "LC_ALL": "C"},
        capture_output=True,
        text=True,
        encoding="ascii",
        check=False,
    )
    assert run.returncode == 1
    assert r"[/x]\x1b[31m.toml: cannot be read: No such file" in run.stderr


def test_tables_in_files_have_no_empty_cells(console):
    """Ten modes of ten configurations are wider than a page; on a terminal the user can make it wider."""
    table = Table()
    table.add_column("stack")
    for mode in range(10):
        table.add_column(f"mode {mode}", no_wrap=True)
    for i in range(10):
        table.add_row(f"configuration_{i}", *["1234.5 1234.5"] * 10)
    console.print(table)
    for line in console.file.getvalue().splitlines()[3:-1]:
        assert all(cell.strip() for cell in line.strip("│┃").split("│"))
    for i in range(10):
        assert f"configuration_{i}" in console.file.getvalue()


def test_work_says_in_a_pipe_what_it_is_at(monkeypatch, capsys):
    monkeypatch.setenv(progress_module.PERIOD, "0.1")  # the least that is taken
    log = logging.getLogger("updating")
    with progress("diagnose", Console(file=io.StringIO())):
        log.info("weigh %d explanations", 7)
        until_said(capsys, r"diagnose, stage 1: weigh 7 explanations \(\d+ s\)")
        logging.getLogger("model").info("reduce the model")
        until_said(capsys, r"diagnose, stage 2: reduce the model \(\d+ s\)")
    with progress_module.shown("identify", 3, Console(file=io.StringIO())) as bar:
        bar.advance(bar.task_ids[0])
        until_said(capsys, r"identify, 1 of 3 done \(\d+ s\)")
    with progress("quiet", Console(quiet=True)):
        time.sleep(0.25)
    assert capsys.readouterr().err == ""


def until_said(capsys, line):
    """Wait for a line that matches; how many seconds it reports depends on how busy the machine is."""
    said = ""
    for _ in range(6000):
        said += capsys.readouterr().err
        if any(re.fullmatch(line, each) for each in said.splitlines()):
            return
        time.sleep(0.01)
    pytest.fail(said)
