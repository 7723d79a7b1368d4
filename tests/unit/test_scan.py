"""The coarse global search: what it makes of parameters that the model cannot have."""

from types import SimpleNamespace

import numpy as np

from model import SolveError
from updating.diagnosis import scan
from updating.diagnosis.scan import Place, with_modes_of


def test_a_place_without_modes_adds_none(monkeypatch):
    """So strong that the contact turns negative, at one pressure if not at another."""

    def solved(*_):
        message = "the stiffness is negative"
        raise SolveError(message)

    monkeypatch.setattr(scan, "solved", solved)
    evidence = SimpleNamespace(used=(np.array([0, 2]),), tested=(None,), parameters=lambda _: ())
    place = Place(effect="contact_offset", cost=np.inf, G_f=1500.0, coordinate=np.empty(0))
    assert with_modes_of(evidence, [place]) is evidence.used
