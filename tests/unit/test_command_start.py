"""Commands begin at once: what is slow to import is imported when something is drawn, read or served."""

import json
import os
import re
import subprocess
import sys
import tomllib

import pytest

from ema.types.errors import CampaignError
from tests.command import ROOT, lamella
from updating import commands
from updating.commands.command_line import EXTRAS, app

DRAWING = {"matplotlib", "plotly", "pyvista", "vtkmodules", "PIL", "pptx", "jinja2"}
SERVING = {"trame", "trame_server", "aiohttp", "wslink"}
READING = {"h5py", "nptdms", "pandas"}
SELDOM = {"scipy.stats", "scipy.signal"}  # half a second each, in each process
NUMBERS = {"numpy", "scipy", "skfem", "cattrs", "dask", "distributed"}  # typer takes pydantic for ranges of options
COUNT = """
import contextlib, io, json, sys
from updating.commands.command_line import app
{job}
print(json.dumps(sorted(sys.modules)))
"""
ASK = """
with contextlib.redirect_stdout(io.StringIO()), contextlib.suppress(SystemExit):
    app({words!r})
"""
RUN = [name for name in commands.__all__ if name.endswith("_command")]
EVERY = [command.name or command.callback.__name__ for command in app.registered_commands]


def imported(job):
    """Return the modules that a process has imported once it has done a job."""
    done = subprocess.run(
        [sys.executable, "-c", COUNT.format(job=job)], capture_output=True, text=True, timeout=600, check=False
    )
    assert done.returncode == 0, done.stderr
    return set(json.loads(done.stdout.splitlines()[-1]))


def test_help_needs_no_numbers():
    """Nor the modules that do what the commands say: of this package there are the words alone."""
    asked = imported("".join(ASK.format(words=words) for words in (["--help"], *([c, "--help"] for c in EVERY))))
    assert asked & (DRAWING | SERVING | READING | NUMBERS) == set()
    one = {name for name in asked if name.startswith("updating.commands.")}
    assert one == {f"updating.commands.{name}" for name in ("command_line", "terminal")}


def test_a_command_begins_without_what_it_may_need_later():
    job = "\n".join(f"commands.{name}" for name in RUN)
    assert imported(f"from updating import commands\n{job}") & (DRAWING | SERVING | READING | SELDOM) == set()


BEGUN = (
    {
        "new": {"scipy", "model.stack.stack", "updating.results"},
        "ema": {"scipy.optimize", "scipy.special", "scipy.ndimage", "model.elements", "updating.fitting"},
        "model": {"scipy.interpolate", "scipy.optimize", "updating.diagnosis", "updating.virtual"},
        "effects": {"scipy.interpolate", "scipy.optimize", "updating.diagnosis", "updating.virtual"},
        "fit": {"scipy.interpolate", "scipy.optimize", "updating.report", "updating.commands.diagnose"},
        "diagnose": {"scipy.interpolate", "scipy.ndimage", "updating.report", "updating.changes"},
    },
    {
        name: {"scipy.optimize", "updating.report.page", "updating.workbench", "updating.commands.fit"}
        for name in ("report", "open", "view")
    },
)
"""What must not be there once a command has begun: of each, one after the other in one process."""


@pytest.mark.parametrize("row", BEGUN)
def test_a_command_begins_with_its_own_part_of_the_program(row):
    """Each part takes some tenths of a second that a user waits for, also where a file is not there."""
    job = "from updating import commands\n" + "".join(
        f"commands.{name}_command\n"
        f"too_early = {not_yet!r} & sys.modules.keys()\n"
        f"assert not too_early, ({name!r}, too_early)\n"
        for name, not_yet in row.items()
    )
    assert "updating.commands" in imported(job)


def test_a_file_that_is_not_there_is_named_before_anything_is_loaded(tmp_path):
    job = f"""
from updating.errors import StoreError
for name in {["ema", "fit", "diagnose", "next-test", "update", "pick", "simulate"]!r}:
    words = [name, {str(tmp_path / "no.toml")!r}, *(["M1"] if name == "pick" else []), "-o", {str(tmp_path)!r}]
    try:
        app(words, standalone_mode=False)
    except StoreError as error:
        assert "no.toml: cannot be read: No such file or directory" in str(error), name
    else:
        raise AssertionError(name + ": nothing was said")
"""
    assert imported(job) & (DRAWING | SERVING | READING | NUMBERS) == set()


