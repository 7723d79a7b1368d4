"""The reduced model of a stack, cached for its next diagnosis: no measurement enters it, and it takes long."""

from __future__ import annotations

import pickle
import platform
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from contextlib import suppress
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

import cloudpickle
import platformdirs

from model import Effect, Instruments, Stack
from model.effects.catalogue import shipped
from updating.diagnosis.candidates import CandidateModel, candidate_model
from updating.errors import StoreError
from updating.results.store import digest, versions, write_bytes

N_CACHED = 3
"""Models that are cached, those that were used last; each takes some 170 MB."""


def cached_model(
    stack: Stack,
    instruments: Instruments,
    effects: Mapping[str, Effect],
    aids: Sequence[Effect] = (),
    executor: Executor | None = None,
) -> CandidateModel:
    """Return `candidate_model`, or read it from the user's cache folder where an earlier call left the same.

    A model with effects that do not ship is not cached, for their code may change. A folder that cannot be written, or
    a damaged file there, costs the time alone.

    Parameters
    ----------
    stack, instruments, effects, aids, executor
        As in `candidate_model`.
    """
    own = shipped()
    if any(effect not in own for effect in (*stack.effects, *effects.values())):
        return candidate_model(stack, instruments, effects, aids, executor)
    made_by = {**versions(), "scikit-fem": version("scikit-fem"), "python": platform.python_version()}
    what = {
        "versions": made_by,
        "stack": replace(stack, instruments=instruments),
        "effects": [*effects, *(aid.name for aid in aids)],
    }
    path = folder() / f"model_{digest(what)}.pickle"
    found = _read(path)
    if found is not None:
        return replace(found, effects={name: effects[name] for name in found.effects})
    found = candidate_model(stack, instruments, effects, aids, executor)
    with suppress(StoreError, OSError):
        write_bytes(path, cloudpickle.dumps(found))
        _forget(path.parent)
    return found


def folder() -> Path:
    """Return where models are cached."""
    return platformdirs.user_cache_path("lamella", appauthor=False)


def _read(path: Path) -> CandidateModel | None:
    try:
        found: CandidateModel = pickle.loads(path.read_bytes())
        path.touch()  # for it was used now
    except Exception:  # no file, or what a damaged one makes of reading it
        return None
    return found


def _forget(where: Path) -> None:
    """Remove all models but those that were used last."""
    every = sorted(where.glob("model_*.pickle"), key=lambda file: file.stat().st_mtime, reverse=True)
    for file in every[N_CACHED:]:
        file.unlink(missing_ok=True)
