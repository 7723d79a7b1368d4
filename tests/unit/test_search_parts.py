"""What is best is also fitted without some of its effects, and an effect with a place from each place it ended at."""

from types import SimpleNamespace

import numpy as np

from updating.diagnosis.discrepancy import Sizes
from updating.diagnosis.search import _best_of_each_place, _from_alone, _parts
from updating.diagnosis.starts import Start


def parameter(name):
    return SimpleNamespace(name=name)


OF = {"inertia": ("inertia", "station"), "mass": ("mass",), "place": ("place",)}
EVIDENCE = SimpleNamespace(parameters=lambda names: tuple(parameter(p) for name in names for p in OF[name]))


SMALL, LARGE = Sizes(frequency=1e-4), Sizes(frequency=0.1)
BASE = SimpleNamespace(effects=(), likeliest=LARGE)
FITTED = [SimpleNamespace(effects=("mass",), likeliest=SMALL)]


def explanation(coordinates, nuisance=(0.5,)):
    """The most probable explanation, with the coordinates of each of its effects."""
    return SimpleNamespace(
        effects=tuple(coordinates),
        parameter=tuple(parameter(p) for name in coordinates for p in OF[name]),
        coordinate=np.concatenate([np.zeros(0), *coordinates.values()]),
        nuisance=np.array(nuisance),
    )


def test_every_part_begins_where_the_whole_stands():
    starts = _parts(
        EVIDENCE, explanation({"mass": [3.0], "inertia": [1.0, 2.0], "place": [4.0]}), BASE, FITTED
    )
    places = {tuple(start.effects): start.coordinate.tolist() for start in starts}
    assert places == {
        ("mass",): [3.0], ("inertia",): [1.0, 2.0], ("place",): [4.0],
        ("mass", "inertia"): [3.0, 1.0, 2.0], ("mass", "place"): [3.0, 4.0],
        ("inertia", "place"): [1.0, 2.0, 4.0],
    }  # fmt: skip
    assert all(start.nuisance.tolist() == [0.5] for start in starts)
    sizes = {tuple(start.effects): start.sizes for start in starts}
    assert sizes.pop(("mass",)) is SMALL
    assert set(sizes.values()) == {LARGE}


def test_one_effect_and_the_base_model_have_no_parts():
    assert _parts(EVIDENCE, explanation({"mass": [3.0]}), BASE, FITTED) == []
    assert _parts(EVIDENCE, explanation({}), BASE, FITTED) == []


def fitted(effect, coordinate, log_evidence):
    return SimpleNamespace(effects=(effect,), coordinate=np.array(coordinate), log_evidence=log_evidence)


def test_fits_that_ended_apart_are_all_kept_and_of_one_place_the_best():
    fits = [
        fitted("inertia", [0.1, -0.6], 5.0), fitted("inertia", [0.1, 0.0], 9.0), fitted("mass", [0.2], 1.0),
        fitted("inertia", [0.12, 0.02], 8.0), fitted("inertia", [0.1, -0.61], 6.0),
    ]  # fmt: skip
    kept = [(own.effects[0], own.log_evidence) for own in _best_of_each_place(fits)]
    assert kept == [("inertia", 9.0), ("inertia", 6.0), ("mass", 1.0)]


def test_a_further_effect_with_a_place_also_starts_where_it_ended_alone():
    singles = [fitted("inertia", [0.3, 0.4], 5.0), fitted("mass", [0.2], 1.0)]
    starts = [
        Start(("mass", "inertia"), np.zeros(1), np.array([0.1, 0.0, 0.0]), 8),
        Start(("inertia", "mass"), np.zeros(1), np.array([0.0, 0.0, 0.1]), 8),
    ]
    further = _from_alone(starts, singles)
    assert [(own.effects, own.coordinate.tolist()) for own in further] == [
        (("mass", "inertia"), [0.1, 0.3, 0.4])
    ]
