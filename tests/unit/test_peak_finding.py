"""Peaks are those that SciPy finds."""

import numpy as np
import pytest
from scipy import signal

from ema.quality.peaks import find_peaks, peak_widths


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("digits", [0, 1, 9])  # rounded, it has flat tops and equal heights
def test_peaks_are_those_of_scipy(seed, digits):
    rng = np.random.default_rng(seed)
    level = np.round(np.cumsum(rng.standard_normal(700)) + 3 * rng.standard_normal(700), digits)
    lines, prominence = find_peaks(level, 2.0)
    right, properties = signal.find_peaks(level, prominence=2.0)
    np.testing.assert_array_equal(lines, right)
    np.testing.assert_array_equal(prominence, properties["prominences"])
    np.testing.assert_allclose(peak_widths(level, lines), signal.peak_widths(level, right, rel_height=0.5)[0])


@pytest.mark.parametrize(
    "level", [[], [1.0], [1.0, 2.0], [1.0, 1.0, 1.0], [3.0, 2.0, 1.0], [0.0, 1.0, 0.0], [0.0, 2.0, 2.0]]
)
def test_short_curves(level):
    level = np.array(level)
    lines, _ = find_peaks(level, 0.5)
    np.testing.assert_array_equal(lines, signal.find_peaks(level, prominence=0.5)[0])
    assert peak_widths(level, lines).size == lines.size
