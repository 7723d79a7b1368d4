"""The plan of the house: who may import whom, read from the source."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = ("ema", "model", "updating")
FORBIDDEN = {"ema": {"model", "updating"}, "model": {"ema", "updating"}, "updating": set()}
ROOMS = {
    "correlation": set(),
    "fitting": {"correlation"},
    "diagnosis": {"correlation"},
    "virtual": set(),
    "blind": {"diagnosis", "virtual"},
    "published": {"fitting", "diagnosis"},
    "report": {"correlation", "fitting", "diagnosis"},
}  # folders of `updating`, with those that each may import
SOLE_IMPORTERS = {"pyuff": {"ema/uff.py"}, "sdypy": set()}
DRAWING = {"matplotlib", "pyvista", "vtk", "tkinter"}


def sources(package):
    return sorted((ROOT / package).rglob("*.py"))


def imported(tree):
    """Top-level names of everything imported anywhere in a module."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name.split(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            yield (node.module or "").split(".")[0]


def rooms(tree):
    """Folders of `updating` that a module imports from."""
    modules = (n.module or "" for n in ast.walk(tree) if isinstance(n, ast.ImportFrom))
    return {m.split(".")[1] for m in modules if m.startswith("updating.")} & ROOMS.keys()


def imported_on_load(tree):
    """Top-level names of what a module imports when it is itself imported."""
    for node in tree.body:
        yield from imported(node) if isinstance(node, ast.Import | ast.ImportFrom) else ()


def parse(path):
    return ast.parse(path.read_text(encoding="utf-8"), filename=str(path))


@pytest.mark.parametrize("package", PACKAGES)
def test_packages_import_in_one_direction(package):
    for path in sources(package):
        assert not FORBIDDEN[package] & set(imported(parse(path))), path


@pytest.mark.parametrize("room", ROOMS)
def test_folders_of_updating_import_in_one_direction(room):
    for path in sources(f"updating/{room}"):
        assert rooms(parse(path)) <= ROOMS[room] | {room}, path


def test_every_folder_of_updating_has_its_place():
    assert {path.parent.name for path in (ROOT / "updating").glob("*/__init__.py")} == ROOMS.keys()


def test_every_package_has_sources():
    assert all(len(sources(package)) > 5 for package in PACKAGES)


@pytest.mark.parametrize("library", SOLE_IMPORTERS)
def test_file_and_identification_libraries_stay_behind_one_door(library):
    found = {
        path.relative_to(ROOT).as_posix()
        for package in PACKAGES
        for path in sources(package)
        if library in set(imported(parse(path)))
    }
    assert found <= SOLE_IMPORTERS[library]


@pytest.mark.parametrize("package", PACKAGES)
def test_drawing_libraries_load_only_when_something_is_drawn(package):
    for path in sources(package):
        assert not DRAWING & set(imported_on_load(parse(path))), path


def test_a_forbidden_import_is_seen():
    tree = ast.parse("def f():\n    from model.stack import Stack\n    import matplotlib.pyplot as plt\n")
    assert set(imported(tree)) == {"model", "matplotlib"}
    assert not set(imported_on_load(tree))
