"""When a further term is no more than the error of the form of one that is there."""

from types import SimpleNamespace

import numpy as np

from updating.pooled import search
from updating.pooled.linear import Place, Scales
from updating.pooled.screening import Screened
from updating.pooled.search import Found, is_form
from updating.pooled.specimen import Level
from updating.pooled.term import Term

RIG = Level(kind="rig", of="", members=(0, 1))
ODD = Level(kind="specimen", of="S2", members=(1,))
FIRST, FURTHER = Term(effect="clamp_inertia", level=RIG), Term(effect="clamp_mass", level=RIG)
GLUED = Term(effect="adhesive_edges", level=ODD)


def fitted(terms, *misfit):
    """A fit with some squared residuals in each specimen; what priors leave does not count."""
    found = [
        SimpleNamespace(value=np.array([np.sqrt(own), 9.0]), kind=np.array(["frequency", "prior"]))
        for own in misfit
    ]
    return SimpleNamespace(terms=terms, linear=SimpleNamespace(found=found))


BASE, BEFORE = fitted((), 100.0, 100.0), fitted((FIRST,), 10.0, 10.0)


def test_a_small_share_beside_an_effect_of_the_same_specimens_may_be_its_form():
    assert is_form(BASE, BEFORE, fitted((FIRST, FURTHER), 4.0, 4.0))  # 12 of 180


def test_a_large_share_is_more_than_that():
    assert not is_form(BASE, BEFORE, fitted((FIRST, FURTHER), 1.0, 1.0))  # 18 of 180


def test_what_one_specimen_has_is_no_error_of_form_of_the_rig():
    assert not is_form(BASE, BEFORE, fitted((FIRST, GLUED), 10.0, 9.0))


def test_the_first_term_is_no_error_of_form():
    assert not is_form(BASE, BASE, fitted((FIRST,), 99.0, 99.0))


EACH = Level(kind="each", of="", members=(0, 1))
PLACE = Place(nuisance=(np.zeros(1), np.zeros(1)), coordinate=np.array([0.3, 0.1]))


def test_what_each_specimen_has_as_much_of_as_it_will_is_not_begun_with():
    each = Screened(
        term=Term(effect="clamp_mass", level=EACH), start=np.zeros(2), log_gain=99.0, detectability=9.0
    )
    rig = Screened(term=FIRST, start=np.zeros(1), log_gain=20.0, detectability=9.0)
    begun = search._starts(SimpleNamespace(terms=(), at=PLACE, scales=Scales()), [each, rig])
    assert [own.terms for own in begun] == [(FIRST,)]


def test_of_terms_that_are_of_no_use_beside_each_other_the_weaker_leaves_first(monkeypatch):
    """Together each may as well be neutral; alone the stronger one may not."""
    std = {2: np.array([0.2, 0.2]), 1: np.array([0.05])}
    monkeypatch.setattr(search, "stds", lambda _, own: std[len(own.terms)])
    monkeypatch.setattr(search, "coordinates_of", lambda *_: (None,))
    monkeypatch.setattr(search, "log_prior", lambda *_: 0.0)
    tried = []

    def done(_, starts, *__, **___):
        tried.extend(starts)
        return [
            SimpleNamespace(terms=own.terms, at=own.at, scales=own.scales, log_evidence=5.0) for own in starts
        ]

    monkeypatch.setattr(search, "_done", done)
    both = SimpleNamespace(terms=(FIRST, FURTHER), at=PLACE, scales=Scales(), log_evidence=9.0)
    base = SimpleNamespace(terms=(), at=PLACE, scales=Scales(), log_evidence=0.0)
    found = Found(bench=None, levels=(), base=base, fitted=(both, base), screened=(), n_effect=2)
    left = search._without_neutral(found, None)
    assert [own.terms for own in tried] == [(FIRST,)]
    assert tried[0].at.coordinate.tolist() == [0.3]
    assert left.fitted[0].terms == (FIRST,)
