"""Structures of matrices behind the inference: derivatives, fits of stated terms, and what is missing."""

from dataclasses import replace

import numpy as np
import pytest

import model
from model.matrices.reduced import _forces
from tests.matrices_plate import EXAMPLE, POINTS, as_measured, noisy
from updating.diagnosis import evidence
from updating.diagnosis.evidence import POINTS_SHIFT, DiagnosisScatter
from updating.diagnosis.fit_settings import coordinate_of
from updating.diagnosis.matrices_answer import diagnose_matrices, fit_matrices
from updating.diagnosis.matrices_model import MatricesModel
from updating.errors import PairingError
from updating.inference.explain import coordinates_of


@pytest.fixture(scope="module")
def structure():
    return model.read_matrices(EXAMPLE / "structure.toml")


@pytest.fixture(scope="module")
def measured(structure, tmp_path_factory):
    """Make modes, as a test gives them, of the structure at some factors with some strengths of effects."""
    folder = tmp_path_factory.mktemp("modes")

    def make(factors, effects=None):
        whole = _of(structure, as_measured(folder, np.ones(1), np.ones((len(POINTS), 1))))
        coordinates = coordinates_of(whole, [whole.terms[name] for name in effects or {}])
        at = {name: np.log(value) for name, value in factors.items()}
        at |= {name: coordinate_of(whole.parameters[name], value) for name, value in (effects or {}).items()}
        x = np.array([at.get(c.name, 0.0) for c in coordinates])
        modal = whole.about(coordinates, [x]).modal(x, 0)
        frequency = np.sqrt(np.concatenate([modal.eigenvalue, modal.beyond])) / (2 * np.pi)
        rows = np.hstack([modal.rows, modal.beyond_rows])
        return noisy(folder, frequency, rows, 3)

    return make


def _of(structure, modes):
    tested = evidence.Tested(name="plate", pressure=np.nan, modes=modes)
    return MatricesModel(structure, [tested], DiagnosisScatter())


def test_derivatives_are_those_of_differences(structure, measured):
    whole = _of(structure, measured({"root_springs": 1.0}))
    names = ("mass_at_corner", "spring_at_side_z", "tip_mass", "sensor_mass")
    coordinates = coordinates_of(whole, [whole.terms[n] for n in names])
    x = np.array([0.02 if c.name in names else 0.01 for c in coordinates])
    x[[c.name for c in coordinates].index(POINTS_SHIFT)] = 1e-3
    near = whole.about(coordinates, [x])
    found = near.modal(x, 0)
    order = [c.name for c in coordinates]
    for name in ("stiffness", "mass", "root_springs", "strip", *names):
        i = order.index(name)
        step = 1e-6 * np.eye(x.size)[i]
        ends = [near.modal(x + sign * step, 0).eigenvalue for sign in (1.0, -1.0)]
        k = list(found.moves).index(i)
        expected = np.diag(found.stiffness[k]) - found.eigenvalue * np.diag(found.mass[k])
        np.testing.assert_allclose((ends[0] - ends[1]) / 2e-6, expected, rtol=1e-3, atol=1e-6 * found.eigenvalue[-1])
    i = order.index(POINTS_SHIFT)
    step = 1e-6 * np.eye(x.size)[i]
    ends = [near.modal(x + sign * step, 0).rows for sign in (1.0, -1.0)]
    slope = found.row_change[list(found.looks).index(i)]
    np.testing.assert_allclose((ends[0] - ends[1]) / 2e-6, slope, rtol=1e-3, atol=1e-6 * np.abs(slope).max())


def test_the_stated_terms_are_fitted(structure, measured):
    fit = fit_matrices(structure, measured({"root_springs": 0.6, "strip": 1.1}))
    value = {one.name: one for one in fit.moved}
    for name, true in (("root_springs", 0.6), ("strip", 1.1), ("mass", 1.0), ("stiffness", 1.0)):
        assert abs(value[name].value - true) < 3.0 * value[name].std
    assert fit.error < 5e-4 < fit.initial_error
    assert fit.pairing.paired_mac.min() > 0.999
    assert not fit.at_bound
    assert not any("frequency error" in finding for finding in fit.findings)
    unmet = replace(fit, error=0.9 * fit.initial_error)
    assert "less than half of the frequency error" in unmet.findings[0]


def test_nothing_is_missing_where_nothing_is(structure, measured):
    found = diagnose_matrices(structure, [("plate", measured({"root_springs": 0.7}))])
    assert found.verdict == "nothing missing"


