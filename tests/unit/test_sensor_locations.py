"""Displacements of points that are not where the file has them."""

from dataclasses import replace

import numpy as np

from model import Observation, observe, read_stack, reduce
from updating.diagnosis.stack_model import location_slopes


def test_slopes_are_those_of_displacements_and_points_at_an_edge_move_inwards(tmp_path, stack_text):
    path = tmp_path / "stack.toml"
    path.write_text(stack_text.replace("n_lamina = 240", "n_lamina = 12\n[mesh]\nn_x = 6\nn_y = 2"), encoding="utf-8")
    system = reduce(read_stack(path), G_f_range=(500.0, 2000.0), n_snapshot=2, n_mode=10)
    location = np.array([[0.05, 0.01, 0.0], [system.stack.length / 2.0, 0.0, 0.0]])
    normal = np.tile([0.0, 0.0, 1.0], (2, 1))
    at = Observation(node=np.array([1, 2]), location=location, direction=normal)
    slope = location_slopes(system, at)

    def moved(step):
        return observe(system, replace(at, location=location + step)).reduced_rows

    for axis in (0, 1):
        step = 1e-4 * np.eye(3)[axis]
        expected = (moved(step)[0] - moved(-step)[0]) / 2e-4
        np.testing.assert_allclose(slope[0, axis], expected, atol=1e-2 * np.abs(expected).max())
    inwards = (moved(0.0) - moved(np.array([-1e-4, 0.0, 0.0])))[1] / 1e-4
    np.testing.assert_allclose(slope[1, 0], inwards, atol=2e-2 * np.abs(inwards).max())
