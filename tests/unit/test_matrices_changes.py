"""What changed in a structure of matrices: at its nodes, and in the terms that its file states."""

import types
from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp
import scipy.sparse.linalg as sla

import model
from tests.matrices_plate import EXAMPLE, plate_test
from updating.changes.compare import what_changed
from updating.changes.kinds import kinds
from updating.changes.nodes import N_LOCATION, Nodes
from updating.changes.reference import fit_matrices_reference
from updating.changes.refined import Condensed
from updating.changes.scan import Actions, Measured
from updating.changes.situation import Situation
from updating.commands import diagnose
from updating.commands.terminal import Run
from updating.diagnosis import evidence
from updating.diagnosis.matrices_model import MatricesModel
from updating.errors import FitError

SPRINGS = 0.7
MOUNTED = {"again": 0.72, "same": 0.68}


@pytest.fixture(scope="module")
def structure():
    return model.read_matrices(EXAMPLE / "structure.toml")


@pytest.fixture(scope="module")
def measured(structure, tmp_path_factory):
    folder = tmp_path_factory.mktemp("modes")
    return lambda factors, added=(), seed=0: plate_test(folder, structure, factors, added, seed)


@pytest.fixture(scope="module")
def reference(structure, measured):
    states = [measured({"root_springs": value}, seed=i) for i, value in enumerate((SPRINGS, MOUNTED["again"]))]
    return fit_matrices_reference(structure, [(f"r{i}", np.nan, one) for i, one in enumerate(states)])


def nodes_of(structure, modes, m=12):
    whole = MatricesModel(
        structure, [evidence.Tested(name="plate", pressure=np.nan, modes=modes)], evidence.DiagnosisScatter()
    )
    x = np.zeros(len(whole.nuisances))
    near = whole.about(whole.nuisances, [x])
    return Nodes(near, x, near.modal(x, 0).shape[:, :m], (20.0, 1400.0))


@pytest.fixture(scope="module")
def nodes(structure, measured):
    return nodes_of(structure, measured({}))


def test_of_a_repeat_that_was_mounted_anew_nothing_is_named(reference, measured):
    found = what_changed(reference, [("same", np.nan, measured({"root_springs": MOUNTED["same"]}, seed=5))])
    assert found.verdict == "unchanged"
    assert found.left == ()
    assert "softer_patch" in found.impossible


