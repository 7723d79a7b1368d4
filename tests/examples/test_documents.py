"""What the documents name exists: links, files, modules and commands."""

import ast
import importlib
import re
from pathlib import Path

import pytest

from updating.commands.command_line import app

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", ROOT / ".github/CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]
FOLDERS = r"(?:\.ci|\.github|data|docs|ema|model|tests|updating)"


def text_of(page):
    return page.read_text(encoding="utf-8")


def slug(heading):
    """Return the anchor that a heading of Markdown gets."""
    return re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-")


def exists(name):
    """Tell whether a dotted name is a module or something in one."""
    parts = name.split(".")
    for n in range(len(parts), 0, -1):
        try:
            found = importlib.import_module(".".join(parts[:n]))
        except ModuleNotFoundError:
            continue
        for part in parts[n:]:
            if not hasattr(found, part):
                return False
            found = getattr(found, part)
        return True
    return False


def broken_links(page, text):
    for target, anchor in re.findall(r"\]\((?!https?:)([^)#\s]*)#?([^)\s]*)\)", text):
        other = page if not target else page.parent / target
        if not other.exists():
            yield target
        elif anchor and anchor not in {slug(h) for h in re.findall(r"(?m)^#+ (.*)$", text_of(other))}:
            yield f"{target}#{anchor}"


def commands(text):
    """Names of commands at the beginning of a line of code or of what stands in backticks."""
    return set(re.findall(r"(?:^    |`)lamella ([a-z][\w-]*)", text, flags=re.MULTILINE))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page):
    assert not list(broken_links(page, text_of(page)))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_modules_and_their_members_exist(page):
    named = set(re.findall(r"`((?:ema|model|updating)(?:\.\w+)+)", text_of(page)))
    assert not {name for name in named if not exists(name)}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_files_exist(page):
    named = set(re.findall(rf"`({FOLDERS}/[\w./-]*)`", text_of(page)))
    assert not {name for name in named if not (ROOT / name).exists()}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_commands_exist(page):
    known = {(c.name or c.callback.__name__) for c in app.registered_commands}
    assert commands(text_of(page)) <= known


def test_constants_in_the_table_of_thresholds_exist():
    table = text_of(ROOT / "docs/theory.md").partition("## Thresholds")[2]
    rows = re.findall(r"(?m)^\| `([\w.]+)` \| (.*?) \|", table)
    assert len(rows) > 5
    missing = {f"{m}.{c}" for m, names in rows for c in re.findall(r"`(\w+)`", names) if not exists(f"{m}.{c}")}
    assert not missing


def test_every_page_is_in_the_table_of_contents():
    listed = re.findall(r"(?m)^([\w/]+)$", text_of(ROOT / "docs/index.md"))
    assert {page.stem for page in (ROOT / "docs").glob("*.md")} - {"index"} <= set(listed)


@pytest.mark.parametrize("script", sorted((ROOT / "docs/gallery").glob("*.py")), ids=lambda script: script.stem)
def test_an_example_reads_what_is_there_and_imports_what_exists(script):
    text = text_of(script)
    assert re.match(r'"""\n(.+)\n=+\n', text)
    files = re.findall(r'DATA / "([^"]+)"', text)
    assert files
    assert not [name for name in files if not (ROOT / "data" / name).exists()]
    imports = [node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.ImportFrom)]
    assert not [f"{i.module}.{a.name}" for i in imports for a in i.names if not exists(f"{i.module}.{a.name}")]


def test_what_does_not_exist_is_seen():
    page = ROOT / "docs/limits.md"
    assert list(broken_links(page, "[a](no.md) [b](theory.md#none) [c](theory.md#thresholds)")) == [
        "no.md",
        "theory.md#none",
    ]
    assert not exists("ema.lscf")
    assert not exists("updating.inference.levels.GAIN_SINGLE")
    assert exists("ema.identification.stabilization")
    assert commands("`lamella play SPEC`\n    lamella fit\nnot lamella this") == {"play", "fit"}
