"""A place is told only where something there explains most of what is left."""

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from updating.diagnosis import point_change as module
from updating.diagnosis.point_change import point_change


@dataclass(frozen=True)
class Equations:
    terms: tuple
    theta: dict


@dataclass(frozen=True)
class Fake:
    equations: Equations
    observed: Any
    effects: dict


def told(monkeypatch, gain, misfit):
    """Return what is told where a spring at the second of two points lowers a misfit of 700 differences."""

    def screened(evidence, _):
        return [
            SimpleNamespace(
                effect=name,
                log_gain=0.5 * gain if name == "spring_1" else 0.0,
                gain=gain if name == "spring_1" else 0.0,
                parameter=effect.parameters,
                start=np.array([-0.1]),
            )
            for name, effect in evidence.effects.items()
        ]

    monkeypatch.setattr(module, "screen", screened)
    observed = SimpleNamespace(node=np.array([3, 4]), reduced_rows=np.eye(2))
    evidence = Fake(equations=Equations((), {}), observed=(observed,), effects={})
    at = SimpleNamespace(effects=(), misfit=misfit, residual=SimpleNamespace(value=np.zeros(700)))
    return point_change(evidence, at)


@pytest.mark.parametrize(("gain", "misfit"), [(48.0, 506.0), (900.0, 2000.0)])
def test_what_explains_most_of_what_is_left_is_told(monkeypatch, gain, misfit):
    found = told(monkeypatch, gain, misfit)
    assert (found.node, found.kind) == (4, "spring")


@pytest.mark.parametrize(("gain", "misfit"), [(20.0, 1.8e6), (600.0, 2000.0)])
def test_what_explains_little_of_what_is_left_is_not(monkeypatch, gain, misfit):
    assert told(monkeypatch, gain, misfit) is None
