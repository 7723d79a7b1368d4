"""The coarse global search: what it makes of parameters that the model cannot have."""

from types import SimpleNamespace

import numpy as np

from model import Parameter, SolveError
from updating.diagnosis import scan
from updating.diagnosis.scan import Place, with_modes_of


def test_a_place_without_modes_adds_none(monkeypatch):
    """So strong that the contact turns negative, at one pressure if not at another."""

    def solved(*_):
        message = "the stiffness is negative"
        raise SolveError(message)

    monkeypatch.setattr(scan, "solved", solved)
    evidence = SimpleNamespace(used=(np.array([0, 2]),), tested=(None,), parameters=lambda _: (), rough=None)
    evidence.rough = evidence
    place = Place(effect="contact_offset", cost=np.inf, G_f=1500.0, coordinate=np.empty(0))
    assert with_modes_of(evidence, [place]) is evidence.used


def test_a_weak_effect_of_a_range_that_reaches_far_is_looked_at():
    """The inertia of four clamps was a fortieth of the largest that is plausible."""
    inertia = Parameter(name="inertia", unit="kg m2", nominal=3e-3, lower=0.0, upper=0.03, source="a drawing")
    places = [float(where[0]) for where in scan._grid((inertia,))]
    assert min(abs(np.log(place / (1.0 / 40.0))) for place in places) < np.log(2.0)
