"""Local changes: rows whose squares are the model's matrices, the integral over a size, and what is left."""

from __future__ import annotations

import dataclasses
import functools
import types

import numpy as np
import pytest
import scipy.linalg as la
from scipy.integrate import quad
from scipy.stats import norm

import model
from model.stack.parts import EdgeSupport
from tests.independent.plate import Plate
from updating.changes.candidate import lines
from updating.changes.compare import _verdict
from updating.changes.fields import Fields
from updating.changes.joint import joint_errors
from updating.changes.kinds import kinds
from updating.changes.kinds.edges import held_edges
from updating.changes.refined import Condensed
from updating.changes.scan import Actions, Measured, conditional, weigh
from updating.changes.situation import _pairs, _pairs_of_repeats
from updating.inference.equation_error import equation_errors
from updating.inference.protocol import Modal, State
from updating.results.what_changed import KindOfChange

ELASTIC = (EdgeSupport(edge="front", along=1e7, across=1e6, rotation=1e3),)


@functools.cache
def system(n_lamina, held, clamps=()):
    stack = model.Stack(
        name="s",
        length=0.3,
        width=0.12,
        height=0.004 * n_lamina,
        n_lamina=n_lamina,
        material=model.Material(young=2e11, poisson=0.28, density=7700.0),
        contact=model.Contact(G_f=1000.0, d_f=1e-11, pressure=2e5, normal_modulus=5e8),
        mesh=model.Mesh(n_x=8, n_y=4),
        supports=ELASTIC if held else (),
        clamps=clamps,
    )
    return model.reduce(stack)


def fields(n_lamina, held=False, m=10, clamps=()):
    one = system(n_lamina, held, clamps)
    stiffness, mass = one.matrix("K", one.theta), one.matrix("M", one.theta)
    return one, Fields(one, la.eigh(stiffness, mass)[1][:, :m], one.theta, (100.0, 1000.0))


CLAMPS = tuple(model.Clamp(mass=0.3, x=x, y=0.0, footprint=(0.03, 0.1)) for x in (-0.08, 0.05))


def projected(one, made, name):
    vectors = la.eigh(one.matrix("K", one.theta), one.matrix("M", one.theta))[1][:, : made.n_mode]
    term = next(t for t in one.terms if t.name == name)
    matrix = term.matrix
    if not isinstance(matrix, np.ndarray):
        matrix = matrix.range @ matrix.core @ matrix.range.T
    return term.factor(one.theta) * vectors.T @ matrix @ vectors


def squared(rows, weight):
    return np.einsum("pRi,p,pRj->ij", rows, weight, rows)


@pytest.mark.parametrize("n_lamina", [1, 12])
def test_rows_of_strain_and_motion_make_the_matrices_of_the_model(n_lamina):
    one, made = fields(n_lamina)
    whole, area = made.layers[0], made.grid.area
    for found, name in (
        (squared(made.strain(whole), area), "laminas"),
        (made.mass / area.sum() * squared(made.motion(whole), area), "lamina mass"),
    ):
        expected = projected(one, made, name)
        assert np.abs(found - expected).max() < 0.03 * np.abs(expected).max()


def test_rows_of_contact_make_the_matrices_of_the_model_and_layers_sum_to_the_whole():
    one, made = fields(12)
    area = made.grid.area
    slip, opening = made.slip_and_opening(made.layers[0])
    for rows, name in ((slip, "tangential contact"), (opening, "normal contact")):
        expected = projected(one, made, name)  # openings vary faster than a trapezoidal rule likes
        assert np.abs(squared(rows, area) - expected).max() < 0.06 * np.abs(expected).max()
    whole, *thirds = (squared(made.contact(layer), area) for layer in made.layers)
    np.testing.assert_allclose(sum(thirds), whole, atol=1e-9 * np.abs(whole).max())


def test_rows_of_clamps_make_their_masses():
    one, made = fields(12, clamps=CLAMPS)
    for i, rows in enumerate(made.clamps):
        expected = projected(one, made, f"clamp {i} mass")
        np.testing.assert_allclose(rows.T @ rows, expected, atol=1e-9 * np.abs(expected).max())


def test_rows_of_a_held_edge_make_its_stiffness():
    one, made = fields(1, held=True)
    (edge,) = held_edges(made)
    found = squared(edge.moving, edge.weight) + squared(edge.turning, edge.weight)
    expected = projected(one, made, "support 0")
    assert np.abs(found - expected).max() < 0.01 * np.abs(expected).max()


