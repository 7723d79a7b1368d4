"""Measured points that are not where the file has them, on a bar whose shapes and slopes are known."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.linalg as la

from model import Observation, observe, read_stack, reduce
from updating.diagnosis.sensor_place import USUAL, Seen, error_of_places, motion, place_slopes

LENGTH, N_DOF, N_MEASURED, N_REACHED = 0.3, 30, 6, 10
PLACE = np.linspace(-0.49, 0.49, N_DOF) * LENGTH
ROOT = np.array([4.730041, 7.853205, 10.995608, 14.137165, 17.278760, 20.420352, 23.561945, 26.703538])
NOISE = 2e-4


def shapes(x):
    """Return bending shapes of a free bar at places from its middle, with their slopes: (n, 8) each."""
    k = ROOT / LENGTH
    at = k * (np.asarray(x)[:, None] + LENGTH / 2.0)
    s = (np.cosh(ROOT) - np.cos(ROOT)) / (np.sinh(ROOT) - np.sin(ROOT))
    value = np.cosh(at) + np.cos(at) - s * (np.sinh(at) + np.sin(at))
    slope = k * (np.sinh(at) - np.sin(at) - s * (np.cosh(at) + np.cos(at)))
    return value, slope


def seen(rng, moved, scatter, worse=None):
    """Shapes of two configurations, measured at places that are off by `moved`, m, each with scatter of its own."""
    (stated, slope), (true, _) = shapes(PLACE), shapes(PLACE + moved)
    reached = la.orth(np.hstack([stated, np.ones((N_DOF, 1)), PLACE[:, None]]))
    found = []
    for _ in range(2):
        for mode in range(N_MEASURED):
            length = np.linalg.norm(stated[:, mode])
            size = 0.08 if mode == worse else scatter
            drawn = rng.normal(size=N_DOF) * np.hypot(size / np.sqrt(N_DOF), NOISE)
            found.append(
                Seen(
                    shape=true[:, mode] / length + drawn,
                    slope=np.diag(slope[:, mode] / length),
                    std=np.full(N_DOF, NOISE),
                    reached=reached,
                )
            )
    return found


@pytest.mark.parametrize("seed", range(4))
def test_errors_of_a_millimetre_and_scatter_are_told_apart(seed):
    rng = np.random.default_rng(seed)
    place, scatter = error_of_places(seen(rng, 1e-3 * rng.normal(size=N_DOF), 5e-3))
    assert 0.7e-3 <= place <= 1.5e-3
    assert scatter == pytest.approx(5e-3)


@pytest.mark.parametrize("seed", range(4))
def test_points_that_are_where_they_should_be(seed):
    rng = np.random.default_rng(seed)
    place, scatter = error_of_places(seen(rng, np.zeros(N_DOF), 2e-2))
    assert place <= 0.4 * USUAL
    assert scatter == pytest.approx(2e-2)
    assert error_of_places(seen(rng, np.zeros(N_DOF), 0.0))[1] <= 1e-3


def test_what_a_laboratory_states_is_taken_as_stated():
    rng = np.random.default_rng(5)
    own = seen(rng, 1e-3 * rng.normal(size=N_DOF), 5e-3)
    assert error_of_places(own, 3e-4)[0] == 3e-4


def test_a_shape_that_is_far_worse_than_the_others_has_a_scatter_of_its_own():
    rng = np.random.default_rng(6)
    own = seen(rng, 1e-3 * rng.normal(size=N_DOF), 5e-3, worse=2)
    found = [each.scatter(1e-3, 5e-3) for each in own]
    for i, scatter in enumerate(found):
        assert scatter == (pytest.approx(0.08, rel=0.4) if i % N_MEASURED == 2 else 5e-3)


def test_slopes_are_those_of_displacements_and_points_at_an_edge_move_inwards(tmp_path, stack_text):
    path = tmp_path / "stack.toml"
    path.write_text(
        stack_text.replace("n_lamina = 240", "n_lamina = 12\n[mesh]\nn_x = 6\nn_y = 2"), encoding="utf-8"
    )
    system = reduce(read_stack(path), G_f_range=(500.0, 2000.0), n_snapshot=2, n_mode=10)
    location = np.array([[0.05, 0.01, 0.0], [system.stack.length / 2.0, 0.0, 0.0]])
    normal = np.tile([0.0, 0.0, 1.0], (2, 1))
    at = Observation(node=np.array([1, 2]), location=location, direction=normal)
    slope = place_slopes(system, at)

    def moved(step):
        return observe(system, replace(at, location=location + step)).reduced_rows

    for axis in (0, 1):
        step = 1e-4 * np.eye(3)[axis]
        expected = (moved(step)[0] - moved(-step)[0]) / 2e-4
        np.testing.assert_allclose(slope[0, axis], expected, atol=1e-2 * np.abs(expected).max())
    inwards = (moved(0.0) - moved(np.array([-1e-4, 0.0, 0.0])))[1] / 1e-4
    np.testing.assert_allclose(slope[1, 0], inwards, atol=2e-2 * np.abs(inwards).max())


def test_close_modes_are_measured_in_the_mixture_that_they_make():
    """Two of them mixed by 45 degrees, one alone and turned; each with a little of a far one, which is no mixture."""
    rng, root = np.random.default_rng(2), np.sqrt(0.5)
    shape = la.orth(rng.normal(size=(N_DOF, 4))) * [1.0, 2.0, 3.0, 4.0]
    modes = SimpleNamespace(frequency=np.array([100.0, 240.0, 241.0, 400.0]), coordinate=np.eye(4))
    unit = shape / np.linalg.norm(shape, axis=0)
    mixed = unit @ np.array([[0.0, root, root, 0.01], [-1.0, 0.0, 0.0, 0.01]]).T
    found = motion(modes, mixed, shape, np.array([1, 0]))
    np.testing.assert_allclose(
        found.T, [[0.0, root / 2.0, root / 3.0, 0.0], [-1.0, 0.0, 0.0, 0.0]], atol=1e-12
    )
