"""The pooled diagnosis on cases that an independent model made: part of `make blind`, resumable."""

import pytest

from tests.independent.layered import Layered
from tests.studies.pooled import KINDS, PooledCase, drawn, figures, study_of

OUT = "out/blind/pooled.jsonl"
NUMBER = 60


def case(**given):
    made = {
        "seed": 1, "kind": "specimen", "planted": {"adhesive_edges": {"modulus": 5e7}}, "members": (3,),
        "truth": "adhesive_edges", "verdict": "identified",
        "named": (("adhesive_edges", "specimen", ("S4",)),), "left": ((("adhesive_edges", "specimen"),),),
        "odd": ("S4",), "shows": True, "alone": None,
    }  # fmt: skip
    return PooledCase(**(made | given))


def shares(cases):
    return {one.name: (one.hits, one.total) for one in figures(cases)}


def test_an_effect_at_another_level_is_not_right():
    wrong = case(named=(("adhesive_edges", "rig", ("S1", "S2")),), odd=())
    other = case(named=(("adhesive_edges", "specimen", ("S2",)),), odd=("S2",))
    found = shares([case(), wrong, other])
    assert found["effect and its level right"] == (1, 3)
    assert found["the effect among those named, at any level"] == (3, 3)
    assert found["odd specimen found"] == (1, 3)
    assert found["others called odd"] == (1, 15)


def test_nothing_named_is_right_where_nothing_is():
    none = {"kind": "null", "planted": {}, "members": (), "truth": "", "odd": ()}
    found = shares([case(**none, named=()), case(**none)])
    assert found["nothing named where nothing is"] == (1, 2)


@pytest.mark.parametrize(("kind", "number"), list(zip(KINDS, (6, 3, 1, 0), strict=True)))
def test_as_many_specimens_have_it_as_the_kind_says(kind, number):
    planted, members = drawn(5, kind)
    assert len(members) == number
    assert len(planted) == (number > 0)


@pytest.mark.blind
def test_pooled_cases(capsys, request):
    """Every figure is printed; of false alarms no more are left than chance explains."""
    with capsys.disabled():
        cases = study_of(NUMBER, Layered(), request.config.rootpath / OUT)
        for one in figures(cases):
            print(one.row, flush=True)
    hits, total = shares(cases)["others called odd"]
    assert hits <= 0.05 * total
