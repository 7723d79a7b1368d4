"""Subset selection: the parameters that data resolve, the best known first."""

import numpy as np
import pytest

from updating.fitting.subset import select


def test_the_strongest_comes_first_and_a_twin_gains_nothing():
    column = np.array([[1.0], [2.0], [0.0]])
    other = np.array([[0.0], [0.0], [5.0]])
    order, gain = select(np.hstack([0.5 * column, column, other]))
    assert order.tolist() == [2, 1, 0]
    assert gain == pytest.approx([0.0, np.sqrt(5.0), 5.0], abs=1e-12)


def test_what_two_parameters_share_counts_once():
    order, gain = select(np.array([[3.0, 3.0], [0.0, 4.0]]))
    assert order.tolist() == [1, 0]
    assert gain == pytest.approx([3.0 * 0.8, 5.0])  # sine of the angle between the two is 4/5


def test_more_parameters_than_data_leave_some_without_gain():
    gain = select(np.ones((1, 3)))[1]
    assert np.count_nonzero(gain) == 1