def test_a_folder_stands_for_the_campaign_in_it(tmp_path):
    (tmp_path / "campaign.toml").write_text("nothing = 1\n")
    with pytest.raises(CampaignError, match=r"campaign\.toml: nothing: unknown key"):
        app(["ema", str(tmp_path), "-o", str(tmp_path / "out")], standalone_mode=False)


def test_every_command_that_multiplies_uses_one_thread():
    """`single_threaded` leaves what it wraps as `__wrapped__`."""
    several = {name for name in RUN if not hasattr(getattr(commands, name), "__wrapped__")}
    assert several == {"new_command"}


def test_one_thread_holds_for_libraries_that_are_imported_later():
    job = """
from threadpoolctl import threadpool_info
from ema.types.arrays import single_threaded
@single_threaded
def later():
    import numpy, scipy.linalg, scipy.spatial, scipy.sparse.linalg
    return [own["num_threads"] for own in threadpool_info() if own["user_api"] == "blas"]
assert set(later()) == {1}
"""
    environment = {name: value for name, value in os.environ.items() if "NUM_THREADS" not in name}
    subprocess.run([sys.executable, "-c", job], env=environment, timeout=600, check=True)


PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def test_extras_bring_what_commands_say_they_lack():
    extras = PROJECT["optional-dependencies"]
    brought = {extra: {re.split(r"[>\[]", name)[0].lower() for name in extras[extra]} for extra in extras}
    core = {re.split(r"[>\[]", name)[0].lower() for name in PROJECT["dependencies"]}
    sold_as = {"vtkmodules": "pyvista", "pptx": "python-pptx", "aiohttp": "trame"}  # the last brings it
    for package, extra in EXTRAS.items():
        assert sold_as.get(package, package) in brought[extra] - core
    assert "ansys-mapdl-reader" in brought["ansys"]  # as the reader of .full files says


@pytest.mark.parametrize(("package", "extra"), EXTRAS.items())
def test_a_command_that_lacks_a_package_says_which_extra_brings_it(monkeypatch, tmp_path, package, extra):
    monkeypatch.setitem(sys.modules, package, None)
    monkeypatch.setattr("updating.commands.model.read_stack", lambda _: __import__(f"{package}.inside"))
    done = lamella("model", "data/demo_stack/stack.toml", "-o", tmp_path)
    assert done.returncode == 1
    said = " ".join(done.stderr.split())
    assert said.startswith(f"Error: this takes {package}, which is not installed.")
    assert f'pip install "lamella[{extra}]"' in said


def test_a_package_that_no_extra_brings_is_a_fault(monkeypatch, tmp_path):
    monkeypatch.setattr("updating.commands.model.read_stack", lambda _: __import__("nowhere_at_all"))
    with pytest.raises(ModuleNotFoundError, match="nowhere_at_all"):
        lamella("model", "data/demo_stack/stack.toml", "-o", tmp_path)


def test_numbers_come_without_any_extra(monkeypatch, tmp_path):
    for package in EXTRAS:
        monkeypatch.setitem(sys.modules, package, None)
    data = ROOT / "data/hidden_effect/b"
    text = (data / "campaign.toml").read_text(encoding="utf-8")
    text = text[: text.index('[[configuration]]\nname = "M2"')]
    text = "[[configuration.run]]".join(text.split("[[configuration.run]]")[:7])  # six runs are enough
    for file in ("stack.toml", "points.csv", "M1"):
        text = text.replace(f'"{file}', f'"{data / file}')
    campaign = tmp_path / "campaign.toml"
    campaign.write_text(f"[identification]\nband_Hz = [100, 420]\norder = 8\n{text}", encoding="utf-8")
    done = lamella("ema", campaign, "-o", tmp_path)
    assert done.returncode == 0, done.stderr
