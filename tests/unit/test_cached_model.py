"""The reduced model is cached for the next diagnosis of the same stack, and for no other."""

import dataclasses
import os
from pathlib import Path

import numpy as np
import pytest

from model import Mesh, catalogue, read_stack
from model.effects.parts import known_or_usual_instruments
from updating.diagnosis import cached_model as module
from updating.diagnosis.cached_model import N_CACHED, cached_model

ROOT = Path(__file__).parents[2]
STACK = dataclasses.replace(
    read_stack(ROOT / "data/demo_stack/stack.toml"), n_lamina=12, mesh=Mesh(n_x=4, n_y=1)
)
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
        np.testing.assert_array_equal(
            second.system.matrix(target, theta), reduced.system.matrix(target, theta)
        )


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
    own = {**EFFECTS, "clamp_mass": dataclasses.replace(EFFECTS["clamp_mass"])}
    for _ in range(2):
        cached_model(STACK, INSTRUMENTS, own)
    assert len(made) == 2
    assert not (tmp_path / "cache").exists()


def test_a_damaged_file_is_made_anew(made, tmp_path):
    cached_model(STACK, INSTRUMENTS, EFFECTS)
    (file,) = (tmp_path / "cache").iterdir()
    file.write_bytes(file.read_bytes()[:100])
    for _ in range(2):
        cached_model(STACK, INSTRUMENTS, EFFECTS)
    assert len(made) == 2


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
