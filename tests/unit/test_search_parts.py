"""What is best is also fitted without some of its effects, from where it stands."""

from types import SimpleNamespace

import numpy as np

from updating.diagnosis.search import _parts


def parameter(name):
    return SimpleNamespace(name=name)


OF = {"inertia": ("inertia", "station"), "mass": ("mass",), "place": ("place",)}
EVIDENCE = SimpleNamespace(parameters=lambda names: tuple(parameter(p) for name in names for p in OF[name]))


def explanation(coordinates, nuisance=(0.5,)):
    """The most probable explanation, with the coordinates of each of its effects."""
    return SimpleNamespace(
        effects=tuple(coordinates),
        parameter=tuple(parameter(p) for name in coordinates for p in OF[name]),
        coordinate=np.concatenate([np.zeros(0), *coordinates.values()]),
        nuisance=np.array(nuisance),
    )


def test_every_part_begins_where_the_whole_stands():
    starts = _parts(EVIDENCE, explanation({"mass": [3.0], "inertia": [1.0, 2.0], "place": [4.0]}))
    places = {tuple(start.effects): start.coordinate.tolist() for start in starts}
    assert places == {
        ("mass",): [3.0], ("inertia",): [1.0, 2.0], ("place",): [4.0],
        ("mass", "inertia"): [3.0, 1.0, 2.0], ("mass", "place"): [3.0, 4.0],
        ("inertia", "place"): [1.0, 2.0, 4.0],
    }  # fmt: skip
    assert all(start.nuisance.tolist() == [0.5] for start in starts)


def test_one_effect_and_the_base_model_have_no_parts():
    assert _parts(EVIDENCE, explanation({"mass": [3.0]})) == []
    assert _parts(EVIDENCE, explanation({})) == []
