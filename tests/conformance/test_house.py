"""The plan of the house: who may import whom, read from the source."""

import ast
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FORBIDDEN = {"ema": {"model", "updating"}, "model": {"ema", "updating"}, "updating": set()}
FOLDERS = {
    "ema": ("types", "io", "campaign", "quality", "modal", "identification", "plot"),
    "model": ("stack", "elements", "contact", "solvers", "reduction", "matrices", "modes", "effects", "plot"),
    "updating": (
        "workers", "inference", "correlation", "fitting", "results", "diagnosis", "changes", "pooled", "virtual",
        "report", "workbench", "commands",
    ),
}  # fmt: skip
"""Folders of each package by the way of the data: each imports only from itself and from those before it."""
FLOORS = 7
SOLE_IMPORTERS = {
    "pyuff": {"ema/io/uff.py"},
    "h5py": {"ema/io/array_files.py"},
    "nptdms": {"ema/io/array_files.py"},
    "sdypy": set(),
}
DRAWING = {"matplotlib", "pyvista", "vtk", "tkinter", "plotly", "trame", "aiohttp"}
MOST_LINES = {"function": 100, "module": 600}
"""What reads in one piece: a function as long as its thought, a module of one idea."""


def sources(package):
    return sorted((ROOT / package).rglob("*.py"))


@cache
def tree_of(source):
    return ast.parse(source)


@cache
def parse(path):
    return tree_of(path.read_text(encoding="utf-8"))


@cache
def imported_modules(tree):
    """Dotted names of everything imported anywhere in a module, with the names taken from it."""
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            found += [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
    return tuple(found)


def imported(tree):
    """Top-level names of everything imported anywhere in a module."""
    return {name.split(".")[0] for name in imported_modules(tree)}


def imported_on_load(tree):
    """Top-level names of what a module imports when it is itself imported."""
    for node in tree.body:
        yield from imported(node) if isinstance(node, ast.Import | ast.ImportFrom) else ()


def name_of(path):
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def arrows(package):
    """Modules of a package, each with those of the same package that it imports."""
    modules = {name_of(path): parse(path) for path in sources(package)}
    return {name: (set(imported_modules(tree)) & modules.keys()) - {name} for name, tree in modules.items()}


def circle(graph):
    """Names of a circle of arrows, none where there is none."""
    done, way = set(), []

    def follow(name):
        if name in way:
            return [*way[way.index(name) :], name]
        if name in done:
            return []
        way.append(name)
        found = next((c for c in map(follow, sorted(graph.get(name, ()))) if c), [])
        way.pop()
        done.add(name)
        return found

    return next((c for c in map(follow, sorted(graph)) if c), [])


def folder_of(module):
    parts = module.split(".")
    return parts[1] if len(parts) > 2 or (len(parts) == 2 and (ROOT / Path(*parts)).is_dir()) else ""


def folder_arrows(graph):
    """Folders, each with those of the same package from which a module of it imports."""
    found = {}
    for name, targets in graph.items():
        if folder_of(name):
            found.setdefault(folder_of(name), set()).update(filter(None, map(folder_of, targets)))
    return {folder: targets - {folder} for folder, targets in found.items()}


def height(graph, name):
    return 1 + max((height(graph, below) for below in graph.get(name, ())), default=0)


@pytest.mark.parametrize("package", FORBIDDEN)
def test_packages_import_in_one_direction(package):
    for path in sources(package):
        assert not FORBIDDEN[package] & imported(parse(path)), path


def test_what_all_share_knows_none_of_them():
    assert not set(FORBIDDEN) & imported(parse(ROOT / "lamella_shared.py"))


@pytest.mark.parametrize("package", FOLDERS)
def test_every_folder_has_its_place(package):
    assert {path.parent.name for path in (ROOT / package).glob("*/__init__.py")} == set(FOLDERS[package])


def backward(graph, order):
    """Pairs of folders of which the first imports from the second, which comes after it."""
    return {
        (folder, target)
        for folder, targets in folder_arrows(graph).items()
        for target in targets
        if order.index(target) > order.index(folder)
    }


@pytest.mark.parametrize("package", FOLDERS)
def test_a_folder_imports_only_from_those_before_it(package):
    assert backward(arrows(package), FOLDERS[package]) == set()


def test_an_import_from_a_later_folder_is_seen():
    graph = arrows("ema")
    graph["ema.io.files"] |= {"ema.quality.verdict"}
    assert backward(graph, FOLDERS["ema"]) == {("io", "quality")}
    assert circle(graph) == []  # of modules there need be none


@pytest.mark.parametrize("package", FOLDERS)
def test_folders_are_few_floors_high(package):
    graph = folder_arrows(arrows(package))
    assert max(height(graph, folder) for folder in graph) <= FLOORS


@pytest.mark.parametrize("package", FOLDERS)
def test_modules_import_in_no_circle(package):
    assert circle(arrows(package)) == []


def test_a_circle_is_seen():
    assert circle({"a": {"b"}, "b": {"c"}, "c": {"b"}}) == ["b", "c", "b"]


def oversized(source):
    """Names in a module of what has more lines than a person takes in at once."""
    tree = tree_of(source)
    if len(source.splitlines()) > MOST_LINES["module"]:
        yield "the module"
    for node in ast.walk(tree):
        is_function = isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        if is_function and node.end_lineno - node.lineno + 1 > MOST_LINES["function"]:
            yield node.name


@pytest.mark.parametrize("package", FOLDERS)
def test_functions_and_modules_are_short(package):
    for path in sources(package):
        assert not list(oversized(path.read_text(encoding="utf-8"))), path


def test_what_is_too_long_is_seen():
    assert list(oversized("def long():\n" + 100 * "    pass\n")) == ["long"]
    assert list(oversized(601 * "x = 1\n")) == ["the module"]
    assert not list(oversized("def short():\n" + 99 * "    pass\n"))


@pytest.mark.parametrize("library", SOLE_IMPORTERS)
def test_file_and_identification_libraries_stay_behind_one_door(library):
    found = {
        path.relative_to(ROOT).as_posix()
        for package in FOLDERS
        for path in sources(package)
        if library in imported(parse(path))
    }
    assert found <= SOLE_IMPORTERS[library]


@pytest.mark.parametrize("package", FOLDERS)
def test_drawing_libraries_load_only_when_something_is_drawn(package):
    for path in sources(package):
        assert not DRAWING & set(imported_on_load(parse(path))), path


def test_a_forbidden_import_is_seen():
    tree = ast.parse("def f():\n    from model.stack import Stack\n    import matplotlib.pyplot as plt\n")
    assert imported(tree) == {"model", "matplotlib"}
    assert not set(imported_on_load(tree))


def test_second_models_know_nothing_of_what_they_judge():
    for path in sources("tests/independent"):
        assert not {"model", "ema", "updating"} & imported(parse(path)), path


def numbers(package):
    """Public names of modules of a package that stand for a number alone, with all their values."""
    found = {}
    for path in sources(package):
        for node in parse(path).body:
            name = node.targets[0].id if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name) else "_"
            if (
                not name.startswith("_")
                and isinstance(node.value, ast.Constant)
                and type(node.value.value) in (int, float)
            ):
                found.setdefault(name, set()).add(node.value.value)
    return found


def test_a_public_number_has_one_value():
    every = [numbers(package) for package in FORBIDDEN]
    names = {name for found in every for name in found}
    assert len(names) > 20
    assert not {n for n in names if len(set().union(*(found.get(n, set()) for found in every))) > 1}
