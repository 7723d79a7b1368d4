"""The engine that is asked of a case. Another engine is put beside it by another `answer`."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from functools import cache
from typing import Any

import model
from model import Effect, Instruments, Stack
from tests.golden.cases import Case
from tests.golden.record import Errors, Record, Value
from updating.diagnosis.answer import Diagnosis, Ranked
from updating.diagnosis.cached_model import cached_model
from updating.diagnosis.candidates import CandidateModel
from updating.diagnosis.diagnosis import diagnose
from updating.results.store import digest

_models: dict[str, CandidateModel] = {}
_spent: list[float] = []  # processor seconds for reduced models


def answer(case: Case) -> Record:
    """Return what the engine says of a case; the seconds leave out the reduced model, which all cases share."""
    _spent.clear()
    begun = time.process_time()
    found = diagnose(case.stack, case.tested, _effects(), reduced=_reduced)
    return Record(
        **case.meta | {"truth": case.truth},
        **said(found, case.truth),
        seconds=time.process_time() - begun - sum(_spent),
    )


def said(found: Diagnosis, truth: Sequence[str]) -> dict[str, Any]:
    """Return what a diagnosis says as fields of a record."""
    first = found.ranked(found.set[0] if found.set else ())
    return {
        "verdict": found.verdict,
        "names": found.set,
        "values": {
            one.name: Value(unit=one.unit, value=one.value, lower=one.lower, upper=one.upper) for one in first.parameter
        },
        "base": _errors(found.ranked(())),
        "answer": _errors(first),
        "true": _errors(found.ranked(truth)) if truth and found.has(truth) else None,
    }


def _errors(one: Ranked) -> Errors:
    def known(value: float) -> float | None:
        return float(value) if math.isfinite(value) else None

    return Errors(
        frequency=known(one.frequency_error),
        damping=known(one.damping_error),
        left_out_frequency=known(one.left_out_error),
        left_out_damping=known(one.left_out_damping_error),
    )


@cache
def _effects() -> Mapping[str, Effect]:
    return model.catalogue()


def _reduced(
    stack: Stack,
    instruments: Instruments,
    effects: Mapping[str, Effect],
    aids: Sequence[Effect] = (),
    executor: Executor | None = None,
) -> CandidateModel:
    """Return the reduced model of a stack, read or made once in this process."""
    begun = time.process_time()
    key = digest(replace(stack, instruments=instruments))
    if key not in _models:
        _models[key] = cached_model(stack, instruments, effects, aids, executor)
    _spent.append(time.process_time() - begun)
    return _models[key]