def test_a_line_has_its_length_where_the_plan_is_and_nothing_beyond():
    _, made = fields(1)
    centre = np.array([[0.0, 0.0], [0.15, 0.0]])
    weight = lines(made.grid, centre, np.zeros(2), np.array([0.1, 0.1]), n=200)
    assert weight.sum(axis=1) == pytest.approx([0.1, 0.05], rel=0.02)


def test_every_kind_changes_the_equations_somewhere_or_says_why_it_cannot_be():
    for n_lamina, held in ((1, True), (12, False)):
        _, made = fields(n_lamina, held)
        at, _ = made.locations()
        for kind in kinds():
            why = kind.why_not(made)
            if why is not None:
                assert len(why) > 10
                continue
            found = kind.candidates(made, at)
            assert found.n > 0
            assert kind.value(found, np.zeros(found.n)).shape == (found.n,)
            assert max(abs(part.weight).max() * np.abs(part.rows).max() for part in found.parts) > 0.0
            some = found.only(np.array([0]))
            assert some.n == 1
            assert some.parts[0].weight.shape[0] == 1


def test_kinds_that_differ_by_their_sign_are_weighed_once():
    _, made = fields(12)
    each = {kind.name: kind for kind in kinds()}
    at, _ = made.locations()
    m = made.n_mode
    actions = Actions(Measured(weight=np.eye(m)[:4], eigenvalue=np.ones(4), scale=np.ones((4, m))))
    for less, more in (
        ("softer_patch", "stiffer_patch"), ("lost_contact", "glued_patch"), ("removed_mass", "added_mass"),
    ):  # fmt: skip
        pair = [each[name].candidates(made, at) for name in (less, more)]
        for one, other in zip(pair[0].parts, pair[1].parts, strict=True):
            assert one.weight is other.weight
        found = [actions.of(candidates) for candidates in pair]
        np.testing.assert_allclose(found[0], -found[1], atol=1e-12 * np.abs(found[0]).max())
        assert np.abs(found[0]).max() > 0.0


def test_what_a_structure_does_not_have_cannot_have_changed():
    plate, stack = (fields(n)[1] for n in (1, 12))
    why = {kind.name: (kind.why_not(plate), kind.why_not(stack)) for kind in kinds()}
    assert why["lost_contact"][0] is not None
    assert why["lost_contact"][1] is None
    assert all(why[name] == why["loose_clamp"] for name in ("tight_clamp",))
    assert None not in why["loose_clamp"]  # no clamps on either
    assert None not in why["softer_edge"]  # nothing holds them
    assert not any("sensor" in name or "orthotropy" in name for name in why)


def test_a_size_is_integrated_over_a_half_normal_prior_that_ends_at_what_is_possible():
    rng = np.random.default_rng(3)
    root = np.linalg.cholesky(np.diag(rng.uniform(0.5, 2.0, 6)))
    error = rng.standard_normal(6)
    for action in (-error + 0.3 * rng.standard_normal(6), error):
        for upper in (np.inf, 0.7):
            effects = np.array([0.5, 2.0])
            found = weigh(action[None], np.ones(1), upper, error, root, effects)

            def density(t, scale, action=action, upper=upper):
                rest = np.linalg.solve(root, error + t * action)
                prior = norm.pdf(t, scale=scale) / (norm.cdf(upper, scale=scale) - 0.5)
                return np.exp(-0.5 * rest @ rest) * prior

            rest = np.linalg.solve(root, error)
            expected = [quad(density, 0.0, min(upper, 40.0), args=(scale,))[0] for scale in effects]
            assert found.log[0] == pytest.approx(np.log(np.mean(expected)) + 0.5 * rest @ rest, abs=1e-6)
            assert 0.0 <= found.amplitude[0] <= upper


POINTS = np.stack(np.meshgrid(np.linspace(-0.14, 0.14, 7), np.linspace(-0.05, 0.05, 5)), axis=-1).reshape(-1, 2)


def changed_plate(planted):
    """Return a plate with a state that its whole equations of motion give, and the errors of that without a change."""
    one, made = fields(1, held=True, m=7)
    stiffness, mass = (one.assembly.matrix(target, one.theta).toarray() for target in "KM")
    more_stiff, more_mass = planted(one.assembly)
    square, vector = la.eigh(stiffness + more_stiff, mass + more_mass, subset_by_index=[0, 4])
    return beside_reference(one, made, square, sensors_of(one) @ vector)


def sensors_of(one):
    sensors = np.zeros((len(POINTS), one.assembly.size))
    sensors[:, one.assembly.slices()["w"]] = one.assembly.plan.point_rows("w", POINTS).toarray()
    return sensors


