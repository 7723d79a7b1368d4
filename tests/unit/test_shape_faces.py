"""Faces between trace lines."""

import numpy as np

from updating.fitting.plots import faces


def test_a_block_of_points_has_its_six_faces():
    line = np.array([(a, a | b) for a in range(8) for b in (1, 2, 4) if not a & b])
    found = faces(line)
    assert len(found) == 12
    corner = np.array([[a & 1, (a >> 1) & 1, a >> 2] for a in range(8)], float)
    ends = corner[found]
    area = 0.5 * np.linalg.norm(np.cross(ends[:, 1] - ends[:, 0], ends[:, 2] - ends[:, 0]), axis=1)
    np.testing.assert_allclose(area, 0.5)  # half a face each: none goes through the block
    flat = np.ptp(ends, axis=1) == 0.0
    assert sorted((int(np.flatnonzero(f)[0]), float(e[0, f][0])) for f, e in zip(flat, ends, strict=True)) == sorted(
        2 * [(axis, side) for axis in range(3) for side in (0.0, 1.0)]
    )


def test_a_ring_with_a_line_across_is_filled_once():
    assert faces(np.array([[0, 1], [1, 2], [2, 3], [3, 0], [0, 2]])).tolist() == [[0, 1, 2], [0, 2, 3]]


def test_lines_that_enclose_nothing_have_no_face():
    assert faces(np.array([[0, 1], [1, 2], [2, 2]])).shape == (0, 3)
    assert faces(np.empty((0, 2), int)).shape == (0, 3)
