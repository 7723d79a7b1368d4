"""Diagnoses of one lamina, free and held, against tests that quintic plate elements made and not `model`."""

from __future__ import annotations

import functools
import sys
from pathlib import Path

import numpy as np
import pytest

import model
from model.stack.parts import EdgeSupport
from updating.diagnosis.candidates import candidate_model, instruments_of
from updating.diagnosis.diagnosis import diagnose
from updating.fitting.fit import fit
from updating.results.text import parameter_text

sys.path.insert(0, str(Path(__file__).parent))
from reference_plate import (
    DENSITY,
    LENGTH,
    POISSON,
    THICKNESS,
    WIDTH,
    YOUNG,
    Edge,
    grid_of_points,
    measured,
    plate_modes,
)

CLAMPED = (EdgeSupport(edge="left", along=np.inf, across=np.inf, rotation=np.inf),)
RIGID = Edge(translation=1e12, rotation=1e8)
CONSIDERED = (
    "support_compliance",
    "steel_orthotropy",
    "stinger_mass",
    "soft_interlayers",
    "steel_loss",
    "contact_loss",
)
PRESSURE = 1e5


def plate(*supports):
    return model.Stack(
        name="plate",
        length=LENGTH,
        width=WIDTH,
        height=THICKNESS,
        n_lamina=1,
        material=model.Material(young=YOUNG, poisson=POISSON, density=DENSITY),
        mesh=model.Mesh(n_x=9, n_y=6),
        supports=supports,
    )


@functools.cache
def reduced(held):
    """Return the model of the plate, which all tests of it share."""
    effects = {name: effect for name, effect in model.catalogue().items() if name in CONSIDERED}
    return candidate_model(plate(*(CLAMPED if held else ())), instruments_of(measured(None)), effects)


def diagnosed(supports, edge, seed=1):
    tested = [("plate", PRESSURE, measured(edge, seed=seed))]
    return diagnose(plate(*supports), tested, {}, reduced=lambda *_: reduced(bool(supports)))


def test_the_plates_of_both_models_agree():
    for supports, edge, n_rigid in (((), None, 6), (CLAMPED, RIGID, 0)):
        theirs = plate_modes(10, edge, grid_of_points())[0]
        system = model.reduce(plate(*supports), n_mode=16)
        nowhere = model.Observation(node=[1], location=[[0.0, 0.0, 0.0]], direction=[[0.0, 0.0, 1.0]])
        ours = model.solve_modes(system, G_f=1e3, d_f=0.0, n_mode=n_rigid + 10, observation=nowhere)
        np.testing.assert_allclose(ours.frequency[n_rigid:], theirs, rtol=2e-3)


@pytest.mark.parametrize(
    ("supports", "edge"),
    [pytest.param((), None, id="free"), pytest.param(CLAMPED, RIGID, id="clamped", marks=pytest.mark.slow)],
)
def test_a_plate_that_lacks_nothing_is_said_to_lack_nothing(supports, edge):
    found = diagnosed(supports, edge)
    assert found.verdict == "nothing missing"
    assert found.n_used == {"plate": (10, 10)}
    assert any("Damping is not compared" in sentence for sentence in found.sentences)
    assert not any("damping ratio" in sentence for sentence in found.sentences)
    reasons = found.impossible
    assert "no interface" in reasons["soft_interlayers"]
    assert "no contact" in reasons["contact_loss"]
    assert "damping is not compared" in reasons["steel_loss"]
    assert ("support_compliance" in reasons) == (not supports)


@pytest.mark.parametrize(
    "edge",
    [
        pytest.param(Edge(translation=1e8, rotation=2e4), id="a soft edge"),
        pytest.param(Edge(translation=1e5, rotation=300.0), id="an edge that is nearly free", marks=pytest.mark.slow),
    ],
)
def test_an_edge_that_gives_way_is_named_with_its_stiffness(edge):
    found = diagnosed(CLAMPED, edge)
    assert found.verdict == "identified"
    assert found.set == (("support_compliance",),)
    assert found.sentences[0].startswith("Identified: compliance of a held edge (support_compliance), ")
    base, best = found.ranked(()), found.ranked(("support_compliance",))
    assert base.frequency_error > 0.02 > 1e-3 > best.frequency_error
    assert best.left_out_error < 2e-3
    stiffness = {p.name: p for p in best.parameter}
    for name, true in (("edge_translation", edge.translation), ("edge_rotation", edge.rotation)):
        found = stiffness[name]  # three standard deviations: of one test in twenty the interval of 95 % misses
        assert abs(np.log(true / found.value)) < 1.5 * 0.5 * np.log(found.upper / found.lower)
        assert stiffness[name].value == pytest.approx(true, rel=0.15)


def test_a_fit_of_one_lamina_puts_it_beside_the_measurement_as_it_is():
    found = fit(plate(), measured(None, seed=2))
    assert found.pairing.measured.tolist() == list(range(10))
    assert found.error < 1e-3
    assert found.G_f.value == found.stack.contact.G_f
    assert found.G_f.std == 0.0
    assert "not fitted" in parameter_text(found.G_f)
    assert "not fitted" in parameter_text(found.d_f)
