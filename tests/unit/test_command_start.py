"""Commands begin at once: what is slow to import is imported when something is drawn, read or served."""

import json
import subprocess
import sys

DRAWING = {"matplotlib", "plotly", "pyvista", "vtkmodules", "PIL", "pptx", "jinja2"}
SERVING = {"trame", "trame_server", "aiohttp", "wslink"}
READING = {"h5py", "nptdms", "pandas"}
SELDOM = {"scipy.stats", "scipy.signal"}  # half a second each, in each process
NUMBERS = {"numpy", "scipy", "skfem", "pydantic", "cattrs", "dask", "distributed"}
COUNT = """
import json, sys
from updating.commands.command_line import load
{job}
print(json.dumps(sorted(sys.modules)))
"""
HELP = """
import contextlib, io
from updating.commands.command_line import app
with contextlib.redirect_stdout(io.StringIO()), contextlib.suppress(SystemExit):
    app(["--help"])
"""


def imported(job):
    """Return the modules that a process has imported once it has done a job."""
    done = subprocess.run(
        [sys.executable, "-c", COUNT.format(job=job)], capture_output=True, text=True, timeout=120, check=True
    )
    return set(json.loads(done.stdout.splitlines()[-1]))


def test_the_list_of_commands_needs_no_numbers():
    assert imported(HELP) & (DRAWING | SERVING | READING | NUMBERS) == set()


def test_a_command_begins_without_what_it_may_need_later():
    job = "\n".join(f"load({name!r})" for name in ("report", "open", "fit", "diagnose", "ema", "new"))
    assert imported(job) & (DRAWING | SERVING | READING | SELDOM) == set()
