"""When a further term is no more than the error of the form of one that is there."""

from types import SimpleNamespace

import numpy as np
import pytest

from updating.pooled import search
from updating.pooled.fit import Fitted
from updating.pooled.linear import Place, Scales
from updating.pooled.search import is_form
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


@pytest.mark.parametrize(("left", "beyond"), [(4.0, False), (1.0, True)])
def test_another_level_of_a_term_is_asked_for_more_than_a_form_too(monkeypatch, left, beyond):
    """Two explanations of one term each were fitted; beside the better of them the other brings a small share."""
    monkeypatch.setattr(search, "matters", lambda bench, before, after: True)
    found = SimpleNamespace(base=BASE, bench=None, fitted=(BEFORE, fitted((FURTHER,), 90.0, 90.0), BASE))
    assert search._is_beyond_form(found, fitted((FURTHER, FIRST), left, left)) == beyond
    assert search._is_beyond_form(found, fitted((FURTHER,), 99.0, 99.0))


def searched(monkeypatch, std, odds):
    """What is left of two terms of the rig, by the standard deviations of these and the odds without either."""
    terms = FIRST, FURTHER
    values = {terms: 50.0, (FIRST,): odds, (FURTHER,): odds, (): 0.0}

    def own(terms):
        at = Place(nuisance=(), coordinate=np.ones(len(terms)))
        return SimpleNamespace(terms=terms, at=at, scales=Scales(), log_evidence=values[terms])

    monkeypatch.setattr(search, "stds", lambda bench, best: np.array(std)[: len(best.terms)])
    monkeypatch.setattr(search, "coordinates_of", lambda bench, term: (term,))
    monkeypatch.setattr(search, "log_prior", lambda n, term, levels: 0.0)
    monkeypatch.setattr(
        search, "_done", lambda bench, starts, executor, settled: [own(s.terms) for s in starts]
    )
    found = search.Found(
        bench=None, levels=(RIG,), base=own(()), fitted=(own(terms), own(())), screened=(), n_effect=2
    )
    return search._without_neutral(found, None).fitted[0].terms


def test_of_two_terms_that_do_the_same_one_stays(monkeypatch):
    assert searched(monkeypatch, (0.9, 0.8), odds=49.0) == (
        FURTHER,
    )  # each alone is far from neutral, or the last


def test_a_term_that_brings_much_stays_though_it_may_be_neutral(monkeypatch):
    assert searched(monkeypatch, (0.9, 0.8), odds=3.0) == (FIRST, FURTHER)


def placed(monkeypatch, rough, settled):
    """Where an explanation of two terms at 0.2 is in the end, by evidences of fits there and at another place, 0.7."""
    terms = FIRST, FURTHER

    def own(start, evidence):
        return Fitted(
            terms=terms, coordinates=(), at=start.at, scales=Scales(), linear=None, log_evidence=evidence
        )

    def done(bench, starts, executor, settled):
        return [own(start, evidence) for start, evidence in zip(starts, values[settled], strict=True)]

    def at(z):
        return Place(nuisance=(), coordinate=np.array([z, 0.0]))

    values = {False: rough, True: settled}
    there = search.Start(terms=terms, at=at(0.7), scales=Scales(), most=9, weighed=True)
    monkeypatch.setattr(search, "elsewhere", lambda bench, best: [there])
    monkeypatch.setattr(search, "_with_shapes_in_common", lambda bench, starts, executor: bench)
    monkeypatch.setattr(search, "roughly", lambda bench, at, coordinates: bench)
    monkeypatch.setattr(search, "log_prior", lambda n, term, levels: 0.0)
    monkeypatch.setattr(search, "_done", done)
    monkeypatch.setattr(search, "_weighed", lambda found, best, executor: found)
    best, base = own(SimpleNamespace(at=at(0.2)), 50.0), SimpleNamespace(terms=(), log_evidence=0.0)
    found = search.Found(bench=None, levels=(RIG,), base=base, fitted=(best, base), screened=(), n_effect=2)
    found, top = search._at_better_place(found, best, None)
    assert top in found.fitted
    return top.at.coordinate[0], top.log_evidence


def test_an_explanation_moves_to_a_better_place_of_its_effects(monkeypatch):
    """By as much as it is better there by the same weights, which are not those of what was found before."""
    assert placed(monkeypatch, rough=(-700.0, -690.0), settled=(-698.0, -691.0)) == (0.7, 57.0)


@pytest.mark.parametrize(("rough", "settled"), [((-690.0, -700.0), ()), ((-700.0, -690.0), (-691.0, -692.0))])
def test_an_explanation_stays_where_no_other_place_is_better(monkeypatch, rough, settled):
    assert placed(monkeypatch, rough, settled) == (0.2, 50.0)


def test_fits_by_the_modes_of_the_best_begin_with_sizes_of_their_own(monkeypatch):
    """What takes no part at any of several places takes none then either: it had led fits astray."""
    seen = []

    def done(bench, starts, executor, settled):
        seen.append((bench, [start.scales for start in starts]))
        return [own(start.terms, start.at) for start in starts]

    def own(terms, at):
        return Fitted(terms=terms, coordinates=(), at=at, scales=Scales(), linear=None, log_evidence=9.0)

    at = Place(nuisance=(), coordinate=np.zeros(1))
    base, best = own((), at), own((FIRST,), at)
    monkeypatch.setattr(search, "weighed_at", lambda bench, at, coordinates: bench)
    monkeypatch.setattr(search, "log_prior", lambda n, term, levels: 0.0)
    monkeypatch.setattr(search, "_done", done)
    bench = SimpleNamespace(apart=(frozenset({1}),))
    found = search.Found(bench=bench, levels=(RIG,), base=base, fitted=(best, base), screened=(), n_effect=2)
    search._weighed(found, best, None)
    ((weighed, scales),) = seen
    assert weighed.apart == (frozenset({1}),)
    assert scales == [None, None]
