"""Commands begin at once: what is slow to import is imported when something is drawn, read or served."""

import json
import subprocess
import sys

import pytest

from updating.commands.command_line import COMMANDS, described, load

DRAWING = {"matplotlib", "plotly", "pyvista", "vtkmodules", "PIL", "pptx", "jinja2"}
SERVING = {"trame", "trame_server", "aiohttp", "wslink"}
READING = {"h5py", "nptdms", "pandas"}
NUMBERS = {"numpy", "scipy", "skfem", "pydantic", "cattrs", "dask", "distributed"}
COUNT = """
import json, sys
from updating.commands.command_line import load
{job}
print(json.dumps(sorted({{name.partition(".")[0] for name in sys.modules}})))
"""
HELP = """
import contextlib, io
from updating.commands.command_line import app
with contextlib.redirect_stdout(io.StringIO()), contextlib.suppress(SystemExit):
    app(["--help"])
"""


def imported(job):
    """Return the top-level packages that a process has imported once it has done a job."""
    done = subprocess.run(
        [sys.executable, "-c", COUNT.format(job=job)], capture_output=True, text=True, timeout=120, check=True
    )
    return set(json.loads(done.stdout.splitlines()[-1]))


def test_the_list_of_commands_needs_no_numbers():
    assert imported(HELP) & (DRAWING | SERVING | READING | NUMBERS) == set()


@pytest.mark.parametrize("name", ["report", "open", "fit", "diagnose", "ema", "new"])
def test_a_command_begins_without_what_it_may_need_later(name):
    assert imported(f"load({name!r})") & (DRAWING | SERVING | READING) == set()


OWN_HELP = """
import contextlib, io, sys
from updating.commands.command_line import COMMANDS, app
for name in COMMANDS:
    with contextlib.redirect_stdout(io.StringIO()) as said, contextlib.suppress(SystemExit):
        app([name, "--help"])
    assert "Example:" in said.getvalue(), name
"""


def test_the_help_of_a_command_needs_no_numbers():
    ours = NUMBERS - {"pydantic"}  # which typer imports for some arguments
    assert imported(OWN_HELP) & (DRAWING | SERVING | READING | ours) == set()


@pytest.mark.parametrize("name", COMMANDS)
def test_help_says_of_a_command_what_it_takes_when_it_runs(name):
    described_, loaded = (
        [(p.name, p.opts, p.help, p.default) for p in make(name).params] for make in (described, load)
    )
    assert described_ == loaded
    assert described(name).help == load(name).help
    assert described(name).epilog == load(name).epilog
