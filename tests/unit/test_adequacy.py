"""Whether what an explanation leaves is what a right model may leave."""

from types import SimpleNamespace

import numpy as np
import pytest

from updating.diagnosis.adequacy import p_value, too_large
from updating.diagnosis.discrepancy import KINDS, MEDIAN, Sizes
from updating.diagnosis.evidence import DiagnosisScatter

UNKNOWN = SimpleNamespace(scatter=DiagnosisScatter())


def leaving(**factor):
    """An explanation that leaves so many times what is usual of some kinds of data, and of the others what is."""
    return SimpleNamespace(mean=Sizes(**{kind: MEDIAN[kind] * factor.get(kind, 1.0) for kind in KINDS}))


@pytest.mark.parametrize("kind", KINDS)
def test_one_of_twenty_right_models_leaves_five_times_what_is_usual(kind):
    assert p_value(UNKNOWN, leaving(), kind) == pytest.approx(0.5)
    assert p_value(UNKNOWN, leaving(**{kind: 5.0}), kind) == pytest.approx(0.05, rel=1e-2)
    assert p_value(UNKNOWN, leaving(**{kind: 0.2}), kind) == pytest.approx(0.95, rel=1e-2)


@pytest.mark.parametrize("kind", KINDS)
def test_the_kind_in_which_too_much_is_left_is_named(kind):
    assert too_large(UNKNOWN, leaving()) == ()
    assert too_large(UNKNOWN, leaving(**{kind: 4.8})) == ()
    assert too_large(UNKNOWN, leaving(**{kind: 5.2})) == (kind,)
    assert too_large(UNKNOWN, leaving(**dict.fromkeys(KINDS, 6.0))) == KINDS


def test_what_a_laboratory_states_is_no_question():
    stated = SimpleNamespace(scatter=DiagnosisScatter(frequency=0.1))
    assert p_value(stated, leaving(frequency=30.0), "frequency") == 1.0
    assert too_large(stated, leaving(frequency=30.0, shape=6.0)) == ("shape",)


def test_more_left_is_never_more_adequate():
    sizes = np.geomspace(0.01, 100.0, 30)
    found = [p_value(UNKNOWN, leaving(shape=size), "shape") for size in sizes]
    assert np.all(np.diff(found) < 0.0)
