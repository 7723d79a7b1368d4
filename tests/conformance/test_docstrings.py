"""What the API documentation is built from: docstrings that say of parameters and attributes what there is."""

import importlib
import inspect
import pkgutil
import re

import pytest

import ema
import model
import updating

MODULES = [
    info.name
    for package in (ema, model, updating)
    for info in pkgutil.walk_packages(package.__path__, f"{package.__name__}.")
]
SECTION = re.compile(r"(?m)^(\w[\w ]*)\n-{3,}\n((?:(?!\w[\w ]*\n-{3,}\n).*\n?)*)")
ENTRY = re.compile(r"(?m)^(\S.*?)(?: *:.*)?$")


def documented(text, title):
    """Names in a section of a docstring."""
    sections = dict(SECTION.findall(inspect.cleandoc(text)))
    return [name.lstrip("*") for entry in ENTRY.findall(sections.get(title, "")) for name in entry.split(", ")]


def public(owner, module):
    """Functions, classes and their methods and properties that a module makes and does not hide."""
    for name, member in vars(owner).items():
        one = member.__func__ if isinstance(member, classmethod | staticmethod) else inspect.unwrap(member)
        if isinstance(one, property):
            one = one.fget
        if name.startswith("_") or getattr(one, "__module__", None) != module:
            continue
        if inspect.isfunction(one) or inspect.isclass(one):
            yield one
        if inspect.isclass(one):
            yield from public(one, module)


def attributes(kind):
    fields = {name for base in kind.__mro__ for name in vars(base).get("__annotations__", {})}
    return fields | {name for name in dir(kind) if not name.startswith("_")}


@pytest.mark.parametrize("name", MODULES)
def test_docstrings_say_what_there_is(name):
    module = importlib.import_module(name)
    assert module.__doc__
    for item in public(module, name):
        text = item.__doc__
        assert text, item.__qualname__
        if inspect.isclass(item):
            unknown = set(documented(text, "Attributes")) - attributes(item)
        else:
            unknown = set(documented(text, "Parameters")) - set(inspect.signature(item).parameters)
        assert not unknown, f"{item.__qualname__}: no {unknown}"


def test_what_a_module_makes_is_found():
    names = {item.__qualname__ for item in public(importlib.import_module("ema.types.frf"), "ema.types.frf")}
    assert {"Geometry", "Dof", "Dofs"} <= names
    assert any("." in name for name in names)  # methods, too


def test_an_unknown_name_is_seen():
    def function(x):
        """Do nothing.

        Parameters
        ----------
        x, y : float
            Two numbers.
        """

    assert documented(function.__doc__, "Parameters") == ["x", "y"]
