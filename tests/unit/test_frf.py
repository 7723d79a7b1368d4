"""The block of FRFs: selections and conversion between quantities."""

from dataclasses import replace

import numpy as np
import pytest

from ema.types.frf import FRF, Dofs, place_in_run

FREQUENCY = np.arange(0.0, 50.0, 2.0)
OMEGA = 2 * np.pi * FREQUENCY
RECEPTANCE = 1 / (1e4 - OMEGA**2 + 20j * OMEGA)


@pytest.fixture
def frf():
    return FRF(
        frequency=FREQUENCY,
        value=np.array([[RECEPTANCE], [-2 * RECEPTANCE]]),
        quantity="receptance",
        output=Dofs(node=[1, 2], direction=[[0, 0, 1], [0, 0, -1]]),
        input=Dofs(node=[1], direction=[[0, 0, 1]]),
        run=[0, 1],
        source=("a", "b"),
        coherence=np.ones((2, 1, FREQUENCY.size)),
    )


def test_differentiation_is_multiplication_by_i_omega(frf):
    np.testing.assert_allclose(frf.convert("mobility").value[0, 0], 1j * OMEGA * RECEPTANCE)
    np.testing.assert_allclose(frf.convert("accelerance").value[1, 0], 2 * OMEGA**2 * RECEPTANCE)
    assert frf.convert("accelerance").frequency.size == FREQUENCY.size


def test_integration_leaves_out_the_line_at_zero(frf):
    back = frf.convert("accelerance").convert("receptance")
    assert back.quantity == "receptance"
    np.testing.assert_array_equal(back.frequency, FREQUENCY[1:])
    np.testing.assert_allclose(back.value, frf.value[..., 1:])
    assert back.coherence.shape == back.value.shape


def test_selections(frf):
    second = frf.outputs(np.array([False, True])).band(10, 20)
    assert second.source == ("b",)
    assert second.run.tolist() == [1]
    np.testing.assert_array_equal(second.output.direction, [[0, 0, -1]])
    np.testing.assert_array_equal(second.frequency, [10, 12, 14, 16, 18, 20])
    np.testing.assert_array_equal(second.value[0, 0], frf.value[1, 0, 5:11])


def test_a_sensor_is_the_place_among_the_outputs_of_a_run(frf):
    assert frf.sensor.tolist() == [0, 0]
    assert replace(frf, run=[3, 3]).sensor.tolist() == [0, 1]
    assert place_in_run(np.array([0, 1, 0, 2, 1, 0])).tolist() == [0, 0, 1, 0, 1, 2]


def test_arrays_are_checked_and_read_only(frf):
    with pytest.raises(ValueError, match=r"FRF.value: expected shape \(2, 1, 25\), got \(1, 1, 25\)"):
        replace(frf, value=frf.value[:1])
    with pytest.raises(ValueError, match=r"FRF\.source: expected 2 entries, got 1"):
        replace(frf, source=("a",))
    with pytest.raises(ValueError, match="read-only"):
        frf.value[0, 0, 0] = 1
