"""What is installed: the demo travels, what a source archive holds, and another package of the name of one of ours."""

import os
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest

from updating.commands import demo
from updating.commands.demo import shipped_data
from updating.errors import StoreError

ROOT = Path(__file__).parents[2]
LARGEST = 3e6  # bytes of a wheel


def carried():
    """Every file of data that a wheel holds."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    patterns = project["tool"]["setuptools"]["data-files"].items()
    return {
        (place, file.relative_to(ROOT)) for place, several in patterns for one in several for file in ROOT.glob(one)
    }


def test_the_demo_is_carried():
    found = {f"{place}/{file.name}" for place, file in carried()}
    folder = ROOT / "data/demo_diagnosis"
    files = {file for file in folder.rglob("*") if file.is_file() and file.name != "truth.json"}
    assert {f"share/lamella/{file.relative_to(ROOT / 'data').as_posix()}" for file in files} <= found
    assert not any("truth" in name for name in found)


def test_data_is_found_from_any_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert (shipped_data("demo_diagnosis") / "campaign.toml").is_file()
    monkeypatch.chdir(ROOT)
    assert shipped_data("demo_diagnosis") == Path("data/demo_diagnosis")  # as a person would write it
    monkeypatch.setattr(demo, "_CHECKOUT", tmp_path)
    with pytest.raises(StoreError, match="lacks the data 'nothing'"):
        shipped_data("nothing")


@pytest.mark.parametrize("name", ["ema", "model"])
def test_another_package_of_that_name_is_named(tmp_path, name):
    (tmp_path / f"{name}.py").write_text("x = 1\n")
    path = os.pathsep.join([str(tmp_path), str(ROOT)])
    done = subprocess.run(
        [sys.executable, "-c", "import updating"], cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": path}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 1
    last = done.stderr.splitlines()[-1]
    assert last.startswith(f"ImportError: Lamella needs its package '{name}'")
    assert str(tmp_path / f"{name}.py") in last


@pytest.mark.slow
def test_a_wheel_is_small_and_a_source_archive_whole(tmp_path):
    pytest.importorskip("build")
    listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    source = tmp_path / "source"
    for name in listed.splitlines():
        (source / name).parent.mkdir(parents=True, exist_ok=True)
        (source / name).write_bytes((ROOT / name).read_bytes())
    subprocess.run([sys.executable, "-m", "build", "--outdir", tmp_path, source], capture_output=True, check=True)
    (wheel,), (archive,) = tmp_path.glob("*.whl"), tmp_path.glob("*.tar.gz")
    assert wheel.stat().st_size < LARGEST
    names = zipfile.ZipFile(wheel).namelist()
    assert any(name.endswith("share/lamella/demo_diagnosis/campaign.toml") for name in names)
    with tarfile.open(archive) as packed:
        held = {name.partition("/")[2] for name in packed.getnames()}
    assert {name for name in listed.splitlines() if name != ".gitignore"} <= held
