"""The reduced model is cached for the next diagnosis of the same stack, and for no other."""

import dataclasses
import os
import pickle
from pathlib import Path

import cloudpickle
import numpy as np
import pytest

from model import EffectError, Mesh, assemble, catalogue, read_stack
from model.effects.catalogue import shipped
from model.effects.parts import known_or_usual_instruments
from updating.diagnosis import cached_model as module
from updating.diagnosis.cached_model import N_CACHED, cached_model, flattened, read_arrays, restored, write_arrays

ROOT = Path(__file__).parents[2]
STACK = dataclasses.replace(read_stack(ROOT / "data/demo_stack/stack.toml"), n_lamina=12, mesh=Mesh(n_x=4, n_y=1))
INSTRUMENTS = known_or_usual_instruments(STACK)
EFFECTS = {name: catalogue()[name] for name in ("clamp_mass", "normal_stiffness")}


@pytest.fixture(scope="module")
def reduced():
    return module.candidate_model(STACK, INSTRUMENTS, EFFECTS)


@pytest.fixture
def made(monkeypatch, tmp_path, reduced):
    """List the stacks that are reduced; the folder is a fresh one."""
    stacks = []

    def reduce(stack, *_):
        stacks.append(stack)
        return reduced

    monkeypatch.setattr(module, "candidate_model", reduce)
    monkeypatch.setattr(module, "folder", lambda: tmp_path / "cache")
    return stacks


def test_a_second_diagnosis_of_a_stack_reads_its_model(made, reduced):
    first, second = (cached_model(STACK, INSTRUMENTS, EFFECTS) for _ in range(2))
    assert len(made) == 1
    assert first is reduced
    assert second.effects == EFFECTS
    theta = {**reduced.system.theta, "G_f": 900.0}
    for target in ("M", "C", "K"):
        np.testing.assert_array_equal(second.system.matrix(target, theta), reduced.system.matrix(target, theta))


def test_another_stack_or_catalogue_has_a_model_of_its_own(made):
    cached_model(STACK, INSTRUMENTS, EFFECTS)
    cached_model(dataclasses.replace(STACK, height=1.001 * STACK.height), INSTRUMENTS, EFFECTS)
    cached_model(STACK, dataclasses.replace(INSTRUMENTS, shaker=(0.0, 0.0, 0.0)), EFFECTS)
    cached_model(STACK, INSTRUMENTS, {"clamp_mass": EFFECTS["clamp_mass"]})
    assert len(made) == 4


def test_another_version_makes_its_own(made, monkeypatch):
    cached_model(STACK, INSTRUMENTS, EFFECTS)
    monkeypatch.setattr(module, "versions", lambda: {"lamella": "another"})
    cached_model(STACK, INSTRUMENTS, EFFECTS)
    assert len(made) == 2


def test_effects_of_the_users_own_are_reduced_anew_for_their_code_may_change(made, tmp_path):
    def terms(assembly):
        return EFFECTS["clamp_mass"].terms(assembly)

    one = {**EFFECTS, "clamp_mass": dataclasses.replace(EFFECTS["clamp_mass"], terms=terms)}
    for _ in range(2):
        cached_model(STACK, INSTRUMENTS, one)
    assert len(made) == 2
    assert not (tmp_path / "cache").exists()


def test_effects_that_ship_are_known_in_another_process_too(made):
    """It has copies of them; models that were made there were never kept."""
    for _ in range(2):
        cached_model(STACK, INSTRUMENTS, cloudpickle.loads(cloudpickle.dumps(EFFECTS)))
    assert len(made) == 1


def same(one, other):
    theta = {**other.system.theta, "G_f": 900.0}
    return all(
        np.array_equal(part(one).matrix(target, theta), part(other).matrix(target, theta))
        for part in (lambda found: found.system, lambda found: found.finer, lambda found: found.resized["length"])
        for target in "MCK"
    )


@pytest.mark.parametrize("damage", [
    lambda content: content[:100],
    lambda content: content[:-100],
    lambda content: content[:-5000] + bytes([content[-5000] ^ 1]) + content[-4999:],
    lambda content: content.replace(b'"crc32": "', b'"crc32": "0', 1),
    lambda content: b"",
    lambda content: b"{}\n",
    lambda content: b"\0" * 10**6,
])  # fmt: skip
def test_a_damaged_file_is_made_anew(made, tmp_path, reduced, damage):
    cached_model(STACK, INSTRUMENTS, EFFECTS)
    (file,) = (tmp_path / "cache").iterdir()
    file.write_bytes(damage(file.read_bytes()))
    for n_made in (2, 2):
        assert same(cached_model(STACK, INSTRUMENTS, EFFECTS), reduced)
        assert len(made) == n_made


