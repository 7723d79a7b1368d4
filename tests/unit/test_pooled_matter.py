"""What a further term takes off, and whether that is of any matter."""

from types import SimpleNamespace

import numpy as np
import pytest

from updating.pooled import matter
from updating.pooled.linear import Scales
from updating.pooled.matter import matters
from updating.pooled.specimen import Level
from updating.pooled.term import Term


def bench(stated=()):
    evidence = SimpleNamespace(scatter=SimpleNamespace(stated=stated), nuisances=("G_f", "density"))
    own = SimpleNamespace(evidence=evidence, known=np.zeros(2))
    return SimpleNamespace(own=[own, own], nuisance_std={"G_f": np.inf, "density": 0.01})


def fitted(*members, frequency=1e-3, damping=0.01, torque=0.03, density=(0.0, 0.0)):
    """A fit whose second specimen's logarithms are as large as stated, and whose first one's do not change."""
    level = Level(kind="specimen", of="", members=members)
    terms = (Term(effect="adhesive_edges", level=level),) if members else ()
    found = [
        SimpleNamespace(log_frequency=np.full(4, f), log_damping=np.full(4, d))
        for f, d in ((1e-3, 0.01), (frequency, damping))
    ]
    at = SimpleNamespace(nuisance=[np.array([1.0, own]) for own in density])
    linear = SimpleNamespace(found=found)
    return SimpleNamespace(terms=terms, linear=linear, scales=Scales(), torque=torque, at=at)


@pytest.fixture(autouse=True)
def torques(monkeypatch):
    monkeypatch.setattr(matter, "torques_left_out", lambda bench, own: np.array([own.torque]))


@pytest.mark.parametrize(
    ("given", "counts"),
    [
        ({"frequency": 8e-4}, False),  # hundredths of a per cent
        ({"frequency": 8e-4, "torque": 0.006}, True),  # a torque is predicted from the other
        (
            {"frequency": 8e-4, "torque": 0.026},
            False,
        ),  # hardly better, as by lost contact of a hundredth of an end
        ({"frequency": 4e-4}, True),  # what halves the error does
        ({"damping": 0.001}, False),
    ],
)
def test_what_right_models_leave_is_of_no_matter(given, counts):
    assert matters(bench(), fitted(), fitted(1, **given)) == counts


def test_what_one_specimen_has_counts_by_what_it_takes_off_that_one():
    before = fitted(frequency=0.01)
    assert matters(bench(), before, fitted(1, frequency=0.001))
    assert not matters(bench(), before, fitted(0, frequency=0.001))


def test_what_a_laboratory_states_is_no_estimate_that_could_fall():
    assert matters(bench(("frequency",)), fitted(), fitted(1))


@pytest.mark.parametrize(
    ("density", "members", "counts"),
    [
        ((0.04, 0.04), (0, 1), True),  # both stacks of steel four deviations too dense: the rig has a mass
        ((0.04, -0.04), (0, 1), False),  # as many are lighter: that is their steel
        ((0.02, 0.02), (0, 1), False),
        ((0.04, 0.0), (0,), True),
        ((0.04, 0.0), (1,), False),
    ],
)
def test_what_relieves_all_that_have_it_matters(density, members, counts):
    assert matters(bench(), fitted(density=density), fitted(*members)) == counts


def test_half_of_a_tiny_error_is_of_no_matter():
    assert not matters(bench(), fitted(frequency=2e-4), fitted(1, frequency=5e-5))
