"""Clamps that sit otherwise than the file says: the mass that a clamp takes with it is its own."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse.linalg as sla

from model import Clamp, Mesh, assemble, catalogue, read_stack, reduce
from model.effects.parts import known_or_usual_instruments
from updating.diagnosis.candidates import candidate_model, clamp_locations

STACK = dataclasses.replace(
    read_stack(Path(__file__).parents[2] / "data/demo_stack/stack.toml"), n_lamina=6, mesh=Mesh(n_x=6, n_y=2)
)


def with_clamp(distribution):
    clamp = Clamp(mass=3.0, x=0.03, y=0.002, footprint=(0.04, 0.03), distribution=distribution)
    return dataclasses.replace(STACK, clamps=(clamp,))


def frequencies(system, parameters=None):
    """Of the lowest ten elastic modes, Hz."""
    theta = {**system.theta, **(parameters or {})}
    value = la.eigh(system.matrix("K", theta), system.matrix("M", theta), eigvals_only=True)
    return np.sqrt(value[6:16]) / (2.0 * np.pi)


def plain(stack):
    """The stack without effects, exact at its own G_f, at which its one snapshot is."""
    return reduce(stack, n_snapshot=1)


@pytest.mark.parametrize("distribution", ["height", "faces"])
def test_a_clamp_takes_its_mass_with_it(distribution):
    stack, off = with_clamp(distribution), 2e-3
    along_x, along_y = clamp_locations(stack)
    assembly = assemble(stack.with_effects(along_x, along_y))
    # along x elements end at clamps, and the mesh would be another one
    moved = dataclasses.replace(stack.clamps[0], y=stack.clamps[0].y + off)
    expected = assemble(dataclasses.replace(stack, clamps=(moved,))).matrix("M", assembly.theta)
    base = assemble(stack).matrix("M", assembly.theta)
    found = assembly.matrix("M", {**assembly.theta, along_y.name: off})
    assert sla.norm(found - expected) < 0.1 * sla.norm(base - expected)


def test_clamps_that_are_off_change_frequencies_as_the_model_with_clamps_there_does():
    """At the crest of a mode the first order says that nothing changes; by the second, 20 mm are 1 to 2 % off."""
    clamps = tuple(Clamp(mass=2.8, x=x, y=0.0, footprint=(0.04, 0.06)) for x in (-0.109, -0.0254, 0.0254, 0.109))
    stack = dataclasses.replace(STACK, n_lamina=12, mesh=Mesh(n_x=18, n_y=2), clamps=clamps)
    places = clamp_locations(stack)
    system = reduce(stack.with_effects(*places), n_snapshot=4)
    base, start = frequencies(plain(stack)), frequencies(system)
    for off, least, tolerance in ((5e-3, 2e-3, 2e-4), (2e-2, 3e-2, 3e-3)):
        moved = tuple(dataclasses.replace(clamp, x=clamp.x + off) for clamp in clamps)
        there = frequencies(plain(dataclasses.replace(stack, clamps=moved)))
        found = frequencies(system, {place.name: off for place in places if place.name.endswith("x")})
        assert np.max(np.abs(there / base - 1.0)) > least
        np.testing.assert_allclose(found / start, there / base, rtol=tolerance)


def test_a_clamp_at_the_end_does_not_leave_the_stack():
    """Shapes were continued beyond the edge: 6 mm off it, a clamp had lowered a mode by a tenth, or two fifths."""
    clamp = Clamp(mass=2.2, x=0.5 * STACK.length - 1e-4, y=0.0, footprint=(0.0, 0.06), distribution="faces")
    stack = dataclasses.replace(STACK, n_lamina=12, mesh=Mesh(n_x=18, n_y=2), clamps=(clamp,))
    along_x, _ = clamp_locations(stack)
    system = reduce(stack.with_effects(along_x), n_snapshot=4)
    start = frequencies(system)
    for off in (3e-3, 6e-3, 1.2e-2):
        np.testing.assert_allclose(frequencies(system, {along_x.name: off}), start, rtol=0.07)
    inwards = dataclasses.replace(stack, clamps=(dataclasses.replace(clamp, x=clamp.x - 6e-3),))
    base, there = frequencies(plain(stack)), frequencies(plain(inwards))
    share = (frequencies(system, {along_x.name: -6e-3}) / start - 1.0) / (there / base - 1.0)
    # no polynomial is flat on one side alone: inwards some 0.73 of what it should be, and outwards some 0.27
    assert np.all((share > 0.65) & (share < 1.0))


@pytest.mark.parametrize("distribution", ["height", "faces"])
def test_mass_stays_positive_however_far_off_a_clamp_is(distribution):
    stack = with_clamp(distribution)
    along_x, along_y = clamp_locations(stack)
    assembly = assemble(stack.with_effects(along_x, along_y))
    for x, y in ((0.02, 0.0), (0.0, -0.02), (0.02, 0.02), (-0.02, 0.02)):
        off = {along_x.name: x, along_y.name: y}
        mass = assembly.matrix("M", {**assembly.theta, **off})
        assert np.linalg.eigvalsh(mass.toarray())[0] > 0.0


@pytest.mark.parametrize("distribution", ["height", "faces"])
def test_mass_that_a_clamp_lacks_is_its_own(distribution):
    stack = with_clamp(distribution)
    assembly = assemble(stack.with_effects(catalogue()["clamp_mass"]))
    found = assembly.matrix("M", {**assembly.theta, "clamp_added_mass": -0.5})
    lighter = dataclasses.replace(stack.clamps[0], mass=2.5)
    expected = assemble(dataclasses.replace(stack, clamps=(lighter,))).matrix("M", assembly.theta)
    assert sla.norm(found - expected) < 1e-12 * sla.norm(expected)


def test_a_clamp_cannot_lack_mass_that_it_does_not_have():
    """The file may have a clamp without mass, for its place; the reduction passes over what cannot be."""
    stack = dataclasses.replace(STACK, clamps=(Clamp(mass=0.0, x=0.03, y=0.0, footprint=(0.04, 0.03)),))
    effects = {"clamp_mass": catalogue()["clamp_mass"]}
    model = candidate_model(stack, known_or_usual_instruments(stack), effects)
    assert np.isfinite(model.system.basis).all()