def beside_reference(one, made, square, shape):
    """Return modes of a changed plate beside the plate itself, the errors of that, and which equations bend."""
    value, low = (
        part[..., : made.n_mode] for part in la.eigh(one.matrix("K", one.theta), one.matrix("M", one.theta))
    )  # the modes of `made`
    sensors, size = sensors_of(one), np.linalg.norm(shape, axis=0)
    seen = size > 1e-3 * size.max()  # others move in the plane
    square, shape = square[seen], (shape / np.maximum(size, 1e-300))[:, seen]
    n, no = np.count_nonzero(seen), np.zeros(0)
    nothing = np.full(n, 1e-5)
    state = State(
        name="s", path=("s",), frequency=np.sqrt(square) / (2.0 * np.pi), frequency_std=nothing,
        damping=np.full(n, np.nan), damping_std=nothing, shape=shape, shape_std=nothing,
    )  # fmt: skip
    none = np.zeros(0, dtype=int)
    modal = Modal(
        eigenvalue=value, n_rigid=0, shape=low, rows=sensors @ one.basis @ low, moves=none, stiffness=no, mass=no,
        damping=np.zeros((1, made.n_mode, made.n_mode)), damps=none, damping_change=no, looks=none, row_change=no,
        beyond=no, beyond_rows=no, beyond_stiffness=no, beyond_mass=no,
    )  # fmt: skip
    errors = equation_errors(state, modal, np.full(n, 1e-4), 1)
    ours = Measured(weight=errors.weight, eigenvalue=square, scale=errors.latent.scale)
    joint = types.SimpleNamespace(errors=(errors,))
    at = types.SimpleNamespace(structure=made, ours=ours, joint=joint, n_reference=0, sensors=(sensors,))
    return at, errors.value, np.linalg.norm(modal.rows, axis=0) > 1.0


@pytest.mark.parametrize(("name", "size", "along"), [("added_mass", 0.4, "uvw"), ("spring_to_ground", 3e5, "w")])
def test_a_large_change_at_a_point_is_closer_once_the_answer_of_the_plate_is_in(name, size, along):
    place = np.array([[0.08, 0.02]])

    def planted(assembly):
        rows = np.zeros((len(along), assembly.size))
        for row, field in zip(rows, along, strict=True):
            row[assembly.slices()[field]] = assembly.plan.point_rows(field, place).toarray()[0]
        added = size * rows.T @ rows
        return (0.0 * added, added) if name == "added_mass" else (added, 0.0 * added)

    at, error, seen = changed_plate(planted)
    kind = next(one for one in kinds() if one.name == name)
    candidates = kind.candidates(at.structure, place)
    left = error + Condensed(at).changes(kind, candidates, 0)[0](np.array([size]))[0].reshape(error.shape)
    first = error + size * Actions(at.ours).of(candidates)[0]
    error, left, first = (one[:, seen] for one in (error, left, first))
    assert np.linalg.norm(first) > 5e-3 * np.linalg.norm(error)
    assert np.linalg.norm(left) < 0.4 * np.linalg.norm(first)


@pytest.mark.parametrize(
    ("name", "planted", "number"),
    [
        ("crack", {"crack": {"x": -0.01, "y": 0.02, "length": 0.4, "along": 1.0}}, 3),
        ("hole", {"hole": {"x": -0.01, "y": 0.02, "diameter": 0.34}}, 7),
    ],
)
def test_a_long_crack_and_a_large_hole_act_as_other_finite_elements_have_them(name, planted, number):
    """To first order they take far more than that: what is left carries less than it did."""
    one, made = fields(1, held=True, m=12)
    scale = float(np.sqrt(0.3 * 0.12))
    (values,) = planted.values()
    size = "length" if name == "crack" else "diameter"
    # held at its lowest x, which is the lowest y here
    plate = Plate(
        length=0.12, width=0.3, thickness=0.004, young=2e11, poisson=0.28, density=7700.0, translation=1e6,
        rotation=1e3, mesh=(8, 14),
    )  # fmt: skip
    f, _, shape = plate.modes(4, POINTS[:, ::-1], {name: values | {size: values[size] * scale}})
    at, error, seen = beside_reference(one, made, (2.0 * np.pi * f) ** 2, shape)
    kind = next(one for one in kinds() if one.name == name)
    candidates = kind.candidates(made, np.array([[values["y"], values["x"]]]))
    (i, *_) = np.flatnonzero(candidates.form == number)
    assert kind.value(candidates.only(np.array([i])), np.ones(1))[0] == pytest.approx(values[size] * scale)
    left = error + Condensed(at).changes(kind, candidates, int(i))[0](np.ones(1))[0].reshape(error.shape)
    first = error + Actions(at.ours).of(candidates)[i]
    error, left, first = (one[:, seen] for one in (error, left, first))
    assert np.linalg.norm(left) < 0.3 * np.linalg.norm(error)
    assert np.linalg.norm(left) < 0.6 * np.linalg.norm(first)


