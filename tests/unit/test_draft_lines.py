"""Trace lines that `lamella new` guesses from where the points are."""

import itertools
import shutil
from itertools import pairwise
from pathlib import Path

import numpy as np
from typer.testing import CliRunner

from ema.campaign.campaign import read_campaign
from ema.campaign.draft_file import trace_lines
from updating.commands.command_line import app

DATA = Path(__file__).parents[2] / "data"
rng = np.random.default_rng(1)


def edges(node, coordinate):
    lines = trace_lines(np.asarray(node), np.asarray(coordinate, dtype=float))
    return {frozenset(pair) for line in lines for pair in pairwise(line)}


def test_a_grid_is_joined_along_its_axes_and_nowhere_across():
    place = np.array(list(itertools.product(range(5), range(3), [0.0])), dtype=float)
    place += 1e-5 * rng.standard_normal(place.shape)  # as measured by hand
    number = 10 + rng.permutation(len(place))  # numbers say nothing of the order
    found = edges(number, place)
    assert len(found) == 4 * 3 + 5 * 2
    at = dict(zip(number.tolist(), place, strict=True))
    assert all(np.isclose(np.linalg.norm(at[a] - at[b]), 1.0, atol=1e-3) for a, b in map(tuple, found))


def test_points_in_a_row_are_one_line_in_the_order_along_it():
    assert trace_lines(np.array([7, 3, 5]), np.array([[2.0, 0, 0], [0, 0, 0], [1, 0, 0]])) == [[3, 5, 7]]
    assert trace_lines(np.array([7]), np.zeros((1, 3))) == []


def test_a_hole_in_a_grid_is_not_bridged():
    place = np.array([p for p in itertools.product(range(9), range(9), [0.0]) if not (1 < p[0] < 7 and 1 < p[1] < 7)])
    at = dict(enumerate(place))
    assert all(np.linalg.norm(at[a] - at[b]) < 1.5 for a, b in map(tuple, edges(range(len(place)), place)))


def test_points_at_no_grid_are_triangles_on_the_faces():
    angle = np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False)
    ring = np.vstack([np.column_stack([r * np.cos(angle + r), r * np.sin(angle + r)]) for r in (1.0, 1.4)])
    flat = np.column_stack([ring, np.zeros(len(ring))])
    found = edges(range(24), flat)
    assert {n for edge in found for n in edge} == set(range(24))
    both = np.vstack([flat, flat + np.array([0.0, 0.0, 0.5])])
    found = edges(range(48), both)
    inside = [edge for edge in found if len({n < 24 for n in edge}) == 1]
    assert len(inside) == len(found)  # of each face alone: no line goes through the body
    assert {n for edge in found for n in edge} == set(range(48))


def test_the_file_that_new_writes_draws_lines(tmp_path):
    for name in ("M1", "points.csv"):
        source = DATA / "demo_stack" / name
        (shutil.copytree if source.is_dir() else shutil.copy)(source, tmp_path / name)
    done = CliRunner().invoke(app, ["new", str(tmp_path)])
    assert done.exit_code == 0, done.output
    drawn, by_hand = (
        {frozenset(pair) for pair in read_campaign(folder / "campaign.toml").geometry.line.tolist()}
        for folder in (tmp_path, DATA / "demo_stack")
    )
    assert drawn == by_hand