def test_what_is_held_otherwise_each_time_moves_frequencies_by_no_more_than_assembly_is_stated_to(reference, measured):
    moved = {}
    for stated in (1e-6, 1.0):
        at = Situation(reference, [("same", np.nan, measured({}, seed=5))], stated)
        weight = np.concatenate([one.weight.ravel() for one in at.joint.errors])
        mode = np.repeat(np.arange(weight.size // at.ours.weight.shape[1]), at.ours.weight.shape[1])
        one = np.where(mode[:, None] == mode, at.nuisance, 0.0)
        moved[stated] = stated**2 * float(weight @ one @ weight) / (mode.max() + 1)  # mean square of eigenvalues
    assert moved[1e-6] == pytest.approx(2e-12, rel=0.1)
    assert 1e-6 < moved[1.0] < 1e-2  # as known of springs and temperature


@pytest.mark.parametrize(
    ("factors", "added", "kind", "part", "size"),
    [
        ({}, [("M", (80, 40, 4), "xyz", 0.06)], "added_mass", "node", 0.06),
        ({}, [("K", (160, 120, 0), "z", 2e4)], "spring_to_ground", "along z", 2e4),
        ({"root_springs": 0.2}, [], "lesser_term", "root springs", 1.0 - 0.2 / SPRINGS),
        ({"strip": 0.8}, [], "lesser_term", "strip", 0.2),
        ({"tip_mass": 0.5}, [], "greater_term", "tip mass", 0.5),
    ],
)
def test_a_change_is_named_and_placed(reference, measured, factors, added, kind, part, size):
    state = measured({"root_springs": SPRINGS, **factors}, added, seed=7)
    found = what_changed(reference, [("after", np.nan, state)], seen=True)
    one = found.kind(kind)
    assert found.left[0] == kind
    assert part in one.part
    assert 0.8 * one.lower < size < 1.2 * one.upper
    if added:
        place = 1e-3 * np.array(added[0][1][:2])
        assert np.all(np.abs(np.array(one.place[:2]) - place) < 3.0 * np.array(one.place_std[:2]) + 0.02)
        assert found.map.sum() == pytest.approx(1.0)
        assert "Where: x = " in found.sentences[1]
        assert "end" not in found.sentences[1]


def test_without_locations_a_node_is_named_by_its_number(structure, measured):
    anywhere = np.repeat(structure.node[:, None].astype(float), 3, axis=1)
    bare = replace(structure, location=anywhere, placed=False)
    states = [measured({}, seed=1), measured({}, [("M", (80, 40, 4), "xyz", 0.1)], seed=2)]
    tests = []
    for modes in states:
        at = 1e-3 * modes.geometry.coordinate
        near = [int(np.argmin(np.linalg.norm(structure.location - one, axis=1))) for one in 1e3 * at]
        number = dict(zip(modes.geometry.node.tolist(), structure.node[near].tolist(), strict=True))
        geometry = replace(modes.geometry, node=structure.node[near])
        named = np.array([number[int(n)] for n in modes.node])
        force = replace(modes.input, node=np.array([number[int(n)] for n in modes.input.node]))
        tests.append(replace(modes, geometry=geometry, node=named, input=force))
    fitted = fit_matrices_reference(bare, [("before", np.nan, tests[0])])
    found = what_changed(fitted, [("after", np.nan, tests[1])], seen=True)
    assert found.left[0] == "added_mass"
    node = int(found.kind("added_mass").part.removeprefix("node "))
    place = structure.location[structure.node == node][0]
    assert place[:2] == pytest.approx((0.08, 0.04), abs=0.021)
    assert found.axes == ()
    assert len(found.sentences) == 2


def test_every_kind_changes_the_equations_somewhere_or_says_why_it_cannot_be(nodes):
    at, _ = nodes.locations()
    possible = set()
    for kind in kinds():
        why = kind.why_not(nodes)
        if why is not None:
            assert "matrices" in why
            continue
        found = kind.candidates(nodes, at)
        assert found.n > 0
        assert max(abs(part.weight).max() * np.abs(part.rows).max() for part in found.parts) > 0.0
        assert nodes.part_name(kind.name, int(found.part[0]))
        possible.add(kind.name)
    terms = {"lesser_term", "greater_term"}
    assert possible == {"added_mass", "removed_mass", "absorber", "spring_to_ground", *terms}


def test_stated_terms_are_their_matrices_and_only_springs_to_ground_are_mounted_anew(nodes, structure):
    for one in nodes.stated:
        (part,) = one.parts
        (term,) = (t for t in structure.terms if t.factor == one.name)
        expected = nodes.vectors.T @ (term.matrix @ nodes.vectors)
        made = np.einsum("pRi,p,pRj->ij", part.rows, part.weight.toarray()[0], part.rows)
        np.testing.assert_allclose(made, expected, atol=1e-9 * np.abs(expected).max())
    assert {one.name: one.there for one in nodes.stated} == {
        "root_springs": True, "strip": True, "tip_mass": False,
    }  # fmt: skip
    (held,) = nodes.grounded
    np.testing.assert_array_equal(held.rows, nodes.stated[0].parts[0].rows)


def test_a_fine_mesh_is_looked_at_coarsely_first():
    grid = np.stack(np.meshgrid(np.arange(40.0), np.arange(30.0), [0.0, 1.0], indexing="ij"), axis=-1)
    fine = Nodes.__new__(Nodes)
    fine.location = grid.reshape(-1, 3)
    fine.number = np.arange(len(fine.location))
    place, side = fine.locations()
    assert N_LOCATION / 2 < len(place) <= N_LOCATION
    near = fine.finer(place[:2], side)
    assert len(near) > 2 * len(place[:2])
    assert np.linalg.norm(near[:, None] - place[:2], axis=2).min(axis=1).max() < 1.5 * side.max()


def situation(nodes, matrices, value, vector):
    """Return modes that were solved as a situation has what was measured."""
    stiffness, mass = matrices
    first = np.einsum("im,im->m", nodes.vectors, stiffness @ nodes.vectors)
    weight = vector.T @ mass @ nodes.vectors
    weight = weight / np.linalg.norm(weight, axis=1)[:, None]
    scale = np.sqrt(np.outer(value, first))
    latent = types.SimpleNamespace(
        scale=scale, gap=(value[:, None] - first) / scale, weight=weight, eigenvalue=value,
        sure=np.full(value.size, 1e6), modal=types.SimpleNamespace(rows=nodes.vectors), shape=vector.T,
    )  # fmt: skip
    return types.SimpleNamespace(
        structure=nodes, ours=Measured(weight=weight, eigenvalue=value, scale=scale), n_reference=0,
        sensors=[sp.eye_array(len(vector))],
        joint=types.SimpleNamespace(errors=[types.SimpleNamespace(eigenvalue=value, latent=latent)]),
    )  # fmt: skip


def left_by(change, size):
    return np.hstack([mode.usual for mode in change.modes]) + change(np.array([size]))[0]


PLACE = np.array([[0.08, 0.04, 0.004]])


def test_a_large_mass_is_closer_once_the_answer_of_the_structure_is_in(nodes, structure):
    size = 0.2
    matrices = stiffness, mass = [sp.csc_matrix(structure.matrix(target, structure.theta)) for target in "KM"]
    at = np.linalg.norm(structure.location - PLACE, axis=1) < 1e-6
    value, vector = sla.eigsh(stiffness, 7, sp.csc_matrix(mass + size * sp.diags_array(at.astype(float))), sigma=-1e4)
    found = situation(nodes, matrices, value, vector)
    kind = next(one for one in kinds() if one.name == "added_mass")
    candidates = kind.candidates(nodes, PLACE)
    (change,) = Condensed(found).changes(kind, candidates, 0)
    error = found.joint.errors[0].latent.gap * found.ours.weight
    taken = error + size * Actions(found.ours).of(candidates)[0]
    assert np.linalg.norm(taken) > 5e-3 * np.linalg.norm(error)
    assert np.linalg.norm(left_by(change, size)) < 0.4 * np.linalg.norm(taken)


def test_what_is_tuned_is_weighed_between_the_tunings_that_are_tried(nodes, structure):
    size, kind = 0.05, next(one for one in kinds() if one.name == "absorber")
    candidates = kind.candidates(nodes, PLACE)
    tuned, n = candidates.parts[0].resonance, candidates.n // 3
    i = 2 + 3 * int(np.argmin(np.abs(tuned[::3] - (2.0 * np.pi * 200.0) ** 2)))  # along z
    assert n == tuned.size // 3
    assert "along z" in nodes.part_name(kind.name, int(candidates.part[i]))
    matrices = stiffness, mass = [sp.csc_matrix(structure.matrix(target, structure.theta)) for target in "KM"]
    at = (np.linalg.norm(structure.location - PLACE, axis=1) < 1e-6) & (structure.dof == 3)
    spring = 1.012**2 * tuned[i] * size
    tie = sp.csc_matrix(np.append(at.astype(float), -1.0)[:, None])
    whole = sp.block_diag([stiffness, [[0.0]]]) + spring * tie @ tie.T
    value, vector = sla.eigsh(sp.csc_matrix(whole), 7, sp.csc_matrix(sp.block_diag([mass, [[size]]])), sigma=-1e4)
    found = situation(nodes, matrices, value, vector[:-1])
    left = [np.linalg.norm(left_by(change, size)) for change in Condensed(found).changes(kind, candidates, i)]
    assert min(left) < 0.3 * left[len(left) // 2]


def test_the_model_beside_the_references_is_diagnosed_without_changed_states(monkeypatch, tmp_path):
    asked: list[str] = []

    def stop(assigned, *_):
        asked.extend(one.configuration.name for one in assigned)
        raise FitError("enough")

    monkeypatch.setattr(diagnose, "every_identified", stop)
    with pytest.raises(FitError, match="enough"):
        diagnose.diagnose_campaign(Run(campaign=EXAMPLE / "changes.toml", output=tmp_path))
    assert asked == ["before", "again"]
