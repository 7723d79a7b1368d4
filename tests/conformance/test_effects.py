"""Every effect of the catalogue is what the equations of motion need, and the check sees effects that are not."""

import ast
import dataclasses
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
import scipy.sparse as sp

import model
import model.effects
from model.effects.conformance import effect_faults
from model.effects.parts import every_lamina, mean_over, square
from model.elements.equations import Formula, Monomial, Term
from model.stack.effect import Family

EFFECTS = model.catalogue()
BESIDE = {"__init__", "catalogue", "conformance", "parts"}
FILES = sorted(path for path in Path(model.effects.__path__[0]).glob("*.py") if path.stem not in BESIDE)


@pytest.mark.parametrize("name", EFFECTS)
def test_effect_conforms(name):
    assert effect_faults(EFFECTS[name]) == ()


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_file_ends_in_an_effect_of_its_name(path):
    last = ast.parse(path.read_text(encoding="utf-8")).body[-1]
    assert isinstance(last, ast.Assign)
    assert [target.id for target in last.targets] == ["EFFECT"]
    assert EFFECTS[path.stem].description.startswith(ast.get_docstring(ast.parse(path.read_text()))[:20])


def test_catalogue_has_all_families():
    assert len(EFFECTS) >= 24
    assert {effect.family for effect in EFFECTS.values()} == set(get_args(Family))


def spring(assembly, *, grounded):
    """A spring of 1 N/m from w in the middle to the ground, or a shear contact of 1 Pa."""
    if grounded:
        row = mean_over(assembly, "w", (0.0, 0.0), (0.05, 0.05))
        return (square("w", row, every_lamina(assembly.stack)),)
    return assembly.term("tangential contact").krons


def effect(factor=None, target="K", krons=None, **changes):
    """An effect without faults, but for what is given."""

    def terms(assembly):
        found = spring(assembly, grounded=False) if krons is None else krons(assembly)
        given = Monomial(exponent={"strength": 1}) if factor is None else factor
        return (Term(name="trial", target=target, factor=given, krons=found),)

    values = {
        "name": "trial",
        "label": "trial contact",
        "family": "contact law",
        "summary": "A trial",
        "description": "Trial.\n\nEnters: a\nRange: b\nDoes: c\nMistaken for: d",
        "parameters": (
            model.Parameter(name="strength", unit="Pa", nominal=1e6, lower=0.0, upper=1e8, source="this test"),
        ),
        "terms": terms,
    }
    return model.Effect(**{**values, **changes})


@dataclasses.dataclass(frozen=True)
class WrongDerivative:
    def __call__(self, theta):
        return theta["strength"] ** 2

    def derivative(self, theta, name):
        return theta["strength"] if name == "strength" else 0.0


def asymmetric(assembly):
    kron = assembly.term("tangential contact").krons[0]
    ramp = sp.diags_array(np.linspace(1.0, 2.0, kron.z.shape[0]))
    return (dataclasses.replace(kron, z=ramp @ kron.z),)


def too_small(assembly):
    kron = assembly.term("tangential contact").krons[0]
    return (dataclasses.replace(kron, z=kron.z[:-1, :-1]),)


def slip_alone(assembly):
    """Slip without the turning of the laminas: a stack that turns would stretch it."""
    return assembly.term("tangential contact").krons[:1]


def infinite(assembly):
    kron = assembly.term("tangential contact").krons[0]
    return (dataclasses.replace(kron, z=np.inf * kron.z),)


def raising(assembly):
    raise ZeroDivisionError


def grounding(assembly):
    return spring(assembly, grounded=True)


def ranging(**changes):
    values = {"name": "strength", "unit": "Pa", "nominal": 1e6, "lower": 0.0, "upper": 1e8, "source": "test"}
    return (model.Parameter(**{**values, **changes}),)


def test_the_trial_effects_have_no_faults():
    assert effect_faults(effect()) == ()
    assert effect_faults(effect(krons=grounding, grounded=True)) == ()


@pytest.mark.parametrize(
    ("broken", "expected"),
    [
        ({"krons": asymmetric}, "not symmetric"),
        ({"krons": infinite}, "cannot be evaluated|not finite"),
        ({"krons": too_small}, "must be of shapes"),
        ({"krons": slip_alone}, "turning about"),
        ({"krons": grounding}, "moving along z"),
        ({"grounded": True}, "no rigid-body motion meets a force"),
        ({"krons": raising}, "ZeroDivisionError"),
        ({"factor": Formula(lambda t: t["strength"] + 1.0)}, "at its neutral value the matrix K"),
        ({"factor": Formula(lambda t: 0.0 * t["strength"])}, "changes nothing"),
        ({"factor": Formula(lambda t: -1e3 * t["strength"])}, "the matrix K is negative"),
        ({"factor": Formula(lambda t: -1e6 * t["strength"]), "target": "C"}, "the matrix C is negative"),
        (
            {"factor": Formula(lambda t: -t["strength"]), "target": "M", "krons": grounding},
            "the matrix M is not positive",
        ),
        (
            {
                "factor": Formula(lambda t: t["strength"] * t["omega"] / 1e4),
                "target": "M",
                "krons": grounding,
                "frequency_dependent": True,
            },
            "whose factor is a Riding",
        ),
        ({"factor": WrongDerivative()}, "derivative of its factor by strength"),
        ({"factor": Formula(lambda t: abs(t["strength"]))}, "derivative of its factor by strength"),
        ({"factor": Formula(lambda t: t["strenght"])}, "strenght"),
        ({"frequency_dependent": True}, "frequency_dependent is True"),
        ({"description": "Enters: a\nRange: b\nDoes: c"}, "Mistaken for:"),
        ({"description": "Enters: a\nRange: b\nDoes:\nMistaken for: d"}, "Does:"),
        ({"summary": ""}, "summary"),
        ({"label": ""}, "noun phrase in lower case"),
        ({"label": "Lost contact"}, "such as 'clamp rotary inertia', got 'Lost contact'"),
        ({"label": "lost contact."}, "noun phrase"),
        ({"label": "clamp mass"}, "is that of clamp_mass too"),
        ({"parameters": ranging(name="pressure")}, "name of a parameter of the base model"),
        ({"terms": lambda assembly: ()}, "adds no term"),
        ({"terms": lambda assembly: assembly.terms[:1]}, "two terms have the name"),
    ],
)
def test_a_broken_effect_is_seen(broken, expected):
    import re

    faults = effect_faults(effect(**broken))
    assert any(re.search(expected, fault) for fault in faults), faults


def test_labels_tell_effects_apart():
    assert len({effect.label for effect in EFFECTS.values()}) == len(EFFECTS)
    assert model.printed_effects(["clamp_inertia", "unknown"]) == ("clamp rotary inertia (clamp_inertia)", "unknown")


def test_stated_units_and_sources_are_demanded():
    with pytest.raises(model.EffectError, match="unit and source"):
        ranging(unit="")
    with pytest.raises(model.EffectError, match="unit and source"):
        ranging(source="")


def test_shared_parameters_must_agree():
    other = effect(name="second", parameters=ranging(upper=2e8))
    with pytest.raises(model.EffectError, match=r"share the parameter strength .* upper"):
        model.shared_parameters([effect(parameters=ranging()), other])