@pytest.mark.parametrize(
    ("name", "value"),
    [
        pytest.param("mass_at_corner", 0.04, marks=pytest.mark.slow),  # `lamella diagnose` finds such a one
        ("spring_at_other_corner_z", 2e4),
        pytest.param("tip_mass", 0.5, marks=pytest.mark.slow),
    ],
)
def test_what_is_hidden_is_found(structure, measured, name, value):
    found = diagnose_matrices(structure, [("plate", measured({"root_springs": 0.7}, {name: value}))])
    assert found.verdict in ("identified", "one of")
    assert found.set[0] == (name,)
    (one,) = found.ranked((name,)).parameter
    assert one.value == pytest.approx(value, rel=0.05)
    assert name in found.sentences[0]


def test_a_basis_is_asked_once_whether_it_holds_about_a_point(structure, measured, monkeypatch):
    whole, asked = _of(structure, measured({"root_springs": 1.0})), []
    error = model.ReducedMatrices.error
    monkeypatch.setattr(model.ReducedMatrices, "error", lambda one, theta: asked.append(theta) or error(one, theta))
    at = [c.name for c in whole.nuisances].index("root_springs")
    for value in (0.0, 0.01, 0.1):
        x = np.zeros(len(whole.nuisances))
        x[at] = value
        whole.about(whole.nuisances, [x])
    assert [round(float(np.log(theta["root_springs"])), 3) for theta in asked] == [0.0, 0.1]


def test_errors_at_several_points_are_those_at_each(structure):
    reduced = model.reduce_matrices(structure)
    points = [{"root_springs": 0.4}, {}, {"strip": 1.5, "tip_mass": 0.3}]
    found = reduced.errors(points)
    assert found == pytest.approx([reduced.error(theta) for theta in points], rel=1e-6)
    theta = {**structure.theta, **points[2]}
    frequency, vector = reduced.solve(theta, 1)
    x, value = reduced.basis @ vector, (2.0 * np.pi * frequency) ** 2
    stiffness = structure.matrix("K", theta)
    force = stiffness @ x - structure.matrix("M", theta) @ x * value
    rounding = 1e-13 * float(np.max(abs(stiffness) @ np.abs(x)))
    np.testing.assert_allclose(_forces(structure, {None: 1.0, **theta}, x, value), force, atol=rounding)


def test_a_direction_that_rounding_leaves_without_mass_harms_no_mode(structure):
    reduced = model.reduce_matrices(structure)
    more = {"K": 1e12, "M": -1e-20}  # as of a basis whose vectors depend on each other
    terms = [replace(term, matrix=np.pad(term.matrix, (0, 1))) for term in reduced.terms]
    for i, target in ((next(i for i, t in enumerate(terms) if t.target == target), target) for target in "KM"):
        terms[i].matrix[-1, -1] = more[target]
    basis = np.pad(reduced.basis, ((0, 0), (0, 1)))
    wider = replace(reduced, terms=tuple(terms), basis=basis)
    np.testing.assert_allclose(wider.solve(n_mode=8)[0], reduced.solve(n_mode=8)[0], rtol=1e-8)
    _, vector = wider.solve(n_mode=8)
    mass = vector.T @ wider.matrix("M", wider.theta) @ vector
    np.testing.assert_allclose(mass, np.eye(8), atol=1e-9)


def test_a_point_off_the_structure_is_named(structure, measured):
    modes = measured({"root_springs": 1.0})
    moved = replace(modes.geometry, coordinate=10.0 * modes.geometry.coordinate)
    with pytest.raises(PairingError, match=r"mm from the nearest node.*unit and origin"):
        fit_matrices(structure, replace(modes, geometry=moved))


def test_a_screen_has_what_the_model_changes(structure, measured):
    whole = _of(structure, measured({"root_springs": 1.0}))
    coordinates = coordinates_of(whole, [whole.terms[n] for n in ("mass_at_corner", "spring_at_side_z")])
    x, there = (np.zeros(len(coordinates)), np.array([0.1 if c.name != POINTS_SHIFT else 0.0 for c in coordinates]))
    near = whole.about(coordinates, [x])
    screen = near.screen(x, 0)
    found, m = screen.change(there), whole.n_equation
    _, every, before = near.solved(x)
    after = near.solved(there)[2]
    for target, one, beyond in (("K", found.stiffness, found.stiffness_beyond), ("M", found.mass, found.mass_beyond)):
        exact = every.T @ (after[target] - before[target]) @ every
        np.testing.assert_allclose(one[0][0], exact[:, :m], atol=1e-9 * np.abs(exact).max())
        np.testing.assert_allclose(beyond[0][0], np.diag(exact)[m:], atol=1e-9 * np.abs(exact).max())
        for k, i in enumerate(found.moved):
            ends = [near.solved(there + s * 1e-3 * np.eye(x.size)[i])[2][target] for s in (1.0, -1.0)]
            slope = every.T @ ((ends[0] - ends[1]) / 2e-3) @ every
            np.testing.assert_allclose(one[1][k, 0], slope[:, :m], atol=1e-4 * max(np.abs(slope).max(), 1e-6))
