"""What the API documentation is built from: docstrings that say of parameters and attributes what there is."""

import inspect
import pkgutil
import re

import pdoc.doc
import pdoc.docstrings
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
    return [
        name.lstrip("*") for entry in ENTRY.findall(sections.get(title, "")) for name in entry.split(", ")
    ]


def public(namespace):
    """Functions, classes and their methods that a module makes and does not hide, as pdoc finds them."""
    for member in namespace.own_members:
        if isinstance(member, pdoc.doc.Function | pdoc.doc.Class) and not member.name.startswith("_"):
            yield member
            if isinstance(member, pdoc.doc.Class):
                yield from public(member)


def attributes(kind):
    fields = {name for base in kind.__mro__ for name in vars(base).get("__annotations__", {})}
    return fields | {name for name in dir(kind) if not name.startswith("_")}


@pytest.mark.parametrize("name", MODULES)
def test_docstrings_say_what_there_is(name):
    module = pdoc.doc.Module.from_name(name)
    assert module.docstring
    for item in public(module):
        assert item.docstring, item.fullname
        pdoc.docstrings.numpy(item.docstring)
        if isinstance(item, pdoc.doc.Class):
            unknown = set(documented(item.docstring, "Attributes")) - attributes(item.obj)
        else:  # warns of an annotation that has no meaning
            unknown = set(documented(item.docstring, "Parameters")) - set(item.signature.parameters)
        assert not unknown, f"{item.fullname}: no {unknown}"


@pytest.mark.parametrize("name", MODULES)
def test_documentation_can_be_built(name):
    """pdoc warns, which is an error, of members whose origin or annotation it cannot find."""
    for item in pdoc.doc.Module.from_name(name).own_members:
        if isinstance(item, pdoc.doc.Class):
            functions = [m for m in item.members.values() if isinstance(m, pdoc.doc.Function)]
            assert all(m.signature for m in functions if m.docstring)


def test_an_unknown_name_is_seen():
    def function(x):
        """Do nothing.

        Parameters
        ----------
        x, y : float
            Two numbers.
        """

    assert documented(function.__doc__, "Parameters") == ["x", "y"]