def test_the_file_of_another_stack_is_not_taken(made, tmp_path, reduced):
    other = dataclasses.replace(STACK, height=1.001 * STACK.height)
    for stack in (STACK, other):
        cached_model(stack, INSTRUMENTS, EFFECTS)
    one, renamed = (tmp_path / "cache").iterdir()
    content = one.read_bytes(), renamed.read_bytes()
    one.write_bytes(content[1])
    renamed.write_bytes(content[0])
    assert same(cached_model(STACK, INSTRUMENTS, EFFECTS), reduced)
    assert len(made) == 3


class Planted:
    """Runs a command where its pickle is read."""

    def __init__(self, command):
        self.command = command

    def __reduce__(self):
        return os.system, (self.command,)


def test_a_planted_pickle_is_not_run(made, tmp_path, reduced):
    cached_model(STACK, INSTRUMENTS, EFFECTS)
    (file,) = (tmp_path / "cache").iterdir()
    planted = pickle.dumps(Planted(f"touch {tmp_path / 'run'}"))
    file.write_bytes(planted)
    file.with_suffix(".pickle").write_bytes(planted)
    assert same(cached_model(STACK, INSTRUMENTS, EFFECTS), reduced)
    assert len(made) == 2
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    "written",
    [
        {"module": "os", "name": "system", "given": {"command": "touch run"}},
        {"module": "model.effects.catalogue", "name": "read_effect", "given": {"path": "run.py"}},
        {"module": "model.effects.clamp_mass", "name": "terms", "given": {}},
        {"module": "model.effects.clamp_inertia", "name": "partial", "given": {}},
    ],
)
def test_a_file_chooses_no_code_but_factors_of_effects(written):
    with pytest.raises(TypeError, match="is no factor of an effect"):
        module._formula(written)


def test_every_shipped_effect_can_be_written(tmp_path):
    """What cannot be is reduced at every start."""
    each = {effect.name: effect for effect in shipped()}
    plain = assemble(STACK)
    assembly = assemble(STACK.with_effects(*(effect for effect in each.values() if _possible(effect, plain))))
    special = module._special(each.values())
    graph = flattened(assembly, module._TYPES, special)
    write_arrays(tmp_path / "file", graph, {})
    found = restored(read_arrays(tmp_path / "file", {}), module._TYPES, special)
    assert found.stack.effects == assembly.stack.effects
    moved = {name: 0.9 * value + 0.01 for name, value in assembly.theta.items()}
    for one, other in zip(found.terms, assembly.terms, strict=True):
        assert one.name == other.name
        assert one.factor(moved) == other.factor(moved)
        assert one.factor.names(moved) == other.factor.names(moved)
    np.testing.assert_array_equal(found.matrix("K", moved).toarray(), assembly.matrix("K", moved).toarray())


def _possible(effect, assembly):
    try:
        return bool(effect.terms(assembly))
    except EffectError:
        return False


def test_where_nothing_can_be_written_the_answer_is_the_same(made, monkeypatch, tmp_path, reduced):
    (tmp_path / "file").write_text("no folder")
    monkeypatch.setattr(module, "folder", lambda: tmp_path / "file")
    assert cached_model(STACK, INSTRUMENTS, EFFECTS) is reduced


def test_the_models_that_were_used_last_stay(made, tmp_path):
    stacks = [dataclasses.replace(STACK, width=(1.0 + i) * STACK.width) for i in range(N_CACHED + 1)]
    for i, stack in enumerate(stacks[:-1]):
        cached_model(stack, INSTRUMENTS, EFFECTS)
        for file in (tmp_path / "cache").iterdir():  # none was just used
            os.utime(file, (i, file.stat().st_mtime - 100.0))
    cached_model(stacks[0], INSTRUMENTS, EFFECTS)
    cached_model(stacks[-1], INSTRUMENTS, EFFECTS)
    assert len(made) == N_CACHED + 1
    cached_model(stacks[0], INSTRUMENTS, EFFECTS)
    assert len(made) == N_CACHED + 1
    cached_model(stacks[1], INSTRUMENTS, EFFECTS)
    assert len(made) == N_CACHED + 2