def test_what_the_reference_shares_cancels():
    covariance = np.array([[1.0001, 1.0], [1.0, 1.0001]])
    rest, left, _ = conditional(np.array([3.0, 3.1]), covariance, np.array([False, True]))
    assert rest[0] == pytest.approx(0.1, abs=1e-3)
    assert left[0, 0] == pytest.approx(2e-4, rel=0.01)


def test_of_two_modes_that_look_alike_the_nearer_one_is_the_same():
    """A mode that sensors hardly see takes on the shape of the one that they see beside it."""
    before = types.SimpleNamespace(weight=np.eye(3)[:2], eigenvalue=np.array([1.0, 4.0]))
    for eigenvalue, beside in (([1.0, 4.1, 5.0], 2), ([1.0, 3.2, 3.9], 1)):
        after = types.SimpleNamespace(weight=np.eye(3)[[0, 1, 1]], eigenvalue=np.array(eigenvalue))
        assert beside not in _pairs(after, before)[0]


def test_of_two_modes_that_a_resonator_makes_one_is_the_same_as_all_repeats_of_the_reference():
    after = types.SimpleNamespace(weight=np.eye(3)[[0, 1, 1]], eigenvalue=np.array([1.0, 4.0, 6.25]))
    repeats = [types.SimpleNamespace(weight=np.eye(3)[:2], eigenvalue=np.array([1.0, own])) for own in (4.9, 5.1)]
    paired = _pairs_of_repeats(after, repeats)
    assert [row.tolist() for row, _ in paired] == [[0, 1], [0]]


def test_two_roving_accelerometers_that_read_otherwise_are_no_change():
    """One at each side of a plate, put back so that they differ by 3 % more than in the reference."""
    one, made = fields(1, held=True, m=7)
    square, vector = (part[..., :5] for part in la.eigh(one.matrix("K", one.theta), one.matrix("M", one.theta)))
    sensor = (POINTS[:, 1] > 0.0).astype(int)
    shape = (sensors_of(one) @ one.basis @ vector) * (1.0 + 0.03 * sensor)[:, None]
    at, *_ = beside_reference(one, made, 1.002 * square, shape)
    (errors,) = at.joint.errors
    modal, n = errors.latent.modal, len(errors.eigenvalue)
    state = State(
        name="s", path=("s",), frequency=np.sqrt(errors.eigenvalue) / (2.0 * np.pi), frequency_std=np.full(n, 1e-5),
        damping=np.full(n, np.nan), damping_std=np.zeros(n), shape=errors.latent.shape.T, shape_std=np.full(n, 1e-4),
    )  # fmt: skip
    misfit = []
    for gain in (0.0, 0.02):
        joint = joint_errors([state], [modal], [sensor], gain)
        inverse = la.inv(joint.noise + 3e-3**2 * joint.each)
        misfit.append(joint.value @ inverse @ joint.value)
    assert misfit[1] < 0.2 * misfit[0]


def a_kind(name, log_odds, explained=1.0):
    nowhere = (0.0, 0.0, 0.0)
    return KindOfChange(
        name=name, label=name, log_odds=log_odds, probability=0.5, local=True, place=nowhere, place_std=nowhere,
        best=nowhere, quantity="", unit="1", size=1.0, lower=0.5, upper=1.5, extent=0.1, angle=0.0, layer="", part="",
        explained=explained,
    )  # fmt: skip


def test_verdicts():
    near = [a_kind("a", 20.0), a_kind("b", 17.0), a_kind("c", 12.0)]
    assert _verdict(near, 20.1, seen=True) == ("one of", ("a", "b"))
    assert _verdict(near[::2], 20.1, seen=True) == ("identified", ("a",))
    assert _verdict(near, 1.0, seen=True) == ("too little to say", ())
    assert _verdict(near, 1.0, seen=False) == ("unchanged", ())
    half = [dataclasses.replace(near[0], explained=0.7)]
    assert _verdict(half, 20.0, seen=True)[0] == "partly explained"
    none = [dataclasses.replace(near[0], explained=0.2)]
    assert _verdict(none, 20.0, seen=True) == ("unlike anything", ())
