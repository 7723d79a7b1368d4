"""Runs of the main job, shared by the tests of its results."""

import shutil
from pathlib import Path

import pytest
from filelock import FileLock
from rich.console import Console

from updating.commands.fit import fit_campaign
from updating.commands.terminal import Run
from updating.report import page
from updating.report.modes_part import modes_section
from updating.results.identified import Failed

DATA = Path(__file__).parents[2] / "data"


@pytest.fixture(scope="session")
def demo(tmp_path_factory, worker_id):
    """The folder of `lamella fit data/demo_stack/campaign.toml` and what it returned; one worker does it for all."""

    def fitted(folder):
        return tuple(
            fit_campaign(Run(campaign=DATA / "demo_stack/campaign.toml", output=folder, console=Console(quiet=True)))
        )

    folder = tmp_path_factory.mktemp("demo")
    if worker_id != "master":
        shared = tmp_path_factory.getbasetemp().parent / "demo"
        with FileLock(f"{shared}.lock"):
            fitted(shared)
        shutil.copytree(shared, folder, dirs_exist_ok=True)
    return folder, fitted(folder)


@pytest.fixture(scope="module")
def tables_alone():
    """Of a configuration, have the tables alone on the pages of a module's tests.

    All that is drawn of one is drawn of the small campaign and of the demo stack (`test_report_page`).
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(page, "configuration_section", lambda tested, _, added: modes_section(tested, added))
        yield


@pytest.fixture(scope="session")
def write_small_campaign():
    """A function that writes a campaign of many configurations, each identified and fitted within two seconds.

    They are the first runs of the two of the demo stack in turn, in a band of two modes, and the mesh is coarse.
    """

    def write(folder, n_configuration):
        demo = DATA / "demo_stack"
        stack = (demo / "stack.toml").read_text(encoding="utf-8")
        for line, coarse in (
            ("n_x = 18", "n_x = 3"), ("n_y = 4", "n_y = 1"), ("n_lamina = 240", "n_lamina = 20")
        ):  # fmt: skip
            assert line in stack
            stack = stack.replace(line, coarse)
        (folder / "stack.toml").write_text(stack, encoding="utf-8")
        parts = [
            '[campaign]\nname = "small"\n[structure]\nstack = "stack.toml"',
            f'[points]\nfile = "{demo / "points.csv"}"\nunit = "mm"',
            "[identification]\nband_Hz = [100, 420]\norder = 8",
        ]
        for i in range(n_configuration):
            files = demo / f"M{1 + i % 2}" / "run_0[1-6].uff"
            parts.append(
                f'[[configuration]]\nname = "C{i + 1}"\npressure_kPa = {160 * (1 + i % 2)}\nfiles = ["{files}"]'
            )
        path = folder / "campaign.toml"
        path.write_text("\n".join(parts), encoding="utf-8")
        return path

    return write


@pytest.fixture(scope="session")
def small(tmp_path_factory, worker_id, write_small_campaign):
    """A campaign of four configurations, and the folder of what `fit_campaign` made of it without a break.

    One worker makes them, each has a copy.
    """

    def make(folder):
        folder.mkdir()
        campaign = write_small_campaign(folder, 4)
        done = tuple(fit_campaign(Run(campaign=campaign, output=folder / "out", console=Console(quiet=True))))
        assert len(done) == 4
        assert not any(isinstance(one, Failed) for one in done)

    folder = tmp_path_factory.mktemp("small") / "campaign"
    if worker_id == "master":
        make(folder)
    else:
        shared = tmp_path_factory.getbasetemp().parent / "small"
        with FileLock(f"{shared}.lock"):
            if not shared.exists():
                make(shared)
        shutil.copytree(shared, folder)
    return folder / "campaign.toml", folder / "out"


@pytest.fixture(scope="session")
def written():
    """A function that returns the contents of a folder's files, but of hidden ones, as a kill can leave them."""

    def contents(folder):
        files = [f for f in folder.rglob("*") if f.is_file() and not f.name.startswith(".")]
        return {f.relative_to(folder).as_posix(): f.read_bytes() for f in files}

    return contents
